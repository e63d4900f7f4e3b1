//! Rules that every entry of the catalogue keeps.

use super::*;

/// A small size is this share of the typical one.
const SMALL: f64 = 0.01;
/// Largest departure from proportionality between a small size and its double, relative. Second-order terms of a response that
/// doubles within the typical size are of this order.
const LINEARITY: f64 = 0.05;

/// A hook that changes one number per rotor.
type Call<T> = fn(&mut T, &Moment<'_>, &mut [f64]);

fn sizes(declaration: &EffectDeclaration) -> impl Iterator<Item = usize> {
    (0..declaration.parameters.len()).filter(|&i| declaration.parameters[i].kind == ParameterKind::Size)
}

#[test]
fn val_every_id_and_parameter_stands_once() {
    for (i, entry) in catalogue().iter().enumerate() {
        let id = entry.id;
        assert!(catalogue()[..i].iter().all(|other| other.id != id), "{id} stands twice");
        assert!(!entry.channels.is_empty() && !entry.places.is_empty(), "{id}");
        assert!(sizes(entry).count() > 0, "{id}");
        for other in entry.confused_with.iter().chain(entry.needs) {
            assert!(catalogue().iter().any(|e| e.id == *other), "{id} names {other}");
        }
        for (k, parameter) in entry.parameters.iter().enumerate() {
            let name = format!("{id}.{}", parameter.name);
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
            assert!(parameter.size > 0.0 && parameter.clutter < parameter.size, "{name}");
            if parameter.kind == ParameterKind::Size {
                assert!(
                    parameter.clutter > 0.0 && plausible.contains(&0.0),
                    "{name}: neutral is 0"
                );
            }
        }
    }
}

#[test]
fn val_every_row_of_the_catalogue_has_an_entry() {
    for row in 1..=62 {
        assert!(catalogue().iter().any(|e| e.catalogue_number == Some(row)), "row {row}");
    }
    let rows: Vec<_> = catalogue().iter().map(|e| e.catalogue_number).collect();
    assert!(rows.is_sorted(), "entries stand in the order of the rows");
}

#[test]
fn prop_sizes_of_zero_change_nothing_bit_for_bit() {
    let nominal = f550();
    #[derive(Debug, Clone)]
    struct Nothing;
    impl ActiveEffect for Nothing {
        fn hooks(&self) -> Hooks {
            Hooks::NONE
        }
        fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
            Box::new(self.clone())
        }
    }
    let without = response(&mut (Box::new(Nothing) as Box<dyn ActiveEffect>));
    for entry in catalogue() {
        let with = response(&mut build(entry, &values(entry, &[]), &nominal));
        for (i, (a, b)) in with.iter().zip(&without).enumerate() {
            // The time constant of a pair of resistance 0 has no effect.
            let shape_only = entry.id == "battery-rc" && *b == nominal.rc_time_s;
            assert!(
                a.to_bits() == b.to_bits() || shape_only,
                "{}: number {i}: {a} is not {b}",
                entry.id
            );
        }
    }
}

#[test]
fn prop_response_is_continuous_and_proportional_for_small_sizes() {
    let nominal = f550();
    for entry in catalogue() {
        for index in sizes(entry) {
            let parameter = &entry.parameters[index];
            let small = SMALL * parameter.typical;
            let at = |value: f64| response(&mut build(entry, &values(entry, &[(index, value)]), &nominal));
            let (zero, one, two) = (at(0.0), at(small), at(2.0 * small));
            let scale = |x: &[f64]| x.iter().zip(&zero).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
            assert!(scale(&one) > 0.0, "{}.{} changes nothing", entry.id, parameter.name);
            let bend: f64 = (0..zero.len())
                .map(|i| (two[i] - 2.0 * one[i] + zero[i]).powi(2))
                .sum::<f64>()
                .sqrt();
            assert!(
                bend <= LINEARITY * scale(&two),
                "{}.{}: departs by {} of {}",
                entry.id,
                parameter.name,
                bend,
                scale(&two)
            );
        }
    }
}

#[test]
fn val_hooks_not_announced_are_not_used() {
    // An effect that changes something through a hook that it does not announce would be silently without effect in the callers.
    let nominal = f550();
    for entry in catalogue() {
        let set: Vec<_> = sizes(entry).map(|i| (i, entry.parameters[i].typical)).collect();
        let all = values(entry, &set);
        let mut raw = build(entry, &all, &nominal);
        let mut announced = EffectSet::from_effects(vec![build(entry, &all, &nominal)], &nominal).unwrap();
        let rotors = Rotors::distinct(&nominal);
        for _ in 0..3 {
            announced.begin(0.0);
            let mut constants = nominal;
            raw.constants(&mut constants);
            assert_eq!(&constants, announced.constants(), "{}", entry.id);
            let at = instant(&constants, &rotors);
            let (mut a, mut b) = ([0.0; 3], [0.0; 3]);
            raw.wind(&at, &mut a);
            announced.wind(&at, &mut b);
            assert_eq!(a, b, "{}", entry.id);
            let calls: [Call<Box<dyn ActiveEffect>>; 3] = [
                |e, at, x| e.command(at, x),
                |e, at, x| e.static_lift(at, x),
                |e, at, x| e.rotor_thrust(at, x),
            ];
            let same: [Call<EffectSet>; 3] = [
                |e, at, x| e.command(at, x),
                |e, at, x| e.static_lift(at, x),
                |e, at, x| e.rotor_thrust(at, x),
            ];
            for (call, same) in calls.iter().zip(&same) {
                let (mut a, mut b) = (rotors.duty, rotors.duty);
                call(&mut raw, &at, &mut a);
                same(&mut announced, &at, &mut b);
                assert_eq!(a, b, "{}", entry.id);
            }
            let (mut a, mut b) = (Wrench::default(), Wrench::default());
            raw.wrench(&at, &mut a);
            announced.wrench(&at, &mut b);
            assert_eq!(a, b, "{}", entry.id);
            let (mut a, mut b) = (Readings::default(), Readings::default());
            raw.readings(&at, &mut a);
            announced.readings(&at, &mut b);
            assert_eq!(a, b, "{}", entry.id);
            raw.advance(&at, 0.0025);
            announced.advance(&at, 0.0025);
        }
    }
}
