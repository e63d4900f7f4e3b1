//! Mismatch: how far the true vehicle is from the document that controller and detector assume.
//!
//! The preset `paper` draws the lift bias of each rotor and nothing else (§6). `realistic` adds typical errors of a
//! vehicle outdoors; it is this project's own draw, not the paper's. Every magnitude can be overridden by a key of
//! `[mismatch]`. Each parameter is uniform in ± its magnitude and comes from a random stream of its own.
//!
//! The presets are those of a vehicle of some kilograms. Their forces, torques, lengths and drag are bounded by shares of the
//! vehicle's own weight and size ([`Size`]), so that a vehicle of some grams does not tumble from errors of another's
//! size. The bounds are three or more times the values of the paper's hexarotor (twice, for the lift bias), so no bit
//! of its flights depends on them. Values given in the scenario are used unchanged.

use rotortwin_flight_core::MAX_ROTORS;
use serde::{Deserialize, Serialize};

use crate::body::environment::Disturbance;
use crate::error::{Refusal, in_range};
use crate::random::RandomStream;
use crate::vector::Vector3;
use crate::vehicle::model::{RotorPlacement, VehicleModel};

/// Starting point of the magnitudes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MismatchPreset {
    /// The true vehicle is the document.
    None,
    /// Lift bias ±10.756 mN per rotor (§6, the fit's RMSE).
    #[default]
    Paper,
    /// `paper` and: lag ±20 %, mass ±2 %, inertia ±5 %, moment ratio ±15 %, rotor gain ±0.5 %, centre of mass ±3 mm, voltage bias
    /// ±50 mV and noise 20 mV, disturbance 0.5 N and 2 mN·m rms (2 s), drag 0.05 kg/s.
    Realistic,
}

/// `[mismatch]` of a scenario; an absent key keeps the preset's magnitude.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MismatchModel {
    /// Preset that gives the absent keys.
    pub preset: MismatchPreset,
    /// ±, N, each rotor: constant added to the static lift.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotor_bias_n: Option<f64>,
    /// ±, fraction, each rotor: relative error of Eq. 19.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotor_gain: Option<f64>,
    /// ±, fraction, common to all rotors: error of the lag τ.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub thrust_lag: Option<f64>,
    /// ±, fraction: error of the mass.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    /// ±, fraction, each axis: error of the inertia.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inertia: Option<f64>,
    /// ±, fraction, common to all rotors: error of c_D/c_L.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moment_ratio: Option<f64>,
    /// ±, m, each body axis: offset of the centre of mass.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub centre_of_mass_m: Option<f64>,
    /// ±, V: constant error of the voltage measurement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub battery_voltage_bias_v: Option<f64>,
    /// Standard deviation, V, of the voltage noise; not drawn. Adds in quadrature to that of `[sensors]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub battery_voltage_noise_v: Option<f64>,
    /// Rms per NED axis, N, of the disturbance force; not drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub disturbance_force_rms_n: Option<f64>,
    /// Rms per body axis, N·m, of the disturbance torque; not drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub disturbance_torque_rms_nm: Option<f64>,
    /// Correlation time of both, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub disturbance_correlation_s: Option<f64>,
    /// Added to the vehicle's k_t, kg/s; not drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub linear_drag_kg_s: Option<f64>,
}

/// The magnitudes in force: preset and overrides joined. Units and meaning as in [`MismatchModel`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[expect(missing_docs, reason = "the fields are those of MismatchModel")]
pub struct MismatchMagnitudes {
    pub rotor_bias_n: f64,
    pub rotor_gain: f64,
    pub thrust_lag: f64,
    pub mass: f64,
    pub inertia: f64,
    pub moment_ratio: f64,
    pub centre_of_mass_m: f64,
    pub battery_voltage_bias_v: f64,
    pub battery_voltage_noise_v: f64,
    pub disturbance_force_rms_n: f64,
    pub disturbance_torque_rms_nm: f64,
    pub disturbance_correlation_s: f64,
    pub linear_drag_kg_s: f64,
}

