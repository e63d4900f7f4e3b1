//! The web page in a real browser against the real server: the twin from a log to a model that agrees, a live flight, every page checked
//! with axe.
//!
//! Needs Chromium (Debian's `chromium`) and Playwright for Python, installed into a virtual environment under `target/`; reported as
//! skipped without them.

use rotortwin_tests::disk::Disk;
use rotortwin_tests::program::program;
use rotortwin_tests::python::{bytecode_folder, client_folder, environment};
use rotortwin_tests::scratch::{Scratch, repository, short_flight};
use rotortwin_tests::server::Server;
use rotortwin_tests::skip;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Versions tested together, and our client, which a run copied as Python asks for.
fn browser_environment() -> Option<PathBuf> {
    let client = client_folder().display().to_string();
    environment(
        "web-page",
        &[
            "playwright==1.65.2",
            "axe-playwright-python==0.1.8",
            "--editable",
            &client,
        ],
    )
}

fn chromium() -> Option<PathBuf> {
    let found = [
        "/usr/bin/chromium",
        "/usr/bin/chromium-browser",
        "/usr/bin/google-chrome",
    ]
    .map(PathBuf::from)
    .into_iter()
    .find(|path| path.exists());
    if found.is_none() {
        skip("the web page in a browser: expected /usr/bin/chromium (Debian: apt-get install chromium)");
    }
    found
}

/// A heavier and larger quadrotor than those of the library, as a document.
fn a_vehicle_of_no_library(scratch: &Scratch) -> String {
    let config = repository().join("config");
    let mut text = std::fs::read_to_string(config.join("vehicles/quad-x.toml")).expect("it is shipped");
    for (from, to) in [
        ("mass_kg = 1.55 ", "mass_kg = 2.2 "),
        ("[0.0266, 0.0266, 0.0498]", "[0.035, 0.041, 0.07]"),
        ("thrust_lag_s = 0.05 ", "thrust_lag_s = 0.07 "),
        ("arm_length_m = 0.275 ", "arm_length_m = 0.33 "),
        ("moment_ratio_m = 0.016 ", "moment_ratio_m = 0.02 "),
        ("../blades", &config.join("blades").display().to_string()),
    ] {
        assert!(text.contains(from), "quad-x.toml has no `{from}`");
        text = text.replace(from, to);
    }
    scratch.write("own.toml", &text).display().to_string()
}

/// A drag that begins at 2.5 m/s: the independent simulator can fly it, and no catalogue has it.
const OF_NO_CATALOGUE: &str = "threshold-drag:drag_n_s3_m3=0.1,threshold_m_s=2.5";

