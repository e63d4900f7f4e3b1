//! Conformance test of an unknown controller: it flies the simulated plant, and its errors are identified.
//!
//! ```text
//!  hover held still ─▶ change one sensor value at a time ─▶ responses: delay, sign, frame, motor order, spin
//!                                                       └▶ gains ─▶ would they fly? in which unit?
//!  a short closed-loop flight ─▶ does it hold, follow, turn? ─▶ extreme sensor values ─▶ only fractions?
//! ```
//! An autopilot, which cannot be held still in a hover, is tested on a stand instead ([`spin_test`]): order and spin of its motors.
//!
//! The flight decides, the responses give the reason: a controller that flies is not faulted for unusual gains or structure. Always
//! faulted, whatever happens in flight: protocol violations (NaN, duties out of range, steps skipped or answered twice), late or
//! infrequently computed answers, references that are not followed, a yaw that is not wrapped.
//!
//! Limits: a single fault is identified reliably, several at once may mask each other; anything unexplained is reported. The controller
//! is probed around hover and for 60 ms at a time: integrators and slow filters only show in the flight.

mod flight;
mod motors;
mod probe;
mod response;
mod stand;
mod suspect;
mod units;

pub use stand::{MotorVerdict, SpinReport, spin_test};

use crate::setup::run_setup;
use probe::{Delays, Prober, Trouble};
use response::{Airframe, Input, MOTION, Responses, TURN_RAD, UP, YAW};
use rotortwin_flight_core::frames::{EulerAngles, Vec3};
use rotortwin_flight_core::signals::NavState;
use rotortwin_plant::{Simulation, SimulationError};
use rotortwin_proto::Role;
use rotortwin_scenario::Scenario;
use rotortwin_wire::frames::SensorFrame;
use rotortwin_wire::link::{LinkError, PlantLink};
use serde::Serialize;
use std::time::Duration;

/// Maximum number of steps of the run, as announced to the peers.
const MOST_STEPS: u64 = 100_000;
/// Thrust-to-weight ratio at the reference that counts as hover.
const LIFT: std::ops::RangeInclusive<f64> = 0.5..=2.0;
/// Ratio of the response to the reference and the response to the sensed value.
const ALIKE: std::ops::RangeInclusive<f64> = 0.2..=5.0;
/// Vertical gains below which the voltage is not assessed.
const SIGN: f64 = 1e-9;

/// Kind of error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    /// A field is missing, swapped with another, or not used.
    Field,
    /// Degrees instead of radians, pulse widths instead of fractions, centimetres instead of metres.
    Unit,
    /// A sign.
    Sign,
    /// NED, ENU, FRD, FLU; heading.
    Frame,
    /// Duties assigned to the wrong motors.
    MotorOrder,
    /// Rotation direction of a rotor, or sign of the yaw moment.
    Spin,
    /// It computes less often than it is called.
    Rate,
    /// It answers with an earlier step's result, or takes too long.
    Latency,
    /// A step without an answer, or an answer to a step that was not requested.
    MissedStep,
    /// NaN or infinite.
    NotFinite,
    /// A step answered more than once.
    Duplicate,
    /// It refuses to fly, or exits.
    Refusal,
    /// It does not fly, for an unknown reason.
    Flight,
}

impl Fault {
    /// Printed name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Field => "field",
            Self::Unit => "unit",
            Self::Sign => "sign",
            Self::Frame => "frame",
            Self::MotorOrder => "motor order",
            Self::Spin => "spin",
            Self::Rate => "rate",
            Self::Latency => "latency",
            Self::MissedStep => "missed step",
            Self::NotFinite => "not finite",
            Self::Duplicate => "duplicate",
            Self::Refusal => "refusal",
            Self::Flight => "flight",
        }
    }
}

/// One suspected error.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Suspicion {
    /// Kind of error.
    pub fault: Fault,
    /// Affected message fields.
    pub field: String,
    /// What is wrong with them.
    pub sentence: String,
    /// Observed evidence.
    pub evidence: String,
    /// Alternative explanations that fit equally well.
    pub others: Vec<String>,
}

