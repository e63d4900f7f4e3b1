//! Which sign, frame, motor order or spin explains the responses of a controller.
//!
//! Each response is a change of all duties; the correct one is the smallest change that produces the right acceleration alone. The cosine
//! between the two is 1 for a correct controller, whatever its gains. Each suspicion knows how to undo itself; the one after which all
//! responses point the right way is reported.

use super::response::{Airframe, Duties, Input, MOTION, ROLL, Responses, TURN_RAD, axis_name, cosine, length, turn};
use super::{Fault, Suspicion};
use rotortwin_flight_core::MAX_ROTORS;

/// A response points the right way above this cosine: 45°.
const RIGHT: f64 = 0.7;
/// Two suspicions explain the answers equally well within this.
const TIE: f64 = 0.01;
/// Tolerance on the measured turn of the response, rad.
const TURN_TOLERANCE_RAD: f64 = 0.5 * TURN_RAD;

/// How a suspicion transforms the measurements.
#[derive(Clone, Debug)]
struct Repair {
    /// Column of the measurement, and sign, for each number of the motion.
    inputs: [(usize, f64); MOTION],
    /// `order[i]`: our rotor that receives the duty meant for rotor i.
    order: [usize; MAX_ROTORS],
    /// Bit i: it assumes that rotor i turns the other way.
    reversed: u32,
    /// Signs of the axes of its own wrench.
    axes: [f64; 4],
    /// Sign that it applies to the yaw.
    yaw: f64,
}

impl Repair {
    fn none() -> Self {
        Self {
            inputs: std::array::from_fn(|i| (i, 1.0)),
            order: std::array::from_fn(|i| i),
            reversed: 0,
            axes: [1.0; 4],
            yaw: 1.0,
        }
    }

    fn flip(mut self, inputs: &[usize]) -> Self {
        for &input in inputs {
            self.inputs[input].1 = -self.inputs[input].1;
            if input == 8 {
                self.yaw = -self.yaw;
            }
        }
        self
    }

    fn swap(mut self, a: usize, b: usize) -> Self {
        self.inputs.swap(a, b);
        self
    }

    fn apply(&self, measured: &[Duties; MOTION], rotors: usize) -> [Duties; MOTION] {
        std::array::from_fn(|i| {
            let (column, sign) = self.inputs[i];
            let mut duties = [0.0; MAX_ROTORS];
            for rotor in 0..rotors {
                duties[rotor] = sign * measured[column][self.order[rotor]];
            }
            duties
        })
    }
}

/// How well responses point the right way.
#[derive(Clone, Debug)]
pub(super) struct Direction {
    /// By motion value; `None`: no response.
    pub(super) cosines: [Option<f64>; MOTION],
}

impl Direction {
    fn of(columns: &[Duties; MOTION], patterns: &[Duties; 4]) -> Self {
        Self {
            cosines: std::array::from_fn(|i| {
                let (axis, sign) = Input::answer(i);
                (length(&columns[i]) > 0.0).then(|| sign * cosine(&columns[i], &patterns[axis]))
            }),
        }
    }

    fn worst(&self) -> f64 {
        self.cosines.iter().flatten().fold(1.0, |worst: f64, c| worst.min(*c))
    }

    fn mean(&self) -> f64 {
        let answered: Vec<f64> = self.cosines.iter().flatten().copied().collect();
        answered.iter().sum::<f64>() / answered.len().max(1) as f64
    }

    /// True if all existing responses point the right way.
    pub(super) fn is_right(&self) -> bool {
        self.worst() >= RIGHT
    }
}

/// As measured, uncorrected.
pub(super) fn direction(airframe: &Airframe, measured: &[Duties; MOTION]) -> Option<Direction> {
    Some(Direction::of(measured, &airframe.patterns(0)?))
}

/// The explanation found, and the corrected measurements.
pub(super) struct Explained {
    pub(super) suspicion: Suspicion,
    pub(super) repaired: [Duties; MOTION],
    pub(super) reversed: u32,
}

/// A suspicion to try.
struct Candidate {
    fault: Fault,
    field: String,
    sentence: String,
    repair: Repair,
}

