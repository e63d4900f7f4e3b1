//! Conversion between the parameters of the handshake ([`crate::proto`]) and the configurations of `flight-core`.
//!
//! The conversion is lossless: a configuration sent and read back is bit-identical. Invalid input is rejected with an error
//! message that names the field; whether the numbers make a flyable vehicle is up to `flight-core`.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::control::{ControllerConfig, PidGains, ThrustToDuty};
use rotortwin_flight_core::fdi::{FdiConfig, Network, NetworkWeights, NominalThrust, SequentialConfig, TTestConfig};
use rotortwin_flight_core::frames::Vec3;
use rotortwin_flight_core::geometry::{Geometry, Rotor, Spin};
use rotortwin_flight_core::thrust_map::ThrustMap;
use rotortwin_proto::{self as proto, controller_setup, fdi_setup};
use std::collections::BTreeMap;

/// Initial value of the vertical integrator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trim {
    /// Hover duty, fraction.
    pub duty: f32,
    /// Corresponding battery voltage, V.
    pub battery_voltage: f32,
}

fn missing(field: &str) -> String {
    format!("{field} is missing")
}

/// An array of fixed length.
fn fixed<const N: usize>(values: &[f32], field: &str) -> Result<[f32; N], String> {
    values
        .try_into()
        .map_err(|_wrong_length| format!("{field} has {} entries, expected {N}", values.len()))
}

fn rotors_to_proto(geometry: &Geometry) -> Vec<proto::Rotor> {
    geometry.rotors()[..geometry.rotor_count()]
        .iter()
        .map(|rotor| proto::Rotor {
            position_m: Some(proto::BodyVector {
                forward: rotor.position_body.x,
                right: rotor.position_body.y,
                down: rotor.position_body.z,
            }),
            spin: match rotor.spin {
                Spin::Ccw => 1,
                Spin::Cw => -1,
            },
            moment_ratio_m: rotor.moment_ratio,
        })
        .collect()
}

fn geometry_from_proto(rotors: &[proto::Rotor], message: &str) -> Result<Geometry, String> {
    if rotors.len() > MAX_ROTORS {
        return Err(format!(
            "{message}.rotors has {} entries, expected at most {MAX_ROTORS}",
            rotors.len()
        ));
    }
    let rotors = rotors
        .iter()
        .enumerate()
        .map(|(index, rotor)| {
            let position =
                rotor.position_m.as_ref().ok_or_else(|| missing(&format!("{message}.rotors[{index}].position_m")))?;
            Ok(Rotor {
                position_body: Vec3::new(position.forward, position.right, position.down),
                spin: match rotor.spin {
                    1 => Spin::Ccw,
                    -1 => Spin::Cw,
                    other => {
                        return Err(format!(
                            "{message}.rotors[{index}].spin is {other}, expected 1 (counter-clockwise) or -1 (clockwise)"
                        ));
                    }
                },
                moment_ratio: rotor.moment_ratio_m,
            })
        })
        .collect::<Result<Vec<_>, String>>()?;
    Geometry::new(&rotors).map_err(|error| format!("{message}.rotors: {error}"))
}

fn thrust_map_to_proto(map: &ThrustMap) -> proto::ThrustMap {
    proto::ThrustMap {
        coef: map.coef().to_vec(),
        voltage_offset_v: map.voltage_offset(),
    }
}

fn thrust_map_from_proto(map: &proto::ThrustMap, field: &str) -> Result<ThrustMap, String> {
    ThrustMap::new(fixed(&map.coef, &format!("{field}.coef"))?, map.voltage_offset_v)
        .map_err(|error| format!("{field}: {error}"))
}

fn gains_to_proto(gains: &[PidGains; 3]) -> Vec<proto::PidGains> {
    gains
        .iter()
        .map(|k| proto::PidGains {
            proportional: k.proportional,
            integral: k.integral,
            derivative: k.derivative,
        })
        .collect()
}

