//! Which outputs are rotors, and where they are.

use serde::Serialize;

use super::Request;
use super::class::Class;
use super::frames::{self, Frame, Place};
use super::grid::{Grid, moving_outputs};
use super::wiring::{self, Contradiction, Wiring};
use crate::log::LEAST_TO_CONTRADICT_HZ;
use crate::log::flight_parts::RotorPlace;
use crate::log::{FlightLog, RotorOrder, SensorRate, SourceKind};
use crate::model::constants::Source;
use rotortwin_plant::vehicle::model::SpinDirection;

/// Motor outputs slower than this rule out a stated frame only if the motion identifies the right one: that takes 15
/// Hz.
pub(super) const CONCLUSIVE_DUTY_HZ: f64 = 15.0;

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
