//! Presets: which cases test which claim.

use crate::catalogue::{KINDS, Kind, Place};
use crate::draw::{draw_effect, same_group};
use crate::hidden::{Hidden, Profile};
use crate::random::Stream;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Purpose of a set of cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema, clap::ValueEnum)]
#[schema(as = BlindPreset)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// One effect of the catalogue, excitation and waypoint flights
    Singles,
    /// The same with 2 % clutter on every other parameter
    Clutter,
    /// One effect on helix flights
    Helix,
    /// Nothing hidden, flights in motion
    Null,
    /// Nothing hidden, hover
    NullHover,
    /// Nothing hidden, hover with none to 0.4 of the usual disturbances: the duties answer to the noise of the readings
    NullStill,
    /// One effect at 0.3 of its size
    Small,
    /// Two effects that are not confusable with each other, excitation flights
    Pairs,
    /// One kind outside the catalogue
    Outside,
    /// A 5 % blade that breaks in mid-flight
    Onset,
    /// A bit of everything: none, one, two, outside
    Mixed,
    /// Damaged rotors of all kinds, judged by the detectors instead of diagnosed; alone
    Faults,
}

impl Preset {
    /// All of them.
    pub fn all() -> &'static [Self] {
        <Self as clap::ValueEnum>::value_variants()
    }

    /// As an argument has it, and a file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Singles => "singles",
            Self::Clutter => "clutter",
            Self::Helix => "helix",
            Self::Null => "null",
            Self::NullHover => "null-hover",
            Self::NullStill => "null-still",
            Self::Small => "small",
            Self::Pairs => "pairs",
            Self::Outside => "outside",
            Self::Onset => "onset",
            Self::Mixed => "mixed",
            Self::Faults => "faults",
        }
    }
}

/// One case: the request to the generator, and the answer that the score expects.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// From 0.
    pub index: usize,
    /// Preset that it belongs to.
    pub preset: Preset,
    /// Vehicle document.
    pub vehicle: String,
    /// Built-in flight.
    pub flight: String,
    /// Seed of the flight.
    pub seed: u64,
    /// Times the typical size.
    pub scale: f64,
    /// With clutter.
    pub clutter: bool,
    /// Factor on the generator's white force and torque.
    #[serde(default = "usual")]
    pub disturbance: f64,
    /// Hidden effects, a companion before the effect that needs it.
    pub effects: Vec<Hidden>,
}

fn usual() -> f64 {
    1.0
}

impl Case {
    /// Arguments of the generator for the effects.
    pub fn effect_arguments(&self) -> Vec<String> {
        self.effects
            .iter()
            .map(|effect| {
                let mut parts: Vec<String> = effect.rotor.iter().map(|rotor| format!("rotor={rotor}")).collect();
                parts.extend(effect.onset_s.iter().map(|onset| format!("onset_s={onset}")));
                parts.extend(effect.profile.iter().flat_map(Profile::arguments));
                // `{:?}` of an f64 is the shortest text that reads back to the same bits.
                parts.extend(
                    effect
                        .parameters
                        .iter()
                        .map(|(name, value)| format!("{name}={value:?}")),
                );
                format!("{}:{}", effect.id, parts.join(","))
            })
            .collect()
    }
}

/// Disturbances of hovers in still air, over the usual ones.
const STILL: [f64; 4] = [0.0, 0.05, 0.15, 0.4];

/// Kinds in a random order: every kind comes once before any comes twice.
fn shuffled(kinds: Vec<&'static Kind>, random: &mut Stream) -> Vec<&'static Kind> {
    let mut kinds = kinds;
    for i in (1..kinds.len()).rev() {
        kinds.swap(i, random.below(i + 1));
    }
    kinds
}

fn of_catalogue() -> Vec<&'static Kind> {
    KINDS.iter().filter(|kind| kind.place != Place::Outside).collect()
}

fn outside() -> Vec<&'static Kind> {
    KINDS.iter().filter(|kind| kind.place == Place::Outside).collect()
}

