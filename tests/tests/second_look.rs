//! The second look of a run: sizes of losses that grow, and rotors that are healthy again, where the sequential detector takes each loss for
//! a step.

use rotortwin_tests::program::{Call, read_json};
use rotortwin_tests::scratch::{Scratch, hover};
use serde_json::Value;

/// What the second look of a run says at the end of its last interval, and the intervals that were flown.
fn at_the_end(scratch: &Scratch, name: &str, faults: &str) -> (Value, Value) {
    std::fs::write(scratch.path(&format!("{name}.toml")), hover(name, 45.0, faults)).expect("written");
    let flown = Call::new(
        scratch,
        ["fly", &format!("{name}.toml"), "--link", "in-process", "--out", name],
    )
    .run();
    let flown = flown.expect_code(0);
    let summary = read_json(&scratch.path(name).join("summary.json"));
    let own = summary["own_detectors"].as_array().expect("a list");
    let second = own
        .iter()
        .find(|one| one["name"] == "Second look")
        .expect("it judged the run");
    let statements = second["statements"].as_array().expect("a list");
    assert_eq!(statements.len(), summary["intervals"].as_array().expect("a list").len());
    let last = statements.last().expect("an interval").clone();
    assert!(flown.stdout.contains("Second look"), "{}", flown.stdout);
    (last, summary)
}

fn fault(time_s: f64, percent: f64, ramp_s: f64) -> String {
    format!("[[fault]]\ntime_s = {time_s}\nrotor = 3\nthrust_loss_percent = {percent:?}\nramp_s = {ramp_s:?}\n")
}

/// "2.2 % [2.1, 2.4]" with certainty of a loss of 10 % that had grown for a second: the run's own detector measures steps.
#[test]
fn regress_the_size_of_a_loss_that_grew_is_followed() {
    let scratch = Scratch::new();
    for (name, percent, ramp_s, from_s) in [
        ("fast", 10.0, 1.0, 30.0),
        ("five", 3.0, 5.0, 30.0),
        ("slow", 20.0, 15.0, 20.0),
    ] {
        let (said, summary) = at_the_end(&scratch, name, &fault(from_s, percent, ramp_s));
        let [loss] = said["severity"]["losses"].as_array().expect("a list").as_slice() else {
            panic!("{name}: {said}");
        };
        assert_eq!(loss["rotor"], 3, "{said}");
        let [low, high] = [0, 1].map(|end| loss["interval_share"][end].as_f64().expect("a number"));
        let truth = percent / 100.0;
        // One interval in twenty may miss; half its width more is a wrong size.
        let slack = 0.25 * (high - low);
        assert!((low - slack..high + slack).contains(&truth), "{name}: {said}");
        assert!(high - low < 0.2 * truth, "{name}: {said}");
        assert!(
            said["text"]
                .as_str()
                .is_some_and(|text| text.starts_with("rotor 3 lost ")),
            "{said}"
        );
        println!(
            "{name}: {} | sequential: {}",
            said["text"], summary["intervals"][1]["severity"]
        );
    }
}

#[test]
fn scenario_a_rotor_that_has_recovered_is_healthy_and_a_healthy_flight_has_no_alarm() {
    let scratch = Scratch::new();
    let pulse = fault(25.0, 10.0, 0.0) + &fault(27.0, 0.0, 0.0);
    let (said, summary) = at_the_end(&scratch, "pulse", &pulse);
    assert_eq!(said["text"], "healthy", "{said}");
    let own = &summary["own_detectors"][0];
    assert_eq!(own["column"], "verdict_own_second_look");
    let scores = own["scores"].as_array().expect("a list");
    assert_eq!(scores[0]["false_alarm_events"], 0, "{own}");
    assert!(
        scores[1]["isolated_after_s"].as_f64().is_some_and(|delay| delay < 1.0),
        "{own}"
    );
    assert_eq!(scores[2]["right_at_end"], true, "{own}");
}

/// In a campaign, too, if it is asked for: judged as a single run is, once, and with a coverage of sizes of its own.
#[test]
fn scenario_a_campaign_has_the_second_look_with_sizes_that_hold() {
    let scratch = Scratch::new();
    std::fs::write(
        scratch.path("grown.toml"),
        hover("grown", 40.0, &fault(25.0, 10.0, 1.0)),
    )
    .expect("written");
    let campaign =
        "name = \"grown\"\ndescription = \"losses that grow\"\nscenario = \"grown.toml\"\nseed = 9\nrepeats = 3\n";
    std::fs::write(scratch.path("campaign.toml"), campaign).expect("written");
    let words = ["campaign", "campaign.toml", "--second-look", "--out", "flown"];
    let printed = Call::new(&scratch, words).run().expect_code(0).stdout;
    assert!(printed.contains("Second look"), "{printed}");
    let summary = read_json(&scratch.path("flown/summary.json"));
    let held = |errors: &Value| ["interval_holds_truth", "flights"].map(|name| errors[name].as_u64());
    let errors = &summary["own_thrust_loss_errors"]["own_second_look"];
    assert_eq!(held(errors), [Some(3), Some(3)], "{summary:#}");
    // The sequential detector takes what has grown for a step.
    assert_eq!(held(&summary["thrust_loss_error"]), [Some(0), Some(3)], "{summary:#}");

    // One of these flights as a run has the same verdicts.
    let words = ["campaign", "campaign.toml", "--flight", "1", "--out", "one"];
    Call::new(&scratch, words).run().expect_code(0);
    let run = read_json(&scratch.path("one/summary.json"));
    let own = &run["own_detectors"][0];
    assert_eq!(own["name"], "Second look", "{own}");
    let lines = std::fs::read_to_string(scratch.path("flown/own/second_look.jsonl")).expect("written");
    let line: Value = serde_json::from_str(lines.lines().nth(2).expect("a head and three flights")).expect("JSON");
    assert_eq!(line["flight"], 1, "{line}");
    let last = own["statements"]
        .as_array()
        .and_then(|all| all.last())
        .expect("statements");
    assert_eq!(
        line["loss"]["loss_n"], last["severity"]["losses"][0]["loss_n"],
        "{line} {last}"
    );

    // Shards that were judged where they were flown have their scores in the whole.
    let words = [
        "campaign",
        "campaign.toml",
        "--shards",
        "0..1",
        "--second-look",
        "--out",
        "part",
    ];
    Call::new(&scratch, words).run().expect_code(0);
    let words = ["campaign", "merge", "campaign.toml", "part", "--out", "whole"];
    Call::new(&scratch, words).run().expect_code(0);
    assert_eq!(read_json(&scratch.path("whole/summary.json")), summary);

    // What it has judged is not judged again.
    let kept = std::fs::metadata(scratch.path("flown/own/second_look.jsonl"))
        .expect("there")
        .len();
    let again = Call::new(
        &scratch,
        ["campaign", "campaign.toml", "--second-look", "--out", "flown"],
    )
    .run();
    assert_eq!(
        again.expect_code(0).stdout.matches("Second look").count(),
        printed.matches("Second look").count()
    );
    assert_eq!(
        std::fs::metadata(scratch.path("flown/own/second_look.jsonl"))
            .expect("there")
            .len(),
        kept
    );
}
