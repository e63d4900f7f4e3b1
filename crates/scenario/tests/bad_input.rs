//! Documents that must be rejected, each with its error message.
#![expect(clippy::unwrap_used, reason = "a test that cannot write its documents has failed")]

use std::fs;
use std::path::PathBuf;

use proptest::prelude::*;
use rotortwin_scenario::{Documents, Scenario};

fn config() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config"))
}

fn read(path: &str) -> String {
    fs::read_to_string(config().join(path)).unwrap()
}

const BASE: &str = "\
name = 'bad'
description = 'to be spoilt'
vehicle = '../vehicles/f550.toml'
duration_s = 10.0
[trajectory]
kind = 'hover'
position_ned_m = [0.0, 0.0, -5.0]
";

/// Error message for the scenario `text`.
fn refusal(text: &str) -> String {
    Scenario::parse(text, config().join("scenarios")).map_or_else(|e| e.to_string(), |_| "accepted".to_owned())
}

/// Error message after replacing `from` by `to` in a valid scenario.
fn swapped(from: &str, to: &str) -> String {
    assert!(BASE.contains(from), "nothing to replace");
    refusal(&BASE.replace(from, to))
}

/// Error message after adding lines to a valid scenario, starting at line 8.
fn with(lines: &str) -> String {
    refusal(&format!("{BASE}{lines}\n"))
}

fn with_fault(lines: &str) -> String {
    with(&format!("[[fault]]\n{lines}"))
}

fn with_sensor_fault(lines: &str) -> String {
    with(&format!("[[sensor_fault]]\n{lines}"))
}

/// Error message for a vehicle or blade document with `from` replaced by `to`. The folder's name is cut off and the line of the
/// change reads `line #`, so that a new comment in a document breaks no test.
fn spoilt(file: &str, from: &str, to: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let mut line = 0;
    for path in [
        "blades/t9545.toml",
        "vehicles/f550.toml",
        "vehicles/f550-skids.toml",
        "vehicles/hexa-h.toml",
    ] {
        let text = read(path);
        let text = if path.ends_with(file) {
            let (before, _) = text.split_once(from).expect("nothing to replace");
            line = 1 + before.matches('\n').count();
            text.replacen(from, to, 1)
        } else {
            text
        };
        let target = folder.path().join(path);
        fs::create_dir_all(target.parent().unwrap()).unwrap();
        fs::write(target, text).unwrap();
    }
    let vehicle = file.strip_suffix(".toml").filter(|_| !file.starts_with("t9545"));
    let scenario = BASE.replace("f550", vehicle.unwrap_or("f550"));
    let path = folder.path().join("scenarios/bad.toml");
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, scenario).unwrap();
    let text = Scenario::load(&path).map_or_else(|e| e.to_string(), |_| "accepted".to_owned());
    text.replace(&format!("{}/", folder.path().display()), "")
        .replace(&format!("line {line}, "), "line #, ")
}

#[test]
fn val_the_base_is_in_order() {
    assert_eq!(refusal(BASE), "accepted");
}

#[test]
fn val_keys_and_types() {
    assert_eq!(
        swapped("duration_s = 10.0\n", ""),
        "scenario, key `duration_s`: missing key"
    );
    assert_eq!(
        swapped("duration_s", "duration_ms"),
        "scenario, line 4, key `duration_ms`: unknown key, expected `duration_s` (units are part of the names)"
    );
    assert_eq!(
        swapped("10.0", "'long'"),
        "scenario, line 4, key `duration_s`: expected a number, got string \"long\""
    );
    assert_eq!(
        swapped("duration_s = 10.0", "duration_s = 10.0\nduration_s = 11.0"),
        "scenario, line 5: expected valid TOML: duplicate key at `duration_s`"
    );
    assert_eq!(
        with("colour = 3.0"),
        "scenario, line 8, key `trajectory.colour`: unknown key, expected one of position_ned_m, yaw_rad"
    );
    assert_eq!(
        with("yaw_deg = 3.0"),
        "scenario, line 8, key `trajectory.yaw_deg`: unknown key, expected `yaw_rad` (units are part of the names)"
    );
    assert_eq!(
        swapped("'hover'", "'hoover'"),
        "scenario, line 6, key `trajectory.kind`: expected one of hover, helix, waypoints, got `hoover`"
    );
    assert_eq!(
        swapped("kind = 'hover'\n", ""),
        "scenario, line 5, key `trajectory.kind`: missing key"
    );
    assert_eq!(
        swapped("-5.0]", "-5.0, 1.0]"),
        "scenario, line 7, key `trajectory.position_ned_m`: expected a list of 3, got 4"
    );
    assert_eq!(
        swapped("-5.0]", "'up']"),
        "scenario, line 7, key `trajectory.position_ned_m[2]`: expected a number, got string \"up\""
    );
    assert_eq!(
        with("[controller]\nroll = { proportional = 1.0, integral = 2.0 }"),
        "scenario, line 9, key `controller.roll.derivative`: missing key"
    );
    assert_eq!(
        with("[fdi]\nwindow_samples = -3"),
        "scenario, line 9, key `fdi.window_samples`: expected a whole number, 0 or more, got integer `-3`"
    );
}

