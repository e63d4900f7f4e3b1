//! From a planned flight to its record.
//!
//! ```text
//!  PlannedFlight ─▶ scenario ─▶ FlightEngine (plant ⇄ controller, FDI) ── every sample ─▶ FlightScorer ─▶ FlightRecord
//! ```
//!
//! [`FlightEngine`] abstracts how flights are stepped: one by one ([`OneByOne`]), or many side by side ([`SideBySide`]).

use super::document::Criteria;
use super::plan::{Campaign, PlannedFlight};
use super::record::{DETECTORS, FlightRecord, FlightStatus};
use super::score::{DetectorScorer, Verdict, WindowTruth};
use rotortwin_flight::batch::{self, BatchFlight};
use rotortwin_flight::lockstep::{self, FlightEnd, FlightObserver, FlightOutcome, StopReason};
use rotortwin_flight::pace::Pace;
use rotortwin_flight::sample::Sample;
use rotortwin_flight::setup::{ground, run_setup};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::verdict_code::NOT_READY;
use rotortwin_plant::batch::LANES;
use rotortwin_plant::nearest_step;
use rotortwin_plant::vector_units::Dispatch;
use rotortwin_scenario::Scenario;
use rotortwin_wire::frames::LossEstimate;
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::peers::{AirborneEngine, FdiEnginePeer, PidPeer};

/// Result of a flight, besides its score.
#[derive(Clone, Debug, PartialEq)]
pub struct Flown {
    /// Why it ended early, as a message.
    pub failure: Option<String>,
    /// Complete steps.
    pub steps: u64,
    /// Hash over all of them.
    pub run_hash: String,
}

/// Steps flights to their end and passes every complete sample to the flight's scorer. All implementations are bit-identical.
pub trait FlightEngine: Sync {
    /// Preferred number of flights at a time.
    fn lanes(&self) -> usize;

    /// Flies every scenario with its seed; results in the order of the scenarios.
    fn fly(&self, flights: &[(Scenario, u64)], scorers: &mut [FlightScorer]) -> Vec<Flown>;
}

/// The lockstep loop of [`rotortwin_flight::lockstep`], one flight after another.
pub struct OneByOne;

impl FlightEngine for OneByOne {
    fn lanes(&self) -> usize {
        1
    }

    fn fly(&self, flights: &[(Scenario, u64)], scorers: &mut [FlightScorer]) -> Vec<Flown> {
        let flights = flights.iter().zip(scorers);
        flights
            .map(|((scenario, seed), scorer)| fly_alone(scenario, *seed, scorer))
            .collect()
    }
}

/// Flies one scenario for any observer.
pub fn fly_alone(scenario: &Scenario, seed: u64, observer: &mut impl FlightObserver) -> Flown {
    let mut simulation = match scenario.simulation(seed) {
        Ok(simulation) => simulation,
        Err(error) => {
            return Flown {
                failure: Some(error.to_string()),
                steps: 0,
                run_hash: String::new(),
            };
        }
    };
    let setup = run_setup(scenario, &simulation, 1);
    let mut link = InProcessLink::new(PidPeer::default(), FdiEnginePeer::default());
    flown_of(lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, observer))
}

/// Flights in the lanes of vector registers ([`rotortwin_flight::batch`]).
#[derive(Default)]
pub struct SideBySide {
    dispatch: Dispatch,
}

impl FlightEngine for SideBySide {
    fn lanes(&self) -> usize {
        // Twice: a lane whose flight ends early takes another.
        2 * LANES
    }

