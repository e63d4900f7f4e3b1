//! One flight, one step at a time.

use crate::columns::{Recording, bytes, singles};
use crate::interrupt::in_parts;
use crate::refusal::{flight, pickled};
use crate::scenario::Scenario;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyDict};
use rotortwin_flight::stepped::SteppedFlight;
use rotortwin_wire::frames::FdiReport;
use std::sync::Arc;

/// Steps between two looks at Python's signals: some 50 ms.
const STEPS_UNHEARD: u64 = 4_000;

/// One flight of a scenario, with controller and detectors, in this process.
#[derive(Clone)]
#[pyclass(module = "rotortwin._native")]
pub(crate) struct Simulation {
    scenario: Arc<rotortwin_scenario::Scenario>,
    seed: u64,
    record: Vec<String>,
    flight: SteppedFlight,
    recording: Recording,
    report: FdiReport,
}

#[pymethods]
impl Simulation {
    #[new]
    #[pyo3(signature = (scenario, seed = None, record = vec!["*".to_owned()]))]
    fn new(scenario: &Scenario, seed: Option<u64>, record: Vec<String>) -> PyResult<Self> {
        let scenario = Arc::clone(&scenario.inner);
        let seed = seed.unwrap_or_else(|| scenario.seed());
        Self::begin(scenario, seed, record)
    }

    /// Restarts the flight, by default with the previous seed.
    #[pyo3(signature = (seed = None))]
    fn reset(&mut self, seed: Option<u64>) -> PyResult<()> {
        *self = Self::begin(
            Arc::clone(&self.scenario),
            seed.unwrap_or(self.seed),
            self.record.clone(),
        )?;
        Ok(())
    }

    /// Flies `steps` steps with the duties `duty`, or with our controller.
    #[pyo3(signature = (duty = None, steps = 1))]
    fn step(&mut self, py: Python<'_>, duty: Option<&[u8]>, steps: u64) -> PyResult<()> {
        let duty = duty.map(singles);
        if steps == 1 {
            return self.one(duty.as_deref());
        }
        in_parts(py, steps, STEPS_UNHEARD, |now| {
            (0..now).try_for_each(|_| self.one(duty.as_deref()))?;
            Ok(true)
        })
    }

    /// Continues with our controller, to the end or to a step.
    #[pyo3(signature = (until_step = None))]
    fn run(&mut self, py: Python<'_>, until_step: Option<u64>) -> PyResult<()> {
        let steps = until_step.unwrap_or(u64::MAX).saturating_sub(self.flight.steps());
        in_parts(py, steps, STEPS_UNHEARD, |now| {
            for _ in 0..now {
                if self.flight.done() {
                    return Ok(false);
                }
                self.one(None)?;
            }
            Ok(true)
        })
    }

    /// The same flight at the same step, with what it has recorded; the two go on apart.
    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(pickled(
            "a flight",
            "scenario and seed to be sent, and the flight to be flown there: same seed, same bits",
        ))
    }

    #[getter]
    fn scenario(&self) -> &str {
        self.scenario.name()
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.seed
    }

    #[getter]
    fn rotor_count(&self) -> usize {
        self.flight.rotor_count()
    }

    #[getter]
    fn hover_duty(&self) -> f32 {
        self.flight.hover_duty()
    }

    #[getter]
    fn steps(&self) -> u64 {
        self.flight.steps()
    }

    #[getter]
    fn done(&self) -> bool {
        self.flight.done()
    }

    #[getter]
    fn run_hash(&self) -> String {
        self.flight.run_hash()
    }

    #[getter]
    fn observation<'py>(&self, py: Python<'py>) -> Bound<'py, PyByteArray> {
        bytes(
            py,
            self.flight.sensors().numbers().iter().map(|value| value.to_ne_bytes()),
        )
    }

    /// Our controller's output now.
    fn controller_duty<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyByteArray> {
        let count = self.flight.rotor_count();
        let duty = self.flight.controller_command().duty;
        bytes(py, duty[..count].iter().map(|value| value.to_ne_bytes()))
    }

    #[getter]
    fn motion<'py>(&self, py: Python<'py>) -> Bound<'py, PyByteArray> {
        bytes(py, self.flight.truth().motion().iter().map(|value| value.to_ne_bytes()))
    }

    #[getter]
    fn truth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let truth = self.flight.truth();
        let count = self.flight.rotor_count();
        let dict = PyDict::new(py);
        for (name, values) in [
            ("position_ned_m", &truth.position_ned_m),
            ("velocity_ned_m_s", &truth.velocity_ned_m_s),
            ("attitude_rad", &truth.attitude_rad),
            ("body_rates_rad_s", &truth.body_rates_rad_s),
            ("wind_ned_m_s", &truth.wind_ned_m_s),
        ] {
            dict.set_item(name, values.to_vec())?;
        }
        dict.set_item("rotor_thrust_n", truth.rotor_thrust_n[..count].to_vec())?;
        dict.set_item("state_of_charge", truth.state_of_charge)?;
        dict.set_item("battery_voltage_v", truth.battery_voltage_v)?;
        dict.set_item("battery_current_a", truth.battery_current_a)?;
        dict.set_item("fault_label", truth.fault_label)?;
        let faulty: Vec<usize> = (0..count)
            .filter(|rotor| truth.faulty_rotors >> rotor & 1 == 1)
            .map(|rotor| rotor + 1)
            .collect();
        dict.set_item("faulty_rotors", faulty)?;
        Ok(dict)
    }

    /// Outputs of the detectors after the last step.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let report = &self.report;
        let dict = PyDict::new(py);
        dict.set_item("sequential", report.sequential)?;
        dict.set_item("probability", report.sequential_probability)?;
        let loss = &report.thrust_loss;
        dict.set_item("loss", (loss.share, loss.share_low, loss.share_high))?;
        dict.set_item("t_test", report.t_test)?;
        dict.set_item("network", report.network)?;
        dict.set_item("residuals_nms", report.residuals_nms.to_vec())?;
        dict.set_item("wrench_residual", report.wrench_residual.to_vec())?;
        Ok(dict)
    }

    /// All steps so far, by column.
    fn telemetry<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.recording.arrays(py)
    }
}

impl Simulation {
    fn begin(scenario: Arc<rotortwin_scenario::Scenario>, seed: u64, record: Vec<String>) -> PyResult<Self> {
        let flight = SteppedFlight::new(&scenario, seed).map_err(crate::refusal::input)?;
        let recording = Recording::new(&scenario, flight.rotor_count(), &record)?;
        Ok(Self {
            scenario,
            seed,
            record,
            flight,
            recording,
            report: FdiReport::default(),
        })
    }

    fn one(&mut self, duty: Option<&[f32]>) -> PyResult<()> {
        let sample = self.flight.step(duty).map_err(|failure| flight(failure.sentence))?;
        self.recording.push(&sample);
        self.report = sample.report;
        Ok(())
    }
}
