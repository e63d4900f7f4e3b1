//! Many flights at once: stepped by a caller ([`SimulationBatch`]), or from start to end in parallel vector lanes ([`fly`]).

use crate::columns::{Recording, bytes, singles};
use crate::interrupt::{in_parts, interruptible};
use crate::refusal::{input, pickled};
use crate::scenario::Scenario;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyDict};
use rayon::prelude::*;
use rotortwin_flight::batch::{BatchFlight, fly_batch};
use rotortwin_flight::lockstep::{FlightEnd, FlightObserver, StopReason};
use rotortwin_flight::sample::Sample;
use rotortwin_flight::stepped::SteppedFlight;
use rotortwin_plant::vector_units::Dispatch;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Steps of every flight between two looks at Python's signals.
const STEPS_UNHEARD: u64 = 500;
/// Flights per thread at a time: enough to keep its lanes full for long.
const FLIGHTS_OF_A_PART: usize = 32;

/// A flight and its state.
#[derive(Clone)]
struct Seat {
    scenario: Arc<rotortwin_scenario::Scenario>,
    seed: u64,
    flight: SteppedFlight,
    /// Why it cannot continue.
    failure: Option<String>,
}

impl Seat {
    fn new(scenario: Arc<rotortwin_scenario::Scenario>, seed: u64) -> Result<Self, String> {
        let flight = SteppedFlight::new(&scenario, seed)?;
        Ok(Self {
            scenario,
            seed,
            flight,
            failure: None,
        })
    }

    fn step(&mut self, duty: Option<&[f32]>, steps: u64) {
        for _ in 0..steps {
            if self.failure.is_some() || self.flight.done() {
                return;
            }
            if let Err(failure) = self.flight.step(duty) {
                self.failure = Some(failure.sentence);
            }
        }
    }
}

/// Flights of vehicles with the same number of rotors, stepped together on all cores.
#[derive(Clone)]
#[pyclass(module = "rotortwin._native")]
pub(crate) struct SimulationBatch {
    seats: Vec<Seat>,
    rotor_count: usize,
}

#[pymethods]
impl SimulationBatch {
    #[new]
    fn new(py: Python<'_>, scenarios: Vec<Py<Scenario>>, seeds: Vec<u64>) -> PyResult<Self> {
        if scenarios.is_empty() || scenarios.len() != seeds.len() {
            return Err(input(format!(
                "expected as many seeds as scenarios and at least one, got {} and {}",
                seeds.len(),
                scenarios.len()
            )));
        }
        let scenarios: Vec<_> = scenarios
            .iter()
            .map(|scenario| Arc::clone(&scenario.get().inner))
            .collect();
        let seats = py.detach(|| {
            scenarios
                .into_par_iter()
                .zip(seeds)
                .map(|(scenario, seed)| Seat::new(scenario, seed))
                .collect::<Result<Vec<_>, _>>()
        });
        let seats = seats.map_err(input)?;
        let rotor_count = seats[0].flight.rotor_count();
        if let Some(other) = seats
            .iter()
            .map(|seat| seat.flight.rotor_count())
            .find(|count| *count != rotor_count)
        {
            return Err(input(format!(
                "expected vehicles of the same number of rotors, got {rotor_count} and {other}"
            )));
        }
        Ok(Self { seats, rotor_count })
    }

    fn __len__(&self) -> usize {
        self.seats.len()
    }

    #[getter]
    fn rotor_count(&self) -> usize {
        self.rotor_count
    }

    #[getter]
    fn hover_duty(&self) -> Vec<f32> {
        self.seats.iter().map(|seat| seat.flight.hover_duty()).collect()
    }

    /// Restarts the flights at `places`, with new seeds and, where given, other scenarios.
    #[pyo3(signature = (places, seeds, scenarios = None))]
    fn reset(&mut self, places: Vec<usize>, seeds: Vec<u64>, scenarios: Option<Vec<Py<Scenario>>>) -> PyResult<()> {
        if places.len() != seeds.len() || scenarios.as_ref().is_some_and(|list| list.len() != places.len()) {
            return Err(input("expected as many seeds, and scenarios, as places"));
        }
        for (number, (&place, seed)) in places.iter().zip(seeds).enumerate() {
            let count = self.seats.len();
            let seat = self
                .seats
                .get_mut(place)
                .ok_or_else(|| input(format!("expected places below {count}, got {place}")))?;
            let scenario = match &scenarios {
                Some(list) => Arc::clone(&list[number].get().inner),
                None => Arc::clone(&seat.scenario),
            };
            let begun = Seat::new(scenario, seed).map_err(input)?;
            if begun.flight.rotor_count() != self.rotor_count {
                return Err(input(format!(
                    "expected a vehicle of {} rotors, got one of {}",
                    self.rotor_count,
                    begun.flight.rotor_count()
                )));
            }
            *seat = begun;
        }
        Ok(())
    }

    /// Holds one row of duties for each flight over `steps` steps, or lets our controllers fly.
    #[pyo3(signature = (duty = None, steps = 1))]
    fn step(&mut self, py: Python<'_>, duty: Option<&[u8]>, steps: u32) -> PyResult<()> {
        let duty = duty.map(singles);
        let (flights, rotors) = (self.seats.len(), self.rotor_count);
        if let Some(duty) = &duty
            && duty.len() != flights * rotors
        {
            return Err(input(format!(
                "expected duties of shape ({flights}, {rotors}), got {} numbers",
                duty.len()
            )));
        }
        in_parts(py, u64::from(steps), STEPS_UNHEARD, |now| {
            self.seats.par_iter_mut().enumerate().for_each(|(place, seat)| {
                let own = duty.as_ref().map(|duty| &duty[place * rotors..(place + 1) * rotors]);
                seat.step(own, now);
            });
            Ok(true)
        })
    }

