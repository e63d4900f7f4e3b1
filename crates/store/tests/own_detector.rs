//! Detectors of the user's own on a complete run.
#![expect(clippy::unwrap_used, reason = "a test that cannot write or read its run has failed")]

use rotortwin_store::files::{MCAP_FILE, REPORT_FILE, SUMMARY_FILE, TELEMETRY_FILE};
use rotortwin_store::own_detector::{Detector, Listed, Seen, judge};
use rotortwin_store::query::{QueryError, TelemetryFile};
use rotortwin_store::{RunFolder, SpoolHeader, SpoolWriter, Summary, TelemetryRow, finalise, load_summary};
use std::collections::BTreeMap;
use std::path::Path;

#[expect(unreachable_pub, reason = "shared with the unit tests of the library")]
mod synthetic;

/// More than one row group of the telemetry; blade b from 45 s, c from 60 s, d from 75 s.
const STEPS: u64 = 66_000;

fn fly(path: &Path, steps: u64) {
    let folder = RunFolder::create(path).unwrap();
    let header = SpoolHeader {
        rotor_count: synthetic::ROTORS,
        step_ns: synthetic::STEP_NS,
        conditions: BTreeMap::from([(1, "blade b".into()), (2, "blade c".into()), (3, "blade d".into())]),
        sensor_faults: Vec::new(),
        rotor_positions_body_m: vec![[0.25, 0.0, 0.0]; synthetic::ROTORS],
        hover_thrust_n: 2.5,
        dropped_loads: Vec::new(),
    };
    let mut spool = SpoolWriter::create(&folder.spool_path(), &header).unwrap();
    (0..steps).for_each(|step| spool.push(&synthetic::row(step)).unwrap());
    spool.finish().unwrap();
    let mut summary = Summary {
        run_hash: "0123456789abcdef".into(),
        ..Summary::default()
    };
    summary.scenario.name = "made-up flight".into();
    finalise(&folder, summary).unwrap();
}

/// Gives in each step the verdict that `verdict` computes from the row.
fn listed(name: &str, steps: u64, verdict: impl Fn(&TelemetryRow) -> i32) -> Listed {
    let said = (0..steps).map(|step| {
        let row = synthetic::row(step);
        (row.sim_time_ns as f64 / 1e9, verdict(&row))
    });
    Listed::new(name, said.collect()).unwrap()
}

fn column(run: &Path, name: &str) -> Vec<f64> {
    let file = TelemetryFile::open(&run.join(TELEMETRY_FILE)).unwrap();
    let mut values = Vec::new();
    file.for_each_block(&[name], |block| {
        values.extend_from_slice(&block[0]);
        Ok::<(), QueryError>(())
    })
    .unwrap();
    values
}

/// Topic, time and content of each message, in the order of the file.
fn messages(run: &Path) -> Vec<(String, u64, Vec<u8>)> {
    let bytes = std::fs::read(run.join(MCAP_FILE)).unwrap();
    mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(|message| {
            let message = message.unwrap();
            (message.channel.topic.clone(), message.log_time, message.data.to_vec())
        })
        .collect()
}

fn files(run: &Path) -> BTreeMap<&'static str, Vec<u8>> {
    [TELEMETRY_FILE, MCAP_FILE, REPORT_FILE, SUMMARY_FILE]
        .map(|name| (name, std::fs::read(run.join(name)).unwrap()))
        .into()
}

#[test]
fn val_who_says_what_one_of_ours_says_has_its_scores() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    fly(&run, STEPS);
    let before = load_summary(&run).unwrap();
    let streams = messages(&run);
    let kept: Vec<Vec<f64>> = ["duty_3", "true_thrust_3_n", "step", "window_end"]
        .map(|name| column(&run, name))
        .into();

    let summary = judge(&run, &mut listed("copy of the T-test", STEPS, |row| row.t_test)).unwrap();
    assert_eq!(summary.intervals.len(), 4);
    let [own] = &summary.own_detectors[..] else {
        panic!("{:?}", summary.own_detectors)
    };
    for (interval, score) in summary.intervals.iter().zip(&own.scores) {
        assert_eq!(*score, interval.scores.t_test, "{}", interval.description);
        assert!(
            score.right > 0 && score.share_right < Some(1.0),
            "a case that tells nothing"
        );
    }
    assert_eq!(load_summary(&run).unwrap(), summary);

    // The flight is the same, and one column longer.
    assert_eq!(
        (&summary.intervals, &summary.run_hash),
        (&before.intervals, &before.run_hash)
    );
    let again: Vec<Vec<f64>> = ["duty_3", "true_thrust_3_n", "step", "window_end"]
        .map(|name| column(&run, name))
        .into();
    assert_eq!(kept, again);
    assert_eq!(
        column(&run, "verdict_own_copy_of_the_t_test"),
        column(&run, "verdict_t_test")
    );
    let channels = |run: &Path| {
        TelemetryFile::open(&run.join(TELEMETRY_FILE))
            .unwrap()
            .channels()
            .to_vec()
    };
    assert_eq!(channels(&run).last().unwrap().name, own.column);

    // Its changes come in between the messages that were there.
    let (said, others): (Vec<_>, Vec<_>) = messages(&run)
        .into_iter()
        .partition(|(topic, ..)| topic == "/detectors/copy_of_the_t_test");
    assert_eq!(others, streams);
    let verdicts = column(&run, "verdict_t_test");
    let changes = 1 + verdicts.windows(2).filter(|pair| pair[0] != pair[1]).count();
    assert_eq!(said.len(), changes);
    let at_first_fault = said.iter().find(|(_, time_ns, _)| *time_ns > 45_000_000_000).unwrap();
    assert!(String::from_utf8_lossy(&at_first_fault.2).contains("copy of the T-test"));
    let times: Vec<u64> = messages(&run).iter().map(|(_, time_ns, _)| *time_ns).collect();
    assert!(times.is_sorted(), "streams are in the order of time");

    let report = std::fs::read_to_string(run.join(REPORT_FILE)).unwrap();
    assert!(report.contains("copy of the T-test") && report.contains("\"verdict_own_copy_of_the_t_test\":["));
}