    fn fly(&self, flights: &[(Scenario, u64)], scorers: &mut [FlightScorer]) -> Vec<Flown> {
        let mut flown: Vec<Option<Flown>> = flights.iter().map(|_| None).collect();
        let (mut taken, mut batch, mut watching) = (Vec::new(), Vec::new(), Vec::new());
        for (index, (flight, scorer)) in flights.iter().zip(scorers).enumerate() {
            let (scenario, seed) = (&flight.0, flight.1);
            let candidate = BatchFlight { scenario, seed };
            if batch::takes(&candidate) {
                taken.push(index);
                batch.push(candidate);
                watching.push(Some(scorer));
            } else {
                flown[index] = OneByOne
                    .fly(std::slice::from_ref(flight), std::slice::from_mut(scorer))
                    .pop();
            }
        }
        let observer = |place: usize| watching[place].take().expect("a flight has one observer");
        match batch::fly_batch(&batch, self.dispatch, observer) {
            Ok((outcomes, _)) => {
                for (index, outcome) in taken.into_iter().zip(outcomes) {
                    flown[index] = Some(flown_of(outcome.outcome));
                }
            }
            Err(sentence) => {
                for index in taken {
                    flown[index] = Some(Flown {
                        failure: Some(sentence.clone()),
                        steps: 0,
                        run_hash: String::new(),
                    });
                }
            }
        }
        flown
            .into_iter()
            .map(|flown| flown.expect("every flight was taken or flown alone"))
            .collect()
    }
}

fn flown_of(outcome: FlightOutcome) -> Flown {
    Flown {
        failure: match outcome.end {
            FlightEnd::Done => None,
            FlightEnd::Canceled => Some("canceled".to_owned()),
            FlightEnd::Failed(failure) => Some(failure.sentence),
        },
        steps: outcome.steps,
        run_hash: outcome.run_hash,
    }
}

/// Scores a flight while it is flown.
pub struct FlightScorer {
    rotor_count: usize,
    /// Fraction of the hover thrust for each blade code.
    blade_share: Vec<f64>,
    /// Mean thrust of a rotor in hover, N.
    hover_thrust_n: f64,
    lost_tilt_cos: f64,
    lost_distance_m: f64,
    window_steps: u64,
    labels: Vec<(i32, u32)>,
    onset_step: Option<u64>,
    faulty_rotors: u32,
    detectors: [DetectorScorer; DETECTORS.len()],
    /// Engine, its verdict, its score.
    curve: Vec<(AirborneEngine, Verdict, DetectorScorer)>,
    /// Verdict of the last window.
    verdict: i32,
    thrust_loss: LossEstimate,
    last_blade: [i32; MAX_ROTORS],
    last_loss: [f64; MAX_ROTORS],
    last_voltage_v: f64,
    /// Step and truth of each window, if they are wanted.
    windows: Option<Vec<(u64, WindowTruth)>>,
}

impl FlightScorer {
    /// Scorer of one flight of `scenario`. `levels`: evidence, nats, of further instances of the sequential detector.
    pub fn new(scenario: &Scenario, criteria: &Criteria, levels: &[f32]) -> Result<Self, String> {
        let config = scenario.fdi_config();
        let vehicle = scenario.vehicle();
        let rotor_count = vehicle.rotor_count();
        let window_steps = u64::from(config.window_len);
        let mut curve = Vec::with_capacity(levels.len());
        for level in levels {
            let mut config = config;
            // A fault is absorbed at a fixed margin of evidence above the naming threshold.
            let reserve = config.sequential.evidence_to_absorb - config.sequential.evidence_to_isolate;
            config.sequential.evidence_to_isolate = *level;
            config.sequential.evidence_to_absorb = level + reserve;
            // The curve does not use them.
            config.network = None;
            let engine = AirborneEngine::new(config, ground(scenario)).map_err(|error| error.to_string())?;
            curve.push((engine, Verdict::of_code(NOT_READY), DetectorScorer::new(window_steps)));
        }
        Ok(Self {
            rotor_count,
            blade_share: blade_shares(scenario, f64::from(vehicle.battery.cells) * 3.9),
            hover_thrust_n: vehicle.body.mass_kg * vehicle.body.gravity_m_s2 / rotor_count as f64,
            lost_tilt_cos: criteria.lost_tilt_deg.to_radians().cos(),
            lost_distance_m: criteria.lost_distance_m,
            window_steps,
            labels: Vec::with_capacity(usize::from(config.window_len)),
            onset_step: None,
            faulty_rotors: 0,
            detectors: std::array::from_fn(|_| DetectorScorer::new(window_steps)),
            curve,
            verdict: NOT_READY,
            thrust_loss: LossEstimate::default(),
            last_blade: [0; MAX_ROTORS],
            last_loss: [0.0; MAX_ROTORS],
            last_voltage_v: f64::from(vehicle.battery.cells) * 3.9,
            windows: None,
        })
    }

