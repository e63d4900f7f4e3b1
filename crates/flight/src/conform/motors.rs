//! From the responses on the test stand to a verdict on each motor, or to none.
//!
//! An explanation is an order of the motors with a set of motors that are taken to turn the other way. Its measure is the mean cosine between
//! the measured shares and those that it predicts, over roll, pitch and yaw.
//!
//! A verdict needs evidence: with hundreds of sets of eight motors, one of them fits any noise to a mean cosine of 0.9 or so. So a motor is
//! blamed only where the best explanation leaves nothing over and half of the samples in roll and in pitch
//! were taken with all motors within their limits. Where integrators wind up against the stand, these conditions fail, and so does the verdict.

use super::response::{Airframe, Duties, PITCH, ROLL, YAW, cosine, length};
use super::suspect::permute;
use rotortwin_flight_core::MAX_ROTORS;
use serde::Serialize;

/// Share of the samples of a swing that must be within the limits of the motors.
pub(super) const LEFT: f64 = 0.5;
/// Share of a swing with motors at their limits above which an open outcome is put down to it.
const REPORTED_AT_LIMIT: f64 = 0.1;
/// Smallest duty amplitude that counts as a response.
const ANSWER: f64 = 1e-3;
/// Shares match a motor order above this cosine.
const FITS: f64 = 0.8;
/// A mean cosine that leaves nothing unexplained.
const EXPLAINS: f64 = 0.97;
/// A mean cosine that it takes to blame a motor. In a replica of the stand, right motors of an octorotor driven to their limits by wound-up
/// integrators were taken for wrong ones with up to 0.96, of a quadrotor with up to 0.98, the latter with fewer free samples than [`LEFT`].
const BLAMES: f64 = 0.965;
/// Required improvement of the mean cosine before motors are reported as reversed.
const CLEAR: f64 = 0.05;
/// Weight of the yaw when motors are ordered: a reversed motor is not a swapped one.
const YAW_WEIGHT: f64 = 0.1;
/// Advantage of the order as wired.
const AS_WIRED: f64 = 0.02;

/// One rotor of the vehicle, and how the autopilot treats its motor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MotorVerdict {
    /// Our rotor number, from 1.
    pub rotor: usize,
    /// Autopilot output that drives it, from 1.
    pub channel: usize,
    /// Azimuth, degrees clockwise from the nose.
    pub azimuth_deg: f64,
    /// It turns counter-clockwise, seen from above.
    pub turns_ccw: bool,
    /// The rotor whose place the autopilot assumes for that motor, from 1.
    pub answers_as: usize,
    /// The autopilot assumes the opposite rotation direction.
    pub reversed: bool,
}

impl MotorVerdict {
    /// True if the autopilot drives it correctly.
    pub fn is_right(&self) -> bool {
        self.rotor == self.answers_as && !self.reversed
    }
}

/// Result of the stand test.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpinReport {
    /// Name of the autopilot.
    pub peer: String,
    /// By channel.
    pub motors: Vec<MotorVerdict>,
    /// Cosines of the shares in roll, pitch and yaw with those of the vehicle, after assigning the motors to their assumed places.
    pub cosines: [f64; 3],
}

impl SpinReport {
    /// Every motor is where the autopilot assumes it to be, and turns as assumed.
    pub fn is_right(&self) -> bool {
        self.motors.iter().all(MotorVerdict::is_right)
    }
}

/// What was measured, by axis: roll, pitch, yaw.
#[derive(Clone, Debug, Default)]
pub(super) struct Swings {
    /// Each rotor's share of the opposing response, as a duty.
    pub(super) shares: [Duties; 3],
    /// Share of the samples with a motor at its limit.
    pub(super) at_limit: [f64; 3],
}

impl Swings {
    /// The larger one of roll and pitch. Yaw asks for much and drives right motors to their limits, evenly to both sides.
    fn most_at_limit(&self) -> f64 {
        self.at_limit[0].max(self.at_limit[1])
    }

    /// An open outcome, with its likely cause.
    fn cannot_tell(&self, peer: &str, reason: &str) -> String {
        let mut sentence = format!("cannot tell whether the motors of {peer} are right: {reason}");
        if self.most_at_limit() >= REPORTED_AT_LIMIT {
            sentence.push_str(&format!(
                "; motors stood at their limits for {:.0} % of a swing, as integrators wind up against the stand: set them to 0 for this test \
                 (of PX4: config/autopilot-settings/px4-stand.env) and start the autopilot again",
                100.0 * self.most_at_limit()
            ));
        }
        sentence
    }

    /// The shares of the motors that an order puts in each place.
    fn in_order(&self, order: &[usize]) -> [Duties; 3] {
        self.shares.map(|duties| {
            let mut ordered = [0.0; MAX_ROTORS];
            for (place, &rotor) in order.iter().enumerate() {
                ordered[place] = duties[rotor];
            }
            ordered
        })
    }
}

/// The motors whose reversal fits all three axes best.
#[derive(Clone, Copy)]
struct Spins {
    /// Bit i: the autopilot assumes that rotor i turns the other way.
    reversed: u32,
    /// Mean cosine.
    mean: f64,
}

