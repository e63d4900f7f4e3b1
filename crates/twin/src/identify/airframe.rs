//! Which outputs are rotors and where they are; and the list of identified values.

use rotortwin_plant::effects::hover_rotor_speed_rad_s;
use rotortwin_plant::vehicle::model::SpinDirection;
use serde::Serialize;

use super::agreement::Compared;
use super::bench::{About, together};
use super::class::{self, Class};
use super::estimate::Estimate;
use super::excitation::Excitation;
use super::fit::{self, ALPHA, BETA, DELAY, Fitted, GAIN, LAG, SLOPES};
use super::frames::{self, Frame, Place};
use super::grid::{GRAVITY, Grid, moving_outputs};
use super::held_out::{Halves, default_yaw};
use super::plausible::{GYRATION_OVER_ARM, MOMENT_RATIO_OVER_ARM, gyration_over_arm, has_possible_gyration};
use super::slow::Drag;
use super::wiring::{self, Contradiction, Wiring};
use super::yaw::{EXPLAINED, Reaction, Yaw};
use super::{Numbers, Request, slow};
use crate::Z95;
use crate::log::LEAST_TO_CONTRADICT_HZ;
use crate::log::flight_parts::RotorPlace;
use crate::log::{FlightLog, RotorOrder, SensorRate, SourceKind};
use crate::model::constants::Source;

/// Motor outputs slower than this rule out a stated frame only if the motion identifies the right one: that takes 15
/// Hz.
const CONCLUSIVE_DUTY_HZ: f64 = 15.0;

/// The manoeuvre from which the drag could be identified.
const STRAIGHT_RUN: &str = "a straight run at 4 m/s or more, there and back, with velocity in the log";

/// Where the rotors are.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct Airframe {
    /// In words.
    pub name: String,
    /// In the order of the outputs; in units of the arm.
    #[serde(skip)]
    pub places: Vec<Place>,
    /// Where this comes from.
    pub source: Source,
    /// In words.
    pub how: String,
    /// What the motion indicates, if it was evaluated.
    pub motion: Option<Wiring>,
    /// The motion contradicts it, but the user insists: torques computed with this frame do not determine the inertia.
    #[serde(skip)]
    pub against_the_motion: bool,
}

/// Columns that are rotors, in the order of their motor numbers: all that the import took for rotors, otherwise those
/// that move.
pub(crate) fn rotor_outputs(log: &FlightLog) -> Result<Vec<usize>, String> {
    let moving = moving_outputs(log);
    if moving.len() < 4 {
        let found = log.rotor_count();
        return Err(if found > 0 && log.duties().is_empty() {
            format!(
                "{}: expected motor outputs (duty_1 …), the log has rotor speeds alone; a mapping makes outputs of them, with `to = \"duty\"`, \
                 the speeds' columns in `from`, `low = 0` and `high` the motors' highest speed (docs/logs.md)",
                log.name
            )
        } else if found == 0 {
            format!(
                "{}: expected motor outputs (duty_1 …), the log has none: a vehicle cannot be made from it",
                log.name
            )
        } else if found < 4 && moving.len() == found {
            // They all move: a rotor is missing, not the flight.
            let left_out = log.report.unused_columns.iter();
            let left_out: Vec<String> = left_out
                .filter(|unused| unused.column.starts_with("outputs "))
                .map(|unused| format!("; {} left out ({})", unused.column, unused.reason))
                .collect();
            format!(
                "{}: expected at least 4 rotors, the log has {found}{}: a mapping with 'order' names the outputs that are rotors",
                log.name,
                left_out.concat()
            )
        } else {
            format!(
                "{}: expected at least 4 outputs that move, {} of {found} do: no flight in this log",
                log.name,
                moving.len()
            )
        });
    }
    if log.report.rotor_outputs.is_empty() {
        return Ok(moving);
    }
    Ok((1..=log.report.rotor_outputs.len()).collect())
}

/// Frame, places of the motors in their order, and the evidence, as far as the log's parameters or its format state
/// them.
pub(crate) fn stated_places(log: &FlightLog) -> Option<(String, Vec<Place>, String)> {
    let nothing_entered = Request {
        mass_kg: 0.0,
        arm_m: 0.0,
        frame: None,
        trust_frame: false,
        capacity_ah: None,
        cells: None,
    };
    let (name, places, _, how) = stated_airframe(log, &nothing_entered).ok().flatten()?;
    Some((name, places, how))
}

/// Where the rotors are, as far as the log's parameters or its format state it; the motion is not used.
pub fn known_rotor_places(log: &FlightLog) -> Option<Vec<RotorPlace>> {
    let (_, places, _) = stated_places(log)?;
    let outputs = rotor_outputs(log).ok()?;
    (outputs.len() == places.len()).then(|| {
        outputs
            .into_iter()
            .zip(places)
            .map(|(output, place)| RotorPlace {
                output,
                position: place.position,
            })
            .collect()
    })
}

/// The frame: named, from parameters, of a known platform, or from the motion.
pub(crate) fn find(log: &FlightLog, grids: &[Grid], request: &Request, class: &Class) -> Result<Airframe, String> {
    let rotors = grids[0].duty.len();
    let motion = wiring::search(grids, class);
    let stated = stated_airframe(log, request)?;
    if let Some((name, places, source, how)) = stated {
        if places.len() != rotors {
            return Err(format!(
                "{}: the frame {name} ({how}) has {} rotors, {rotors} outputs move (outputs {}); where some of these are no motors, `order` of a mapping says which are",
                log.name,
                places.len(),
                grids[0]
                    .outputs
                    .iter()
                    .map(usize::to_string)
                    .collect::<Vec<_>>()
                    .join(", ")
            ));
        }
        let stated_against = motion.as_ref().map(|motion| (motion, motion.against(&places)));
        let against_the_motion = matches!(stated_against, Some((_, Some(_))));
        // Between two samples a controller moves its motors up and down again: the logged commands may be in antiphase
        // with the motion that they damp.
        let rate = log.duty_rate().filter(SensorRate::is_slower).map(|rate| rate.source_hz);
        let unsure = motion.as_ref().is_some_and(|motion| motion.best.doubt().is_some());
        let too_slow_hz = rate.filter(|hz| {
            *hz < if unsure {
                CONCLUSIVE_DUTY_HZ
            } else {
                LEAST_TO_CONTRADICT_HZ
            }
        });
        let how = match stated_against {
            None => how,
            Some((motion, None)) if motion.best.doubt().is_some() => how,
            Some((_, None)) => format!("{how}; the motion agrees"),
            Some((motion, Some(contradiction))) => {
                let against = against(&name, &how, &motion.best, &contradiction);
                if let Some(hz) = too_slow_hz {
                    return Ok(Airframe {
                        how: format!("{how}; motor outputs at {hz:.1} Hz are too slow for the motion to confirm it"),
                        name,
                        places,
                        source,
                        motion: Some(motion.best.clone()),
                        against_the_motion: true,
                    });
                }
                if !request.trust_frame {
                    let else_do = if source == Source::Entered {
                        "leave --frame out"
                    } else {
                        "name the right one with --frame"
                    };
                    return Err(format!(
                        "{}: {against}; {else_do}, put the outputs in order, or insist with --trust-frame",
                        log.name
                    ));
                }
                format!("{how}; TRUSTED AGAINST THE MOTION: {against}")
            }
        };
        return Ok(Airframe {
            name,
            places,
            source,
            how,
            motion: motion.map(|motion| motion.best),
            against_the_motion,
        });
    }
    if let Some(found) = betaflight(log, rotors, motion.as_ref()) {
        return Ok(found);
    }
    let Some(motion) = motion.map(|motion| motion.best) else {
        return Err(format!(
            "{}: the motor order is unknown: no parameter says it, and without body rates (or with {rotors} rotors) the motion cannot; \
             name the frame with --frame ({})",
            log.name,
            frame_names()
        ));
    };
    if let Some(doubt) = motion.doubt() {
        return Err(format!(
            "{}: the motor order is unknown: no parameter says it, and the motion does not either ({doubt}); name the frame with --frame ({}), \
             or fly 20 s with roll, pitch and yaw steps",
            log.name,
            frame_names()
        ));
    }
    let how = format!(
        "of {} orders this explains the motion best: score {:.2}, next {:.2}; correlation of roll {:.2}, pitch {:.2}, yaw {:.2} over {:.0} s",
        motion.tried,
        motion.score,
        motion.score - motion.margin,
        motion.correlation[0],
        motion.correlation[1],
        motion.correlation[2],
        motion.seconds
    );
    Ok(Airframe {
        name: format!("{rotors} rotors, {}", motion.layout),
        places: motion.places.clone(),
        source: Source::Log,
        how,
        motion: Some(motion),
        against_the_motion: false,
    })
}

