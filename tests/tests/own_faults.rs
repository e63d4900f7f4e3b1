//! Faults of a user's own world: a rotor that gives more, a blade that drags, a loss that comes and goes, a dropped load. What the run
//! records of each, and what the second look says of it.

use rotortwin_tests::program::{Call, read_json, text};
use rotortwin_tests::scratch::{Scratch, hover};
use serde_json::Value;

/// The intervals of a hover of 40 s with these sections, each with the second look's statement and score; and what was printed.
fn flown(scratch: &Scratch, name: &str, sections: &str) -> (Vec<(Value, Value, Value)>, String) {
    let path = scratch.write(&format!("{name}.toml"), hover(name, 40.0, sections));
    let ended = Call::new(scratch, ["fly".as_ref(), path.as_os_str()])
        .with(["--link", "in-process", "--out", name])
        .run()
        .expect_code(0);
    let summary = read_json(&scratch.path(name).join("summary.json"));
    let own = summary["own_detectors"].as_array().expect("a list");
    let second = own
        .iter()
        .find(|one| one["name"] == "Second look")
        .expect("it judged the run");
    let list = |value: &Value| value.as_array().expect("a list").clone();
    let (intervals, statements, scores) = (
        list(&summary["intervals"]),
        list(&second["statements"]),
        list(&second["scores"]),
    );
    assert_eq!((statements.len(), scores.len()), (intervals.len(), intervals.len()));
    let all = intervals.into_iter().zip(statements).zip(scores);
    let all = all.map(|((interval, statement), score)| (interval, statement, score));
    (all.collect(), ended.stderr.join("\n"))
}

#[test]
fn scenario_a_rotor_that_gives_more_is_called_that() {
    let scratch = Scratch::new();
    let fault = "[[fault]]\ntime_s = 20.0\nrotor = 2\nthrust_loss_percent = -8.0\n";
    let (intervals, _) = flown(&scratch, "gain", fault);
    let [(_, before, _), (interval, after, score)] = intervals.as_slice() else {
        panic!("{intervals:#?}");
    };
    assert_eq!(before["text"], "healthy");
    assert_eq!(
        (&interval["fault_label"], &score["right_at_end"]),
        (&2.into(), &true.into())
    );
    assert_eq!(interval["description"], "rotor 2: +8 % thrust");
    let said = text(after, "/text");
    assert!(
        said.starts_with("rotor 2 gives 8.") || said.starts_with("rotor 2 gives 7."),
        "{said}"
    );
    assert_eq!(
        after["severity"]["losses"],
        Value::Array(Vec::new()),
        "a gain is no loss: {after}"
    );
}

#[test]
fn scenario_a_blade_that_drags_is_told_from_one_that_does_not() {
    let scratch = Scratch::new();
    let fault = |name: &str, drag: &str| {
        let fault = format!("[[fault]]\ntime_s = 20.0\nrotor = 3\nthrust_loss_percent = 8.0\n{drag}");
        let (intervals, _) = flown(&scratch, name, &fault);
        let (interval, statement, score) = intervals.last().expect("an interval").clone();
        assert_eq!(
            (&interval["fault_label"], &score["right_at_end"]),
            (&3.into(), &true.into()),
            "{statement}"
        );
        (
            text(&interval, "/description").to_owned(),
            text(&statement, "/text").to_owned(),
        )
    };
    let (described, said) = fault("drags", "moment_ratio_change_percent = 20.0\n");
    assert_eq!(described, "rotor 3: −8 % thrust, +20 % torque for its thrust");
    assert!(said.contains("its blade drags"), "{said}");
    let (described, said) = fault("smooth", "");
    assert_eq!(described, "rotor 3: −8 % thrust");
    assert!(!said.contains("drags"), "{said}");
}

#[test]
fn scenario_an_intermittent_loss_is_in_the_truth_while_it_acts_and_is_named() {
    let scratch = Scratch::new();
    let fault = "[[fault]]\ntime_s = 20.0\nrotor = 5\nthrust_loss_percent = 10.0\nperiod_s = 4.0\non_s = 1.0\n";
    let (intervals, _) = flown(&scratch, "intermittent", fault);
    // Healthy, then five bursts of a second with their pauses.
    assert_eq!(intervals.len(), 11);
    for (place, (interval, statement, score)) in intervals.iter().enumerate() {
        let acts = place % 2 == 1;
        let described = if acts {
            "rotor 5: −10 % thrust for 1 s in every 4 s"
        } else {
            "healthy"
        };
        assert_eq!(interval["description"], described);
        assert_eq!(interval["fault_label"], if acts { 5 } else { 0 });
        if acts {
            assert!(
                score["isolated_after_s"].as_f64().is_some_and(|s| s < 1.0),
                "{statement}"
            );
        } else {
            assert_eq!(score["right_at_end"], true, "{statement}");
        }
    }
}

#[test]
fn scenario_a_dropped_load_is_called_a_load_and_no_rotor_is_named() {
    let scratch = Scratch::new();
    for (name, place) in [("centre", ""), ("aside", "position_body_m = [0.02, -0.01, 0.05]\n")] {
        let drop = format!("[[load_drop]]\ntime_s = 20.0\nmass_kg = 0.15\n{place}");
        let (intervals, printed) = flown(&scratch, name, &drop);
        let [(_, before, _), (interval, after, score)] = intervals.as_slice() else {
            panic!("{intervals:#?}");
        };
        assert_eq!(before["text"], "healthy");
        assert_eq!(
            (&interval["start_s"], &interval["fault_label"]),
            (&20.0.into(), &0.into())
        );
        assert_eq!(interval["description"], "healthy, 0.15 kg dropped");
        assert!(printed.contains("drops a load of 0.15 kg"), "{printed}");
        let said = text(after, "/text");
        let grams: f64 = said
            .strip_prefix("healthy; ")
            .and_then(|load| load.split_once(" g ["))
            .and_then(|(grams, _)| grams.parse().ok())
            .unwrap_or_else(|| panic!("{name}: {said}"));
        assert!(
            (grams - 150.0).abs() < 8.0 && said.contains("were dropped"),
            "{name}: {said}"
        );
        assert_eq!(after["severity"]["suspect_rotors"], Value::Array(Vec::new()), "{after}");
        assert_eq!(score["right_at_end"], true, "{name}: {score}");
        assert_eq!(score["other_rotor"], 0, "{name}: {score}");
    }
}
