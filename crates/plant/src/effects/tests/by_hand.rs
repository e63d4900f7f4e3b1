//! Every effect of the catalogue against a value computed by hand (expectations are from a calculation outside of this code, at the
//! instant of [`instant`]: v_a = (4, 1, 3.6) m/s, ω = (0.3, −0.2, 0.5) rad/s, thrusts 2.0 to 3.0 N).

use super::*;

/// Expectations are printed to ten digits or more.
const ROUNDING: f64 = 1e-9;
/// atan(0.1 I/I_h) at the instant, rad.
const HEADING_RIGHT: f64 = 0.0974659047918369;

fn near(what: &str, got: f64, expected: f64) {
    assert!(
        (got - expected).abs() <= ROUNDING * expected.abs().max(1.0),
        "{what}: got {got}, expected {expected}"
    );
}

fn effect(id: &str, sizes: &[(&str, f64)]) -> Box<dyn ActiveEffect> {
    let declaration = catalogue().iter().find(|entry| entry.id == id).unwrap();
    let set: Vec<_> = sizes
        .iter()
        .map(|(name, v)| (declaration.parameter_index(name).unwrap(), *v))
        .collect();
    build(declaration, &values(declaration, &set), &f550())
}

fn changed(id: &str, sizes: &[(&str, f64)]) -> Constants {
    let mut constants = f550();
    effect(id, sizes).constants(&mut constants);
    constants
}

/// Force and torque that an effect adds, without friction of the vehicle (the F550 has none).
fn added(id: &str, sizes: &[(&str, f64)]) -> Wrench {
    let (constants, mut effect) = (f550(), effect(id, sizes));
    let rotors = Rotors::distinct(&constants);
    let at = instant(&constants, &rotors);
    let mut wrench = Wrench::default();
    effect.wrench(&at, &mut wrench);
    constants.closed(&wrench, at.air_velocity_body, at.body_rates)
}

fn thrusts(id: &str, sizes: &[(&str, f64)]) -> [f64; 6] {
    let (constants, mut effect) = (f550(), effect(id, sizes));
    let rotors = Rotors::distinct(&constants);
    let mut thrust = rotors.thrust;
    effect.rotor_thrust(&instant(&constants, &rotors), &mut thrust);
    thrust
}

#[test]
fn val_forces_and_torques() {
    let f = added("rotor-drag", &[("drag_n_s_m", 0.25)]).force_body;
    near("rotor drag x", f[0], -0.9908782040227853);
    near("rotor drag y", f[1], -0.24771955100569631);
    let f = added("quadratic-drag", &[("drag_kg_m", 0.03)]).force_body;
    near("quadratic drag x", f[0], -0.6568287448033924);
    near("quadratic drag z", f[2], -0.5911458703230531);
    let f = added("wall-effect", &[("strength", 0.1)]).force_body;
    near("wall north", f[0], 0.0024511344088324416);
    near("wall east", f[1], 0.0038174156624830712);
    let m = added("flapping-moment", &[("moment_n_s", 0.003)]).torque_body;
    near("flapping x", m[0], 0.01783235622846056);
    near("flapping y", m[1], -0.07144185865045166);
    let m = added("gyroscopic-torque", &[("inertia_kg_m2", 6e-5)]).torque_body;
    near("gyroscopic x", m[0], 0.00080046439976865);
    near("gyroscopic y", m[1], 0.0012006965996529749);
    near(
        "reaction",
        added("rotor-reaction", &[("inertia_kg_m2", 6e-5)]).torque_body[2],
        0.0300200603661992,
    );
    near(
        "carried weight",
        added("slung-load", &[("weight_kg", 0.15)]).force_body[2],
        1.35,
    );
}

#[test]
fn val_rotors_of_the_document_turn_the_vehicle_as_they_speed_up() {
    // λ of the document acts without any effect: N = λ Σ s c f', f' = 2 f_h (Ω/Ω_h)(Ω/Ω_h)'.
    let yaw = |reaction_s: f64| {
        let constants = Constants {
            rotor_reaction_s: reaction_s,
            ..f550()
        };
        let rotors = Rotors::distinct(&constants);
        let mut set = EffectSet::new(&Catalogue::default(), &[], &constants, 0).unwrap();
        let mut wrench = Wrench::default();
        set.wrench(&instant(&constants, &rotors), &mut wrench);
        wrench.torque_body[2]
    };
    near("reaction of the document", yaw(0.1), 0.006193268013319559);
    assert_eq!(yaw(0.0), 0.0);
}

