//! Deployment files: the commands they call exist, no container has more rights than it needs, and kustomize accepts them. (That they
//! work was checked by hand: docs/deploy.md.)

use rotortwin_tests::program::Call;
use rotortwin_tests::scratch::{Scratch, repository};
use rotortwin_tests::server::Server;
use serde_json::json;
use skip::skip;
use std::path::PathBuf;

#[path = "../src/skip.rs"]
#[expect(unreachable_pub, reason = "the harness has it, too")]
mod skip;

/// All files of the manifests, including the components.
fn manifests() -> Vec<PathBuf> {
    let mut folders = vec![repository().join("deploy/kubernetes")];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("it is in the repository") {
            let path = entry.expect("it can be read").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.push(path);
            }
        }
    }
    files
}

fn manifest(name: &str) -> String {
    std::fs::read_to_string(repository().join("deploy/kubernetes").join(name)).expect("it is text")
}

/// Entries of lists such as `args: [worker, --roles, jobs]` after `key` that call the program.
fn calls(text: &str, key: &str) -> Vec<Vec<String>> {
    let mut calls = Vec::new();
    for rest in text.split(&format!("{key}: [")).skip(1) {
        let (list, _) = rest.split_once(']').expect("a list ends");
        let words = list.split(',').map(|word| word.trim().trim_matches('"').to_owned());
        let words: Vec<String> = words.skip_while(|word| word == "rotortwin").collect();
        if matches!(
            words.first().map(String::as_str),
            Some("serve" | "worker" | "router" | "health")
        ) {
            calls.push(words);
        }
    }
    calls
}

/// The number behind a key of a manifest.
fn number(file: &str, key: &str) -> u64 {
    let text = manifest(file);
    let (_, rest) = text.split_once(key).unwrap_or_else(|| panic!("{file}: expected {key}"));
    let digits: String = rest
        .chars()
        .skip_while(|c| !c.is_ascii_digit())
        .take_while(char::is_ascii_digit)
        .collect();
    digits.parse().expect("it is a number")
}

#[test]
fn val_as_many_workers_as_are_allowed_find_connections_and_their_jobs_memory() {
    let replicas = |file: &str| number(file, "replicas:");
    let workers =
        number("autoscaling/workers.yaml", "maxReplicaCount:") + replicas("controller.yaml") + replicas("fdi.yaml");
    // docs/server.md: 4 connections for each worker, 11 for each server, 3 that Postgres keeps.
    let connections = 4 * workers + 11 * replicas("api.yaml") + 3;
    let most = number("postgres.yaml", "max_connections=");
    assert!(connections <= most, "{connections} of {most}");
    let jobs = number("worker.yaml", "--workers, ") * number("worker.yaml", "--job-memory, ");
    let gibibytes = number("worker.yaml", "limits: {memory: ");
    assert!(jobs * 1_000_000 < gibibytes << 30, "{jobs} MB of {gibibytes} GiB");
}

#[test]
fn val_containers_call_what_the_program_has() {
    let scratch = Scratch::new();
    let mut files = manifests();
    files.push(repository().join("docker-compose.yml"));
    let mut count = 0;
    for file in files {
        let text = std::fs::read_to_string(&file).expect("it is text");
        for key in ["command", "args", "test"] {
            // `test: [CMD, rotortwin, …]` of the compose file.
            for call in calls(&text.replace("[CMD, ", "["), key) {
                let help = Call::new(&scratch, [call[0].as_str(), "--help"])
                    .run()
                    .expect_code(0)
                    .stdout;
                for option in call.iter().filter(|word| word.starts_with("--")) {
                    let known = help.split([' ', '\n', ',']).any(|word| word == option);
                    assert!(known, "{}: rotortwin {} has no {option}", file.display(), call[0]);
                }
                count += 1;
            }
        }
    }
    assert!(count >= 15, "only {count} calls were found");
}

