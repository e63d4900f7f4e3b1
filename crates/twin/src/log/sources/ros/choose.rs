//! Which of several topics of one type, and of which vehicle.

use super::super::{Asked, RawStream};
use crate::log::resample::usual_rate_hz;
use std::collections::{BTreeMap, BTreeSet};

/// A topic that spans less of the recording than this share of the longest of its type comes after those that span it.
const COVERS: f64 = 0.9;
/// Rates that differ by less are alike.
const ALIKE: f64 = 1.1;

fn span_s(stream: &RawStream) -> f64 {
    match stream.time_s.as_slice() {
        [first, .., last] => last - first,
        _ => 0.0,
    }
}

fn rate_hz(stream: &RawStream) -> f64 {
    usual_rate_hz(&stream.time_s)
}

/// First part of a topic's name, and the rest: `/drone1/odom` is `drone1` and `odom`.
fn vehicle_of(name: &str) -> Option<(&str, &str)> {
    name.trim_start_matches('/').split_once('/')
}

/// Vehicles: first parts under which the same topics of the same types stand.
fn vehicles(streams: &[RawStream]) -> BTreeSet<String> {
    let mut places: BTreeMap<(&str, &str), BTreeSet<&str>> = BTreeMap::new();
    for stream in streams {
        if let Some((vehicle, rest)) = vehicle_of(&stream.name) {
            places.entry((rest, &stream.kind)).or_default().insert(vehicle);
        }
    }
    let several = places.into_values().filter(|vehicles| vehicles.len() > 1);
    several.flatten().map(str::to_owned).collect()
}

/// Leaves one vehicle, and puts the best topic of each type first (instance 0).
pub(super) fn choose(streams: &mut Vec<RawStream>, asked: &Asked<'_>, notes: &mut Vec<String>) {
    let preferred = |name: &str| asked.topics.iter().any(|start| name.starts_with(start.as_str()));
    let vehicles = vehicles(streams);
    if vehicles.len() > 1 {
        let of = |vehicle: &str| -> Vec<&RawStream> {
            let mine = |stream: &&RawStream| vehicle_of(&stream.name).is_some_and(|(first, _)| first == vehicle);
            streams.iter().filter(mine).collect()
        };
        let weight = |vehicle: &&String| {
            let mine = of(vehicle);
            let wished = mine.iter().any(|stream| preferred(&stream.name));
            (wished, mine.iter().map(|stream| stream.time_s.len()).sum::<usize>())
        };
        // Of equal ones the first by name.
        if let Some(taken) = vehicles.iter().rev().max_by_key(weight).cloned() {
            let others: Vec<String> = vehicles
                .iter()
                .filter(|other| **other != taken)
                .map(|other| format!("/{other}"))
                .collect();
            streams.retain(|stream| {
                vehicle_of(&stream.name).is_none_or(|(first, _)| first == taken || !vehicles.contains(first))
            });
            notes.push(format!(
                "several vehicles: /{taken} is taken, {} left out (topics = [\"{}/\"] in a mapping takes that one)",
                others.join(", "),
                others[0]
            ));
        }
    }
    let mut kinds: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (index, stream) in streams.iter().enumerate() {
        kinds.entry(stream.kind.clone()).or_default().push(index);
    }
    for (kind, mut places) in kinds {
        if places.len() < 2 {
            continue;
        }
        let longest = places.iter().map(|place| span_s(&streams[*place])).fold(0.0, f64::max);
        let fastest = |streams: &[RawStream], places: &[usize]| {
            let covering = places
                .iter()
                .filter(|place| span_s(&streams[**place]) >= COVERS * longest);
            covering.map(|place| rate_hz(&streams[*place])).fold(0.0, f64::max)
        };
        let most_hz = fastest(streams, &places);
        // A camera's own inertial unit has the camera's axes.
        let of_a_camera = |name: &str| {
            ["camera", "optical", "realsense"]
                .iter()
                .any(|word| name.contains(word))
        };
        places.sort_by(|a, b| {
            let rank = |place: usize| {
                let stream = &streams[place];
                let slow = span_s(stream) < COVERS * longest || ALIKE * rate_hz(stream) < most_hz;
                (
                    !preferred(&stream.name),
                    of_a_camera(&stream.name),
                    slow,
                    stream.name.clone(),
                )
            };
            rank(*a).cmp(&rank(*b))
        });
        let tell = |place: &usize| format!("{} ({:.0} Hz)", streams[*place].name, rate_hz(&streams[*place]));
        let others: Vec<String> = places[1..].iter().map(tell).collect();
        notes.push(format!(
            "{} topics of type {kind}: {} is taken, not {} (topics = [\"{}\"] in a mapping puts another first)",
            places.len(),
            tell(&places[0]),
            others.join(", "),
            streams[places[1]].name
        ));
        for (instance, place) in places.into_iter().enumerate() {
            streams[place].instance = u16::try_from(instance).unwrap_or(u16::MAX);
        }
    }
}