#[test]
fn val_friction_damping_and_drag_centre() {
    let rotors = Rotors::distinct(&f550());
    let closed = |c: &Constants| {
        let at = instant(c, &rotors);
        let drag = Wrench {
            drag_body: [-2.0, -1.0, 0.0],
            ..Wrench::default()
        };
        c.closed(&drag, at.air_velocity_body, at.body_rates)
    };
    let w = closed(&changed("linear-friction", &[("drag_kg_s", 0.2)]));
    near("linear friction", w.force_body[0], -2.0 - 0.2 * 4.0);
    let w = closed(&changed("rotational-damping", &[("damping_n_m_s", 0.01)]));
    near("damping", w.torque_body[2], -0.01 * 0.5);
    let w = closed(&changed("yaw-damping", &[("damping_n_m_s", 0.02)]));
    near("damping of the yaw", w.torque_body[2], -0.02 * 0.5);
    near("and of nothing else", w.torque_body[0], 0.0);
    // Arms a tenth longer: outwards, not up.
    let (short, long) = (f550(), changed("arm-length", &[("share", 0.1)]));
    for (short, long) in short.rotor_position_body.iter().zip(&long.rotor_position_body) {
        near("arm x", long[0], 1.1 * short[0]);
        near("arm y", long[1], 1.1 * short[1]);
        near("height of a rotor", long[2], short[2]);
    }
    // (0, 0, −0.04) × (−2, −1, 0) = (−0.04, 0.08, 0).
    let w = closed(&changed("drag-centre", &[("height_m", 0.04)]));
    near("drag centre x", w.torque_body[0], -0.04);
    near("drag centre y", w.torque_body[1], 0.08);
    // −2 (1 + 0.2) forward, −1 (1 − 0.2) sideways; with a friction of 0.25 kg/s at 4, 1, 3.6 m/s, −3 and −1.25 before.
    let w = closed(&changed("drag-anisotropy", &[("share", 0.4)]));
    near("uneven drag x", w.force_body[0], -2.4);
    near("uneven drag y", w.force_body[1], -0.8);
    near("uneven drag z", w.force_body[2], 0.0);
    let w = closed(&Constants {
        linear_drag_kg_s: 0.25,
        ..changed("drag-anisotropy", &[("share", 0.4)])
    });
    near("uneven friction x", w.force_body[0], -3.6);
    near("uneven friction y", w.force_body[1], -1.0);
    near("uneven friction z", w.force_body[2], -0.9);
}

#[test]
fn val_mass_leaves_at_its_rate_from_the_onset_and_never_all_of_it() {
    let mass_after = |steps: usize, onset_s: Option<f64>, rate: f64| {
        let mut one = EffectInstance::new("mass-loss", &[("rate_kg_s", rate)]);
        one.onset_s = onset_s;
        let constants = f550();
        let rotors = Rotors::distinct(&constants);
        let mut set = EffectSet::new(&Catalogue::default(), &[one], &constants, 0).unwrap();
        for k in 0..steps {
            set.begin(k as f64 * 0.0025);
            set.advance(&instant(&constants, &rotors), 0.0025);
        }
        set.begin(steps as f64 * 0.0025);
        set.constants().mass_kg
    };
    // 2.5 g/s for 10 s; for 6 s after an onset at 4 s.
    near("from the start", mass_after(4000, None, 0.0025), 1.525);
    near("from 4 s on", mass_after(4000, Some(4.0), 0.0025), 1.535);
    near("before it sets in", mass_after(1600, Some(4.0), 0.0025), 1.55);
    near("all there is", mass_after(80_000, None, 0.0025 * 40.0), 0.155);
}

#[test]
fn val_a_heading_errs_with_the_field_of_the_current() {
    let read = |forward: f64, right: f64, yaw: f64| {
        let constants = f550();
        let rotors = Rotors::distinct(&constants);
        let mut readings = Readings {
            attitude: [0.1, -0.05, yaw],
            ..Readings::default()
        };
        effect("current-heading", &[("forward_share", forward), ("right_share", right)])
            .readings(&instant(&constants, &rotors), &mut readings);
        assert_eq!(readings.attitude[..2], [0.1, -0.05]);
        readings.attitude[2]
    };
    // I/I_h = 0.98666896 · 15.36 V/15.5 V = 0.97775711: heading north, 0.1 of it to the right reads atan(0.097775711) too little.
    near("field to the right", read(0.0, 0.1, 0.0), -HEADING_RIGHT);
    // Heading east, a field forward points east: the same error.
    let east = std::f64::consts::FRAC_PI_2;
    near("field forward", read(0.1, 0.0, east), east - HEADING_RIGHT);
    // Heading north it lies along the earth's field: none; and none of the heading's turns is lost.
    near("along", read(0.1, 0.0, 0.0), 0.0);
    near(
        "after a turn",
        read(0.0, 0.1, 2.0 * std::f64::consts::PI),
        2.0 * std::f64::consts::PI - HEADING_RIGHT,
    );
}

