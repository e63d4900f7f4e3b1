//! Stored encodings of every message: they must always decode to the same values.
//!
//! A released file is never rewritten. After adding a message here,
//! `ROTORTWIN_WRITE_GOLDEN=1 cargo test --release -p rotortwin-wire --test golden` writes the missing files. A field
//! added to a message later is absent from the old file and has its default here.

use prost::Message;
use rotortwin_proto::{
    BodyVector, ControllerSetup, FdiReports, FdiSetup, Finish, Join, MeasuredStep, MeasuredSteps, NetworkSetup,
    PidGains, Ready, RigidBody, Role, Rotor, SequentialSetup, Setup, TTestSetup, ThrustMap, controller_setup,
    fdi_setup, setup,
};
use rotortwin_wire::frames::{CommandFrame, FdiReport, LossEstimate, SensorFrame, Stamp};
use std::fmt::Debug;
use std::path::PathBuf;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/golden/v1");

/// Decodes the golden bytes of `name` and compares.
fn check<M: Message + Default + PartialEq + Debug>(name: &str, expected: &M) {
    let path = PathBuf::from(FOLDER).join(name).with_extension("bin");
    if std::env::var_os("ROTORTWIN_WRITE_GOLDEN").is_some() && !path.exists() {
        std::fs::create_dir_all(FOLDER).expect("the folder can be made");
        std::fs::write(&path, expected.encode_to_vec()).expect("the file can be written");
    }
    let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert!(!bytes.is_empty(), "{name} says something");
    let decoded = M::decode(bytes.as_slice()).unwrap_or_else(|error| panic!("{name}: {error}"));
    assert_eq!(&decoded, expected, "{name}");
}

const STAMP: Stamp = Stamp {
    run_id: 0xfedc_ba98_7654_3210,
    step: 18_000,
    sim_time_ns: 45_000_000_000,
};

fn sensors() -> SensorFrame {
    SensorFrame {
        stamp: STAMP,
        position_ned_m: [1.5, -2.25, -5.125],
        velocity_ned_m_s: [0.5, 0.75, -0.0625],
        attitude_rad: [0.03125, -0.015625, 3.0],
        body_rates_rad_s: [0.125, -0.25, 0.375],
        reference_position_ned_m: [1.0, -2.0, -5.0],
        reference_velocity_ned_m_s: [0.25, 0.5, -0.125],
        reference_yaw_rad: 2.5,
        battery_voltage_v: 15.75,
    }
}

fn command() -> CommandFrame {
    let mut duty = [0.0; 16];
    duty[..6].copy_from_slice(&[0.375, 0.5, 0.0, 1.0, 0.625, 0.25]);
    CommandFrame {
        stamp: STAMP,
        duty,
        attitude_setpoint_rad: [0.0625, -0.125, 2.5],
        saturated_rotors: 0b1100,
    }
}

fn report() -> FdiReport {
    let mut residuals_nms = [[0.0; 3]; 16];
    for (rotor, residual) in residuals_nms[..6].iter_mut().enumerate() {
        let rotor = rotor as f32;
        *residual = [0.5 + rotor, -0.25 * rotor, 0.001_953_125 * rotor];
    }
    FdiReport {
        stamp: STAMP,
        residuals_nms,
        wrench_residual: [0.5, -0.25, 0.125, 0.0625],
        t_test: 3,
        network: -2,
        sequential: -1,
        sequential_probability: 0.9375,
        thrust_loss: LossEstimate {
            loss_n: 0.125,
            ..LossEstimate::default()
        },
        window_end: 1,
        ..FdiReport::default()
    }
}

/// Including later additions: the pair of rotors 2 and 5, intervals, sets of rotors.
fn report_of_a_pair() -> FdiReport {
    FdiReport {
        sequential: 205,
        thrust_loss: LossEstimate {
            loss_n: 0.125,
            low_n: 0.0625,
            high_n: 0.25,
            share: 0.5,
            share_low: 0.375,
            share_high: 0.625,
        },
        second_thrust_loss: LossEstimate {
            loss_n: 0.75,
            low_n: 0.5,
            high_n: 1.0,
            ..LossEstimate::default()
        },
        suspect_rotors: 0b10110,
        hypothesis_count: 9,
        hypothesis_rotors: [0b10010, 0b00110, 0b10000, 1, 2, 3, 4, 5],
        ..report()
    }
}

#[test]
fn regress_golden_loop_messages() {
    check("SensorFrame", &rotortwin_proto::SensorFrame::from(&sensors()));
    check("MotorCommand", &command().to_proto(6));
    check("FdiReport", &report().to_proto(6));
    check("FdiReport-pair", &report_of_a_pair().to_proto(6));
    let healthy = FdiReport {
        t_test: 0,
        window_end: 0,
        ..report()
    };
    check(
        "FdiReports",
        &FdiReports {
            reports: vec![report().to_proto(6), healthy.to_proto(6)],
        },
    );
    let step = MeasuredStep {
        sensors: Some((&sensors()).into()),
        command: Some(command().to_proto(6)),
    };
    check(
        "MeasuredSteps",
        &MeasuredSteps {
            steps: vec![step.clone(), step],
        },
    );
}

/// The golden bytes also still decode to the native frames.
#[test]
fn regress_golden_native_frames() {
    let read = |name: &str| std::fs::read(PathBuf::from(FOLDER).join(name)).expect("a golden file");
    let message = Message::decode(read("SensorFrame.bin").as_slice()).expect("it decodes");
    assert_eq!(SensorFrame::try_from(&message), Ok(sensors()));
    let message = Message::decode(read("MotorCommand.bin").as_slice()).expect("it decodes");
    assert_eq!(CommandFrame::from_proto(&message, 6), Ok(command()));
    let message = Message::decode(read("FdiReport.bin").as_slice()).expect("it decodes");
    assert_eq!(FdiReport::from_proto(&message, 6), Ok(report()));
    let message = Message::decode(read("FdiReport-pair.bin").as_slice()).expect("it decodes");
    assert_eq!(FdiReport::from_proto(&message, 6), Ok(report_of_a_pair()));
}