/// The simplest suspicion after which all responses point the right way; `None` if there is none.
pub(super) fn suspect(airframe: &Airframe, responses: &Responses) -> Option<Explained> {
    let rotors = airframe.rotor_count();
    let mut fitting: Vec<(f64, usize, Candidate)> = Vec::new();
    let mut try_all = |candidates: Vec<Candidate>, rank: usize| -> Option<()> {
        for candidate in candidates {
            let mut patterns = airframe.patterns(candidate.repair.reversed)?;
            for (pattern, sign) in patterns.iter_mut().zip(candidate.repair.axes) {
                for duty in pattern.iter_mut() {
                    *duty *= sign;
                }
            }
            let columns = candidate.repair.apply(&responses.motion, rotors);
            let direction = Direction::of(&columns, &patterns);
            if direction.is_right() && heading_fits(airframe, responses, &candidate.repair) {
                fitting.push((direction.mean(), rank, candidate));
            }
        }
        Some(())
    };
    try_all(signs(), 0)?;
    try_all(frames(), 1)?;
    try_all(spins(airframe), 2)?;
    try_all(orders(airframe, responses), 3)?;
    let best = fitting.iter().map(|fit| fit.0).fold(0.0, f64::max);
    fitting.retain(|fit| fit.0 > best - TIE);
    fitting.sort_by_key(|fit| fit.1);
    let mut fitting = fitting.into_iter();
    let (mean, rank, chosen) = fitting.next()?;
    let others = fitting
        .take_while(|other| other.1 == rank || rank == 0)
        .map(|other| format!("{}: {}", other.2.field, other.2.sentence))
        .take(2)
        .collect();
    let before = direction(airframe, &responses.motion)?;
    let repaired = chosen.repair.apply(&responses.motion, rotors);
    Some(Explained {
        repaired: repaired.map(|column| undo_axes(airframe, &column, &chosen.repair)),
        reversed: chosen.repair.reversed,
        suspicion: Suspicion {
            fault: chosen.fault,
            field: chosen.field,
            sentence: chosen.sentence,
            evidence: format!(
                "{}; with this undone all answers point the right way (mean cosine {mean:.2})",
                wrong_answers(airframe, responses, &before)
            ),
            others,
        },
    })
}

/// Undoes axis signs in a change of duties.
fn undo_axes(airframe: &Airframe, duties: &Duties, repair: &Repair) -> Duties {
    let Some(patterns) = airframe.patterns(0) else {
        return *duties;
    };
    if repair.axes == [1.0; 4] {
        return *duties;
    }
    let accelerations = airframe.accelerations(duties);
    std::array::from_fn(|rotor| {
        (0..4)
            .map(|axis| repair.axes[axis] * accelerations[axis] * patterns[axis][rotor])
            .sum()
    })
}

/// Does the response to position errors turn with the heading as expected after this repair? One that does not turn at all says nothing.
fn heading_fits(airframe: &Airframe, responses: &Responses, repair: &Repair) -> bool {
    let in_order = |duties: &Duties| {
        let mut ordered = [0.0; MAX_ROTORS];
        for rotor in 0..airframe.rotor_count() {
            ordered[rotor] = duties[repair.order[rotor]];
        }
        ordered
    };
    let (north, turned) = (in_order(&responses.motion[0]), in_order(&responses.turned_north));
    let Some(turn) = turn(airframe, &north, &turned, &repair.axes) else {
        return true;
    };
    let off = |yaw: f64| (turn + yaw * TURN_RAD).abs();
    off(-repair.yaw) > TURN_TOLERANCE_RAD || off(repair.yaw) < TURN_TOLERANCE_RAD
}

/// The first two responses that point the wrong way, as text.
fn wrong_answers(airframe: &Airframe, responses: &Responses, before: &Direction) -> String {
    let wrong: Vec<usize> = (0..MOTION)
        .filter(|&i| before.cosines[i].is_some_and(|cosine| cosine < RIGHT))
        .collect();
    let words: Vec<String> = wrong
        .iter()
        .take(2)
        .map(|&i| {
            let input = Input::Motion(i);
            let (axis, sign) = Input::answer(i);
            let got = airframe.accelerations(&responses.motion[i]);
            format!(
                "{} +1 {} is answered by {} (expected {} in {}; cosine {:.2})",
                input.field(),
                input.unit(),
                strongest(&got),
                if sign > 0.0 { "an increase" } else { "a decrease" },
                axis_name(axis),
                before.cosines[i].unwrap_or(0.0)
            )
        })
        .collect();
    format!(
        "{} of {MOTION} answers point elsewhere: {}",
        wrong.len(),
        words.join("; ")
    )
}

