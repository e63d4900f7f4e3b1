//! `rotortwin list`, `new` and `config`: documents by name, including the user's own.

use crate::output;
use clap::{Parser, ValueEnum};
use rotortwin_runner::grid::Grid;
use rotortwin_scenario::names::{self, Kind, Named};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// A folder of the configuration, as a word of `rotortwin list`.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Folder {
    Scenarios,
    Vehicles,
    Blades,
    Effects,
    Campaigns,
    #[value(alias = "mappings", alias = "mapping", alias = "log-mapping")]
    LogMappings,
    Classifiers,
}

impl Folder {
    const fn kind(self) -> Kind {
        match self {
            Self::Scenarios => Kind::Scenario,
            Self::Vehicles => Kind::Vehicle,
            Self::Blades => Kind::Blades,
            Self::Effects => Kind::Effect,
            Self::Campaigns => Kind::Campaign,
            Self::LogMappings => Kind::LogMapping,
            Self::Classifiers => Kind::Classifier,
        }
    }
}

/// What one can write oneself: classifiers come from `rotortwin train`.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Written {
    Scenario,
    Vehicle,
    Blades,
    Effect,
    Campaign,
    #[value(alias = "mapping")]
    LogMapping,
}

impl Written {
    const fn kind(self) -> Kind {
        match self {
            Self::Scenario => Kind::Scenario,
            Self::Vehicle => Kind::Vehicle,
            Self::Blades => Kind::Blades,
            Self::Effect => Kind::Effect,
            Self::Campaign => Kind::Campaign,
            Self::LogMapping => Kind::LogMapping,
        }
    }
}

