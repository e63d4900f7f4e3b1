//! Plant states of several flights, quantity by quantity, and one step of all of them.
//!
//! The loops over lanes hold no branches and no calls, so that each compiles to vector instructions; a lane computes
//! [`Dynamics::step`], [`Quaternion::to_euler_with`] and so on, the functions of the one-flight path. A lane that
//! leaves the range of a branch-free function is flagged, and the caller repeats that lane alone.

use super::LANES;
use crate::body::dynamics::{DynamicState, Dynamics};
use crate::body::rigid_body::{Quaternion, RigidBody, RigidBodyState, Surroundings};
use crate::elementary::BranchFree;
use crate::powertrain::battery::{BatteryConstants, Chart, ChartInterval};
use crate::powertrain::held::{HeldRotors, sum_of_powers};
use crate::vector_units::VectorWork;

/// One number of every flight.
pub(super) type Row = [f64; LANES];
pub(super) const ZERO: Row = [0.0; LANES];

/// Reads one lane of several rows.
#[inline(always)]
pub(super) fn column<const K: usize>(rows: &[Row; K], lane: usize) -> [f64; K] {
    let mut values = [0.0; K];
    for i in 0..K {
        values[i] = rows[i][lane];
    }
    values
}

/// Writes one lane of several rows.
#[inline(always)]
pub(super) fn set_column<const K: usize>(rows: &mut [Row; K], lane: usize, values: &[f64; K]) {
    for i in 0..K {
        rows[i][lane] = values[i];
    }
}

/// What is integrated.
#[derive(Debug, Clone)]
pub(super) struct StateRows<const N: usize> {
    pub(super) position: [Row; 3],
    pub(super) velocity: [Row; 3],
    pub(super) quaternion: [Row; 4],
    pub(super) body_rates: [Row; 3],
    pub(super) thrust: [Row; N],
    pub(super) state_of_charge: Row,
}

impl<const N: usize> StateRows<N> {
    pub(super) const NONE: Self = Self {
        position: [ZERO; 3],
        velocity: [ZERO; 3],
        quaternion: [ZERO; 4],
        body_rates: [ZERO; 3],
        thrust: [ZERO; N],
        state_of_charge: ZERO,
    };

    #[inline(always)]
    pub(super) fn get(&self, lane: usize) -> DynamicState<N> {
        DynamicState {
            body: RigidBodyState {
                position_ned: column(&self.position, lane),
                velocity_ned: column(&self.velocity, lane),
                ned_from_body: Quaternion(column(&self.quaternion, lane)),
                body_rates: column(&self.body_rates, lane),
            },
            thrust: column(&self.thrust, lane),
            state_of_charge: self.state_of_charge[lane],
        }
    }

    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, state: &DynamicState<N>) {
        set_column(&mut self.position, lane, &state.body.position_ned);
        set_column(&mut self.velocity, lane, &state.body.velocity_ned);
        set_column(&mut self.quaternion, lane, &state.body.ned_from_body.0);
        set_column(&mut self.body_rates, lane, &state.body.body_rates);
        set_column(&mut self.thrust, lane, &state.thrust);
        self.state_of_charge[lane] = state.state_of_charge;
    }
}

/// What does not change in a step. Rotor rows change when a fault sets in, surroundings with each step of the wind.
#[derive(Debug, Clone)]
pub(super) struct ParameterRows<const N: usize> {
    /// 1/m, g, k_t, k_r.
    pub(super) body: [Row; 4],
    pub(super) inertia: [Row; 3],
    pub(super) per_inertia: [Row; 3],
    /// Wind (NED), force (NED), torque (body).
    pub(super) around: [[Row; 3]; 3],
    /// Internal resistance, power coefficient, 1/(3600 Q_nom).
    pub(super) battery: [Row; 3],
    /// Of the chart's interval: number of all intervals, knot, voltage, rise.
    pub(super) chart: [Row; 4],
    /// a₀ … a₃ of the mounted blades.
    pub(super) blade: [[Row; N]; 4],
    pub(super) voltage_offset: [Row; N],
    pub(super) gain: [Row; N],
    pub(super) bias: [Row; N],
    pub(super) health: [Row; N],
    pub(super) torque_arm: [[Row; N]; 3],
    pub(super) per_lag: Row,
}

