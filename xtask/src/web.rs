//! The web page and the report page: built from `web/` into `web/dist` and `web/dist-report`, which are committed, so that neither
//! building nor running the program needs Node.
//!
//! ```text
//! web/package-lock.json ─ npm ci ─▶ node_modules ─ types of the OpenAPI document, tsc, vitest, vite ─▶ bundles ─ compared ─▶ web/dist, web/dist-report
//! ```
//! Assumes that the same sources and lock file give the same bytes, on every machine and version of Node from 20.19.

use crate::command::run;
use anyhow::{Context as _, Result, bail};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

#[expect(unreachable_pub, reason = "tests of other crates use it from their own module")]
#[path = "../../tests/src/skip.rs"]
mod skip;

/// Output folders of `web/`, and the Vite arguments for each.
const BUNDLES: [(&str, &[&str]); 2] = [("dist", &[]), ("dist-report", &["--config", "vite.report.ts"])];

/// Minimum version for Vite 8.
const NODE: (u32, u32) = (20, 19);

/// npm's messages when the network is at fault, not the tree.
const NO_NETWORK: [&str; 6] = [
    "ENOTFOUND",
    "EAI_AGAIN",
    "ECONNREFUSED",
    "ECONNRESET",
    "ETIMEDOUT",
    "ENETUNREACH",
];

/// Rebuilds both.
pub(crate) fn write(root: &Path) -> Result<()> {
    if let Some(why) = node_is_missing() {
        bail!("the web page: {why}");
    }
    if let Some(why) = install(root)? {
        bail!("the web page: npm ci needs the network: {why}");
    }
    run(
        "web: types, check, bundle",
        npm(root).args(["run", "build", "--silent"]),
    )
}

/// Rebuilds elsewhere and compares; reported as skipped where that is not possible.
pub(crate) fn check(root: &Path) -> Result<()> {
    println!("-- the web page");
    let not_here = match node_is_missing() {
        Some(why) => Some(why),
        None => install(root)?.map(|why| format!("npm ci needs the network: {why}")),
    };
    if let Some(why) = not_here {
        skip::skip(&format!(
            "web/dist and web/dist-report are not compared with what web/ gives: {why}"
        ));
        return Ok(());
    }
    run("web: types and check", npm(root).args(["run", "check", "--silent"]))?;
    run("web: unit tests", npm(root).args(["run", "test", "--silent"]))?;
    for (name, options) in BUNDLES {
        let elsewhere = root.join("target").join(name);
        let mut build = npm(root);
        build.args(["exec", "--no", "--", "vite", "build", "--logLevel", "warn"]);
        build.args(options).args(["--emptyOutDir", "--outDir"]).arg(&elsewhere);
        run(&format!("web: {name}"), &mut build)?;
        compare(name, &files(&root.join("web").join(name))?, &files(&elsewhere)?)?;
    }
    Ok(())
}

fn compare(folder: &str, committed: &BTreeMap<PathBuf, Vec<u8>>, built: &BTreeMap<PathBuf, Vec<u8>>) -> Result<()> {
    let differs = |(name, bytes): &(&PathBuf, &Vec<u8>)| committed.get(*name) != Some(*bytes);
    let new = built.iter().filter(differs).map(|(name, _)| name);
    let old = committed.keys().filter(|name| !built.contains_key(*name));
    let names: Vec<String> = new.chain(old).map(|name| name.display().to_string()).collect();
    if names.is_empty() {
        return Ok(());
    }
    bail!(
        "web/{folder} is not what web/ gives ({}): run `cargo xtask web` and commit web/{folder}",
        names.join(", ")
    )
}

/// Why the page cannot be built here.
fn node_is_missing() -> Option<String> {
    let expected = format!("expected Node {}.{} or later", NODE.0, NODE.1);
    let output = Command::new("node").arg("--version").output();
    let Ok(output) = output else {
        return Some(format!("there is no `node`; {expected}"));
    };
    let text = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    let mut parts = text
        .trim_start_matches('v')
        .split('.')
        .map(|part| part.parse::<u32>().ok());
    let version = (parts.next().flatten().unwrap_or(0), parts.next().flatten().unwrap_or(0));
    if version < NODE {
        return Some(format!("`node` is {text}; {expected}"));
    }
    Command::new("npm")
        .arg("--version")
        .stdout(Stdio::null())
        .status()
        .is_err()
        .then(|| "there is no `npm`".to_owned())
}

/// Installs packages according to the lock file, once per lock file. Returns npm's last words if the network is at fault.
fn install(root: &Path) -> Result<Option<String>> {
    let lock_file = root.join("web/package-lock.json");
    let wanted = std::fs::read(&lock_file).with_context(|| format!("reading {}", lock_file.display()))?;
    let stamp = root.join("web/node_modules/.rotortwin-lock.json");
    if std::fs::read(&stamp).is_ok_and(|there| there == wanted) {
        return Ok(None);
    }
    println!("-- web: npm ci");
    let output = npm(root)
        .args(["ci", "--ignore-scripts"])
        .output()
        .context("web: npm ci cannot be started")?;
    if output.status.success() {
        std::fs::write(&stamp, wanted).with_context(|| format!("writing {}", stamp.display()))?;
        return Ok(None);
    }
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    if let Some(line) = words
        .lines()
        .find(|line| NO_NETWORK.iter().any(|word| line.contains(word)))
    {
        return Ok(Some(line.trim().to_owned()));
    }
    bail!("web: npm ci failed ({}):\n{words}", output.status)
}

fn npm(root: &Path) -> Command {
    let mut command = Command::new("npm");
    command.current_dir(root.join("web")).stdin(Stdio::null());
    command
}

/// All files of a folder, by their path in it.
fn files(folder: &Path) -> Result<BTreeMap<PathBuf, Vec<u8>>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(&next).with_context(|| format!("reading {}", next.display()))? {
            let path = entry.with_context(|| format!("reading {}", next.display()))?.path();
            if path.is_dir() {
                open.push(path);
                continue;
            }
            let bytes = std::fs::read(&path).with_context(|| format!("reading {}", path.display()))?;
            found.insert(path.strip_prefix(folder).unwrap_or(&path).to_owned(), bytes);
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_a_missing_and_an_extra_file_are_named() {
        let tree = |entries: &[(&str, &str)]| -> BTreeMap<PathBuf, Vec<u8>> {
            let own = |(name, text): &(&str, &str)| (PathBuf::from(name), text.as_bytes().to_vec());
            entries.iter().map(own).collect()
        };
        let committed = tree(&[("same", "1"), ("changed", "1"), ("old", "1")]);
        assert!(compare("dist", &committed, &committed).is_ok());
        let built = tree(&[("same", "1"), ("changed", "2"), ("new", "1")]);
        let sentence = compare("dist", &committed, &built).unwrap_err().to_string();
        assert!(sentence.contains("(changed, new, old)"), "{sentence}");
    }
}
