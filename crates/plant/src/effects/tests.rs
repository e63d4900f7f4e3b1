//! Rules that every entry of the catalogue keeps.

use super::*;

#[test]
fn val_every_id_and_parameter_stands_once() {
    for (i, entry) in catalogue().iter().enumerate() {
        assert!(
            catalogue()[..i].iter().all(|other| other.id != entry.id),
            "{} stands twice",
            entry.id
        );
        assert!(
            !entry.parameters.is_empty() && !entry.channels.is_empty() && !entry.places.is_empty(),
            "{}",
            entry.id
        );
        for (k, parameter) in entry.parameters.iter().enumerate() {
            let name = format!("{}.{}", entry.id, parameter.name);
            assert!(
                entry.parameters[..k].iter().all(|other| other.name != parameter.name),
                "{name} stands twice"
            );
            assert!(parameter.plausible_low < parameter.plausible_high, "{name}");
            let plausible = parameter.plausible_low..=parameter.plausible_high;
            assert!(
                plausible.contains(&parameter.typical) && parameter.typical != 0.0,
                "{name}"
            );
            assert!(
                parameter.size > 0.0 && parameter.clutter >= 0.0 && parameter.clutter < parameter.size,
                "{name}"
            );
            if parameter.kind == ParameterKind::Size {
                assert!(
                    parameter.clutter > 0.0 && plausible.contains(&0.0),
                    "{name}: neutral is 0"
                );
            }
        }
    }
}