#[test]
fn val_ranges_and_not_a_number() {
    let expected = "scenario, line 4, key `duration_s`: expected a number from 0.0025 to 86400 s, got";
    assert_eq!(swapped("10.0", "nan"), format!("{expected} NaN"));
    assert_eq!(swapped("10.0", "-1"), format!("{expected} -1"));
    assert_eq!(swapped("10.0", "1e300"), format!("{expected} 1e300"));
    assert_eq!(
        swapped("-5.0]", "inf]"),
        "scenario, line 7, key `trajectory.position_ned_m[2]`: expected a number from -10000 to 10000 m, got inf"
    );
    assert_eq!(
        with("[initial]\nstate_of_charge = 90.0"),
        "scenario, line 9, key `initial.state_of_charge`: expected a number from 0.01 to 1, got 90"
    );
    assert_eq!(
        with("[controller]\npitch = { proportional = 1.0, integral = 2.0, derivative = nan }"),
        "scenario, line 9, key `controller.pitch.derivative`: expected a number from 0 to 100000 1/s, got NaN"
    );
    assert_eq!(
        with("[fdi]\ncalibration_end_s = 3"),
        "scenario, line 9, key `fdi.calibration_end_s`: the sequential detector needs it to be two correlation times of the gusts \
         after the start or later, 3600 s at most"
    );
    assert_eq!(
        with("[fdi]\ncalibration_start_s = 0.1"),
        "scenario, line 9, key `fdi.calibration_start_s`: the sequential detector needs it to be late enough for 200 samples in its \
         last three quarters, 600 s at most"
    );
    assert_eq!(
        with("[fdi]\ncalibration_end_s = 1"),
        "scenario, line 9, key `fdi.calibration_end_s`: expected an end of the calibration after its start at 2 s, got 1 s"
    );
    assert_eq!(
        refusal(&BASE.replace("kind = 'hover'", "kind = 'waypoints'").replace(
            "position_ned_m = [0.0, 0.0, -5.0]",
            "points_ned_m = [[0, 0, -5],\n[9, 0, -5]]\ninterval_s = 2\nspeed_m_s = 4"
        )),
        "scenario, line 8, key `trajectory.points_ned_m[1]`: expected a point at most 8 m from the one before (interval times \
         speed), got 9 m"
    );
}

