//! Vehicle document: the vehicle as controller and detector assume it, from which the plant starts.
//!
//! `config/vehicles/*.toml`. A vehicle names its blade document by a path relative to its own.

use std::f64::consts::PI;

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::frames::Vec3;
use rotortwin_flight_core::geometry::{Geometry, Rotor, Spin};
use serde::{Deserialize, Serialize};

use crate::body::ground::LandingGear;
use crate::error::{Refusal, all_in_range, in_range};
use crate::powertrain::battery::BatteryModel;
use crate::powertrain::blades::BladeSet;
use crate::powertrain::motor::MotorModel;
use crate::vector::Vector3;

/// A vehicle document.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleModel {
    /// Readable name.
    pub name: String,
    /// Where the numbers come from.
    pub description: String,
    /// Mass properties and friction.
    pub body: Body,
    /// Rotors and their powertrain.
    pub rotors: Rotors,
    /// Battery.
    pub battery: BatteryModel,
    /// Feet; needed where a scenario's ground carries the vehicle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub landing_gear: Option<LandingGear>,
}

/// `[body]`: mass properties and friction (Eq. 1).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// m, kg.
    pub mass_kg: f64,
    /// J_x, J_y, J_z, kg·m², body.
    pub inertia_body_kg_m2: [f64; 3],
    /// g, m/s².
    pub gravity_m_s2: f64,
    /// k_t, kg/s.
    pub linear_drag_kg_s: f64,
    /// k_r, N·m·s.
    pub angular_drag_nms: f64,
}

/// `[rotors]`: layout and powertrain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rotors {
    /// Path of the blade document, relative to the vehicle document.
    pub blades: String,
    /// Blade that every healthy rotor carries, a name in the blade document.
    pub nominal_blade: String,
    /// τ, s: first-order lag of the thrust.
    pub thrust_lag_s: f64,
    /// Thrust that a linear map from thrust to duty assumes at full duty, N.
    pub full_thrust_n: f64,
    /// λ, s: a rotor that speeds up turns the vehicle, N = Σ s_i c_i (f_i + λ f_i'). At the hover thrust f_h it is that of a rotor with an
    /// inertia of 2 c λ f_h/Ω_h. 0 where it is not known.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub reaction_s: f64,
    /// k_d, kg/s: drag of all rotors together across their axis, F_xy = −k_d (Σ Ω_i/(n Ω_h)) v_a,xy, in addition to the
    /// drag of the body, which acts along all axes. 0 where the two are not distinguished.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub drag_kg_s: f64,
    /// R, m: of the propellers. Absent: from the hover thrust, at the disc loading of the F550.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_m: Option<f64>,
    /// Ω_h, rad/s: speed of a rotor that carries its share of the weight. Absent: from the hover thrust, at the tip speed
    /// of the F550.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hover_speed_rad_s: Option<f64>,
    /// ESC and motor, which turn the plant's rotors in place of Eq. 19 and its lag. Controllers, detectors and the twin
    /// still assume Eq. 19, as the paper's do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motor: Option<MotorModel>,
    /// Where the rotors are.
    pub layout: Layout,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands out references")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// Rotor layout.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Layout {
    /// Equal arms at equal angles, the first rotor half an angle to the right of the nose, then clockwise seen from above; rotor 1
    /// turns counter-clockwise, the next the other way.
    RegularX {
        /// Even number of rotors.
        rotors: u32,
        /// l, m.
        arm_length_m: f64,
        /// c_D/c_L, m.
        moment_ratio_m: f64,
    },
    /// As `regular-x` with the first rotor ahead of the nose.
    RegularPlus {
        /// Even number of rotors.
        rotors: u32,
        /// l, m.
        arm_length_m: f64,
        /// c_D/c_L, m.
        moment_ratio_m: f64,
    },
    /// Any layout.
    List {
        /// One entry per rotor, in any order.
        rotor: Vec<ListedRotor>,
    },
}

/// One rotor of [`Layout::List`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ListedRotor {
    /// From 1, each number once.
    pub number: u32,
    /// m, body, from the centre of mass.
    pub position_body_m: [f64; 3],
    /// Rotation sense, seen from above.
    pub spin: SpinDirection,
    /// c_D/c_L, m.
    pub moment_ratio_m: f64,
}

/// Direction in which a rotor turns, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SpinDirection {
    /// Counter-clockwise: pushes the nose to the right.
    Ccw,
    /// Clockwise: pushes the nose to the left.
    Cw,
}

