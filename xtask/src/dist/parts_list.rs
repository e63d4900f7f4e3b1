//! Software bill of materials of the packages, for vulnerability scans: CycloneDX 1.5, from cargo's resolution.
//!
//! Contains the packages linked into the programs and the Python module, for this system, with name, version, licence, the checksum
//! of the lock file and their dependencies. Build scripts and macros, which only run at build time, are not included.

use super::{VERSION, output_of};
use crate::command::cargo;
use anyhow::{Context as _, Result, bail};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Programs in the packages.
const PROGRAMS: [&str; 2] = ["rotortwin-network", "rotortwin-native"];

/// Writes the list.
pub(super) fn write(root: &Path, out: &Path) -> Result<()> {
    let target = output_of(std::process::Command::new("rustc").args(["--print", "host-tuple"]))?;
    let said = output_of(cargo(root).args([
        "metadata",
        "--format-version",
        "1",
        "--locked",
        "--filter-platform",
        target.trim(),
    ]))?;
    let metadata: Value = serde_json::from_str(&said).context("what cargo metadata says")?;
    let lock = std::fs::read_to_string(root.join("Cargo.lock"))?;
    let list = list(&metadata, &checksums(&lock))?;
    let file = out.join(format!("rotortwin-{VERSION}-{}.cdx.json", std::env::consts::ARCH));
    Ok(std::fs::write(file, serde_json::to_string_pretty(&list)?)?)
}

/// Name and version → SHA-256 of the package as it was downloaded.
fn checksums(lock: &str) -> BTreeMap<(String, String), String> {
    let of = |block: &str, key: &str| {
        let start = format!("{key} = \"");
        let line = block.lines().find_map(|line| line.strip_prefix(&start))?;
        Some(line.trim_end_matches('"').to_owned())
    };
    let blocks = lock.split("[[package]]");
    blocks
        .filter_map(|block| Some(((of(block, "name")?, of(block, "version")?), of(block, "checksum")?)))
        .collect()
}

fn list(metadata: &Value, checksums: &BTreeMap<(String, String), String>) -> Result<Value> {
    let entries = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let packages: BTreeMap<String, Value> = entries(&metadata["packages"])
        .into_iter()
        .map(|package| (text(&package["id"]), package))
        .collect();
    let linked: BTreeMap<String, Vec<String>> = entries(&metadata["resolve"]["nodes"])
        .into_iter()
        .map(|node| {
            let normal = entries(&node["deps"]).into_iter().filter(|used| {
                let is_macro = packages.get(&text(&used["pkg"])).is_some_and(|package| {
                    entries(&package["targets"])
                        .iter()
                        .any(|target| entries(&target["kind"]).contains(&json!("proc-macro")))
                });
                !is_macro && entries(&used["dep_kinds"]).iter().any(|kind| kind["kind"].is_null())
            });
            (text(&node["id"]), normal.map(|used| text(&used["pkg"])).collect())
        })
        .collect();
    let mut open: Vec<String> = packages
        .iter()
        .filter(|(_, package)| PROGRAMS.contains(&text(&package["name"]).as_str()))
        .map(|(id, _)| id.clone())
        .collect();
    if open.len() != PROGRAMS.len() {
        bail!("cargo metadata names {} of {PROGRAMS:?}", open.len());
    }
    let mut found = BTreeSet::new();
    while let Some(id) = open.pop() {
        if found.insert(id.clone()) {
            open.extend(linked.get(&id).cloned().unwrap_or_default());
        }
    }
    let reference = |id: &str| {
        let package = packages.get(id).with_context(|| format!("{id} is unknown"))?;
        Ok::<_, anyhow::Error>(format!(
            "pkg:cargo/{}@{}",
            text(&package["name"]),
            text(&package["version"])
        ))
    };
    let (mut components, mut dependencies) = (Vec::new(), Vec::new());
    for id in &found {
        let package = &packages[id];
        let (name, version) = (text(&package["name"]), text(&package["version"]));
        let mut component = json!({
            "type": "library", "bom-ref": reference(id)?, "name": name, "version": version, "purl": reference(id)?,
        });
        if let Some(licence) = package["license"].as_str() {
            // "MIT/Apache-2.0" is the old notation.
            component["licenses"] = json!([{ "expression": licence.replace('/', " OR ") }]);
        }
        if let Some(checksum) = checksums.get(&(name, version)) {
            component["hashes"] = json!([{ "alg": "SHA-256", "content": checksum }]);
        }
        components.push(component);
        let used = linked.get(id).cloned().unwrap_or_default();
        let used: BTreeSet<String> = used.iter().map(|id| reference(id)).collect::<Result<_>>()?;
        dependencies.push(json!({ "ref": reference(id)?, "dependsOn": used }));
    }
    Ok(json!({
        "bomFormat": "CycloneDX", "specVersion": "1.5", "version": 1,
        "metadata": { "component": { "type": "application", "bom-ref": "rotortwin", "name": "rotortwin", "version": VERSION } },
        "components": components, "dependencies": dependencies,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_what_is_linked_is_listed_and_nothing_else() {
        let package = |name: &str, kind: &str| json!({ "id": name, "name": name, "version": "1.2.3", "license": "MIT/Apache-2.0", "targets": [{ "kind": [kind] }] });
        let normal = |name: &str| json!({ "pkg": name, "dep_kinds": [{ "kind": null }] });
        let names = [
            "rotortwin-network",
            "rotortwin-native",
            "used",
            "used-by-used",
            "built-with",
            "of-tests",
        ];
        let mut packages: Vec<Value> = names.iter().map(|name| package(name, "lib")).collect();
        packages.push(package("macro", "proc-macro"));
        let deps = json!([
            normal("used"), normal("macro"),
            { "pkg": "built-with", "dep_kinds": [{ "kind": "build" }] }, { "pkg": "of-tests", "dep_kinds": [{ "kind": "dev" }] },
        ]);
        let metadata = json!({ "packages": packages, "resolve": { "nodes": [
            { "id": "rotortwin-network", "deps": deps }, { "id": "used", "deps": [normal("used-by-used")] },
        ] } });
        let lock = "[[package]]\nname = \"used\"\nversion = \"1.2.3\"\nchecksum = \"abc\"\n";
        let list = list(&metadata, &checksums(lock)).expect("it is whole");
        let components = list["components"].as_array().expect("a list");
        let named: Vec<&str> = components
            .iter()
            .filter_map(|component| component["name"].as_str())
            .collect();
        assert_eq!(named, ["rotortwin-native", "rotortwin-network", "used", "used-by-used"]);
        assert_eq!(components[2]["hashes"][0]["content"], "abc");
        assert_eq!(components[2]["licenses"][0]["expression"], "MIT OR Apache-2.0");
        assert_eq!(
            list["dependencies"][2]["dependsOn"],
            json!(["pkg:cargo/used-by-used@1.2.3"])
        );
    }
}