/// `n` cases of a preset. Case k depends on seed, preset and k alone, so a longer bench begins with the shorter one's cases.
pub fn draw_cases(preset: Preset, n: usize, seed: u64, vehicles: &[(String, usize)]) -> Vec<Case> {
    let catalogue = shuffled(of_catalogue(), &mut Stream::new(seed, "order"));
    let foreign = shuffled(outside(), &mut Stream::new(seed, "order-outside"));
    (0..n)
        .map(|index| {
            let mut random = Stream::new(seed, &format!("case-{preset:?}-{index}"));
            let (vehicle, rotors) = &vehicles[index % vehicles.len()];
            let preset_of_case = match preset {
                Preset::Mixed => [
                    Preset::Singles,
                    Preset::Null,
                    Preset::Pairs,
                    Preset::Singles,
                    Preset::Outside,
                ][index % 5],
                other => other,
            };
            let scale = if preset_of_case == Preset::Small { 0.3 } else { 1.0 };
            // Each kind meets each flight: the flight changes with every round through the kinds, too.
            let flight_of = |round: usize| ["excitation", "waypoint"][round % 2];
            let round = index / catalogue.len() + index % catalogue.len();
            let kind = catalogue[index % catalogue.len()];
            let (flight, effects) = match preset_of_case {
                Preset::Singles | Preset::Clutter | Preset::Small | Preset::Mixed => {
                    (flight_of(round), draw_effect(kind, scale, *rotors, &mut random))
                }
                Preset::Helix => ("helix", draw_effect(kind, scale, *rotors, &mut random)),
                Preset::Null => (["excitation", "waypoint", "helix"][index % 3], vec![]),
                Preset::NullHover | Preset::NullStill => ("hover", vec![]),
                Preset::Pairs => ("excitation", draw_pair(&catalogue, *rotors, &mut random)),
                Preset::Outside => {
                    let kind = foreign[index % foreign.len()];
                    (
                        flight_of(index / foreign.len() + index % foreign.len()),
                        draw_effect(kind, scale, *rotors, &mut random),
                    )
                }
                // Faults have cases of their own (`faults`); of a bench that is diagnosed they are an onset.
                Preset::Onset | Preset::Faults => (flight_of(index), draw_onset(*rotors, &mut random)),
            };
            Case {
                index,
                preset: preset_of_case,
                vehicle: vehicle.clone(),
                flight: flight.to_owned(),
                // Odd multiplier: distinct seeds for distinct cases.
                seed: seed.wrapping_mul(0x9e37_79b9).wrapping_add(index as u64 + 1) & 0xffff_ffff,
                scale,
                clutter: preset_of_case == Preset::Clutter,
                disturbance: if preset_of_case == Preset::NullStill {
                    STILL[index % STILL.len()]
                } else {
                    1.0
                },
                effects,
            }
        })
        .collect()
}

fn draw_pair(catalogue: &[&'static Kind], rotors: usize, random: &mut Stream) -> Vec<Hidden> {
    // Gross errors and kinds with a companion of their own would make three effects, or one.
    let pairable: Vec<&Kind> = catalogue
        .iter()
        .copied()
        .filter(|kind| kind.companion.is_none() && kind.number != 35)
        .collect();
    let first = pairable[random.below(pairable.len())];
    let second = loop {
        let second = pairable[random.below(pairable.len())];
        if !same_group(first.id, second.id) {
            break second;
        }
    };
    let mut effects = draw_effect(first, 1.0, rotors, random);
    effects.extend(draw_effect(second, 1.0, rotors, random));
    effects
}

fn draw_onset(rotors: usize, random: &mut Stream) -> Vec<Hidden> {
    let mut effect = Hidden {
        id: "rotor-thrust-scale".to_owned(),
        rotor: Some(1 + random.below(rotors)),
        onset_s: Some((random.between(20.0, 70.0) * 10.0).round() / 10.0),
        profile: None,
        parameters: Default::default(),
    };
    effect.parameters.insert("share".to_owned(), -0.05);
    vec![effect]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vehicles() -> Vec<(String, usize)> {
        vec![("f550.toml".to_owned(), 6)]
    }

    #[test]
    fn prop_a_longer_bench_begins_with_the_shorter_one() {
        for preset in [Preset::Singles, Preset::Pairs, Preset::Mixed] {
            let short = draw_cases(preset, 20, 3, &vehicles());
            let long = draw_cases(preset, 70, 3, &vehicles());
            assert_eq!(short, long[..20]);
            let mut seeds: Vec<u64> = long.iter().map(|case| case.seed).collect();
            seeds.sort_unstable();
            seeds.dedup();
            assert_eq!(seeds.len(), 70);
        }
    }

    #[test]
    fn val_a_preset_has_one_name() {
        use clap::ValueEnum as _;
        for preset in Preset::all() {
            assert_eq!(serde_json::to_value(preset).unwrap(), preset.name());
            assert!(preset.to_possible_value().unwrap().matches(preset.name(), false));
        }
    }

    #[test]
    fn prop_arguments_read_back_to_the_same_effects() {
        for case in draw_cases(Preset::Mixed, 120, 5, &vehicles()) {
            let read: Vec<Hidden> = case
                .effect_arguments()
                .iter()
                .map(|text| Hidden::parse(text).unwrap())
                .collect();
            assert_eq!(read, case.effects);
        }
    }

    #[test]
    fn prop_singles_reach_every_kind_on_both_flights() {
        let cases = draw_cases(Preset::Singles, 2 * of_catalogue().len(), 1, &vehicles());
        for kind in of_catalogue() {
            let flights: Vec<&str> = cases
                .iter()
                .filter(|case| case.effects.last().is_some_and(|effect| effect.id == kind.id))
                .map(|case| case.flight.as_str())
                .collect();
            assert_eq!(flights.len(), 2, "{}", kind.id);
            assert_ne!(flights[0], flights[1], "{}", kind.id);
        }
    }
}