/// The quadrotor of Betaflight and INAV, whose logs number motors by the mixer, not by the connectors; the motion
/// decides which way they turn, as both directions are in use. `None` if the motion contradicts both, or the log is
/// from another autopilot.
fn betaflight(log: &FlightLog, rotors: usize, motion: Option<&wiring::Motion>) -> Option<Airframe> {
    if log.source.kind != SourceKind::Blackbox || rotors != 4 || log.report.rotor_order != RotorOrder::Logged {
        return None;
    }
    let frames =
        ["quad-betaflight-x", "quad-betaflight-x-reversed"].map(|name| Frame::named(name).expect("in the table"));
    let scores = frames.map(|frame| motion.map_or(0.0, |motion| motion.score_of(&frame.places())));
    let frame = frames[usize::from(scores[1] > scores[0])];
    let places = frame.places();
    let doubt = motion.and_then(|motion| motion.best.doubt());
    if motion.is_some_and(|motion| motion.against(&places).is_some()) {
        return None;
    }
    let how = match (motion, doubt) {
        (Some(_), None) => "Betaflight's order of motors; the motion agrees, also with the way they turn".to_owned(),
        (Some(_), Some(_)) => format!(
            "Betaflight's order of motors; the motion does not clearly show which way they turn, {} is assumed: --frame selects the other",
            if frame.name == frames[0].name {
                "the usual one"
            } else {
                "what fits better"
            }
        ),
        (None, _) => {
            "Betaflight's order of motors; without body rates the motion does not show which way they turn".to_owned()
        }
    };
    Some(Airframe {
        name: frame.name.to_owned(),
        places,
        source: Source::Assumed,
        how,
        motion: motion.map(|motion| motion.best.clone()),
        against_the_motion: false,
    })
}

/// Why a stated frame is rejected, with the evidence.
fn against(name: &str, how: &str, best: &Wiring, stated: &Contradiction) -> String {
    let three = |[roll, pitch, yaw]: [f64; 3]| format!("{roll:.2}, {pitch:.2}, {yaw:.2}");
    let other = match (best.doubt(), Frame::of_places(&best.places)) {
        (None, Some(frame)) => format!("that of {}", frame.name),
        (None, None) => format!("another one ({})", listed(&best.places)),
        (Some(_), _) => "another one".to_owned(),
    };
    format!(
        "the frame {name} ({how}) contradicts the motion: over {:.0} s in the air its torques correlate with the angular acceleration by {} \
         in roll, pitch, yaw (score {:.2}), those of the best order, {other}, by {} (score {:.2})",
        best.seconds,
        three(stated.correlation),
        stated.score,
        three(best.correlation),
        best.score
    )
}

/// Where the rotor of each output is: degrees from the nose, clockwise from above.
fn listed(places: &[Place]) -> String {
    let one = |(i, place): (usize, &Place)| {
        let degrees = place.position[1].atan2(place.position[0]).to_degrees();
        let spin = if place.spin == SpinDirection::Ccw { "ccw" } else { "cw" };
        format!("output {} at {degrees:.0}° {spin}", i + 1)
    };
    places.iter().enumerate().map(one).collect::<Vec<_>>().join(", ")
}

fn frame_names() -> String {
    frames::FRAMES
        .iter()
        .map(|frame| frame.name)
        .collect::<Vec<_>>()
        .join(", ")
}

type StatedAirframe = (String, Vec<Place>, Source, String);

fn stated_airframe(log: &FlightLog, request: &Request) -> Result<Option<StatedAirframe>, String> {
    let of = |frame: &Frame, source, how: String| Some((frame.name.to_owned(), frame.places(), source, how));
    if let Some(name) = &request.frame {
        let frame = Frame::named(name).ok_or_else(|| format!("--frame {name}: expected one of {}", frame_names()))?;
        return Ok(of(frame, Source::Entered, "--frame".to_owned()));
    }
    if log.report.rotor_order != RotorOrder::Logged {
        // The columns do not have the numbers that the parameters use.
        return Ok(None);
    }
    if let Some((places, arm)) = frames::of_px4_allocation(&log.parameters) {
        let how = format!("CA_ROTORn_PX, _PY, _KM (their longest arm: {arm:.3} m)");
        return Ok(Some(("control allocation".to_owned(), places, Source::Parameter, how)));
    }
    if log.source.kind != SourceKind::Px4Ulog
        && let Some(frame) = Frame::of_ardupilot(&log.parameters).map_err(|reason| format!("{}: {reason}", log.name))?
    {
        return Ok(of(frame, Source::Parameter, "FRAME_CLASS, FRAME_TYPE".to_owned()));
    }
    if log.source.kind != SourceKind::Px4Ulog
        && let Some(rotors) = rotor_outputs(log).ok().map(|outputs| outputs.len())
        && let Some(frame) = Frame::of_old_ardupilot(&log.parameters, rotors)
    {
        return Ok(of(frame, Source::Parameter, "FRAME".to_owned()));
    }
    if let Some(frame) = Frame::of_px4_airframe(&log.parameters) {
        let airframe = log.parameters.get("SYS_AUTOSTART").copied().unwrap_or_default();
        return Ok(of(frame, Source::Parameter, format!("SYS_AUTOSTART {airframe}")));
    }
    if log.source.kind == SourceKind::CrazyflieUsdlog {
        let frame = Frame::named("quad-cw-x").expect("in the table");
        return Ok(of(
            frame,
            Source::Parameter,
            "Crazyflie, by the format of the log: M1 front right, then clockwise".to_owned(),
        ));
    }
    Ok(None)
}

