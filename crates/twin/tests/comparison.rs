//! Comparison of models with logs: healthy logs agree, a hidden effect shows where it acts, and the report can be opened.

#![expect(clippy::unwrap_used, reason = "a refusal where none is due fails the test")]

use std::path::{Path, PathBuf};

use rotortwin_plant::powertrain::battery::Battery;
use rotortwin_plant::random::NormalStream;
use rotortwin_scenario::VehicleDocuments;
use rotortwin_twin::compare::{self, ChannelVerdict, NamedModel};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;
use rotortwin_twin::model::specification::effect_by_hand;

fn nominal() -> ModelVersion {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
    ModelVersion::first("f550", VehicleDocuments::load(path).unwrap())
}

fn named(label: &str, version: ModelVersion) -> NamedModel {
    NamedModel {
        label: label.to_owned(),
        version,
    }
}

fn with_drag(value: f64) -> ModelVersion {
    let drag = effect_by_hand("rotor-drag", None, None, &[format!("drag_n_s_m={value}")]).unwrap();
    nominal().with_effects([drag], "")
}

/// A log of the directory with measurements of others, or `None` with a word about it.
fn hidden(number: u32) -> Option<FlightLog> {
    let root = std::env::var_os("ROTORTWIN_SHARED").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared"),
        PathBuf::from,
    );
    let path = root.join(format!("data/hidden_effect/log{number:02}.parquet"));
    if path.is_file() {
        return Some(FlightLog::read(&path).unwrap());
    }
    eprintln!("skipped: no {}", path.display());
    None
}

fn verdicts(log: &FlightLog, version: ModelVersion) -> (bool, Vec<&'static str>, Vec<&'static str>) {
    let (comparison, _) = compare::compare(std::slice::from_ref(log), &[named("m", version)]).unwrap();
    let model = &comparison.logs[0].models[0];
    let of = |wanted: ChannelVerdict| {
        model
            .channels
            .iter()
            .filter(|c| c.verdict == wanted)
            .map(|c| c.channel)
            .collect()
    };
    (model.agrees, of(ChannelVerdict::Fails), of(ChannelVerdict::NotTestable))
}

#[test]
fn val_healthy_logs_of_a_foreign_simulator_agree() {
    for number in [4, 15, 16] {
        if let Some(log) = hidden(number) {
            assert_eq!(verdicts(&log, nominal()), (true, vec![], vec![]), "log {number}");
        }
    }
}

#[test]
fn val_rotor_drag_shows_in_fx_and_fy_with_speed_and_goes_when_it_is_added() {
    let Some(log) = hidden(1) else { return };
    let models = [named("v0", nominal()), named("v1", with_drag(0.25))];
    let (comparison, series) = compare::compare(&[log], &models).unwrap();
    let [before, after] = comparison.logs[0].models.as_slice() else {
        panic!("two models were given")
    };
    let fails: Vec<&str> = before
        .channels
        .iter()
        .filter(|c| c.verdict == ChannelVerdict::Fails)
        .map(|c| c.channel)
        .collect();
    assert_eq!(fails, ["fx", "fy"]);
    assert_eq!(before.channels[0].conditions[0].condition, "forward_speed");
    assert_eq!(before.channels[1].conditions[0].condition, "sideways_speed");
    assert!(after.agrees, "{}", after.sentence());
    let force = |model: &compare::ModelOnLog| model.error_of("force").unwrap().error;
    // The hidden size itself: only noise remains, to 10 %.
    assert!(force(before) > 300.0 && force(after) < 1.1 * after.error_of("force").unwrap().noise);
    let far = |model: &compare::ModelOnLog| model.open_loop[2].velocity_m_s;
    assert!(far(after) < 0.5 * far(before), "{} {}", far(before), far(after));
    assert!(!after.worst.iter().any(|moment| moment.channel == "fx"));

    let folder = tempfile::tempdir().unwrap();
    compare::files::write(folder.path(), &comparison, &series, &[]).unwrap();
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert!(page.len() < 5_000_000, "{}", page.len());
    assert!(page.contains("v1 agrees with this flight"));
    let inside = inside(&page);
    assert_eq!(inside["kind"], "comparison");
    let pictures = &inside["data"]["pictures"][0];
    let fx = &pictures["channels"][0];
    let length = pictures["time_s"].as_array().unwrap().len();
    assert_eq!(fx["channel"], "fx");
    assert_eq!(fx["measured"].as_array().unwrap().len(), length);
    // Without drag the residual follows the speed; with it, it is noise.
    let rms = |model: usize| {
        let means = fx["residuals"][model]["mean"].as_array().unwrap().iter();
        let squares: Vec<f64> = means.filter_map(serde_json::Value::as_f64).map(|x| x * x).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    assert!(rms(0) > 3.0 * rms(1), "{} {}", rms(0), rms(1));
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.path().join("comparison.json")).unwrap()).unwrap();
    assert_eq!(json["logs"][0]["models"][1]["agrees"], true);
    assert!(folder.path().join("residuals-log01.parquet").is_file());
}