/// The largest acceleration of four.
fn strongest(accelerations: &[f64; 4]) -> String {
    let axis = (0..4)
        .max_by(|&a, &b| accelerations[a].abs().total_cmp(&accelerations[b].abs()))
        .unwrap_or(0);
    let unit = if axis == 0 { "m/s²" } else { "rad/s²" };
    format!("{} {:+.3} {unit}", axis_name(axis), accelerations[axis])
}

fn signs() -> Vec<Candidate> {
    let one = |input: usize| Candidate {
        fault: Fault::Sign,
        field: Input::Motion(input).field(),
        sentence: "its sign is taken the other way round".to_owned(),
        repair: Repair::none().flip(&[input]),
    };
    (0..MOTION).map(one).collect()
}

fn frames() -> Vec<Candidate> {
    let frame = |fault, field: &str, sentence: &str, repair| Candidate {
        fault,
        field: field.to_owned(),
        sentence: sentence.to_owned(),
        repair,
    };
    let enu = |r: Repair, first: usize| r.swap(first, first + 1).flip(&[first + 2]);
    let none = Repair::none;
    let up = "z is taken to point up, it points down (NED)";
    let east = "it is read as east, north, up (ENU); it is north, east, down (NED)";
    let left = "it is read as forward, left, up (FLU); it is forward, right, down (FRD)";
    let both = "position_ned_m and velocity_ned_m_s";
    let angular = "attitude_rad and body_rates_rad_s";
    vec![
        frame(Fault::Frame, both, up, none().flip(&[2, 5])),
        frame(Fault::Frame, both, east, enu(enu(none(), 0), 3)),
        frame(Fault::Frame, "position_ned_m", east, enu(none(), 0)),
        frame(Fault::Frame, "velocity_ned_m_s", east, enu(none(), 3)),
        frame(
            Fault::Frame,
            both,
            "north and east are swapped",
            none().swap(0, 1).swap(3, 4),
        ),
        frame(Fault::Frame, angular, left, none().flip(&[7, 8, 10, 11])),
        frame(Fault::Frame, "body_rates_rad_s", left, none().flip(&[10, 11])),
        frame(Fault::Frame, "attitude_rad", left, none().flip(&[7, 8])),
        frame(
            Fault::Frame,
            "all fields",
            "they are read as north, west, up and forward, left, up; they are NED and FRD",
            none().flip(&[1, 2, 4, 5, 7, 8, 10, 11]),
        ),
        frame(
            Fault::Frame,
            "all fields",
            "they are read as east, north, up and forward, left, up; they are NED and FRD",
            enu(enu(none(), 0), 3).flip(&[7, 8, 10, 11]),
        ),
        frame(
            Fault::Sign,
            "attitude_rad.roll and body_rates_rad_s.p",
            "their sign is taken the other way round",
            none().flip(&[6, 9]),
        ),
        frame(
            Fault::Sign,
            "attitude_rad.pitch and body_rates_rad_s.q",
            "their sign is taken the other way round",
            none().flip(&[7, 10]),
        ),
        frame(
            Fault::Sign,
            "attitude_rad.yaw and body_rates_rad_s.r",
            "their sign is taken the other way round",
            none().flip(&[8, 11]),
        ),
        frame(
            Fault::Sign,
            "attitude_rad",
            "all signs are taken the other way round",
            none().flip(&[6, 7, 8]),
        ),
        frame(
            Fault::Sign,
            "body_rates_rad_s",
            "all signs are taken the other way round",
            none().flip(&[9, 10, 11]),
        ),
        frame(
            Fault::Sign,
            "position_ned_m",
            "all signs are taken the other way round",
            none().flip(&[0, 1, 2]),
        ),
        frame(
            Fault::Sign,
            "velocity_ned_m_s",
            "all signs are taken the other way round",
            none().flip(&[3, 4, 5]),
        ),
        frame(
            Fault::Field,
            "attitude_rad",
            "roll and pitch are swapped",
            none().swap(6, 7),
        ),
        frame(
            Fault::Field,
            "body_rates_rad_s",
            "p and q are swapped",
            none().swap(9, 10),
        ),
        frame(
            Fault::Field,
            angular,
            "roll and pitch, p and q are swapped",
            none().swap(6, 7).swap(9, 10),
        ),
    ]
}

