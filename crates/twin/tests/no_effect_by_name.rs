//! The engine knows strategies and requirements, but no effect: an effect declares in its own file how it is searched for.
//!
//! Checks the string literals of the sources, without comments and unit tests.

use std::path::{Path, PathBuf};

use rotortwin_plant::effects::catalogue;

/// The modules that fit, rank, name and keep effects. A vehicle from a log (`identify`) uses the word mass, not the effect.
const ENGINE: [&str; 9] = [
    "baseline",
    "compare",
    "diagnose",
    "estimation",
    "improve",
    "model",
    "next_flight",
    "predict",
    "propose",
];

/// Names of constants of a vehicle, in the module `model`, that are called like an effect.
const CONSTANTS: [&str; 1] = ["mass"];

/// Modules that read scenarios: what an effect needs or acts on is also in its declaration.
const SCENARIOS: [&str; 1] = ["../../scenario/src"];

/// Keys of a scenario that are called like an effect.
const KEYS: [&str; 2] = ["wind", "mass"];

/// Columns of a log and keys of results that are called like a parameter of an effect.
const OTHER_THINGS: [&str; 1] = ["time_s"];

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry of a folder").path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|end| end == "rs") && path.file_name().is_some_and(|n| n != "tests.rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Line number and text of every string literal that is not of a comment or of unit tests.
fn literals(source: &str) -> Vec<(usize, String)> {
    let code = source.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    let mut found = Vec::new();
    for (number, line) in code.lines().enumerate() {
        if line.trim_start().starts_with("//") {
            continue;
        }
        let parts = line.split('"').skip(1).step_by(2);
        found.extend(parts.map(|text| (number + 1, text.to_owned())));
    }
    found
}

/// The literals of the sources below `rooms` for which `is` holds, as `file:line: text`.
fn named(rooms: &[&str], is: impl Fn(&str) -> bool) -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let files = rooms.iter().flat_map(|room| sources(&root.join(room)));
    let mut all = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(&file).expect("a source");
        for (line, literal) in literals(&text) {
            if is(&literal) {
                all.push(format!("{}:{line}: {literal}", file.display()));
            }
        }
    }
    all
}

/// Also with a rotor: rotor-thrust-scale#3.
fn is_an_effect(text: &str) -> bool {
    let id = text.split('#').next().unwrap_or_default();
    catalogue().iter().any(|entry| entry.id == id)
}

#[test]
fn val_the_engine_names_no_effect() {
    let without_constants: Vec<&str> = ENGINE.into_iter().filter(|room| *room != "model").collect();
    assert_eq!(named(&without_constants, is_an_effect), Vec::<String>::new());
    let is = |text: &str| is_an_effect(text) && !CONSTANTS.contains(&text);
    assert_eq!(named(&["model"], is), Vec::<String>::new());
}

#[test]
fn val_who_reads_scenarios_names_no_effect() {
    let is = |text: &str| is_an_effect(text) && !KEYS.contains(&text);
    assert_eq!(named(&SCENARIOS, is), Vec::<String>::new());
}

#[test]
fn val_the_engine_names_no_parameter_of_an_effect() {
    let is = |text: &str| {
        let mut parameters = catalogue().iter().flat_map(|entry| entry.parameters);
        parameters.any(|p| p.name == text) && !OTHER_THINGS.contains(&text)
    };
    assert_eq!(named(&ENGINE, is), Vec::<String>::new());
}

#[test]
fn val_the_engine_asks_for_no_row_of_the_catalogue() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for file in ENGINE.iter().flat_map(|room| sources(&root.join(room))) {
        let text = std::fs::read_to_string(&file).expect("a source");
        // Whether it has one at all only shows that it is not a user's effect.
        let asks = text
            .replace("catalogue_number.is_some()", "")
            .contains("catalogue_number");
        assert!(!asks, "{}", file.display());
        // All the places where an effect acts are a name in disguise.
        assert!(!text.contains(".places =="), "{}", file.display());
    }
}

/// A wind of each flight's own takes the place of exactly one effect.
#[test]
fn val_one_effect_is_the_steady_wind() {
    let declared = catalogue().iter().filter(|entry| entry.search.is_steady_wind);
    assert_eq!(declared.map(|entry| entry.id).collect::<Vec<_>>(), ["wind"]);
}

#[test]
fn val_literals_are_found() {
    let source = "// \"mass\"\nlet a = [\"mass\", \"x\"];\n#[cfg(test)]\nmod tests { \"mass\" }\n";
    assert_eq!(literals(source), [(2, "mass".to_owned()), (2, "x".to_owned())]);
}
