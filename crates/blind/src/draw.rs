//! Random draws: which effects, how large, with which clutter.

use crate::catalogue::{self, KINDS, Kind, Place};
use crate::hidden::Hidden;
use crate::random::Stream;

/// Clutter: standard deviation as a share of the typical size.
pub const CLUTTER: f64 = 0.02;

/// Kinds that are a structure, a noise class or a time, not a small deviation that every vehicle has.
const NO_CLUTTER: [&str; 23] = [
    "reversed-spin",
    "wind",
    "gusts",
    "vortex-ring",
    "ceiling-effect",
    "wall-effect",
    "slung-load",
    "frame-flex",
    "speed-domain-lag",
    "saturation",
    "cold-battery",
    "drag-centre",
    "drag-anisotropy",
    "yaw-damping",
    "arm-length",
    "mass-loss",
    "command-delay",
    "imu-latency",
    "attitude-latency",
    "velocity-latency",
    "position-latency",
    "swapped-rotors",
    "battery-rc",
];

/// Kinds that no flight of one vehicle can distinguish, or only a special flight: never drawn into one pair.
pub const GROUPS: [&[&str]; 10] = [
    &[
        "air-density",
        "mass",
        "mass-loss",
        "dead-zone",
        "voltage-gain",
        "voltage-offset",
        "esc-resistance",
        "thrust-curve-shape",
        "voltage-exponent",
        "saturation",
        "ground-effect",
    ],
    &[
        "rotor-drag",
        "linear-friction",
        "quadratic-drag",
        "wind",
        "gusts",
        "drag-centre",
        "threshold-drag",
        "drag-anisotropy",
        "translational-lift",
    ],
    &["inertia-yaw", "moment-ratio", "rotor-reaction"],
    &[
        "motor-time-constant",
        "lag-asymmetry",
        "speed-domain-lag",
        "command-delay",
        "imu-latency",
        "frame-flex",
        "attitude-latency",
    ],
    &[
        "accelerometer-bias",
        "level-offset",
        "imu-misalignment",
        "vibration-rectification",
        "accelerometer-scale",
    ],
    &["internal-resistance", "battery-rc", "cold-battery", "battery-capacity"],
    &["velocity-latency", "position-latency"],
    &["rotor-tilt-tangential", "rotor-tilt-radial", "rotor-moment-ratio"],
    &["heading-offset", "current-heading"],
    &["rotational-damping", "yaw-damping"],
];

/// Whether two kinds share a group.
pub fn same_group(a: &str, b: &str) -> bool {
    a == b || GROUPS.iter().any(|group| group.contains(&a) && group.contains(&b))
}

/// The effect of one kind, drawn: sizes 0.7 to 1.3 times typical, times `scale`; random sign where both are plausible. An effect
/// that does nothing alone comes with its companion, which is listed first.
pub fn draw_effect(kind: &Kind, scale: f64, rotors: usize, random: &mut Stream) -> Vec<Hidden> {
    let mut drawn = Vec::new();
    if let Some(companion) = kind.companion.and_then(catalogue::kind) {
        drawn.extend(draw_effect(companion, 1.0, rotors, random));
    }
    let rotor = kind.per_rotor.then(|| 1 + random.below(rotors));
    let mut effect = Hidden::typical(kind, rotor);
    for parameter in kind.parameters {
        let factor = random.between(0.7, 1.3);
        let sign = random.sign();
        if parameter.scales {
            let sign = if parameter.signed { sign } else { 1.0 };
            let value = parameter.typical * factor * sign * scale;
            effect.parameters.insert(parameter.name.to_owned(), value);
        }
    }
    if let (Some(rotor), "swapped-rotors") = (rotor, kind.id) {
        let partner = 1 + (rotor + random.below(rotors - 1)) % rotors;
        effect.parameters.insert("partner".to_owned(), partner as f64);
    }
    drawn.push(effect);
    drawn
}

/// A small deviation of every parameter of the catalogue that is not among `hidden`: normal, [`CLUTTER`] of the typical size.
pub fn draw_clutter(hidden: &[Hidden], rotors: usize, random: &mut Stream) -> Vec<Hidden> {
    let mut clutter = Vec::new();
    for kind in KINDS.iter().filter(|kind| kind.place != Place::Outside) {
        if NO_CLUTTER.contains(&kind.id) || hidden.iter().any(|effect| effect.id == kind.id && !kind.per_rotor) {
            continue;
        }
        let rotor_list: Vec<Option<usize>> = if kind.per_rotor {
            (1..=rotors).map(Some).collect()
        } else {
            vec![None]
        };
        for rotor in rotor_list {
            let mut effect = Hidden::typical(kind, rotor);
            for parameter in kind.parameters {
                let value = CLUTTER * parameter.typical * random.normal();
                effect.parameters.insert(parameter.name.to_owned(), value);
            }
            if !hidden.iter().any(|h| h.id == effect.id && h.rotor == rotor) {
                clutter.push(effect);
            }
        }
    }
    clutter
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_names_in_the_tables_exist() {
        for id in NO_CLUTTER.iter().chain(GROUPS.iter().copied().flatten()) {
            assert!(catalogue::kind(id).is_some(), "{id}");
        }
        for companion in KINDS.iter().filter_map(|kind| kind.companion) {
            assert!(catalogue::kind(companion).is_some(), "{companion}");
        }
    }

    #[test]
    fn prop_draws_repeat_and_stay_in_range() {
        for kind in KINDS {
            let draw = |seed| draw_effect(kind, 1.0, 6, &mut Stream::new(seed, "draw"));
            assert_eq!(draw(3), draw(3));
            let effects = draw(3);
            let effect = effects.last().unwrap();
            assert!(effect.check(6).is_ok());
            for parameter in kind.parameters.iter().filter(|p| p.scales) {
                let ratio = effect.parameters[parameter.name] / parameter.typical;
                assert!((0.7..=1.3).contains(&ratio.abs()), "{} {ratio}", kind.id);
            }
        }
    }
}