#[test]
fn val_thrusts() {
    let f = thrusts("translational-lift", &[("lift_n_s2_m2", 0.005)]);
    near("translational lift 1", f[0], 2.0835353161802037);
    near("translational lift 4", f[3], 2.6866537463197964);
    let f = thrusts("axial-inflow", &[("loss_n_s_m", 0.15)]);
    near("inflow 1", f[0], 2.4915596446152732);
    near("inflow 4", f[3], 3.1334561241975774);
    let f = thrusts("vortex-ring", &[("loss", 0.7)]);
    near("vortex ring 1", f[0], 1.8968389583833962);
    near("vortex ring 4", f[3], 2.5001078990855192);
    near(
        "ground 1",
        thrusts("ground-effect", &[("strength", 1.0)])[0],
        2.0202020202020203,
    );
    near(
        "ceiling 1",
        thrusts("ceiling-effect", &[("strength", 1.0)])[0],
        2.327272727272727,
    );
    let f = thrusts("rotor-interference", &[("loss_s_m", 0.05)]);
    near("front rotor", f[0], 2.0);
    near("rear rotor", f[3], 2.0846667900320917);
}

#[test]
fn val_a_small_or_a_positive_deviation_of_thrust_is_no_damage() {
    let declaration = catalogue()
        .iter()
        .find(|entry| entry.id == "rotor-thrust-scale")
        .unwrap();
    let tolerance = declaration.parameters[0].tolerance.unwrap();
    let said = |size, half_width, sets_in| tolerance.words(size, half_width, sets_in);
    for (size, half_width, sets_in, expected) in [
        (-0.006, 0.0005, false, tolerance.within),
        (0.009, 0.0002, false, tolerance.within),
        // It may be within.
        (-0.025, 0.006, false, tolerance.within),
        (-0.033, 0.006, false, tolerance.below),
        (0.033, 0.006, false, tolerance.above),
        // What was right at the start is no matter of how it was made.
        (-0.006, 0.0005, true, tolerance.below),
        (0.006, 0.0005, true, tolerance.above),
    ] {
        let words = said(size, half_width, sets_in);
        assert!(words.starts_with(expected), "{size} ± {half_width}: {words}");
        assert_eq!(words.ends_with(tolerance.condition), !sets_in, "{words}");
    }
    assert!(tolerance.below.contains("damaged") && !tolerance.within.contains("damaged blade"));
    assert!(tolerance.above.contains("no damage"));
}

#[test]
fn val_geometry_and_mass() {
    let thrust = Rotors::distinct(&f550()).thrust;
    let nominal = f550().rotor_wrench(&thrust);
    near("M_x", nominal.torque_body[0], 0.33);
    near("collective", nominal.force_body[2], -15.0);
    let c = changed("centre-of-mass", &[("forward_m", 0.008), ("right_m", -0.005)]);
    let w = c.rotor_wrench(&thrust);
    near("centre of mass x", w.torque_body[0], 0.255);
    near("centre of mass y", w.torque_body[1], -0.12);
    let w = changed("rotor-tilt-tangential", &[("angle_rad", 0.035)]).rotor_wrench(&thrust);
    near("tangential x", w.force_body[0], -0.035);
    near("tangential y", w.force_body[1], 0.06062177826491071);
    near("tangential N", w.torque_body[2] - nominal.torque_body[2], 0.01925);
    let w = changed("rotor-tilt-radial", &[("angle_rad", 0.035)]).rotor_wrench(&thrust);
    near("radial x", w.force_body[0], 0.06062177826491071);
    near("radial N", w.torque_body[2], nominal.torque_body[2]);
    let w = changed("moment-ratio", &[("share", 0.2)]).rotor_wrench(&thrust);
    // Σ s_i f_i = −0.6 N, 0.016 m.
    near("moment ratio", w.torque_body[2], -0.6 * 0.016 * 1.2);
    let w = changed("rotor-moment-ratio", &[("share", 0.15)]).rotor_wrench(&thrust);
    // Rotor 1 gives 2 N.
    near(
        "moment ratio of rotor 1",
        (w.torque_body[2] - nominal.torque_body[2]).abs(),
        2.0 * 0.016 * 0.15,
    );
    near("no force with it", w.force_body[0], nominal.force_body[0]);
    let w = changed("reversed-spin", &[("share", 1.0)]).rotor_wrench(&thrust);
    near("reversed spin of rotor 1", w.torque_body[2], -4.6 * 0.016);
    near("mass", changed("mass", &[("share", 0.1)]).mass_kg, 1.705);
    for (id, axis, expected) in [
        ("inertia-roll", 0, 0.03059),
        ("inertia-pitch", 1, 0.03059),
        ("inertia-yaw", 2, 0.05727),
    ] {
        near(
            id,
            changed(id, &[("share", 0.15)]).inertia_body_kg_m2[axis][axis],
            expected,
        );
    }
    for (id, a, b) in [
        ("inertia-product-xy", 0, 1),
        ("inertia-product-xz", 0, 2),
        ("inertia-product-yz", 1, 2),
    ] {
        let j = changed(id, &[("value_kg_m2", 0.001)]).inertia_body_kg_m2;
        near(id, j[a][b], 0.001);
        near(id, j[b][a], 0.001);
    }
}

