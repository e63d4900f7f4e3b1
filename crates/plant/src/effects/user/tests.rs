//! Effects of users against built-in ones, and refusals.

use super::super::tests::{Rotors, f550, instant};
use super::super::{Catalogue, EffectInstance, EffectSet};
use super::*;

const DRAG: &str = r#"
id = "my-rotor-drag"
name = "Rotor drag, written by a user"
[[parameter]]
name = "drag_n_s_m"
unit = "N·s/m"
low = 0.0
high = 0.5
typical = 0.25
[[term]]
place = "force_x"
expression = "-drag_n_s_m * mean_speed_ratio * air_velocity_x"
[[term]]
place = "force_y"
expression = "-drag_n_s_m * mean_speed_ratio * air_velocity_y"
"#;

const INFLOW: &str = r#"
id = "my-inflow"
name = "Axial inflow, written by a user"
[[parameter]]
name = "loss"
unit = "N/(m/s)"
low = 0.0
high = 0.25
typical = 0.15
[[term]]
place = "rotor_thrust"
expression = "loss * rotor_speed_ratio * rotor_air_velocity_z"
"#;

#[test]
fn val_user_effects_do_what_built_in_ones_do() {
    let documents = [DRAG, INFLOW].map(|text| toml::from_str(text).unwrap());
    let catalogue = Catalogue::with_documents(&documents).unwrap();
    let nominal = f550();
    let set = |instance: EffectInstance| EffectSet::new(&catalogue, &[instance], &nominal, 1).unwrap();
    let rotors = Rotors::distinct(&nominal);
    let at = instant(&nominal, &rotors);
    for (id, mine, name, value) in [
        ("rotor-drag", "my-rotor-drag", ("drag_n_s_m", "drag_n_s_m"), 0.3),
        ("axial-inflow", "my-inflow", ("loss_n_s_m", "loss"), 0.1),
    ] {
        let mut built_in = set(EffectInstance::new(id, &[(name.0, value)]));
        let mut user = set(EffectInstance::new(mine, &[(name.1, value)]));
        let result = |set: &mut EffectSet| {
            set.begin(0.0);
            let (mut wrench, mut thrust) = (Wrench::default(), rotors.thrust);
            set.wrench(&at, &mut wrench);
            set.rotor_thrust(&at, &mut thrust);
            (nominal.closed(&wrench, [0.0; 3], [0.0; 3]), thrust)
        };
        let ((a, f), (b, g)) = (result(&mut built_in), result(&mut user));
        for i in 0..3 {
            assert!((a.force_body[i] - b.force_body[i]).abs() < 1e-12, "{id}");
        }
        for i in 0..6 {
            assert!((f[i] - g[i]).abs() < 1e-12, "{id}");
        }
    }
    let entry = catalogue.find("my-inflow").unwrap();
    assert_eq!(entry.channels, [ChannelGroup::Force, ChannelGroup::Moment]);
    assert!(std::ptr::eq(
        documents[0].declaration().unwrap(),
        documents[0].declaration().unwrap()
    ));
}

#[test]
fn val_refusals_name_line_key_and_column() {
    let cases = [
        (
            "-drag_n_s_m * mean_speed_ratio * air_velocity_x",
            "-drag_n_s_m * air_velocity_x * airspeed",
            "term[0].expression",
            "expected a value in N",
        ),
        (
            "-drag_n_s_m * mean_speed_ratio * air_velocity_x",
            "drag_n_s_m * air_velocity_x + 1[N]",
            "term[0].expression",
            "where every size is 0",
        ),
        (
            "-drag_n_s_m * mean_speed_ratio * air_velocity_x",
            "drag_n_s_m * air_velocity_q",
            "term[0].expression",
            "column 14",
        ),
        (
            "-drag_n_s_m * mean_speed_ratio * air_velocity_x",
            "drag_n_s_m * rotor_air_velocity_x",
            "term[0].expression",
            "from rotor to rotor",
        ),
        (
            "unit = \"N·s/m\"",
            "unit = \"N·ms/m\"",
            "parameter[0].unit",
            "without prefix",
        ),
        (
            "place = \"force_x\"",
            "place = \"force_q\"",
            "term[0].place",
            "expected one of",
        ),
        ("id = \"my-rotor-drag\"", "id = \"rotor-drag\"", "id", "built-in"),
        ("id = \"my-rotor-drag\"", "id = \"My Drag\"", "id", "small letters"),
        ("high = 0.5", "high = -0.5", "parameter[0].high", "above `low`"),
        ("low = 0.0", "low = 0.1", "parameter[0].typical", "contains 0"),
        (
            "name = \"drag_n_s_m\"",
            "name = \"thrust\"",
            "parameter[0].name",
            "taken already",
        ),
    ];
    for (from, to, key, part) in cases {
        assert!(DRAG.contains(from));
        let document: EffectDocument = toml::from_str(&DRAG.replacen(from, to, 1)).unwrap();
        let refusal = document.declaration().expect_err(to);
        assert_eq!(refusal.key, key, "{refusal}");
        assert!(refusal.reason.contains(part), "{refusal}");
    }
}

#[test]
fn val_the_unit_of_a_factor_is_that_of_its_place_over_its_expression() {
    assert_eq!(factor_unit("force_x", "air_velocity_x").unwrap(), "N·s/m");
    assert_eq!(factor_unit("torque_z", "yaw_rate * abs(yaw_rate)").unwrap(), "kg·m^2");
    assert_eq!(factor_unit("force_z", "thrust").unwrap(), "");
    assert!(factor_unit("force_x", "air_velocity").is_err() && factor_unit("here", "thrust").is_err());
}