/// Everything that the values are derived from.
pub(crate) struct Findings<'a> {
    pub(crate) request: &'a Request,
    pub(crate) class: Class,
    pub(crate) grids: &'a [Grid],
    pub(crate) logs: &'a [FlightLog],
    pub(crate) fitted: &'a Fitted,
    pub(crate) yaw: Option<Yaw>,
    /// The estimates from each half of the flights, if they are long enough.
    pub(crate) halves: Option<&'a Halves>,
    pub(crate) voltage_slope: (f64, f64, Source),
    pub(crate) has_voltage: bool,
    pub(crate) rotors: usize,
    /// [`Airframe::against_the_motion`]
    pub(crate) against_the_motion: bool,
    pub(crate) excitation: Excitation,
    /// Bench results, if they are of this rotor and do not contradict the flight.
    pub(crate) bench: Option<&'a About>,
    /// n that the flight indicates but no propeller has; the curve is then the class's.
    pub(crate) impossible_slope: Option<f64>,
}

/// Deviation of the logarithm of the thrust level if the accelerometer is correct: scale error of an ordinary one.
const LEVEL_LOG_DEVIATION: f64 = 0.01;
/// … without one, if the attitude tells how far the thrust leans from the weight that it carries on average: a flight
/// that ends lower or slower than it began; and without either: 30° of lean.
const LEVEL_BY_ATTITUDE: f64 = 0.05;
const LEVEL_BY_WEIGHT: f64 = 0.15;
/// Deviation of the centre of mass over the arm.
const CENTRE_DEVIATION: f64 = 0.01;
/// Deviation of a healthy rotor's thrust: seven healthy flights of CrazyPAD.
const EVENNESS_DEVIATION: f64 = 0.03;

/// Deviation of the thrust at full duty, relative, if the curve only extrapolates.
const TOP_DEVIATION: f64 = 0.05;
/// Deviation of a dead zone, duty.
const DEAD_ZONE_DEVIATION: f64 = 0.01;

/// The drag of climbs must surely be below this share of the drag along the body for the difference to be attributed to
/// the rotors. A thrust curve fitted to the same flight can absorb half of a drag that acts along all axes.
const MOST_CLIMB_DRAG_SHARE: f64 = 0.3;

/// Deviation of ln c/Jz above which the flight is not informative about it.
const YAW_LOG_DEVIATION: f64 = 1.0;

/// Source of a value, by how much the log narrows the prior's deviation.
fn whose(data: f64, prior: f64) -> Source {
    if data < 0.5 * prior {
        Source::Log
    } else if data < 2.0 * prior {
        Source::LogAndClass
    } else {
        Source::Class
    }
}

/// The same for a value with the class as a prior: if the log moved it, or made it more certain than the class, it is
/// not a class default, even if the log alone, without what the class says about the other values, leaves it open.
///
/// * `data`: deviation by the log alone · `posterior`: with the class included · `prior`: the class's · `moved`: how
///   far the value is from the class's, in the class's deviations
fn whose_in_all(data: f64, (posterior, prior): (f64, f64), moved: f64) -> Source {
    /// Posterior over prior deviation of a value whose log is twice as uncertain as the class.
    const NARROWED_RATIO: f64 = 0.894;
    const MOVED: f64 = 0.5;
    match whose(data, prior) {
        Source::Class if posterior < NARROWED_RATIO * prior || moved.abs() > MOVED => Source::LogAndClass,
        source => source,
    }
}

/// Deviation and source of a value whose channel may not be excited: it is then known no better than from its class.
fn as_far_as_excited(excited: bool, (data, class): (f64, f64), source: Source) -> (f64, Source) {
    match (excited, source) {
        (true, _) | (false, Source::Class) => (data, source),
        (false, _) => (data.max(class), Source::LogAndClass),
    }
}

