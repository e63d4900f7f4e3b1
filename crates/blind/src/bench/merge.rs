//! Merges parts of one bench that any scheduler has run in folders of their own: the result is that of one machine.

use super::cases::Case;
use super::report;
use super::run::{BenchFolder, PARTS, Request};
use super::sheet::{self, Sheet};
use crate::error::{BlindError, Result};
use crate::vehicle::Vehicle;
use std::path::{Path, PathBuf};

/// What a merge gave.
#[derive(Debug)]
pub struct Merged {
    /// Cases of the whole bench.
    pub cases: usize,
    /// Numbers of the cases that no folder has, ascending.
    pub missing: Vec<u64>,
    /// The score, if none is missing.
    pub sheet: Option<Sheet>,
}

/// Merges the cases of `folders` in `out`, which may already contain some; each is taken once. Once all are there, the
/// score is written.
///
/// # Errors
/// A folder is not one of a bench, or of another bench than the first; a file cannot be read or written.
pub fn merge(folders: &[PathBuf], out: &Path) -> Result<Merged> {
    let Some(first) = folders.first() else {
        return Err(BlindError::input("merge", "expected folders with parts of a bench"));
    };
    let request = Request::of_folder(first)?;
    for other in folders {
        if Request::of_folder(other)? != request {
            return Err(BlindError::input(
                other.join("bench.json").display().to_string(),
                format!("is of another bench than {}; expected parts of one", first.display()),
            ));
        }
    }
    let bench = BenchFolder {
        path: out.to_owned(),
        request,
    };
    bench.open()?;
    for other in folders {
        take_in(other, out)?;
    }
    let rotor_counts = bench
        .request
        .vehicles
        .iter()
        .map(|path| Vehicle::load(path.as_ref()).map(|vehicle| vehicle.rotors.len()))
        .collect::<Result<Vec<_>>>()?;
    let cases = bench.request.cases(&rotor_counts);
    let rows = bench.rows(&cases);
    let is_missing = |case: &&Case| !rows.iter().any(|row| row.case.index == case.index);
    let missing = cases.iter().filter(is_missing).map(|case| case.index as u64).collect();
    let mut merged = Merged {
        cases: cases.len(),
        missing,
        sheet: None,
    };
    if merged.missing.is_empty() {
        let sheet = sheet::sum_up(&rows);
        report::write(out, &bench.request, &rows, &sheet)?;
        merged.sheet = Some(sheet);
    }
    Ok(merged)
}

/// Copies the cases that `out` lacks; rows last, so that a row means that the rest of its case is there.
fn take_in(from: &Path, out: &Path) -> Result<()> {
    for part in PARTS {
        let source = from.join(part);
        let entries = match std::fs::read_dir(&source) {
            Ok(entries) => entries,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            Err(error) => return Err(BlindError::file("reading", source, error)),
        };
        for entry in entries {
            let entry = entry.map_err(|error| BlindError::file("reading", &source, error))?;
            let place = out.join(part).join(entry.file_name());
            // Half a row of a bench that was stopped.
            if place.exists() || place.extension().is_some_and(|ending| ending == "part") {
                continue;
            }
            let aside = place.with_extension("part");
            std::fs::copy(entry.path(), &aside)
                .and_then(|_| std::fs::rename(&aside, &place))
                .map_err(|error| BlindError::file("writing", place, error))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::cases::Preset;
    use crate::bench::run::write_json;
    use crate::bench::score::failed;

    /// A folder with the rows of some cases, as a bench that did only these leaves it.
    fn part(folder: &Path, request: &Request, range: std::ops::Range<usize>) {
        let bench = BenchFolder {
            path: folder.to_owned(),
            request: request.clone(),
        };
        bench.open().unwrap();
        for case in &bench.request.cases(&[6])[range] {
            let row = failed(case, "not diagnosed".to_owned(), 0.5);
            write_json(&folder.join(format!("rows/{:05}.json", case.index)), &row).unwrap();
            std::fs::write(folder.join(format!("truth/{:05}.json", case.index)), "{}").unwrap();
        }
    }

    #[test]
    fn val_parts_in_any_order_give_the_bench_of_one_machine() {
        let scratch = tempfile::tempdir().unwrap();
        let at = |name: &str| scratch.path().join(name);
        let vehicle = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
        let request = Request {
            version: "1".to_owned(),
            presets: vec![Preset::Singles, Preset::Null],
            n: 3,
            seed: 4,
            vehicles: vec![vehicle.display().to_string()],
            duration_s: 90.0,
        };
        part(&at("whole"), &request, 0..6);
        part(&at("a"), &request, 0..2);
        part(&at("b"), &request, 1..5);
        part(&at("c"), &request, 5..6);
        let early = merge(&[at("b"), at("a")], &at("merged")).unwrap();
        assert_eq!((early.cases, early.missing, early.sheet.is_none()), (6, vec![5], true));
        assert!(!at("merged").join("score.json").exists());
        assert!(merge(&[at("c"), at("b")], &at("merged")).unwrap().sheet.is_some());
        merge(&[at("whole")], &at("alone")).unwrap();
        for file in ["score.json", "rows.parquet", "truth/00003.json"] {
            let read = |folder: &str| std::fs::read(at(folder).join(file)).unwrap();
            assert_eq!(read("merged"), read("alone"), "{file}");
        }
    }

    #[test]
    fn val_parts_of_another_bench_are_refused() {
        let scratch = tempfile::tempdir().unwrap();
        let at = |name: &str| scratch.path().join(name);
        let request = Request {
            version: "1".to_owned(),
            presets: vec![Preset::Singles],
            n: 2,
            seed: 4,
            vehicles: vec!["f550.toml".to_owned()],
            duration_s: 90.0,
        };
        part(&at("a"), &request, 0..1);
        part(
            &at("b"),
            &Request {
                seed: 5,
                ..request.clone()
            },
            1..2,
        );
        let error = merge(&[at("a"), at("b")], &at("out")).unwrap_err().to_string();
        assert!(error.contains("of another bench"), "{error}");
        let error = merge(&[at("nowhere")], &at("out")).unwrap_err().to_string();
        assert!(error.contains("nowhere"), "{error}");
    }
}