/// One check.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    /// Name.
    pub name: &'static str,
    /// Whether it passed.
    pub passed: bool,
    /// Observed evidence.
    pub evidence: String,
}

/// Result of the conformance test.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// In the order in which they were run.
    pub checks: Vec<Check>,
    /// Errors found; empty if it conforms.
    pub findings: Vec<Suspicion>,
    /// Number of steps requested.
    pub steps: u64,
    /// Median and 99th percentile of the response time, ms of wall clock.
    pub answer_ms: [f64; 2],
}

impl Report {
    /// True if there are no findings.
    pub fn conforms(&self) -> bool {
        self.findings.is_empty()
    }

    fn check(&mut self, name: &'static str, passed: bool, evidence: String) {
        self.checks.push(Check { name, passed, evidence });
    }

    fn find(
        &mut self,
        fault: Fault,
        field: impl Into<String>,
        sentence: impl Into<String>,
        evidence: impl Into<String>,
    ) {
        self.findings.push(Suspicion {
            fault,
            field: field.into(),
            sentence: sentence.into(),
            evidence: evidence.into(),
            others: Vec::new(),
        });
    }
}

/// Requirements on a controller in addition to the protocol.
#[derive(Clone, Copy, Debug, Default)]
pub struct Demands {
    /// Largest median response time, wall clock.
    pub answer: Option<Duration>,
}

/// Simulates the plant of `scenario`, which starts in trimmed hover, for the controller behind `link`.
///
/// # Errors
/// No controller connected, the scenario cannot be flown, or something other than the controller failed.
pub fn conform(
    link: &mut dyn PlantLink,
    scenario: &Scenario,
    seed: u64,
    run_id: u64,
    demands: &Demands,
) -> Result<Report, String> {
    if !scenario.starts_trimmed() {
        return Err(format!(
            "{}: expected initial.start = \"trimmed\": answers are measured around hover",
            scenario.name()
        ));
    }
    let mut simulation = scenario.simulation(seed).map_err(|error| error.to_string())?;
    let mut setup = run_setup(scenario, &simulation, run_id);
    setup.step_count = MOST_STEPS;
    let mut report = Report::default();
    let end = match link.open(&setup) {
        Ok(()) => {
            let mut prober = Prober::new(link, run_id, simulation.rotor_count());
            let end = examine(&mut prober, &mut simulation, scenario, &mut report);
            report.steps = prober.steps;
            answer_times(&mut report, &prober.answers, demands);
            end
        }
        Err(error) => Err(Trouble::Link(error)),
    };
    let failure = match end {
        Ok(()) => None,
        Err(Trouble::Plant(sentence)) => return Err(sentence),
        Err(Trouble::Link(error)) => {
            report.findings.push(blame(&error).ok_or_else(|| error.to_string())?);
            Some(error.to_string())
        }
    };
    link.finish(report.steps, failure.as_deref());
    let repeated = link.strays().repeated;
    report.check(
        "one answer to each step",
        repeated == 0,
        format!("{repeated} answers came again, of {} steps", report.steps),
    );
    if repeated > 0 {
        let evidence = format!("{repeated} of {} steps were answered twice", report.steps);
        report.find(
            Fault::Duplicate,
            "MotorCommand",
            "a step is answered more than once",
            evidence,
        );
    }
    Ok(report)
}

