//! Trajectories: the reference to follow, as a function of time.
//!
//! The position reference is given in closed form; the velocity reference is its backward difference at 400 Hz, its first sample
//! repeating the second, as in the reference vectors. No acceleration is fed forward.

use rotortwin_flight_core::frames::Vec3;
use rotortwin_flight_core::signals::Reference;
use serde::{Deserialize, Serialize};

use crate::STEP_RATE_HZ;
use crate::error::{Refusal, all_in_range, in_range};
use crate::vector::Vector3;

const TURN: f64 = 2.0 * std::f64::consts::PI;

/// `[trajectory]` of a scenario. Heights are above the origin: z = −height.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Trajectory {
    /// Stay at one place.
    Hover {
        /// m, NED.
        position_ned_m: [f64; 3],
        /// ψ_r, rad.
        #[serde(default)]
        yaw_rad: f64,
    },
    /// A helicoid that climbs and sinks in turn: x = R cos(2πt/T), y = R sin(2πt/T), height = h₀ + A (1 − cos(2πt/T_A)),
    /// ψ_r = Y sin(2πt/T_Y).
    Helix {
        /// R, m.
        radius_m: f64,
        /// T, s for one turn.
        turn_s: f64,
        /// h₀, m: lowest height.
        start_height_m: f64,
        /// A, m: half of the climb.
        climb_amplitude_m: f64,
        /// T_A, s.
        climb_period_s: f64,
        /// Y, rad.
        #[serde(default)]
        yaw_amplitude_rad: f64,
        /// T_Y, s.
        #[serde(default = "thirty_seconds")]
        yaw_period_s: f64,
    },
    /// A new point at a fixed interval, approached from the previous one in a straight line at constant speed.
    Waypoints {
        /// m, NED; the flight starts at the first and stays at the last.
        points_ned_m: Vec<[f64; 3]>,
        /// s from one point's call to the next.
        interval_s: f64,
        /// m/s on each leg.
        speed_m_s: f64,
        /// ψ_r, rad.
        #[serde(default)]
        yaw_rad: f64,
    },
}

fn thirty_seconds() -> f64 {
    30.0
}

impl Trajectory {
    /// Rejects a trajectory that cannot be followed.
    pub fn check(&self) -> Result<(), Refusal> {
        let position = |key: &str, p: &[f64]| all_in_range(key, p, -10_000.0, 10_000.0, "m");
        match self {
            Self::Hover {
                position_ned_m,
                yaw_rad,
            } => {
                position("position_ned_m", position_ned_m)?;
                in_range("yaw_rad", *yaw_rad, -3.2, 3.2, "rad")
            }
            Self::Helix {
                radius_m,
                turn_s,
                start_height_m,
                climb_amplitude_m,
                climb_period_s,
                yaw_amplitude_rad,
                yaw_period_s,
            } => {
                in_range("radius_m", *radius_m, 0.0, 1000.0, "m")?;
                in_range("turn_s", *turn_s, 1.0, 3600.0, "s")?;
                in_range("start_height_m", *start_height_m, -10_000.0, 10_000.0, "m")?;
                in_range("climb_amplitude_m", *climb_amplitude_m, 0.0, 1000.0, "m")?;
                in_range("climb_period_s", *climb_period_s, 1.0, 3600.0, "s")?;
                in_range("yaw_amplitude_rad", *yaw_amplitude_rad, 0.0, 3.2, "rad")?;
                in_range("yaw_period_s", *yaw_period_s, 1.0, 3600.0, "s")
            }
            Self::Waypoints {
                points_ned_m,
                interval_s,
                speed_m_s,
                yaw_rad,
            } => {
                in_range("interval_s", *interval_s, 0.1, 3600.0, "s")?;
                in_range("speed_m_s", *speed_m_s, 0.01, 50.0, "m/s")?;
                in_range("yaw_rad", *yaw_rad, -3.2, 3.2, "rad")?;
                if points_ned_m.is_empty() || points_ned_m.len() > 10_000 {
                    return Err(Refusal::new("points_ned_m", "expected 1 to 10000 points"));
                }
                for (i, point) in points_ned_m.iter().enumerate() {
                    position(&format!("points_ned_m[{i}]"), point)?;
                }
                let reach = interval_s * speed_m_s;
                match points_ned_m
                    .windows(2)
                    .position(|leg| length(difference(leg[1], leg[0])) > reach)
                {
                    None => Ok(()),
                    Some(i) => Err(Refusal::new(
                        format!("points_ned_m[{}]", i + 1),
                        format!(
                            "expected a point at most {reach} m from the one before (interval times speed), got {} m",
                            length(difference(points_ned_m[i + 1], points_ned_m[i]))
                        ),
                    )),
                }
            }
        }
    }

