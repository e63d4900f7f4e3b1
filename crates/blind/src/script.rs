//! Flights as lists of reference segments, and the smoothed reference that the pilot follows.
//!
//! A script moves a target (place and heading); a third-order low pass smooths the target so that position, velocity and
//! acceleration of the reference are continuous. Built-in scripts: hover, helix, waypoint, excitation; anything else as TOML:
//!
//! ```toml
//! name = "yaw doublet"
//! start_height_m = 3.0      # metres above the ground
//! smoothing_rad_s = 3.0     # corner of the low pass
//! [[segment]]
//! kind = "turn"             # hold, go, cruise, turn, sine, helix
//! duration_s = 2.0
//! yaw_rate_rad_s = 1.2
//! ```

use crate::error::{BlindError, Result};
use crate::random::Stream;
use crate::world::FOOT_DEPTH;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// One segment. Horizontal places are absolute, `height_m` is above the ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Segment {
    /// Stay.
    Hold {
        /// s.
        duration_s: f64,
    },
    /// The target moves to a place on a straight leg of least jerk: peak speed 1.875 D/T, peak acceleration 5.77 D/T².
    Go {
        /// T, s; the leg takes all of it.
        duration_s: f64,
        /// m.
        north_m: f64,
        /// m.
        east_m: f64,
        /// m.
        height_m: f64,
        /// rad; absent: as it is.
        #[serde(default)]
        yaw_rad: Option<f64>,
    },
    /// The target moves at a constant velocity.
    Cruise {
        /// s.
        duration_s: f64,
        /// m/s.
        north_m_s: f64,
        /// m/s.
        east_m_s: f64,
        /// m/s, up.
        climb_m_s: f64,
    },
    /// The heading of the target turns at a constant rate.
    Turn {
        /// s.
        duration_s: f64,
        /// rad/s.
        yaw_rate_rad_s: f64,
    },
    /// Sines about the place where the segment begins, faded in and out over half a period.
    Sine {
        /// s.
        duration_s: f64,
        /// s.
        period_s: f64,
        /// m, amplitude.
        #[serde(default)]
        north_m: f64,
        /// m, amplitude.
        #[serde(default)]
        east_m: f64,
        /// m, amplitude.
        #[serde(default)]
        height_m: f64,
        /// rad, amplitude.
        #[serde(default)]
        yaw_rad: f64,
    },
    /// A helicoid about the origin that begins at its northern point.
    Helix {
        /// s.
        duration_s: f64,
        /// m.
        radius_m: f64,
        /// s a turn.
        turn_s: f64,
        /// m, amplitude of the climb about the height where the segment begins.
        climb_m: f64,
        /// s.
        climb_period_s: f64,
    },
}

impl Segment {
    fn duration(&self) -> f64 {
        match self {
            Self::Hold { duration_s }
            | Self::Go { duration_s, .. }
            | Self::Cruise { duration_s, .. }
            | Self::Turn { duration_s, .. }
            | Self::Sine { duration_s, .. }
            | Self::Helix { duration_s, .. } => *duration_s,
        }
    }
}

/// A flight: segments one after the other; the last place is held until the end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Script {
    /// Name in reports.
    pub name: String,
    /// m above the ground at the start.
    pub start_height_m: f64,
    /// m north at the start.
    #[serde(default)]
    pub start_north_m: f64,
    /// Corner of the third-order low pass, rad/s.
    pub smoothing_rad_s: f64,
    /// Segments.
    #[serde(default)]
    pub segment: Vec<Segment>,
}

/// Where the wall stands that a case may hide (`catalogue.rs`: 7.2 m from the start), how near to it drawn waypoints lie at most, and
/// the place right before it (north, east, m) that flights visit.
const WALL_AZIMUTH_RAD: f64 = 0.3;
const FARTHEST_TO_WALL_M: f64 = 6.9;
const BEFORE_WALL_M: [f64; 2] = [6.8, 2.1];

/// A punch: the target jumps up by this much, m, within this time, s. Smoothed at 8 rad/s this requires 15 m/s² per
/// metre.
const PUNCH_M: f64 = 2.4;
const PUNCH_S: f64 = 0.1;