fn rotors() -> Vec<Rotor> {
    [
        (0.25, 0.125, 1),
        (0.0, 0.275, -1),
        (-0.25, 0.125, 1),
        (-0.25, -0.125, -1),
    ]
    .map(|(forward, right, spin)| Rotor {
        position_m: Some(BodyVector {
            forward,
            right,
            down: 0.0,
        }),
        spin,
        moment_ratio_m: 0.015625,
    })
    .to_vec()
}

fn body() -> RigidBody {
    RigidBody {
        mass_kg: 1.55,
        inertia_body_kg_m2: vec![0.0266, 0.0265, 0.0498],
        gravity_m_s2: 9.81,
        linear_drag_n_s_m: 0.125,
        angular_drag_nm_s: 0.0625,
    }
}

fn thrust_map() -> ThrustMap {
    ThrustMap {
        coef: vec![-1.4310e-2, 4.6339e-3, 1.0350e-4, -1.7318e-7],
        voltage_offset_v: 5.2859,
    }
}

fn setup(role: Role, parameters: setup::Parameters) -> Setup {
    Setup {
        run_id: STAMP.run_id,
        role: role.into(),
        protocol_version: 1,
        model_hash: "b5bb9d8014a0f9b1".to_owned(),
        step_count: 36_000,
        scenario: "reference flight".to_owned(),
        fdi_batch: 32,
        plant_pid: 4321,
        plant_host: "bench".to_owned(),
        plant_process_space: 0x0123_4567_89ab_cdef,
        parameters: Some(parameters),
    }
}

#[test]
fn regress_golden_hand_shake() {
    check(
        "Join",
        &Join {
            run_id: STAMP.run_id,
            role: Role::Fdi.into(),
            protocol_version: 1,
            program: "rotortwin-fdi 0.1.0".to_owned(),
            host: "bench".to_owned(),
            pid: 1234,
            process_space: 0x0123_4567_89ab_cdef,
        },
    );
    let refusal = "ControllerSetup.rotors[2].spin is 0".to_owned();
    check(
        "Ready",
        &Ready {
            run_id: STAMP.run_id,
            role: Role::Controller.into(),
            refusal,
        },
    );
    let failure = "the controller died after step 5".to_owned();
    check(
        "Finish",
        &Finish {
            run_id: STAMP.run_id,
            steps: 6,
            failure,
        },
    );

    let gains = |k: f32| PidGains {
        proportional: 4.98 * k,
        integral: 2.08 * k,
        derivative: 3.9 * k,
    };
    let controller = ControllerSetup {
        rotors: rotors(),
        body: Some(body()),
        period_s: 0.0025,
        position_gains: vec![gains(1.0), gains(1.0), gains(2.0)],
        attitude_gains: vec![gains(48.0), gains(48.0), gains(4.0)],
        tilt_limit_rad: 0.6108652,
        thrust_to_duty: Some(controller_setup::ThrustToDuty::FullThrustN(12.0059)),
        trim_duty: 0.388,
        trim_voltage_v: 16.0,
    };
    let by_map = ControllerSetup {
        thrust_to_duty: Some(controller_setup::ThrustToDuty::InverseMap(thrust_map())),
        ..controller.clone()
    };
    check(
        "Setup-controller",
        &setup(Role::Controller, setup::Parameters::Controller(controller)),
    );
    check(
        "Setup-controller-inverse-map",
        &setup(Role::Controller, setup::Parameters::Controller(by_map)),
    );

    let parameters = [("calibration_start", 2.0), ("evidence_to_isolate", 22.0)];
    let fdi = FdiSetup {
        rotors: rotors(),
        body: Some(body()),
        period_s: 0.0025,
        thrust_map: Some(thrust_map()),
        nominal_thrust: Some(fdi_setup::NominalThrust::StaticMap(true)),
        observer_gain: 5.0,
        window_len: 25,
        t_test: Some(TTestSetup {
            alpha_detect: 1e-10,
            alpha_isolate: 1e-8,
            calibration_start_s: 2.0,
            calibration_end_s: 10.0,
        }),
        network: None,
        sequential: Some(SequentialSetup {
            parameters: parameters.map(|(name, value)| (name.to_owned(), value)).into(),
        }),
        ground: None,
    };
    check("Setup-fdi", &setup(Role::Fdi, setup::Parameters::Fdi(fdi.clone())));
    let with_network = FdiSetup {
        nominal_thrust: Some(fdi_setup::NominalThrust::LagS(0.05)),
        network: Some(NetworkSetup {
            inputs: 2,
            hidden: 2,
            outputs: 3,
            hidden_weights: vec![0.5, -0.25, 0.125, 1.0],
            hidden_biases: vec![0.1, 0.2],
            output_weights: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
            output_biases: vec![-1.0, 0.0, 1.0],
            feature_means: vec![0.5, 0.25],
            feature_deviations: vec![2.0, 4.0],
            self_calibrated: true,
        }),
        ..fdi.clone()
    };
    check(
        "Setup-fdi-network",
        &setup(Role::Fdi, setup::Parameters::Fdi(with_network)),
    );
    let linear = FdiSetup {
        nominal_thrust: Some(fdi_setup::NominalThrust::LinearFullThrustN(12.0059)),
        ..fdi
    };
    check("Setup-fdi-linear", &setup(Role::Fdi, setup::Parameters::Fdi(linear)));
}
