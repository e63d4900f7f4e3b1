//! Scenarios from strangers: whole documents, texts, and settings, until the flight could begin; then a few steps of it.
//!
//! The first byte says what the rest is. A text's paths are replaced: that they stay in the library is the server's check.

#![no_main]

use libfuzzer_sys::fuzz_target;
use rotortwin_plant::{Documents, Scenario, Simulation};
use std::path::Path;
use std::sync::LazyLock;

static LIBRARY: LazyLock<&Path> = LazyLock::new(|| Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/scenarios")));

fuzz_target!(|data: &[u8]| {
    let Some((&which, bytes)) = data.split_first() else { return };
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let scenario = match which & 3 {
        0 | 1 => Documents::from_toml("documents", text).and_then(|documents| Scenario::from_documents(&documents)),
        2 => {
            let Ok(mut table) = toml::from_str::<toml::Table>(text) else {
                drop(Scenario::parse(&text.replace("vehicle", "x").replace("network", "x").replace("effect_files", "x"), *LIBRARY));
                return;
            };
            table.insert("vehicle".to_owned(), "../vehicles/f550.toml".into());
            table.remove("effect_files");
            table.remove("fdi");
            Scenario::parse(&table.to_string(), *LIBRARY)
        }
        _ => {
            let set: Vec<&str> = text.lines().take(8).collect();
            if set.iter().any(|line| ["vehicle", "fdi", "effect_files", "\"", "'"].iter().any(|word| line.contains(word))) {
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
    drop(Simulation::new(&scenario, scenario.seed()));
});