/// Identifies motors from their shares in the responses to roll, pitch and yaw.
///
/// # Errors
/// There is no response, or the responses do not show which motors are wrong, or whether any is.
pub(super) fn judge(
    airframe: &Airframe,
    swings: &Swings,
    rotor_of_channel: &[usize],
    peer: String,
) -> Result<SpinReport, String> {
    let patterns = airframe
        .patterns(0)
        .ok_or("the rotors of the vehicle do not span thrust, roll, pitch and yaw")?;
    for (axis, name) in ["roll", "pitch"].into_iter().enumerate() {
        if length(&swings.shares[axis]) < ANSWER {
            return Err(format!(
                "{peer} does not respond to a swing in {name}: no duty changes by more than {ANSWER}"
            ));
        }
    }
    let wired: Vec<usize> = (0..airframe.rotor_count()).collect();
    let best = best_order(airframe, swings, &patterns);
    // Reversed motors also change the shares of a least-squares mixer in roll and pitch: if they explain everything, the order is not at fault.
    let as_wired = spins(airframe, &swings.shares, &patterns);
    let ordered = spins(airframe, &swings.in_order(&best), &patterns);
    let is_wired = as_wired.mean > EXPLAINS || best == wired;
    let (order, found) = if is_wired { (&wired, as_wired) } else { (&best, ordered) };
    let cosines = cosines(&swings.in_order(order), &patterns);
    if as_wired.mean <= EXPLAINS && (cosines[0] < FITS || cosines[1] < FITS) {
        return Err(swings.cannot_tell(
            &peer,
            &format!(
                "the responses fit no order of the motors, the best has cosines of {:.2} in roll and {:.2} in pitch",
                cosines[0], cosines[1]
            ),
        ));
    }
    let is_right = is_wired && found.reversed == 0;
    if let Some(reason) = doubt(swings, is_right, found.mean) {
        return Err(swings.cannot_tell(&peer, &reason));
    }
    let verdict = |(channel, &rotor): (usize, &usize)| {
        let place = order.iter().position(|&other| other == rotor).unwrap_or(rotor);
        MotorVerdict {
            rotor: rotor + 1,
            channel: channel + 1,
            azimuth_deg: airframe.azimuth_deg(rotor),
            turns_ccw: airframe.turns_ccw(rotor),
            answers_as: place + 1,
            reversed: found.reversed >> place & 1 == 1,
        }
    };
    Ok(SpinReport {
        peer,
        motors: rotor_of_channel.iter().enumerate().map(verdict).collect(),
        cosines,
    })
}

/// Why the best explanation, of this mean cosine, is no verdict; `None`: it is one.
///
/// Right motors whose mixer distributes otherwise than by least squares fit less well, which is no reason for doubt within their limits.
fn doubt(swings: &Swings, is_right: bool, mean: f64) -> Option<String> {
    let free = 1.0 - swings.most_at_limit();
    if is_right {
        return (mean <= EXPLAINS && free < LEFT).then(|| {
            format!("all motors right fits best, with a mean cosine of {mean:.3}; more than {EXPLAINS} is needed with motors at their limits")
        });
    }
    if mean <= BLAMES {
        return Some(format!(
            "the best explanation, with wrong motors, has a mean cosine of {mean:.3}; more than {BLAMES} is needed to blame one"
        ));
    }
    if free < LEFT {
        return Some(format!(
            "{:.0} % of the samples of a swing are free of motors at their limits; {:.0} % are needed to blame one",
            100.0 * free,
            100.0 * LEFT
        ));
    }
    None
}

/// Cosines of shares with those of the vehicle.
fn cosines(shares: &[Duties; 3], patterns: &[Duties; 4]) -> [f64; 3] {
    [(0, ROLL), (1, PITCH), (2, YAW)].map(|(axis, pattern)| cosine(&shares[axis], &patterns[pattern]))
}

fn mean(cosines: [f64; 3]) -> f64 {
    cosines.iter().sum::<f64>() / 3.0
}

/// The motor order that fits best, by exhaustive search. Ties go to the order as wired.
fn best_order(airframe: &Airframe, swings: &Swings, patterns: &[Duties; 4]) -> Vec<usize> {
    let worth = |order: &[usize]| {
        let [roll, pitch, yaw] = cosines(&swings.in_order(order), patterns);
        roll + pitch + YAW_WEIGHT * yaw
    };
    let mut order: Vec<usize> = (0..airframe.rotor_count()).collect();
    let mut best = (worth(&order) + AS_WIRED, order.clone());
    permute(&mut order, 0, &mut |order| {
        let worth = worth(order);
        if worth > best.0 {
            best = (worth, order.to_vec());
        }
    });
    best.1
}

/// The reversed motors that fit best, by exhaustive search. With a least-squares mixer, one reversed motor changes the responses of all motors;
/// with a mixer table, only that motor in yaw: both are tried.
fn spins(airframe: &Airframe, shares: &[Duties; 3], nominal: &[Duties; 4]) -> Spins {
    let of_none = mean(cosines(shares, nominal));
    let mut best = (of_none, 0);
    for mask in 1..1_u32 << airframe.rotor_count() {
        let mut table = *nominal;
        for (rotor, share) in table[YAW].iter_mut().enumerate() {
            if mask >> rotor & 1 == 1 {
                *share = -*share;
            }
        }
        let least_squares = airframe
            .patterns(mask)
            .map_or(-1.0, |patterns| mean(cosines(shares, &patterns)));
        let worth = least_squares.max(mean(cosines(shares, &table)));
        if worth > best.0 + 1e-9 {
            best = (worth, mask);
        }
    }
    // A slightly better fit is no reason to call a motor reversed.
    if best.0 <= of_none + CLEAR {
        return Spins {
            reversed: 0,
            mean: of_none,
        };
    }
    Spins {
        reversed: best.1,
        mean: best.0,
    }
}