/// Everything between the handshake and the end.
fn examine(
    prober: &mut Prober<'_>,
    simulation: &mut Simulation,
    scenario: &Scenario,
    report: &mut Report,
) -> Result<(), Trouble> {
    let truth = *simulation.truth();
    let voltage_v = truth.battery_voltage_v as f32;
    let nav = NavState {
        position_ned: Vec3::from_array(truth.position_ned_m.map(|x| x as f32)),
        attitude: EulerAngles::default(),
        ..NavState::default()
    };
    let base = prober.frame(&nav, voltage_v);
    let airframe = Airframe::new(scenario, simulation.hover_duty(), voltage_v);
    prober.hold(base)?;
    let hover = prober.hold(base)?;
    let lift = airframe.lift(&hover);
    report.check(
        "hover",
        LIFT.contains(&lift),
        format!("thrust over weight {lift:.2} where sensors and reference agree"),
    );
    let (inner, delays) = delays(prober, base)?;
    timing(report, inner, delays);
    let responses = prober.responses(base, delays.map_or(0, |delays| delays.most))?;
    let references = references(prober, base, &responses, report)?;
    let wrapped = wrap(prober, base, &airframe, &responses)?;
    voltage(prober, base, &airframe, report)?;
    let flight = flight::fly(prober, simulation)?;
    report.check("flight", flight.flown, flight.evidence.clone());
    directions(&airframe, &responses, report);
    if flight.flown {
        report.checks.extend(wrapped.iter().map(|(check, _)| check.clone()));
        report
            .findings
            .extend(wrapped.into_iter().filter_map(|(_, suspicion)| suspicion));
    } else {
        explain(&airframe, &responses, lift, &flight.evidence, report);
    }
    // A misinterpreted sensed value also differs from its reference.
    let blamed = |sensed: usize| {
        let field = Input::Motion(sensed).field();
        let group = field.split('.').next().unwrap_or_default().to_owned();
        report
            .findings
            .iter()
            .any(|finding| finding.field.contains(&group) && !finding.field.contains("reference"))
    };
    let references: Vec<Suspicion> = references
        .into_iter()
        .filter(|(sensed, _)| !blamed(*sensed))
        .map(|(_, suspicion)| suspicion)
        .collect();
    report.findings.extend(references);
    if !flight.flown && report.findings.is_empty() {
        let sentence = "it does not fly; no single error of sign, frame, order, spin or unit explains it";
        report.find(Fault::Flight, "MotorCommand.duty", sentence, &flight.evidence);
    }
    extremes(prober, base)?;
    report.check(
        "extreme sensors",
        true,
        "only fractions for 60° of tilt, 50 m of distance, 10 rad/s".to_owned(),
    );
    Ok(())
}

/// Delay of the response to a body rate, or if there is none, to the pitch angle.
fn delays(prober: &mut Prober<'_>, base: SensorFrame) -> Result<(Input, Option<Delays>), Trouble> {
    for input in [Input::Motion(10), Input::Motion(7)] {
        let (response, size) = prober.response(base, input)?;
        if response::length(&response) > 0.0 {
            let delays = prober.delays(base, input, size)?;
            return Ok((input, delays));
        }
    }
    Ok((Input::Motion(7), None))
}

fn timing(report: &mut Report, input: Input, delays: Option<Delays>) {
    let Some(Delays { least, most }) = delays else {
        report.check(
            "answer in the same step",
            false,
            format!("no answer to {} at all", input.field()),
        );
        return;
    };
    let evidence = format!(
        "the duties follow a change of {} after {least} to {most} steps",
        input.field()
    );
    report.check("answer in the same step", most == 0, evidence.clone());
    if most > least {
        let period = most - least + 1;
        let sentence = format!(
            "it computes every {period} steps or so ({:.0} Hz), it is asked at 400 Hz",
            400.0 / period as f64
        );
        report.find(Fault::Rate, "MotorCommand.duty", sentence, evidence.clone());
    }
    if least > 0 {
        let sentence = format!(
            "the answer to step k is that to the sensors of step k − {least}, {:.1} ms old",
            2.5 * least as f64
        );
        report.find(Fault::Latency, "MotorCommand.duty", sentence, evidence);
    }
}

