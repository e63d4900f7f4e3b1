//! Benchmarks, printed with the machine's data; each ratio is from interleaved measurements of the same run.
//!
//! These are not tests: a rate that depends on the machine and its load proves nothing by passing a limit.

use anyhow::{Context, Result, bail};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const SCENARIO: &str = "config/scenarios/reference-flight.toml";

/// Steps of the reference flight; the bare link runs the same number.
const STEPS: &str = "36000";

/// Runs all benchmarks: five repetitions, or two if `quick`.
pub(crate) fn run(root: &Path, quick: bool) -> Result<()> {
    let repetitions = if quick { 2 } else { 5 };
    build(root)?;
    let bench = Bench {
        root: root.to_path_buf(),
        repetitions,
    };
    println!("{}", machine());
    println!("medians of {repetitions} (lowest – highest)\n");
    bench.closed_loop(if quick { 1.0 } else { 3.0 })?;
    bench.side_by_side_flights()?;
    bench.lockstep("iceoryx2", "all processes on CPU 0", Some(0))?;
    bench.lockstep("iceoryx2", "not pinned", None)?;
    bench.lockstep("zenoh", "all processes on CPU 0", Some(0))?;
    bench.lockstep("zenoh", "not pinned", None)?;
    bench.side_by_side()
}

/// Flights side by side only.
pub(crate) fn side_by_side_only(root: &Path) -> Result<()> {
    crate::command::build(root, &["--example", "batch_rate"])?;
    println!("{}", machine());
    let bench = Bench {
        root: root.to_path_buf(),
        repetitions: 5,
    };
    println!("medians of {} (lowest – highest)\n", bench.repetitions);
    bench.side_by_side_flights()
}

/// Builds the benchmark programs.
pub(crate) fn build(root: &Path) -> Result<()> {
    let mut targets = vec!["--bin", "rotortwin", "--bin", "rotortwin-network"];
    for example in ["closed_loop_rate", "batch_rate", "dynamics_rate", "link_rate"] {
        targets.extend(["--example", example]);
    }
    crate::command::build(root, &targets)
}

/// CPU, cores, kernel, load: without them a rate is meaningless.
pub(crate) fn machine() -> String {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let model = read("/proc/cpuinfo")
        .lines()
        .find_map(|line| {
            line.strip_prefix("model name")
                .and_then(|rest| rest.split_once(": "))
                .map(|(_, name)| name.to_owned())
        })
        .unwrap_or_else(|| "unknown CPU".to_owned());
    let cpus = std::thread::available_parallelism().map_or(0, usize::from);
    let kernel = read("/proc/sys/kernel/osrelease");
    let load = read("/proc/loadavg");
    format!(
        "{model}, {cpus} CPUs, Linux {}, load {}",
        kernel.trim(),
        load.split(' ').next().unwrap_or("unknown")
    )
}

/// Scenarios flown side by side: every trajectory, faults, wind, mismatch.
pub(crate) const SIDE_BY_SIDE: [&str; 6] = [
    SCENARIO,
    "config/scenarios/realistic-reference-flight.toml",
    "config/scenarios/waypoints.toml",
    "config/scenarios/helix-2.toml",
    "config/scenarios/hover.toml",
    "config/scenarios/windy-hover.toml",
];

/// One run of the example `batch_rate`, pinned to one core. Fails if any run hash differs from that of the single flight.
pub(crate) fn side_by_side(root: &Path, flights: &str, scenarios: &[&str]) -> Result<serde_json::Value> {
    let bench = Bench {
        root: root.to_path_buf(),
        repetitions: 1,
    };
    bench.json(
        Command::new("taskset")
            .args(["-c", "0", "target/release/examples/batch_rate", flights])
            .args(scenarios),
    )
}

/// Plant and controller alone on CPU 0, for `seconds` of CPU time on each vector unit.
pub(crate) fn dynamics(root: &Path, scenario: &str, seconds: f64) -> Result<serde_json::Value> {
    let bench = Bench {
        root: root.to_path_buf(),
        repetitions: 1,
    };
    bench.json(
        Command::new("taskset")
            .args(["-c", "0", "target/release/examples/dynamics_rate"])
            .arg(seconds.to_string())
            .arg(scenario),
    )
}

struct Bench {
    root: PathBuf,
    repetitions: usize,
}

impl Bench {
    fn closed_loop(&self, seconds: f64) -> Result<()> {
        let mut full = Vec::new();
        let mut parts = [Vec::new(), Vec::new(), Vec::new()];
        for _ in 0..self.repetitions {
            let json = self.json(
                Command::new("taskset")
                    .args(["-c", "0", "target/release/examples/closed_loop_rate", SCENARIO])
                    .arg(seconds.to_string()),
            )?;
            full.push(number(&json, "steps_per_cpu_s")?);
            for (values, key) in parts.iter_mut().zip(["ns_plant_and_loop", "ns_controller", "ns_fdi"]) {
                values.push(number(&json, key)?);
            }
        }
        println!("one process, closed loop with FDI and run hash, one core");
        println!("  steps per CPU-second     {}", Spread::of(full));
        for (values, name) in
            parts
                .into_iter()
                .zip(["plant, sensors, loop, hash", "controller", "residuals and detectors"])
        {
            println!("  ns a step: {name:<27} {}", Spread::of(values));
        }
        println!();
        Ok(())
    }