/// These logs of the independent simulator, and an invalid file.
fn logs(scratch: &Scratch, wanted: &[&str]) {
    let vehicle = repository().join("config/vehicles/f550.toml").display().to_string();
    let own = a_vehicle_of_no_library(scratch);
    // A short flight at one speed cannot tell one kind of drag from another.
    let kinds: [(&str, &str, &[&str]); 9] = [
        ("drag", "excitation/2/60", &["--effect", "rotor-drag"]),
        ("drag-again", "excitation/3/60", &["--effect", "rotor-drag"]),
        ("healthy", "excitation/2/60", &[]),
        (
            "two",
            "excitation/2/60",
            &["--effect", "rotor-drag", "--effect", "motor-time-constant"],
        ),
        ("untold", "helix/4/12", &["--effect", "rotor-drag:drag_n_s_m=0.04"]),
        ("strange", "excitation/31/60", &["--effect", OF_NO_CATALOGUE]),
        ("strange-again", "waypoint/32/60", &["--effect", OF_NO_CATALOGUE]),
        ("own-1", "excitation/11/60", &["--effect", "rotor-drag"]),
        ("own-2", "excitation/12/60", &["--effect", "rotor-drag"]),
    ];
    for (name, flight, more) in kinds.into_iter().filter(|(name, ..)| wanted.contains(name)) {
        let out = scratch.path(&format!("{name}.parquet")).display().to_string();
        let mut parts = flight.split('/');
        let flown = if name.starts_with("own") { &own } else { &vehicle };
        let mut words = vec!["blind", "generate", "--model", flown, "--out", &out];
        for option in ["--flight", "--seed", "--duration-s"] {
            words.extend([option, parts.next().expect("three parts")]);
        }
        words.extend(more);
        made(name, &words);
    }
    std::fs::write(scratch.path("picture.csv"), b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01").expect("it can be written");
}

/// A scenario of `web_page.py`, with the logs that it drops.
fn passes(scenario: &str, wanted: &[&str]) {
    let Some(chromium) = chromium() else { return };
    let Some(programs) = browser_environment() else {
        return;
    };
    let scratch = Scratch::new();
    logs(&scratch, wanted);
    // A small disk for the scenario that fills it.
    let disk = if scenario == "full" {
        let Some(disk) = Disk::new(scratch.path("disk"), "48m") else {
            return;
        };
        Some(disk)
    } else {
        None
    };
    let data = disk
        .as_ref()
        .map_or_else(|| scratch.path(""), |disk| disk.path().to_owned());
    let server = Server::start(&data.join("data"));
    let output = Command::new(programs.join("python"))
        .arg(repository().join("tests/src/web_page.py"))
        .arg(server.url())
        .arg(chromium)
        .arg(scratch.path(""))
        .arg(scenario)
        .env("PYTHONPYCACHEPREFIX", bytecode_folder())
        .env("ROTORTWIN", program())
        .env_remove("DATABASE_URL")
        .output()
        .expect("it starts");
    let words = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
    assert!(output.status.success(), "{scenario}: {}", words.concat());
    print!("{}", words.concat());
}

/// Runs a command that must succeed.
fn made(what: &str, words: &[&str]) {
    let output = Command::new(program()).args(words).output().expect("it starts");
    assert!(
        output.status.success(),
        "{what}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// Makes every kind of report, each in a folder of that name, with the texts it must contain.
fn reports(scratch: &Scratch) {
    let at = |name: &str| scratch.path(name).display().to_string();
    let vehicle = repository().join("config/vehicles/f550.toml").display().to_string();
    let (drag, healthy) = (at("drag.parquet"), at("healthy.parquet"));
    let rotor = scratch.write("short.toml", short_flight()).display().to_string();
    let campaign = "name = 'c'\ndescription = 'of <b>the</b> system tests'\nscenario = 'short.toml'\nseed = 5\nflights = 6\n\
                    [[axis]]\nname = 'rotor'\nkey = 'fault[0].rotor'\nrotors = true\npick = 'any'\n\
                    [operating_curve]\nevidence_nats = [15.0, 40.0]\n";
    let campaign = scratch.write("c.toml", campaign).display().to_string();
    let stand = repository()
        .join("crates/twin/tests/data/strawson/a1_7.csv")
        .display()
        .to_string();
    std::fs::create_dir(scratch.path("fit")).expect("it can be made");
    let fit = at("fit/report.html");
    let (first, last) = (format!("{drag}@0:40"), format!("{drag}@40:60"));
    let models = at("models");
    // Name, command, least number of pictures and tables by their selectors, words on the page, words without scripts.
    type Kind<'a> = (&'a str, Vec<&'a str>, &'a [(&'a str, usize)], &'a [&'a str], &'a str);
    const PLOT: &str = "figure.plot canvas";
    let identified = at("identification/mine.toml");
    std::fs::create_dir(scratch.path("identification")).expect("it can be made");
    // Three healthy flights, and one with a propeller that has lost some of its thrust.
    let flights = [1, 2, 3, 4].map(|flight| at(&format!("flight-{flight}.parquet")));
    for (seed, out) in (1..).zip(&flights) {
        let seed = seed.to_string();
        let mut words = vec![
            "blind",
            "generate",
            "--duration-s",
            "40",
            "--flight",
            "waypoint",
            "--seed",
            &seed,
        ];
        words.extend(["--out", out]);
        if seed == "4" {
            words.extend(["--effect", "rotor-thrust-scale:rotor=4,share=-0.06"]);
        }
        made("a flight", &words);
    }
    let [first_healthy, second_healthy, third_healthy, worn] = flights.each_ref();
    for folder in ["fdi-log", "fleet"] {
        std::fs::create_dir(scratch.path(folder)).expect("it can be made");
    }
    let (judged, shown, fleet) = (at("fdi-log/report.html"), at("fleet/report.html"), at("vehicles"));
    let all = [
        &["fleet", "add", "hexa", "--fleet", &fleet, "--model", &vehicle],
        flights.each_ref().map(String::as_str).as_slice(),
    ]
    .concat();
    made("fleet add", &all);
    let kinds: [Kind<'_>; 12] = [
        (
            "baseline",
            vec![
                "diagnose",
                worn,
                "--model",
                &vehicle,
                "--baseline",
                first_healthy,
                second_healthy,
                third_healthy,
            ],
            &[(PLOT, 8)],
            &[
                "The flight: measured against model",
                "Command of each motor",
                "Against the healthy flights",
                "Thrust command of the rotors over the healthy mean",
                "(rotor 4)",
                "could not be considered",
            ],
            "healthy flights vary by",
        ),
        (
            "fdi-log",
            vec!["fdi-log", worn, first_healthy, "--model", &vehicle, "--report", &judged],
            &[(PLOT, 16)],
            &[
                "The flight: measured against model",
                "Vibration: gyroscope",
                "flight-4.parquet",
                "flight-1.parquet",
                "Verdict:",
                "Verdicts of the sequential detector",
                "windows decided",
                "no classifier was named",
            ],
            "Judged",
        ),
        (
            "fleet",
            vec!["fleet", "show", "hexa", "--fleet", &fleet, "--report", &shown],
            &[(PLOT, 1)],
            &[
                "4 flights",
                "No rotor deviates significantly",
                "Loss of each rotor against the first flights",
                "loss over flights",
                "flight-4.parquet",
            ],
            "hexa",
        ),
        (
            "reproduce",
            vec!["reproduce", "--table", "1", "--table", "3", "--figure", "7"],
            &[("img.paper", 1), ("table", 3)],
            &[
                "Table 1: lift of the blades",
                "Table 3: fault signatures",
                "Choices the paper leaves open",
                "Lift over duty, healthy blade",
            ],
            "Table 1: lift of the blades",
        ),
        (
            "identification",
            vec![
                "vehicle",
                "from-log",
                &drag,
                "--mass",
                "1.55",
                "--arm",
                "0.275",
                "--frame",
                "hexa-cw-x",
                "--held-out",
                "--out",
                &identified,
            ],
            &[(PLOT, 8)],
            &[
                "The flight: measured against model",
                "Command of each motor",
                "constants are known",
                "What is known, and from where",
                "what would make it better",
                "in the air",
                "how the vehicle begins to roll",
                "rotor 6",
            ],
            "95 % interval",
        ),
        (
            "comparison",
            vec!["compare", &drag, &healthy, "--model", &vehicle],
            &[(PLOT, 9), (".bars", 12)],
            &[
                "forward specific force (fx)",
                "How much: drag",
                "Open loop",
                "Not visible here",
            ],
            "drag: ",
        ),
        (
            "diagnosis",
            vec!["diagnose", &drag, "--model", &vehicle],
            &[(PLOT, 10)],
            &[
                "Rotor drag",
                "with what was found",
                "in the air",
                "Trajectory from above",
                "Vibration: accelerometer",
                "held-out",
                "could not be considered",
                "ln Bayes factor",
            ],
            "Not considered",
        ),
        (
            "improvement",
            vec![
                "improve",
                &first,
                "--held-out",
                &last,
                "--model",
                &vehicle,
                "--models",
                &models,
                "--yes",
            ],
            &[(".bars", 8), ("table", 4)],
            &[
                "Rotor drag",
                "fitted",
                "held out: no fit has seen it",
                "The last diagnosis",
            ],
            "the vehicle as given",
        ),
        (
            "run",
            vec!["fly", &rotor],
            &[(PLOT, 12)],
            &[
                "rotor 3",
                "no network loaded",
                "Position",
                "Residuals in numbers",
                "Normal plot of residual",
            ],
            "2400 steps",
        ),
        (
            "campaign",
            vec!["campaign", &campaign],
            &[(PLOT, 1)],
            &[
                "c",
                "of <b>the</b> system tests",
                "Confusion matrix, sequential",
                "hash of all flights",
            ],
            "6 of 6 flights",
        ),
        (
            "blind",
            vec!["blind", "--preset", "singles", "--n", "2", "--duration-s", "40"],
            &[("table", 5)],
            &["right, or correctly not testable", "Every case", "ln evidence"],
            "2 cases",
        ),
        (
            "fit",
            vec!["fit", "thrust", &stand, "--report", &fit],
            &[(PLOT, 2)],
            &["ΔAICc", "Residual of", "best"],
            "held out",
        ),
    ];
    for (name, mut words, least, says, summary) in kinds {
        let out = at(name);
        if !["fit", "identification", "fdi-log", "fleet"].contains(&name) {
            words.extend(["--out", &out]);
        }
        made(name, &words);
        if name == "identification" {
            let beside = Path::new(&identified).with_extension("report.html");
            std::fs::rename(beside, scratch.path("identification/report.html")).expect("it was written");
        }
        let expected = serde_json::json!({ "says": says, "least": least, "summary": summary });
        std::fs::write(scratch.path(&format!("{name}.json")), expected.to_string()).expect("it can be written");
    }
}

#[test]
fn scenario_every_report_opens_from_the_disk_and_prints() {
    let Some(chromium) = chromium() else { return };
    let Some(programs) = browser_environment() else {
        return;
    };
    let scratch = Scratch::new();
    logs(&scratch, &["drag", "healthy"]);
    reports(&scratch);
    let output = Command::new(programs.join("python"))
        .arg(repository().join("tests/src/report_page.py"))
        .arg(chromium)
        .arg(scratch.path(""))
        .env("PYTHONPYCACHEPREFIX", bytecode_folder())
        .output()
        .expect("it starts");
    let words = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
    assert!(output.status.success(), "{}", words.concat());
    print!("{}", words.concat());
}

#[test]
fn scenario_a_hidden_effect_is_named_added_and_undone_by_mouse() {
    passes("loop", &["drag", "drag-again"]);
}

#[test]
fn scenario_a_cell_of_a_campaign_leads_to_its_flights_and_a_flight_to_its_run() {
    passes("cells", &[]);
}

#[test]
fn scenario_a_cell_of_a_blind_bench_leads_to_its_cases_and_a_case_to_its_log() {
    passes("bench", &[]);
}

#[test]
fn scenario_a_run_copied_as_curl_python_or_command_is_the_same_run() {
    passes("copies", &[]);
}

#[test]
fn scenario_sessions_of_detectors_are_shown_as_they_are_fed() {
    passes("monitor", &[]);
}

#[test]
fn scenario_documents_and_forms_say_what_is_wrong_where_it_is_typed() {
    passes("editor", &[]);
}

#[test]
fn scenario_a_table_of_another_program_is_read_once_its_columns_are_chosen() {
    passes("table", &["healthy"]);
}

#[test]
fn scenario_logs_of_other_programs_are_let_go_over_the_page() {
    passes("formats", &[]);
}

/// What docs/web.md states of a quiet machine; it prints each figure with its goal.
#[test]
#[ignore = "a measurement: cargo test --release -p rotortwin-tests --test web -- --ignored --nocapture bench_"]
fn bench_what_is_promised_of_a_quiet_machine() {
    passes("promised", &["drag", "drag-again", "untold"]);
}

#[test]
fn scenario_runs_are_found_by_vehicle_verdict_and_day() {
    passes("filters", &[]);
}

#[test]
fn scenario_a_branch_of_a_model_is_begun_left_and_taken_up_again() {
    passes("branches", &["drag"]);
}

#[test]
fn scenario_a_run_is_forked_verified_and_compared_and_a_log_is_judged() {
    passes("clicks", &[]);
}

#[test]
fn scenario_a_blade_that_breaks_is_named_and_dated_over_the_flight() {
    passes("over_time", &[]);
}

#[test]
fn scenario_an_effect_shows_what_it_does_as_large_as_the_slider_says() {
    passes("sandbox", &[]);
}

#[test]
fn scenario_a_seed_beyond_two_to_the_53_is_exact() {
    passes("seeds", &[]);
}

#[test]
fn scenario_pages_with_content_are_accessible_and_fit_a_telephone() {
    passes("filled", &["drag"]);
}

#[test]
fn scenario_forms_findings_and_sign_in_are_accessible_and_fit_a_telephone() {
    passes("states", &["healthy", "drag", "strange", "untold", "own-1"]);
}

#[test]
fn scenario_a_run_of_the_server_is_compared_and_its_effect_is_named_and_added() {
    passes("of_a_run", &["healthy"]);
}

#[test]
fn scenario_an_effect_of_no_catalogue_is_proposed_added_and_undone_by_mouse() {
    passes("strange", &["strange", "strange-again"]);
}

#[test]
fn scenario_a_healthy_flight_agrees_and_a_file_that_is_no_log_is_refused() {
    passes("healthy", &["healthy"]);
}

#[test]
fn scenario_a_vehicle_is_identified_from_the_log_and_kept() {
    passes("vehicle", &["healthy"]);
}

#[test]
fn scenario_a_vehicle_of_no_library_is_made_from_its_log_calibrated_and_compared() {
    passes("stranger", &["own-1", "own-2"]);
}

#[test]
fn scenario_the_manoeuvre_that_tells_two_effects_apart_is_found_and_flown() {
    passes("untold", &["untold"]);
}

#[test]
fn scenario_two_hidden_effects_are_two_steps_down() {
    passes("steps", &["two"]);
}

#[test]
fn scenario_exchanged_axes_motors_and_a_wrong_unit_are_repaired_by_a_click() {
    passes("repair", &["healthy"]);
}

#[test]
fn scenario_a_job_in_any_stage_ends_soon_after_cancel() {
    passes("cancel", &["drag", "untold"]);
}

#[test]
fn scenario_files_that_are_no_logs_get_a_sentence_and_text_stays_text() {
    passes("strangers", &["healthy"]);
}

#[test]
fn scenario_an_ended_session_asks_for_the_token_and_goes_on() {
    passes("session", &[]);
}

#[test]
fn scenario_pages_of_other_sites_read_nothing_and_make_nothing() {
    passes("foreign", &[]);
}

#[test]
fn scenario_ten_thousand_runs_are_usable() {
    passes("many", &[]);
}

#[test]
fn scenario_the_loop_goes_by_keyboard_alone() {
    passes("keyboard", &[]);
}

#[test]
fn scenario_a_flight_is_shown_while_it_flies() {
    passes("live", &[]);
}

#[test]
fn scenario_a_job_that_waits_says_what_the_server_is_working_on() {
    passes("waits", &[]);
}

#[test]
fn scenario_a_flight_at_real_time_is_shown_as_it_flies_and_a_reload_shows_all_of_it() {
    passes("behind", &[]);
}

#[test]
fn scenario_eight_tabs_on_one_flight_answer_clicks_and_read_one_stream() {
    passes("tabs", &[]);
}

#[test]
fn scenario_a_killed_server_is_named_and_no_event_is_missed_or_comes_twice() {
    passes("killed", &[]);
}

#[test]
fn scenario_a_full_disk_is_said_where_it_was_asked_and_with_room_all_goes_on() {
    passes("full", &["drag"]);
}

#[test]
fn scenario_a_long_flight_of_many_channels_is_scrubbed_without_waiting() {
    passes("scrub", &[]);
}

#[test]
fn scenario_every_page_is_accessible_and_fits_a_telephone() {
    passes("pages", &[]);
}
