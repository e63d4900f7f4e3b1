//! The flights of one seed, and the training samples.

use crate::learning::samples::Samples;
use crate::paper::protocol::{Conduct, Course, FlightPlan, flight_plans, flight_scenario};
use crate::paper::windows::{self, Collect, FlightWindows};
use crate::parallel::map_in_order;
use rotortwin_flight_core::fdi::FaultVerdict;
use rotortwin_flight_core::geometry::Geometry;
use rotortwin_scenario::Scenario;
use rotortwin_scenario::settings::NominalThrustModel;
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

/// Samples of a batch of tracking errors ([32] as quoted in §6.5.3).
pub const BATCH_OF_ERRORS: usize = 120;

/// All flights of one seed.
#[derive(Clone, Debug, PartialEq)]
pub struct DataSet {
    /// Rotor layout of the residuals.
    pub geometry: Geometry,
    /// Plan and windows of each flight, in the order of [`flight_plans`].
    pub flights: Vec<(FlightPlan, FlightWindows)>,
    /// Wall-clock time of the generation.
    pub wall: Duration,
}

impl DataSet {
    /// Flies the protocol for `base` with the random numbers of `seed`.
    pub fn fly(
        base: &Scenario,
        conduct: Conduct,
        seed: u64,
        collect: &Collect,
        threads: NonZeroUsize,
        done: &(dyn Fn() + Sync),
    ) -> Result<Self, String> {
        let start = Instant::now();
        let geometry = base.fdi_config().geometry;
        let plans = flight_plans(geometry.rotor_count(), seed);
        let fly = |plan: &FlightPlan| {
            let scenario = flight_scenario(base, conduct, plan).map_err(|error| error.to_string())?;
            windows::fly(&scenario, plan.seed, collect).map_err(|sentence| format!("{}: {sentence}", scenario.name()))
        };
        let flights = map_in_order(threads, &plans, fly, done)
            .into_iter()
            .zip(&plans)
            .map(|(windows, plan)| Ok((*plan, windows?)))
            .collect::<Result<_, String>>()?;
        Ok(Self {
            geometry,
            flights,
            wall: start.elapsed(),
        })
    }

    /// Total number of steps of all flights.
    pub fn steps(&self) -> u64 {
        self.flights.iter().map(|(_, windows)| windows.steps).sum()
    }

    /// Every window as a row of 3 n_a residual means, flight by flight.
    pub fn residual_samples(&self, model: NominalThrustModel, self_calibrated: bool) -> GroupedSamples {
        let rotor_count = self.geometry.rotor_count();
        let mut samples = GroupedSamples::new(3 * rotor_count);
        for (plan, flight) in &self.flights {
            let windows = flight.of(model);
            for (i, label) in flight.labels.iter().enumerate() {
                let ready = !self_calibrated || windows.t_test[i] != FaultVerdict::NotReady;
                let input = windows.network_input(&self.geometry, i, self_calibrated);
                samples.push(
                    input.component[..rotor_count].as_flattened(),
                    *label,
                    plan.course,
                    ready,
                );
            }
        }
        samples
    }

    /// Every full batch of tracking errors as a row: roll, then pitch.
    pub fn tracking_error_samples(&self) -> GroupedSamples {
        let mut samples = GroupedSamples::new(2 * BATCH_OF_ERRORS);
        let mut row = Vec::with_capacity(2 * BATCH_OF_ERRORS);
        for (plan, flight) in &self.flights {
            for (i, batch) in flight.attitude_errors.chunks_exact(BATCH_OF_ERRORS).enumerate() {
                row.clear();
                for axis in 0..2 {
                    row.extend(batch.iter().map(|error| error[axis]));
                }
                // The label of the window containing the middle of the batch: faults set in at batch boundaries.
                let middle = i * BATCH_OF_ERRORS + BATCH_OF_ERRORS / 2;
                let label = flight.labels[(middle / flight.window_len).min(flight.labels.len() - 1)];
                samples.push(&row, label, plan.course, true);
            }
        }
        samples
    }
}

/// Samples grouped by trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupedSamples {
    /// Features and labels.
    pub samples: Samples,
    /// Trajectory of each row.
    pub courses: Vec<Course>,
    /// Whether the detector gives a verdict on this row; false while it calibrates.
    pub ready: Vec<bool>,
}

impl GroupedSamples {
    fn new(features: usize) -> Self {
        Self {
            samples: Samples::new(features),
            courses: Vec::new(),
            ready: Vec::new(),
        }
    }

    fn push(&mut self, row: &[f32], label: u8, course: Course, ready: bool) {
        self.samples.push(row, label);
        self.courses.push(course);
        self.ready.push(ready);
    }

    /// Rows that are ready and whose trajectory satisfies `wanted`.
    pub fn rows(&self, wanted: impl Fn(Course) -> bool) -> Vec<u32> {
        (0..self.courses.len())
            .filter(|row| self.ready[*row] && wanted(self.courses[*row]))
            .map(|row| row as u32)
            .collect()
    }
}