/// A reference must act like the sensed value with the opposite sign. Returns those that do not, with the sensed value.
fn references(
    prober: &mut Prober<'_>,
    base: SensorFrame,
    responses: &Responses,
    report: &mut Report,
) -> Result<Vec<(usize, Suspicion)>, Trouble> {
    let pairs = (0..3)
        .map(|i| (Input::ReferencePosition(i), i))
        .chain([(Input::ReferenceYaw, 8)]);
    let mut wrong = Vec::new();
    let mut ratios = Vec::new();
    for (input, motion) in pairs {
        let sensed = responses.motion[motion];
        if response::length(&sensed) == 0.0 {
            continue;
        }
        let (answer, _) = prober.response(base, input)?;
        let alike = -response::cosine(&answer, &sensed);
        let ratio = response::length(&answer) / response::length(&sensed);
        ratios.push(format!("{ratio:.2}"));
        if alike > 0.7 && ALIKE.contains(&ratio) {
            continue;
        }
        let (fault, sentence) = if ratio == 0.0 {
            (Fault::Field, "it is ignored: the vehicle will not follow")
        } else if alike < -0.7 {
            (Fault::Sign, "its sign is taken the other way round")
        } else if alike > 0.7 {
            (Fault::Unit, "it is not in the unit of the sensed number")
        } else {
            (Fault::Frame, "it is not in the frame of the sensed number")
        };
        let suspicion = Suspicion {
            fault,
            field: input.field(),
            sentence: sentence.to_owned(),
            evidence: format!(
                "its answer is {ratio:.3} of that to {}, cosine {alike:.2} with it",
                Input::Motion(motion).field()
            ),
            others: Vec::new(),
        };
        wrong.push((motion, suspicion));
    }
    let evidence = format!(
        "answers to north, east, down, yaw over those to the sensed ones: {}",
        ratios.join(", ")
    );
    report.check("reference", wrong.is_empty(), evidence);
    Ok(wrong)
}

/// From just east of south to just west of it must be a short turn. `None`: it does not hold yaw at all.
fn wrap(
    prober: &mut Prober<'_>,
    base: SensorFrame,
    airframe: &Airframe,
    responses: &Responses,
) -> Result<Option<(Check, Option<Suspicion>)>, Trouble> {
    let expected = airframe.accelerations(&responses.motion[8])[YAW];
    if expected == 0.0 {
        return Ok(None);
    }
    const BEYOND: f32 = 0.01;
    let south = std::f32::consts::PI;
    let at = |sensed: f32, wanted: f32| SensorFrame {
        attitude_rad: [0.0, 0.0, sensed],
        reference_yaw_rad: wanted,
        ..base
    };
    prober.hold(at(south - BEYOND, south - BEYOND))?;
    let rest = prober.hold(at(south - BEYOND, south - BEYOND))?;
    let across = prober.hold(at(south - BEYOND, BEYOND - south))?;
    prober.hold(at(south - BEYOND, south - BEYOND))?;
    prober.hold(base)?;
    let change = std::array::from_fn(|i| across[i] - rest[i]);
    // Sensed yaw 0.02 rad left of the reference.
    let ratio = airframe.accelerations(&change)[YAW] / (-2.0 * f64::from(BEYOND) * expected);
    let passed = (0.2..=5.0).contains(&ratio);
    let evidence = format!("0.02 rad across 180° of yaw are answered like {:.2} rad", 0.02 * ratio);
    let suspicion = (!passed).then(|| Suspicion {
        fault: Fault::Frame,
        field: "attitude_rad.yaw".to_owned(),
        sentence: "the error of the yaw is not wrapped to −180° … 180°: it turns the long way round".to_owned(),
        evidence: evidence.clone(),
        others: Vec::new(),
    });
    let check = Check {
        name: "yaw across 180°",
        passed,
        evidence,
    };
    Ok(Some((check, suspicion)))
}

/// A higher voltage must not need a higher duty.
fn voltage(
    prober: &mut Prober<'_>,
    base: SensorFrame,
    airframe: &Airframe,
    report: &mut Report,
) -> Result<(), Trouble> {
    let (answer, _) = prober.response(base, Input::Voltage)?;
    let up = airframe.accelerations(&answer)[UP];
    let evidence = format!("one volt more is answered by {up:+.3} m/s² of thrust");
    report.check("voltage", up <= SIGN, evidence.clone());
    if up > SIGN {
        report.find(
            Fault::Sign,
            Input::Voltage.field(),
            "more volts are answered by more duty",
            evidence,
        );
    }
    Ok(())
}