#[test]
fn val_a_second_judgement_replaces_the_first_and_leaves_others() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    fly(&run, 20_000);
    judge(&run, &mut listed("one", 20_000, |row| row.t_test)).unwrap();
    let once = files(&run);
    judge(&run, &mut listed("one", 20_000, |row| row.t_test)).unwrap();
    assert!(once == files(&run), "the same again gives the same files");

    judge(&run, &mut listed("two", 20_000, |_| 0)).unwrap();
    let summary = judge(&run, &mut listed("one", 20_000, |row| row.fault_label)).unwrap();
    let names: Vec<&str> = summary.own_detectors.iter().map(|own| own.name.as_str()).collect();
    assert_eq!(names, ["one", "two"]);
    for (interval, score) in summary.intervals.iter().zip(&summary.own_detectors[0].scores) {
        assert_eq!((score.right, score.share_right), (interval.windows, Some(1.0)));
    }
    assert!(column(&run, "verdict_own_two").iter().all(|verdict| *verdict == 0.0));
    assert_eq!(column(&run, "verdict_own_one"), column(&run, "fault_label"));
    let said = messages(&run)
        .into_iter()
        .filter(|(topic, ..)| topic == "/detectors/one")
        .count();
    assert_eq!(said, 1 + usize::from(synthetic::condition(50.0) != 0));
}

#[test]
fn val_what_cannot_be_judged_is_left_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    fly(&run, 20_000);
    let before = files(&run);
    let refused = |detector: &mut dyn Detector| judge(&run, detector).unwrap_err().to_string();
    let late = &mut listed("late", 20_000, |row| if row.step < 19_000 { 0 } else { 7 });
    let sentence = refused(late);
    assert!(
        sentence.contains("at 47.5 s 'late' says 7") && sentence.contains("1 to 6"),
        "{sentence}"
    );
    assert!(refused(&mut listed("T-test", 1, |_| 0)).contains("a detector of this program"));
    assert!(before == files(&run), "nothing was changed");

    let none = judge(folder.path(), &mut listed("mine", 1, |_| 0))
        .unwrap_err()
        .to_string();
    assert!(none.contains("no run here"), "{none}");
}

/// Sees no more than controller and detectors do, in the order of time.
#[test]
fn val_a_detector_sees_what_was_measured_and_commanded() {
    struct Reader(Vec<Seen>);
    impl Detector for Reader {
        fn name(&self) -> &str {
            "reader"
        }
        fn begin(&mut self, rotor_count: usize) {
            assert_eq!(rotor_count, synthetic::ROTORS);
        }
        fn step(&mut self, seen: &Seen) -> i32 {
            self.0.push(seen.clone());
            0
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    fly(&run, 5_000);
    let mut reader = Reader(Vec::new());
    judge(&run, &mut reader).unwrap();
    assert_eq!(reader.0.len(), 5_000);
    for (step, seen) in reader.0.iter().enumerate().step_by(499) {
        let row = synthetic::row(step as u64);
        let same = |seen: &[f64], row: &[f32]| seen.iter().zip(row).all(|(seen, row)| *seen == f64::from(*row));
        assert_eq!(seen.time_s, row.sim_time_ns as f64 / 1e9);
        assert!(same(&seen.position_ned_m, &row.position_ned_m));
        assert!(same(&seen.velocity_ned_m_s, &row.velocity_ned_m_s));
        assert!(same(&seen.attitude_rad, &row.attitude_rad));
        assert!(same(&seen.body_rates_rad_s, &row.body_rates_rad_s));
        assert!(same(&seen.specific_force_m_s2, &row.specific_force_m_s2));
        assert!(same(&seen.duty, &row.duty[..synthetic::ROTORS]));
        assert!(same(&[seen.battery_voltage_v], &[row.battery_voltage_v]));
        assert!(same(&seen.residuals_nms[5], &row.residuals_nms[5]));
        assert_eq!(seen.window_end, row.window_end);
    }
}
