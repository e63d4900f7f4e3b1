//! Several flights side by side, in lanes of arrays: the same bits as [`Simulation`], at a fraction of the time for each.
//!
//! ```text
//!  Simulation ──seat──▶ lane ─┐  for all lanes at once:
//!                             ├─▶ sense() ─▶ nav, reference, voltage ─▶ (controller) ─▶ advance(duty) ─▶ …
//!  what is rare stays there ◀─┘      faults, wind, trajectory and random streams of each lane stay in its own Simulation
//! ```
//!
//! Flights in a batch may differ in everything but the number of rotors `N` and the substeps of the integrator. They need not start
//! together: a lane whose flight has ended takes the next one while the others go on.
//!
//! What cannot run in lanes ends a lane instead of being approximated: see [`NoLane`] before a flight,
//! [`BatchSimulation::advance`] during it. Such a flight has to be flown by [`Simulation`] from its start.

mod lanes;

use crate::STEP_S;
use crate::simulation::{Simulation, TruthSample};
use crate::vector_units::Dispatch;
use lanes::{
    Flags, Integrate, Integrated, LaneInputs, Measure, ParameterRows, RecordTruth, SensorRows, StateRows, TruthRows,
    column, set_column,
};
use rotortwin_flight_core::signals::Reference;

/// Flights side by side: eight `f64` fill one register of AVX-512, two of AVX2.
pub const LANES: usize = 8;

/// Why a flight cannot have a lane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum NoLane {
    /// Its number of rotors is not that of the batch.
    RotorCount,
    /// Its integrator takes another number of substeps than the batch.
    Substeps,
    /// It has sensor faults.
    SensorFaults,
    /// Its scenario has effects, dropped loads or ground contact, or it records an accelerometer.
    Effects,
    /// It has already begun.
    Begun,
}

/// One lane's flight.
#[derive(Debug, Clone)]
struct Seat {
    simulation: Simulation,
}

/// Sensor readings of all lanes: a row for each number, a column for each lane.
#[derive(Debug, Clone)]
pub struct SensedRows {
    /// Position (m, NED), velocity (m/s, NED), attitude (rad), body rates (rad/s), each with three rows; battery voltage (V).
    pub values: [[f32; LANES]; 13],
    /// Position (m, NED), velocity (m/s, NED), yaw (rad).
    pub reference: [[f32; LANES]; 7],
}

/// The part of one lane's truth that changes with every step.
#[derive(Debug, Clone, Copy)]
pub struct LaneMotion<const N: usize> {
    /// Position (m, NED), velocity (m/s, NED), attitude (rad), body rates (rad/s).
    pub motion: [f64; 12],
    /// f_i, N.
    pub rotor_thrust_n: [f64; N],
    /// State of charge (fraction), terminal voltage (V), current (A).
    pub battery: [f64; 3],
}

/// See the module.
#[derive(Debug, Clone)]
pub struct BatchSimulation<const N: usize> {
    dispatch: Dispatch,
    substeps: u32,
    seats: [Option<Box<Seat>>; LANES],
    inputs: Box<LaneInputs<N>>,
    integrated: Box<Integrated<N>>,
    sensed: SensedRows,
    wind_moves: [bool; LANES],
    /// An earlier lane that follows the same trajectory: its reference is this lane's, too, while their steps are the same.
    same_trajectory: [Option<usize>; LANES],
    /// A later lane follows this one's trajectory.
    leads: [bool; LANES],
}