/// The result inside of a report.
fn inside(page: &str) -> serde_json::Value {
    let (_, rest) = page.split_once("id=\"report\">").unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

/// A hovering log of the nominal vehicle with the noise of its sensors; `bend` is added to the accelerometer's z.
fn hover(bend: f64, with_rates: bool) -> FlightLog {
    let documents = nominal().documents();
    let thrust = documents.vehicle.body.mass_kg * documents.vehicle.body.gravity_m_s2 / 6.0;
    let count = 8000;
    // The voltage sinks as this battery's does at constant power, and the duty follows it.
    let battery = Battery::new(&documents.vehicle.battery);
    let power = 6.0 * battery.power_coefficient() * thrust.powf(1.5);
    let mut charge = 0.8;
    let true_voltage: Vec<f64> = (0..count)
        .map(|_| {
            let now = battery.output(charge, power);
            charge += 0.0025 * battery.charge_rate(now.battery_current);
            now.battery_voltage
        })
        .collect();
    let duty: Vec<f64> = true_voltage
        .iter()
        .map(|&voltage| documents.nominal_blade().duty(thrust, voltage).unwrap())
        .collect();
    let noise = |name: &str, deviation: f64, mean: f64| {
        let mut stream = NormalStream::new(9, name);
        (0..count)
            .map(|_| mean + deviation * stream.sample())
            .collect::<Vec<f64>>()
    };
    let mut columns = vec![
        ("accel_x_m_s2".to_owned(), noise("ax", 0.05, 0.0)),
        ("accel_y_m_s2".to_owned(), noise("ay", 0.05, 0.0)),
        ("accel_z_m_s2".to_owned(), noise("az", 0.05, -9.81 + bend)),
        (
            "battery_voltage_v".to_owned(),
            noise("v", 0.01, 0.0)
                .iter()
                .zip(&true_voltage)
                .map(|(noise, v)| noise + v)
                .collect(),
        ),
    ];
    for name in ["roll_rad", "pitch_rad", "yaw_rad"] {
        columns.push((name.to_owned(), noise(name, 0.001, 0.0)));
    }
    for name in ["velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"] {
        columns.push((name.to_owned(), noise(name, 0.01, 0.0)));
    }
    if with_rates {
        for name in ["roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"] {
            columns.push((name.to_owned(), noise(name, 0.01, 0.0)));
        }
    }
    columns.extend((1..=6).map(|rotor| (format!("duty_{rotor}"), duty.clone())));
    let time = (0..count).map(|k| 0.0025 * k as f64).collect();
    FlightLog::from_columns("hover", time, columns).unwrap()
}

#[test]
fn val_a_log_made_here_agrees_and_an_error_of_its_accelerometer_is_seen() {
    assert_eq!(
        verdicts(&hover(0.0, true), nominal()),
        (true, vec![], vec!["kp_north", "kp_east", "kp_down"])
    );
    // 0.5 m/s² are eight times what six rotor biases at their bounds can take up.
    let (agrees, fails, _) = verdicts(&hover(0.5, true), nominal());
    assert!(!agrees && fails.contains(&"fz"), "{fails:?}");
}

#[test]
fn val_missing_columns_rule_out_their_channels_and_no_others() {
    let (_, _, without) = verdicts(&hover(0.0, false), nominal());
    assert_eq!(
        without,
        [
            "mx", "my", "mz", "ka_roll", "ka_pitch", "ka_yaw", "kp_north", "kp_east", "kp_down"
        ]
    );
    let (comparison, _) = compare::compare(&[hover(0.0, false)], &[named("m", nominal())]).unwrap();
    assert!(
        comparison.logs[0]
            .notes
            .iter()
            .any(|note| note.contains("no body rates"))
    );
}
