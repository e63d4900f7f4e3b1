//! Untrusted scenarios: whole documents, texts, and settings, up to the start of the flight; then some steps of it.
//!
//! The first byte says what the rest is: a text of documents, instructions that change values of shipped documents, the
//! text of a scenario, or settings. Paths in a text are replaced: keeping them inside the library is checked by the
//! server.

#![no_main]

use libfuzzer_sys::fuzz_target;
use rotortwin_flight_core::{MAX_ROTORS, signals::MotorCommand};
use rotortwin_scenario::{Documents, Scenario};
use std::path::Path;
use std::sync::LazyLock;
use toml::Value;

static LIBRARY: LazyLock<&Path> =
    LazyLock::new(|| Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/scenarios")));

/// All documents of each shipped scenario.
static SHIPPED: LazyLock<Vec<toml::Table>> = LazyLock::new(|| {
    let mut paths: Vec<_> = std::fs::read_dir(*LIBRARY)
        .expect("it is there")
        .map(|entry| entry.expect("it is read").path())
        .collect();
    paths.sort();
    let load = |path| {
        Scenario::load(path)
            .expect("shipped scenarios can be flown")
            .documents()
            .to_toml()
    };
    paths
        .into_iter()
        .map(|path| toml::from_str(&load(path)).expect("documents are TOML"))
        .collect()
});

/// Values where things break.
const EDGES: [f64; 16] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-12,
    1e12,
    f64::MAX,
    f64::MIN,
    f64::MIN_POSITIVE,
    f64::INFINITY,
    f64::NAN,
    0.5,
    2.0,
    1e-300,
    3.6e6,
    -1e9,
];

/// Shipped documents, changed: an instruction is place (2 bytes), deed (1), value (2).
fn changed(bytes: &[u8]) -> Option<String> {
    let (&which, instructions) = bytes.split_first()?;
    let mut documents = SHIPPED[usize::from(which) % SHIPPED.len()].clone();
    for one in instructions.chunks_exact(5).take(8) {
        let place = usize::from(u16::from_le_bytes([one[0], one[1]]));
        let mut leaves = 0;
        count(&documents, &mut leaves);
        let mut left = place % leaves.max(1);
        change(&mut documents, &mut left, one[2], i16::from_le_bytes([one[3], one[4]]));
    }
    toml::to_string(&documents).ok()
}

fn count(table: &toml::Table, leaves: &mut usize) {
    for value in table.values() {
        *leaves += 1;
        match value {
            Value::Table(inner) => count(inner, leaves),
            Value::Array(items) => items
                .iter()
                .filter_map(Value::as_table)
                .for_each(|inner| count(inner, leaves)),
            _ => {}
        }
    }
}

/// Changes the leaf that is reached after `left` others; true once it was.
fn change(table: &mut toml::Table, left: &mut usize, deed: u8, number: i16) -> bool {
    let keys: Vec<String> = table.keys().cloned().collect();
    for key in keys {
        if *left == 0 {
            match (deed % 8, table.get_mut(&key)) {
                (0, _) => drop(table.remove(&key)),
                (1, Some(Value::Array(items))) if !items.is_empty() => {
                    let again = items[number.unsigned_abs() as usize % items.len()].clone();
                    items.push(again);
                }
                (2, Some(Value::Array(items))) => drop(items.pop()),
                (3, Some(Value::Float(value))) => *value *= f64::from(number) / 100.0,
                (4, Some(Value::Integer(value))) => *value = i64::from(number),
                (5, Some(Value::Integer(value))) => {
                    *value = [0, 1, -1, i64::MAX, i64::MIN, 1 << 40][number.unsigned_abs() as usize % 6]
                }
                (6, Some(Value::Array(items))) if !items.is_empty() => {
                    let at = number.unsigned_abs() as usize % items.len();
                    if items[at].is_float() {
                        items[at] = Value::Float(EDGES[(number.unsigned_abs() >> 8) as usize % 16]);
                    }
                }
                (_, Some(Value::Float(value))) => *value = EDGES[number.unsigned_abs() as usize % 16],
                _ => {}
            }
            return true;
        }
        *left -= 1;
        let done = match table.get_mut(&key) {
            Some(Value::Table(inner)) => change(inner, left, deed, number),
            Some(Value::Array(items)) => items
                .iter_mut()
                .filter_map(Value::as_table_mut)
                .any(|inner| change(inner, left, deed, number)),
            _ => false,
        };
        if done {
            return true;
        }
    }
    false
}

fuzz_target!(|data: &[u8]| {
    let Some((&which, bytes)) = data.split_first() else {
        return;
    };
    let changed = if which & 3 == 1 { changed(bytes) } else { None };
    let Ok(text) = changed.as_deref().map_or_else(|| std::str::from_utf8(bytes), Ok) else {
        return;
    };
    let scenario = match which & 3 {
        0 | 1 => Documents::from_toml("documents", text).and_then(|documents| Scenario::from_documents(&documents)),
        2 => {
            let Ok(mut table) = toml::from_str::<toml::Table>(text) else {
                drop(Scenario::parse(
                    &text
                        .replace("vehicle", "x")
                        .replace("network", "x")
                        .replace("effect_files", "x"),
                    *LIBRARY,
                ));
                return;
            };
            table.insert("vehicle".to_owned(), "../vehicles/f550.toml".into());
            table.remove("effect_files");
            table.remove("fdi");
            Scenario::parse(&table.to_string(), *LIBRARY)
        }
        _ => {
            let set: Vec<&str> = text.lines().take(8).collect();
            if set.iter().any(|line| {
                ["vehicle", "fdi", "effect_files", "\"", "'"]
                    .iter()
                    .any(|word| line.contains(word))
            }) {
                return;
            }
            Scenario::load_with(LIBRARY.join("short-hover.toml"), &set)
        }
    };
    let Ok(scenario) = scenario else { return };
    // What was accepted is accepted again as the server keeps it, and is the same.
    let kept = scenario.documents().to_toml();
    let again = Documents::from_toml("kept", &kept).expect("what was accepted can be read");
    let again = Scenario::from_documents(&again).expect("what was accepted is accepted again");
    assert_eq!(again.documents().to_toml(), kept);
    drop(scenario.warnings());
    let Ok(mut simulation) = scenario.simulation(scenario.seed()) else {
        return;
    };
    let duty = simulation.hover_duty();
    for _ in 0..40 {
        let _ = simulation.sense();
        if simulation.done()
            || simulation
                .advance(&MotorCommand {
                    duty: [duty; MAX_ROTORS],
                })
                .is_err()
        {
            return;
        }
    }
});