/// What a shell of a job of `deploy/kubernetes-campaign` executes, with `folder` in place of its volume.
fn shell_of_job(file: &str, folder: &std::path::Path) -> String {
    let path = repository().join("deploy/kubernetes-campaign").join(file);
    let text = std::fs::read_to_string(path).expect("it is text");
    let (_, args) = text.split_once("args:").expect("a container has arguments");
    let (args, _) = args.split_once("env:").expect("and then its environment");
    let script = args
        .trim()
        .trim_start_matches("- |")
        .trim_start_matches("['")
        .trim_end_matches("']");
    script.replace("/campaign/", &format!("{}/", folder.display()))
}

#[test]
fn scenario_pods_of_an_indexed_job_and_their_merge_give_the_campaign_of_one_machine() {
    let scratch = Scratch::new();
    scratch.write("hover.toml", rotortwin_tests::scratch::short_flight());
    // Two shards and a third that is not full; the last pod has less to do than the others.
    let campaign = scratch.write(
        "c.toml",
        "name = 'c'\ndescription = 'in pods'\nscenario = 'hover.toml'\nseed = 5\nflights = 72\n\
         [[axis]]\nname = 'loss'\nkey = 'fault[0].thrust_loss_percent'\nlog_uniform = [2.0, 30.0]\n",
    );
    std::fs::create_dir_all(scratch.path("bin")).expect("a folder");
    std::os::unix::fs::symlink(rotortwin_tests::program::program(), scratch.path("bin/rotortwin")).expect("a link");
    let path = format!(
        "{}:{}",
        scratch.path("bin").display(),
        std::env::var("PATH").unwrap_or_default()
    );
    let volume = scratch.path("volume");
    let shell = |file: &str, index: &str| {
        let output = std::process::Command::new("sh")
            .args(["-euc", &shell_of_job(file, &volume)])
            .env("PATH", &path)
            .env("CAMPAIGN", &campaign)
            .env("PER_POD", "2")
            .env("JOB_COMPLETION_INDEX", index)
            .current_dir(scratch.path(""))
            .output()
            .expect("the shell runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{file}, pod {index}: {said}");
    };
    shell("flights.yaml", "1");
    shell("flights.yaml", "0");
    // A pod that is made again after its last shard.
    shell("flights.yaml", "1");
    shell("merge.yaml", "");
    let whole = scratch.path("one-machine");
    let words = [
        "campaign".as_ref(),
        campaign.as_os_str(),
        "--out".as_ref(),
        whole.as_os_str(),
    ];
    Call::new(&scratch, words).run().expect_code(0);
    let read = |folder: &std::path::Path| std::fs::read(folder.join("campaign.parquet")).expect("it was written");
    assert_eq!(read(&volume.join("whole")), read(&whole));
}

#[test]
fn val_containers_have_no_rights_to_spare() {
    let count = |text: &str, words: &str| text.matches(words).count();
    for file in manifests() {
        let text = std::fs::read_to_string(&file).expect("it is text");
        let containers = count(&text, "          image: ");
        for words in [
            "readOnlyRootFilesystem: true",
            "allowPrivilegeEscalation: false",
            "capabilities: {drop: [ALL]}",
            "runAsNonRoot: true",
        ] {
            assert_eq!(count(&text, words), containers, "{}: {words}", file.display());
        }
    }
    let compose = std::fs::read_to_string(repository().join("docker-compose.yml")).expect("it is text");
    let (_, services) = compose.split_once("\nservices:\n").expect("it has services");
    let (services, _) = services.split_once("\nnetworks:\n").expect("and networks");
    let names = services
        .lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("   ") && line.ends_with(':'));
    // The database has its own block; all others share one.
    assert_eq!(names.count(), count(services, "<<: *program") + 1);
    for words in ["read_only: true", "cap_drop: [ALL]", "no-new-privileges:true"] {
        assert_eq!(count(&compose, words), 2, "{words}");
    }
    let image = std::fs::read_to_string(repository().join("Dockerfile")).expect("it is text");
    assert!(image.contains("\nUSER 10001:10001\n"), "the image runs as root");
}

