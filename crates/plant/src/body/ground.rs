//! The ground of a scenario: an inclined plane, how feet press on it and rub along it, and what goes wrong on it.

use serde::{Deserialize, Serialize};

use crate::body::rigid_body::Quaternion;
use crate::error::{Refusal, in_range};
use crate::vector::Vector3;

/// `[ground.contact]` of a scenario: the ground carries the vehicle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GroundContact {
    /// µ: Coulomb friction, static and sliding alike.
    pub friction: f64,
    /// Depth to which the vehicle's weight presses its feet into the ground, m: sets the stiffness, k = m g/(feet · sink).
    pub sink_m: f64,
    /// Damping of the vehicle on its feet at rest, share of the critical one.
    pub damping_ratio: f64,
    /// Angle of the ground with the horizontal, degrees.
    pub slope_deg: f64,
    /// Direction in which the ground falls, degrees clockwise from north.
    pub downhill_deg: f64,
    /// Touching down faster than this, m/s along the normal, is a hard landing.
    pub hard_landing_m_s: f64,
}

impl Default for GroundContact {
    fn default() -> Self {
        Self {
            friction: 0.8,
            sink_m: 0.001,
            damping_ratio: 0.5,
            slope_deg: 0.0,
            downhill_deg: 0.0,
            hard_landing_m_s: 1.5,
        }
    }
}

impl GroundContact {
    /// Rejects an invalid ground, or one that steps of 0.5 ms cannot resolve.
    pub fn check(&self) -> Result<(), Refusal> {
        in_range("friction", self.friction, 0.0, 2.0, "")?;
        in_range("sink_m", self.sink_m, 2e-4, 0.02, "m")?;
        in_range("damping_ratio", self.damping_ratio, 0.05, 2.0, "")?;
        in_range("slope_deg", self.slope_deg, 0.0, 45.0, "degrees")?;
        in_range("downhill_deg", self.downhill_deg, -360.0, 360.0, "degrees")?;
        in_range("hard_landing_m_s", self.hard_landing_m_s, 0.05, 50.0, "m/s")
    }

    /// Height of a point, m, NED, over the ground below it, which lies at `down_m` below the origin.
    pub fn height(&self, down_m: f64, position_ned_m: [f64; 3]) -> f64 {
        Plane::new(down_m, self).at(position_ned_m[0], position_ned_m[1])[2] - position_ned_m[2]
    }
}

/// `[landing_gear]` of a vehicle document.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LandingGear {
    /// Points that touch the ground, m, body, from the centre of mass.
    pub feet_body_m: Vec<[f64; 3]>,
}

/// Most feet of a vehicle.
const MOST_FEET: usize = 16;

impl LandingGear {
    /// Refuses feet on which nothing can stand: above the centre of mass, or without an area around it.
    pub fn check(&self) -> Result<(), Refusal> {
        let feet = &self.feet_body_m;
        if !(3..=MOST_FEET).contains(&feet.len()) {
            let reason = format!("expected 3 to {MOST_FEET} feet, got {}", feet.len());
            return Err(Refusal::new("feet_body_m", reason));
        }
        for (i, foot) in feet.iter().enumerate() {
            for (axis, &value) in foot.iter().enumerate() {
                let least = if axis == 2 { 0.001 } else { -5.0 };
                in_range(&format!("feet_body_m[{i}][{axis}]"), value, least, 5.0, "m")?;
            }
        }
        if stands(feet) {
            return Ok(());
        }
        let reason = "expected feet around the centre of mass: seen from above it is not between them";
        Err(Refusal::new("feet_body_m", reason))
    }
}

