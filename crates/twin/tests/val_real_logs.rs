//! Real logs with known damage and loads. Skipped if they are not present outside the repository.

mod development_data;

use development_data::shared;
use rotortwin_twin::baseline::trim;
use rotortwin_twin::compare::{NamedModel, compare};
use rotortwin_twin::diagnose::{Options, Verdict, diagnose};
use rotortwin_twin::identify::{Request, Source, files, held_out, identify};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;
use rotortwin_twin::predict::NAMES;
use std::path::{Path, PathBuf};

fn model(vehicle: &str) -> ModelVersion {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../config/vehicles/{vehicle}.toml"));
    ModelVersion::load(&path).expect(vehicle)
}

fn logs_in(folder: &Path) -> Vec<FlightLog> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    paths.sort();
    paths
        .iter()
        .map(|path| FlightLog::read(path).expect("accepted"))
        .collect()
}

#[test]
fn val_cut_propellers_are_told_from_healthy_flights() {
    let Some(folder) = shared("data/real/crazypad_e8/motor_data") else {
        return;
    };
    let model = model("crazyflie-e8");
    let healthy = logs_in(&folder.join("normal_flight"));
    for one in 0..healthy.len() {
        let mut others = healthy.clone();
        let flown = others.remove(one);
        let found = trim(&[flown], &others, &model).expect("a trim");
        assert!(found.named.is_empty(), "healthy flight {one}: {}", found.sentence);
    }
    for entry in std::fs::read_dir(&folder).expect("a folder") {
        let case = entry.expect("an entry").path();
        let name = case.file_name().expect("a name").to_string_lossy().into_owned();
        if !name.starts_with("cut_propeller_M3") {
            continue;
        }
        let found = trim(&logs_in(&case), &healthy, &model).expect("a trim");
        // Never another rotor; and rotor 3 where both blades lost more than a tenth of their length together.
        assert!(
            found.named.first().is_none_or(|c| c.rotor == Some(3)),
            "{name}: {}",
            found.sentence
        );
        if name.contains("3.5mm_3") || name.contains("3mm_3mm") {
            assert_eq!(found.named.len(), 1, "{name}: {}", found.sentence);
        }
    }
}

#[test]
fn val_a_slung_load_of_grams_is_among_what_is_missing() {
    let Some(folder) = shared("data/real/crazyswarm2_slung_load/logs") else {
        return;
    };
    let log = FlightLog::read(&folder.join("log184")).expect("accepted");
    let found = diagnose(&[log], &model("crazyflie-lee"), &Options::default()).expect("a diagnosis");
    assert!(
        found.notes.iter().any(|note| note.contains("taken as uncalibrated")),
        "{:?}",
        found.notes
    );
    let load = found
        .effects
        .iter()
        .find(|f| f.instance.effect == "slung-load")
        .unwrap_or_else(|| panic!("{}", found.sentence));
    let value = |name: &str| load.parameters.iter().find(|p| p.name == name).expect(name).value;
    // Payload over vehicle 0.16 by its makers' motion capture, the rope 0.51 m. Much else of this log is unexplained, so that the fit's
    // own intervals (0.16 ± 0.02, 0.42 ± 0.02 m) are too narrow.
    assert!((value("mass_kg") / 0.032 - 0.16).abs() < 0.08, "{}", found.sentence);
    assert!((value("length_m") - 0.51).abs() < 0.1, "{}", found.sentence);
}

/// Of its 47 s it flies for five; the mean duty of all of them, a third of that in flight, made the unknown force between two commands three times as
/// large.
#[test]
fn regress_the_error_of_slow_commands_is_that_of_the_flight() {
    let Some(folder) = shared("data/real/arpl_crazyflie_sysid") else {
        return;
    };
    let log = FlightLog::read(&folder.join("log16")).expect("accepted");
    let model = NamedModel {
        label: "crazyflie-2".to_owned(),
        version: model("crazyflie-2"),
    };
    let (comparison, _) = compare(&[log], &[model]).expect("a comparison");
    let one = &comparison.logs[0];
    assert!((0.2..1.6).contains(&one.noise.accel_m_s2), "{:?}", one.noise);
    let bound = |note: &String| note.contains("motor outputs 530.1 Hz") && note.contains("at most");
    assert!(one.notes.iter().any(bound), "{:?}", one.notes);
}

