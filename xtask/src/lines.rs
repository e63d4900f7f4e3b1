//! Lines of Rust by crate: program and tests.
//!
//! Counts lines that are neither empty nor a comment. Lines after `#[cfg(test)]`, which precedes the last module of a file here, and all
//! lines of `tests/`, `benches/` and `examples/` count as tests. Third-party (`third_party`) and generated code (`proto/src`) is
//! excluded.

use anyhow::{Context, Result, bail};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// Third-party or generated.
const LEFT_OUT: [&str; 2] = ["third_party/", "proto/src/"];

/// Lines of the program, lines of tests.
type Lines = [usize; 2];

/// Prints a table of the current tree, optionally next to that of a commit.
pub(crate) fn run(root: &Path, before: Option<&str>) -> Result<()> {
    let after = counted(root, None)?;
    let Some(commit) = before else {
        println!("| crate | lines | of tests |\n|---|---:|---:|");
        for (name, [program, tests]) in with_sum(&after) {
            println!("| {name} | {program} | {tests} |");
        }
        return Ok(());
    };
    let (before, after) = (with_sum(&counted(root, Some(commit))?), with_sum(&after));
    println!("| crate | before | after | | of tests, before | after |\n|---|---:|---:|---:|---:|---:|");
    for name in before
        .keys()
        .chain(after.keys().filter(|name| !before.contains_key(*name)))
    {
        let of = |counts: &BTreeMap<String, Lines>| counts.get(name).copied().unwrap_or_default();
        let ([old, old_tests], [new, new_tests]) = (of(&before), of(&after));
        if (old, old_tests) != (new, new_tests) {
            let change = new.cast_signed() - old.cast_signed();
            println!("| {name} | {old} | {new} | {change:+} | {old_tests} | {new_tests} |");
        }
    }
    Ok(())
}

/// The last row holds the sum.
fn with_sum(counts: &BTreeMap<String, Lines>) -> BTreeMap<String, Lines> {
    let sum = counts
        .values()
        .fold([0, 0], |sum, lines| [sum[0] + lines[0], sum[1] + lines[1]]);
    // Sorts after all folder names.
    counts
        .iter()
        .map(|(name, lines)| (name.clone(), *lines))
        .chain([("~ all".to_owned(), sum)])
        .collect()
}

fn counted(root: &Path, commit: Option<&str>) -> Result<BTreeMap<String, Lines>> {
    let files = match commit {
        Some(commit) => git(root, &["ls-tree", "-r", "--name-only", commit])?,
        None => git(root, &["ls-files", "--cached", "--others", "--exclude-standard"])?,
    };
    let mut counts: BTreeMap<String, Lines> = BTreeMap::new();
    for file in files.lines().filter(|file| file.ends_with(".rs")) {
        if LEFT_OUT.iter().any(|folder| file.starts_with(folder)) {
            continue;
        }
        let text = match commit {
            Some(commit) => git(root, &["show", &format!("{commit}:{file}")])?,
            // Listed by git, and deleted since.
            None if !root.join(file).is_file() => continue,
            None => std::fs::read_to_string(root.join(file)).with_context(|| file.to_owned())?,
        };
        let [program, tests] = lines_of(file, &text);
        let sum = counts.entry(crate_of(file)).or_default();
        *sum = [sum[0] + program, sum[1] + tests];
    }
    Ok(counts)
}

/// `crates/plant` of `crates/plant/src/lib.rs`, `cli` of `cli/src/main.rs`.
fn crate_of(file: &str) -> String {
    let parts: Vec<&str> = file.split('/').collect();
    let inner = ["src", "tests", "benches", "examples", "build.rs", "fuzz_targets"];
    let end = parts.iter().position(|part| inner.contains(part)).unwrap_or(1);
    parts.get(..end.max(1)).unwrap_or_default().join("/")
}

fn lines_of(file: &str, text: &str) -> Lines {
    let only_tests = file
        .split('/')
        .any(|part| ["tests", "benches", "examples"].contains(&part));
    let mut counts = [0, 0];
    let mut in_tests = only_tests;
    for line in text.lines().map(str::trim) {
        in_tests |= line.starts_with("#[cfg(test)]");
        if !line.is_empty() && !line.starts_with("//") {
            counts[usize::from(in_tests)] += 1;
        }
    }
    counts
}

fn git(root: &Path, words: &[&str]) -> Result<String> {
    let output = Command::new("git")
        .args(words)
        .current_dir(root)
        .output()
        .context("git")?;
    if !output.status.success() {
        bail!(
            "git {}: {}",
            words.join(" "),
            String::from_utf8_lossy(&output.stderr).trim()
        );
    }
    String::from_utf8(output.stdout).context("git said something that is no text")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_lines_of_a_program_and_of_its_tests() {
        let text = "//! What it is.\n\nfn one() {}\n// Why.\nfn two() {}\n#[cfg(test)]\nmod tests {\n}\n";
        assert_eq!(lines_of("crates/a/src/lib.rs", text), [2, 3]);
        assert_eq!(lines_of("crates/a/tests/it.rs", text), [0, 5]);
        assert_eq!(crate_of("crates/a/tests/it.rs"), "crates/a");
        assert_eq!(crate_of("cli/src/fly/mod.rs"), "cli");
        assert_eq!(crate_of("tests/tests/server.rs"), "tests");
        assert_eq!(crate_of("firmware/mps2-an500/src/main.rs"), "firmware/mps2-an500");
    }
}