/// One rotor in f64: used by the plant where `flight-core` has its f32 `Rotor`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotorPlacement {
    /// m, body.
    pub position_body: Vector3,
    /// Rotation sense, seen from above.
    pub spin: SpinDirection,
    /// c_D/c_L, m.
    pub moment_ratio: f64,
}

impl RotorPlacement {
    /// Torque per newton of thrust about a centre of mass at `centre`, m, body: rows Mx, My, Mz of F in Eq. 6, with the moment
    /// ratio scaled by `moment_ratio_factor`.
    pub fn torque_arm(&self, centre: Vector3, moment_ratio_factor: f64) -> Vector3 {
        let ratio = self.moment_ratio * moment_ratio_factor;
        let yaw = if self.spin == SpinDirection::Ccw { ratio } else { -ratio };
        [
            -(self.position_body[1] - centre[1]),
            self.position_body[0] - centre[0],
            yaw,
        ]
    }
}

impl Layout {
    /// Moments about the body axes per newton of each rotor's thrust, m, the centre of mass in the origin.
    pub fn torque_arms(&self) -> Vec<Vector3> {
        let placements = self.placements();
        placements.iter().map(|rotor| rotor.torque_arm([0.0; 3], 1.0)).collect()
    }

    /// The rotors in the order of their numbers.
    pub fn placements(&self) -> Vec<RotorPlacement> {
        match self {
            Self::RegularX {
                rotors,
                arm_length_m,
                moment_ratio_m,
            } => regular(*rotors, *arm_length_m, *moment_ratio_m, PI / f64::from(*rotors)),
            Self::RegularPlus {
                rotors,
                arm_length_m,
                moment_ratio_m,
            } => regular(*rotors, *arm_length_m, *moment_ratio_m, 0.0),
            Self::List { rotor } => {
                let mut listed: Vec<&ListedRotor> = rotor.iter().collect();
                listed.sort_by_key(|r| r.number);
                listed
                    .iter()
                    .map(|r| RotorPlacement {
                        position_body: r.position_body_m,
                        spin: r.spin,
                        moment_ratio: r.moment_ratio_m,
                    })
                    .collect()
            }
        }
    }

    fn check(&self) -> Result<(), Refusal> {
        match self {
            Self::RegularX {
                rotors,
                arm_length_m,
                moment_ratio_m,
            }
            | Self::RegularPlus {
                rotors,
                arm_length_m,
                moment_ratio_m,
            } => {
                if !(4..=MAX_ROTORS as u32).contains(rotors) || rotors % 2 != 0 {
                    let reason = format!("expected an even number of rotors from 4 to {MAX_ROTORS}, got {rotors}");
                    return Err(Refusal::new("rotors", reason));
                }
                in_range("arm_length_m", *arm_length_m, 0.02, 5.0, "m")?;
                in_range("moment_ratio_m", *moment_ratio_m, 1e-4, 0.5, "m")
            }
            Self::List { rotor } => {
                if !(4..=MAX_ROTORS).contains(&rotor.len()) {
                    let reason = format!("expected 4 to {MAX_ROTORS} rotors, got {}", rotor.len());
                    return Err(Refusal::new("rotor", reason));
                }
                let mut seen = [false; MAX_ROTORS];
                for (i, r) in rotor.iter().enumerate() {
                    let key = |name: &str| format!("rotor[{i}].{name}");
                    if !(1..=rotor.len()).contains(&(r.number as usize)) {
                        let reason = format!("expected a number from 1 to {}, got {}", rotor.len(), r.number);
                        return Err(Refusal::new(key("number"), reason));
                    }
                    if std::mem::replace(&mut seen[r.number as usize - 1], true) {
                        let reason = format!("expected each rotor once, rotor {} is given twice", r.number);
                        return Err(Refusal::new(key("number"), reason));
                    }
                    all_in_range(&key("position_body_m"), &r.position_body_m, -5.0, 5.0, "m")?;
                    in_range(&key("moment_ratio_m"), r.moment_ratio_m, 1e-4, 0.5, "m")?;
                }
                Ok(())
            }
        }
    }
}

fn regular(rotors: u32, arm_length: f64, moment_ratio: f64, offset: f64) -> Vec<RotorPlacement> {
    (0..rotors)
        .map(|i| {
            let (sin, cos) = libm::sincos(offset + 2.0 * PI * f64::from(i) / f64::from(rotors));
            RotorPlacement {
                position_body: [arm_length * cos, arm_length * sin, 0.0],
                spin: if i % 2 == 0 {
                    SpinDirection::Ccw
                } else {
                    SpinDirection::Cw
                },
                moment_ratio,
            }
        })
        .collect()
}