fn gains_from_proto(gains: &[proto::PidGains], field: &str) -> Result<[PidGains; 3], String> {
    let gains: &[proto::PidGains; 3] = gains
        .try_into()
        .map_err(|_wrong_length| format!("{field} has {} entries, expected 3", gains.len()))?;
    Ok(gains.map(|k| PidGains {
        proportional: k.proportional,
        integral: k.integral,
        derivative: k.derivative,
    }))
}

/// The parameters of a controller, for sending.
///
/// * `trim`: presets the vertical integrator; `None` leaves it at 0
pub fn controller_setup(config: &ControllerConfig, trim: Option<Trim>) -> proto::ControllerSetup {
    let trim = trim.unwrap_or(Trim {
        duty: 0.0,
        battery_voltage: 0.0,
    });
    proto::ControllerSetup {
        rotors: rotors_to_proto(&config.geometry),
        body: Some(proto::RigidBody {
            mass_kg: config.mass,
            inertia_body_kg_m2: config.inertia_body.to_vec(),
            gravity_m_s2: config.gravity,
            // The controller does not use drag.
            linear_drag_n_s_m: 0.0,
            angular_drag_nm_s: 0.0,
        }),
        period_s: config.period,
        position_gains: gains_to_proto(&config.position_gains),
        attitude_gains: gains_to_proto(&config.attitude_gains),
        tilt_limit_rad: config.tilt_limit,
        thrust_to_duty: Some(match &config.thrust_to_duty {
            ThrustToDuty::Linear { full_thrust } => controller_setup::ThrustToDuty::FullThrustN(*full_thrust),
            ThrustToDuty::InverseMap(map) => controller_setup::ThrustToDuty::InverseMap(thrust_map_to_proto(map)),
        }),
        trim_duty: trim.duty,
        trim_voltage_v: trim.battery_voltage,
    }
}

/// The configuration of a controller, and the initial value of its vertical integrator, as received.
pub fn controller_config(setup: &proto::ControllerSetup) -> Result<(ControllerConfig, Option<Trim>), String> {
    let body = setup.body.as_ref().ok_or_else(|| missing("ControllerSetup.body"))?;
    let thrust_to_duty = match &setup.thrust_to_duty {
        None => return Err(missing("ControllerSetup.thrust_to_duty")),
        Some(controller_setup::ThrustToDuty::FullThrustN(full_thrust)) => ThrustToDuty::Linear {
            full_thrust: *full_thrust,
        },
        Some(controller_setup::ThrustToDuty::InverseMap(map)) => {
            ThrustToDuty::InverseMap(thrust_map_from_proto(map, "ControllerSetup.inverse_map")?)
        }
    };
    if !(0.0..=1.0).contains(&setup.trim_duty) {
        return Err(format!(
            "ControllerSetup.trim_duty is {}, expected a fraction from 0 to 1 (0: no trim)",
            setup.trim_duty
        ));
    }
    let trim = (setup.trim_duty > 0.0).then_some(Trim {
        duty: setup.trim_duty,
        battery_voltage: setup.trim_voltage_v,
    });
    if let Some(trim) = trim
        && !(trim.battery_voltage > 0.0 && trim.battery_voltage.is_finite())
    {
        return Err(format!(
            "ControllerSetup.trim_voltage_v is {}, expected a voltage above 0 with trim_duty",
            trim.battery_voltage
        ));
    }
    let config = ControllerConfig {
        geometry: geometry_from_proto(&setup.rotors, "ControllerSetup")?,
        mass: body.mass_kg,
        inertia_body: fixed(&body.inertia_body_kg_m2, "ControllerSetup.body.inertia_body_kg_m2")?,
        gravity: body.gravity_m_s2,
        period: setup.period_s,
        position_gains: gains_from_proto(&setup.position_gains, "ControllerSetup.position_gains")?,
        attitude_gains: gains_from_proto(&setup.attitude_gains, "ControllerSetup.attitude_gains")?,
        tilt_limit: setup.tilt_limit_rad,
        thrust_to_duty,
    };
    Ok((config, trim))
}