impl<const N: usize> BatchSimulation<N> {
    /// Empty lanes for flights with `substeps` substeps of the integrator.
    pub fn new(dispatch: Dispatch, substeps: u32) -> Self {
        Self {
            dispatch,
            substeps,
            seats: [const { None }; LANES],
            inputs: Box::new(LaneInputs {
                parameters: ParameterRows::NONE,
                state: StateRows::NONE,
                truth: TruthRows::NONE,
                sensors: SensorRows::NONE,
                duty: [[0.0; LANES]; N],
                h: STEP_S / f64::from(substeps),
            }),
            integrated: Box::new(Integrated {
                state: StateRows::NONE,
                left: [0; LANES],
            }),
            sensed: SensedRows {
                values: [[0.0; LANES]; 13],
                reference: [[0.0; LANES]; 7],
            },
            wind_moves: [false; LANES],
            same_trajectory: [None; LANES],
            leads: [false; LANES],
        }
    }

    /// Whether a flight can have a lane here.
    pub fn check(&self, simulation: &Simulation) -> Result<(), NoLane> {
        if simulation.rotor_count() != N {
            return Err(NoLane::RotorCount);
        }
        if simulation.substeps() != self.substeps {
            return Err(NoLane::Substeps);
        }
        if simulation.sensors.has_faults() {
            return Err(NoLane::SensorFaults);
        }
        if simulation.is_extended() {
            return Err(NoLane::Effects);
        }
        if simulation.step() != 0 {
            return Err(NoLane::Begun);
        }
        Ok(())
    }

    /// Gives a flight a lane; the one before it is dropped.
    pub fn seat(&mut self, lane: usize, simulation: Simulation) -> Result<(), NoLane> {
        self.check(&simulation)?;
        let s = &simulation;
        let p = &mut self.inputs.parameters;
        let (body, inertia, per_inertia) = s.body.parts();
        set_column(&mut p.body, lane, &body);
        set_column(&mut p.inertia, lane, &inertia);
        set_column(&mut p.per_inertia, lane, &per_inertia);
        let battery = s.battery.constants();
        let battery = [
            battery.internal_resistance,
            battery.power_coefficient,
            battery.per_coulomb,
        ];
        set_column(&mut p.battery, lane, &battery);
        p.per_lag[lane] = s.powertrain.per_lag();
        self.inputs.sensors.voltage_bias[lane] = s.sensors.voltage_bias();
        set_column(&mut self.inputs.sensors.deviation, lane, s.sensors.deviations());
        self.wind_moves[lane] = s.environment.moves();
        self.inputs.state.set(lane, &s.dynamic_state());
        // The truth of step 0 is there already.
        self.read_truth(lane, &simulation);
        self.seats[lane] = Some(Box::new(Seat { simulation }));
        for lane in 0..LANES {
            let trajectory = |lane: usize| {
                let seat = self.seats[lane].as_ref();
                seat.map(|seat| seat.simulation.reference.trajectory())
            };
            self.same_trajectory[lane] =
                trajectory(lane).and_then(|own| (0..lane).find(|other| trajectory(*other) == Some(own)));
        }
        self.leads = core::array::from_fn(|lane| self.same_trajectory.contains(&Some(lane)));
        self.read_rotors(lane);
        self.read_surroundings(lane);
        self.read_reference(lane);
        self.find_interval(lane);
        Ok(())
    }

    /// Empties a lane.
    pub fn clear(&mut self, lane: usize) -> Option<Simulation> {
        self.seats[lane].take().map(|seat| seat.simulation)
    }

    /// The flight in a lane, for values that do not change with every step: its step number, faults, duration.
    pub fn simulation(&self, lane: usize) -> Option<&Simulation> {
        self.seats[lane].as_ref().map(|seat| &seat.simulation)
    }

    /// Sensor readings at the start of the current step of each lane. Call it once per step.
    pub fn sense(&mut self) -> &SensedRows {
        for lane in 0..LANES {
            if let Some(seat) = &mut self.seats[lane] {
                seat.simulation.sensors.noise(&mut self.inputs.sensors.noise, lane);
            }
        }
        self.dispatch.run::<Measure<N>>(&self.inputs, &mut self.sensed.values);
        &self.sensed
    }