impl MismatchMagnitudes {
    const NONE: Self = Self {
        rotor_bias_n: 0.0,
        rotor_gain: 0.0,
        thrust_lag: 0.0,
        mass: 0.0,
        inertia: 0.0,
        moment_ratio: 0.0,
        centre_of_mass_m: 0.0,
        battery_voltage_bias_v: 0.0,
        battery_voltage_noise_v: 0.0,
        disturbance_force_rms_n: 0.0,
        disturbance_torque_rms_nm: 0.0,
        disturbance_correlation_s: 2.0,
        linear_drag_kg_s: 0.0,
    };
    const PAPER: Self = Self {
        rotor_bias_n: 0.010756,
        ..Self::NONE
    };
    const REALISTIC: Self = Self {
        rotor_gain: 0.005,
        thrust_lag: 0.20,
        mass: 0.02,
        inertia: 0.05,
        moment_ratio: 0.15,
        centre_of_mass_m: 0.003,
        battery_voltage_bias_v: 0.050,
        battery_voltage_noise_v: 0.020,
        disturbance_force_rms_n: 0.5,
        disturbance_torque_rms_nm: 0.002,
        linear_drag_kg_s: 0.05,
        ..Self::PAPER
    };
}

/// What the bounds of the presets are taken from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Size {
    /// Weight m g, N.
    pub weight_n: f64,
    /// Rotors that carry it.
    pub rotor_count: usize,
    /// Distance of the farthest rotor from the body's z axis, m.
    pub arm_m: f64,
    /// Mass, kg.
    pub mass_kg: f64,
}

impl Size {
    /// Largest lift bias of a rotor that a preset gives, share of the rotor's hover thrust. The paper's hexarotor has 0.44 %.
    const ROTOR_BIAS_SHARE: f64 = 0.01;
    /// Largest disturbance force, share of the weight. The paper's hexarotor has 3.4 %.
    const FORCE_SHARE: f64 = 0.10;
    /// Largest disturbance torque, share of weight times arm. The paper's hexarotor has 0.05 %.
    const TORQUE_SHARE: f64 = 0.0015;
    /// Largest offset of the centre of mass, share of the arm. The paper's hexarotor has 1.1 %.
    const CENTRE_SHARE: f64 = 0.035;
    /// Largest added drag over the mass, 1/s. The paper's hexarotor has 0.033.
    const DRAG_OVER_MASS_1_S: f64 = 0.10;

    /// Of a vehicle.
    pub fn of(vehicle: &VehicleModel) -> Self {
        let arms = vehicle.rotors.layout.placements();
        let arm = |placement: &RotorPlacement| libm::hypot(placement.position_body[0], placement.position_body[1]);
        Self {
            weight_n: vehicle.body.mass_kg * vehicle.body.gravity_m_s2,
            rotor_count: vehicle.rotor_count(),
            arm_m: arms.iter().map(arm).fold(0.0, f64::max),
            mass_kg: vehicle.body.mass_kg,
        }
    }
}

impl MismatchMagnitudes {
    /// A preset's magnitudes for a vehicle of this size.
    fn bounded(mut self, size: Size) -> Self {
        let hover_n = size.weight_n / size.rotor_count as f64;
        let torque_nm = Size::TORQUE_SHARE * size.weight_n * size.arm_m;
        for (magnitude, bound) in [
            (&mut self.rotor_bias_n, Size::ROTOR_BIAS_SHARE * hover_n),
            (&mut self.disturbance_force_rms_n, Size::FORCE_SHARE * size.weight_n),
            (&mut self.disturbance_torque_rms_nm, torque_nm),
            (&mut self.centre_of_mass_m, Size::CENTRE_SHARE * size.arm_m),
            (&mut self.linear_drag_kg_s, Size::DRAG_OVER_MASS_1_S * size.mass_kg),
        ] {
            *magnitude = magnitude.min(bound);
        }
        self
    }
}

