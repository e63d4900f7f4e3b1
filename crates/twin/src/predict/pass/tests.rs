//! What a pass shares with its base equals what it would have computed itself.

use std::path::Path;

use rotortwin_plant::effects::{Catalogue, EffectInstance};
use rotortwin_scenario::VehicleDocuments;

use crate::estimation::candidates::Library;
use crate::log::FlightLog;
use crate::predict::{CHANNELS, NAMES, Nuisances, Predictor, Source, Stages};

/// Six seconds of motion about all axes at 400 Hz.
fn log() -> FlightLog {
    let time: Vec<f64> = (0..2400).map(|k| 0.0025 * f64::from(k)).collect();
    let wave = |mean: f64, height: f64, frequency: f64| -> Vec<f64> {
        time.iter()
            .map(|t| mean + height * libm::sin(frequency * t + 0.3 * frequency))
            .collect()
    };
    let vectors = [
        (
            ["position_north_m", "position_east_m", "position_down_m"],
            [0.0, 0.0, -3.0],
            1.0,
        ),
        (
            ["velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"],
            [1.0, 0.5, 0.0],
            2.0,
        ),
        (["roll_rad", "pitch_rad", "yaw_rad"], [0.05, -0.02, 0.4], 0.2),
        (
            ["roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"],
            [0.0, 0.1, 0.2],
            0.8,
        ),
        (["accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"], [0.1, 0.0, -9.8], 1.5),
    ];
    let mut columns = Vec::new();
    for (i, (names, means, height)) in vectors.into_iter().enumerate() {
        for axis in 0..3 {
            let frequency = 2.0 + (i as f64) + 0.7 * axis as f64;
            columns.push((names[axis].to_owned(), wave(means[axis], height, frequency)));
        }
    }
    for rotor in 1..=6 {
        columns.push((format!("duty_{rotor}"), wave(0.6, 0.1, 3.0 + 0.5 * f64::from(rotor))));
    }
    columns.push(("battery_voltage_v".to_owned(), wave(15.5, 0.3, 1.0)));
    FlightLog::from_columns("waves", time, columns).unwrap()
}

#[test]
fn prop_what_a_pass_shares_is_what_it_would_have_made() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
    let documents = VehicleDocuments::load(&path).unwrap();
    let catalogue = Catalogue::built_in();
    let predictor = Predictor::new(&documents, &[], &catalogue, &log()).unwrap();
    let library = Library::new(&catalogue, 6, &predictor.vehicle_size());
    let bases: [Vec<EffectInstance>; 8] = [
        vec![],
        vec![EffectInstance::new("rotor-drag", &[("drag_n_s_m", 0.25)])],
        vec![EffectInstance::new("rotational-damping", &[("damping_n_m_s", 0.01)])],
        vec![EffectInstance::new("gyro-bias", &[("x_rad_s", 0.01)])],
        vec![EffectInstance::new("accelerometer-scale", &[("share", 0.02)])],
        vec![EffectInstance::new("imu-lever-arm", &[("z_m", 0.03)])],
        vec![EffectInstance::new("imu-latency", &[("delay_s", 0.006)])],
        vec![
            EffectInstance::new("rotor-thrust-scale", &[("share", -0.05)])
                .on_rotor(2)
                .from_time(3.0),
        ],
    ];
    let noise = predictor.residuals(&Nuisances::default(), &[]).unwrap().noise_floor;
    let mut compared = 0;
    for active in bases {
        let base_set = predictor.effect_set(&Nuisances::default(), &active).unwrap();
        let base = predictor.predict(&base_set, Source::Smooth, None);
        for column in &library.columns {
            let entry = &library.candidates[column.candidate];
            let mut values = entry.neutral();
            values[column.parameter] += 0.1 * column.size;
            let Some(instance) = entry.instance(&values, None) else {
                continue;
            };
            if active.iter().any(|one| one.effect == instance.effect) {
                continue;
            }
            let hooks = predictor.hooks_of(&instance).unwrap();
            let mut all = active.clone();
            all.push(instance);
            let Ok(set) = predictor.effect_set(&Nuisances::default(), &all) else {
                continue;
            };
            let stages = Stages::between(base_set.constants(), set.constants(), hooks);
            let shared = predictor.predict(&set, Source::Smooth, Some((&base, stages)));
            let whole = predictor.predict(&set, Source::Smooth, None);
            for channel in 0..CHANNELS {
                let largest = |a: &[f64], b: &[f64]| {
                    let off = a.iter().zip(b).map(|(a, b)| (a - b).abs());
                    off.fold(0.0, f64::max)
                };
                // Over the three axes: rates carry a torque from one to the others.
                let group = 3 * (channel / 3)..CHANNELS.min(3 * (channel / 3) + 3);
                let change = group
                    .map(|c| largest(&whole.channels[c], &base.channels[c]))
                    .fold(0.0, f64::max);
                let off = largest(&whole.channels[channel], &shared.channels[channel]);
                // The rates that the observer predicts are those of the base: they respond to another torque over 10
                // ms. A thousandth of the noise of a sample is invisible in any sum over a flight.
                assert!(
                    off <= 0.05 * change + 1e-3 * noise[channel],
                    "{} in {} beside {:?}: off by {off:e} of {change:e}",
                    entry.label(),
                    NAMES[channel],
                    active.first().map(|one| &one.effect)
                );
            }
            compared += 1;
        }
    }
    assert!(compared > 600, "{compared}");
}