    /// Keeps the truth of every window, for verdicts that are given after the flight.
    #[must_use]
    pub fn keeping_windows(self) -> Self {
        Self {
            windows: Some(Vec::new()),
            ..self
        }
    }

    /// Last step and truth of each window so far; none unless they are kept.
    pub fn take_windows(&mut self) -> Vec<(u64, WindowTruth)> {
        self.windows.take().unwrap_or_default()
    }

    fn loss_share_of(&self, blade: &[i32; MAX_ROTORS], loss: &[f64; MAX_ROTORS]) -> f64 {
        let share = |rotor: usize| {
            let given = usize::try_from(blade[rotor])
                .ok()
                .and_then(|code| self.blade_share.get(code))
                .copied()
                .unwrap_or(1.0);
            1.0 - given * (1.0 - loss[rotor])
        };
        (0..self.rotor_count).map(share).fold(0.0, larger)
    }

    fn window(&mut self, sample: &Sample) {
        // The median label, as in the protocol; rotors of the corresponding sample.
        self.labels.sort_unstable();
        let (label, faulty_rotors) = self.labels[self.labels.len() / 2];
        let truth = WindowTruth {
            label,
            faulty_rotors,
            touched: self.labels.iter().any(|(label, _)| *label != 0),
            loss_share: self.loss_share_of(&sample.truth.rotor_blade, &sample.truth.rotor_thrust_loss),
            after_onset_steps: self.onset_step.map(|onset| sample.truth.step + 1 - onset),
        };
        if let Some(windows) = &mut self.windows {
            windows.push((sample.truth.step, truth));
        }
        self.labels.clear();
        self.last_blade = sample.truth.rotor_blade;
        self.last_loss = sample.truth.rotor_thrust_loss;
        self.last_voltage_v = sample.truth.battery_voltage_v;
        let report = &sample.report;
        self.verdict = report.sequential;
        self.thrust_loss = report.thrust_loss;
        let sequential = Verdict {
            code: report.sequential,
            suspect_rotors: report.suspect_rotors,
        };
        let verdicts = [
            sequential,
            Verdict::of_code(report.network),
            Verdict::of_code(report.t_test),
        ];
        for (detector, verdict) in self.detectors.iter_mut().zip(verdicts) {
            detector.window(&truth, verdict);
        }
        for (_, verdict, detector) in &mut self.curve {
            detector.window(&truth, *verdict);
        }
    }

    /// The record of the observed flight.
    pub fn finish(mut self, planned: &PlannedFlight, scenario: &Scenario, flown: Flown) -> FlightRecord {
        let faulty = self.onset_step.is_some();
        let onset_loss = first_loss(scenario, &self.blade_share);
        self.blade_share = blade_shares(scenario, self.last_voltage_v);
        let final_loss = self.loss_share_of(&self.last_blade, &self.last_loss);
        // For a pair, the estimate is that of one of two rotors, and the truth that of the worst.
        let estimate = (1..100).contains(&self.verdict).then_some(self.thrust_loss);
        FlightRecord {
            status: match flown.failure {
                None => FlightStatus::Done,
                Some(_) => FlightStatus::Failed,
            },
            reason: flown.failure.unwrap_or_default(),
            run_hash: flown.run_hash,
            steps: flown.steps,
            rotor_count: u32::try_from(self.rotor_count).expect("at most 16 rotors"),
            fault_onset_s: self.onset_step.map(|step| step as f64 * rotortwin_plant::STEP_S),
            faulty_rotors: self.faulty_rotors,
            onset_loss_share: faulty.then_some(onset_loss),
            final_loss_share: faulty.then_some(final_loss),
            thrust_loss_n: estimate.map(|loss| f64::from(loss.loss_n)),
            thrust_loss_low_n: estimate.map(|loss| f64::from(loss.low_n)),
            thrust_loss_high_n: estimate.map(|loss| f64::from(loss.high_n)),
            true_thrust_loss_n: faulty.then_some(final_loss * self.hover_thrust_n),
            detectors: self.detectors.map(DetectorScorer::finish).into(),
            curve: self.curve.into_iter().map(|(_, _, scorer)| scorer.finish()).collect(),
            ..blank(planned)
        }
    }
}