#[test]
fn val_actuators() {
    near(
        "density",
        changed("air-density", &[("share", -0.06)]).rotor_gain[5],
        0.94,
    );
    let c = changed("rotor-thrust-scale", &[("share", -0.05)]);
    near("rotor 1", c.rotor_gain[0], 0.95);
    near("rotor 2", c.rotor_gain[1], 1.0);
    near(
        "lift bias",
        changed("rotor-lift-bias", &[("bias_n", 0.006)]).rotor_bias_n[0],
        0.006,
    );
    // (3 − 2)/0.07 N/s.
    near(
        "time constant",
        changed("motor-time-constant", &[("share", 0.4)]).thrust_rate(3.0, 2.0),
        1.0 / 0.07,
    );
    let c = changed("lag-asymmetry", &[("share", 0.2)]);
    near("rising", c.thrust_rate(3.0, 2.0), 1.0 / 0.04);
    near("falling", c.thrust_rate(2.0, 3.0), -1.0 / 0.06);
    near(
        "speed lag",
        changed("speed-domain-lag", &[("share", 1.0)]).thrust_rate(3.0, 2.0),
        17.97958971132711,
    );
    near(
        "delay",
        changed("command-delay", &[("delay_s", 0.01)]).command_delay_s,
        0.01,
    );
    near(
        "dead zone",
        changed("dead-zone", &[("duty", 0.02)]).effective_duty(0.4),
        0.38,
    );
    near(
        "below dead zone",
        changed("dead-zone", &[("duty", 0.02)]).effective_duty(0.01),
        0.0,
    );
    near(
        "saturation",
        changed("saturation", &[("lost_duty", 0.15)]).effective_duty(0.95),
        0.85,
    );
    near(
        "ESC",
        changed("esc-resistance", &[("resistance_ohm", 0.04)]).esc_resistance_ohm,
        0.04,
    );
    let (constants, mut swap) = (f550(), effect("swapped-rotors", &[("share", 1.0), ("partner", 2.0)]));
    let rotors = Rotors::distinct(&constants);
    let mut duty = rotors.duty;
    swap.command(&instant(&constants, &rotors), &mut duty);
    near("swapped 1", duty[0], 0.33);
    near("swapped 2", duty[1], 0.31);
}

#[test]
fn val_battery() {
    near(
        "resistance",
        changed("internal-resistance", &[("added_ohm", 0.015)]).internal_resistance_ohm,
        0.025,
    );
    let c = changed("battery-rc", &[("resistance_ohm", 0.012)]);
    near("RC resistance", c.rc_resistance_ohm, 0.012);
    near("RC time", c.rc_time_s, 15.0);
    near(
        "capacity",
        changed("battery-capacity", &[("share", -0.2)]).capacity_ah,
        5.4,
    );
    near(
        "charge",
        changed("charge-offset", &[("charge", 0.2)]).charge_offset,
        0.2,
    );
    near(
        "cold",
        changed("cold-battery", &[("below_25_k", 25.0)]).internal_resistance_ohm,
        0.02521868260358148,
    );
}