#[test]
fn val_faults_without_effect() {
    let without = "this fault cannot have an effect:";
    assert_eq!(
        with_fault("time_s = 1.0\nrotor = 7\nblade = 'b'"),
        "scenario, line 10, key `fault[0].rotor`: expected a rotor from 1 to 6, got 7"
    );
    assert_eq!(
        with_fault("time_s = 1.0\nrotor = 1\nblade = 'z'"),
        "scenario, line 11, key `fault[0].blade`: expected one of the blades a, b, c, d, got z"
    );
    assert_eq!(
        with_fault("time_s = 1.0\nrotor = 1\nblade = 'a'"),
        format!("scenario, line 11, key `fault[0].blade`: {without} rotor 1 already has blade a")
    );
    assert_eq!(
        with_fault("time_s = 10.0\nrotor = 1\nblade = 'b'"),
        format!("scenario, line 9, key `fault[0].time_s`: {without} it sets in at 10 s, the flight ends at 10 s")
    );
    assert_eq!(
        with_fault("time_s = 1.0\nrotor = 1"),
        "scenario, line 8, key `fault[0]`: expected blade, rotor_lost, or thrust_loss_percent and moment_ratio_change_percent (one of \
         them or both)"
    );
    assert_eq!(
        with_fault("time_s = 1.0\nrotor = 1\nblade = 'b'\nramp_s = 1.0"),
        "scenario, line 12, key `fault[0].ramp_s`: a ramp needs thrust_loss_percent or moment_ratio_change_percent: a blade \
         is changed and a rotor is lost at once"
    );
    assert_eq!(
        with_fault("time_s = 1.0\nrotor = 1\nthrust_loss_percent = 0"),
        format!(
            "scenario, line 11, key `fault[0].thrust_loss_percent`: {without} rotor 1 already has a thrust loss of 0 %"
        )
    );
    assert_eq!(
        with_fault("time_s = 1.0\nrotor = 1\nrotor_lost = true\n[[fault]]\ntime_s = 2.0\nrotor = 1\nblade = 'b'"),
        format!("scenario, line 14, key `fault[1].rotor`: {without} rotor 1 was already lost")
    );
    assert_eq!(
        with_fault("time_s = 2.0\nrotor = 1\nblade = 'b'\n[[fault]]\ntime_s = 1.0\nrotor = 1\nblade = 'b'"),
        format!("scenario, line 11, key `fault[0].blade`: {without} rotor 1 already has blade b"),
        "in the order of time, not of the document"
    );
    assert_eq!(
        with_fault("time_s = 1.0\nrotor = 1\nblade = 'c'\n[[fault]]\ntime_s = 1.0\nrotor = 1\nblade = 'b'"),
        "scenario, line 12, key `fault[1]`: this rotor has another fault of the same kind at the same time: only one can act"
    );
}

#[test]
fn val_changes_in_percent_and_their_periods() {
    let refused = |lines: &str| with_fault(&format!("time_s = 1.0\nrotor = 1\n{lines}"));
    for (lines, line, key, reason) in [
        (
            "thrust_loss_percent = -31",
            11,
            "thrust_loss_percent",
            "expected a number from -30 to 100 %, got -31",
        ),
        (
            "moment_ratio_change_percent = -60",
            11,
            "moment_ratio_change_percent",
            "expected a number from -50 to 200 %, got -60",
        ),
        (
            "moment_ratio_change_percent = 0",
            11,
            "moment_ratio_change_percent",
            "this fault cannot have an effect: rotor 1 already has a change of its moment ratio of 0 %",
        ),
        (
            "thrust_loss_percent = 5\nperiod_s = 2",
            12,
            "period_s",
            "an intermittent fault needs on_s with it, s in each period",
        ),
        (
            "thrust_loss_percent = 5\non_s = 2",
            12,
            "on_s",
            "an intermittent fault needs period_s with it, s",
        ),
        (
            "thrust_loss_percent = 5\nperiod_s = 1\non_s = 1",
            13,
            "on_s",
            "expected less than period_s, 1 s, got 1 s: without a pause the fault is not intermittent",
        ),
        (
            "thrust_loss_percent = 5\nperiod_s = 1\non_s = nan",
            13,
            "on_s",
            "expected a number from 0.0025 to 1000000 s, got NaN",
        ),
        (
            "thrust_loss_percent = 5\nperiod_s = 1\non_s = 0.5\nramp_s = 1",
            14,
            "ramp_s",
            "an intermittent fault sets in and ends at once: expected ramp_s or period_s, not both",
        ),
        (
            "rotor_lost = true\nperiod_s = 1\non_s = 0.5",
            12,
            "period_s",
            "a period needs thrust_loss_percent or moment_ratio_change_percent: a blade is changed and a rotor is lost at once",
        ),
    ] {
        assert_eq!(
            refused(lines),
            format!("scenario, line {line}, key `fault[0].{key}`: {reason}")
        );
    }
    assert_eq!(
        refused("blade = 'b'\nmoment_ratio_change_percent = 5"),
        "scenario, line 8, key `fault[0]`: expected blade, rotor_lost, or thrust_loss_percent and moment_ratio_change_percent (one of \
         them or both)"
    );
}

