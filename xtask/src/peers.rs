//! Comparison with other simulators on the same core, in the same run: scope and speed of each.
//!
//! Each peer gets its own virtual environment in a temporary folder, from the package index configured for `pip`; the folder is
//! removed afterwards. A peer that cannot be installed or does not run is reported with the reason, and the others continue. The
//! product depends on none of them.
//!
//! Rates are steps per CPU-second of one process, pinned to one core, in each program's documented set-up. The tasks differ: see the
//! column that describes them.

use crate::bench::{SIDE_BY_SIDE, build, machine};
use anyhow::{Context, Result, bail};
use std::path::Path;
use std::process::Command;

/// Package and the script in `xtask/peers` that measures it.
const PEERS: [(&str, &str); 3] = [
    ("crazyflow", "crazyflow_rate.py"),
    ("rotorpy", "rotorpy_rate.py"),
    ("gym-pybullet-drones", "gym_pybullet_drones_rate.py"),
];

/// Flights of each scenario in our own row.
const FLIGHTS: &str = "16";

struct Row {
    what: String,
    computes: String,
    rate_hz: f64,
    steps_per_cpu_s: f64,
}

/// Measures ours and theirs, `seconds` of CPU time for each of theirs, and prints one table.
///
/// * `environments`: folder with existing virtual environments named after the packages; `None`: temporary ones
pub(crate) fn run(root: &Path, environments: Option<&Path>, seconds: f64) -> Result<()> {
    build(root)?;
    println!("{}", machine());
    let temporary = std::env::temp_dir().join(format!("rotortwin-peers-{}", std::process::id()));
    let mut rows = ours(root, seconds)?;
    for (package, script) in PEERS {
        let home = environments.unwrap_or(&temporary).join(package);
        let measured = match environments {
            Some(_) => Ok(()),
            None => install(&home, package),
        }
        .and_then(|()| measure(root, &home, script, seconds));
        match measured {
            Ok(found) => rows.extend(found),
            Err(error) => println!("{package}: left out, {error:#}"),
        }
    }
    if environments.is_none() && temporary.exists() {
        std::fs::remove_dir_all(&temporary).with_context(|| format!("removing {}", temporary.display()))?;
    }
    println!(
        "\n{:<38} {:>14} {:>12}  computes",
        "one pinned core", "steps/CPU-s", "× real time"
    );
    for row in &rows {
        println!(
            "{:<38} {:>14.0} {:>12.1}  {}",
            row.what,
            row.steps_per_cpu_s,
            row.steps_per_cpu_s / row.rate_hz,
            row.computes
        );
    }
    let best = |begin: &str| {
        let rates = rows.iter().filter(|row| row.what.starts_with(begin));
        rates.map(|row| row.steps_per_cpu_s).reduce(f64::max)
    };
    if let Some(theirs) = best("crazyflow") {
        println!();
        for (what, begin) in [("side by side", OURS), ("the same work", SAME_WORK)] {
            if let Some(ours) = best(begin) {
                println!("{what}, best unit over crazyflow's best: {:.2}", ours / theirs);
            }
        }
    }
    Ok(())
}

/// Rows of ours with detectors, one for each vector unit.
const OURS: &str = "rotortwin, 8 side by side";
/// Rows of ours that compute what crazyflow does, one for each vector unit.
const SAME_WORK: &str = "rotortwin, 8, no detectors";

fn ours(root: &Path, seconds: f64) -> Result<Vec<Row>> {
    let dynamics = crate::bench::dynamics(root, "xtask/peers/quad-hover.toml", seconds)?;
    let json = crate::bench::side_by_side(root, FLIGHTS, &SIDE_BY_SIDE)?;
    let computes = "hexarotor, 400 Hz, RK4, battery, wind, PID, f64; sensor noise, FDI with three evaluators, run hash";
    let row = |what: String, computes: &str, steps_per_cpu_s: f64| Row {
        what,
        computes: computes.to_owned(),
        rate_hz: 400.0,
        steps_per_cpu_s,
    };
    let single = crate::bench::number(&json, "single_steps_per_cpu_s")?;
    let mut rows = vec![row("rotortwin, one flight".to_owned(), computes, single)];
    let same_work =
        "quadrotor, 400 Hz, RK4, battery, PID, f64; no noise, no FDI, no run hash: the same work as crazyflow's";
    for (what, computes, json) in [(OURS, computes, &json), (SAME_WORK, same_work, &dynamics)] {
        for (unit, rate) in crate::bench::units(json)? {
            rows.push(row(format!("{what}, {unit}"), computes, rate));
        }
    }
    Ok(rows)
}

fn install(home: &Path, package: &str) -> Result<()> {
    println!("-- installing {package} into {}", home.display());
    let made = Command::new("python3").args(["-m", "venv"]).arg(home).output();
    let made = made.context("starting python3")?;
    if !made.status.success() {
        bail!("python3 -m venv failed: {}", last_line(&made.stderr));
    }
    let installed = Command::new(home.join("bin/pip"))
        .args(["install", "--quiet", "--disable-pip-version-check", package])
        .output()
        .context("starting pip")?;
    if !installed.status.success() {
        bail!("pip cannot install it: {}", last_line(&installed.stderr));
    }
    Ok(())
}

fn measure(root: &Path, home: &Path, script: &str, seconds: f64) -> Result<Vec<Row>> {
    let output = Command::new("taskset")
        .args(["-c", "0"])
        .arg(home.join("bin/python"))
        .arg(root.join("xtask/peers").join(script))
        .arg(seconds.to_string())
        .output()
        .with_context(|| format!("starting {script}"))?;
    if !output.status.success() {
        bail!("{script} failed: {}", last_line(&output.stderr));
    }
    String::from_utf8_lossy(&output.stdout)
        .lines()
        .filter(|line| line.starts_with('{'))
        .map(|line| {
            let json: serde_json::Value = serde_json::from_str(line).context("reading a result")?;
            let text = |key: &str| json[key].as_str().unwrap_or_default().to_owned();
            Ok(Row {
                what: text("what"),
                computes: text("computes"),
                rate_hz: crate::bench::number(&json, "rate_hz")?,
                steps_per_cpu_s: crate::bench::number(&json, "steps_per_cpu_s")?,
            })
        })
        .collect()
}

fn last_line(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    text.lines()
        .rfind(|line| !line.trim().is_empty())
        .unwrap_or("without a word")
        .to_owned()
}