impl<const N: usize> ParameterRows<N> {
    pub(super) const NONE: Self = Self {
        body: [ZERO; 4],
        inertia: [ZERO; 3],
        per_inertia: [ZERO; 3],
        around: [[ZERO; 3]; 3],
        battery: [ZERO; 3],
        chart: [ZERO; 4],
        blade: [[ZERO; N]; 4],
        voltage_offset: [ZERO; N],
        gain: [ZERO; N],
        bias: [ZERO; N],
        health: [ZERO; N],
        torque_arm: [[ZERO; N]; 3],
        per_lag: ZERO,
    };

    #[inline(always)]
    fn battery(&self, lane: usize) -> BatteryConstants {
        BatteryConstants {
            internal_resistance: self.battery[0][lane],
            power_coefficient: self.battery[1][lane],
            per_coulomb: self.battery[2][lane],
        }
    }

    #[inline(always)]
    fn chart(&self, lane: usize) -> ChartInterval {
        ChartInterval {
            intervals: self.chart[0][lane],
            knot: self.chart[1][lane],
            voltage: self.chart[2][lane],
            rise: self.chart[3][lane],
            left: false,
        }
    }
}

/// Lanes that have to be repeated alone: not 0.
pub(super) type Flags = [u64; LANES];

/// All that a step reads.
#[derive(Debug, Clone)]
pub(super) struct LaneInputs<const N: usize> {
    pub(super) parameters: ParameterRows<N>,
    pub(super) state: StateRows<N>,
    pub(super) truth: TruthRows,
    pub(super) sensors: SensorRows,
    /// Held command, fraction.
    pub(super) duty: [[f32; LANES]; N],
    /// Length of a substep, s.
    pub(super) h: f64,
}

/// What one substep gives.
#[derive(Debug, Clone)]
pub(super) struct Integrated<const N: usize> {
    pub(super) state: StateRows<N>,
    /// The charge has left its interval of the chart.
    pub(super) left: Flags,
}

/// Integrates all flights over one substep.
pub(super) struct Integrate<const N: usize>;

impl<const N: usize> VectorWork for Integrate<N> {
    type Input = LaneInputs<N>;
    type Output = Integrated<N>;
    const WIDE: bool = true;

    #[inline(always)]
    fn run(input: &LaneInputs<N>, output: &mut Integrated<N>) {
        let p = &input.parameters;
        for lane in 0..LANES {
            let body = RigidBody::from_parts(
                column(&p.body, lane),
                column(&p.inertia, lane),
                column(&p.per_inertia, lane),
            );
            let around = Surroundings {
                wind_ned: column(&p.around[0], lane),
                force_ned: column(&p.around[1], lane),
                torque_body: column(&p.around[2], lane),
            };
            let (mut lift_per_volt, mut bias) = ([0.0; N], [0.0; N]);
            for i in 0..N {
                // Numbers, as the caller has made sure.
                let duty = f64::from(input.duty[i][lane]).clamp(0.0, 1.0);
                let u = 100.0 * duty;
                let blade = |k: usize| p.blade[k][i][lane];
                let shape = blade(0) * u.sqrt() + u * (blade(1) + u * (blade(2) + u * blade(3)));
                lift_per_volt[i] = p.gain[i][lane] * shape.max(0.0);
                let held_bias = p.bias[i][lane];
                bias[i] = if duty > 0.0 { held_bias } else { 0.0 };
            }
            let (voltage_offset, health) = (column(&p.voltage_offset, lane), column(&p.health, lane));
            let arm = [
                column(&p.torque_arm[0], lane),
                column(&p.torque_arm[1], lane),
                column(&p.torque_arm[2], lane),
            ];
            let dynamics = Dynamics {
                body: &body,
                around: &around,
                rotors: HeldRotors {
                    lift_per_volt: &lift_per_volt,
                    voltage_offset: &voltage_offset,
                    bias: &bias,
                    health: &health,
                    torque_arm: [&arm[0], &arm[1], &arm[2]],
                    per_lag: p.per_lag[lane],
                },
                battery: p.battery(lane),
                connected: true,
            };
            let mut chart = p.chart(lane);
            let state = dynamics.step(&mut chart, &input.state.get(lane), input.h);
            output.state.set(lane, &state);
            output.left[lane] = u64::from(chart.left);
        }
    }
}

