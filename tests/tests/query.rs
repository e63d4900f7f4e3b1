//! `rotortwin query`: SQL over a campaign's files, and what it must not do.

use rotortwin_tests::process::{Process, wait_until};
use rotortwin_tests::program::{Call, Ended, PATIENCE, program};
use rotortwin_tests::python::client_environment;
use rotortwin_tests::scratch::{Scratch, short_flight};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// 40 flights in the folder `runs/c`.
fn flown(scratch: &Scratch) {
    scratch.write("short.toml", short_flight());
    let text = "name = 'c'\ndescription = 'asked'\nscenario = 'short.toml'\nseed = 5\nflights = 40\n\
                [[axis]]\nname = 'loss'\nkey = 'fault[0].thrust_loss_percent'\nlog_uniform = [2.0, 30.0]\n";
    let file = scratch.write("c.toml", text).display().to_string();
    Call::new(scratch, ["campaign", &file, "--out", "runs/c"])
        .run()
        .expect_code(0);
}

fn ask(scratch: &Scratch, programs: &Path, words: &[&str]) -> Ended {
    let python = programs.join("python").display().to_string();
    Call::new(scratch, [&["query", "--python", &python], words].concat()).run()
}

#[test]
fn scenario_results_are_tables() {
    let Some(programs) = client_environment() else { return };
    let scratch = Scratch::new();
    flown(&scratch);
    let rows = std::fs::read_to_string(scratch.path("runs/c/campaign.csv")).expect("it was written");
    let header: Vec<&str> = rows.lines().next().expect("a header").split(',').collect();
    let place = header.iter().position(|name| *name == "run_hash").expect("a hash");
    let seventh = rows.lines().nth(8).expect("flight 7");
    let hash = seventh.split(',').nth(place).expect("its hash");

    let sql = "SELECT folder, flight, run_hash FROM campaign WHERE flight = 7";
    let csv = ask(&scratch, &programs, &[sql, "--csv"]).expect_code(0).stdout;
    assert_eq!(csv, format!("folder,flight,run_hash\nc,7,{hash}\n"));
    let sql = "SELECT count(*) AS n, NULL AS nothing, [1, 2] AS list FROM shards";
    let json = ask(&scratch, &programs, &[sql, "runs/c", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json.expect_code(0).stdout).expect("JSON");
    assert_eq!(json["rows"], serde_json::json!([[40, null, [1, 2]]]), "{json}");
    assert_eq!(
        (&json["columns"][0]["type"], &json["more"]),
        (&"BIGINT".into(), &false.into())
    );
    let sql = "SELECT flight FROM campaign ORDER BY flight";
    let table = ask(&scratch, &programs, &[sql, "--rows", "3"]).expect_code(0).stdout;
    assert!(
        table.contains("flight") && table.contains("The first 3 rows"),
        "{table}"
    );
    assert_eq!(
        table.lines().filter(|line| line.trim().parse::<u64>().is_ok()).count(),
        3,
        "{table}"
    );
    let sql = "SELECT DISTINCT folder FROM campaign";
    let named = ask(&scratch, &programs, &[sql, "--named", "mine=runs/c", "--csv"]);
    assert_eq!(named.expect_code(0).stdout, "folder\nmine\n");
    let none = ask(&scratch, &programs, &["SELECT 1", "nowhere"]);
    assert_eq!(none.code, Some(2));
    assert!(
        none.stderr[0].contains("nowhere: no Parquet files there"),
        "{:?}",
        none.stderr
    );
}

/// A statement reads its files only, and writes nothing.
#[test]
fn scenario_a_query_reaches_its_files_and_nothing_else() {
    let Some(programs) = client_environment() else { return };
    let scratch = Scratch::new();
    flown(&scratch);
    let secret = scratch.path("secret.parquet");
    let table = scratch.path("runs/c/campaign.parquet");
    std::fs::copy(&table, &secret).expect("copied");
    std::os::unix::fs::symlink(&secret, scratch.path("runs/c/link.parquet")).expect("linked");
    let before = std::fs::read(&table).expect("readable");
    scratch.write("text.csv", "a\n1\n");
    // Python would import this from the current folder.
    scratch.write("duckdb.py", "open('imported', 'w')");
    for sql in [
        "SELECT * FROM read_parquet('secret.parquet')",
        "SELECT * FROM 'secret.parquet'",
        "SELECT * FROM read_parquet('runs/c/../../secret.parquet')",
        "SELECT * FROM link",
        "SELECT * FROM read_text('/etc/passwd')",
        "SELECT * FROM read_csv('text.csv')",
        "SELECT * FROM glob('/*')",
        "SELECT * FROM read_blob('/proc/self/environ')",
        "SELECT * FROM parquet_metadata('secret.parquet')",
        "SELECT * FROM read_csv('http://127.0.0.1:9/x.csv')",
        "COPY (SELECT 1) TO 'runs/c/campaign.parquet'",
        "COPY (SELECT 1) TO 'new.csv'",
        "SELECT * FROM query('COPY (SELECT 1) TO ''new.csv''')",
        "EXPLAIN ANALYZE COPY (SELECT 1) TO 'new.csv'",
        "SELECT 1; COPY (SELECT 1) TO 'new.csv'",
        "ATTACH 'new.csv'",
        "INSTALL httpfs",
        "LOAD httpfs",
        "SET enable_external_access = true",
        "PRAGMA enable_profiling",
        "EXPORT DATABASE 'new.csv'",
        "IMPORT DATABASE 'runs'",
        "SELECT * FROM sys",
        "SELEC 1",
        "",
    ] {
        let ended = ask(&scratch, &programs, &[sql, "--json"]);
        assert_eq!(
            (ended.code, ended.stderr.len()),
            (Some(2), 1),
            "{sql}: {:?} {}",
            ended.stderr,
            ended.stdout
        );
    }
    assert!(std::fs::read(&table).expect("readable") == before, "it was written");
    for name in ["new.csv", "imported"] {
        assert!(!scratch.path(name).exists(), "{name}");
    }
}

#[test]
fn scenario_a_query_ends_in_time_and_with_its_command() {
    let Some(programs) = client_environment() else { return };
    let scratch = Scratch::new();
    flown(&scratch);
    let endless = "SELECT count(*) FROM range(1000000000) a, range(1000000) b WHERE hash(a.range + b.range) = 7";
    let late = ask(&scratch, &programs, &[endless, "--time", "2"]);
    assert_eq!(late.code, Some(1));
    assert!(late.stderr[0].contains("exceeded 2 s"), "{:?}", late.stderr);
    let large = "SELECT length(list(range)) FROM range(300000000)";
    let large = ask(&scratch, &programs, &[large, "--memory", "64"]);
    assert!(matches!(large.code, Some(1 | 2)), "{:?}", large.code);
    assert!(large.stderr[0].to_lowercase().contains("memory"), "{:?}", large.stderr);

    let mut command = Command::new(program())
        .args(["query", endless, "--python"])
        .arg(programs.join("python"))
        .current_dir(scratch.folder())
        .stdout(Stdio::null())
        .spawn()
        .expect("it starts");
    let mut engine = None;
    wait_until(PATIENCE, || {
        engine = Process::children(command.id()).pop();
        engine.is_some()
    });
    let (engine, _) = engine.expect("the engine is started");
    // Until the query is running.
    std::thread::sleep(Duration::from_secs(1));
    assert!(engine.is_alive());
    command.kill().expect("it can be killed");
    command.wait().expect("it can be waited for");
    let gone = wait_until(Duration::from_secs(10), || !engine.is_alive());
    assert!(gone.is_some(), "the engine outlives its command");
}

#[test]
fn scenario_without_an_engine_it_says_what_to_install() {
    let scratch = Scratch::new();
    let path = format!("PATH={}", scratch.folder().display());
    for with_python in [false, true] {
        if with_python {
            // A Python without DuckDB: the module's exit code.
            let python = scratch.write("python3", "#!/bin/sh\nexit 4\n");
            std::fs::set_permissions(&python, std::fs::Permissions::from_mode(0o755)).expect("it can be run");
        }
        let before = ["/usr/bin/env", &path].map(Into::into);
        let ended = Call::new(&scratch, ["query", "SELECT 1"]).behind(before).run();
        assert_eq!((ended.code, ended.stderr.len()), (Some(1), 1), "{:?}", ended.stderr);
        assert!(
            ended.stderr[0].contains("`pip install duckdb pyarrow`"),
            "{:?}",
            ended.stderr
        );
    }
}
