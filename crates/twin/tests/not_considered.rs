//! What a diagnosis could not consider is listed with the column or setting that would make it testable.

use std::path::{Path, PathBuf};

use rotortwin_blind::flight::{FlightPlan, Row, fly};
use rotortwin_blind::script::Script;
use rotortwin_blind::vehicle::Vehicle;
use rotortwin_plant::effects::{EffectClass, catalogue};
use rotortwin_twin::diagnose::{Diagnosis, NotConsidered, Options, Verdict, diagnose};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;
use rotortwin_twin::model::specification::effect_by_hand;

const KINEMATICS: [[&str; 3]; 5] = [
    ["position_north_m", "position_east_m", "position_down_m"],
    ["velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"],
    ["roll_rad", "pitch_rad", "yaw_rad"],
    ["roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"],
    ["accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"],
];

fn vehicle_path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml")
}

fn model() -> ModelVersion {
    ModelVersion::load(vehicle_path()).expect("the F550")
}

/// A healthy flight of 20 s some metres over the ground, without the columns for which `lacks` holds.
fn flight(lacks: impl Fn(&str) -> bool) -> FlightLog {
    let vehicle = Vehicle::load(&vehicle_path()).expect("the F550");
    let script = Script::built_in("excitation", 3).expect("a built-in script");
    let (rows, _) = fly(&FlightPlan::new(vehicle, script, 20.0, 3)).expect("a flight");
    let of = |value: &dyn Fn(&Row) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
    let mut columns = vec![("battery_voltage_v".to_owned(), of(&|r| r.voltage))];
    for axis in 0..3 {
        let values = [
            of(&|r| r.position[axis]),
            of(&|r| r.velocity[axis]),
            of(&|r| r.euler[axis]),
            of(&|r| r.rates[axis]),
            of(&|r| r.accel[axis]),
        ];
        columns.extend(KINEMATICS.map(|names| names[axis].to_owned()).into_iter().zip(values));
    }
    for rotor in 0..6 {
        columns.push((format!("duty_{}", rotor + 1), of(&|r| r.duties[rotor])));
    }
    columns.retain(|(name, _)| !lacks(name));
    FlightLog::from_columns("flight", of(&|r| r.time), columns).expect("a log")
}

fn diagnosis(log: FlightLog, model: &ModelVersion) -> Diagnosis {
    diagnose(&[log], model, &Options::default()).expect("a diagnosis")
}

fn listed<'a>(diagnosis: &'a Diagnosis, effect: &str) -> Option<&'a NotConsidered> {
    diagnosis.not_considered.iter().find(|one| one.effect == effect)
}

#[test]
fn scenario_a_ground_effect_without_a_height_asks_for_the_column_and_not_for_a_lower_flight() {
    let found = diagnosis(flight(|_| false), &model());
    let ground = listed(&found, "ground-effect").unwrap();
    assert_eq!(ground.columns, ["height_above_ground_m"]);
    assert!(ground.reason.contains("height_above_ground_m"), "{}", ground.reason);
    assert!(found.not_testable.iter().all(|row| row.effect != "ground-effect"));
    // What stays there is excited by another manoeuvre.
    assert!(!found.not_testable.is_empty());
    // Nothing to act through; and a form of gusts that is not looked for.
    let gusts = listed(&found, "gusts").unwrap();
    assert!(gusts.columns.is_empty() && gusts.setting.as_ref().unwrap().contains("rotor-drag"));
    assert!(listed(&found, "dryden-gusts").unwrap().reason.contains("gusts"));
    // Wirings were considered: the log has rates and duties.
    assert!(listed(&found, "swapped-rotors").is_none() && listed(&found, "reversed-spin").is_none());
}

#[test]
fn scenario_gusts_act_through_the_drag_of_the_vehicle_document() {
    let mut model = model();
    model.vehicle.rotors.drag_kg_s = 0.25;
    let found = diagnosis(flight(|_| false), &model);
    let reason = listed(&found, "gusts").map_or("", |one| one.reason.as_str());
    assert!(!reason.contains("acts only through"), "{reason}");
}

#[test]
fn scenario_a_height_above_ground_makes_the_ground_effect_a_matter_of_the_flight() {
    let mut log = flight(|_| false);
    let height: Vec<f64> = log.column("position_down_m").unwrap().iter().map(|z| -z).collect();
    log.columns.insert("height_above_ground_m".to_owned(), height);
    let found = diagnosis(log, &model());
    assert_eq!(listed(&found, "ground-effect"), None);
    assert!(found.not_testable.iter().any(|row| row.effect == "ground-effect"));
}