#[test]
fn val_sensors() {
    let rotors = Rotors::distinct(&f550());
    let read = |id: &str, sizes: &[(&str, f64)]| {
        let constants = changed(id, sizes);
        let at = instant(&constants, &rotors);
        let mut readings = Readings {
            attitude: [0.1, 0.2, 0.3],
            body_rates: at.body_rates,
            specific_force: at.specific_force,
            battery_voltage: at.battery_voltage,
            ..Readings::default()
        };
        effect(id, sizes).readings(&at, &mut readings);
        constants.corrupt(&mut readings, at.angular_acceleration);
        readings
    };
    near(
        "voltage gain",
        read("voltage-gain", &[("share", 0.02)]).battery_voltage,
        15.81,
    );
    near(
        "voltage offset",
        read("voltage-offset", &[("offset_v", 0.3)]).battery_voltage,
        15.8,
    );
    near(
        "accelerometer bias",
        read("accelerometer-bias", &[("y_m_s2", 0.1)]).specific_force[1],
        -0.2,
    );
    near(
        "accelerometer scale",
        read("accelerometer-scale", &[("share", 0.02)]).specific_force[2],
        -9.18,
    );
    near("gyro bias", read("gyro-bias", &[("z_rad_s", 0.01)]).body_rates[2], 0.51);
    near(
        "gyro scale",
        read("gyro-scale", &[("share", 0.02)]).body_rates[0],
        0.306,
    );
    // (0.02, 0, 0) × (0.4, −0.3, −9) = (0, 0.18, −0.006);  × (0.3, −0.2, 0.5) = (0, −0.01, −0.004).
    let r = read("imu-misalignment", &[("x_rad", 0.02)]);
    near("misaligned force", r.specific_force[1], -0.12);
    near("misaligned rate", r.body_rates[2], 0.496);
    // ω' × r = (2, −1, 0.5) × (0.03, 0, 0) = (0, 0.015, 0.03);  ω × (ω × r) = ω (ω·r) − r ω² = (−0.0087, −0.0018, 0.0045).
    let r = read("imu-lever-arm", &[("x_m", 0.03)]);
    near("lever arm x", r.specific_force[0], 0.4 - 0.0087);
    near("lever arm y", r.specific_force[1], -0.3 + 0.015 - 0.0018);
    near("lever arm z", r.specific_force[2], -9.0 + 0.03 + 0.0045);
    near(
        "heading",
        read("heading-offset", &[("offset_rad", 0.08)]).attitude[2],
        0.38,
    );
    near(
        "level",
        read("level-offset", &[("roll_rad", 0.01), ("pitch_rad", -0.01)]).attitude[1],
        0.19,
    );
    near(
        "vibration",
        read("vibration-rectification", &[("hover_bias_m_s2", 0.25)]).specific_force[2],
        -9.0 + 0.24328823946888659,
    );
    near(
        "IMU latency",
        changed("imu-latency", &[("delay_s", 0.006)]).imu_latency_s,
        0.006,
    );
    near(
        "attitude latency",
        changed("attitude-latency", &[("delay_s", 0.012)]).attitude_latency_s,
        0.012,
    );
    near(
        "velocity latency",
        changed("velocity-latency", &[("delay_s", 0.08)]).velocity_latency_s,
        0.08,
    );
    near(
        "position latency",
        changed("position-latency", &[("delay_s", 0.08)]).position_latency_s,
        0.08,
    );
    near(
        "wind",
        changed("wind", &[("north_m_s", 3.0), ("east_m_s", -2.0)]).wind_ned_m_s[1],
        -2.0,
    );
}

/// A driven pendulum against its exact solution: q(t) = −(a/g)(1 − cos ωt) for a constant acceleration a and no damping.
#[test]
fn val_slung_load_swings_at_its_frequency() {
    let constants = f550();
    let declaration = catalogue().iter().find(|e| e.id == "slung-load").unwrap();
    let mut load = build(declaration, &[0.15, 0.0, 1.0, 0.0], &constants);
    let rotors = Rotors::distinct(&constants);
    let at = instant(&constants, &rotors);
    let omega = 9.81_f64.sqrt();
    for step in 1..=2000_u32 {
        load.advance(&at, 0.0025);
        let mut wrench = Wrench::default();
        load.wrench(&at, &mut wrench);
        // The force of the middle of the step that follows.
        let exact = -0.4 / 9.81 * (1.0 - (omega * 0.0025 * (f64::from(step) + 0.5)).cos());
        let got = wrench.force_body[0] / (0.15 * 9.81);
        // Leapfrog: the phase is right to (ω h)²/24 of itself, 4e-5 after 5 s; the half drift to (ω h)²/8, 8e-6.
        assert!(
            (got - exact).abs() < 1e-4 * 0.4 / 9.81,
            "step {step}: {got}, exact {exact}"
        );
    }
}

