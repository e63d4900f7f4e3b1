use super::*;
use rotortwin_plant::random::NormalStream;

/// A hexarotor in the air for [`SPAN_S`], its sensors at [`RATE_HZ`].
const RATE_HZ: f64 = 800.0;
const SPAN_S: f64 = 30.0;
const ROTORS: usize = 6;
/// Mean speeds, Hz: neighbours 2 to 4 Hz apart, as rotors of one vehicle are in hover.
const SPEEDS_HZ: [f64; ROTORS] = [98.0, 101.0, 104.0, 107.0, 110.0, 113.0];
/// Amplitude of a healthy rotor at 100 Hz, m/s².
const HEALTHY: [f64; ROTORS] = [0.20, 0.12, 0.30, 0.18, 0.25, 0.15];
/// White noise of a sample, m/s², and its motion as a vehicle.
const NOISE: f64 = 0.6;
const MOTION: f64 = 1.5;

/// A flight whose rotors pull with `amplitudes` at 100 Hz; ESC telemetry at 10 Hz to 0.2 %, interpolated.
fn flight(seed: u64, amplitudes: &[f64; ROTORS]) -> FlightLog {
    let mut draws = NormalStream::new(seed, "vibration");
    let count = (SPAN_S * RATE_HZ) as usize;
    let time: Vec<f64> = (0..count).map(|k| k as f64 / RATE_HZ).collect();
    let wander: Vec<[f64; 3]> = (0..ROTORS).map(|_| std::array::from_fn(|_| draws.sample())).collect();
    let speed = |rotor: usize, t: f64| {
        let [a, b, c] = wander[rotor];
        let slow = 1.5 * a * (0.9 * t + b).sin() + 1.0 * c * (2.3 * t + a).sin();
        TAU * (SPEEDS_HZ[rotor] + slow)
    };
    let mut axes = vec![vec![0.0; count]; 3];
    for (rotor, amplitude) in amplitudes.iter().enumerate() {
        // The way from the motor to the sensor: other shares and phases on each axis.
        let way: Vec<(f64, f64)> = (0..3).map(|_| (draws.sample(), TAU * draws.sample())).collect();
        let size = way.iter().map(|(share, _)| share * share).sum::<f64>().sqrt();
        let mut angle = 0.0;
        for k in 0..count {
            let turn = speed(rotor, time[k]);
            // Euler's rule at a fifth of the step: none of the product's code.
            angle += turn / RATE_HZ;
            let pull = amplitude * (turn / (TAU * 100.0)).powi(2);
            for (axis, (share, lag)) in axes.iter_mut().zip(&way) {
                axis[k] += pull * share / size * (angle + lag).cos();
            }
        }
    }
    for (i, axis) in axes.iter_mut().enumerate() {
        for (k, value) in axis.iter_mut().enumerate() {
            let slow = MOTION * (TAU * 0.7 * time[k] + i as f64).sin();
            *value += slow + NOISE * draws.sample() - if i == 2 { 9.81 } else { 0.0 };
        }
    }
    let mut columns: Vec<(String, Vec<f64>)> = names::ACCEL
        .iter()
        .zip(axes)
        .map(|(n, a)| ((*n).to_owned(), a))
        .collect();
    for rotor in 0..ROTORS {
        let told: Vec<f64> = (0..=(SPAN_S * 10.0) as usize)
            .map(|k| speed(rotor, k as f64 / 10.0) * (1.0 + 0.002 * draws.sample()))
            .collect();
        let between = |t: &f64| {
            let place = t * 10.0;
            let before = place as usize;
            told[before] + (place - before as f64) * (told[before + 1] - told[before])
        };
        columns.push((names::rotor_speed(rotor + 1), time.iter().map(between).collect()));
        columns.push((names::duty(rotor + 1), vec![0.5; count]));
    }
    FlightLog::from_columns(&format!("flight-{seed}"), time, columns).unwrap()
}

#[test]
fn val_every_rotor_has_the_amplitude_that_it_was_given() {
    let found = vibration(&flight(1, &HEALTHY), None).unwrap();
    for (line, given) in found.rotors.iter().zip(HEALTHY) {
        let expected = given * (found.reference_hz / 100.0).powi(2);
        let amplitude = line.amplitude.expect("told apart");
        // Telemetry that is 0.2 % off blurs a line: some tenths are lost, on every flight alike.
        assert!(
            amplitude > 0.6 * expected && amplitude < 1.2 * expected,
            "rotor {}: {amplitude} of {expected}",
            line.rotor
        );
        assert!(line.seen);
    }
}

#[test]
fn val_a_rotor_out_of_balance_is_named_and_healthy_flights_name_none() {
    let healthy: Vec<FlightLog> = (10..15).map(|seed| flight(seed, &HEALTHY)).collect();
    let (mut alarms, mut right) = (0, 0);
    for seed in 0..6 {
        let rotor = seed as usize % ROTORS;
        let mut damaged = HEALTHY;
        damaged[rotor] *= 4.0;
        let found = change(&[flight(100 + seed, &damaged)], &healthy, None).unwrap();
        let named: Vec<usize> = found.named.iter().filter_map(|one| one.rotor).collect();
        right += usize::from(named == [rotor + 1]);
        assert!(
            named.iter().all(|one| *one == rotor + 1),
            "rotor {}: {}",
            rotor + 1,
            found.sentence
        );
        alarms += usize::from(
            !change(&[flight(200 + seed, &HEALTHY)], &healthy, None)
                .unwrap()
                .named
                .is_empty(),
        );
    }
    assert_eq!(alarms, 0);
    assert_eq!(right, 6);
}