/// True if the origin lies inside of the hull of the points, seen from above: no half-plane through it holds them all.
fn stands(feet: &[[f64; 3]]) -> bool {
    let mut azimuths: Vec<f64> = feet.iter().map(|f| libm::atan2(f[1], f[0])).collect();
    azimuths.sort_by(f64::total_cmp);
    let turn = 2.0 * std::f64::consts::PI;
    let gaps = azimuths.windows(2).map(|pair| pair[1] - pair[0]);
    let last = azimuths[0] + turn - azimuths[azimuths.len() - 1];
    let widest = gaps.fold(last, f64::max);
    let apart = feet.iter().all(|f| f[0] * f[0] + f[1] * f[1] > 1e-6);
    apart && widest < 0.5 * turn - 1e-6
}

/// A plane through a point below the origin.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane {
    /// Unit vector out of the ground, NED.
    pub(crate) normal: Vector3,
    down: f64,
    slope: f64,
    downhill: f64,
}

impl Plane {
    pub(crate) fn new(down: f64, contact: &GroundContact) -> Self {
        let (slope, downhill) = (contact.slope_deg.to_radians(), contact.downhill_deg.to_radians());
        let ((sin, cos), (east, north)) = (libm::sincos(slope), libm::sincos(downhill));
        Self {
            normal: [sin * north, sin * east, -cos],
            down,
            slope,
            downhill,
        }
    }

    /// How deep a point lies in the ground, m along the normal; negative above it.
    #[inline]
    pub(crate) fn depth(&self, point: Vector3) -> f64 {
        let [x, y, z] = self.normal;
        -(point[0] * x + point[1] * y + (point[2] - self.down) * z)
    }

    /// The point of the ground below or above (north, east), m, NED.
    pub(crate) fn at(&self, north: f64, east: f64) -> Vector3 {
        let [x, y, z] = self.normal;
        [north, east, self.down - (north * x + east * y) / z]
    }

    /// Attitude of a body that stands on the plane with this heading, rad.
    pub(crate) fn standing(&self, yaw: f64) -> Quaternion {
        let ((tilt, w), (east, north)) = (libm::sincos(0.5 * self.slope), libm::sincos(self.downhill));
        let (z, c) = libm::sincos(0.5 * yaw);
        // (w, tilt · (sin β, −cos β, 0)) ⊗ (c, 0, 0, z)
        let (x, y) = (tilt * east, -tilt * north);
        Quaternion([w * c, x * c + y * z, y * c - x * z, w * z])
    }
}

/// Something that happened on the ground and that a pilot would have avoided.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GroundEvent {
    /// Touched down too fast.
    HardLanding {
        /// Along the normal, m/s.
        speed_m_s: f64,
    },
    /// Lies on its side or back.
    TipOver {
        /// Between the body's axis and the normal, rad.
        tilt_rad: f64,
    },
    /// A rotor's disc reached the ground.
    RotorStrike {
        /// From 0.
        rotor: usize,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_vehicle_stands_on_feet_around_its_centre() {
        let square = [[0.1, 0.1, 0.2], [-0.1, 0.1, 0.2], [-0.1, -0.1, 0.2], [0.1, -0.1, 0.2]];
        assert!(stands(&square));
        let ahead = square.map(|[x, y, z]| [x + 0.2, y, z]);
        assert!(!stands(&ahead));
    }

    #[test]
    fn val_standing_on_a_slope_the_body_axis_is_the_normal() {
        for downhill_deg in [0.0, 37.0, 180.0, 250.0] {
            let contact = GroundContact {
                slope_deg: 25.0,
                downhill_deg,
                ..GroundContact::default()
            };
            let plane = Plane::new(3.0, &contact);
            for yaw in [0.0, 1.0, -2.5] {
                let down = plane.standing(yaw).down_axis();
                for axis in 0..3 {
                    assert!((down[axis] + plane.normal[axis]).abs() < 1e-12);
                }
            }
            assert!(plane.depth(plane.at(12.0, -7.0)).abs() < 1e-12);
            // Downhill is where the ground is deeper.
            let (east, north) = downhill_deg.to_radians().sin_cos();
            assert!(plane.at(north, east)[2] > 3.4);
        }
    }
}
