//! Files that are not logs but pretend to be: each is rejected in one sentence, quickly, and before it has taken
//! memory.

use rotortwin_twin::log::{FlightLog, MAX_COLUMNS, ReadOptions};
use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What the reading of all of them may take at the most, the files' own bytes (60 MB at a time) included.
const MOST_MEMORY: u64 = 400 << 20;
/// What the reading of one of them may take on a busy machine.
const MOST_TIME: Duration = Duration::from_secs(20);

/// Most memory that this process has ever had, bytes.
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("/proc is mounted");
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))
        .expect("the kernel counts it");
    let kilobytes: u64 = line.trim().trim_end_matches(" kB").parse().expect("a number");
    kilobytes << 10
}

fn refusal(name: &str, bytes: &[u8]) -> String {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let file = folder.join(name);
    std::fs::write(&file, bytes).expect("it can be written");
    let begun = Instant::now();
    let read = FlightLog::read_with(&file, &ReadOptions::default());
    let took = begun.elapsed();
    std::fs::remove_file(&file).expect("it is there");
    assert!(took < MOST_TIME, "{name} took {took:?}");
    read.err().unwrap_or_else(|| panic!("{name} was taken")).to_string()
}

/// A ULog message.
fn message(log: &mut Vec<u8>, kind: u8, payload: &[u8]) {
    log.extend(u16::try_from(payload.len()).expect("it is short").to_le_bytes());
    log.push(kind);
    log.extend(payload);
}

fn ulog() -> Vec<u8> {
    b"ULog\x01\x12\x35\x01\0\0\0\0\0\0\0\0".to_vec()
}

#[test]
fn regress_files_that_would_take_all_memory_are_refused() {
    // A header of 15 million columns: 2.3 GB when each got its place before they were counted.
    let header = format!("time_s{}\n0\n", ",x".repeat(15_000_000));
    let said = refusal("columns.csv", header.as_bytes());
    assert!(said.contains(&format!("more than {MAX_COLUMNS} columns")), "{said}");
    drop(header);
    let row = format!("time_s,roll_rad\n0,0\n1{}\n", ",".repeat(30_000_000));
    let said = refusal("cells.csv", row.as_bytes());
    assert!(
        said.contains("row 2 has 3 or more cells; the header has 2 columns"),
        "{said}"
    );
    drop(row);

    // 14 MB of subscriptions to one topic: 3 GB when each got the columns of the topic.
    let mut log = ulog();
    let fields: String = (0..200).map(|field| format!("float value_{field};")).collect();
    message(&mut log, b'F', format!("many:uint64_t timestamp;{fields}").as_bytes());
    for number in 0..1_400_000_u32 {
        let [low, high, ..] = number.to_le_bytes();
        message(&mut log, b'A', &[&[0, low, high], b"many".as_slice()].concat());
    }
    let said = refusal("subscriptions.ulg", &log);
    assert!(said.contains("more than"), "{said}");

    // Types of types without a number: nothing to keep, and 4000⁷ of them to look at.
    let mut log = ulog();
    for depth in 0..7 {
        message(&mut log, b'F', format!("t{depth}:t{}[4000] a;", depth + 1).as_bytes());
    }
    message(&mut log, b'F', b"t7:");
    message(&mut log, b'A', b"\0\0\0t0");
    let said = refusal("nested.ulg", &log);
    assert!(said.contains("no field of this log"), "{said}");

    let mut log = ulog();
    for number in 0..2_000_000_u32 {
        message(&mut log, b'F', format!("t{number}:float a;").as_bytes());
    }
    let said = refusal("formats.ulg", &log);
    assert!(said.contains("message formats"), "{said}");

    let mut log = ulog();
    message(&mut log, b'F', b"t:float a;");
    for number in 0..1_000_000_u32 {
        let key = format!("float P{number}");
        let length = u8::try_from(key.len()).expect("it is short");
        message(
            &mut log,
            b'P',
            &[&[length], key.as_bytes(), &1.0_f32.to_le_bytes()].concat(),
        );
    }
    let said = refusal("parameters.ulg", &log);
    assert!(said.contains("parameters"), "{said}");

    // A stream for each instance of each message.
    let mut text = String::from(
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 1, 9, BAT, QBf, TimeUS,Instance,Volt\n",
    );
    for instance in 0..1_000_000 {
        writeln!(text, "BAT, {instance}, {instance}, 1").expect("it can be written");
    }
    let said = refusal("instances.log", text.as_bytes());
    assert!(said.contains("subscriptions and instances"), "{said}");
    drop(text);

    // An event of a Crazyflie's log with as many variables as two bytes can say, many times.
    let mut log = vec![0xbc];
    log.extend(2_u16.to_le_bytes());
    log.extend(u16::MAX.to_le_bytes());
    for event in 0..100_u16 {
        log.extend(event.to_le_bytes());
        log.extend(b"e\0");
        log.extend(u16::MAX.to_le_bytes());
        for _ in 0..u16::MAX {
            log.extend(b"v(b)\0");
        }
    }
    let said = refusal("variables", &log);
    assert!(said.contains("variables") || said.contains("numbers"), "{said}");
    drop(log);

    // Blackbox frames of one byte, each a row of thousands of fields: 5 GB of numbers in 250 kB.
    let count = 2500;
    let list = |value: &str| vec![value; count].join(",");
    let names: Vec<String> = (0..count).map(|field| format!("f{field}")).collect();
    let mut log = format!(
        "H Product:Blackbox flight data recorder\nH Data version:2\nH Field I name:time,{}\nH Field I encoding:1,{}\n\
         H Field I predictor:0,{}\nH Field P encoding:9,{}\nH Field P predictor:6,{}\n",
        names.join(","),
        list("9"),
        list("0"),
        list("9"),
        list("0")
    )
    .into_bytes();
    log.extend(b"I\x05");
    log.extend(vec![b'P'; 250_000]);
    let said = refusal("frames.bbl", &log);
    assert!(said.contains("more samples"), "{said}");

    let peak = peak_memory();
    assert!(peak < MOST_MEMORY, "{} MB", peak >> 20);
}

#[test]
fn val_a_clock_that_jumps_by_years_is_not_resampled() {
    let log = FlightLog::from_columns("jump", vec![0.0, 1.0, 3e9], [("roll_rad".to_owned(), vec![0.0; 3])]);
    let refused = log.expect("a log").resampled(400.0).expect_err("10¹² rows");
    assert!(refused.contains("cells") && refused.contains("jump"), "{refused}");
}
