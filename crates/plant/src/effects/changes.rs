//! Effects that do nothing but change constants of the vehicle.

use super::constants::Constants;
use super::declaration::Setup;
use super::hooks::{ActiveEffect, Hooks};

/// An effect that does nothing but change constants.
#[derive(Debug, Clone)]
pub(crate) struct Changes<const N: usize> {
    values: [f64; N],
    rotor: usize,
    change: fn(&mut Constants, &[f64; N], usize),
}

impl<const N: usize> Changes<N> {
    /// `change` gets the constants, the parameters in the order of the declaration, and the rotor from 0.
    pub(crate) fn boxed(setup: &Setup<'_>, change: fn(&mut Constants, &[f64; N], usize)) -> Box<dyn ActiveEffect> {
        Box::new(Self {
            values: std::array::from_fn(|i| setup.values[i]),
            rotor: setup.rotor,
            change,
        })
    }
}

impl<const N: usize> ActiveEffect for Changes<N> {
    fn hooks(&self) -> Hooks {
        Hooks::CONSTANTS
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn constants(&self, constants: &mut Constants) {
        (self.change)(constants, &self.values, self.rotor);
    }
}
