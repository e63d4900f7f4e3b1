//! The nominal vehicle in f32: configurations of the flight code, from checked documents.
//!
//! They are derived from the documents, never from the mismatched truth.

use rotortwin_flight_core::control::{ControllerConfig, PidGains, ThrustToDuty};
use rotortwin_flight_core::fdi::{FdiConfig, NominalThrust, SequentialConfig, TTestConfig};
use rotortwin_flight_core::thrust_map::ThrustMap;

use crate::classifier::Classifier;
use crate::settings::{ControllerSettings, FdiSettings, Gains, NominalThrustModel, ThrustToDutyMap};
use rotortwin_plant::STEP_S;
use rotortwin_plant::powertrain::blades::Blade;
use rotortwin_plant::vehicle::model::{VehicleModel, geometry};

/// Configuration of `flight-core`'s controller; vehicle, blade and settings have been checked.
pub(crate) fn controller_config(
    vehicle: &VehicleModel,
    blade: &Blade,
    controller: &ControllerSettings,
) -> ControllerConfig {
    let gains = |g: &Gains| PidGains {
        proportional: g.proportional as f32,
        integral: g.integral as f32,
        derivative: g.derivative as f32,
    };
    ControllerConfig {
        geometry: geometry(&vehicle.rotors.layout.placements()).expect("the layout was checked with the vehicle"),
        mass: vehicle.body.mass_kg as f32,
        inertia_body: vehicle.body.inertia_body_kg_m2.map(|j| j as f32),
        gravity: vehicle.body.gravity_m_s2 as f32,
        period: STEP_S as f32,
        position_gains: [&controller.position_x, &controller.position_y, &controller.position_z].map(gains),
        attitude_gains: [&controller.roll, &controller.pitch, &controller.yaw].map(gains),
        tilt_limit: controller.tilt_limit_deg.to_radians() as f32,
        thrust_to_duty: match controller.thrust_to_duty {
            ThrustToDutyMap::Linear => ThrustToDuty::Linear {
                full_thrust: vehicle.rotors.full_thrust_n as f32,
            },
            ThrustToDutyMap::InverseMap => ThrustToDuty::InverseMap(thrust_map(blade)),
        },
    }
}

/// Configuration of `flight-core`'s detectors; vehicle, blade, settings and classifier have been checked.
pub(crate) fn fdi_config(
    vehicle: &VehicleModel,
    blade: &Blade,
    fdi: &FdiSettings,
    classifier: Option<&Classifier>,
) -> FdiConfig {
    let rotor_time_constant = vehicle.rotors.thrust_lag_s as f32;
    let (calibration_start, calibration_end) = (fdi.calibration_start_s as f32, fdi.calibration_end_s as f32);
    FdiConfig {
        geometry: geometry(&vehicle.rotors.layout.placements()).expect("the layout was checked with the vehicle"),
        mass: vehicle.body.mass_kg as f32,
        inertia_body: vehicle.body.inertia_body_kg_m2.map(|j| j as f32),
        gravity: vehicle.body.gravity_m_s2 as f32,
        linear_drag: vehicle.body.linear_drag_kg_s as f32,
        angular_drag: vehicle.body.angular_drag_nms as f32,
        period: STEP_S as f32,
        thrust_map: thrust_map(blade),
        nominal_thrust: match fdi.nominal_thrust {
            NominalThrustModel::Static => NominalThrust::Static,
            NominalThrustModel::Lagged => NominalThrust::Lagged {
                time_constant: rotor_time_constant,
            },
            NominalThrustModel::Linear => NominalThrust::Linear {
                full_thrust: vehicle.rotors.full_thrust_n as f32,
            },
        },
        observer_gain: fdi.observer_gain_1_s as f32,
        window_len: fdi.window_samples,
        t_test: TTestConfig {
            alpha_detect: fdi.alpha_detect,
            alpha_isolate: fdi.alpha_isolate,
            baseline_start: calibration_start,
            baseline_end: calibration_end,
        },
        network: classifier.map(|classifier| classifier.network().expect("the classifier was checked")),
        sequential: SequentialConfig {
            calibration_start,
            calibration_end,
            rotor_time_constant,
            ..SequentialConfig::standard()
        },
    }
}

/// Eq. 19 of a checked blade.
pub(crate) fn thrust_map(blade: &Blade) -> ThrustMap {
    ThrustMap::new(blade.coefficients.map(|a| a as f32), blade.voltage_offset_v as f32)
        .expect("the blade was checked with its vehicle")
}