#[test]
fn val_a_motor_lag_that_is_off_by_factors_is_named_with_its_value() {
    let Some(folder) = shared("data/real/arpl_crazyflie_sysid") else {
        return;
    };
    let log = FlightLog::read(&folder.join("log15")).expect("accepted");
    // The seconds that its authors used; they found 70 ms, a compare of many lags 70 to 100 ms. With inertias that are a quarter larger than
    // theirs, which the same flight asks for, it is 64 ms.
    let start = log.time_s[0];
    let log = log.slice(start + 15.8, start + 50.8);
    let mut model = model("crazyflie-2");
    model.vehicle.rotors.thrust_lag_s = 0.02;
    let found = diagnose(&[log], &model, &Options::default()).expect("a diagnosis");
    assert!(
        matches!(&found.verdict, Verdict::CalibrateFirst { constants } if constants[0] == "rotors.thrust_lag_s"),
        "{}",
        found.sentence
    );
    let wanted = found.calibrate[0].wanted;
    assert!((0.06..0.085).contains(&wanted), "{}", found.sentence);
    assert!(
        found.effects.iter().all(|effect| effect.onset_s.is_none()),
        "{}",
        found.sentence
    );
}

#[test]
fn val_a_motor_lag_that_is_off_by_less_than_a_factor_of_two_is_named_with_its_value() {
    let Some(folder) = shared("data/real/arpl_crazyflie_sysid") else {
        return;
    };
    let log = FlightLog::read(&folder.join("log15")).expect("accepted");
    let start = log.time_s[0];
    let log = log.slice(start + 15.8, start + 50.8);
    let mut model = model("crazyflie-2");
    model.vehicle.rotors.thrust_lag_s = 0.045;
    let found = diagnose(&[log], &model, &Options::default()).expect("a diagnosis");
    println!("{}\n{:?}\n{:#?}", found.sentence, found.notes, found.held_out);
    let lag = found
        .effects
        .iter()
        .find(|effect| effect.instance.effect == "motor-time-constant")
        .unwrap_or_else(|| panic!("{}", found.sentence));
    // Authors 70 ms, a compare of many lags 70 to 100 ms; with the larger inertias that are found along with it 65 ms, and unseen blocks are
    // predicted better (torque 0.12 instead of 0.15 mN·m). Lag and inertia lie on a ridge.
    let wanted = 0.045 * (1.0 + lag.parameters[0].value);
    assert!((0.06..0.085).contains(&wanted), "{}", found.sentence);
    // It is trusted, though nothing explains the yaw, and reported in seconds.
    assert!(
        matches!(found.verdict, Verdict::PartlyMissing { .. } | Verdict::Missing { .. }),
        "{}",
        found.sentence
    );
    assert!(
        found.sentence.contains("lag of the thrust 0.06") && found.sentence.contains("where the model has 0.04500 s"),
        "{}",
        found.sentence
    );
    assert!(
        found
            .held_out
            .iter()
            .any(|error| error.quantity == "torque" && error.after < 0.9 * error.before),
        "{:?}",
        found.held_out
    );
}

#[test]
fn val_yaw_with_the_torque_of_rotor_acceleration_is_predicted_where_a_real_vehicle_yaws() {
    let Some(folder) = shared("data/real/arpl_crazyflie_sysid") else {
        return;
    };
    let request = Request {
        mass_kg: 0.027,
        arm_m: 0.0396,
        frame: None,
        trust_frame: false,
        capacity_ah: None,
        cells: None,
    };
    let logs = ["log10", "log15", "log16"].map(|name| FlightLog::read(&folder.join(name)).expect("accepted"));
    let yaw = |log: &FlightLog| {
        let found = held_out(log, &request).expect("two halves");
        let score = found
            .scores
            .into_iter()
            .find(|score| score.channel == "yaw acceleration");
        score.expect("rates are logged").calibrated
    };
    // Vertical excitation, roll and pitch excitation, yaw steps: R² of each half by the other. Without the term 0.16, 0.26 and 0.19.
    let explained = logs.each_ref().map(yaw);
    assert!(
        explained[0] > 0.4 && explained[1] > 0.28 && explained[2] > 0.9,
        "{explained:?}"
    );
    let reaction = |logs: &[FlightLog]| {
        let found = identify(logs, &request).expect("a vehicle");
        let value = found.value("rotors.reaction_s").expect("always listed").clone();
        let written = files(&found, "own")
            .documents()
            .expect("valid")
            .vehicle
            .rotors
            .reaction_s;
        assert!((written - value.value).abs() < 1e-4, "{written} {value:?}");
        value
    };
    let yawing = reaction(&logs[2..]);
    assert!(
        (0.08..0.15).contains(&yawing.value) && yawing.source == Source::Log,
        "{yawing:?}"
    );
    // Another flight of the same vehicle says the same; one that hardly yaws does not pretend to know.
    let rising = reaction(&logs[..1]);
    assert!(
        rising.low < yawing.value && yawing.value < rising.high,
        "{rising:?} {yawing:?}"
    );
    let rolling = reaction(&logs[1..2]);
    assert!(
        rolling.source == Source::LogAndClass && rolling.low < yawing.value && yawing.value < rolling.high,
        "{rolling:?} {yawing:?}"
    );
    let all = reaction(&logs);
    assert!(all.low < yawing.value && yawing.value < all.high, "{all:?} {yawing:?}");
}