#[test]
fn val_loads_that_cannot_be_dropped() {
    let refused = |lines: &str| with(&format!("[[load_drop]]\n{lines}"));
    for (lines, line, key, reason) in [
        (
            "time_s = 10\nmass_kg = 0.1",
            9,
            ".time_s",
            "this load cannot have an effect: it is dropped at 10 s, the flight ends at 10 s",
        ),
        (
            "time_s = 0\nmass_kg = 0.1",
            9,
            ".time_s",
            "expected a number from 0.0025 to 1000000 s, got 0",
        ),
        (
            "time_s = 1\nmass_kg = -0.1",
            10,
            ".mass_kg",
            "expected a number from 0.0001 to 100 kg, got -0.1",
        ),
        (
            "time_s = 1\nmass_kg = 1.0",
            10,
            ".mass_kg",
            "expected loads of at most 0.775 kg together, 50 % of the vehicle's mass, which includes them; got 1 kg",
        ),
        (
            "time_s = 1\nmass_kg = 0.3\nposition_body_m = [0, 0, 0.3]",
            11,
            ".position_body_m",
            "expected a place nearer to the centre of mass: the vehicle's inertia includes the load, and 0.3 kg there have more of it \
             than the vehicle",
        ),
        (
            "time_s = 1\nmass_g = 300",
            10,
            ".mass_g",
            "unknown key, expected `mass_kg` (units are part of the names)",
        ),
        ("time_s = 1", 8, ".mass_kg", "missing key"),
    ] {
        assert_eq!(
            refused(lines),
            format!("scenario, line {line}, key `load_drop[0]{key}`: {reason}")
        );
    }
}

#[test]
fn val_ground_that_carries_nothing() {
    const CONTACT: &str = "[ground]\ndown_m = 0.0\n[ground.contact]\n";
    let with = |lines: &str| refusal(&format!("{}{lines}\n", BASE.replace("f550", "f550-skids")));
    assert_eq!(with(CONTACT), "accepted");
    assert_eq!(with(&format!("{CONTACT}[initial]\nstart = 'on-ground'")), "accepted");
    assert_eq!(
        with("[initial]\nstart = 'on-ground'"),
        "scenario, line 9, key `initial.start`: a flight that begins on the ground needs ground that carries the vehicle: give \
         `[ground.contact]`"
    );
    assert_eq!(
        with(&format!("{CONTACT}friction = -0.1")),
        "scenario, line 11, key `ground.contact.friction`: expected a number from 0 to 2, got -0.1"
    );
    assert_eq!(
        with(&format!("{CONTACT}sink_m = 0.0")),
        "scenario, line 11, key `ground.contact.sink_m`: expected a number from 0.0002 to 0.02 m, got 0"
    );
    assert_eq!(
        with(&format!("{CONTACT}slope = 3.0")),
        "scenario, line 11, key `ground.contact.slope`: unknown key, expected `slope_deg` (units are part of the names)"
    );
    assert_eq!(
        with("[ground]\ndown_m = -6.0\n[ground.contact]"),
        "scenario, line 9, key `ground.down_m`: expected a ground below the first point of the trajectory, it is 1.000 m above it"
    );
    assert_eq!(
        refusal(&format!("{BASE}{CONTACT}")),
        "scenario, line 10, key `ground.contact`: the vehicle has no feet to stand on: give `landing_gear.feet_body_m` in its document"
    );
    assert_eq!(
        with(&format!("{CONTACT}slope_deg = 44.0\n[initial]\nstart = 'on-ground'")),
        "scenario, line 11, key `ground.contact.slope_deg`: the vehicle does not stand on a slope of 44°: it tips over or its rotors \
         touch the ground"
    );
    let feet = |to: &str| spoilt("f550-skids.toml", "[0.10, 0.13, 0.18],", to);
    assert_eq!(
        feet("[0.10, 0.13, -0.18],"),
        "vehicles/f550-skids.toml, line #, key `landing_gear.feet_body_m[0][2]`: expected a number from 0.001 to 5 m, got -0.18"
    );
    let ahead = "[0.10, 0.13, 0.18], [0.2, 0.0, 0.18]]\nunused = [";
    assert!(feet(ahead).contains("landing_gear.unused"));
}