    /// Holds `duty` over the current step of each lane and moves it to the next. Returns the lanes (bit 0 is lane 0) that cannot go
    /// on here: a duty that is not a number, a state that is not, or a battery that is empty. Their flights have to be flown by
    /// [`Simulation`] from their start.
    pub fn advance(&mut self, duty: &[[f32; LANES]; N]) -> u32 {
        let mut lost = 0;
        for row in duty {
            for (lane, duty) in row.iter().enumerate() {
                lost |= u32::from(!duty.is_finite()) << lane;
            }
        }
        self.inputs.duty = *duty;
        let mut references = [const { None }; LANES];
        let left = self.integrate(lost);
        for lane in 0..LANES {
            if left[lane] != 0 {
                self.find_interval(lane);
            }
            let Some(seat) = &mut self.seats[lane] else { continue };
            let simulation = &mut seat.simulation;
            let known = self.same_trajectory[lane].and_then(|other| {
                references[other]
                    .as_ref()
                    .filter(|(step, _)| *step == simulation.step() + 1)
            });
            let changed = simulation.advance_around(known.map(|(_, reference)| reference));
            if self.leads[lane] {
                references[lane] = Some((simulation.step(), simulation.reference.point()));
            }
            if changed {
                self.read_rotors(lane);
            }
            if self.wind_moves[lane] {
                self.read_surroundings(lane);
            }
            self.read_reference(lane);
        }
        let mut truth = TruthRows::NONE;
        self.dispatch.run::<RecordTruth<N>>(&self.inputs, &mut truth);
        self.inputs.truth = truth;
        for lane in 0..LANES {
            if self.inputs.truth.lost[lane] != 0 {
                lost |= 1 << lane;
            }
            if (self.inputs.truth.steep[lane] | self.inputs.truth.left[lane]) != 0 {
                self.repeat_truth(lane);
            }
        }
        (0..LANES).fold(0, |mask, lane| {
            mask | (lost & (u32::from(self.seats[lane].is_some()) << lane))
        })
    }

    /// Moves the states of all lanes over one step. Returns which left their interval of the chart and were repeated alone.
    fn integrate(&mut self, lost: u32) -> Flags {
        let before = (self.substeps > 1).then(|| self.inputs.state.clone());
        let mut left = [0; LANES];
        for substep in 0..self.substeps {
            if substep > 0 {
                std::mem::swap(&mut self.inputs.state, &mut self.integrated.state);
            }
            self.dispatch.run::<Integrate<N>>(&self.inputs, &mut self.integrated);
            for lane in 0..LANES {
                left[lane] |= self.integrated.left[lane];
            }
        }
        let before = before.as_ref().unwrap_or(&self.inputs.state);
        for lane in 0..LANES {
            let Some(seat) = &mut self.seats[lane] else { continue };
            if left[lane] != 0 && lost & (1 << lane) == 0 {
                let state = seat
                    .simulation
                    .step_of(&before.get(lane), &column_f32(&self.inputs.duty, lane));
                self.integrated.state.set(lane, &state);
            }
        }
        std::mem::swap(&mut self.inputs.state, &mut self.integrated.state);
        left
    }

    /// The truth of one lane that changes with every step.
    #[inline]
    pub fn motion(&self, lane: usize) -> LaneMotion<N> {
        let state = &self.inputs.state;
        let mut motion = [0.0; 12];
        let sources = [
            &state.position,
            &state.velocity,
            &self.inputs.truth.attitude,
            &state.body_rates,
        ];
        for (part, rows) in motion.as_chunks_mut::<3>().0.iter_mut().zip(sources) {
            *part = column(rows, lane);
        }
        let [_, voltage, current] = column(&self.inputs.truth.battery, lane);
        LaneMotion {
            motion,
            rotor_thrust_n: column(&state.thrust, lane),
            battery: [state.state_of_charge[lane], voltage, current],
        }
    }