/// Targets of budgets and autoscaling exist under that name, each secret is documented on the page, and no file holds one.
#[test]
fn val_budgets_autoscaling_and_secrets_name_what_is_there() {
    let budgets = manifest("disruption.yaml");
    for part in ["worker", "controller", "fdi"] {
        let labels = format!("matchLabels: {{app: {part}}}");
        assert!(budgets.contains(&labels), "no budget keeps {part}");
        let deployment = manifest(&format!("{part}.yaml"));
        assert!(
            deployment.contains(&labels) && deployment.contains("replicas: 2"),
            "{part}"
        );
    }
    // Single replicas: a budget would keep their nodes from ever being drained.
    for part in ["api", "router", "postgres"] {
        assert!(manifest(&format!("{part}.yaml")).contains("replicas: 1"), "{part}");
        assert!(!budgets.contains(&format!("app: {part}")), "{part}");
    }

    let scaled = manifest("autoscaling/workers.yaml");
    assert!(scaled.contains("scaleTargetRef: {name: worker}"), "{scaled}");
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let run = server.submit(&json!({ "scenario": "short-hover", "link": "in-process" }));
    server.ended(&run);
    let metrics = server.ask("GET", "/metrics", &[], "");
    let metrics = String::from_utf8(metrics.body).expect("it is text");
    let queries: Vec<&str> = scaled
        .lines()
        .filter_map(|line| line.trim().strip_prefix("query: "))
        .collect();
    assert_eq!(queries.len(), 2, "{queries:?}");
    for query in queries {
        let name = query
            .split(['(', ')', '{', ' '])
            .find(|word| word.starts_with("rotortwin_"))
            .expect("a metric");
        assert!(metrics.contains(&format!("# TYPE {name} gauge")), "{name}");
    }

    let page = std::fs::read_to_string(repository().join("docs/deploy.md")).expect("it is text");
    for file in manifests() {
        let text = std::fs::read_to_string(&file).expect("it is text");
        for part in text.split("secretKeyRef: {name: ").skip(1) {
            let (name, rest) = part.split_once(", key: ").expect("a key");
            let key = rest.split([',', '}']).next().expect("its name");
            assert!(
                page.contains(&format!("secret generic {name}")),
                "{name} of {}",
                file.display()
            );
            assert!(
                page.contains(&format!("--from-literal={key}=")),
                "{key} of {}",
                file.display()
            );
        }
        for words in [
            "AWS_SECRET_ACCESS_KEY, value:",
            "POSTGRES_PASSWORD, value:",
            "DATABASE_URL, value:",
        ] {
            assert!(!text.contains(words), "{} holds a secret", file.display());
        }
    }
}

/// `kubectl kustomize` builds them, with and without the components.
#[test]
fn scenario_kustomize_takes_the_manifests_with_and_without_components() {
    let scratch = Scratch::new();
    let folder = scratch.path("deploy");
    let copied = std::process::Command::new("cp")
        .arg("-r")
        .arg(repository().join("deploy"))
        .arg(&folder)
        .status();
    assert!(copied.is_ok_and(|status| status.success()), "it can be copied");
    let manifests = folder.join("kubernetes");
    let build = || {
        let output = std::process::Command::new("kubectl")
            .arg("kustomize")
            .arg(&manifests)
            .output()
            .ok()?;
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Some(String::from_utf8(output.stdout).expect("it is text"))
    };
    let Some(plain) = build() else {
        skip("kubectl is not installed");
        return;
    };
    assert!(plain.contains("kind: PodDisruptionBudget") && plain.contains("claimName: artifacts"));
    assert!(!plain.contains("ScaledObject") && !plain.contains("object-store"));
    let list = manifests.join("kustomization.yaml");
    let text = std::fs::read_to_string(&list)
        .expect("it is text")
        .replace("# components:", "components:");
    std::fs::write(&list, text).expect("written");
    let all = build().expect("it was there");
    assert!(
        !all.contains("claimName: artifacts") && !all.contains("- --artifacts"),
        "the volume is left out"
    );
    assert_eq!(all.matches("name: ROTORTWIN_ARTIFACTS").count(), 2, "API and workers");
    assert!(all.contains("kind: ScaledObject"));
    // Controllers and FDI engines only: the number of workers follows the queue.
    assert_eq!(
        (
            plain.matches("replicas: 2").count(),
            all.matches("  replicas: 2\n  selector").count()
        ),
        (3, 2)
    );
}