/// The parameters of an FDI engine, for sending.
///
/// * `network`: the weights behind `config.network`, which stores them in a different form; checked by
///   [`fdi_config`] on the other side
/// * `ground`: the ground under the vehicle
pub fn fdi_setup(
    config: &FdiConfig,
    network: Option<proto::NetworkSetup>,
    ground: Option<proto::Ground>,
) -> proto::FdiSetup {
    proto::FdiSetup {
        rotors: rotors_to_proto(&config.geometry),
        body: Some(proto::RigidBody {
            mass_kg: config.mass,
            inertia_body_kg_m2: config.inertia_body.to_vec(),
            gravity_m_s2: config.gravity,
            linear_drag_n_s_m: config.linear_drag,
            angular_drag_nm_s: config.angular_drag,
        }),
        period_s: config.period,
        thrust_map: Some(thrust_map_to_proto(&config.thrust_map)),
        nominal_thrust: Some(match config.nominal_thrust {
            NominalThrust::Static => fdi_setup::NominalThrust::StaticMap(true),
            NominalThrust::Lagged { time_constant } => fdi_setup::NominalThrust::LagS(time_constant),
            NominalThrust::Linear { full_thrust } => fdi_setup::NominalThrust::LinearFullThrustN(full_thrust),
        }),
        observer_gain: config.observer_gain,
        window_len: u32::from(config.window_len),
        t_test: Some(proto::TTestSetup {
            alpha_detect: config.t_test.alpha_detect,
            alpha_isolate: config.t_test.alpha_isolate,
            calibration_start_s: config.t_test.baseline_start,
            calibration_end_s: config.t_test.baseline_end,
        }),
        network,
        sequential: Some(proto::SequentialSetup {
            parameters: sequential_to_map(&config.sequential),
        }),
        ground,
    }
}

/// The configuration of an FDI engine, as received.
pub fn fdi_config(setup: &proto::FdiSetup) -> Result<FdiConfig, String> {
    let body = setup.body.as_ref().ok_or_else(|| missing("FdiSetup.body"))?;
    let map = setup
        .thrust_map
        .as_ref()
        .ok_or_else(|| missing("FdiSetup.thrust_map"))?;
    let t_test = setup.t_test.as_ref().ok_or_else(|| missing("FdiSetup.t_test"))?;
    let sequential = setup
        .sequential
        .as_ref()
        .ok_or_else(|| missing("FdiSetup.sequential"))?;
    let geometry = geometry_from_proto(&setup.rotors, "FdiSetup")?;
    let window_len = u16::try_from(setup.window_len)
        .ok()
        .filter(|len| (2..=1000).contains(len))
        .ok_or_else(|| {
            format!(
                "FdiSetup.window_len is {}, expected 2 to 1000 samples",
                setup.window_len
            )
        })?;
    Ok(FdiConfig {
        geometry,
        mass: body.mass_kg,
        inertia_body: fixed(&body.inertia_body_kg_m2, "FdiSetup.body.inertia_body_kg_m2")?,
        gravity: body.gravity_m_s2,
        linear_drag: body.linear_drag_n_s_m,
        angular_drag: body.angular_drag_nm_s,
        period: setup.period_s,
        thrust_map: thrust_map_from_proto(map, "FdiSetup.thrust_map")?,
        nominal_thrust: match setup.nominal_thrust {
            None | Some(fdi_setup::NominalThrust::StaticMap(false)) => return Err(missing("FdiSetup.nominal_thrust")),
            Some(fdi_setup::NominalThrust::StaticMap(true)) => NominalThrust::Static,
            Some(fdi_setup::NominalThrust::LagS(time_constant)) => NominalThrust::Lagged { time_constant },
            Some(fdi_setup::NominalThrust::LinearFullThrustN(full_thrust)) => NominalThrust::Linear { full_thrust },
        },
        observer_gain: setup.observer_gain,
        window_len,
        t_test: TTestConfig {
            alpha_detect: t_test.alpha_detect,
            alpha_isolate: t_test.alpha_isolate,
            baseline_start: t_test.calibration_start_s,
            baseline_end: t_test.calibration_end_s,
        },
        network: setup
            .network
            .as_ref()
            .map(|network| network_from_proto(network, geometry.rotor_count()))
            .transpose()?,
        sequential: sequential_from_map(&sequential.parameters)?,
    })
}