/// f32 geometry of the flight code for these rotors, or the reason why they cannot fly.
pub fn geometry(placements: &[RotorPlacement]) -> Result<Geometry, String> {
    let rotors: Vec<Rotor> = placements
        .iter()
        .map(|p| Rotor {
            position_body: Vec3::from_array(p.position_body.map(|x| x as f32)),
            spin: if p.spin == SpinDirection::Ccw {
                Spin::Ccw
            } else {
                Spin::Cw
            },
            moment_ratio: p.moment_ratio as f32,
        })
        .collect();
    Geometry::new(&rotors).map_err(|error| error.to_string())
}

impl VehicleModel {
    /// Number of rotors.
    pub fn rotor_count(&self) -> usize {
        match &self.rotors.layout {
            Layout::RegularX { rotors, .. } | Layout::RegularPlus { rotors, .. } => *rotors as usize,
            Layout::List { rotor } => rotor.len(),
        }
    }

    /// Rejects what cannot fly with these blades; keys are those of the vehicle document.
    pub fn check(&self, blades: &BladeSet) -> Result<(), Refusal> {
        self.check_body().map_err(|r| r.under("body"))?;
        self.check_rotors(blades).map_err(|r| r.under("rotors"))?;
        self.battery.check().map_err(|r| r.under("battery"))?;
        let gear = self.landing_gear.as_ref();
        gear.map_or(Ok(()), |gear| gear.check().map_err(|r| r.under("landing_gear")))
    }

    fn check_body(&self) -> Result<(), Refusal> {
        let body = &self.body;
        in_range("mass_kg", body.mass_kg, 0.02, 200.0, "kg")?;
        all_in_range("inertia_body_kg_m2", &body.inertia_body_kg_m2, 1e-6, 100.0, "kg·m²")?;
        let [x, y, z] = body.inertia_body_kg_m2;
        if x > y + z || y > x + z || z > x + y {
            let reason =
                format!("expected moments of inertia of which none exceeds the sum of the others, got {x}, {y}, {z}");
            return Err(Refusal::new("inertia_body_kg_m2", reason));
        }
        in_range("gravity_m_s2", body.gravity_m_s2, 0.1, 30.0, "m/s²")?;
        in_range("linear_drag_kg_s", body.linear_drag_kg_s, 0.0, 10.0, "kg/s")?;
        in_range("angular_drag_nms", body.angular_drag_nms, 0.0, 1.0, "N·m·s")
    }

    fn check_rotors(&self, blades: &BladeSet) -> Result<(), Refusal> {
        let rotors = &self.rotors;
        // Below 5 ms a step of 2.5 ms would not resolve the lag.
        in_range("thrust_lag_s", rotors.thrust_lag_s, 0.005, 1.0, "s")?;
        in_range("full_thrust_n", rotors.full_thrust_n, 0.01, 2000.0, "N")?;
        in_range("reaction_s", rotors.reaction_s, 0.0, 1.0, "s")?;
        in_range("drag_kg_s", rotors.drag_kg_s, 0.0, 10.0, "kg/s")?;
        if let Some(radius_m) = rotors.radius_m {
            in_range("radius_m", radius_m, 0.005, 5.0, "m")?;
        }
        if let Some(speed) = rotors.hover_speed_rad_s {
            in_range("hover_speed_rad_s", speed, 10.0, 10_000.0, "rad/s")?;
        }
        if let Some(motor) = &rotors.motor {
            motor.check().map_err(|r| r.under("motor"))?;
            if rotors.reaction_s != 0.0 {
                let reason = "expected 0 together with `motor`, whose inertia already turns the vehicle";
                return Err(Refusal::new("reaction_s", reason));
            }
        }
        rotors.layout.check().map_err(|r| r.under("layout"))?;
        if !blades.blade.contains_key(&rotors.nominal_blade) {
            let names = blades.names().collect::<Vec<_>>().join(", ");
            let reason = format!("expected one of the blades {names}, got {}", rotors.nominal_blade);
            return Err(Refusal::new("nominal_blade", reason));
        }
        let factor = blades.blade[&rotors.nominal_blade].moment_ratio_factor;
        if factor != 1.0 {
            let reason = format!(
                "expected a blade with a moment_ratio_factor of 1, because moment_ratio_m is the ratio with the nominal blade; {} has {factor}",
                rotors.nominal_blade
            );
            return Err(Refusal::new("nominal_blade", reason));
        }
        geometry(&rotors.layout.placements()).map_err(|reason| Refusal::new("layout", reason))?;
        Ok(())
    }
}