impl FlightObserver for FlightScorer {
    #[inline]
    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        let truth = &sample.truth;
        if truth.faulty_rotors != 0 {
            self.onset_step.get_or_insert(truth.step);
            self.faulty_rotors |= truth.faulty_rotors;
        }
        self.labels.push((truth.fault_label, truth.faulty_rotors));
        if !self.curve.is_empty() {
            let measurement = sample.command.measurement(&sample.sensors);
            for (engine, verdict, _) in &mut self.curve {
                let output = engine.step(&measurement);
                *verdict = Verdict {
                    code: output.sequential.code(),
                    suspect_rotors: output.suspects.rotors,
                };
            }
        }
        if sample.report.window_end == 1 {
            self.window(sample);
        } else if self.labels.len() as u64 > 4 * self.window_steps {
            // When samples are rejected, the window waits and its truth is that of the latest samples.
            self.labels.remove(0);
        }
        let [roll, pitch, _] = truth.attitude_rad;
        if roll.cos() * pitch.cos() < self.lost_tilt_cos {
            return Err(format!(
                "the vehicle was lost at {:.2} s: it tilted by more than {:.0}°",
                truth.step as f64 * rotortwin_plant::STEP_S,
                self.lost_tilt_cos.acos().to_degrees()
            ));
        }
        let reference = sample.sensors.reference_position_ned_m;
        let squares = (0..3).map(|axis| {
            let error = truth.position_ned_m[axis] - f64::from(reference[axis]);
            error * error
        });
        let squared: f64 = squares.sum();
        if squared > self.lost_distance_m * self.lost_distance_m {
            return Err(format!(
                "the vehicle was lost at {:.2} s: more than {} m away from its reference",
                truth.step as f64 * rotortwin_plant::STEP_S,
                self.lost_distance_m
            ));
        }
        Ok(())
    }

    #[inline]
    fn stop_requested(&mut self) -> Option<StopReason> {
        None
    }
}

/// Fraction of the nominal thrust that each blade gives at the duty at which the nominal one hovers at `voltage`, by truth code. It
/// varies by a few per cent of itself over a discharge.
fn blade_shares(scenario: &Scenario, voltage: f64) -> Vec<f64> {
    let vehicle = scenario.vehicle();
    let nominal = scenario.nominal_blade();
    let mean = vehicle.body.mass_kg * vehicle.body.gravity_m_s2 / vehicle.rotor_count() as f64;
    let duty = nominal.duty(mean, voltage).unwrap_or(0.5);
    let healthy = nominal.lift(duty, voltage);
    let shares = scenario
        .blades()
        .blade
        .values()
        .map(|blade| blade.lift(duty, voltage) / healthy);
    std::iter::once(1.0).chain(shares).collect()
}

/// The larger of two losses, whichever sign they have: a rotor that gives more has a negative one.
fn larger(one: f64, other: f64) -> f64 {
    if other.abs() > one.abs() { other } else { one }
}

/// Fractional loss of the worst of the first faults, once fully developed; negative for a rotor that gives more, 0 for one whose thrust
/// stays.
fn first_loss(scenario: &Scenario, blade_share: &[f64]) -> f64 {
    let faults = &scenario.document().fault;
    let first = faults.iter().map(|fault| nearest_step(fault.time_s)).min();
    faults
        .iter()
        .filter(|fault| Some(nearest_step(fault.time_s)) == first)
        .map(|fault| match (&fault.blade, fault.thrust_loss_percent) {
            (Some(name), _) => {
                let code = scenario
                    .blades()
                    .code(name)
                    .and_then(|code| usize::try_from(code + 1).ok());
                1.0 - code.and_then(|code| blade_share.get(code)).copied().unwrap_or(1.0)
            }
            (None, Some(percent)) => percent / 100.0,
            (None, None) if fault.rotor_lost == Some(true) => 1.0,
            (None, None) => 0.0,
        })
        .fold(0.0, larger)
}

