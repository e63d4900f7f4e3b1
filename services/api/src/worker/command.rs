//! The command line that does a job.

use rotortwin_jobs::Job;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Words after `rotortwin`.
///
/// # Errors
/// One sentence: it is a flight, which `flight.rs` does.
pub(super) fn words(job: &Job) -> Result<Vec<OsString>, String> {
    let mut words = Words(Vec::new());
    match job {
        Job::Campaign(campaign) => {
            words
                .plain(["campaign"])
                .path(&campaign.campaign)
                .plain(["--json", "--events"]);
            words.option("--out", &campaign.out);
            words.maybe("--threads", campaign.threads);
            words.maybe("--limit", campaign.limit);
            words.maybe(
                "--shards",
                campaign
                    .shards
                    .as_ref()
                    .map(|part| format!("{}..{}", part.start, part.end)),
            );
        }
        Job::BlindBench(bench) => {
            let presets: Vec<&str> = bench.presets.iter().map(|preset| preset.name()).collect();
            words.plain(["blind", "--json", "--events"]);
            words.option("--out", &bench.out);
            words.maybe("--jobs", bench.processes);
            words
                .option("--preset", presets.join(","))
                .option("--n", bench.n.to_string());
            words.option("--seed", bench.seed.to_string());
            words.option("--vehicles", bench.vehicles.join(","));
            words.option("--duration-s", bench.duration_s.to_string());
            words.maybe(
                "--cases",
                bench.cases.as_ref().map(|part| format!("{}..{}", part.start, part.end)),
            );
        }
        Job::Comparison(comparison) => {
            words.plain(["compare"]).paths(&comparison.logs).plain(["--json"]);
            words.plain(["--model"]).plain(&comparison.model);
            words.option("--models", &comparison.models);
            words.path_option("--out", comparison.out.as_deref());
            for label in &comparison.label {
                words.plain([format!("--label={label}")]);
            }
        }
        Job::Diagnosis(diagnosis) => {
            words
                .plain(["diagnose"])
                .paths(&diagnosis.logs)
                .plain(["--json", "--events"]);
            words
                .option("--model", &diagnosis.model)
                .option("--models", &diagnosis.models);
            words.path_option("--out", diagnosis.out.as_deref());
            for effect in &diagnosis.effects {
                words.option("--effects", effect);
            }
            if !diagnosis.baseline.is_empty() {
                words.plain(["--baseline"]).paths(&diagnosis.baseline);
            }
        }
        Job::Improvement(improvement) => {
            words
                .plain(["improve"])
                .paths(&improvement.logs)
                .plain(["--json", "--events", "--yes"]);
            words
                .option("--model", &improvement.model)
                .option("--models", &improvement.models);
            words.path_option("--out", improvement.out.as_deref());
            words.path_option("--final", improvement.final_version.as_deref());
            words.path_option("--truth", improvement.truth.as_deref());
            if !improvement.held_out.is_empty() {
                words.plain(["--held-out"]).paths(&improvement.held_out);
            }
        }
        Job::LogImport(import) => {
            words.plain(["log", "import"]).path(&import.file).plain(["--quiet"]);
            words.option("--out", &import.out);
            words.maybe("--rate", import.rate_hz);
            words.plain(import.align.then_some("--align"));
            words.plain(import.damaged.then_some("--damaged"));
            words.path_option("--vehicle", import.vehicle.as_deref());
            words.path_option("--mapping", import.mapping.as_deref());
        }
        Job::LogExample(example) => {
            words.plain(["log", "example"]);
            words.option("--model", &example.vehicle).option("--out", &example.out);
            words.maybe("--preset", example.preset.map(|preset| preset.name()));
            // A word of its own would pass for an option.
            words.plain(example.effect.as_ref().map(|effect| format!("--effect={effect}")));
            words.option("--seed", example.seed.to_string());
            words.option("--duration-s", example.duration_s.to_string());
        }
        Job::Identification(found) => {
            words
                .plain(["vehicle", "from-log"])
                .paths(&found.logs)
                .plain(["--json"]);
            words.plain([format!("--mass={}", found.mass_kg), format!("--arm={}", found.arm_m)]);
            words.plain(found.frame.as_ref().map(|frame| format!("--frame={frame}")));
            words.plain(found.trust_frame.then_some("--trust-frame"));
            words.maybe("--capacity", found.capacity_ah);
            words.maybe("--cells", found.cells);
            words.plain(found.held_out.then_some("--held-out"));
            for table in &found.bench {
                words.option("--bench", table);
            }
            words.option("--out", &found.out);
        }
        Job::NextFlight(next) => {
            words.plain(["next-flight", "--json"]);
            words.option("--model", &next.model).option("--models", &next.models);
            // A word of its own would pass for an option.
            words.plain([format!("--between={}", next.between.join(","))]);
            words.option("--out", &next.out);
        }
        Job::Training(training) => {
            words.plain(["train", "--json", "--method", training.method.as_str()]);
            words
                .option("--out", &training.out)
                .option("--scenario", &training.scenario);
            words.option("--seeds", training.seeds.to_string());
            words.option("--first-seed", training.first_seed.to_string());
            words.maybe("--threads", training.threads);
        }
        Job::Verification(verification) => {
            words.plain(["replay"]).path(&verification.run).plain(["--json"]);
        }
        Job::Run(_) => return Err("a flight has a command line of its own".to_owned()),
    }
    Ok(words.0)
}

/// File with the result; `None`: its standard output is the result.
pub(super) fn result_file(job: &Job) -> Option<PathBuf> {
    match job {
        Job::LogImport(import) => import
            .file
            .with_extension("import.json")
            .file_name()
            .map(|name| import.out.join(name)),
        Job::LogExample(example) => Some(example.out.join("log.import.json")),
        _ => None,
    }
}

struct Words(Vec<OsString>);

impl Words {
    fn plain(&mut self, words: impl IntoIterator<Item = impl Into<OsString>>) -> &mut Self {
        self.0.extend(words.into_iter().map(Into::into));
        self
    }

    fn path(&mut self, path: &Path) -> &mut Self {
        self.plain([path])
    }

    fn paths(&mut self, paths: &[PathBuf]) -> &mut Self {
        self.plain(paths)
    }

    fn option(&mut self, name: &str, value: impl Into<OsString>) -> &mut Self {
        self.plain([name.into(), value.into()])
    }

    fn path_option(&mut self, name: &str, value: Option<&Path>) -> &mut Self {
        if let Some(path) = value {
            self.option(name, path);
        }
        self
    }

    fn maybe(&mut self, name: &str, value: Option<impl ToString>) -> &mut Self {
        if let Some(value) = value {
            self.option(name, value.to_string());
        }
        self
    }
}
