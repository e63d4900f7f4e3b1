use super::*;
use rotortwin_plant::random::NormalStream;
use std::path::Path;

/// Spread of the healthy flights of the tests, as of the Crazyflie of CrazyPAD: common factor, each rotor.
const COMMON: f64 = 0.019;
const EACH: f64 = 0.02;

fn vehicle() -> (Constants, VehicleSize) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/crazyflie-e8.toml");
    let vehicle = ModelVersion::load(&path).unwrap().documents().vehicle;
    let constants = Constants::nominal(&vehicle);
    let size = VehicleSize::of(&constants, &vehicle.battery);
    (constants, size)
}

/// Rotors that differ by 14 %.
const HEALTHY_N: [f64; 4] = [0.0797, 0.0635, 0.0838, 0.0673];

fn flights(draws: &mut NormalStream, mean: &[f64], count: usize) -> Vec<Vec<f64>> {
    (0..count)
        .map(|_| {
            let common = COMMON * draws.sample();
            mean.iter()
                .map(|f| f * (common + EACH * draws.sample()).exp())
                .collect()
        })
        .collect()
}

#[test]
fn val_a_rotor_with_another_gain_balances_force_and_torque() {
    let (constants, _) = vehicle();
    let balance = Balance {
        healthy: &HEALTHY_N,
        constants: &constants,
    };
    let z = balance.signature(Kind::Rotor(2), &[-0.2]);
    for (i, z) in z.iter().enumerate() {
        let expected = if i == 2 { -(0.8_f64.ln()) } else { 0.0 };
        // 0.2 to the 60th, and an allocation by elimination.
        assert!((z - expected).abs() < 1e-9, "rotor {i}: {z}");
    }
}

#[test]
fn val_losses_and_loads_are_named_and_healthy_flights_are_not() {
    const DRAWS: usize = 200;
    let (constants, size) = vehicle();
    let balance = Balance {
        healthy: &HEALTHY_N,
        constants: &constants,
    };
    let mut draws = NormalStream::new(77, "trim");
    let (mut alarms, mut wrong, mut right, mut covered) = (0, 0, 0, 0);
    for round in 0..DRAWS {
        let baseline = flights(&mut draws, &HEALTHY_N, 7);
        let healthy = flights(&mut draws, &HEALTHY_N, 1);
        alarms += usize::from(!weigh(&healthy, &baseline, false, &constants, &size).named.is_empty());
        let rotor = round % 4;
        let z = balance.signature(Kind::Rotor(rotor), &[-0.25]);
        let mean: Vec<f64> = HEALTHY_N.iter().zip(z).map(|(f, z)| f * z.exp()).collect();
        let found = weigh(&flights(&mut draws, &mean, 1), &baseline, false, &constants, &size);
        match found.named.as_slice() {
            [one] if one.rotor == Some(rotor + 1) => right += 1,
            [one] => wrong += usize::from(one.rotor != Some(rotor + 1)),
            _ => {}
        }
        let own = found.ranking.iter().find(|c| c.rotor == Some(rotor + 1)).unwrap();
        covered += usize::from((own.parameters[0].value + 0.25).abs() < own.parameters[0].interval_95);
    }
    // The posterior is to be wrong in 5 of 100 at most; binomial scatter of 200 draws at two deviations is 3 %.
    assert!(alarms <= 16, "{alarms} false alarms of {DRAWS}");
    assert!(wrong <= 16, "{wrong} wrong rotors of {DRAWS}");
    // A quarter of the thrust is nine spreads.
    assert!(right >= 140, "{right} of {DRAWS} named");
    assert!(covered >= 170, "{covered} of {DRAWS} intervals hold the truth");
}

#[test]
fn val_two_damaged_rotors_are_named_as_two() {
    let (constants, size) = vehicle();
    let balance = Balance {
        healthy: &HEALTHY_N,
        constants: &constants,
    };
    let mut draws = NormalStream::new(31, "trim");
    let (mut named, mut wrong) = (0, 0);
    for round in 0..60 {
        let (first, second) = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)][round % 6];
        // By hand: a rotor with the gain 1 + s is commanded 1/(1 + s) of a quadrotor's thrust.
        let mut mean = HEALTHY_N.to_vec();
        mean[first] /= 0.7;
        mean[second] /= 0.75;
        let z = balance.signature(Kind::Pair(first, second), &[-0.3, -0.25]);
        for (f, (z, healthy)) in mean.iter().zip(z.iter().zip(HEALTHY_N)) {
            assert!((f / healthy - z.exp()).abs() < 1e-9);
        }
        let baseline = flights(&mut draws, &HEALTHY_N, 7);
        let found = weigh(&flights(&mut draws, &mean, 1), &baseline, false, &constants, &size);
        let pair = (Some(first + 1), Some(second + 1));
        named += usize::from(matches!(found.named.as_slice(), [one] if (one.rotor, one.second_rotor) == pair));
        // A load off the centre requires more of two neighbours, too: then both are in the answer.
        wrong += usize::from(
            !found.named.is_empty() && !found.named.iter().any(|one| (one.rotor, one.second_rotor) == pair),
        );
    }
    assert!(wrong <= 3, "{wrong} of 60 without the truth");
    assert!(named >= 15, "{named} of 60 named alone");
}

#[test]
fn val_more_healthy_flights_show_a_smaller_loss_and_another_day_a_larger_one() {
    let (constants, size) = vehicle();
    let mut draws = NormalStream::new(8, "trim");
    let baseline = flights(&mut draws, &HEALTHY_N, 4);
    let (now, more) = smallest_losses(&baseline, false, &constants, &size);
    let now = now.expect("a loss that four flights show");
    let more: Vec<f64> = more.iter().map(|more| more.smallest_loss.unwrap()).collect();
    assert!(more[0] < now && more[1] <= more[0], "{now} {more:?}");
    let (other, _) = smallest_losses(&baseline, true, &constants, &size);
    assert!(other.unwrap() > now);
}

#[test]
fn val_a_load_at_a_corner_is_no_damaged_rotor() {
    let (constants, size) = vehicle();
    let balance = Balance {
        healthy: &HEALTHY_N,
        constants: &constants,
    };
    let z = balance.signature(Kind::Load, &[0.2, -0.004, 0.004]);
    let mean: Vec<f64> = HEALTHY_N.iter().zip(z).map(|(f, z)| f * z.exp()).collect();
    let mut draws = NormalStream::new(5, "trim");
    let found = weigh(&[mean], &flights(&mut draws, &HEALTHY_N, 7), false, &constants, &size);
    assert_eq!(found.named[0].effect, "mass with centre-of-mass", "{}", found.sentence);
}

#[test]
fn val_two_healthy_flights_are_refused() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/crazyflie-e8.toml");
    let model = ModelVersion::load(&path).unwrap();
    let error = trim(&[], &[], &model).unwrap_err();
    assert!(error.to_string().contains("at least 3 healthy flights"), "{error}");
}