impl MismatchModel {
    /// Preset and overrides joined, for a vehicle of this size.
    pub fn magnitudes(&self, size: Size) -> MismatchMagnitudes {
        let preset = match self.preset {
            MismatchPreset::None => MismatchMagnitudes::NONE,
            MismatchPreset::Paper => MismatchMagnitudes::PAPER,
            MismatchPreset::Realistic => MismatchMagnitudes::REALISTIC,
        }
        .bounded(size);
        MismatchMagnitudes {
            rotor_bias_n: self.rotor_bias_n.unwrap_or(preset.rotor_bias_n),
            rotor_gain: self.rotor_gain.unwrap_or(preset.rotor_gain),
            thrust_lag: self.thrust_lag.unwrap_or(preset.thrust_lag),
            mass: self.mass.unwrap_or(preset.mass),
            inertia: self.inertia.unwrap_or(preset.inertia),
            moment_ratio: self.moment_ratio.unwrap_or(preset.moment_ratio),
            centre_of_mass_m: self.centre_of_mass_m.unwrap_or(preset.centre_of_mass_m),
            battery_voltage_bias_v: self.battery_voltage_bias_v.unwrap_or(preset.battery_voltage_bias_v),
            battery_voltage_noise_v: self.battery_voltage_noise_v.unwrap_or(preset.battery_voltage_noise_v),
            disturbance_force_rms_n: self.disturbance_force_rms_n.unwrap_or(preset.disturbance_force_rms_n),
            disturbance_torque_rms_nm: self
                .disturbance_torque_rms_nm
                .unwrap_or(preset.disturbance_torque_rms_nm),
            disturbance_correlation_s: self
                .disturbance_correlation_s
                .unwrap_or(preset.disturbance_correlation_s),
            linear_drag_kg_s: self.linear_drag_kg_s.unwrap_or(preset.linear_drag_kg_s),
        }
    }

    /// Refuses magnitudes that leave no vehicle of this size.
    pub fn check(&self, size: Size) -> Result<(), Refusal> {
        let m = self.magnitudes(size);
        in_range("rotor_bias_n", m.rotor_bias_n, 0.0, 10.0, "N")?;
        in_range("rotor_gain", m.rotor_gain, 0.0, 0.5, "")?;
        in_range("thrust_lag", m.thrust_lag, 0.0, 0.9, "")?;
        in_range("mass", m.mass, 0.0, 0.5, "")?;
        in_range("inertia", m.inertia, 0.0, 0.3, "")?;
        in_range("moment_ratio", m.moment_ratio, 0.0, 0.9, "")?;
        in_range("centre_of_mass_m", m.centre_of_mass_m, 0.0, 0.2, "m")?;
        in_range("battery_voltage_bias_v", m.battery_voltage_bias_v, 0.0, 5.0, "V")?;
        in_range("battery_voltage_noise_v", m.battery_voltage_noise_v, 0.0, 5.0, "V")?;
        in_range("disturbance_force_rms_n", m.disturbance_force_rms_n, 0.0, 100.0, "N")?;
        in_range(
            "disturbance_torque_rms_nm",
            m.disturbance_torque_rms_nm,
            0.0,
            10.0,
            "N·m",
        )?;
        in_range(
            "disturbance_correlation_s",
            m.disturbance_correlation_s,
            0.01,
            1000.0,
            "s",
        )?;
        in_range("linear_drag_kg_s", m.linear_drag_kg_s, 0.0, 10.0, "kg/s")
    }
}

/// What one flight's vehicle drew; part of the truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MismatchDraw {
    /// Added to the static lift of each rotor, N.
    pub rotor_bias_n: [f64; MAX_ROTORS],
    /// Factor on Eq. 19 of each rotor.
    pub rotor_gain: [f64; MAX_ROTORS],
    /// Factor on the lag τ.
    pub thrust_lag: f64,
    /// Factor on the mass.
    pub mass: f64,
    /// Factors on J.
    pub inertia: Vector3,
    /// Factor on c_D/c_L.
    pub moment_ratio: f64,
    /// True centre of mass minus the nominal one, m, body.
    pub centre_of_mass_m: Vector3,
    /// Measured minus true voltage, V.
    pub battery_voltage_bias_v: f64,
}

