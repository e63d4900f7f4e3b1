//! The equations of motion of the whole plant and their integration, as pure functions of numbers.
//!
//! [`crate::simulation`] calls [`Dynamics::step`] for one flight, [`crate::batch`] for several side by side: one source, hence the
//! same bits. Nothing here branches on data except through the [`Chart`], so that a compiler can lay flights next to each other in
//! vector registers.

use crate::battery::BatteryConstants;
use crate::rigid_body::{RigidBody, RigidBodyRate, RigidBodyState, Surroundings};
use crate::vector::Vector3;

/// Open-circuit voltage over charge (Eq. 7).
pub(crate) trait Chart {
    /// V_oc, V.
    fn open_circuit_voltage(&mut self, state_of_charge: f64) -> f64;
}

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

/// Everything that is constant over one step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Dynamics<'a, const N: usize> {
    pub(crate) body: &'a RigidBody,
    pub(crate) around: &'a Surroundings,
    pub(crate) rotors: HeldRotors<'a, N>,
    pub(crate) battery: BatteryConstants,
    /// False once the battery has been cut off.
    pub(crate) connected: bool,
}

/// What is integrated.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DynamicState<const N: usize> {
    pub(crate) body: RigidBodyState,
    pub(crate) thrust: [f64; N],
    pub(crate) state_of_charge: f64,
}

impl<const N: usize> HeldRotors<'_, N> {
    /// f' of every rotor, N/s, at the battery voltage V.
    #[inline(always)]
    fn rate(&self, thrust: &[f64; N], voltage: f64) -> [f64; N] {
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

impl<const N: usize> Dynamics<'_, N> {
    /// Right-hand side of the whole plant.
    #[inline(always)]
    fn rate(&self, chart: &mut impl Chart, state: &DynamicState<N>) -> (RigidBodyRate, [f64; N], f64) {
        let power = self.battery.power_coefficient * sum_of_powers(&state.thrust);
        let open_circuit_voltage = chart.open_circuit_voltage(state.state_of_charge);
        let battery = self.battery.output(open_circuit_voltage, power, self.connected);
        let (total, torque) = self.rotors.wrench(&state.thrust);
        (
            self.body.rate(&state.body, total, torque, self.around),
            self.rotors.rate(&state.thrust, battery.battery_voltage),
            self.battery.charge_rate(battery.battery_current),
        )
    }

    /// The state `h` s later by the classical Runge–Kutta method.
    #[inline(always)]
    pub(crate) fn step(&self, chart: &mut impl Chart, state: &DynamicState<N>, h: f64) -> DynamicState<N> {
        let half = 0.5 * h;
        let k1 = self.rate(chart, state);
        let k2 = self.rate(chart, &state.moved(&k1, half));
        let k3 = self.rate(chart, &state.moved(&k2, half));
        let k4 = self.rate(chart, &state.moved(&k3, h));
        let (b, f, c) = (
            [k1.0, k2.0, k3.0, k4.0],
            [k1.1, k2.1, k3.1, k4.1],
            [k1.2, k2.2, k3.2, k4.2],
        );
        let mut body = state.body.moved(&RigidBodyRate::runge_kutta_mean(&b), h);
        body.ned_from_body = body.ned_from_body.normalized();
        let mut thrust = [0.0; N];
        for i in 0..N {
            thrust[i] = state.thrust[i] + h * ((f[0][i] + 2.0 * (f[1][i] + f[2][i]) + f[3][i]) * (1.0 / 6.0));
        }
        let state_of_charge = state.state_of_charge + h * ((c[0] + 2.0 * (c[1] + c[2]) + c[3]) * (1.0 / 6.0));
        DynamicState {
            body,
            thrust,
            state_of_charge,
        }
    }
}

impl<const N: usize> DynamicState<N> {
    #[inline(always)]
    fn moved(&self, rate: &(RigidBodyRate, [f64; N], f64), h: f64) -> Self {
        let mut thrust = [0.0; N];
        for i in 0..N {
            thrust[i] = self.thrust[i] + h * rate.1[i];
        }
        Self {
            body: self.body.moved(&rate.0, h),
            thrust,
            state_of_charge: self.state_of_charge + h * rate.2,
        }
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
