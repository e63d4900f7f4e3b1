//! Benchmarks, printed with the machine's data; each ratio is from interleaved measurements of the same run.
//!
//! These are not tests: a rate that depends on the machine and its load proves nothing by passing a limit.

use anyhow::{Context, Result, bail};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Instant;

const SCENARIO: &str = "config/scenarios/reference-flight.toml";

/// Steps of the reference flight; the bare link runs the same number.
const STEPS: &str = "36000";

/// Campaign of 288 flights whose rate is compared on one core and on two.
const CAMPAIGN: &str = "detector-ideal";

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
    bench.side_by_side()?;
    bench.placement("nothing else of ours runs", 0)?;
    bench.placement("beside a process that keeps one CPU busy", 1)?;
    bench.campaigns()
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
            let mut by_unit: BTreeMap<String, Vec<f64>> = BTreeMap::new();
            let mut alone = 0.0;
            for _ in 0..self.repetitions {
                let json = side_by_side(&self.root, flights, scenarios)?;
                single.push(number(&json, "single_steps_per_cpu_s")?);
                batch.push(number(&json, "batch_steps_per_cpu_s")?);
                ratio.push(100.0 * number(&json, "ratio")?);
                for (unit, rate) in units(&json)? {
                    by_unit.entry(unit).or_default().push(rate);
                }
                alone = number(&json, "flown_alone")?;
            }
            println!("flights side by side, one core: {title}");
            println!("  one after another, steps per CPU-second {}", Spread::of(single));
            println!("  side by side, steps per CPU-second      {}", Spread::of(batch));
            println!("  ratio, per cent                         {}", Spread::of(ratio));
            for (unit, rates) in by_unit {
                println!("  side by side on {unit:<23} {}", Spread::of(rates));
            }
            println!("  flights without a lane                  {alone:>9}\n");
        }
        Ok(())
    }

    /// The reference flight versus echo peers over the same link: same processes, message sizes and pinning. In shared memory also versus two
    /// processes that only hand each other a futex: what no link between processes that sleep can be faster than.
    fn lockstep(&self, link: &str, title: &str, cpu: Option<usize>) -> Result<()> {
        let (mut bare, mut flight, mut futex) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..self.repetitions {
            bare.push(self.bare_rate(link, cpu)?);
            if link == "iceoryx2" {
                futex.push(self.bare_rate("futex", cpu)?);
            }
            flight.push(match cpu {
                Some(cpu) => self.flight_rate(link, Some(cpu))?,
                None => self.unpinned_rate(link)?,
            });
        }
        let (bare, flight) = (Spread::of(bare), Spread::of(flight));
        println!("three processes over {link}, {title}");
        println!("  bare link, steps/s       {bare}");
        println!("  reference flight         {flight}");
        println!("  ratio of medians         {:.2}", flight.median / bare.median);
        if !futex.is_empty() {
            let futex = Spread::of(futex);
            println!("  futex, two processes     {futex}");
            println!("  bare link over futex     {:.2}", bare.median / futex.median);
        }
        println!();
        Ok(())
    }

    /// The placement that a flight chooses by itself versus fixed ones and the kernel's, in turns, beside `busy` processes that never sleep.
    fn placement(&self, title: &str, busy: usize) -> Result<()> {
        let cpus = std::thread::available_parallelism().map_or(1, usize::from).min(2);
        let mut chosen = Vec::new();
        let mut others: Vec<(String, Vec<f64>)> = (0..cpus).map(|cpu| (format!("--cpu {cpu}"), Vec::new())).collect();
        others.push(("left to the kernel".to_owned(), Vec::new()));
        let beside: Vec<Ended> = (0..busy)
            .map(|_| {
                let child = Command::new("sh").args(["-c", "while :; do :; done"]).spawn();
                child.map(Ended).context("starting sh")
            })
            .collect::<Result<_>>()?;
        for _ in 0..self.repetitions {
            chosen.push(self.flight_rate("iceoryx2", None)?);
            for (cpu, (_, rates)) in others.iter_mut().enumerate() {
                rates.push(if cpu < cpus {
                    self.flight_rate("iceoryx2", Some(cpu))?
                } else {
                    self.unpinned_rate("iceoryx2")?
                });
            }
        }
        drop(beside);
        let chosen = Spread::of(chosen);
        println!("placement of a flight over iceoryx2, {title}");
        println!("  chosen by itself, steps/s {chosen}");
        let mut best = 0.0_f64;
        for (name, rates) in others {
            let rates = Spread::of(rates);
            best = best.max(rates.median);
            println!("  {name:<25} {rates}");
        }
        println!("  chosen over the best      {:.2}\n", chosen.median / best);
        Ok(())
    }

    /// A campaign with one thread versus two, in turns.
    fn campaigns(&self) -> Result<()> {
        if std::thread::available_parallelism().map_or(1, usize::from) < 2 {
            println!("campaigns: needs 2 CPUs");
            return Ok(());
        }
        let (mut one, mut two, mut ratio) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..self.repetitions {
            let pair = [self.campaign_s(1)?, self.campaign_s(2)?];
            one.push(pair[0]);
            two.push(pair[1]);
            ratio.push(100.0 * pair[0] / pair[1]);
        }
        println!("campaign {CAMPAIGN}, whole command, s");
        println!("  --jobs 1                 {}", Spread::of(one));
        println!("  --jobs 2                 {}", Spread::of(two));
        println!("  rate of 2 over 1, of each pair, per cent {}", Spread::of(ratio));
        Ok(())
    }

    /// Wall-clock time of the campaign, s.
    fn campaign_s(&self, jobs: usize) -> Result<f64> {
        let out = std::env::temp_dir().join(format!("rotortwin-bench-{}-campaign", std::process::id()));
        let begin = Instant::now();
        let done = self.output(
            Command::new("target/release/rotortwin")
                .args(["campaign", CAMPAIGN, "--json", "--jobs", &jobs.to_string(), "--out"])
                .arg(&out),
        );
        let taken = begin.elapsed().as_secs_f64();
        remove(&out)?;
        done.map(|_| taken)
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
        remove(&out)?;
        number(&json?, "steps_per_s")
    }

    /// The reference flight of processes that are started one by one, which therefore run where the kernel puts them.
    fn unpinned_rate(&self, link: &str) -> Result<f64> {
        let out = std::env::temp_dir().join(format!("rotortwin-bench-{}-unpinned", std::process::id()));
        let [plant, peer] = match link {
            "zenoh" => ["listen", "connect"].map(|how| format!("zenoh:{how}=tcp/127.0.0.1:17449")),
            _ => [(); 2].map(|()| format!("{link}:bench{}", std::process::id())),
        };
        let run_id = format!("{:x}", std::process::id());
        let peers = ["controller", "fdi"]
            .map(|name| {
                let child = Command::new("target/release/rotortwin")
                    .current_dir(&self.root)
                    .args([name, "--link", &peer, "--run-id", &run_id])
                    .spawn();
                child.map(Ended).with_context(|| format!("starting rotortwin {name}"))
            })
            .into_iter()
            .collect::<Result<Vec<_>>>()?;
        let flown = self.output(
            Command::new("target/release/rotortwin")
                .args(["sim", SCENARIO, "--link", &plant, "--run-id", &run_id, "--out"])
                .arg(&out),
        );
        let summary = std::fs::read_to_string(out.join("summary.json"));
        drop(peers);
        remove(&out)?;
        flown?;
        let summary = summary.context("reading the summary of a flight")?;
        number(
            &serde_json::from_str(&summary).context("reading a summary")?,
            "steps_per_s",
        )
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

/// A process that ends with this value.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        if let Err(error) = self.0.kill().and_then(|()| self.0.wait().map(|_| ())) {
            eprintln!("a process cannot be ended: {error}");
        }
    }
}

/// Removes a folder of results, if there is one.
fn remove(folder: &Path) -> Result<()> {
    if folder.exists() {
        std::fs::remove_dir_all(folder).with_context(|| format!("removing {}", folder.display()))?;
    }
    Ok(())
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

/// Rate of each vector unit of the machine, in a result of `batch_rate` or `dynamics_rate`.
pub(crate) fn units(json: &serde_json::Value) -> Result<Vec<(String, f64)>> {
    let units = json.get("units").and_then(serde_json::Value::as_object);
    let units = units.context("no rates by vector unit in a result")?;
    units
        .iter()
        .map(|(name, rate)| {
            let rate = rate.as_f64();
            Ok((name.clone(), rate.with_context(|| format!("no rate of {name}"))?))
        })
        .collect()
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
