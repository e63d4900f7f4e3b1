//! The vehicle and blade documents, read independently: only the numbers are shared with the product, no code.

use crate::error::{BlindError, Result};
use nalgebra::Vector3;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Deserialize)]
struct Document {
    name: String,
    body: Body,
    rotors: Rotors,
    battery: Battery,
}

#[derive(Deserialize)]
struct Body {
    mass_kg: f64,
    inertia_body_kg_m2: [f64; 3],
    gravity_m_s2: f64,
    linear_drag_kg_s: f64,
    angular_drag_nms: f64,
}

#[derive(Deserialize)]
struct Rotors {
    blades: PathBuf,
    nominal_blade: String,
    thrust_lag_s: f64,
    layout: Layout,
}

#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
enum Layout {
    RegularX {
        rotors: usize,
        arm_length_m: f64,
        moment_ratio_m: f64,
    },
    RegularPlus {
        rotors: usize,
        arm_length_m: f64,
        moment_ratio_m: f64,
    },
    List {
        rotor: Vec<ListedRotor>,
    },
}

#[derive(Deserialize)]
struct ListedRotor {
    number: usize,
    position_body_m: [f64; 3],
    spin: String,
    moment_ratio_m: f64,
}

#[derive(Deserialize)]
struct Battery {
    cells: f64,
    capacity_ah: f64,
    internal_resistance_ohm: f64,
    power_coefficient_w_per_n15: f64,
    cell_open_circuit_voltage_v: Vec<f64>,
}

#[derive(Deserialize)]
struct BladeDocument {
    blade: BTreeMap<String, Blade>,
}

#[derive(Deserialize)]
struct Blade {
    coefficients: [f64; 4],
    voltage_offset_v: f64,
}

/// One rotor.
#[derive(Debug, Clone)]
pub struct Rotor {
    /// From the nominal centre of mass, body, m.
    pub position: Vector3<f64>,
    /// Sign of the drag torque on the body about z (down): +1 for a rotor that turns counter-clockwise seen from above.
    pub yaw_sign: f64,
    /// c_D/c_L, m.
    pub moment_ratio: f64,
}

/// The nominal vehicle, as the documents describe it.
#[derive(Debug, Clone)]
pub struct Vehicle {
    /// Readable name.
    pub name: String,
    /// m, kg.
    pub mass: f64,
    /// J_x, J_y, J_z, kg m².
    pub inertia: [f64; 3],
    /// g, m/s².
    pub gravity: f64,
    /// k_t, N s/m.
    pub linear_drag: f64,
    /// k_r, N m s.
    pub angular_drag: f64,
    /// τ, s.
    pub thrust_lag: f64,
    /// Rotors in numerical order.
    pub rotors: Vec<Rotor>,
    /// a0…a3 of Eq. 19, duty in percent.
    pub blade: [f64; 4],
    /// v0 of Eq. 19, V.
    pub blade_voltage_offset: f64,
    /// Q, Ah.
    pub capacity_ah: f64,
    /// R_in, Ω.
    pub internal_resistance: f64,
    /// k_P, W/N^1.5.
    pub power_coefficient: f64,
    /// Open-circuit voltage of the pack at equidistant charges 0…1, V.
    pub open_circuit_voltage: Vec<f64>,
}

fn read<T: for<'a> Deserialize<'a>>(action: &'static str, path: &Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(|source| BlindError::file(action, path, source))?;
    toml::from_str(&text).map_err(|error| BlindError::input(path.display().to_string(), error.message()))
}

/// The file of the blade document that a vehicle document names.
///
/// # Errors
/// The vehicle document cannot be read.
pub fn blades_of(path: &Path) -> Result<PathBuf> {
    let document: Document = read("reading the vehicle document", path)?;
    Ok(beside(path, &document.rotors.blades))
}

/// A path that a document names, relative to that document.
fn beside(document: &Path, named: &Path) -> PathBuf {
    document.parent().unwrap_or(Path::new(".")).join(named)
}

