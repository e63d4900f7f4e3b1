//! The parameters of the handshake compared with the configurations of `flight-core`.

use proptest::prelude::*;
use prost::Message;
use rotortwin_flight_core::control::{ControllerConfig, PidGains, ThrustToDuty};
use rotortwin_flight_core::fdi::{FdiConfig, Network, NetworkWeights, NominalThrust, SequentialConfig, TTestConfig};
use rotortwin_flight_core::geometry::Geometry;
use rotortwin_flight_core::thrust_map::ThrustMap;
use rotortwin_proto as proto;
use rotortwin_wire::setup::{Trim, controller_config, controller_setup, fdi_config, fdi_setup, network_setup};

fn blade_a() -> ThrustMap {
    ThrustMap::new([-1.4310e-2, 4.6339e-3, 1.0350e-4, -1.7318e-7], 5.2859).expect("Table 1")
}

fn geometry(rotors: usize) -> Geometry {
    Geometry::regular(rotors, 0.275, 0.016, 0.3).expect("regular")
}

fn gains(k: &[f32]) -> PidGains {
    PidGains {
        proportional: k[0],
        integral: k[1],
        derivative: k[2],
    }
}

fn controller(rotors: usize, x: &[f32; 24], by_map: bool) -> ControllerConfig {
    ControllerConfig {
        geometry: geometry(rotors),
        mass: x[18],
        inertia_body: [x[19], x[20], x[21]],
        gravity: 9.81,
        period: 0.0025,
        position_gains: [gains(&x[0..3]), gains(&x[3..6]), gains(&x[6..9])],
        attitude_gains: [gains(&x[9..12]), gains(&x[12..15]), gains(&x[15..18])],
        tilt_limit: x[22],
        thrust_to_duty: if by_map {
            ThrustToDuty::InverseMap(blade_a())
        } else {
            ThrustToDuty::Linear { full_thrust: x[23] }
        },
    }
}

fn fdi(nominal_thrust: NominalThrust) -> FdiConfig {
    FdiConfig {
        geometry: geometry(6),
        mass: 1.55,
        inertia_body: [0.0266, 0.0265, 0.0498],
        gravity: 9.81,
        linear_drag: 0.1,
        angular_drag: 0.01,
        period: 0.0025,
        thrust_map: blade_a(),
        nominal_thrust,
        observer_gain: 5.0,
        window_len: 25,
        t_test: TTestConfig::paper(),
        network: None,
        sequential: SequentialConfig::standard(),
    }
}

fn through_bytes<M: Message + Default>(message: &M) -> M {
    M::decode(message.encode_to_vec().as_slice()).expect("what was encoded can be decoded")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn prop_controller_parameters_come_back_the_same(
        rotors in (2_usize..=8).prop_map(|pairs| 2 * pairs),
        x in proptest::array::uniform24(1e-3_f32..1e3),
        by_map in any::<bool>(),
        trim in proptest::option::of((1e-3_f32..=1.0, 5.0_f32..60.0)),
    ) {
        let config = controller(rotors, &x, by_map);
        let trim = trim.map(|(duty, battery_voltage)| Trim { duty, battery_voltage });
        let back = controller_config(&through_bytes(&controller_setup(&config, trim)));
        prop_assert_eq!(back, Ok((config, trim)));
    }

    #[test]
    fn prop_fdi_parameters_come_back_the_same(
        x in proptest::array::uniform6(1e-3_f32..1e3),
        alpha in (1e-12_f64..0.5, 1e-12_f64..0.5),
        window_len in 2_u16..=1000,
        which in 0..3,
    ) {
        let nominal_thrust = match which {
            0 => NominalThrust::Static,
            1 => NominalThrust::Lagged { time_constant: x[0] },
            _ => NominalThrust::Linear { full_thrust: x[0] },
        };
        let mut config = fdi(nominal_thrust);
        config.mass = x[1];
        config.inertia_body = [x[2], x[3], x[4]];
        config.observer_gain = x[5];
        config.window_len = window_len;
        config.t_test.alpha_detect = alpha.0;
        config.t_test.alpha_isolate = alpha.1;
        config.sequential.calibration_end = x[0];
        let back = fdi_config(&through_bytes(&fdi_setup(&config, None, None)));
        prop_assert_eq!(back, Ok(config));
    }
}