#[test]
fn val_instruments_that_nobody_builds() {
    assert_eq!(with("[instruments]\ngps_rate_hz = 5.0"), "accepted");
    assert_eq!(
        with("[instruments]\ngps_rate_hz = 0.0"),
        "scenario, line 9, key `instruments.gps_rate_hz`: expected a number from 1 to 50 Hz, got 0"
    );
    assert_eq!(
        with("[instruments]\nhome = { latitude_deg = 95.0, longitude_deg = 0.0, altitude_m = 0.0 }"),
        "scenario, line 9, key `instruments.home.latitude_deg`: expected a number from -85 to 85 degrees, got 95"
    );
    assert_eq!(
        with("[instruments]\ngps_rate = 5.0"),
        "scenario, line 9, key `instruments.gps_rate`: unknown key, expected `gps_rate_hz` (units are part of the names)"
    );
}

#[test]
fn val_feet_beside_the_centre_of_mass() {
    let said = spoilt(
        "f550-skids.toml",
        "[-0.10, 0.13, 0.18],\n    [-0.10, -0.13, 0.18],",
        "[0.20, 0.0, 0.18],",
    );
    assert!(
        said.ends_with(
            "key `landing_gear.feet_body_m`: expected feet around the centre of mass: seen from above it is not between them"
        ),
        "{said}"
    );
}

#[test]
fn val_wind_without_effect() {
    assert_eq!(
        with("[wind]\nmean_ned_m_s = [1.0, 0.0, 0.0]"),
        "scenario, line 8, key `wind`: wind cannot have an effect on this vehicle: its linear drag is 0, so no air force acts \
         on it; give `body.linear_drag_kg_s` of the vehicle or `mismatch.linear_drag_kg_s` of the scenario"
    );
    assert_eq!(
        with("[mismatch]\nlinear_drag_kg_s = 0.2\n[wind]\ngust_rms_m_s = 0.0"),
        "scenario, line 10, key `wind`: expected some wind, mean and gusts are both 0: leave the section out"
    );
    assert_eq!(
        with("[mismatch]\npreset = 'realistic'\n[wind]\ngust_rms_m_s = 1.0"),
        "accepted"
    );
}

#[test]
fn val_sensor_faults_without_effect() {
    let without = "this fault cannot have an effect:";
    let fault = "time_s = 1.0\nsensor = 'velocity'";
    let key = "key `sensor_fault[0]";
    assert_eq!(
        with_sensor_fault(&format!("{fault}\ndelay_s = 0.0")),
        format!("scenario, line 11, {key}.delay_s`: {without} less than half a step of 2.5 ms")
    );
    assert_eq!(
        with_sensor_fault(&format!("{fault}\nbias_si = [0, 0, 0]")),
        format!("scenario, line 11, {key}.bias_si`: {without} the bias is 0")
    );
    assert_eq!(
        with_sensor_fault(&format!("{fault}\nbias_si = [1]")),
        format!("scenario, line 11, {key}.bias_si`: expected a list of 3 for this sensor, got 1")
    );
    assert_eq!(
        with_sensor_fault(&format!("{fault}\ndropout_probability = 0")),
        format!("scenario, line 11, {key}.dropout_probability`: {without} no sample is lost with probability 0")
    );
    assert_eq!(
        with_sensor_fault(&format!("{fault}\nend_s = 0.5\nstuck = true")),
        format!("scenario, line 11, {key}.end_s`: {without} expected an end after its onset at 1 s")
    );
    assert_eq!(
        with_sensor_fault("time_s = 11\nsensor = 'velocity'\nstuck = true"),
        format!("scenario, line 9, {key}.time_s`: {without} the flight ends at 10 s")
    );
    assert_eq!(
        with_sensor_fault(&format!(
            "{fault}\nstuck = true\n[[sensor_fault]]\n{fault}\ndelay_s = 0.1"
        )),
        format!("scenario, line 12, key `sensor_fault[1]`: {without} the sensor is stuck all the time")
    );
    assert_eq!(
        with_sensor_fault("time_s = 0\nsensor = 'gyro'\nstuck = true"),
        "scenario, line 10, key `sensor_fault[0].sensor`: expected one of position, velocity, attitude, body-rates, \
         battery-voltage, got `gyro`"
    );
}

