//! `[controller]` and `[fdi]` of a scenario, and the mapping of flight-code errors to their keys.

use rotortwin_flight_core::fdi::{FdiConfigError, SequentialConfigError};
use rotortwin_plant::error::{Refusal, in_range};
use rotortwin_plant::nearest_step;
use serde::{Deserialize, Serialize};

/// `[controller]`: cascaded PID (Table 5); outputs are accelerations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ControllerSettings {
    /// North: 1/s², 1/s³, 1/s.
    pub position_x: Gains,
    /// East.
    pub position_y: Gains,
    /// Down.
    pub position_z: Gains,
    /// φ: 1/s², 1/s³, 1/s.
    pub roll: Gains,
    /// θ.
    pub pitch: Gains,
    /// ψ.
    pub yaw: Gains,
    /// Largest tilt of the commanded thrust, degrees.
    pub tilt_limit_deg: f64,
    /// How a thrust is converted to a duty.
    pub thrust_to_duty: ThrustToDutyMap,
}

impl Default for ControllerSettings {
    /// Table 5; 35° and the linear map, choices that the paper leaves open.
    fn default() -> Self {
        let slow = Gains {
            proportional: 4.98,
            integral: 2.08,
            derivative: 3.90,
        };
        let fast = Gains {
            proportional: 242.0,
            integral: 720.0,
            derivative: 27.0,
        };
        Self {
            position_x: slow,
            position_y: slow,
            position_z: slow,
            roll: fast,
            pitch: fast,
            yaw: slow,
            tilt_limit_deg: 35.0,
            thrust_to_duty: ThrustToDutyMap::Linear,
        }
    }
}

/// Gains of one PID loop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gains {
    /// K_p, 1/s².
    pub proportional: f64,
    /// K_i, 1/s³.
    pub integral: f64,
    /// K_d, 1/s.
    pub derivative: f64,
}

/// How the controller converts a thrust to a duty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ThrustToDutyMap {
    /// u = f / `rotors.full_thrust_n`.
    Linear,
    /// Inverse of Eq. 19 at the measured voltage.
    InverseMap,
}

impl ControllerSettings {
    pub(crate) fn check(&self) -> Result<(), Refusal> {
        let loops = [
            ("position_x", &self.position_x),
            ("position_y", &self.position_y),
            ("position_z", &self.position_z),
            ("roll", &self.roll),
            ("pitch", &self.pitch),
            ("yaw", &self.yaw),
        ];
        for (name, gains) in loops {
            in_range(&format!("{name}.proportional"), gains.proportional, 0.0, 1e5, "1/s²")?;
            in_range(&format!("{name}.integral"), gains.integral, 0.0, 1e5, "1/s³")?;
            in_range(&format!("{name}.derivative"), gains.derivative, 0.0, 1e5, "1/s")?;
        }
        in_range("tilt_limit_deg", self.tilt_limit_deg, 1.0, 80.0, "degrees")
    }
}

/// `[fdi]`: residual generators and detectors (Table 5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FdiSettings {
    /// Samples of 2.5 ms per decision.
    pub window_samples: u16,
    /// h of H_i = h I, 1/s.
    pub observer_gain_1_s: f64,
    /// Rotor model of the residual generators.
    pub nominal_thrust: NominalThrustModel,
    /// α_FD of the T-test.
    pub alpha_detect: f64,
    /// α_FDI of the T-test.
    pub alpha_isolate: f64,
    /// Start of the detectors' calibration, s.
    pub calibration_start_s: f64,
    /// End of the calibration, s; verdicts follow.
    pub calibration_end_s: f64,
    /// Classifier file of the network, relative to the scenario document; if absent, the network gives no verdict.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub network: Option<String>,
}

impl Default for FdiSettings {
    /// Table 5; calibration from 2 s to 10 s.
    fn default() -> Self {
        Self {
            window_samples: 25,
            observer_gain_1_s: 5.0,
            nominal_thrust: NominalThrustModel::Static,
            alpha_detect: 1e-10,
            alpha_isolate: 1e-8,
            calibration_start_s: 2.0,
            calibration_end_s: 10.0,
            network: None,
        }
    }
}

