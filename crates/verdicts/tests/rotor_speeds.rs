//! Logs with measured rotor speeds and without duties or a voltage: flights on ESCs and motors whose speeds are states of the plant.

use rotortwin_flight::stepped::SteppedFlight;
use rotortwin_scenario::{DetectorSettings, Detectors, Scenario, VehicleDocuments};
use rotortwin_twin::log::{FlightLog, names};
use rotortwin_verdicts::log::{LogReport, judge};

const VEHICLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/vehicles");

/// c_L of the speeds in the log, N·s²: unknown to the detectors.
const LIFT: f64 = 9.4e-6;

/// Motion capture and ESC telemetry of 40 s, in which rotor 2 loses `percent` at 20 s.
fn flown(percent: f64, seed: u64) -> FlightLog {
    let text = format!(
        "name = 'motors'\ndescription = ''\nvehicle = 'f550-motors.toml'\nduration_s = 40.0\n\
         mismatch = {{ preset = 'realistic' }}\n\
         trajectory = {{ kind = 'helix', radius_m = 2.0, turn_s = 12.0, start_height_m = 5.0, climb_amplitude_m = 1.0, climb_period_s = 30.0, yaw_amplitude_rad = 0.0 }}\n{}",
        if percent > 0.0 {
            format!("[[fault]]\ntime_s = 20.0\nrotor = 2\nthrust_loss_percent = {percent}\n")
        } else {
            String::new()
        }
    );
    let scenario = Scenario::parse(&text, VEHICLES).unwrap_or_else(|error| panic!("{error}"));
    let mut flight = SteppedFlight::new(&scenario, seed).expect("it flies");
    let mut time_s = Vec::new();
    let mut motion = vec![Vec::new(); 9];
    let mut speeds = vec![Vec::new(); 6];
    let mut duties = vec![Vec::new(); 6];
    let mut voltage = Vec::new();
    while !flight.done() {
        let sample = flight.step(None).expect("it goes on");
        let nav = sample.sensors.nav();
        time_s.push(sample.truth.sim_time_ns as f64 * 1e-9);
        let values = [
            nav.velocity_ned.to_array(),
            [nav.attitude.roll, nav.attitude.pitch, nav.attitude.yaw],
            nav.body_rates.to_array(),
        ];
        for (column, value) in motion.iter_mut().zip(values.as_flattened()) {
            column.push(f64::from(*value));
        }
        for rotor in 0..6 {
            let healthy = sample.truth.rotor_thrust_n[rotor] / (1.0 - sample.truth.rotor_thrust_loss[rotor]);
            // Telemetry counts whole turns a minute.
            let rpm = ((healthy.max(0.0) / LIFT).sqrt() * 60.0 / std::f64::consts::TAU).round();
            speeds[rotor].push(rpm * std::f64::consts::TAU / 60.0);
            duties[rotor].push(f64::from(sample.command.duty[rotor]));
        }
        voltage.push(f64::from(sample.sensors.battery_voltage_v));
    }
    let names_of_motion = [names::VELOCITY, names::ATTITUDE, names::RATES].concat();
    let mut columns: Vec<(String, Vec<f64>)> = names_of_motion
        .iter()
        .map(|name| (*name).to_owned())
        .zip(motion)
        .collect();
    columns.extend((1..=6).map(names::rotor_speed).zip(speeds));
    columns.extend((1..=6).map(names::duty).zip(duties));
    columns.push((names::BATTERY_VOLTAGE.to_owned(), voltage));
    FlightLog::from_columns("speeds", time_s, columns).expect("a good log")
}

/// Without the channels that the detectors use if there are no speeds.
fn with_speeds_alone(mut log: FlightLog) -> FlightLog {
    log.columns.remove(names::BATTERY_VOLTAGE);
    for rotor in 1..=6 {
        log.columns.remove(&names::duty(rotor));
    }
    log
}

fn judged(log: &FlightLog) -> LogReport {
    let documents = VehicleDocuments::load(format!("{VEHICLES}/f550.toml")).expect("shipped");
    let detectors = Detectors::new(documents, &DetectorSettings::default(), None).expect("a good configuration");
    judge(log, &detectors, true).expect("judged")
}

#[test]
fn val_a_propeller_that_lifts_less_at_its_speed_is_named() {
    for seed in [1, 2, 3] {
        let report = judged(&with_speeds_alone(flown(8.0, seed)));
        let lack = &report.lacks[0];
        assert!(
            !lack.prevents_verdicts && lack.rules_out.contains("rotor speeds"),
            "{lack:?}"
        );
        assert_eq!(lack.columns.len(), 7, "{lack:?}");
        let before: Vec<i32> = report
            .windows
            .iter()
            .filter(|window| window.time_s < 20.0)
            .map(|window| window.sequential.verdict.code)
            .collect();
        assert!(
            before.contains(&0) && !before.iter().any(|code| *code > 0),
            "seed {seed}: {before:?}"
        );
        let last = report.final_window.expect("judged").sequential;
        assert_eq!(last.verdict.code, 2, "seed {seed}: {last:?}");
        let loss = last.thrust_loss.iter().find(|loss| loss.rotor == 2).expect("a size");
        let [low, high] = [loss.share_low, loss.share_high].map(f64::from);
        assert!(low < 0.08 && 0.08 < high && high - low < 0.04, "seed {seed}: {loss:?}");
    }
}

#[test]
fn val_a_healthy_flight_is_healthy_by_its_speeds() {
    let report = judged(&with_speeds_alone(flown(0.0, 4)));
    assert!(
        report.counts[2].decided > 300 && report.counts[2].alarms == 0,
        "{:?}",
        report.counts
    );
}

#[test]
fn regress_speeds_change_nothing_where_duties_and_voltage_are_there() {
    let log = flown(8.0, 5);
    let mut without = log.clone();
    for rotor in 1..=6 {
        without.columns.remove(&names::rotor_speed(rotor));
    }
    let of = |log: &FlightLog| serde_json::to_value(judged(log).windows).expect("JSON");
    assert_eq!(of(&log), of(&without));
}

#[test]
fn val_slow_telemetry_is_not_taken() {
    let mut log = with_speeds_alone(flown(0.0, 6));
    for rotor in 1..=6 {
        let column = log.columns.get_mut(&names::rotor_speed(rotor)).expect("there");
        // 5 Hz, held.
        for row in 0..column.len() {
            column[row] = column[row - row % 80];
        }
    }
    let held = FlightLog::from_columns("held", log.time_s.clone(), log.columns.clone()).expect("a good log");
    let report = judged(&held);
    assert!(
        report.lacks.iter().any(|lack| lack.prevents_verdicts),
        "{:?}",
        report.lacks
    );
}