    /// p_r, m, NED, and ψ_r, rad, at time `t` in s.
    pub fn pose(&self, t: f64) -> (Vector3, f64) {
        match self {
            Self::Hover {
                position_ned_m,
                yaw_rad,
            } => (*position_ned_m, *yaw_rad),
            Self::Helix {
                radius_m,
                turn_s,
                start_height_m,
                climb_amplitude_m,
                climb_period_s,
                yaw_amplitude_rad,
                yaw_period_s,
            } => {
                let (sin, cos) = libm::sincos(TURN * t / turn_s);
                let climb = 1.0 - libm::cos(TURN * t / climb_period_s);
                let yaw = yaw_amplitude_rad * libm::sin(TURN * t / yaw_period_s);
                (
                    [
                        radius_m * cos,
                        radius_m * sin,
                        -start_height_m - climb_amplitude_m * climb,
                    ],
                    yaw,
                )
            }
            Self::Waypoints {
                points_ned_m,
                interval_s,
                speed_m_s,
                yaw_rad,
            } => {
                let leg = ((t / interval_s) as usize).min(points_ned_m.len() - 1);
                let target = points_ned_m[leg];
                let start = points_ned_m[leg.saturating_sub(1)];
                let way = difference(target, start);
                let distance = length(way);
                let flown = speed_m_s * (t - leg as f64 * interval_s);
                if flown >= distance {
                    return (target, *yaw_rad);
                }
                ([0, 1, 2].map(|i| start[i] + way[i] * (flown / distance)), *yaw_rad)
            }
        }
    }
}

fn difference(a: Vector3, b: Vector3) -> Vector3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn length(v: Vector3) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

/// The reference of one step and the state that the next one needs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ReferencePoint {
    previous: Vector3,
    now: Reference,
}

/// The reference of each step in turn.
#[derive(Debug, Clone)]
pub(crate) struct ReferenceGenerator {
    trajectory: Trajectory,
    previous: Vector3,
    pub(crate) now: Reference,
}

impl ReferenceGenerator {
    /// The generator at step 0.
    pub(crate) fn new(trajectory: Trajectory) -> Self {
        let (first, _) = trajectory.pose(0.0);
        let mut generator = Self {
            trajectory,
            previous: first,
            now: Reference::default(),
        };
        generator.advance(1);
        let velocity_ned = generator.now.velocity_ned;
        generator.advance(0);
        generator.now.velocity_ned = velocity_ned;
        generator
    }

    pub(crate) fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    /// Where it is.
    #[inline]
    pub(crate) fn point(&self) -> ReferencePoint {
        ReferencePoint {
            previous: self.previous,
            now: self.now,
        }
    }

    /// Moves to where a generator of the same trajectory is.
    #[inline]
    pub(crate) fn set_point(&mut self, point: &ReferencePoint) {
        self.previous = point.previous;
        self.now = point.now;
    }

    /// Moves to `step`, one after the step before.
    pub(crate) fn advance(&mut self, step: u64) {
        let (position, yaw) = self.trajectory.pose(step as f64 / STEP_RATE_HZ);
        let velocity = difference(position, self.previous).map(|d| (d * STEP_RATE_HZ) as f32);
        self.previous = position;
        self.now = Reference {
            position_ned: Vec3::from_array(position.map(|p| p as f32)),
            velocity_ned: Vec3::from_array(velocity),
            yaw: yaw as f32,
        };
    }
}