    /// The same flights at the same steps; the copies go on apart.
    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(pickled(
            "a batch of flights",
            "scenarios and seeds to be sent, and the flights to be flown there: same seed, same bits",
        ))
    }

    #[getter]
    fn observation<'py>(&self, py: Python<'py>) -> Bound<'py, PyByteArray> {
        let numbers = self.seats.iter().flat_map(|seat| seat.flight.sensors().numbers());
        bytes(py, numbers.map(f32::to_ne_bytes))
    }

    #[getter]
    fn motion<'py>(&self, py: Python<'py>) -> Bound<'py, PyByteArray> {
        let numbers = self.seats.iter().flat_map(|seat| seat.flight.truth().motion());
        bytes(py, numbers.map(f64::to_ne_bytes))
    }

    #[getter]
    fn done(&self) -> Vec<bool> {
        self.seats.iter().map(|seat| seat.flight.done()).collect()
    }

    /// One sentence for each flight that cannot continue.
    #[getter]
    fn failures(&self) -> Vec<Option<String>> {
        self.seats.iter().map(|seat| seat.failure.clone()).collect()
    }

    #[getter]
    fn seeds(&self) -> Vec<u64> {
        self.seats.iter().map(|seat| seat.seed).collect()
    }

    #[getter]
    fn run_hashes(&self) -> Vec<String> {
        self.seats.iter().map(|seat| seat.flight.run_hash()).collect()
    }
}

/// Doubles by column, run hashes, one sentence for each flight that ended early.
type FlownTogether<'py> = (Bound<'py, PyDict>, Vec<String>, Vec<Option<String>>);

/// Keeps some columns of every n-th row.
struct Keeper<'a> {
    every: u64,
    recording: Recording,
    /// Set once nobody waits for the flights.
    stop: &'a AtomicBool,
}

impl FlightObserver for Keeper<'_> {
    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        if sample.truth.step.is_multiple_of(self.every) {
            self.recording.push(sample);
        }
        Ok(())
    }

    fn stop_requested(&mut self) -> Option<StopReason> {
        self.stop.load(Ordering::Relaxed).then_some(StopReason::Canceled)
    }
}

/// A flown flight.
struct Flown {
    recording: Recording,
    run_hash: String,
    failure: Option<String>,
}

/// Flies `scenario` with each seed from start to end, in parallel, with our controller; keeps some columns of every n-th step.
///
/// Returns (flights × rows) doubles by name, padded with NaN where a flight ended early, the run hashes and the failures.
#[pyfunction]
#[pyo3(signature = (scenario, seeds, columns, every = 1))]
pub(crate) fn fly<'py>(
    py: Python<'py>,
    scenario: &Scenario,
    seeds: Vec<u64>,
    columns: Vec<String>,
    every: u64,
) -> PyResult<FlownTogether<'py>> {
    if every == 0 {
        return Err(input("expected `every` from 1 on, got 0"));
    }
    let scenario = Arc::clone(&scenario.inner);
    let rotor_count = scenario.vehicle().rotor_count();
    let names = Recording::new(&scenario, rotor_count, &columns)?.names();
    let flown = interruptible(py, |stop| {
        seeds
            .par_chunks(FLIGHTS_OF_A_PART)
            .map(|part| side_by_side(&scenario, part, &columns, every, stop))
            .collect::<Result<Vec<_>, _>>()
    })?;
    let flown: Vec<Flown> = flown.map_err(input)?.into_iter().flatten().collect();
    let rows = usize::try_from(scenario.duration_steps().div_ceil(every)).map_err(input)?;
    let arrays = PyDict::new(py);
    for (place, name) in names.iter().enumerate() {
        let mut values = vec![f64::NAN; flown.len() * rows];
        for (flight, row) in flown.iter().zip(values.chunks_mut(rows.max(1))) {
            let kept = &flight.recording.values[place];
            row[..kept.len()].copy_from_slice(kept);
        }
        arrays.set_item(name, bytes(py, values.into_iter().map(f64::to_ne_bytes)))?;
    }
    let (hashes, failures) = flown
        .into_iter()
        .map(|flight| (flight.run_hash, flight.failure))
        .unzip();
    Ok((arrays, hashes, failures))
}

fn side_by_side(
    scenario: &rotortwin_scenario::Scenario,
    seeds: &[u64],
    columns: &[String],
    every: u64,
    stop: &AtomicBool,
) -> Result<Vec<Flown>, String> {
    let rotor_count = scenario.vehicle().rotor_count();
    let flights: Vec<BatchFlight<'_>> = seeds.iter().map(|&seed| BatchFlight { scenario, seed }).collect();
    let keeper = |_| Keeper {
        every,
        recording: Recording::new(scenario, rotor_count, columns).expect("these columns were there before"),
        stop,
    };
    let (outcomes, _) = fly_batch(&flights, Dispatch::default(), keeper)?;
    Ok(outcomes
        .into_iter()
        .map(|flown| Flown {
            recording: flown.observer.recording,
            run_hash: flown.outcome.run_hash,
            failure: match flown.outcome.end {
                FlightEnd::Failed(failure) => Some(failure.sentence),
                FlightEnd::Done | FlightEnd::Canceled => None,
            },
        })
        .collect())
}
