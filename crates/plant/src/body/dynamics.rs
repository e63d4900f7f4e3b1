//! The equations of motion of the whole plant and their integration, as pure functions of numbers.
//!
//! [`crate::simulation`] calls [`Dynamics::step`] for one flight, [`crate::batch`] for several side by side: one source, hence the
//! same bits. Nothing here branches on data except through the [`Chart`], so that a compiler can lay flights next to each other in
//! vector registers.

use crate::body::rigid_body::{RigidBody, RigidBodyRate, RigidBodyState, Surroundings};
use crate::powertrain::battery::{BatteryConstants, Chart};
use crate::powertrain::held::{HeldRotors, sum_of_powers};

/// What acts on the body besides the rotors, wherever it is within the step.
pub(crate) trait Around {
    /// At a state of the body.
    fn at(&self, body: &RigidBodyState) -> Surroundings;
}

impl Around for &Surroundings {
    #[inline(always)]
    fn at(&self, _: &RigidBodyState) -> Surroundings {
        **self
    }
}

/// Everything that is constant over one step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Dynamics<'a, const N: usize, A = &'a Surroundings> {
    pub(crate) body: &'a RigidBody,
    pub(crate) around: A,
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

impl<const N: usize, A: Around> Dynamics<'_, N, A> {
    /// Right-hand side of the whole plant.
    #[inline(always)]
    fn rate(&self, chart: &mut impl Chart, state: &DynamicState<N>) -> (RigidBodyRate, [f64; N], f64) {
        let power = self.battery.power_coefficient * sum_of_powers(&state.thrust);
        let open_circuit_voltage = chart.open_circuit_voltage(state.state_of_charge);
        let battery = self.battery.output(open_circuit_voltage, power, self.connected);
        let (total, torque) = self.rotors.wrench(&state.thrust);
        (
            self.body.rate(&state.body, total, torque, &self.around.at(&state.body)),
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