#[test]
fn val_a_network_comes_back_the_same() {
    let table = |len: usize, k: f32| (0..len).map(|i| (i as f32 * k).sin()).collect::<Vec<_>>();
    let (hidden_weight, output_weight) = (table(18 * 18, 0.7), table(7 * 18, 0.3));
    let (mean, bias, output_bias) = (table(18, 0.1), table(18, 0.2), table(7, 0.4));
    let deviation: Vec<f32> = (0..18).map(|i| 0.5 + i as f32).collect();
    let weights = NetworkWeights {
        mean: &mean,
        deviation: &deviation,
        hidden_weight: &hidden_weight,
        hidden_bias: &bias,
        output_weight: &output_weight,
        output_bias: &output_bias,
    };
    for self_calibrated in [false, true] {
        let network = Network::new(6, &weights)
            .expect("18 features")
            .with_self_calibration(self_calibrated);
        let config = FdiConfig {
            network: Some(network),
            ..fdi(NominalThrust::Static)
        };
        let setup = fdi_setup(&config, Some(network_setup(6, &weights, self_calibrated)), None);
        assert_eq!(fdi_config(&through_bytes(&setup)), Ok(config));

        let mut wrong = setup.clone();
        wrong.network.as_mut().expect("there is one").hidden = 17;
        let text = fdi_config(&wrong).expect_err("17 neurons");
        assert_eq!(text, "FdiSetup.network.hidden is 17, expected 18 for 6 rotors");
    }
}

fn refused_controller(change: impl FnOnce(&mut proto::ControllerSetup)) -> String {
    let mut setup = controller_setup(&controller(6, &[1.0; 24], false), None);
    change(&mut setup);
    controller_config(&setup).expect_err("it must be refused")
}

fn refused_fdi(change: impl FnOnce(&mut proto::FdiSetup)) -> String {
    let mut setup = fdi_setup(&fdi(NominalThrust::Static), None, None);
    change(&mut setup);
    fdi_config(&setup).expect_err("it must be refused")
}

#[test]
fn val_refusals_name_the_field() {
    assert_eq!(
        refused_controller(|s| s.rotors[2].spin = 0),
        "ControllerSetup.rotors[2].spin is 0, expected 1 (counter-clockwise) or -1 (clockwise)"
    );
    assert_eq!(
        refused_controller(|s| s.rotors[1].position_m = None),
        "ControllerSetup.rotors[1].position_m is missing"
    );
    assert!(refused_controller(|s| s.rotors.truncate(3)).starts_with("ControllerSetup.rotors: "));
    assert_eq!(
        refused_controller(|s| s.rotors = vec![s.rotors[0]; 17]),
        "ControllerSetup.rotors has 17 entries, expected at most 16"
    );
    assert_eq!(refused_controller(|s| s.body = None), "ControllerSetup.body is missing");
    assert_eq!(
        refused_controller(|s| s.attitude_gains.truncate(2)),
        "ControllerSetup.attitude_gains has 2 entries, expected 3"
    );
    assert_eq!(
        refused_controller(|s| s.thrust_to_duty = None),
        "ControllerSetup.thrust_to_duty is missing"
    );
    assert!(refused_controller(|s| s.trim_duty = f32::NAN).starts_with("ControllerSetup.trim_duty is NaN, expected"));
    assert!(refused_controller(|s| s.trim_duty = 0.4).starts_with("ControllerSetup.trim_voltage_v is 0, expected"));

    assert_eq!(
        refused_fdi(|s| s.nominal_thrust = None),
        "FdiSetup.nominal_thrust is missing"
    );
    assert!(refused_fdi(|s| s.window_len = 70_000).starts_with("FdiSetup.window_len is 70000, expected"));
    let text = refused_fdi(|s| s.thrust_map.as_mut().expect("there is one").coef.truncate(3));
    assert_eq!(text, "FdiSetup.thrust_map.coef has 3 entries, expected 4");
    let sequential = |name: &str, value: Option<f64>| {
        refused_fdi(|s| {
            let parameters = &mut s.sequential.as_mut().expect("there is one").parameters;
            parameters.remove(name);
            parameters.extend(value.map(|value| (name.to_owned(), value)));
        })
    };
    assert_eq!(
        sequential("calibration_end", None),
        "FdiSetup.sequential.calibration_end is missing"
    );
    let text = sequential("calibration_ends", Some(1.0));
    assert!(
        text.starts_with("FdiSetup.sequential has no parameter calibration_ends; it knows calibration_start,"),
        "{text}"
    );
    let text = sequential("updates_per_window", Some(2.5));
    assert!(
        text.starts_with("FdiSetup.sequential.updates_per_window is 2.5, expected"),
        "{text}"
    );
}