/// Names of the built-in flights.
pub const FLIGHTS: [&str; 4] = ["hover", "helix", "waypoint", "excitation"];

impl Script {
    /// A built-in flight; `seed` draws the places of `waypoint` and the order of `excitation`.
    pub fn built_in(name: &str, seed: u64) -> Option<Self> {
        let script = |start_height_m, start_north_m, smoothing_rad_s, segment| Self {
            name: name.to_owned(),
            start_height_m,
            start_north_m,
            smoothing_rad_s,
            segment,
        };
        match name {
            "hover" => Some(script(3.0, 0.0, 3.0, vec![])),
            "helix" => Some(script(
                5.0,
                4.0,
                3.0,
                vec![Segment::Helix {
                    duration_s: 600.0,
                    radius_m: 4.0,
                    turn_s: 12.0,
                    climb_m: 3.5,
                    climb_period_s: 30.0,
                }],
            )),
            "waypoint" => Some(script(3.0, 0.0, 8.0, waypoints(&mut Stream::new(seed, "waypoints")))),
            "excitation" => Some(script(3.0, 0.0, 8.0, excitation(&mut Stream::new(seed, "excitation")))),
            _ => None,
        }
    }

    /// The same flight after a take-off of 4 s from where it begins.
    #[must_use]
    pub fn from_the_ground(mut self) -> Self {
        let up = Segment::Go {
            duration_s: 4.0,
            north_m: self.start_north_m,
            east_m: 0.0,
            height_m: self.start_height_m,
            yaw_rad: None,
        };
        self.segment.insert(0, up);
        self.start_height_m = FOOT_DEPTH;
        self
    }

    /// Reads a script file.
    pub fn load(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| BlindError::file("reading the flight script", path, source))?;
        let script: Self =
            toml::from_str(&text).map_err(|error| BlindError::input(path.display().to_string(), error.message()))?;
        script.check(&path.display().to_string())?;
        Ok(script)
    }

    fn check(&self, place: &str) -> Result<()> {
        if !(0.05..=100.0).contains(&self.start_height_m) || !(0.2..=20.0).contains(&self.smoothing_rad_s) {
            let reason = "expected start_height_m from 0.05 to 100 and smoothing_rad_s from 0.2 to 20";
            return Err(BlindError::input(place, reason));
        }
        match self
            .segment
            .iter()
            .position(|s| !(s.duration() > 0.0 && s.duration() <= 3600.0))
        {
            None => Ok(()),
            Some(i) => {
                let reason = "expected a duration_s above 0 and at most 3600";
                Err(BlindError::input(format!("{place}: segment {}", i + 1), reason))
            }
        }
    }

    /// Seconds of all segments.
    pub fn duration(&self) -> f64 {
        self.segment.iter().map(Segment::duration).sum()
    }
}

/// Legs of 3 to 12 m flown at peak speeds of 3 to 6 m/s, with turns and climbs. Every fourth time a low pass that ends with a punch, every
/// eighth time a visit to where the drawn wall stands.
fn waypoints(random: &mut Stream) -> Vec<Segment> {
    let mut segments = vec![Segment::Hold { duration_s: 1.0 }];
    let (mut place, mut time, mut count) = ([0.0, 0.0, 3.0], 1.0, 1);
    while time < 600.0 {
        let low_pass = count % 4 == 0;
        let height = if low_pass { 0.35 } else { random.between(1.0, 6.0) };
        let (north, east) = (random.between(-7.0, 7.0), random.between(-7.0, 7.0));
        let next = if count % 8 == 2 {
            [BEFORE_WALL_M[0], BEFORE_WALL_M[1], height]
        } else {
            [north, east, height]
        };
        let level = f64::hypot(next[0] - place[0], next[1] - place[1]);
        // Before the wall, not behind it.
        let to_wall = libm::cos(WALL_AZIMUTH_RAD) * north + libm::sin(WALL_AZIMUTH_RAD) * east;
        if !(3.0..=12.0).contains(&level) || to_wall > FARTHEST_TO_WALL_M {
            // From here the wall is too near or too far: another waypoint first.
            count += usize::from(count % 8 == 2);
            continue;
        }
        let rise: f64 = (next[2] - place[2]).abs();
        // Least-jerk legs: peak speeds of at most 6 m/s level and 2.5 m/s up or down, peak acceleration of 6 m/s².
        let speed = random.between(3.5, 6.0);
        let leg_s = f64::max(1.875 * level / speed, 1.875 * rise / 2.5).max((5.77 * level / 6.0).sqrt());
        let mut go = |duration_s, [north_m, east_m, height_m]: [f64; 3], yaw_rad| {
            segments.push(Segment::Go {
                duration_s,
                north_m,
                east_m,
                height_m,
                yaw_rad,
            });
        };
        go(leg_s, next, Some(random.between(-1.4, 1.4)));
        place = next;
        let mut pause_s = random.between(0.3, 1.2);
        if low_pass {
            place[2] += PUNCH_M;
            go(PUNCH_S, place, None);
            pause_s += 1.0;
        }
        segments.push(Segment::Hold { duration_s: pause_s });
        time += leg_s + pause_s;
        count += 1;
    }
    segments
}