fn blank(planned: &PlannedFlight) -> FlightRecord {
    FlightRecord {
        flight: planned.index,
        seed: planned.seed,
        parameters: planned
            .parameters
            .iter()
            .map(|parameter| (parameter.axis.clone(), parameter.cell.clone()))
            .collect(),
        status: FlightStatus::Refused,
        reason: String::new(),
        run_hash: String::new(),
        steps: 0,
        rotor_count: 0,
        fault_onset_s: None,
        faulty_rotors: 0,
        onset_loss_share: None,
        final_loss_share: None,
        thrust_loss_n: None,
        thrust_loss_low_n: None,
        thrust_loss_high_n: None,
        true_thrust_loss_n: None,
        detectors: Vec::new(),
        curve: Vec::new(),
    }
}

/// Record of a flight that could not be flown, with the reason.
pub(super) fn failed_record(campaign: &Campaign, index: u64, reason: String) -> FlightRecord {
    let planned = campaign.flight(index).unwrap_or(PlannedFlight {
        index,
        seed: 0,
        parameters: Vec::new(),
    });
    FlightRecord {
        reason,
        ..blank(&planned)
    }
}

/// Flies flights of a campaign. A flight that cannot be flown is a record like any other, with its reason.
pub fn fly(campaign: &Campaign, engine: &dyn FlightEngine, indices: std::ops::Range<u64>) -> Vec<FlightRecord> {
    let first = indices.start;
    let planned = indices.map(|index| campaign.flight(index));
    let mut records: Vec<Option<FlightRecord>> = Vec::new();
    let mut ready = Vec::new();
    for (place, planned) in planned.enumerate() {
        let planned = match planned {
            Ok(planned) => planned,
            Err(error) => {
                records.push(Some(failed_record(campaign, first + place as u64, error.to_string())));
                continue;
            }
        };
        match campaign.scenario(&planned) {
            Ok(scenario) => {
                ready.push((place, planned, scenario));
                records.push(None);
            }
            Err(error) => records.push(Some(FlightRecord {
                reason: error.to_string(),
                ..blank(&planned)
            })),
        }
    }
    let levels = campaign.levels();
    let criteria = &campaign.document().criteria;
    let mut flights = Vec::with_capacity(ready.len());
    let mut scorers = Vec::with_capacity(ready.len());
    let mut places = Vec::with_capacity(ready.len());
    for (place, planned, scenario) in ready {
        match FlightScorer::new(&scenario, criteria, levels) {
            Ok(scorer) => {
                flights.push((scenario, planned.seed));
                scorers.push(scorer);
                places.push((place, planned));
            }
            Err(reason) => {
                records[place] = Some(FlightRecord {
                    reason,
                    ..blank(&planned)
                });
            }
        }
    }
    let flown = engine.fly(&flights, &mut scorers);
    for ((((place, planned), scorer), (scenario, _)), flown) in places.into_iter().zip(scorers).zip(&flights).zip(flown)
    {
        records[place] = Some(scorer.finish(&planned, scenario, flown));
    }
    records
        .into_iter()
        .map(|record| record.expect("every flight has a record"))
        .collect()
}

/// Flies and scores one scenario as a separate flight, for searches beyond the plan.
pub fn fly_scenario(
    campaign: &Campaign,
    engine: &dyn FlightEngine,
    scenario: Scenario,
) -> Result<FlightRecord, String> {
    let mut records = fly_scenarios(campaign, engine, vec![scenario])?;
    records.pop().ok_or_else(|| "the engine flew nothing".to_owned())
}

/// Flies and scores scenarios as separate flights, all at once; records in the order of the scenarios.
pub fn fly_scenarios(
    campaign: &Campaign,
    engine: &dyn FlightEngine,
    scenarios: Vec<Scenario>,
) -> Result<Vec<FlightRecord>, String> {
    let mut scorers = scenarios
        .iter()
        .map(|scenario| FlightScorer::new(scenario, &campaign.document().criteria, &[]))
        .collect::<Result<Vec<_>, _>>()?;
    let flights: Vec<(Scenario, u64)> = scenarios
        .into_iter()
        .map(|scenario| {
            let seed = scenario.seed();
            (scenario, seed)
        })
        .collect();
    let flown = engine.fly(&flights, &mut scorers);
    let records = flights
        .iter()
        .zip(scorers)
        .zip(flown)
        .map(|(((scenario, seed), scorer), flown)| {
            let planned = PlannedFlight {
                index: 0,
                seed: *seed,
                parameters: Vec::new(),
            };
            scorer.finish(&planned, scenario, flown)
        });
    Ok(records.collect())
}