#[test]
fn val_vehicle_and_blades() {
    assert_eq!(
        spoilt("f550.toml", "mass_kg = 1.55", "mass_g = 1550"),
        "vehicles/f550.toml, line #, key `body.mass_g`: unknown key, expected `mass_kg` (units are part of the names)"
    );
    assert_eq!(
        spoilt("f550.toml", "capacity_ah = 6.75", "capacity_ah = 6750"),
        "vehicles/f550.toml, line #, key `battery.capacity_ah`: expected a number from 0.05 to 1000 Ah, got 6750"
    );
    assert_eq!(
        spoilt("f550.toml", "[0.0266, 0.0266, 0.0498]", "[0.0266, 0.0266, 0.498]"),
        "vehicles/f550.toml, line #, key `body.inertia_body_kg_m2`: expected moments of inertia of which none exceeds the sum \
         of the others, got 0.0266, 0.0266, 0.498"
    );
    assert_eq!(
        spoilt("f550.toml", "3.61, 3.69", "3.69, 3.61"),
        "vehicles/f550.toml, line #, key `battery.cell_open_circuit_voltage_v[2]`: expected a voltage that never falls with \
         charge, it does at 3.61"
    );
    assert_eq!(
        spoilt("f550.toml", "rotors = 6 ", "rotors = 5 "),
        "vehicles/f550.toml, line #, key `rotors.layout.rotors`: expected an even number of rotors from 4 to 16, got 5"
    );
    assert_eq!(
        spoilt("f550.toml", "\"../blades/t9545.toml\"", "\"../blades\""),
        "vehicles/f550.toml, line #, key `rotors.blades`: expected the path of a TOML file, blades is a folder"
    );
    // The controller's thrust map is in the vehicle's file.
    assert_eq!(
        spoilt("f550.toml", "full_thrust_n = 12.0059", "full_thrust_n = 2.0"),
        "vehicles/f550.toml, line #, key `rotors.full_thrust_n`: expected more than any rotor gives in hover (2.534 N in the \
         mean), got 2 N: rotor 1 cannot give the thrust that hover asks of it"
    );
    assert_eq!(
        spoilt("f550.toml", "t9545.toml", "none.toml"),
        "vehicles/f550.toml, line #, key `rotors.blades`: expected the path of a TOML file, found none at blades/none.toml"
    );
    assert_eq!(
        spoilt("f550.toml", "nominal_blade = \"a\"", "nominal_blade = \"z\""),
        "vehicles/f550.toml, line #, key `rotors.nominal_blade`: expected one of the blades a, b, c, d, got z"
    );
    assert_eq!(
        spoilt("f550.toml", "mass_kg = 1.55", "mass_kg = 9.00"),
        "scenarios/bad.toml, line 3, key `vehicle`: this vehicle cannot hover at a charge of 0.9: rotor 1 would have to give \
         14.715 N, it can give 0 to 11.506 N"
    );
    // Eq. 19 with the duty as a fraction: coefficients in the wrong unit do not increase with duty.
    assert_eq!(
        spoilt("t9545.toml", "1.0350e-4, -1.7318e-7", "1.0350e-4, -1.7318e-3"),
        "blades/t9545.toml, line #, key `blade.a.coefficients`: expected a lift that rises with duty from 10 % to 100 % \
         (Eq. 19, duty in percent)"
    );
}

#[test]
fn val_rotor_lists() {
    assert_eq!(
        spoilt("hexa-h.toml", "number = 3", "number = 2"),
        "vehicles/hexa-h.toml, line #, key `rotors.layout.rotor[2].number`: expected each rotor once, rotor 2 is given twice"
    );
    assert_eq!(
        spoilt("hexa-h.toml", "spin = \"cw\"", "spin = \"left\""),
        "vehicles/hexa-h.toml, line #, key `rotors.layout.rotor[1].spin`: expected one of ccw, cw, got `left`"
    );
    let coaxial = spoilt("hexa-h.toml", "[-0.30, 0.20, 0.0]", "[0.30, 0.20, -0.1]");
    assert!(
        coaxial.starts_with("vehicles/hexa-h.toml, line ")
            && coaxial.contains(", key `rotors.layout`: rotors 1 and 3 are coaxial and turn the same way: "),
        "{coaxial}"
    );
    let counter_rotating = spoilt("hexa-h.toml", "[0.00, 0.24, 0.0]", "[0.30, 0.20, -0.1]");
    assert_eq!(counter_rotating, "accepted");
    let lame = spoilt(
        "hexa-h.toml",
        "position_body_m = [0.00, 0.24, 0.0]",
        "position_body_m = [0.00, 2.40, 0.0]",
    );
    assert_eq!(lame, "accepted", "unusual, and within reach");
}