/// Speeds to 5.5 m/s on both axes, yaw doublets, climbs, roll-with-yaw, slow turns, low passes; a visit to where the drawn wall stands,
/// a drop at up to 4 m/s, and two punches at nearly full throttle.
fn excitation(random: &mut Stream) -> Vec<Segment> {
    let go = |duration_s, north_m, east_m, height_m| Segment::Go {
        duration_s,
        north_m,
        east_m,
        height_m,
        yaw_rad: None,
    };
    let sine = |duration_s, period_s, north_m, east_m, height_m, yaw_rad| Segment::Sine {
        duration_s,
        period_s,
        north_m,
        east_m,
        height_m,
        yaw_rad,
    };
    let stretch = random.between(0.9, 1.1);
    let side = random.sign();
    let turn = random.sign();
    let turn_at = |duration_s, yaw_rate_rad_s| Segment::Turn {
        duration_s,
        yaw_rate_rad_s,
    };
    vec![
        Segment::Hold { duration_s: 1.0 },
        sine(11.0 * stretch, 5.5 * stretch, 4.4, 0.0, 0.0, 0.0),
        sine(11.0 * stretch, 5.5 * stretch, 0.0, 4.2 * side, 0.0, 0.0),
        sine(6.0, 2.0, 0.0, 0.0, 0.0, 0.45),
        sine(4.8, 1.6, 0.0, 0.0, 0.25, 0.0),
        go(2.8, BEFORE_WALL_M[0], BEFORE_WALL_M[1], 4.0),
        go(2.8, 0.0, 0.0, 5.6),
        go(2.1, 0.0, 0.0, 1.0),
        go(2.4, 0.0, 0.0, 5.4),
        go(3.4, 0.0, 0.0, 0.4),
        sine(5.0, 2.5, 1.0, 0.0, 0.05, 0.3),
        go(PUNCH_S, 0.0, 0.0, 0.4 + PUNCH_M),
        Segment::Hold { duration_s: 1.4 },
        go(1.8, 0.0, 0.0, 0.8),
        go(PUNCH_S, 0.0, 0.0, 0.8 + PUNCH_M),
        Segment::Hold { duration_s: 1.4 },
        go(2.4, 0.0, -3.0 * side, 3.0),
        turn_at(3.0, 0.5 * turn),
        sine(9.6 * stretch, 4.8 * stretch, -2.6, 2.6 * side, 0.7, 0.0),
        turn_at(3.0, -turn),
        sine(4.8, 1.6, 0.0, 0.15, 0.0, 0.3),
        sine(4.8, 1.6, 0.15, 0.0, 0.0, 0.3),
        turn_at(3.0, 0.5 * turn),
        sine(600.0, 5.5, 4.0, 1.6, 0.6, 0.9),
    ]
}

/// 10 x³ − 15 x⁴ + 6 x⁵, 0 before and 1 after.
fn least_jerk(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (10.0 + x * (-15.0 + 6.0 * x))
}