/// The mode against the mean over each step of the exact step response of an underdamped second-order system.
#[test]
fn val_frame_flex_rings_at_its_frequency() {
    let constants = f550();
    let declaration = catalogue().iter().find(|e| e.id == "frame-flex").unwrap();
    let mut flex = build(declaration, &[1.0, 25.0, 0.05], &constants);
    let rotors = Rotors::distinct(&constants);
    let at = instant(&constants, &rotors);
    let (w, z) = (2.0 * std::f64::consts::PI * 25.0, 0.05_f64);
    let damped = w * (1.0 - z * z).sqrt();
    for step in 0..200_u32 {
        let mut wrench = Wrench {
            torque_body: [0.2, 0.0, 0.0],
            ..Wrench::default()
        };
        flex.wrench(&at, &mut wrench);
        let response =
            |t: f64| 0.2 * (1.0 - (-z * w * t).exp() * ((damped * t).cos() + z * w / damped * (damped * t).sin()));
        // Mean over the step by Simpson's rule, good to 1e-12 at this width.
        let (start, width) = (0.0025 * f64::from(step), 0.0025 / 64.0);
        let sum: f64 = (0..32)
            .map(|pair| start + 2.0 * f64::from(pair) * width)
            .map(|t| response(t) + 4.0 * response(t + width) + response(t + 2.0 * width))
            .sum();
        near("torque", wrench.torque_body[0], sum * width / 3.0 / 0.0025);
        flex.advance(&at, 0.0025);
    }
}

/// Stationary deviations of both gust models; bounds hold for this seed and are four standard errors of the estimate wide.
#[test]
fn val_gusts_have_their_deviation() {
    let constants = f550();
    let rotors = Rotors::distinct(&constants);
    let at = instant(&constants, &rotors);
    for (id, shape) in [("gusts", 0.5), ("dryden-gusts", 5.0)] {
        let declaration = catalogue().iter().find(|e| e.id == id).unwrap();
        let mut gusts = build(declaration, &[1.5, shape], &constants);
        let mut sum = [0.0; 3];
        const STEPS: u32 = 800_000;
        for _ in 0..STEPS {
            gusts.advance(&at, 0.0025);
            let mut wind = [0.0; 3];
            gusts.wind(&at, &mut wind);
            for i in 0..3 {
                sum[i] += wind[i] * wind[i];
            }
        }
        for square in sum {
            let deviation = (square / f64::from(STEPS)).sqrt();
            // 2000 s hold at least 1000 independent samples: the deviation is known to 2.2 %.
            assert!((deviation - 1.5).abs() < 0.09 * 1.5, "{id}: {deviation}");
        }
    }
}

#[test]
fn val_cold_battery_warms() {
    let constants = f550();
    let mut cold = effect("cold-battery", &[("below_25_k", 25.0)]);
    let rotors = Rotors::distinct(&constants);
    let at = instant(&constants, &rotors);
    for _ in 0..72_000 {
        cold.advance(&at, 0.0025);
    }
    let mut warmer = constants;
    cold.constants(&mut warmer);
    // One time constant of 180 s: 25 K/e.
    near(
        "after 180 s",
        warmer.internal_resistance_ohm,
        0.01 * (0.037 * 25.0 / std::f64::consts::E).exp(),
    );
}

#[test]
fn val_the_law_of_the_thrust() {
    let lifts = |id: &str, sizes: &[(&str, f64)]| {
        let (constants, mut effect) = (f550(), effect(id, sizes));
        let rotors = Rotors::distinct(&constants);
        let mut lift = rotors.thrust;
        effect.static_lift(&instant(&constants, &rotors), &mut lift);
        lift
    };
    near("reference voltage", f550().reference_voltage_v, 15.36);
    near(
        "shape of the curve",
        lifts("thrust-curve-shape", &[("share", 0.15)])[0],
        1.9275959465255228,
    );
    near(
        "exponent of the voltage",
        lifts("voltage-exponent", &[("exponent", 0.4)])[5],
        3.010907737300087,
    );
    // Nothing turns where nothing turned.
    let constants = f550();
    let rotors = Rotors::distinct(&constants);
    let mut lift = [0.0; 6];
    effect("thrust-curve-shape", &[("share", -0.4)]).static_lift(&instant(&constants, &rotors), &mut lift);
    assert_eq!(lift, [0.0; 6]);
}