#[test]
fn val_files() {
    let folder = tempfile::tempdir().unwrap();
    let load = |name: &str| {
        let error = Scenario::load(folder.path().join(name))
            .map(|_| ())
            .unwrap_err()
            .to_string();
        error.replace(&format!("{}/", folder.path().display()), "")
    };
    assert_eq!(load("none.toml"), "none.toml: file not found; expected a TOML file");
    fs::create_dir(folder.path().join("dir.toml")).unwrap();
    assert_eq!(
        load("dir.toml"),
        "dir.toml: expected a TOML file, this is not a regular file"
    );
    fs::write(folder.path().join("binary.toml"), [0xff, 0xfe, 0x00]).unwrap();
    assert_eq!(load("binary.toml"), "binary.toml: expected UTF-8 text");
    fs::write(folder.path().join("large.toml"), "#".repeat(1_048_577)).unwrap();
    assert_eq!(
        load("large.toml"),
        "large.toml: expected a document of at most 1048576 bytes, this one has 1048577"
    );
    fs::write(folder.path().join("empty.toml"), "").unwrap();
    assert_eq!(load("empty.toml"), "empty.toml, key `name`: missing key");
}

#[test]
fn val_overrides() {
    let path = config().join("scenarios/hover.toml");
    let load = |overrides: &[&str]| Scenario::load_with(&path, overrides);
    let scenario = load(&["seed=7", "initial.state_of_charge = 0.4", "mismatch.preset=none"]).unwrap();
    assert_eq!((scenario.seed(), scenario.document().initial.state_of_charge), (7, 0.4));
    let refused = |overrides: &[&str]| {
        let text = load(overrides).map(|_| ()).unwrap_err().to_string();
        text.rsplit('/').next().unwrap().to_owned()
    };
    assert_eq!(
        refused(&["initial.state_of_charge=4"]),
        "hover.toml, key `initial.state_of_charge`: expected a number from 0.01 to 1, got 4"
    );
    assert_eq!(
        refused(&["seed"]),
        "hover.toml: expected an override key=value, got `seed`"
    );
    assert_eq!(
        refused(&["name.short=x"]),
        "hover.toml: expected a key within tables, got `name.short=x`"
    );
    // Entries as errors and the axes of campaigns write them.
    let faulty = config().join("scenarios/reference-flight.toml");
    let moved = Scenario::load_with(&faulty, &["fault[1].rotor=2"]).unwrap();
    let rotors =
        |scenario: &Scenario| -> Vec<_> { scenario.document().fault.iter().map(|fault| fault.rotor).collect() };
    let mut expected = rotors(&Scenario::load(&faulty).unwrap());
    expected[1] = 2;
    assert_eq!(rotors(&moved), expected);
    for key in ["fault[0].rotor", "fault[x].rotor", "seed[0].x"] {
        let text = refused(&[&format!("{key}=2")]);
        assert!(text.contains("expected an entry that the document has"), "{text}");
    }
}

#[test]
fn val_effective_configuration_reads_back() {
    let scenario = Scenario::load(config().join("scenarios/realistic-reference-flight.toml")).unwrap();
    let text = scenario.documents().to_toml();
    let read = Documents::from_toml("effective", &text).unwrap();
    assert_eq!(&read, scenario.documents());
    assert_eq!(Scenario::from_documents(&read).unwrap().documents().to_toml(), text);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever is cut out of a document or inserted: a result, no panic; and the error is one line.
    #[test]
    fn prop_mangled_documents_are_answered(at in 0.0..1.0f64, cut in 0usize..40, put in "[-a-z0-9_\\[\\]{}=.,'\"# \n]{0,12}") {
        let text = read("scenarios/reference-flight.toml");
        let boundary = |i: usize| (0..=i.min(text.len())).rev().find(|&i| text.is_char_boundary(i)).unwrap();
        let start = boundary((at * text.len() as f64) as usize);
        let end = boundary(start + cut).max(start);
        let mangled = format!("{}{put}{}", &text[..start], &text[end..]);
        let answer = refusal(&mangled);
        prop_assert!(!answer.contains('\n'), "{answer}");
    }
}
