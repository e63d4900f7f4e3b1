//! Thrust of a healthy vehicle's rotors: the nominal thrust f̄ of Eq. 19 with a choice of rotor dynamics.
//!
//! Feeds the residual generators. Three choices: the static map (the paper), the map through a first-order rotor lag (§6 of the
//! paper simulates a lag but leaves it out of the observer; see `docs/paper-map.md`), and a straight line without the voltage
//! (the ablation of §6.5.1).
//!
//! A first-order lag with one time constant commutes with the linear map F, so the engine lags the four wrench axes, not the
//! n_a thrusts.

use crate::MAX_ROTORS;
use crate::geometry::Geometry;
use crate::signals::Measurement;
use crate::thrust_map::ThrustMap;

/// Model of the thrust of a healthy rotor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NominalThrust {
    /// f̄ = Eq. 19 of duty and voltage: the paper.
    Static,
    /// Eq. 19 through a first-order lag.
    Lagged {
        /// τ, s, above 0.
        time_constant: f32,
    },
    /// f̄ = k_pwm u, no voltage: the ablation of §6.5.1.
    Linear {
        /// k_pwm, thrust at full duty, N, above 0; 12.0059 in the paper.
        full_thrust: f32,
    },
}

/// Eq. 19 for all rotors, N; entries past the rotor count are 0.
#[inline]
pub fn static_thrust(map: &ThrustMap, rotor_count: usize, input: &Measurement) -> [f32; MAX_ROTORS] {
    let mut thrust = [0.0; MAX_ROTORS];
    for i in 0..rotor_count.min(MAX_ROTORS) {
        thrust[i] = map.thrust(input.command.duty[i], input.battery_voltage);
    }
    thrust
}

/// First-order lag of `N` signals held over each step, integrated exactly.
///
/// s₀ = x₀, a = 1 − e^(−dt/τ), s_{k+1} = s_k + a (x_k − s_k); output is the mean over the step, s_k + (x_k − s_k)(1 − a τ/dt)
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstOrderLag<const N: usize> {
    /// a.
    pub(super) end_weight: f32,
    /// 1 − a τ/dt.
    pub(super) mean_weight: f32,
    pub(super) state: Option<[f32; N]>,
}

impl<const N: usize> FirstOrderLag<N> {
    /// * `time_constant`: τ, s, above 0   * `period`: dt, s, above 0
    pub fn new(time_constant: f32, period: f32) -> Self {
        let x = f64::from(period) / f64::from(time_constant);
        let a = -libm::expm1(-x);
        Self {
            end_weight: a as f32,
            mean_weight: (1.0 - a / x) as f32,
            state: None,
        }
    }

    /// Mean output over a step with the held input; the state moves to the end of the step.
    #[inline]
    pub fn step(&mut self, input: &[f32; N]) -> [f32; N] {
        let state = self.state.get_or_insert(*input);
        lag(self.end_weight, self.mean_weight, state, input)
    }
}

/// One step of a [`FirstOrderLag`].
#[inline(always)]
pub(super) fn lag<const N: usize>(
    end_weight: f32,
    mean_weight: f32,
    state: &mut [f32; N],
    input: &[f32; N],
) -> [f32; N] {
    let mut mean = [0.0; N];
    for i in 0..N {
        let gap = input[i] - state[i];
        mean[i] = state[i] + gap * mean_weight;
        state[i] += gap * end_weight;
    }
    mean
}

/// Wrench F f̄ of healthy rotors over a step, for one choice of [`NominalThrust`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NominalWrench {
    /// See [`NominalThrust::Static`].
    Static,
    /// See [`NominalThrust::Lagged`].
    Lagged(FirstOrderLag<4>),
    /// See [`NominalThrust::Linear`]; k_pwm, N.
    Linear(f32),
}

impl NominalWrench {
    pub(super) const BLANK: Self = Self::Lagged(FirstOrderLag {
        end_weight: 0.0,
        mean_weight: 0.0,
        state: None,
    });

    /// * `period`: dt, s
    pub fn new(model: NominalThrust, period: f32) -> Self {
        match model {
            NominalThrust::Static => Self::Static,
            NominalThrust::Lagged { time_constant } => Self::Lagged(FirstOrderLag::new(time_constant, period)),
            NominalThrust::Linear { full_thrust } => Self::Linear(full_thrust),
        }
    }

    /// Mean wrench over the step, N and N·m, body.
    ///
    /// * `static_wrench`: F times [`static_thrust`] of the same input
    #[inline]
    pub fn step(&mut self, geometry: &Geometry, input: &Measurement, static_wrench: &[f32; 4]) -> [f32; 4] {
        match self {
            Self::Static => *static_wrench,
            Self::Lagged(lag) => lag.step(static_wrench),
            Self::Linear(full_thrust) => {
                let mut thrust = [0.0; MAX_ROTORS];
                for i in 0..geometry.rotor_count() {
                    thrust[i] = *full_thrust * input.command.duty[i];
                }
                geometry.wrench_from_thrust(&thrust)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn val_step_response_against_formula() {
        let (tau, dt) = (0.05f64, 0.0025f64);
        let mut lag = FirstOrderLag::<1>::new(tau as f32, dt as f32);
        assert_eq!(lag.step(&[0.0]), [0.0]);
        for k in 0..100 {
            let start = k as f64 * dt;
            // Mean of 1 − e^(−t/τ) over the step.
            let want = 1.0 - tau / dt * (libm::exp(-start / tau) - libm::exp(-(start + dt) / tau));
            let [got] = lag.step(&[1.0]);
            // Hundred f32 updates of a contracting recursion.
            assert!((f64::from(got) - want).abs() < 1e-6, "{got} {want}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn prop_lag_commutes_with_the_wrench_map(
            inputs in proptest::collection::vec(proptest::array::uniform16(0.0f32..12.0), 1..50),
        ) {
            let geometry = Geometry::regular(8, 0.3, 0.016, 0.1).expect("regular octo");
            let mut rotors = FirstOrderLag::<MAX_ROTORS>::new(0.05, 0.0025);
            let mut wrench = FirstOrderLag::<4>::new(0.05, 0.0025);
            for input in &inputs {
                let first = geometry.wrench_from_thrust(&rotors.step(input));
                let second = wrench.step(&geometry.wrench_from_thrust(input));
                for axis in 0..4 {
                    // Eight thrusts of up to 12 N: sums to 96 N, a few roundings.
                    prop_assert!((first[axis] - second[axis]).abs() < 1e-4);
                }
            }
        }
    }
}
