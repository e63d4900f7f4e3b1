//! The nominal vehicle in f32: configurations of the flight code from a checked scenario.
//!
//! They come from the documents, never from the mismatched truth.

use rotortwin_flight_core::control::{ControllerConfig, PidGains, ThrustToDuty};
use rotortwin_flight_core::fdi::{FdiConfig, NominalThrust, SequentialConfig, TTestConfig};
use rotortwin_flight_core::thrust_map::ThrustMap;

use crate::STEP_S;
use crate::blades::Blade;
use crate::classifier::Classifier;
use crate::scenario::{FdiSettings, Gains, NominalThrustModel, Scenario, ThrustToDutyMap};
use crate::vehicle::{VehicleModel, geometry};

impl Scenario {
    /// Eq. 19 of the nominal blade.
    pub fn thrust_map(&self) -> ThrustMap {
        thrust_map(self.nominal_blade())
    }

    /// Configuration of `flight-core`'s controller for the nominal vehicle.
    pub fn controller_config(&self) -> ControllerConfig {
        let vehicle = self.vehicle();
        let controller = &self.document().controller;
        let gains = |g: &Gains| PidGains {
            proportional: g.proportional as f32,
            integral: g.integral as f32,
            derivative: g.derivative as f32,
        };
        ControllerConfig {
            geometry: geometry(&vehicle.rotors.layout.placements()).expect("the layout was checked with the scenario"),
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
                ThrustToDutyMap::InverseMap => ThrustToDuty::InverseMap(self.thrust_map()),
            },
        }
    }

    /// Configuration of `flight-core`'s detectors for the nominal vehicle, or for the one of [`Scenario::with_fdi_vehicle`].
    pub fn fdi_config(&self) -> FdiConfig {
        let own = self.documents().fdi_vehicle.as_ref();
        let (vehicle, blade) = own.map_or((self.vehicle(), self.nominal_blade()), |own| {
            (&own.vehicle, own.nominal_blade())
        });
        fdi_config(vehicle, blade, &self.document().fdi, self.classifier())
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

fn thrust_map(blade: &Blade) -> ThrustMap {
    ThrustMap::new(blade.coefficients.map(|a| a as f32), blade.voltage_offset_v as f32)
        .expect("the blade was checked with its vehicle")
}
