//! A synthetic flight that looks like the reference flight (helix, fault of rotor 3 from 45 s), for tests of this crate and
//! for inspecting the report. No physics: analytic signals and noise.

use rotortwin_flight_core::fdi::verdict_code::{HEALTHY, NOT_READY, UNKNOWN};
use rotortwin_store::telemetry::{TelemetryRow, TruthRow};

/// Rotors of the synthetic vehicle.
pub const ROTORS: usize = 6;
/// Length of a step, ns.
pub const STEP_NS: u64 = 2_500_000;

fn mix(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

fn uniform(step: u64, stream: u64) -> f64 {
    (mix(mix(step) ^ stream.wrapping_mul(0xD6E8_FEB8_6659_FD93)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Standard normal noise, a pure function of step and stream.
fn normal(step: u64, stream: u64) -> f64 {
    let radius = (-2.0 * (1.0 - uniform(step, 2 * stream)).ln()).sqrt();
    radius * (std::f64::consts::TAU * uniform(step, 2 * stream + 1)).cos()
}

/// As [`normal`], but slowly varying: new every 0.15 s, linear in between.
fn slow(step: u64, stream: u64) -> f64 {
    const KNOT: u64 = 60;
    let part = (step % KNOT) as f64 / KNOT as f64;
    let knot = step / KNOT + (1 << 50);
    (1.0 - part) * normal(knot, stream) + part * normal(knot + 1, stream)
}

/// Condition code of rotor 3: 0 healthy, 1, 2, 3 = blades b, c, d.
pub fn condition(time_s: f64) -> i32 {
    match time_s {
        t if t < 45.0 => 0,
        t if t < 60.0 => 1,
        t if t < 75.0 => 2,
        _ => 3,
    }
}

/// Step `step` of the flight; a pure function.
pub fn row(step: u64) -> TelemetryRow {
    let t = step as f64 * STEP_NS as f64 / 1e9;
    let noise = |stream: u64, deviation: f64| deviation * normal(step, stream);
    let code = condition(t);
    let loss = [0.0, 0.12, 0.22, 0.35][code as usize];
    let settled = 1.0 - (-(t - [0.0, 45.0, 60.0, 75.0][code as usize]) * 5.0).exp();

    let phase = 0.35 * t;
    let reference = [
        4.0 * phase.sin(),
        4.0 * (1.0 - phase.cos()),
        -2.0 - 6.0 * (0.035 * t).sin().powi(2),
    ];
    let lag = [
        0.06 * phase.cos(),
        0.06 * phase.sin(),
        0.05 * (-(t - 45.0).powi(2) / 2.0).exp() + 0.01,
    ];
    let position = [0, 1, 2].map(|i| reference[i] + lag[i]);
    let velocity = [1.4 * phase.cos(), 1.4 * phase.sin(), -0.42 * (0.07 * t).sin()];
    let yaw = 0.6 * (0.1 * t).sin();
    let attitude = [
        0.05 * phase.cos(),
        -0.05 * phase.sin(),
        yaw + 0.002 * phase.cos() + 0.01 * loss,
    ];
    let rates = [-0.0175 * phase.sin(), -0.0175 * phase.cos(), 0.06 * (0.1 * t).cos()];
    let charge = 0.9 - 0.0042 * t;
    let open_circuit = 14.8 + 1.75 * charge - 0.4 * (1.0 - charge).powi(2);
    let current = 21.0 + 1.5 * (0.07 * t).sin();
    let voltage = open_circuit - 0.03 * current;

    let mut row = TelemetryRow {
        step,
        sim_time_ns: step * STEP_NS,
        position_ned_m: [0, 1, 2].map(|i| (position[i] + noise(i as u64, 7.8e-4)) as f32),
        velocity_ned_m_s: [0, 1, 2].map(|i| (velocity[i] + noise(3 + i as u64, 7.8e-3)) as f32),
        attitude_rad: [0, 1, 2].map(|i| (attitude[i] + noise(6 + i as u64, 5.5e-4)) as f32),
        body_rates_rad_s: [0, 1, 2].map(|i| (rates[i] + noise(9 + i as u64, 5.5e-3)) as f32),
        battery_voltage_v: (voltage + noise(12, 0.01)) as f32,
        battery_current_a: current,
        reference_position_ned_m: reference.map(|x| x as f32),
        reference_velocity_ned_m_s: velocity.map(|x| x as f32),
        reference_yaw_rad: yaw as f32,
        truth: TruthRow {
            position_ned_m: position,
            velocity_ned_m_s: velocity,
            attitude_rad: attitude,
            body_rates_rad_s: rates,
            state_of_charge: charge,
            open_circuit_voltage_v: open_circuit,
            battery_voltage_v: voltage,
            ..TruthRow::default()
        },
        fault_label: if code == 0 { HEALTHY } else { 3 },
        faulty_rotors: if code == 0 { 0 } else { 1 << 2 },
        attitude_setpoint_rad: [
            (0.05 * phase.cos() + noise(13, 4e-3)) as f32,
            (-0.05 * phase.sin() + noise(14, 4e-3)) as f32,
            yaw as f32,
        ],
        sequential_probability: 1.0,
        window_end: step % 25 == 24,
        ..TelemetryRow::default()
    };
    row.rotor_condition[2] = code;
    for rotor in 0..ROTORS {
        row.duty[rotor] =
            (0.39 + 0.0004 * t + 0.02 * (phase + rotor as f64).sin() + noise(20 + rotor as u64, 0.01)) as f32;
        row.truth.thrust_n[rotor] =
            2.53 + 0.1 * (phase + rotor as f64).sin() - if rotor == 2 { 0.1 * loss } else { 0.0 };
        // Residual r_i does not react to rotor i; opposite rotors affect each other's residuals except on the arm.
        let angle = std::f64::consts::FRAC_PI_3 * (rotor as f64 - 2.0);
        let shape = [angle.sin(), 0.6 * (1.0 - angle.cos()), 0.1 * (1.0 - angle.cos())];
        for component in 0..3 {
            let stream = 40 + (3 * rotor + component) as u64;
            let deviation = [0.012, 0.014, 0.008][component];
            let bias = 0.004 * normal(1 << 40, stream);
            row.residuals_nms[rotor][component] = (bias
                + 0.3 * loss * settled * shape[component]
                + deviation * (0.6 * slow(step, stream) + 0.5 * normal(step, stream)))
                as f32;
        }
    }
    let window = step / 25;
    let calibrated = t >= 10.0;
    let lucky = uniform(window, 99);
    row.t_test = match (calibrated, code) {
        (false, _) => NOT_READY,
        (true, 0) => {
            if lucky < 0.012 {
                UNKNOWN
            } else {
                HEALTHY
            }
        }
        (true, _) => {
            if lucky < 0.5 * (-4.0 * loss).exp() {
                UNKNOWN
            } else {
                3
            }
        }
    };
    row.sequential = match (calibrated, code) {
        (false, _) => NOT_READY,
        (true, _) if t < 45.2 => HEALTHY,
        (true, _) => 3,
    };
    if row.sequential == 3 {
        let loss = (0.1 * loss + noise(100, 1e-3)) as f32;
        let values = [loss, 0.9 * loss, 1.1 * loss];
        row.thrust_loss = core::array::from_fn(|i| if i < 3 { values[i] } else { values[i - 3] / 2.5 });
        row.suspect_rotors = 1 << 2;
    }
    row.network = NOT_READY;
    row
}