impl MismatchDraw {
    /// Draws the vehicle of the run `seed`.
    pub fn new(magnitudes: &MismatchMagnitudes, seed: u64) -> Self {
        let draw = |magnitude: f64, name: &str| {
            let mut stream = RandomStream::new(seed, name);
            move || magnitude * stream.symmetric()
        };
        let mut bias = draw(magnitudes.rotor_bias_n, "mismatch/rotor-bias");
        let mut gain = draw(magnitudes.rotor_gain, "mismatch/rotor-gain");
        let mut inertia = draw(magnitudes.inertia, "mismatch/inertia");
        let mut centre = draw(magnitudes.centre_of_mass_m, "mismatch/centre-of-mass");
        Self {
            rotor_bias_n: std::array::from_fn(|_| bias()),
            rotor_gain: std::array::from_fn(|_| 1.0 + gain()),
            thrust_lag: 1.0 + draw(magnitudes.thrust_lag, "mismatch/thrust-lag")(),
            mass: 1.0 + draw(magnitudes.mass, "mismatch/mass")(),
            inertia: std::array::from_fn(|_| 1.0 + inertia()),
            moment_ratio: 1.0 + draw(magnitudes.moment_ratio, "mismatch/moment-ratio")(),
            centre_of_mass_m: std::array::from_fn(|_| centre()),
            battery_voltage_bias_v: draw(magnitudes.battery_voltage_bias_v, "mismatch/voltage-bias")(),
        }
    }
}

impl MismatchMagnitudes {
    pub(crate) fn disturbance(&self) -> Disturbance {
        Disturbance {
            force_rms: self.disturbance_force_rms_n,
            torque_rms: self.disturbance_torque_rms_nm,
            correlation_s: self.disturbance_correlation_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{preset, vehicle};

    fn size(name: &str) -> Size {
        Size::of(&vehicle(name))
    }

    /// Bounds leave the vehicles of the paper's weight alone, to the bit: their recorded flights stay what they are.
    #[test]
    fn regress_presets_of_the_paper_s_weight_are_not_bounded() {
        for vehicle in ["f550", "quad-x", "octo-x", "hexa-h"] {
            let size = size(vehicle);
            assert_eq!(
                preset(MismatchPreset::Paper).magnitudes(size),
                MismatchMagnitudes::PAPER,
                "{vehicle}"
            );
            assert_eq!(
                preset(MismatchPreset::Realistic).magnitudes(size),
                MismatchMagnitudes::REALISTIC,
                "{vehicle}"
            );
        }
    }

    #[test]
    fn val_presets_of_a_tiny_vehicle_are_shares_of_its_own() {
        let size = size("crazyflie-2");
        let drawn = preset(MismatchPreset::Realistic).magnitudes(size);
        // 1 % of 0.027 kg · 9.81 m/s² / 4, by hand.
        assert!((drawn.rotor_bias_n - 6.6218e-4).abs() < 1e-8, "{drawn:?}");
        assert!((drawn.disturbance_force_rms_n - 0.026487).abs() < 1e-6, "{drawn:?}");
        assert!((drawn.linear_drag_kg_s - 0.0027).abs() < 1e-12, "{drawn:?}");
        // What has no unit of a size stays.
        assert!((drawn.thrust_lag - 0.20).abs() < 1e-12, "{drawn:?}");
        // The scenario's word counts.
        let own = MismatchModel {
            rotor_bias_n: Some(0.010756),
            ..preset(MismatchPreset::Paper)
        };
        assert_eq!(own.magnitudes(size).rotor_bias_n, 0.010756);
    }
}