fn network_from_proto(network: &proto::NetworkSetup, rotor_count: usize) -> Result<Network, String> {
    let features = 3 * rotor_count;
    for (field, found, expected) in [
        ("inputs", network.inputs, features),
        ("hidden", network.hidden, features),
        ("outputs", network.outputs, rotor_count + 1),
    ] {
        if usize::try_from(found) != Ok(expected) {
            return Err(format!(
                "FdiSetup.network.{field} is {found}, expected {expected} for {rotor_count} rotors"
            ));
        }
    }
    let weights = NetworkWeights {
        mean: &network.feature_means,
        deviation: &network.feature_deviations,
        hidden_weight: &network.hidden_weights,
        hidden_bias: &network.hidden_biases,
        output_weight: &network.output_weights,
        output_bias: &network.output_biases,
    };
    Network::new(rotor_count, &weights)
        .map(|parameters| parameters.with_self_calibration(network.self_calibrated))
        .map_err(|error| format!("FdiSetup.network: {error}"))
}

/// The parameters of a network for `rotor_count` rotors, for sending.
///
/// * `self_calibrated`: see [`Network::self_calibrated`]
pub fn network_setup(rotor_count: usize, weights: &NetworkWeights<'_>, self_calibrated: bool) -> proto::NetworkSetup {
    let count = |number: usize| u32::try_from(number).expect("at most 16 rotors");
    proto::NetworkSetup {
        inputs: count(3 * rotor_count),
        hidden: count(3 * rotor_count),
        outputs: count(rotor_count + 1),
        hidden_weights: weights.hidden_weight.to_vec(),
        hidden_biases: weights.hidden_bias.to_vec(),
        output_weights: weights.output_weight.to_vec(),
        output_biases: weights.output_bias.to_vec(),
        feature_means: weights.mean.to_vec(),
        feature_deviations: weights.deviation.to_vec(),
        self_calibrated,
    }
}

/// A number of [`SequentialConfig`] transmitted as `f64`.
trait Parameter: Sized {
    /// Exact.
    fn to_number(self) -> f64;
    /// `None` if the number is not exactly representable in this type.
    fn from_number(number: f64) -> Option<Self>;
}

impl Parameter for f32 {
    fn to_number(self) -> f64 {
        f64::from(self)
    }
    fn from_number(number: f64) -> Option<Self> {
        let value = number as f32;
        (f64::from(value).to_bits() == number.to_bits()).then_some(value)
    }
}

impl Parameter for u8 {
    fn to_number(self) -> f64 {
        f64::from(self)
    }
    fn from_number(number: f64) -> Option<Self> {
        let value = number as u8;
        (f64::from(value).to_bits() == number.to_bits()).then_some(value)
    }
}

/// Both directions from one list of fields; the compiler rejects an incomplete list.
macro_rules! sequential_parameters {
    ($($field:ident),+ $(,)?) => {
        fn sequential_to_map(config: &SequentialConfig) -> BTreeMap<String, f64> {
            BTreeMap::from([$((stringify!($field).to_owned(), config.$field.to_number())),+])
        }

        fn sequential_from_map(parameters: &BTreeMap<String, f64>) -> Result<SequentialConfig, String> {
            const NAMES: &[&str] = &[$(stringify!($field)),+];
            if let Some(unknown) = parameters.keys().find(|name| !NAMES.contains(&name.as_str())) {
                return Err(format!(
                    "FdiSetup.sequential has no parameter {unknown}; it knows {}",
                    NAMES.join(", ")
                ));
            }
            Ok(SequentialConfig {
                $($field: {
                    let name = stringify!($field);
                    let number = *parameters.get(name).ok_or_else(|| missing(&format!("FdiSetup.sequential.{name}")))?;
                    Parameter::from_number(number)
                        .ok_or_else(|| format!("FdiSetup.sequential.{name} is {number}, expected a number that its type can hold"))?
                }),+
            })
        }
    };
}

rotortwin_flight_core::with_sequential_fields!(sequential_parameters);
