//! Outputs of autopilots on shipped vehicles.
#![expect(clippy::unwrap_used, reason = "a test that cannot read the configuration has failed")]

use rotortwin_plant::vehicle::model::VehicleModel;
use rotortwin_scenario::autopilot_frame::{AutopilotFrame, AutopilotKind};
use std::path::Path;

fn vehicle(name: &str) -> VehicleModel {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../config/vehicles/{name}.toml"));
    toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Name of the frame that fits a vehicle, and our rotor, from 1, of each of its channels.
fn channels(autopilot: AutopilotKind, name: &str) -> (String, Vec<usize>) {
    let (frame, rotors) = AutopilotFrame::of_vehicle(autopilot, &vehicle(name)).unwrap();
    (frame.name, rotors.iter().map(|rotor| rotor + 1).collect())
}

#[test]
fn val_channels_of_a_hexarotor_x_are_those_observed_in_flight() {
    let expected = [
        (AutopilotKind::ArduPilot, [2, 5, 6, 3, 1, 4]),
        (AutopilotKind::Px4, [2, 5, 6, 3, 1, 4]),
        (AutopilotKind::Betaflight, [3, 1, 4, 6, 2, 5]),
    ];
    for (autopilot, numbers) in expected {
        let (frame, found) = channels(autopilot, "f550");
        assert_eq!(found, numbers, "{frame}");
    }
}

#[test]
fn val_channels_of_a_quadrotor_x_are_those_of_the_frames_tables() {
    // Rotor 1 front right, then clockwise: 1 front right, 2 rear right, 3 rear left, 4 front left.
    let expected = [
        (AutopilotKind::ArduPilot, [1, 3, 4, 2]),
        (AutopilotKind::Px4, [1, 3, 4, 2]),
        (AutopilotKind::Betaflight, [2, 1, 3, 4]),
    ];
    for (autopilot, numbers) in expected {
        for name in ["quad-x", "quad-x-skids"] {
            let (frame, found) = channels(autopilot, name);
            assert_eq!(found, numbers, "{frame}");
        }
    }
}

/// `AP_MotorsMatrix`, OCTAQUAD X: motors 1 to 4 above, front right, front left, rear left, rear right; 5 to 8 below, front left first.
#[test]
fn val_channels_of_a_coaxial_octorotor_are_found_by_place_and_spin() {
    for autopilot in [AutopilotKind::ArduPilot, AutopilotKind::Px4] {
        let (frame, found) = channels(autopilot, "x8-skids");
        assert!(frame.ends_with("octaquad-x"), "{frame}");
        assert_eq!(found, [1, 7, 5, 3, 8, 2, 4, 6], "{frame}");
    }
}

#[test]
fn val_channels_of_an_octorotor_x_are_those_of_the_frames_tables() {
    // Rotor 1 front right, then clockwise; ArduPilot's AP_MotorsMatrix, PX4's airframe 8001, Betaflight's mixerOctoFlatX.
    let expected = [
        (
            AutopilotKind::ArduPilot,
            "octo-x-skids",
            "ardupilot-octo-x",
            [1, 5, 2, 4, 8, 6, 7, 3],
        ),
        (
            AutopilotKind::ArduPilot,
            "octo-x",
            "ardupilot-octo-cw-x",
            [1, 2, 3, 4, 5, 6, 7, 8],
        ),
        (
            AutopilotKind::Px4,
            "octo-x-skids",
            "px4-octo-x",
            [1, 5, 2, 4, 8, 6, 7, 3],
        ),
        (
            AutopilotKind::Betaflight,
            "octo-x",
            "betaflight-octoflatx",
            [7, 1, 3, 5, 8, 2, 4, 6],
        ),
        (
            AutopilotKind::Betaflight,
            "octo-x-skids",
            "betaflight-octoflatx-reversed",
            [7, 1, 3, 5, 8, 2, 4, 6],
        ),
    ];
    for (autopilot, name, frame_name, numbers) in expected {
        assert_eq!(channels(autopilot, name), (frame_name.to_owned(), numbers.to_vec()));
    }
}

#[test]
fn val_a_vehicle_without_a_frame_is_named() {
    // Its rotors turn the other way.
    let sentence = AutopilotFrame::of_vehicle(AutopilotKind::Px4, &vehicle("octo-x")).unwrap_err();
    assert_eq!(
        sentence,
        "no frame of PX4 fits the vehicle Octo X (px4-hexa-x: it has 6 motors, the vehicle 8; px4-quad-x: it has 4 motors, the vehicle 8; \
         px4-octo-x: its motor 1 spins opposite to rotor 1 of the vehicle; px4-octaquad-x: its motor 1 at 45° matches no rotor of the vehicle)"
    );
}

#[test]
fn val_bad_frames_are_refused_with_line_and_key() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/autopilots/px4-hexa-x.toml");
    let good = std::fs::read_to_string(path).unwrap();
    let said = |from: &str, to: &str| {
        assert!(good.contains(from));
        AutopilotFrame::parse("frame", &good.replacen(from, to, 1))
            .unwrap_err()
            .to_string()
    };
    assert_eq!(
        said("channel = 2", "channel = 1"),
        "frame, line 19, key `motor[1].channel`: expected each channel from 1 to 6 once, got 1"
    );
    assert_eq!(
        said("max_us = 2000.0", "max_us = 900.0"),
        "frame, line 10, key `pulse.max_us`: expected a number from 1100 to 2500 µs, got 900"
    );
    assert_eq!(
        said("spin = \"cw\"", "spin = \"left\""),
        "frame, line 16, key `motor[0].spin`: expected one of ccw, cw, got `left`"
    );
}