impl Vehicle {
    /// Reads a vehicle document and the blade document that it names.
    pub fn load(path: &Path) -> Result<Self> {
        let document: Document = read("reading the vehicle document", path)?;
        let blades_path = beside(path, &document.rotors.blades);
        let blades: BladeDocument = read("reading the blade document", &blades_path)?;
        let blade = blades.blade.get(&document.rotors.nominal_blade).ok_or_else(|| {
            BlindError::input(
                format!("{}: rotors.nominal_blade", path.display()),
                format!(
                    "blade `{}` not found in {}",
                    document.rotors.nominal_blade,
                    blades_path.display()
                ),
            )
        })?;
        let rotors = match document.rotors.layout {
            Layout::RegularX {
                rotors,
                arm_length_m,
                moment_ratio_m,
            } => ring(rotors, 0.5, arm_length_m, moment_ratio_m),
            Layout::RegularPlus {
                rotors,
                arm_length_m,
                moment_ratio_m,
            } => ring(rotors, 0.0, arm_length_m, moment_ratio_m),
            Layout::List { mut rotor } => {
                rotor.sort_by_key(|rotor| rotor.number);
                rotor
                    .into_iter()
                    .map(|rotor| Rotor {
                        position: Vector3::from(rotor.position_body_m),
                        yaw_sign: if rotor.spin == "ccw" { 1.0 } else { -1.0 },
                        moment_ratio: rotor.moment_ratio_m,
                    })
                    .collect()
            }
        };
        if rotors.len() < 4 || document.battery.cell_open_circuit_voltage_v.len() < 2 {
            return Err(BlindError::input(
                path.display().to_string(),
                "expected at least 4 rotors and 2 knots of the open-circuit voltage",
            ));
        }
        Ok(Self {
            name: document.name,
            mass: document.body.mass_kg,
            inertia: document.body.inertia_body_kg_m2,
            gravity: document.body.gravity_m_s2,
            linear_drag: document.body.linear_drag_kg_s,
            angular_drag: document.body.angular_drag_nms,
            thrust_lag: document.rotors.thrust_lag_s,
            rotors,
            blade: blade.coefficients,
            blade_voltage_offset: blade.voltage_offset_v,
            capacity_ah: document.battery.capacity_ah,
            internal_resistance: document.battery.internal_resistance_ohm,
            power_coefficient: document.battery.power_coefficient_w_per_n15,
            open_circuit_voltage: document
                .battery
                .cell_open_circuit_voltage_v
                .iter()
                .map(|cell| cell * document.battery.cells)
                .collect(),
        })
    }

    /// Static thrust of one rotor at a duty of 0…1 and a voltage, N (Eq. 19), never negative.
    #[inline]
    pub fn static_thrust(&self, duty: f64, voltage: f64) -> f64 {
        let percent = 100.0 * duty.clamp(0.0, 1.0);
        let [a0, a1, a2, a3] = self.blade;
        // Horner's form, another order of operations than the product's.
        let shape = a0 * percent.sqrt() + percent * (a1 + percent * (a2 + percent * a3));
        ((voltage - self.blade_voltage_offset) * shape).max(0.0)
    }

    /// At half charge, without a current, V.
    pub fn resting_voltage(&self) -> f64 {
        let chart = &self.open_circuit_voltage;
        let (middle, odd) = (chart.len() / 2, chart.len() % 2 == 1);
        if odd {
            chart[middle]
        } else {
            0.5 * (chart[middle - 1] + chart[middle])
        }
    }

    /// What hover draws at the resting voltage, A.
    pub fn hover_current(&self) -> f64 {
        let power = self.power_coefficient * self.hover_thrust().powf(1.5) * self.rotors.len() as f64;
        power / self.resting_voltage()
    }

    /// Thrust of each rotor in hover, N.
    pub fn hover_thrust(&self) -> f64 {
        self.mass * self.gravity / self.rotors.len() as f64
    }
}

fn ring(count: usize, shift: f64, arm: f64, moment_ratio: f64) -> Vec<Rotor> {
    (0..count)
        .map(|i| {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * (i as f64 + shift) / count as f64);
            Rotor {
                position: Vector3::new(arm * cos, arm * sin, 0.0),
                yaw_sign: if i % 2 == 0 { 1.0 } else { -1.0 },
                moment_ratio,
            }
        })
        .collect()
}