/// Mass and arm of the Crazyflie, and the vehicle that its log gives.
fn crazyflie_from(log: &FlightLog) -> (tempfile::TempDir, ModelVersion) {
    let request = Request {
        mass_kg: 0.027,
        arm_m: 0.0396,
        frame: None,
        trust_frame: false,
        capacity_ah: None,
        cells: None,
    };
    let found = identify(std::slice::from_ref(log), &request).expect("a vehicle");
    let texts = files(&found, "own");
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in [
        ("own.toml", &texts.vehicle),
        ("own.blades.toml", &texts.blades),
        ("own.intervals.toml", &texts.intervals),
    ] {
        std::fs::write(folder.path().join(name), text).expect("written");
    }
    let model = ModelVersion::load(folder.path().join("own.toml")).expect("valid");
    (folder, model)
}

#[test]
fn val_a_vehicle_from_a_log_without_voltage_lifts_itself_on_that_log() {
    let Some(folder) = shared("data/real/arpl_crazyflie_sysid") else {
        return;
    };
    for name in ["log10", "log15"] {
        let log = FlightLog::read(&folder.join(name)).expect("accepted");
        let (_kept, version) = crazyflie_from(&log);
        let model = NamedModel {
            label: "own".to_owned(),
            version,
        };
        let (_, series) = compare(&[log], &[model]).expect("a comparison");
        let down = NAMES.iter().position(|known| *known == "fz").expect("a channel");
        let own = &series[0].models[0];
        let judged = own.raw[down].iter().zip(&own.mask[down]).filter(|(_, counts)| **counts);
        let (sum, count) = judged.fold((0.0, 0.0), |(sum, count), (x, _)| (sum + x, count + 1.0));
        // Taken at the open-circuit voltage its rotors lifted 9 % too much. The scale of the accelerometer is off by 1.3 % on log10.
        let share = (sum / count / 9.81_f64).abs();
        assert!(share < 0.025, "{name}: thrust off by {share:.3} of the weight");
    }
}

#[test]
fn val_a_log_without_velocity_holds_no_gusts_and_a_search_ends_when_its_time_is_up() {
    let Some(folder) = shared("data/real/arpl_crazyflie_sysid") else {
        return;
    };
    let log = FlightLog::read(&folder.join("log16")).expect("accepted");
    let (_kept, model) = crazyflie_from(&log);
    let whole = diagnose(std::slice::from_ref(&log), &model, &Options::default()).expect("a diagnosis");
    assert!(
        whole.effects.iter().all(|effect| effect.instance.effect != "gusts"),
        "{}",
        whole.sentence
    );
    assert!(!whole.sentence.starts_with("Stopped"), "{}", whole.sentence);
    // A clock that runs by itself: each look at it is a second.
    let looks = std::cell::Cell::new(0.0);
    let options = Options {
        clock: &|| looks.replace(looks.get() + 1.0),
        time_limit_s: 0.5,
        ..Options::default()
    };
    let stopped = diagnose(&[log], &model, &options).expect("a diagnosis");
    assert!(
        stopped.sentence.starts_with("Stopped by the time limit")
            && stopped.effects.is_empty()
            && !stopped.ranking.is_empty(),
        "{}",
        stopped.sentence
    );
}
