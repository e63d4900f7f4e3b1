//! `rotortwin reproduce` where no flight is needed: Tables 1 to 5 and the figures about the blades.

use rotortwin_tests::program::Call;
use rotortwin_tests::scratch::Scratch;
use std::ffi::OsString;

#[test]
fn scenario_settings_and_blades_need_no_flight() {
    let scratch = Scratch::new();
    let words = [
        "--table", "1", "--table", "2", "--table", "3", "--table", "4", "--table", "5", "--figure", "3", "--figure",
        "4", "--figure", "5", "--figure", "7", "--figure", "8",
    ];
    let out = scratch.path("out");
    let ended = Call::new(&scratch, ["reproduce"].map(OsString::from))
        .with(words)
        .with(["--out", out.to_str().expect("plain letters")])
        .run()
        .expect_code(0);
    let printed = &ended.stdout;
    for title in [
        "Table 1:",
        "Table 2:",
        "Table 3:",
        "Table 4:",
        "Table 5:",
        "Figure 8 in numbers",
    ] {
        assert!(printed.contains(title), "{title} is missing:\n{printed}");
    }
    let page = std::fs::read_to_string(out.join("report.html")).expect("a report");
    assert!(page.contains("every dashed line (discharged) is below every solid one"));
    for file in ["figure-07-lift.svg", "figure-08-lift.svg"] {
        let svg = std::fs::read_to_string(out.join(file)).expect("a figure");
        assert_eq!(
            svg.matches("stroke-dasharray").count(),
            if file.contains("07") { 2 } else { 8 },
            "{file}"
        );
    }
    for (file, lines) in [
        ("figure-03-bench.svg", 1),
        ("figure-04-bench.svg", 4),
        ("figure-05-bench.svg", 4),
    ] {
        let svg = std::fs::read_to_string(out.join(file)).expect("a figure");
        assert_eq!(svg.matches("h26").count(), lines, "{file}");
    }
    assert!(!out.join("numbers.csv").exists());
}

#[test]
fn scenario_equation_19_is_identified_from_one_flight() {
    let scratch = Scratch::new();
    let out = scratch.path("out");
    let ended = Call::new(&scratch, ["reproduce", "--table", "eq19", "--json"].map(OsString::from))
        .with(["--out", out.to_str().expect("plain letters")])
        .run()
        .expect_code(0);
    assert!(
        ended.stdout.contains("a_L3") && ended.stdout.contains("R²"),
        "{}",
        ended.stdout
    );
}

#[test]
fn scenario_a_photograph_cannot_be_reproduced() {
    let scratch = Scratch::new();
    let ended = Call::new(&scratch, ["reproduce", "--figure", "6"].map(OsString::from))
        .run()
        .expect_code(2);
    let said = ended.stderr.join("\n");
    assert!(said.contains("photograph"), "{said}");
}