/// Reports the direction of the responses, without a verdict: the flight decides.
fn directions(airframe: &Airframe, responses: &Responses, report: &mut Report) {
    let Some(direction) = suspect::direction(airframe, &responses.motion) else {
        return;
    };
    let words: Vec<String> = (0..MOTION)
        .map(|i| {
            let name = Input::Motion(i).field();
            let name = name.rsplit('.').next().unwrap_or_default().to_owned();
            match direction.cosines[i] {
                Some(cosine) => format!("{name} {cosine:.2}"),
                None => format!("{name} –"),
            }
        })
        .collect();
    report.check(
        "answers point the right way",
        direction.is_right(),
        format!("cosines: {}", words.join(", ")),
    );
}

/// Explains why it does not fly.
fn explain(airframe: &Airframe, responses: &Responses, lift: f64, flight: &str, report: &mut Report) {
    let mut columns = responses.motion;
    if !LIFT.contains(&lift) {
        let evidence = format!("thrust over weight is {lift:.2} where sensors and reference agree; {flight}");
        report.find(
            Fault::Unit,
            "MotorCommand.duty",
            "its duties do not lift the vehicle's weight",
            evidence,
        );
    }
    let silent: Vec<String> = (0..MOTION)
        .filter(|&i| response::length(&columns[i]) == 0.0)
        .map(|i| Input::Motion(i).field())
        .collect();
    if !silent.is_empty() {
        let evidence = format!("a change of {} moves no duty; {flight}", largest(&responses.motion));
        report.find(Fault::Field, silent.join(", "), "it is not used", evidence);
    }
    let right = suspect::direction(airframe, &columns).is_none_or(|direction| direction.is_right());
    let mut explained = right;
    if !right && let Some(found) = suspect::suspect(airframe, responses) {
        columns = found.repaired;
        explained = true;
        report.findings.push(found.suspicion);
        if found.reversed != 0 {
            // These yaw gains belong to rotors that spin the other way.
            return;
        }
    }
    let gains = gains(airframe, &columns);
    if explained && units::cost(airframe, &gains, responses.delay_steps).is_none() {
        report
            .findings
            .extend(units::suspect(airframe, &gains, responses.delay_steps));
    } else if right
        && let Some(turn) = response::turn(airframe, &responses.motion[0], &responses.turned_north, &[1.0; 4])
    {
        heading(turn, flight, report);
    }
}

/// The largest change tried of each value without a response.
fn largest(columns: &[response::Duties; MOTION]) -> String {
    let tried = (0..MOTION).filter(|&i| response::length(&columns[i]) == 0.0).map(|i| {
        let input = Input::Motion(i);
        format!("{} {}", input.sizes()[1], input.unit())
    });
    tried.collect::<Vec<_>>().join(", ")
}

/// Position errors must be rotated into the body frame by the yaw.
fn heading(turn: f64, flight: &str, report: &mut Report) {
    let evidence = format!(
        "at {:.0}° of yaw the answer to a distance is turned by {:.0}°, expected {:.0}°; {flight}",
        TURN_RAD.to_degrees(),
        turn.to_degrees(),
        -TURN_RAD.to_degrees()
    );
    if turn.abs() < 0.5 * TURN_RAD {
        report.find(
            Fault::Frame,
            "position_ned_m",
            "distances are taken as forward and right: they are not turned by the yaw",
            evidence,
        );
    } else if (turn - TURN_RAD).abs() < 0.5 * TURN_RAD {
        report.find(
            Fault::Frame,
            "position_ned_m",
            "distances are turned by the yaw the wrong way round",
            evidence,
        );
    }
}

fn gains(airframe: &Airframe, columns: &[response::Duties; MOTION]) -> units::Gains {
    let mut gains = [[0.0; MOTION]; 4];
    for (input, column) in columns.iter().enumerate() {
        for (axis, value) in airframe.accelerations(column).into_iter().enumerate() {
            gains[axis][input] = value;
        }
    }
    gains
}