    /// The truth of one lane at the start of its current step.
    pub fn truth(&self, lane: usize) -> Option<TruthSample> {
        let seat = self.seats[lane].as_ref()?;
        let mut truth = *seat.simulation.truth();
        let state = self.inputs.state.get(lane);
        truth.position_ned_m = state.body.position_ned;
        truth.velocity_ned_m_s = state.body.velocity_ned;
        truth.attitude_rad = column(&self.inputs.truth.attitude, lane);
        truth.body_rates_rad_s = state.body.body_rates;
        truth.rotor_thrust_n[..N].copy_from_slice(&state.thrust);
        truth.state_of_charge = state.state_of_charge;
        [
            truth.open_circuit_voltage_v,
            truth.battery_voltage_v,
            truth.battery_current_a,
        ] = column(&self.inputs.truth.battery, lane);
        Some(truth)
    }

    #[cold]
    fn repeat_truth(&mut self, lane: usize) {
        self.find_interval(lane);
        if let Some(seat) = &self.seats[lane] {
            let state = self.inputs.state.get(lane);
            let (attitude, battery) = seat.simulation.truth_of(&state);
            set_column(&mut self.inputs.truth.attitude, lane, &attitude);
            set_column(&mut self.inputs.truth.battery, lane, &battery);
        }
    }

    fn read_truth(&mut self, lane: usize, simulation: &Simulation) {
        let truth = simulation.truth();
        set_column(&mut self.inputs.truth.attitude, lane, &truth.attitude_rad);
        let battery = [
            truth.open_circuit_voltage_v,
            truth.battery_voltage_v,
            truth.battery_current_a,
        ];
        set_column(&mut self.inputs.truth.battery, lane, &battery);
    }

    /// Brings the rotor rows up to date after a fault has set in.
    fn read_rotors(&mut self, lane: usize) {
        let Some(seat) = &self.seats[lane] else { return };
        let p = &mut self.inputs.parameters;
        for (i, rotor) in seat.simulation.powertrain.rotors().iter().enumerate() {
            for k in 0..4 {
                p.blade[k][i][lane] = rotor.blade.coefficients[k];
            }
            p.voltage_offset[i][lane] = rotor.blade.voltage_offset_v;
            p.gain[i][lane] = rotor.gain;
            p.bias[i][lane] = rotor.bias;
            p.health[i][lane] = 1.0 - rotor.thrust_loss;
            for (axis, entry) in rotor.acting_torque_arm().into_iter().enumerate() {
                p.torque_arm[axis][i][lane] = entry;
            }
        }
    }

    #[inline]
    fn read_surroundings(&mut self, lane: usize) {
        let Some(seat) = &self.seats[lane] else { return };
        let around = seat.simulation.environment.now();
        let p = &mut self.inputs.parameters.around;
        set_column(&mut p[0], lane, &around.wind_ned);
        set_column(&mut p[1], lane, &around.force_ned);
        set_column(&mut p[2], lane, &around.torque_body);
    }

    #[inline]
    fn read_reference(&mut self, lane: usize) {
        let Some(seat) = &self.seats[lane] else { return };
        let Reference {
            position_ned: p,
            velocity_ned: v,
            yaw,
        } = seat.simulation.reference.now;
        for (row, value) in self
            .sensed
            .reference
            .iter_mut()
            .zip([p.x, p.y, p.z, v.x, v.y, v.z, yaw])
        {
            row[lane] = value;
        }
    }

    fn find_interval(&mut self, lane: usize) {
        let Some(seat) = &self.seats[lane] else { return };
        let interval = seat
            .simulation
            .battery
            .interval(self.inputs.state.state_of_charge[lane]);
        let values = [interval.intervals, interval.knot, interval.voltage, interval.rise];
        set_column(&mut self.inputs.parameters.chart, lane, &values);
    }
}

fn column_f32<const N: usize>(rows: &[[f32; LANES]; N], lane: usize) -> [f32; N] {
    std::array::from_fn(|i| rows[i][lane])
}