    /// Eight flights at a time versus one after another, same flights and hashes, interleaved.
    fn side_by_side_flights(&self) -> Result<()> {
        for (title, flights, scenarios) in [
            ("the reference flight with seeds 1 to 24", "24", &SIDE_BY_SIDE[..1]),
            ("six scenarios with seeds 1 to 8", "8", &SIDE_BY_SIDE[..]),
        ] {
            let (mut single, mut batch, mut ratio) = (Vec::new(), Vec::new(), Vec::new());
            let mut alone = 0.0;
            for _ in 0..self.repetitions {
                let json = side_by_side(&self.root, flights, scenarios)?;
                single.push(number(&json, "single_steps_per_cpu_s")?);
                batch.push(number(&json, "batch_steps_per_cpu_s")?);
                ratio.push(100.0 * number(&json, "ratio")?);
                alone = number(&json, "flown_alone")?;
            }
            println!("flights side by side, one core: {title}");
            println!("  one after another, steps per CPU-second {}", Spread::of(single));
            println!("  side by side, steps per CPU-second      {}", Spread::of(batch));
            println!("  ratio, per cent                         {}", Spread::of(ratio));
            println!("  flights without a lane                  {alone:>9}\n");
        }
        Ok(())
    }

    /// The reference flight versus echo peers over the same link: same processes, message sizes and pinning.
    fn lockstep(&self, link: &str, title: &str, cpu: Option<usize>) -> Result<()> {
        let (mut bare, mut flight) = (Vec::new(), Vec::new());
        for _ in 0..self.repetitions {
            bare.push(self.bare_rate(link, cpu)?);
            flight.push(self.flight_rate(link, cpu)?);
        }
        let (bare, flight) = (Spread::of(bare), Spread::of(flight));
        println!("three processes over {link}, {title}");
        println!("  bare link, steps/s       {bare}");
        println!("  reference flight         {flight}");
        println!("  ratio of medians         {:.2}\n", flight.median / bare.median);
        Ok(())
    }

    /// Two simultaneous flights, each on its own core, versus one.
    fn side_by_side(&self) -> Result<()> {
        if std::thread::available_parallelism().map_or(1, usize::from) < 2 {
            println!("two groups side by side: needs 2 CPUs");
            return Ok(());
        }
        let (mut one, mut two) = (Vec::new(), Vec::new());
        for _ in 0..self.repetitions {
            one.push(self.flight_rate("iceoryx2", Some(0))?);
            let rates = std::thread::scope(|scope| {
                let groups = [0, 1].map(|cpu| scope.spawn(move || self.flight_rate("iceoryx2", Some(cpu))));
                groups
                    .into_iter()
                    .map(|group| group.join().expect("a measuring thread does not panic"))
                    .collect::<Result<Vec<_>>>()
            })?;
            two.push(rates.iter().sum());
        }
        let (one, two) = (Spread::of(one), Spread::of(two));
        println!("two flights side by side over iceoryx2, a core each");
        println!("  one flight, steps/s      {one}");
        println!("  two flights together     {two}");
        println!("  ratio of medians         {:.2}", two.median / one.median);
        Ok(())
    }

    fn bare_rate(&self, link: &str, cpu: Option<usize>) -> Result<f64> {
        let mut command = pinned("target/release/examples/link_rate", cpu);
        let text = self.output(command.args([link, STEPS]))?;
        let rate = text
            .split(" steps/s")
            .next()
            .and_then(|head| head.rsplit(' ').next())
            .and_then(|word| word.parse().ok());
        rate.with_context(|| format!("no rate in the words of link_rate: {text}"))
    }

    fn flight_rate(&self, link: &str, cpu: Option<usize>) -> Result<f64> {
        let out = std::env::temp_dir().join(format!("rotortwin-bench-{}-{}", std::process::id(), cpu.unwrap_or(99)));
        let mut command = Command::new("target/release/rotortwin");
        command
            .args(["fly", SCENARIO, "--link", link, "--json", "--out"])
            .arg(&out);
        if let Some(cpu) = cpu {
            command.args(["--cpu", &cpu.to_string()]);
        }
        let json = self.json(&mut command);
        std::fs::remove_dir_all(&out).with_context(|| format!("removing {}", out.display()))?;
        number(&json?, "steps_per_s")
    }

    fn output(&self, command: &mut Command) -> Result<String> {
        let output = command
            .current_dir(&self.root)
            .stderr(Stdio::inherit())
            .output()
            .with_context(|| format!("starting {command:?}"))?;
        if !output.status.success() {
            bail!("{command:?} failed ({})", output.status);
        }
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }

    fn json(&self, command: &mut Command) -> Result<serde_json::Value> {
        serde_json::from_str(&self.output(command)?).context("reading a result")
    }
}

fn pinned(program: &str, cpu: Option<usize>) -> Command {
    match cpu {
        None => Command::new(program),
        Some(cpu) => {
            let mut command = Command::new("taskset");
            command.args(["-c", &cpu.to_string(), program]);
            command
        }
    }
}

pub(crate) fn number(json: &serde_json::Value, key: &str) -> Result<f64> {
    json.get(key)
        .and_then(serde_json::Value::as_f64)
        .with_context(|| format!("no number '{key}' in a result"))
}

/// Median, lowest and highest of a few measurements.
pub(crate) struct Spread {
    median: f64,
    lowest: f64,
    highest: f64,
}

impl Spread {
    pub(crate) fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        Self {
            median: values[values.len() / 2],
            lowest: values[0],
            highest: values[values.len() - 1],
        }
    }
}

impl std::fmt::Display for Spread {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{:>9.0} ({:.0} – {:.0})", self.median, self.lowest, self.highest)
    }
}
