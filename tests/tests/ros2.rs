//! A flight as a ROS 2 recording, written by third-party tools, against the same flight imported directly.
//!
//! Needs rosbags and pyarrow, installed into a virtual environment under `target/`; reported as skipped without them.

use rotortwin_tests::program::{Call, Link, program};
use rotortwin_tests::python::{bytecode_folder, environment};
use rotortwin_tests::scratch::{Scratch, repository, short_flight};
use std::process::Command;

/// Versions tested together.
const PACKAGES: [&str; 2] = ["rosbags==0.11.9", "pyarrow==26.0.1"];

#[test]
fn val_a_recording_by_rosbags_is_the_flight_that_it_was_made_of() {
    let Some(programs) = environment("ros2-recording", &PACKAGES) else {
        return;
    };
    let scratch = Scratch::new();
    let scenario = scratch.write("short.toml", short_flight());
    Call::fly(&scratch, Link::InProcess, &scenario, "flown")
        .run()
        .expect_code(0);
    let output = Command::new(programs.join("python"))
        .arg(repository().join("tests/src/ros2_recording.py"))
        .arg(program())
        .arg(scratch.path("flown"))
        .arg(scratch.path(""))
        .env("PYTHONPYCACHEPREFIX", bytecode_folder())
        .output()
        .expect("it starts");
    let words = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
    assert!(output.status.success(), "{}", words.concat());
    print!("{}", words.concat());
}