/// The part of the truth that is not integrated state.
#[derive(Debug, Clone)]
pub(super) struct TruthRows {
    pub(super) attitude: [Row; 3],
    /// Open-circuit voltage, terminal voltage, current.
    pub(super) battery: [Row; 3],
    /// An attitude outside of the range of the branch-free functions.
    pub(super) steep: Flags,
    /// The charge has left its interval of the chart.
    pub(super) left: Flags,
    /// Something is not a number, or the charge is spent.
    pub(super) lost: Flags,
}

impl TruthRows {
    pub(super) const NONE: Self = Self {
        attitude: [ZERO; 3],
        battery: [ZERO; 3],
        steep: [0; LANES],
        left: [0; LANES],
        lost: [0; LANES],
    };
}

/// Computes the truth of all flights.
pub(super) struct RecordTruth<const N: usize>;

impl<const N: usize> VectorWork for RecordTruth<N> {
    type Input = LaneInputs<N>;
    type Output = TruthRows;
    const WIDE: bool = true;

    #[inline(always)]
    fn run(input: &LaneInputs<N>, truth: &mut TruthRows) {
        let (p, state) = (&input.parameters, &input.state);
        for lane in 0..LANES {
            let now = state.get(lane);
            let mut functions = BranchFree::default();
            let attitude = now.body.ned_from_body.to_euler_with(&mut functions);
            set_column(&mut truth.attitude, lane, &attitude);
            truth.steep[lane] = u64::from(functions.outside);
        }
        for lane in 0..LANES {
            let now = state.get(lane);
            let constants = p.battery(lane);
            let mut chart = p.chart(lane);
            let power = constants.power_coefficient * sum_of_powers(&now.thrust);
            let open_circuit_voltage = Chart::open_circuit_voltage(&mut chart, now.state_of_charge);
            let output = constants.output(open_circuit_voltage, power, true);
            let values = [
                output.open_circuit_voltage,
                output.battery_voltage,
                output.battery_current,
            ];
            set_column(&mut truth.battery, lane, &values);
            truth.left[lane] = u64::from(chart.left);
            // One NaN or infinity anywhere leaves no finite sum.
            let mut sum = now.state_of_charge;
            for i in 0..3 {
                sum += now.body.position_ned[i] + now.body.velocity_ned[i] + now.body.body_rates[i];
            }
            for i in 0..4 {
                sum += now.body.ned_from_body.0[i];
            }
            for i in 0..N {
                sum += now.thrust[i];
            }
            // If a charge is NaN, so is the sum.
            let finite = sum.abs() < f64::INFINITY;
            truth.lost[lane] = u64::from(!finite | (now.state_of_charge <= 0.0));
        }
    }
}

/// Standard deviations, biases and this step's noise of the sensors.
#[derive(Debug, Clone)]
pub(super) struct SensorRows {
    /// Position, velocity, attitude, body rates, voltage.
    pub(super) deviation: [Row; 5],
    pub(super) voltage_bias: Row,
    /// Standard normals: three for each sensor, one for the voltage.
    pub(super) noise: [Row; 13],
}

impl SensorRows {
    pub(super) const NONE: Self = Self {
        deviation: [ZERO; 5],
        voltage_bias: ZERO,
        noise: [ZERO; 13],
    };
}

/// Adds the noise to the truth. Position, velocity, attitude, body rates, voltage.
pub(super) struct Measure<const N: usize>;

impl<const N: usize> VectorWork for Measure<N> {
    type Input = LaneInputs<N>;
    type Output = [[f32; LANES]; 13];
    const WIDE: bool = false;

    #[inline(always)]
    fn run(input: &LaneInputs<N>, sensed: &mut [[f32; LANES]; 13]) {
        let (s, state, truth) = (&input.sensors, &input.state, &input.truth);
        let sources = [&state.position, &state.velocity, &truth.attitude, &state.body_rates];
        for sensor in 0..4 {
            for axis in 0..3 {
                let (k, source) = (3 * sensor + axis, &sources[sensor][axis]);
                for lane in 0..LANES {
                    sensed[k][lane] = (source[lane] + s.deviation[sensor][lane] * s.noise[k][lane]) as f32;
                }
            }
        }
        for lane in 0..LANES {
            let biased = truth.battery[1][lane] + s.voltage_bias[lane];
            // Without noise nothing is added at all: a sum with 0 has the same bits but for −0, which no voltage is.
            sensed[12][lane] = (biased + s.deviation[4][lane] * s.noise[12][lane]) as f32;
        }
    }
}