fn spins(airframe: &Airframe) -> Vec<Candidate> {
    let rotors = airframe.rotor_count();
    let mut all = vec![Candidate {
        fault: Fault::Spin,
        field: "duty".to_owned(),
        sentence: "the yaw moment has the wrong sign: it takes all rotors to turn the other way".to_owned(),
        repair: Repair {
            reversed: (1 << rotors) - 1,
            ..Repair::none()
        },
    }];
    for rotor in 0..rotors {
        let turns = if airframe.turns_ccw(rotor) {
            "counter-clockwise"
        } else {
            "clockwise"
        };
        all.push(Candidate {
            fault: Fault::Spin,
            field: format!("duty[{rotor}]"),
            sentence: format!(
                "it takes rotor {} to turn the other way; at {:.0}° it turns {turns} seen from above",
                rotor + 1,
                airframe.azimuth_deg(rotor)
            ),
            repair: Repair {
                reversed: 1 << rotor,
                ..Repair::none()
            },
        });
    }
    for (axis, name) in [(ROLL, "roll"), (ROLL + 1, "pitch")] {
        let mut axes = [1.0; 4];
        axes[axis] = -1.0;
        all.push(Candidate {
            fault: Fault::Sign,
            field: "duty".to_owned(),
            sentence: format!("the {name} moment of its mixer has the wrong sign"),
            repair: Repair { axes, ..Repair::none() },
        });
    }
    all
}

/// Motor orders with which all responses point the right way, found by exhaustive search.
fn orders(airframe: &Airframe, responses: &Responses) -> Vec<Candidate> {
    let Some(patterns) = airframe.patterns(0) else {
        return Vec::new();
    };
    let rotors = airframe.rotor_count();
    let mut all = Vec::new();
    let mut order: Vec<usize> = (0..rotors).collect();
    permute(&mut order, 0, &mut |order| {
        let mut repair = Repair::none();
        repair.order[..rotors].copy_from_slice(order);
        if order.iter().enumerate().all(|(i, &rotor)| i == rotor) {
            return;
        }
        let columns = repair.apply(&responses.motion, rotors);
        if Direction::of(&columns, &patterns).is_right() {
            all.push(Candidate {
                fault: Fault::MotorOrder,
                field: "duty".to_owned(),
                sentence: order_words(order),
                repair,
            });
        }
    });
    all
}

/// Calls `visit` with each permutation of the entries from `first` on.
pub(super) fn permute(order: &mut Vec<usize>, first: usize, visit: &mut impl FnMut(&[usize])) {
    if first + 1 >= order.len() {
        visit(order);
        return;
    }
    for other in first..order.len() {
        order.swap(first, other);
        permute(order, first + 1, visit);
        order.swap(first, other);
    }
}

/// Describes what is wrong with an order: `order[i]` is the rotor that receives the duty meant for rotor i.
fn order_words(order: &[usize]) -> String {
    let count = order.len();
    let moved: Vec<usize> = (0..count).filter(|&i| order[i] != i).collect();
    if let [a, b] = moved[..] {
        return format!("rotors {} and {} are swapped", a + 1, b + 1);
    }
    let shift = order[0];
    if shift != 0 && (0..count).all(|i| order[i] == (i + shift) % count) {
        return format!(
            "all are rotated: the duty that is meant for rotor 1 is that of rotor {}",
            shift + 1
        );
    }
    let meant: Vec<String> = moved
        .iter()
        .map(|&i| format!("{} in the place of {}", i + 1, order[i] + 1))
        .collect();
    let mirrored = (0..count).all(|i| order[order[i]] == i) && (0..count).all(|i| (order[i] + i) % count == order[0]);
    let how = if mirrored { "numbered the other way round: " } else { "" };
    format!("{how}duties of rotors are exchanged: {}", meant.join(", "))
}