/// The set points for the pilot at one step.
#[derive(Debug, Clone, Copy)]
pub struct Reference {
    /// m, NED.
    pub position: Vector3<f64>,
    /// m/s, NED.
    pub velocity: Vector3<f64>,
    /// m/s², NED.
    pub acceleration: Vector3<f64>,
    /// rad, not wrapped.
    pub yaw: f64,
    /// rad/s.
    pub yaw_rate: f64,
}

/// Walks through a script at a fixed step.
#[derive(Debug, Clone)]
pub struct ReferenceWalk {
    script: Script,
    segment: usize,
    since: f64,
    /// Place and heading where the segment began: north, east, height, yaw.
    base: [f64; 4],
    target: [f64; 4],
    /// Smoothed values and their first two derivatives.
    smooth: [[f64; 3]; 4],
    step: f64,
}

impl ReferenceWalk {
    /// At the start of a script, at rest.
    pub fn new(script: &Script, step: f64) -> Self {
        let base = [script.start_north_m, 0.0, script.start_height_m, 0.0];
        Self {
            script: script.clone(),
            segment: 0,
            since: 0.0,
            base,
            target: base,
            smooth: base.map(|value| [value, 0.0, 0.0]),
            step,
        }
    }

    fn target_at(&self, segment: &Segment) -> [f64; 4] {
        let b = self.base;
        let t = self.since;
        match *segment {
            Segment::Hold { .. } => b,
            Segment::Go {
                north_m,
                east_m,
                height_m,
                yaw_rad,
                ..
            } => {
                let goal = [north_m, east_m, height_m, yaw_rad.unwrap_or(b[3])];
                let share = least_jerk(t / segment.duration());
                std::array::from_fn(|k| b[k] + share * (goal[k] - b[k]))
            }
            Segment::Cruise {
                north_m_s,
                east_m_s,
                climb_m_s,
                ..
            } => [b[0] + north_m_s * t, b[1] + east_m_s * t, b[2] + climb_m_s * t, b[3]],
            Segment::Turn { yaw_rate_rad_s, .. } => [b[0], b[1], b[2], b[3] + yaw_rate_rad_s * t],
            Segment::Sine {
                period_s,
                north_m,
                east_m,
                height_m,
                yaw_rad,
                ..
            } => {
                let fade = (0.5 * period_s).min(0.4 * segment.duration());
                let envelope = least_jerk(t / fade) * least_jerk((segment.duration() - t) / fade);
                let s = envelope * libm::sin(std::f64::consts::TAU * t / period_s);
                [
                    b[0] + north_m * s,
                    b[1] + east_m * s,
                    b[2] + height_m * s,
                    b[3] + yaw_rad * s,
                ]
            }
            Segment::Helix {
                radius_m,
                turn_s,
                climb_m,
                climb_period_s,
                ..
            } => {
                let (sin, cos) = libm::sincos(std::f64::consts::TAU * t / turn_s);
                let climb = climb_m * libm::sin(std::f64::consts::TAU * t / climb_period_s);
                [radius_m * cos, radius_m * sin, b[2] + climb, b[3]]
            }
        }
    }

    /// The reference of the next step.
    pub fn advance(&mut self) -> Reference {
        if let Some(segment) = self.script.segment.get(self.segment) {
            self.target = self.target_at(segment);
            self.since += self.step;
            if self.since >= segment.duration() {
                // The next segment starts from where this one ends.
                self.base = self.target;
                self.segment += 1;
                self.since = 0.0;
            }
        }
        let w = self.script.smoothing_rad_s;
        for (axis, smooth) in self.smooth.iter_mut().enumerate() {
            // (s + w)³ x = w³ target, semi-implicit Euler.
            let jerk = w * w * w * (self.target[axis] - smooth[0]) - 3.0 * w * w * smooth[1] - 3.0 * w * smooth[2];
            smooth[2] += self.step * jerk;
            smooth[1] += self.step * smooth[2];
            smooth[0] += self.step * smooth[1];
        }
        let [n, e, h, yaw] = self.smooth;
        Reference {
            position: Vector3::new(n[0], e[0], -h[0]),
            velocity: Vector3::new(n[1], e[1], -h[1]),
            acceleration: Vector3::new(n[2], e[2], -h[2]),
            yaw: yaw[0],
            yaw_rate: yaw[1],
        }
    }
}
