//! `rotortwin vibration` and the line *Vibration* of `diagnose --baseline`, on logs with rotor speeds as a flight controller with ESC telemetry
//! writes them: an unbalanced propeller is named, healthy ones raise no alarm, and missing channels are reported.

use rotortwin_tests::columns::too_wide;
use rotortwin_tests::program::{Call, program};
use rotortwin_tests::scratch::{Scratch, repository};
use serde_json::Value;
use std::f64::consts::TAU;
use std::process::Command;

const RATE_HZ: f64 = 500.0;
const SPAN_S: f64 = 20.0;
/// Mean speed of each rotor, Hz, and the amplitude of a healthy one at 100 Hz, m/s².
const SPEEDS_HZ: [f64; 6] = [91.0, 94.5, 98.0, 101.5, 105.0, 108.5];
const HEALTHY: [f64; 6] = [0.3, 0.2, 0.35, 0.25, 0.3, 0.2];

/// Uniform in ± √3: standard deviation 1.
struct Draw(u64);

impl Draw {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (2.0 * (self.0 >> 11) as f64 / (1u64 << 53) as f64 - 1.0) * 3.0_f64.sqrt()
    }
}

/// A hover as a canonical CSV; `speeds`: with rotor speeds.
fn log(scratch: &Scratch, name: &str, seed: u64, damaged: Option<usize>, speeds: bool) -> String {
    let mut draw = Draw(seed);
    for _ in 0..8 {
        draw.next();
    }
    let mut text = "time_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2".to_owned();
    for rotor in 1..=6 {
        text += &format!(",duty_{rotor}");
        if speeds {
            text += &format!(",rotor_speed_{rotor}_rad_s");
        }
    }
    text.push('\n');
    let wander: [[f64; 2]; 6] = std::array::from_fn(|_| [draw.next(), draw.next()]);
    let mut angles: [f64; 6] = std::array::from_fn(|rotor| rotor as f64);
    for k in 0..(SPAN_S * RATE_HZ) as usize {
        let time = k as f64 / RATE_HZ;
        let mut accel = [0.3 * draw.next(), 0.3 * draw.next(), -9.81 + 0.3 * draw.next()];
        let mut columns = String::new();
        for rotor in 0..6 {
            let [a, b] = wander[rotor];
            let hz = SPEEDS_HZ[rotor] + a * (0.7 * time + b).sin();
            angles[rotor] += TAU * hz / RATE_HZ;
            let times = if damaged == Some(rotor + 1) { 4.0 } else { 1.0 };
            let pull = times * HEALTHY[rotor] * (hz / 100.0).powi(2);
            for (axis, value) in accel.iter_mut().enumerate() {
                *value += pull * 0.577 * (angles[rotor] + 2.0 * (axis + rotor) as f64).cos();
            }
            columns += &format!(",{:.4}", 0.5 + 0.002 * draw.next());
            if speeds {
                columns += &format!(",{:.3}", TAU * hz);
            }
        }
        text += &format!("{time:.4},{:.4},{:.4},{:.4}{columns}\n", accel[0], accel[1], accel[2]);
    }
    let path = scratch.path(name);
    std::fs::write(&path, text).expect("it can be written");
    path.display().to_string()
}

#[test]
fn scenario_a_propeller_out_of_balance_is_named_against_healthy_flights() {
    let scratch = Scratch::new();
    let healthy: Vec<String> = (1..4)
        .map(|n| log(&scratch, &format!("healthy-{n}.csv"), n, None, true))
        .collect();
    let today = log(&scratch, "today.csv", 9, Some(4), true);
    let mut words = vec!["vibration".to_owned(), today.clone(), "--baseline".to_owned()];
    words.extend(healthy.clone());
    let said = Call::new(&scratch, words.clone()).run().expect_code(0).stdout;
    assert!(
        said.contains("Against 3 healthy flights these vibrate more at their own speed: rotor 4 ("),
        "{said}"
    );
    for width in [80, 120] {
        let output = Command::new(program())
            .args(&words)
            .env("COLUMNS", width.to_string())
            .output()
            .expect("the program starts");
        let text = String::from_utf8(output.stdout).expect("the output is UTF-8");
        assert!(text.contains("rotor 4"), "{text}");
        assert_eq!(too_wide(&text, width), Vec::<&str>::new(), "at {width}");
    }
    words.push("--json".to_owned());
    let found: Value = serde_json::from_str(&Call::new(&scratch, words).run().expect_code(0).stdout).unwrap();
    let named = found["change"]["named"].as_array().unwrap();
    assert_eq!(named.len(), 1, "{found}");
    let interval = |k: usize| named[0]["interval_95"][k].as_f64().unwrap();
    assert!(interval(0) < 4.0 && interval(1) > 4.0, "{}", named[0]);
    // A healthy flight compared with the others.
    let words = [
        "vibration",
        &healthy[0],
        "--baseline",
        &healthy[1],
        &healthy[2],
        &log(&scratch, "healthy-5.csv", 5, None, true),
    ];
    let said = Call::new(&scratch, words.map(str::to_owned).to_vec())
        .run()
        .expect_code(0)
        .stdout;
    assert!(said.contains("no rotor vibrates significantly more"), "{said}");
    // The same in addition to the commanded thrust of the rotors.
    let model = repository().join("config/vehicles/f550.toml").display().to_string();
    let mut words: Vec<String> = ["diagnose", &today, "--model", &model, "--baseline"]
        .map(str::to_owned)
        .to_vec();
    words.extend(healthy);
    let said = Call::new(&scratch, words).run().expect_code(0).stdout;
    assert!(
        said.contains("Vibration    Against 3 healthy flights these vibrate more at their own speed: rotor 4 ("),
        "{said}"
    );
}

#[test]
fn scenario_what_a_log_lacks_for_its_vibration_is_said() {
    let scratch = Scratch::new();
    let silent = log(&scratch, "silent.csv", 1, None, false);
    let call = |words: &[&str]| {
        let words: Vec<String> = words.iter().map(|w| (*w).to_owned()).collect();
        Call::new(&scratch, words).run().expect_code(2).stderr.join("\n")
    };
    let words = ["vibration", &silent].map(str::to_owned).to_vec();
    let said = Call::new(&scratch, words).run().expect_code(0).stdout;
    for part in [
        "silent: accelerometer at 500 Hz, no rotor speeds: all vibration from 25 to 225 Hz",
        "Single rotors need rotor speeds from the ESCs in the log, or --model",
    ] {
        let plain = said.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(plain.contains(part), "{said}");
    }
    let told = log(&scratch, "told.csv", 2, None, true);
    let said = call(&["vibration", &silent, "--baseline", &told, &told, &told]);
    assert!(said.contains("silent: expected rotor speeds as in told"), "{said}");
    let said = call(&["vibration", &silent, "--baseline", &silent]);
    assert!(said.contains("at least 3 healthy flights"), "{said}");
    let said = call(&["vibration", "nowhere.csv"]);
    assert!(said.contains("nowhere.csv"), "{said}");
}