/// Arguments of `rotortwin list`.
#[derive(Debug, Parser)]
pub struct ListArgs {
    /// What to list [default: all]
    #[arg(value_enum)]
    folder: Option<Folder>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Arguments of `rotortwin new`.
#[derive(Debug, Parser)]
pub struct NewArgs {
    /// Kind of document
    #[arg(value_enum)]
    kind: Written,
    /// Name of the document; it is written to NAME.toml in the current folder
    name: String,
    /// Document to copy: a name or a file
    #[arg(long, value_name = "NAME")]
    from: String,
}

/// Lists the available documents.
pub(crate) fn list(args: &ListArgs) -> ExitCode {
    let kinds = args
        .folder
        .map_or_else(|| Kind::ALL.to_vec(), |folder| vec![folder.kind()]);
    let mut found = Vec::new();
    for kind in kinds {
        match names::list(kind) {
            Ok(named) => found.push((kind, named)),
            Err(error) => return output::failed(error),
        }
    }
    if args.json {
        let entry = |kind: Kind, named: &Named| {
            serde_json::json!({
                "kind": kind.folder(), "name": named.name, "description": description(&named.path),
                "path": named.path, "shipped": named.shipped,
            })
        };
        let entries: Vec<_> = found
            .iter()
            .flat_map(|(kind, list)| list.iter().map(|named| entry(*kind, named)))
            .collect();
        println!("{}", serde_json::to_string_pretty(&entries).expect("text is JSON"));
        return ExitCode::SUCCESS;
    }
    let mut table = Grid::new(["Kind", "Name", "What it is"]);
    for (kind, list) in &found {
        for named in list {
            let mut text = description(&named.path);
            if !named.shipped {
                text = format!("{text} ({})", named.path.display());
            }
            table.add_row([kind.folder().to_owned(), named.name.clone(), text]);
        }
    }
    print!("{table}");
    ExitCode::SUCCESS
}

/// Description of a document: its `description` key, otherwise its first comment.
fn description(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let described = toml::from_str::<toml::Table>(&text)
        .ok()
        .and_then(|table| Some(table.get("description")?.as_str()?.to_owned()));
    let comment = || {
        text.lines()
            .next()
            .and_then(|line| line.strip_prefix("# "))
            .map(str::to_owned)
    };
    described.or_else(comment).unwrap_or_default()
}

/// Copies a document under a new name; relative paths in it are replaced by names.
pub(crate) fn new(args: &NewArgs) -> ExitCode {
    let kind = args.kind.kind();
    if !names::is_name(&args.name) {
        return output::bad_input(format!(
            "{}: expected a name, without folder, dot and ending; the file is NAME.toml in this folder",
            args.name
        ));
    }
    // As of a scenario; no document has one that a command would have to quote.
    if !names::is_plain(&args.name) {
        return output::bad_input(format!(
            "{:?}: expected a name of 1 to {} letters, digits, '-' and '_' that begins with a letter or digit",
            args.name,
            names::LONGEST
        ));
    }
    let from = if names::is_name(&args.from) {
        match names::find(kind, &args.from) {
            Ok(path) => path,
            Err(error) => return output::bad_input(error),
        }
    } else {
        PathBuf::from(&args.from)
    };
    let text = match std::fs::read_to_string(&from) {
        Ok(text) => text,
        Err(error) => return output::bad_input(format!("{}: cannot be read: {error}", from.display())),
    };
    // Vehicles are the documents with a body.
    let is_vehicle = text
        .parse::<toml::Table>()
        .is_ok_and(|table| table.contains_key("body"));
    if is_vehicle != (kind == Kind::Vehicle) {
        let (found, expected) = if is_vehicle {
            ("a vehicle", "another document")
        } else {
            ("no vehicle", "one")
        };
        return output::bad_input(format!("{} is {found}; expected {expected}", from.display()));
    }
    let path = PathBuf::from(format!("{}.toml", args.name));
    let mut file = match std::fs::File::create_new(&path) {
        Ok(file) => file,
        Err(error) => return output::bad_input(format!("{}: cannot be written: {error}", path.display())),
    };
    if let Err(error) = file.write_all(renamed(&text, &args.name).as_bytes()) {
        // Half a document would be in the way of the next attempt.
        let left = std::fs::remove_file(&path)
            .err()
            .map_or("", |_| "; a part of it is left, remove it");
        return output::failed(format!("{}: cannot be written: {error}{left}", path.display()));
    }
    output::say(format!("{} is a copy of {}", path.display(), from.display()));
    let next = match kind {
        Kind::Scenario => format!("rotortwin fly {}", path.display()),
        Kind::Vehicle => format!("rotortwin fly hover --model {}", path.display()),
        Kind::Campaign => format!("rotortwin campaign {}", path.display()),
        Kind::Effect => format!("rotortwin effects --effects {}", path.display()),
        _ => return ExitCode::SUCCESS,
    };
    println!("Next: {next}");
    ExitCode::SUCCESS
}

/// The text with a new name, and with names instead of paths to sibling folders.
fn renamed(text: &str, name: &str) -> String {
    let mut named = false;
    let mut lines = Vec::new();
    for line in text.lines() {
        let is_name = !named && line.starts_with("name = \"");
        named |= is_name || line.starts_with('[');
        lines.push(if is_name {
            format!("name = \"{name}\"")
        } else {
            Kind::ALL
                .iter()
                .fold(line.to_owned(), |line, kind| by_name(&line, *kind))
        });
    }
    lines.join("\n") + "\n"
}

/// `"../vehicles/f550.toml"` becomes `"f550"`, if such a name exists.
fn by_name(line: &str, kind: Kind) -> String {
    let begin = format!("\"../{}/", kind.folder());
    let end = format!(".{}\"", kind.extension());
    let Some((before, rest)) = line.split_once(&begin) else {
        return line.to_owned();
    };
    let Some((name, after)) = rest.split_once(&end) else {
        return line.to_owned();
    };
    if names::find(kind, name).is_err() {
        return line.to_owned();
    }
    let after = after.replace("relative to this file", "a name, or a path relative to this file");
    format!("{before}\"{name}\"{}", by_name(&after, kind))
}

/// Prints the search path of documents.
pub(crate) fn config() -> ExitCode {
    for folder in names::search_path() {
        let there = if folder.is_dir() { "" } else { "  (not there)" };
        println!("{}{there}", folder.display());
    }
    match rotortwin_scenario::shipped::folder() {
        Ok(folder) => println!("{}  (the program's own)", folder.display()),
        Err(error) => return output::failed(error),
    }
    println!(
        "{}",
        output::fitted(&format!(
            "The first folder that has a name wins. {} holds more folders, separated as in PATH.",
            names::SEARCH_PATH_VARIABLE
        ))
    );
    ExitCode::SUCCESS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_copy_names_what_the_original_found_beside_it() {
        let text = "# A comment\nname = \"hover\"\nvehicle = \"../vehicles/f550.toml\" # relative to this file\n\
                    network = \"../classifiers/f550-paper.json\"\n[[fault]]\nname = \"other\"\npath = \"../vehicles/no-such.toml\"\n";
        let expected = "# A comment\nname = \"mine\"\nvehicle = \"f550\" # a name, or a path relative to this file\n\
                        network = \"f550-paper\"\n[[fault]]\nname = \"other\"\npath = \"../vehicles/no-such.toml\"\n";
        assert_eq!(renamed(text, "mine"), expected);
    }

    #[test]
    fn scenario_every_shipped_scenario_and_campaign_can_be_copied_and_used_elsewhere() {
        let scratch = tempfile::tempdir().unwrap();
        for kind in [Kind::Scenario, Kind::Campaign] {
            for named in names::list(kind).unwrap() {
                let path = scratch.path().join(format!("{}.toml", named.name));
                std::fs::write(&path, renamed(&std::fs::read_to_string(&named.path).unwrap(), "mine")).unwrap();
                let text = std::fs::read_to_string(&path).unwrap();
                assert!(!text.contains("\"../"), "{text}");
                match kind {
                    Kind::Scenario => drop(rotortwin_scenario::Scenario::load(&path).unwrap()),
                    _ => assert!(text.contains("scenario = \"")),
                }
            }
        }
    }
}