#[test]
fn scenario_without_voltage_and_rates_their_effects_name_the_columns() {
    let found = diagnosis(
        flight(|name| name == "battery_voltage_v" || KINEMATICS[3].contains(&name)),
        &model(),
    );
    let columns = |effect: &str| listed(&found, effect).map(|one| one.columns.clone()).unwrap();
    assert_eq!(columns("internal-resistance"), ["battery_voltage_v"]);
    assert_eq!(columns("swapped-rotors"), KINEMATICS[3]);
    assert_eq!(columns("inertia-roll"), KINEMATICS[3]);
    for one in &found.not_considered {
        assert!(
            found
                .not_testable
                .iter()
                .all(|row| one.columns.is_empty() || row.effect != one.effect)
        );
    }
}

/// Every n-th value, on straight lines between them, as an autopilot's slower stream is read.
fn interpolated(values: &[f64], every: usize) -> Vec<f64> {
    let at = |k: usize| values[k.min(values.len() - 1)];
    (0..values.len())
        .map(|k| {
            let (before, share) = (k - k % every, (k % every) as f64 / every as f64);
            at(before) + share * (at(before + every) - at(before))
        })
        .collect()
}

/// ArduPilot's RCOU at 10 Hz beside an IMU at 400 Hz: a motor time constant of 0.021 s ± 0.0015 s was "missing" where it is 0.05 s, as an
/// interpolated command rises before it was given.
#[test]
fn scenario_commands_at_10_hz_tell_neither_a_lag_nor_an_age_and_ask_for_faster_ones() {
    const NEEDY: [&str; 7] = [
        "motor-time-constant",
        "lag-asymmetry",
        "speed-domain-lag",
        "command-delay",
        "imu-latency",
        "rotor-reaction",
        "frame-flex",
    ];
    let fast = flight(|_| false);
    let step_s = fast.time_s[1] - fast.time_s[0];
    let mut slow = fast.clone();
    for rotor in 1..=6 {
        let duty = slow.columns.get_mut(&format!("duty_{rotor}")).unwrap();
        *duty = interpolated(duty, (0.1 / step_s).round() as usize);
    }
    let found = diagnosis(slow, &model());
    for effect in NEEDY {
        let one = listed(&found, effect).unwrap_or_else(|| panic!("{effect}: {}", found.sentence));
        assert!(one.reason.contains("Hz") && one.columns.is_empty(), "{}", one.reason);
        assert!(
            one.setting
                .as_ref()
                .is_some_and(|setting| setting.contains("motor outputs"))
        );
        assert!(found.not_testable.iter().all(|row| row.effect != effect));
        assert!(
            found.ranking.iter().all(|row| row.effect != effect),
            "{effect} is ranked"
        );
    }
    let mut named = found.effects.iter().chain(&found.sensor_or_timing);
    assert!(
        named.all(|one| !NEEDY.contains(&one.instance.effect.as_str())),
        "{}",
        found.sentence
    );
    let found = diagnosis(fast, &model());
    assert!(NEEDY.iter().all(|effect| listed(&found, effect).is_none()));
}

#[test]
fn scenario_what_the_model_has_is_listed_as_such() {
    let drag = effect_by_hand("rotor-drag", None, None, &["drag_n_s_m=0.25".to_owned()]).unwrap();
    let found = diagnosis(flight(|_| false), &model().with_effects([drag], "test"));
    let drag = listed(&found, "rotor-drag").unwrap();
    assert_eq!(drag.setting.as_deref(), Some("a model without rotor-drag"));
}

#[test]
fn scenario_duties_alone_list_everything_with_what_it_needs() {
    let found = diagnosis(flight(|name| !name.starts_with("duty_")), &model());
    assert_eq!(found.verdict, Verdict::NothingTestable);
    for entry in catalogue().iter().filter(|entry| entry.class != EffectClass::Nuisance) {
        let one = listed(&found, entry.id).unwrap_or_else(|| panic!("{} is not listed", entry.id));
        assert!(!one.reason.is_empty());
        assert!(!one.columns.is_empty() || entry.id == "dryden-gusts", "{}", entry.id);
    }
}