impl Findings<'_> {
    /// The numbers of the document and the list of values, in the order of the document.
    pub(crate) fn values(&self, notes: &mut Vec<String>) -> (Numbers, Vec<Estimate>) {
        let mut values = vec![
            Estimate::normal("body.mass_kg", "mass", "kg", self.request.mass_kg, 0.0, Source::Entered)
                .how("every force scales with it"),
            Estimate::normal("arm", "arm", "m", self.request.arm_m, 0.0, Source::Entered)
                .how("every inertia scales with it"),
        ];
        let otherwise = self.turns_otherwise();
        let is_its_frame = !self.against_the_motion && otherwise.is_none();
        notes.extend(otherwise);
        let inertia = self.inertia(is_its_frame, &mut values, notes);
        let (moment_ratio, yaw_inertia, reaction_s) = self.yaw(is_its_frame, inertia, &mut values, notes);
        let (drag, rotor_drag) = self.drag(&mut values, notes);
        self.thrust(&mut values, notes);
        let battery = self.battery(&mut values);
        self.assumed(&mut values, battery.1, battery.4);
        let scale = self.grids.iter().find_map(|grid| grid.accel_scale);
        if let Some(scale) = scale {
            values.push(
                Estimate::normal(
                    "accelerometer.scale",
                    "accelerometer at rest over gravity",
                    "",
                    scale,
                    0.002,
                    Source::Log,
                )
                .how("mean specific force before take-off; readings were divided by it"),
            );
        } else if !self.grids[0].accel_from_estimator {
            notes.push(
                "no rest before take-off: the accelerometer's scale is not checked (5 s of standing still would do)"
                    .to_owned(),
            );
        }
        let fitted = self.fitted;
        let numbers = Numbers {
            curve: fitted.curve,
            lag_s: (fitted.lag_s + fitted.delay_s).clamp(0.005, 1.0),
            inertia: [inertia[0].0, inertia[1].0, yaw_inertia],
            moment_ratio,
            reaction_s,
            drag: drag * self.request.mass_kg,
            rotor_drag: rotor_drag * self.request.mass_kg,
            voltage: battery.1,
            voltage_slope: self.voltage_slope.0,
            cells: battery.0,
            capacity: battery.2,
            resistance: battery.3,
            power_coefficient: battery.4,
        };
        (numbers, values)
    }

    /// A value and its deviation from the first and from the second half of the flights, if both excite it.
    fn by_halves(
        &self,
        value: impl Fn(&Fitted) -> (f64, f64),
        excited: impl Fn(&Excitation) -> bool,
    ) -> Option<[(f64, f64); 2]> {
        let halves = self.halves.filter(|halves| halves.excitation.iter().all(excited))?;
        Some(halves.fitted.each_ref().map(value))
    }

    /// Whether rotors at these places would turn the vehicle far more than it turns, with its own constants and with
    /// those of the class. Checked for six or more rotors, whose orders were not searched with the motion or may be
    /// none of those searched; not for outputs at a low rate, which have no phase relation with the motion (R² of a
    /// right frame down to −20 at 10 Hz).
    fn turns_otherwise(&self) -> Option<String> {
        /// R² of a torque that is unrelated to the motion and 1.4 times its size.
        const NOTHING: f64 = -1.0;
        let is_slow = |log: &FlightLog| {
            let rate = log.duty_rate().filter(SensorRate::is_slower);
            rate.is_some_and(|rate| rate.source_hz < CONCLUSIVE_DUTY_HZ)
        };
        if self.rotors < 6 || self.logs.iter().any(is_slow) {
            return None;
        }
        let scores = [0, 1].map(|axis| self.halves.and_then(|halves| halves.acceleration(axis)));
        let told = scores.into_iter().flatten();
        let wrong: Vec<String> = told
            .filter(|score| score.calibrated.max(score.class_default) < NOTHING)
            .map(|score| format!("{} R² {:.1}", score.channel, score.calibrated.max(score.class_default)))
            .collect();
        (!wrong.is_empty()).then(|| {
            format!(
                "the motion is not that of rotors at these places ({} on seconds that were not fitted): check the frame and the order of the outputs",
                wrong.join(", ")
            )
        })
    }

    /// Jx, Jy and the deviations of their logarithms; `is_its_frame`: the motion does not contradict the frame.
    fn inertia(&self, is_its_frame: bool, values: &mut Vec<Estimate>, notes: &mut Vec<String>) -> [(f64, f64); 2] {
        let (mass, arm) = (self.request.mass_kg, self.request.arm_m);
        let fitted = self.fitted;
        let of_class = |axis: usize, why: String| {
            let value = self.class.inertia_ratio[axis] * mass * arm * arm;
            (value, class::INERTIA_LOG_DEVIATION, Source::Class, why)
        };
        [0, 1].map(|axis| {
            let (key, name) = [
                ("body.inertia_body_kg_m2[0]", "inertia, roll"),
                ("body.inertia_body_kg_m2[1]", "inertia, pitch"),
            ][axis];
            // α = gain · (lever in arms) · T/m, hence J = m l/gain.
            let flown = mass * arm / fitted.gain[axis];
            let i = GAIN[axis];
            let of_its_class = self.class.inertia_ratio[axis] * mass * arm * arm;
            let source = whose_in_all(
                fitted.data_deviation[i],
                (fitted.covariance[(i, i)].sqrt(), class::INERTIA_LOG_DEVIATION),
                (flown / of_its_class).ln() / class::INERTIA_LOG_DEVIATION,
            );
            let gyration = gyration_over_arm(fitted.gain[axis], arm);
            let uneven = if fitted.uneven[i] {
                "; parts of the flight differ, and the interval covers them"
            } else {
                ""
            };
            let (value, deviation, source, how) = if !is_its_frame {
                of_class(axis, "the motion contradicts the frame, so its torques determine no inertia".to_owned())
            } else if !has_possible_gyration(fitted.gain[axis], arm) {
                let impossible = format!(
                    "the flight indicates {flown:.3e} kg·m², a radius of gyration of {gyration:.2} arms, which is impossible for {mass} kg on arms of {arm} m \
                     (possible: {} to {} arms)",
                    GYRATION_OVER_ARM.start(),
                    GYRATION_OVER_ARM.end()
                );
                notes.push(format!(
                    "{name}: {impossible}; the class default is written: check mass, arm, frame and the order of the outputs before all else"
                ));
                of_class(axis, impossible)
            } else if source == Source::Class {
                let ratio = self.class.inertia_ratio[axis];
                of_class(axis, format!("{ratio:.2} m l²: not determined by the flight"))
            } else {
                let how = format!(
                    "prediction error over {} parts, {:.3} m l²{uneven}",
                    fitted.parts,
                    flown / (mass * arm * arm)
                );
                let (deviation, source) = as_far_as_excited(
                    self.excitation.rate[axis],
                    (fitted.covariance[(i, i)].sqrt(), class::INERTIA_LOG_DEVIATION),
                    source,
                );
                let halves = self.by_halves(
                    |half| ((mass * arm / half.gain[axis]).ln(), half.covariance[(i, i)].sqrt()),
                    |excitation| excitation.rate[axis],
                );
                let cannot_be = |value: &f64| !has_possible_gyration(mass * arm / value.exp(), arm);
                let compared = Compared {
                    name,
                    impossible: halves.iter().flatten().map(|(value, _)| *value).find(cannot_be),
                    whole: flown.ln(),
                    class: of_its_class.ln(),
                    halves,
                    score: self.halves.and_then(|halves| halves.acceleration(axis)),
                    shown: &|logarithm| format!("{:.3e} kg·m²", logarithm.exp()),
                };
                let (deviation, source) = compared.checked((deviation, source), notes);
                (flown, deviation, source, how)
            };
            let mut estimate = Estimate::log_normal(key, name, "kg·m²", value, deviation, source);
            if source == Source::Class {
                // Towers of stacked rotors and batteries exceed every flat vehicle of the class: a published X8 has
                // 0.78 arms.
                estimate.high = estimate.high.max(mass * (GYRATION_OVER_ARM.end() * arm).powi(2));
            }
            values.push(
                estimate
                    .how(how)
                    .better("20 s of roll and pitch doublets, logged at 200 Hz or more"),
            );
            (value, deviation)
        })
    }

    /// c, Jz and λ.
    fn yaw(
        &self,
        is_its_frame: bool,
        inertia: [(f64, f64); 2],
        values: &mut Vec<Estimate>,
        notes: &mut Vec<String>,
    ) -> (f64, f64, f64) {
        let (mass, arm) = (self.request.mass_kg, self.request.arm_m);
        let share = class::YAW_INERTIA_SHARE;
        let sum = inertia[0].0 + inertia[1].0;
        let inertia_variance = inertia
            .iter()
            .map(|(value, deviation)| (deviation * value / sum).powi(2))
            .sum::<f64>()
            + class::YAW_INERTIA_LOG_DEVIATION.powi(2);
        let on_the_bench = self.bench.and_then(|bench| bench.moment_ratio);
        let (ratio_before, deviation_before) =
            on_the_bench.unwrap_or((self.class.moment_ratio_m, class::MOMENT_LOG_DEVIATION));
        let (mut log_inertia, mut log_ratio) = ((share * sum).ln(), ratio_before.ln());
        let (mut inertia_deviation, mut ratio_deviation) = (inertia_variance.sqrt(), deviation_before);
        let mut ratio_source = if on_the_bench.is_some() {
            Source::Bench
        } else {
            Source::Class
        };
        let counts = self.excitation.rate[2] && is_its_frame;
        let told = self.yaw.filter(|_| counts).filter(|yaw| {
            let ratio = yaw.gain / mass * share * sum;
            let possible = MOMENT_RATIO_OVER_ARM.contains(&(ratio / arm));
            if !possible {
                notes.push(format!(
                    "yaw: the flight indicates a torque over thrust of {ratio:.2e} m, {:.3} arms, which is impossible for propellers on these arms ({} to {} \
                     arms): the class default is written",
                    ratio / arm,
                    MOMENT_RATIO_OVER_ARM.start(),
                    MOMENT_RATIO_OVER_ARM.end()
                ));
            }
            possible
        });
        // Known within a factor of seven either way: not at all.
        let told = told.filter(|yaw| {
            let determined = yaw.deviation < YAW_LOG_DEVIATION;
            if !determined {
                notes.push(
                    "yaw: c/Jz is not determined by the flight (parts of it differ by more than its size): the class default is written"
                        .to_owned(),
                );
            }
            determined
        });
        let believed = told.is_some_and(|yaw| yaw.explained >= EXPLAINED);
        let told = told.map(|yaw| self.yaw_by_halves(yaw, notes));
        let yaw_source = match told {
            Some(yaw) if believed && yaw.deviation < 0.5 * class::MOMENT_LOG_DEVIATION => Source::Log,
            _ => Source::LogAndClass,
        };
        if let Some(yaw) = told {
            if !believed {
                notes.push(format!(
                    "yaw: what the rotors do explains {:.0} % of the yaw acceleration ({} to {} Hz), and {:.0} % are needed: torque over thrust and the torque of \
                     rotor acceleration are known no better than by the class",
                    100.0 * yaw.explained.max(0.0),
                    yaw.band.low_hz,
                    yaw.band.high_hz,
                    100.0 * EXPLAINED
                ));
            }
            // ln c − ln Jz is measured; both have priors.
            let measured = (yaw.gain / mass).ln();
            let noise = yaw.deviation.powi(2);
            let (mut vc, vj) = (deviation_before.powi(2), inertia_variance);
            let apart = (measured - (log_ratio - log_inertia)).abs() / (vc + vj + noise).sqrt();
            if on_the_bench.is_some() && apart > 3.0 {
                notes.push(format!(
                    "torque over thrust is {ratio_before:.4} m on the bench, and c/Jz of the flight with the inertia is {apart:.0} deviations from it: not averaged, the flight's is \
                     taken"
                ));
                ratio_source = Source::Class;
                log_ratio = self.class.moment_ratio_m.ln();
                vc = class::MOMENT_LOG_DEVIATION.powi(2);
            }
            let innovation = measured - (log_ratio - log_inertia);
            let total = vc + vj + noise;
            log_ratio += vc / total * innovation;
            log_inertia -= vj / total * innovation;
            ratio_deviation = (vc - vc * vc / total).sqrt();
            inertia_deviation = (vj - vj * vj / total).sqrt();
            if ratio_source != Source::Bench {
                ratio_source = whose((vj + noise).sqrt(), class::MOMENT_LOG_DEVIATION);
            }
            values.push(
                Estimate::log_normal(
                    "yaw.moment_ratio_over_inertia",
                    "c/Jz",
                    "1/(kg·m)",
                    yaw.gain / mass,
                    yaw.deviation,
                    yaw_source,
                )
                .how("all that yaw determines; c and Jz cannot be separated"),
            );
        }
        // Physics: no moment of inertia exceeds the sum of the others.
        let yaw_inertia = log_inertia
            .exp()
            .min(0.999 * sum)
            .max(1.001 * (inertia[0].0 - inertia[1].0).abs());
        // Jx + Jy above the class value may come from height, which adds nothing to Jz: a published X8 has 0.36 (Jx +
        // Jy).
        let of_its_class = share * self.class.inertia_ratio.iter().sum::<f64>() * mass * arm * arm;
        let least_inertia = (yaw_inertia / (Z95 * inertia_deviation).exp()).min(of_its_class);
        let flat = Estimate::log_normal(
            "body.inertia_body_kg_m2[2]",
            "inertia, yaw",
            "kg·m²",
            yaw_inertia,
            inertia_deviation,
            Source::LogAndClass,
        );
        values.push(
            Estimate {
                low: least_inertia,
                ..flat
            }
            .how(format!("{share} (Jx + Jy), as flat bodies have"))
            .better("a bifilar pendulum"),
        );
        let ratio = log_ratio.exp();
        let reaction_s = self.reaction(
            told.map(|yaw| (yaw.reaction, yaw_source)),
            (ratio, inertia_deviation),
            values,
        );
        let moment = Estimate::log_normal(
            "rotors.moment_ratio_m",
            "torque over thrust, c",
            "m",
            ratio,
            ratio_deviation,
            ratio_source,
        );
        // The flight determines c/Jz: if Jz may be smaller, so may c.
        let least = if told.is_some() && ratio_source != Source::Bench {
            moment.low.min(ratio * least_inertia / yaw_inertia)
        } else {
            moment.low
        };
        values.push(
            Estimate { low: least, ..moment }
                .how(match (ratio_source, told.is_some()) {
                    (Source::Bench, true) => {
                        "torque over thrust of the bench, and c/Jz of the flight, by their variances"
                    }
                    (Source::Bench, false) => "torque over thrust of the bench",
                    (Source::Class, _) => "not determined by the flight",
                    _ => "c/Jz of the flight times Jz",
                })
                .better("10 s of yaw steps; a thrust stand with torque"),
        );
        (ratio, yaw_inertia, reaction_s)
    }

    /// c/Jz with a deviation that its halves, and the class, do not contradict.
    fn yaw_by_halves(&self, yaw: Yaw, notes: &mut Vec<String>) -> Yaw {
        let Some(halves) = self.halves else { return yaw };
        let both = match halves.yaw {
            [Some(first), Some(second)] if halves.excitation.iter().all(|e| e.rate[2]) => {
                let believed = [first, second].iter().all(|half| half.explained >= EXPLAINED);
                believed.then(|| [first, second].map(|half| (half.gain.ln(), half.deviation)))
            }
            _ => None,
        };
        let mass = self.request.mass_kg;
        let compared = Compared {
            name: "c/Jz",
            whole: yaw.gain.ln(),
            class: default_yaw(&self.class, self.request.arm_m).ln(),
            halves: both,
            impossible: None,
            score: halves.acceleration(2),
            shown: &|logarithm| format!("{:.3}/(kg·m)", logarithm.exp() / mass),
        };
        let (deviation, _) = compared.checked((yaw.deviation, Source::Log), notes);
        Yaw { deviation, ..yaw }
    }

    /// λ of the document, s; listed together with the inertia of a rotor that it corresponds to at hover. Needs c, m,
    /// and the deviation of ln Jz.
    ///
    /// J_r = 2 c λ f_h/Ω_h. The flight determines c λ/Jz, so that J_r is as good as Jz, whatever c is; Ω_h is that of a
    /// rotor of this thrust at the tip speed of the F550's ([`hover_rotor_speed_rad_s`]), because no log here contains
    /// it.
    fn reaction(
        &self,
        reaction: Option<(Reaction, Source)>,
        (moment_ratio, inertia_deviation): (f64, f64),
        values: &mut Vec<Estimate>,
    ) -> f64 {
        const NAME: &str = "yaw torque of rotor acceleration, λ";
        const INERTIA: &str = "inertia of a rotor, J_r";
        const YAW_STEPS: &str = "10 s of yaw steps";
        let hover_n = self.request.mass_kg * GRAVITY / self.rotors as f64;
        let hover_speed = hover_rotor_speed_rad_s(hover_n);
        let inertia = |reaction_s: f64| 2.0 * moment_ratio * reaction_s * hover_n / hover_speed;
        let (reaction, source) = reaction.unwrap_or((Reaction::Unknown, Source::Class));
        let (reaction_s, inertia_of_a_rotor) = match reaction {
            Reaction::Seen {
                value_s,
                deviation_s,
                product_deviation,
            } => {
                let source = if deviation_s < 0.5 * class::REACTION_MOST_S {
                    source
                } else {
                    Source::LogAndClass
                };
                let seen = Estimate::normal("rotors.reaction_s", NAME, "s", value_s, deviation_s, source);
                (
                    Estimate {
                        low: seen.low.max(0.0),
                        ..seen
                    }
                    .how("Jz ṙ = c (X + λ Ẋ); it lowers the error of every other part of the flight that it was not fitted to"),
                    Estimate::log_normal(
                        "rotors.inertia_kg_m2",
                        INERTIA,
                        "kg·m²",
                        inertia(value_s),
                        product_deviation.hypot(inertia_deviation),
                        source,
                    ),
                )
            }
            Reaction::Below(_) | Reaction::Unknown => {
                let (most_s, source, how) = match reaction {
                    Reaction::Below(most_s) => (most_s, Source::Log, "none shows, and more than this would have"),
                    _ => (
                        class::REACTION_MOST_S,
                        Source::Class,
                        "unknown: not determined by this flight; vehicles have up to 0.2 s",
                    ),
                };
                let none = |key, name, unit, most| {
                    let none = Estimate::normal(key, name, unit, 0.0, 0.0, source);
                    Estimate { high: most, ..none }
                };
                (
                    none("rotors.reaction_s", NAME, "s", most_s).how(how),
                    none("rotors.inertia_kg_m2", INERTIA, "kg·m²", inertia(most_s)),
                )
            }
        };
        let value_s = reaction_s.value;
        values.push(reaction_s.better(YAW_STEPS));
        values.push(
            inertia_of_a_rotor
                .how("2 c λ f_h/Ω_h: the meaning of λ, with Ω_h by size; the document has λ")
                .better(YAW_STEPS),
        );
        value_s
    }

    /// k/m of the body, along all axes, and k_d/m of the rotors, across theirs, 1/s.
    fn drag(&self, values: &mut Vec<Estimate>, notes: &mut Vec<String>) -> (f64, f64) {
        let mass = self.request.mass_kg;
        let one = match slow::drag(self.grids) {
            Drag::Measured(k, deviation) => {
                if let Some((up, up_deviation)) = slow::drag_in_climbs(self.grids, &self.fitted.curve)
                    && up + Z95 * up_deviation < MOST_CLIMB_DRAG_SHARE * k
                {
                    let body = up.max(0.0);
                    let estimate = |key, name, value: f64, deviation: f64| {
                        let normal = Estimate::normal(key, name, "kg/s", value * mass, deviation * mass, Source::Log);
                        Estimate {
                            low: normal.low.max(0.0),
                            ..normal
                        }
                    };
                    values.push(
                        estimate("body.linear_drag_kg_s", "drag, k", body, up_deviation)
                            .how(format!("lift over the speed of climb, below 1 Hz; k/m = {up:.3} 1/s")),
                    );
                    values.push(
                        estimate(
                            "rotors.drag_kg_s",
                            "drag of the rotors, k_d",
                            k - body,
                            deviation.hypot(up_deviation),
                        )
                        .how(format!(
                            "force along the body over speed, below 1 Hz, of {k:.3} 1/s, less that"
                        )),
                    );
                    return (body, k - body);
                }
                values.push(
                    Estimate::normal(
                        "body.linear_drag_kg_s",
                        "drag, k",
                        "kg/s",
                        k * mass,
                        deviation * mass,
                        Source::Log,
                    )
                    .how(format!("force along the body over speed, below 1 Hz; k/m = {k:.3} 1/s")),
                );
                k
            }
            Drag::Weak(k, deviation, reason) if k.max(0.0) + Z95 * deviation < self.class.drag_per_s => {
                let (value, most) = (k.max(0.0), k.max(0.0) + Z95 * deviation);
                notes.push(format!(
                    "drag is less than that of its class: {reason}, and k/m is below {most:.3} 1/s, where the class has {:.3} 1/s",
                    self.class.drag_per_s
                ));
                let estimate = Estimate::normal(
                    "body.linear_drag_kg_s",
                    "drag, k",
                    "kg/s",
                    value * mass,
                    deviation * mass,
                    Source::Log,
                );
                values.push(
                    Estimate {
                        low: estimate.low.max(0.0),
                        ..estimate
                    }
                    .how(format!("{reason}: an upper bound; k/m is below {most:.3} 1/s"))
                    .better(STRAIGHT_RUN),
                );
                value
            }
            Drag::Weak(_, _, reason) | Drag::Untold(reason) => {
                notes.push(format!(
                    "drag is not determined: {reason}; the class default is written"
                ));
                let k = self.class.drag_per_s;
                values.push(
                    Estimate::log_normal(
                        "body.linear_drag_kg_s",
                        "drag, k",
                        "kg/s",
                        k * mass,
                        class::DRAG_LOG_DEVIATION,
                        Source::Class,
                    )
                    .how(reason)
                    .better(STRAIGHT_RUN),
                );
                k
            }
        };
        (one, 0.0)
    }

    fn thrust(&self, values: &mut Vec<Estimate>, notes: &mut Vec<String>) {
        let fitted = self.fitted;
        let curve = &fitted.curve;
        let covariance = &fitted.covariance;
        let measured = self.grids.iter().all(|grid| grid.accel[2].is_some());
        values.push(
            Estimate::normal(
                "rotors.hover_duty",
                "mean duty in the air",
                "",
                curve.hover_duty,
                0.0,
                Source::Log,
            )
            .how(format!(
                "carries {:.3} N of each rotor",
                curve.hover * self.request.mass_kg
            )),
        );
        let level = slow::level_over_gravity(curve, self.rotors);
        if measured && (level - 1.0).abs() > 0.05 {
            notes.push(format!(
                "the mean specific force in the air is {level:.3} g: the accelerometer's scale is off by that, or the flight climbs and turns"
            ));
        }
        let slope_of = |fitted: &Fitted| {
            let c = &fitted.covariance;
            let variance = c[(ALPHA, ALPHA)] + 0.25 * c[(BETA, BETA)] - c[(ALPHA, BETA)];
            (fitted.curve.slope(), variance.max(0.0).sqrt())
        };
        let slope_variance = slope_of(fitted).1.powi(2);
        let slope_source = whose_in_all(
            fitted.data_deviation[ALPHA]
                .hypot(0.5 * fitted.data_deviation[BETA])
                .min(slope_variance.sqrt() * 2.0),
            (slope_variance.sqrt(), class::SLOPE_DEVIATION),
            (curve.slope() - self.class.slope) / class::SLOPE_DEVIATION,
        );
        let (slope_deviation, slope_source) = as_far_as_excited(
            self.excitation.lift,
            (slope_variance.sqrt(), class::SLOPE_DEVIATION),
            slope_source,
        );
        let compared = Compared {
            name: "thrust slope",
            whole: curve.slope(),
            class: self.class.slope,
            halves: self.by_halves(slope_of, |excitation| excitation.lift),
            impossible: None,
            score: self.halves.and_then(Halves::lift),
            shown: &|slope| format!("n = {slope:.2}"),
        };
        let (slope_deviation, slope_source) = match (self.bench, self.impossible_slope) {
            (None, None) => compared.checked((slope_deviation, slope_source), notes),
            _ => (slope_deviation, slope_source),
        };
        let impossible = self.impossible_slope.map(|slope| {
            format!(
                "the flight indicates n = {slope:.2}, which no propeller has ({} to {})",
                SLOPES.start(),
                SLOPES.end()
            )
        });
        if let Some(impossible) = &impossible {
            notes.push(format!(
                "thrust slope: {impossible}; the class default is written: {}; check that the vehicle flies in this log, that the outputs are those of its \
                 motors, and their range",
                if measured {
                    "the vertical force does not follow the motors as in a flight"
                } else {
                    "no accelerometer says how the thrust follows the motors"
                }
            ));
        }
        let (slope_deviation, slope_source, slope_how) = match (self.bench, impossible) {
            (Some(bench), _) if bench.alone => (
                bench.slope_deviation,
                Source::Bench,
                format!(
                    "shape of the thrust curve by the bench ({:.2}), level by the flight, which hardly moves",
                    bench.slope
                ),
            ),
            (Some(bench), _) => (
                slope_deviation.min(bench.slope_deviation),
                Source::Bench,
                format!(
                    "shape of the thrust curve by the bench ({:.2}) and the flight, by their variances; level by the flight",
                    bench.slope
                ),
            ),
            (None, Some(impossible)) => (class::SLOPE_DEVIATION, Source::Class, impossible),
            (None, None) => (
                slope_deviation,
                slope_source,
                "thrust curve: hover level, this slope, and its bend".to_owned(),
            ),
        };
        values.push(
            Estimate::normal(
                "rotors.thrust_slope",
                "n = d ln thrust/d ln duty at hover",
                "",
                curve.slope(),
                slope_deviation,
                slope_source,
            )
            .how(slope_how)
            .better("10 s of throttle pulses; a thrust stand"),
        );
        let (s, deviation, source) = self.voltage_slope;
        let of_the_bench = self.bench.is_some_and(|bench| bench.exponent.is_some());
        let mut of_voltage = Estimate::normal(
            "rotors.voltage_slope",
            "d ln thrust/d ln voltage",
            "",
            s,
            deviation,
            if of_the_bench { Source::Bench } else { source },
        );
        // The value is that of the document, which has Eq. 19: T ∝ V − V₀, V₀ ≥ 0.
        of_voltage.value = s.max(1.0);
        of_voltage.high = of_voltage.high.max(of_voltage.value);
        if of_voltage.value > s + Z95 * deviation {
            notes.push(format!(
                "thrust over voltage: the flight says V^{s:.2} ± {:.2}, as where an ESC holds the speed or the autopilot makes up for the battery; a vehicle document holds V^1 at \
                 least, so `improve` on the flight has an exponent of the voltage to add",
                Z95 * deviation
            ));
        }
        values.push(
            of_voltage
                .how(match source {
                    _ if of_the_bench => "voltages of the bench, combined with the flight by their variances",
                    _ if !self.has_voltage => "no voltage in the log",
                    Source::Log => "slow drift of thrust over voltage; anything else that drifts with time is in it",
                    Source::LogAndClass => {
                        "slow drift of thrust over voltage, combined with the class by their variances"
                    }
                    _ => "the voltage hardly varies",
                })
                .better("a flight over most of the charge, with voltage"),
        );
        self.falls(values);
        let lag_deviation = covariance[(LAG, LAG)].sqrt();
        let lag_source = whose_in_all(
            fitted.data_deviation[LAG],
            (lag_deviation, class::LAG_LOG_DEVIATION),
            (fitted.lag_s / self.class.lag_s).ln() / class::LAG_LOG_DEVIATION,
        );
        let leans = self.grids.iter().all(|grid| grid.attitude.is_some());
        let (level_deviation, level_source, level_how) = match (measured, leans) {
            (true, _) => (
                LEVEL_LOG_DEVIATION.hypot(level.max(0.5).ln()),
                Source::Log,
                "mean specific force in the air; as good as the accelerometer's scale, and relative to the mass entered",
            ),
            (false, true) => (
                LEVEL_BY_ATTITUDE,
                Source::Log,
                "weight over the cosine of the tilt, mean in the air: no accelerometer in the log; relative to the mass entered",
            ),
            (false, false) => (
                LEVEL_BY_WEIGHT,
                Source::Assumed,
                "the weight: neither accelerometer nor attitude in the log, level flight is assumed; relative to the mass entered",
            ),
        };
        values.push(
            Estimate::log_normal(
                "rotors.thrust_level",
                "thrust of a rotor at the mean duty",
                "N",
                curve.hover * self.request.mass_kg,
                level_deviation,
                level_source,
            )
            .how(level_how),
        );
        values.push(
            Estimate::log_normal(
                "motor.lag_s",
                "motor lag, τ",
                "s",
                fitted.lag_s,
                lag_deviation,
                lag_source,
            )
            .how("first order, on the thrust")
            .better("doublets at 200 Hz or more"),
        );
        values.push(
            Estimate::normal(
                "motor.delay_s",
                "delay of the command, d",
                "s",
                fitted.delay_s,
                covariance[(DELAY, DELAY)].sqrt(),
                whose(fitted.data_deviation[DELAY], class::DELAY_DEVIATION_S),
            )
            .how("apart from the lag only above about 200 Hz"),
        );
        let sum = fitted.lag_s + fitted.delay_s;
        let variance = (fitted.lag_s * lag_deviation).powi(2)
            + covariance[(DELAY, DELAY)]
            + 2.0 * fitted.lag_s * covariance[(LAG, DELAY)];
        let mut both = Estimate::normal(
            "rotors.thrust_lag_s",
            "lag and delay together",
            "s",
            sum,
            variance.max(0.0).sqrt(),
            lag_source,
        )
        .how("the vehicle document has no delay: τ + d");
        // A delay has a different effect: without it the lag is τ.
        both.low = both.low.min(fitted.lag_s / (Z95 * lag_deviation).exp());
        values.push(both);
    }

    /// Decline of the thrust over time, log by log.
    fn falls(&self, values: &mut Vec<Estimate>) {
        for grid in self.grids {
            let Some(fall) = slow::fall(grid, &self.fitted.curve) else {
                continue;
            };
            values.push(
                Estimate::normal(
                    "flight.thrust_fall_per_s",
                    &format!("fall of the thrust with time in {}", grid.name),
                    "1/s",
                    fall.per_s,
                    fall.deviation,
                    Source::Log,
                )
                .how("most likely the supply, whose voltage is not in the log; half of the flight predicts the other; no value of the vehicle")
                .better("voltage in the log"),
            );
        }
    }

    /// What the document assumes.
    fn assumed(&self, values: &mut Vec<Estimate>, voltage: f64, power: f64) {
        let centre = CENTRE_DEVIATION * self.request.arm_m;
        for (axis, name) in ["centre of mass, forward", "centre of mass, to the right"]
            .into_iter()
            .enumerate()
        {
            let key = format!("body.centre_of_mass_m[{axis}]");
            values.push(
                Estimate::normal(&key, name, "m", 0.0, centre, Source::Assumed)
                    .how("amid the rotors, to 1 % of the arm"),
            );
        }
        values.push(
            Estimate::normal(
                "rotors.thrust_scale",
                "thrust of one rotor over the mean of all, less 1",
                "",
                0.0,
                EVENNESS_DEVIATION,
                Source::Assumed,
            )
            .how("healthy rotors vary by 3 %"),
        );
        // Punches and idling are outside the duties that the curve was fitted to: its errors there look like these
        // three.
        let full = self.full_thrust(voltage);
        let current = power * full.powf(1.5) / voltage;
        let resistance = TOP_DEVIATION * voltage / (class::VOLTAGE_SLOPE * current);
        for (key, name, unit, deviation) in [
            (
                "rotors.lost_duty",
                "duty at the top that adds no thrust",
                "",
                TOP_DEVIATION / self.class.slope,
            ),
            (
                "rotors.esc_resistance_ohm",
                "resistance of ESC and motor",
                "Ω",
                resistance,
            ),
            ("rotors.dead_zone", "duty that does nothing", "", DEAD_ZONE_DEVIATION),
        ] {
            values.push(
                Estimate::normal(key, name, unit, 0.0, deviation, Source::Assumed)
                    .how("none; the thrust curve extrapolates beyond the duties that were flown"),
            );
        }
    }

    /// Thrust of a rotor at full duty by the curve, N.
    fn full_thrust(&self, voltage: f64) -> f64 {
        let curve = &self.fitted.curve;
        curve
            .blade(curve.hover * self.request.mass_kg, voltage, self.voltage_slope.0)
            .lift(1.0, voltage)
            .max(0.01)
    }

    /// Cells, mean voltage in the air, capacity, resistance, k_P.
    fn battery(&self, values: &mut Vec<Estimate>) -> (u32, f64, f64, f64, f64) {
        let (mass, arm) = (self.request.mass_kg, self.request.arm_m);
        let found = slow::battery(self.grids, &self.fitted.curve);
        let parameter = |names: &[&str]| -> Option<f64> {
            names
                .iter()
                .find_map(|name| self.logs.iter().find_map(|log| log.parameters.get(*name)).copied())
                .filter(|value| *value > 0.0)
        };
        let class_cells = if mass < 0.1 {
            1
        } else if mass < 2.0 {
            4
        } else {
            6
        };
        let (cells, source) = match (
            self.request.cells,
            parameter(&["BAT1_N_CELLS", "BAT_N_CELLS"]),
            found.cells,
        ) {
            (Some(cells), ..) => (cells, Source::Entered),
            (_, Some(cells), _) if (1.0..=24.0).contains(&cells) => (cells as u32, Source::Parameter),
            (_, _, Some(cells)) => (cells, Source::Log),
            _ => (class_cells, Source::Class),
        };
        let mut counted = Estimate::normal("battery.cells", "cells in series", "", f64::from(cells), 0.0, source)
            .how(found.start_v.map_or_else(
                || "no voltage in the log".to_owned(),
                |volts| format!("{volts:.2} V at the start: {:.2} V a cell", volts / f64::from(cells)),
            ))
            .better(if source == Source::Class { "--cells" } else { "" });
        if source == Source::Class {
            // One more or one less; a battery has at least one.
            (counted.low, counted.high) = ((counted.value - 1.0).max(1.0), counted.value + 1.0);
        }
        values.push(counted);
        let nominal = 3.7 * f64::from(cells);
        let (capacity, source) = match (
            self.request.capacity_ah,
            parameter(&["BATT_CAPACITY", "BAT1_CAPACITY", "BAT_CAPACITY"]),
        ) {
            (Some(capacity), _) => (capacity, Source::Entered),
            (_, Some(milliamp_hours)) if milliamp_hours >= 50.0 => (milliamp_hours / 1000.0, Source::Parameter),
            _ => ((self.class.energy_wh_per_kg * mass / nominal).max(0.05), Source::Class),
        };
        let deviation = if source == Source::Entered {
            0.0
        } else if source == Source::Parameter {
            0.05
        } else {
            0.4
        };
        values.push(
            Estimate::log_normal("battery.capacity_ah", "capacity", "Ah", capacity, deviation, source)
                .how(if source == Source::Class {
                    "energy of batteries of such vehicles"
                } else {
                    ""
                })
                .better(if source == Source::Class {
                    "--capacity, as printed on the pack"
                } else {
                    ""
                }),
        );
        // Of the class: 12 mΩ of a cell of 5 Ah, in proportion to cells over capacity.
        let class_resistance =
            (0.012 * f64::from(cells) * 5.0 / capacity / if mass < 0.1 { 2.0 } else { 4.0 }).clamp(0.002, 1.0);
        let (resistance, resistance_deviation, source) = match found.resistance {
            Some((value, deviation)) => (value, deviation, Source::Log),
            None => (class_resistance, 0.5 * class_resistance, Source::Class),
        };
        let mut estimate = Estimate::normal(
            "battery.internal_resistance_ohm",
            "resistance",
            "Ω",
            resistance,
            resistance_deviation,
            source,
        )
        .how(if source == Source::Log {
            "voltage over current and charge"
        } else {
            "no current in the log, or it hardly varies"
        })
        .better("5 s of rest before take-off, with current and voltage");
        estimate.low = estimate.low.max(0.0);
        values.push(estimate);
        let class_power = self.class.power_coefficient(self.rotors, arm);
        let flown_power = found
            .power
            .map(|(value, deviation)| (value / mass.powf(1.5), deviation));
        let bench_power = self.bench.and_then(|bench| bench.power);
        let (power, deviation, source) = match (flown_power, bench_power) {
            (Some((flown, deviation)), bench) => {
                match bench.and_then(|(value, own)| together((flown.ln(), deviation), (value.ln(), own))) {
                    Some((value, deviation)) => (value.exp(), deviation, Source::Bench),
                    None => (flown, deviation, Source::Log),
                }
            }
            (None, Some((value, deviation))) => (value, deviation, Source::Bench),
            (None, None) => (class_power, 0.35, Source::Class),
        };
        values.push(
            Estimate::log_normal(
                "battery.power_coefficient_w_per_n15",
                "electrical power of a rotor over thrust^1.5",
                "W/N^1.5",
                power,
                deviation,
                source,
            )
            .how(match source {
                Source::Log => "voltage times current in the air",
                Source::Bench => "power over thrust of the bench, with that of the flight where it has a current",
                _ => "momentum theory and the class's efficiency",
            })
            .better(if source == Source::Class {
                "current in the log"
            } else {
                ""
            }),
        );
        let hover_n = mass * GRAVITY / self.rotors as f64;
        let hover_w = self.rotors as f64 * power * hover_n.powf(1.5);
        let (_, mean) = fit::hover_point(self.grids);
        let voltage = if mean.is_finite() && mean > 2.0 {
            mean
        } else {
            // What the twin assumes if the log has no voltage: three quarters charged, under load.
            let open = f64::from(cells) * 3.98;
            0.5 * (open + (open * open - 4.0 * resistance * hover_w).max(0.0).sqrt())
        };
        (cells, voltage, capacity, resistance, power.min(1000.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// "CLASS DEFAULT" was shown next to a value half of the class's, with an interval that excludes the class's.
    #[test]
    fn regress_what_the_log_has_moved_is_no_class_default() {
        // By the log alone it is open (a ridge of inertia and lag); with the class's value for the lag it is not.
        assert_eq!(whose_in_all(0.9, (0.11, 0.3), -2.0), Source::LogAndClass);
        assert_eq!(whose_in_all(0.9, (0.28, 0.3), 0.8), Source::LogAndClass);
        assert_eq!(whose_in_all(0.9, (0.11, 0.3), 0.0), Source::LogAndClass);
        assert_eq!(whose_in_all(0.9, (0.29, 0.3), 0.2), Source::Class);
        assert_eq!(whose_in_all(0.1, (0.09, 0.3), 0.2), Source::Log);
    }
}