#[test]
fn val_two_rotors_out_of_balance_are_both_named() {
    let healthy: Vec<FlightLog> = (10..15).map(|seed| flight(seed, &HEALTHY)).collect();
    let mut damaged = HEALTHY;
    damaged[1] *= 5.0;
    damaged[4] *= 4.0;
    let found = change(&[flight(7, &damaged)], &healthy, None).unwrap();
    let mut named: Vec<usize> = found.named.iter().filter_map(|one| one.rotor).collect();
    named.sort_unstable();
    assert_eq!(named, [2, 5], "{}", found.sentence);
}

#[test]
fn val_a_sensor_that_is_too_slow_says_so() {
    let fast = flight(1, &HEALTHY);
    let every = |values: &Vec<f64>| values.iter().copied().step_by(8).collect::<Vec<f64>>();
    let columns: Vec<_> = fast
        .columns
        .iter()
        .map(|(name, values)| (name.clone(), every(values)))
        .collect();
    let slow = FlightLog::from_columns("slow", every(&fast.time_s), columns).unwrap();
    let error = vibration(&slow, None).unwrap_err().to_string();
    assert!(
        error.contains("the accelerometer comes at 100 Hz, too slow for rotors at 10"),
        "{error}"
    );
}

/// The same flight as an inertial unit alone records it.
fn unit_alone(seed: u64, amplitudes: &[f64; ROTORS]) -> FlightLog {
    let mut log = flight(seed, amplitudes);
    log.columns.retain(|name, _| names::ACCEL.contains(&name.as_str()));
    log
}

#[test]
fn val_without_speeds_and_model_the_vehicle_is_taken_as_a_whole() {
    let found = vibration(&unit_alone(1, &HEALTHY), None).unwrap();
    // Lines of the rotors at their mean speeds, and white noise: 2 σ² on each axis, as far as the band reaches.
    let lines: f64 = HEALTHY
        .iter()
        .zip(SPEEDS_HZ)
        .map(|(a, hz)| (a * (hz / 100.0).powi(2)).powi(2))
        .sum();
    let noise = 3.0 * 2.0 * NOISE * NOISE * (0.45 * RATE_HZ - 25.0) / (0.5 * RATE_HZ);
    let expected = (lines + noise).sqrt();
    assert!(
        (found.amplitude / expected - 1.0).abs() < 0.05,
        "{} of {expected}",
        found.amplitude
    );
    let [from_hz, to_hz] = found.band_hz.expect("of the vehicle as a whole");
    assert_eq!(from_hz, 25.0);
    assert!((to_hz - 0.45 * RATE_HZ).abs() < 1e-6, "{to_hz}");
    assert!((94.0..118.0).contains(&found.reference_hz), "{}", found.reference_hz);
    assert!(found.rotors.is_empty() && found.strongest.is_none());
}

#[test]
fn val_a_vehicle_that_shakes_more_is_told_without_a_rotor() {
    let healthy: Vec<FlightLog> = (10..14).map(|seed| unit_alone(seed, &HEALTHY)).collect();
    let mut damaged = HEALTHY;
    damaged[2] *= 12.0;
    let found = change(&[unit_alone(50, &damaged)], &healthy, None).unwrap();
    assert!(found.named.is_empty());
    assert!(
        found
            .sentence
            .contains("the vehicle vibrates more between 25 and 360 Hz (")
            && found.sentence.contains("Which rotor it is, is not shown"),
        "{}",
        found.sentence
    );
    let quiet = change(&[unit_alone(51, &HEALTHY)], &healthy, None).unwrap();
    assert!(
        quiet.sentence.contains("does not vibrate significantly more"),
        "{}",
        quiet.sentence
    );
    // Other rates: the band that all of them have.
    let every = |values: &Vec<f64>| values.iter().copied().step_by(2).collect::<Vec<f64>>();
    let fast = unit_alone(52, &HEALTHY);
    let columns: Vec<_> = fast.columns.iter().map(|(n, v)| (n.clone(), every(v))).collect();
    let slower = FlightLog::from_columns("slower", every(&fast.time_s), columns).unwrap();
    let found = change(&[slower], &healthy, None).unwrap();
    assert!((found.flights[0].band_hz.unwrap()[1] - 180.0).abs() < 1.0);
    // A log with rotor speeds is another kind of flight.
    let error = change(&[flight(53, &HEALTHY)], &healthy, None).unwrap_err().to_string();
    assert!(error.contains("expected rotor speeds as in flight-53"), "{error}");
}

#[test]
fn val_a_knock_does_not_count_and_a_slow_sensor_says_so() {
    let calm = unit_alone(3, &HEALTHY);
    let mut knocked = calm.clone();
    for value in &mut knocked.columns.get_mut(names::ACCEL[2]).unwrap()[8000..8040] {
        *value += 300.0;
    }
    let amplitude = |log: &FlightLog| vibration(log, None).unwrap().amplitude;
    assert!((amplitude(&knocked) / amplitude(&calm) - 1.0).abs() < 0.02);
    let every = |values: &Vec<f64>| values.iter().copied().step_by(8).collect::<Vec<f64>>();
    let columns: Vec<_> = calm.columns.iter().map(|(n, v)| (n.clone(), every(v))).collect();
    let slow = FlightLog::from_columns("slow", every(&calm.time_s), columns).unwrap();
    let error = vibration(&slow, None).unwrap_err().to_string();
    assert!(
        error.contains("the accelerometer comes at 100 Hz; at least 111 Hz are needed"),
        "{error}"
    );
}
