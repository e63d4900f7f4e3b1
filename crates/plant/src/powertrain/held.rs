//! The rotors over one step of a held command: rate of the thrusts, force and torque, power, as pure functions of numbers.

use crate::vector::Vector3;

/// What `N` rotors do over one step with the held command.
#[derive(Debug, Clone, Copy)]
pub(crate) struct HeldRotors<'a, const N: usize> {
    /// Gain times the bracket of Eq. 19, N/V.
    pub(crate) lift_per_volt: &'a [f64; N],
    pub(crate) voltage_offset: &'a [f64; N],
    /// N; 0 at a duty of 0.
    pub(crate) bias: &'a [f64; N],
    /// 1 less the lost share.
    pub(crate) health: &'a [f64; N],
    pub(crate) torque_arm: [&'a [f64; N]; 3],
    pub(crate) per_lag: f64,
}

impl<const N: usize> HeldRotors<'_, N> {
    /// f' of every rotor, N/s, at the battery voltage V.
    #[inline(always)]
    pub(crate) fn rate(&self, thrust: &[f64; N], voltage: f64) -> [f64; N] {
        let mut rate = [0.0; N];
        for i in 0..N {
            let lift = (voltage - self.voltage_offset[i]).max(0.0) * self.lift_per_volt[i] + self.bias[i];
            rate[i] = (self.health[i] * lift.max(0.0) - thrust[i]) * self.per_lag;
        }
        rate
    }

    /// Collective thrust, N, and torque about the centre of mass, N·m, body (Eq. 6).
    #[inline(always)]
    pub(crate) fn wrench(&self, thrust: &[f64; N]) -> (f64, Vector3) {
        let mut torque = [0.0; 3];
        for axis in 0..3 {
            let mut product = [0.0; N];
            for i in 0..N {
                product[i] = self.torque_arm[axis][i] * thrust[i];
            }
            torque[axis] = sum_of_pairs(&product);
        }
        (sum_of_pairs(thrust), torque)
    }
}

/// Σ f^1.5, N^1.5.
#[inline(always)]
pub(crate) fn sum_of_powers<const N: usize>(thrust: &[f64; N]) -> f64 {
    let mut power = [0.0; N];
    for i in 0..N {
        let f = thrust[i].max(0.0);
        power[i] = f * f.sqrt();
    }
    sum_of_pairs(&power)
}

/// Sum of the even entries plus sum of the odd ones: two chains of additions instead of one, and the same bits whatever zeros
/// pad the array.
#[inline(always)]
fn sum_of_pairs<const N: usize>(values: &[f64; N]) -> f64 {
    let (mut even, mut odd) = (0.0, 0.0);
    for pair in values.as_chunks::<2>().0 {
        even += pair[0];
        odd += pair[1];
    }
    even + odd
}