/// Rotor model of the residual generators.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NominalThrustModel {
    /// Static Eq. 19, as in the paper.
    Static,
    /// Eq. 19 through the vehicle's rotor lag.
    Lagged,
    /// `rotors.full_thrust_n` times duty: no battery compensation, as in the paper's ablation.
    Linear,
}

impl NominalThrustModel {
    /// As written in a document.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Lagged => "lagged",
            Self::Linear => "linear",
        }
    }
}

impl FdiSettings {
    pub(crate) fn check(&self) -> Result<(), Refusal> {
        in_range("window_samples", f64::from(self.window_samples), 2.0, 1000.0, "")?;
        in_range("observer_gain_1_s", self.observer_gain_1_s, 0.01, 399.0, "1/s")?;
        in_range("alpha_detect", self.alpha_detect, 1e-300, 0.5, "")?;
        in_range("alpha_isolate", self.alpha_isolate, 1e-300, 0.5, "")?;
        in_range("calibration_start_s", self.calibration_start_s, 0.0, 3600.0, "s")?;
        in_range("calibration_end_s", self.calibration_end_s, 0.0, 3600.0, "s")?;
        if nearest_step(self.calibration_end_s) <= nearest_step(self.calibration_start_s) {
            let reason = format!(
                "expected an end of the calibration after its start at {} s, got {} s",
                self.calibration_start_s, self.calibration_end_s
            );
            return Err(Refusal::new("calibration_end_s", reason));
        }
        Ok(())
    }
}

/// The document that contains a rejected value.
pub(crate) enum Holder {
    Scenario,
    Vehicle,
}

/// Maps a detector's rejection to the document and key responsible.
pub(crate) fn fdi_refusal(error: &FdiConfigError) -> (Holder, Refusal) {
    let (holder, key, reason) = match error {
        FdiConfigError::Sequential(SequentialConfigError { field, expected }) => {
            let reason = format!("the sequential detector needs it to be {expected}");
            match *field {
                "calibration_start" => (Holder::Scenario, "fdi.calibration_start_s", reason),
                "calibration_end" => (Holder::Scenario, "fdi.calibration_end_s", reason),
                "updates_per_window" => (Holder::Scenario, "fdi.window_samples", reason),
                "rotor_time_constant" => (Holder::Vehicle, "rotors.thrust_lag_s", reason),
                // All other values are constants.
                _ => (Holder::Scenario, "fdi", error.to_string()),
            }
        }
        FdiConfigError::OutOfRange { field, expected } => {
            let reason = format!("the detectors need it to be {expected}");
            match *field {
                "mass" => (Holder::Vehicle, "body.mass_kg", reason),
                "inertia_body" => (Holder::Vehicle, "body.inertia_body_kg_m2", reason),
                "gravity" => (Holder::Vehicle, "body.gravity_m_s2", reason),
                "linear_drag" => (Holder::Vehicle, "body.linear_drag_kg_s", reason),
                "angular_drag" => (Holder::Vehicle, "body.angular_drag_nms", reason),
                "nominal_thrust.time_constant" => (Holder::Vehicle, "rotors.thrust_lag_s", reason),
                "nominal_thrust.full_thrust" => (Holder::Vehicle, "rotors.full_thrust_n", reason),
                "observer_gain" => (Holder::Scenario, "fdi.observer_gain_1_s", reason),
                "window_len" => (Holder::Scenario, "fdi.window_samples", reason),
                "t_test.baseline_start and baseline_end" => (Holder::Scenario, "fdi.calibration_end_s", reason),
                "t_test.alpha_detect and alpha_isolate" => (Holder::Scenario, "fdi.alpha_detect", reason),
                _ => (Holder::Scenario, "fdi", error.to_string()),
            }
        }
        FdiConfigError::NetworkRotorCount { .. } => (Holder::Scenario, "fdi.network", error.to_string()),
    };
    (holder, Refusal::new(key, reason))
}