/// Physically possible sensor values, far from any hover.
fn extremes(prober: &mut Prober<'_>, base: SensorFrame) -> Result<(), Trouble> {
    let changes: [(usize, f64); 8] = [
        (6, 1.0),
        (7, -1.0),
        (0, 50.0),
        (1, -50.0),
        (2, 50.0),
        (5, 20.0),
        (9, 10.0),
        (11, -10.0),
    ];
    for (motion, change) in changes {
        for sign in [1.0, -1.0] {
            let mut frame = base;
            Input::Motion(motion).add(&mut frame, sign * change);
            prober.exchange(frame)?;
        }
    }
    Ok(())
}

fn answer_times(report: &mut Report, answers: &[Duration], demands: &Demands) {
    let mut sorted: Vec<Duration> = answers.to_vec();
    sorted.sort_unstable();
    let at = |share: f64| {
        let place = (share * sorted.len() as f64) as usize;
        sorted
            .get(place.min(sorted.len().saturating_sub(1)))
            .map_or(0.0, |time| 1e3 * time.as_secs_f64())
    };
    report.answer_ms = [at(0.5), at(0.99)];
    let [median, most] = report.answer_ms;
    let Some(limit) = demands.answer else { return };
    let limit = 1e3 * limit.as_secs_f64();
    let evidence = format!("median {median:.2} ms, 99th percentile {most:.2} ms");
    report.check("response time", median <= limit, evidence.clone());
    if median > limit {
        let sentence =
            format!("half of the answers take longer than {limit} ms: too slow for the pace of the wall clock");
        report.find(Fault::Latency, "MotorCommand", sentence, evidence);
    }
}

/// What a protocol failure says about the controller; `None`: not the controller's fault.
fn blame(error: &LinkError) -> Option<Suspicion> {
    let of_controller = |role: &Role| *role == Role::Controller;
    let (fault, field, sentence) = match error {
        LinkError::ProtocolViolation { role, reason, .. } if of_controller(role) => {
            let (fault, sentence) = protocol_violation(reason);
            (fault, "MotorCommand", sentence)
        }
        LinkError::PeerSilent {
            role,
            last_step,
            unused,
            ..
        } if of_controller(role) => {
            let step = last_step.map_or(0, |step| step + 1);
            match unused {
                Some(reason) => (Fault::MissedStep, "MotorCommand.stamp", reason.clone()),
                None => (Fault::MissedStep, "MotorCommand", format!("no answer to step {step}")),
            }
        }
        LinkError::PeerDied { role, .. } if of_controller(role) => (Fault::Refusal, "process", "it ended".to_owned()),
        LinkError::Refused { role, .. } if of_controller(role) => {
            (Fault::Refusal, "Ready", "it refused to start".to_owned())
        }
        _ => return None,
    };
    Some(Suspicion {
        fault,
        field: field.to_owned(),
        sentence,
        evidence: error.to_string(),
        others: Vec::new(),
    })
}

/// What is wrong with an answer that the link rejected, from the message of its check.
fn protocol_violation(reason: &str) -> (Fault, String) {
    if reason.contains("the plant is only at step") {
        return (Fault::MissedStep, "it answers a step that was not requested".to_owned());
    }
    let value: Option<f64> = reason
        .split(" is ")
        .nth(1)
        .and_then(|rest| rest.split(',').next())
        .and_then(|number| number.parse().ok());
    match value {
        Some(value) if !value.is_finite() => (Fault::NotFinite, "a number is not finite".to_owned()),
        Some(value) if (400.0..=2600.0).contains(&value) => (
            Fault::Unit,
            "duties are pulses in µs, expected fractions from 0 to 1".to_owned(),
        ),
        Some(value) if value > 3.0 && value <= 100.0 => (
            Fault::Unit,
            "duties are percent, expected fractions from 0 to 1".to_owned(),
        ),
        Some(_) => (
            Fault::Field,
            "a duty is out of range: the controller has to limit it to 0 … 1".to_owned(),
        ),
        None => (
            Fault::Field,
            "a field is missing, has a wrong length, or cannot be read".to_owned(),
        ),
    }
}

impl From<SimulationError> for Trouble {
    fn from(error: SimulationError) -> Self {
        Self::Plant(error.to_string())
    }
}
