//! A session gives the verdicts of a run's engine, and accepts nothing that a run would not.

use rotortwin_fdi_session::message::refusal_message;
use rotortwin_fdi_session::session::{LONGEST_BRIDGE, REMEMBERED};
use rotortwin_fdi_session::{Answer, Calibration, Chunk, FdiSession, Refusal, Sample, Window};
use rotortwin_flight::lockstep::{self, FlightEnd, FlightObserver, StopReason};
use rotortwin_flight::pace::Pace;
use rotortwin_flight::setup::run_setup;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_scenario::Scenario;
use rotortwin_wire::frames::FdiReport;
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};
use std::sync::OnceLock;

/// Rotor 3 gets a bad blade.
const FAULT_STEP: u64 = 2400;

#[derive(Default)]
struct Recorder {
    samples: Vec<Sample>,
    reports: Vec<FdiReport>,
}

impl FlightObserver for Recorder {
    fn sample(&mut self, sample: &rotortwin_flight::sample::Sample) -> Result<(), String> {
        let sensors = &sample.sensors;
        self.samples.push(Sample {
            position_ned_m: sensors.position_ned_m,
            velocity_ned_m_s: sensors.velocity_ned_m_s,
            attitude_rad: sensors.attitude_rad,
            body_rates_rad_s: sensors.body_rates_rad_s,
            duty: sample.command.duty,
            battery_voltage_v: sensors.battery_voltage_v,
            time_s: Some(sensors.stamp.sim_time_ns as f64 * 1e-9),
        });
        self.reports.push(sample.report);
        Ok(())
    }

    fn stop_requested(&mut self) -> Option<StopReason> {
        None
    }
}

fn scenario() -> Scenario {
    let path = format!(
        "{}/../../config/scenarios/lag-aware-reference-flight.toml",
        env!("CARGO_MANIFEST_DIR")
    );
    Scenario::load_with(
        path,
        &[
            "duration_s=8",
            "fdi.calibration_start_s=0.75",
            "fdi.calibration_end_s=4.75",
            "fault=[{time_s=6.0, rotor=3, blade='d'}]",
        ],
    )
    .expect("a good scenario")
}

/// The flight, flown once.
fn flown() -> &'static Recorder {
    static FLOWN: OnceLock<Recorder> = OnceLock::new();
    FLOWN.get_or_init(|| {
        let scenario = scenario();
        let mut simulation = scenario.simulation(7).expect("a good scenario");
        let setup = run_setup(&scenario, &simulation, 7);
        let mut link = InProcessLink::new(PidPeer::default(), FdiEnginePeer::default());
        let mut recorder = Recorder::default();
        let outcome = lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut recorder);
        assert!(matches!(outcome.end, FlightEnd::Done), "{:?}", outcome.end);
        recorder
    })
}

fn session() -> FdiSession {
    FdiSession::new(scenario().fdi_config(), 7).expect("a good configuration")
}

fn chunk(first_step: usize, count: usize) -> Chunk {
    Chunk {
        first_step: first_step as u64,
        after_gap: false,
        samples: flown().samples[first_step..first_step + count].to_vec(),
    }
}

fn feed(session: &mut FdiSession, first_step: usize, count: usize) -> Answer {
    session.feed(&chunk(first_step, count)).expect("it is taken")
}

#[test]
fn scenario_same_samples_same_bits_as_the_run() {
    let flown = flown();
    let mut session = session();
    let mut windows: Vec<Window> = Vec::new();
    // Chunks of all lengths: the results must not depend on them.
    let (mut step, mut length) = (0, 1);
    while step < flown.samples.len() {
        let count = length.min(flown.samples.len() - step);
        let answer = feed(&mut session, step, count);
        assert!(answer.notes.is_empty(), "{:?}", answer.notes);
        windows.extend(answer.windows);
        step += count;
        length = length * 2 % 997;
    }
    let recorded: Vec<&FdiReport> = flown.reports.iter().filter(|report| report.window_end != 0).collect();
    assert_eq!((windows.len(), recorded.len()), (128, 128));
    for (window, recorded) in windows.iter().zip(recorded) {
        assert_eq!(window.engine, recorded.canonical());
        let p = &window.class_probability;
        assert_eq!(p.is_empty(), recorded.network == -2 || window.obstacle.is_some());
        if let Some((class, _)) = p.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)) {
            // The probabilities are those that the verdict was made of.
            assert_eq!(i32::try_from(class), Ok(recorded.network));
            assert!((p.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{p:?}");
        }
        let done = window.report.stamp.step >= 1900 - 1;
        assert_eq!(
            window.calibration == Calibration::Done,
            done,
            "{:?}",
            window.report.stamp
        );
    }
    // This soon after the calibration, a name has to persist before it is reported.
    let waited = windows.iter().filter(|window| window.obstacle.is_some()).count();
    assert!(waited <= 12, "{waited} windows");
    let last = windows.last().expect("there are windows");
    assert_eq!((last.report.sequential, last.report.suspect_rotors), (3, 0b100));
    let named = windows
        .iter()
        .find(|window| window.report.sequential == 3)
        .expect("it is named");
    assert!(named.report.stamp.step >= FAULT_STEP, "{:?}", named.report.stamp);
}

#[test]
fn scenario_a_chunk_sent_again_changes_nothing() {
    let mut session = session();
    let first = feed(&mut session, 0, 100);
    assert!(!first.repeated);
    let again = feed(&mut session, 0, 100);
    assert_eq!(
        (again.repeated, &again.windows, again.next_step),
        (true, &first.windows, 100)
    );
    assert_eq!(session.samples(), 100);
    for k in 1..=REMEMBERED {
        feed(&mut session, 100 * k, 100);
    }
    let late = session.feed(&chunk(0, 100)).expect_err("too long ago");
    assert_eq!(
        late,
        Refusal::Past {
            expected: 100 * (REMEMBERED as u64 + 1),
            found: 0
        }
    );
    let mut other = chunk(100 * REMEMBERED, 100);
    other.samples[50].battery_voltage_v += 0.1;
    assert!(matches!(session.feed(&other), Err(Refusal::Past { .. })));
}

#[test]
fn scenario_what_is_refused_changes_nothing() {
    let mut session = session();
    feed(&mut session, 0, 200);
    let spoilt = |change: fn(&mut Sample)| {
        let mut chunk = chunk(200, 300);
        change(&mut chunk.samples[30]);
        chunk
    };
    let slow = {
        // 500 Hz: every interval alone could be jitter.
        let mut chunk = chunk(200, 300);
        for (index, sample) in chunk.samples.iter_mut().enumerate() {
            sample.time_s = Some(0.5 + 0.002 * index as f64);
        }
        chunk
    };
    for (bad, words) in [
        (
            Chunk {
                samples: Vec::new(),
                ..chunk(200, 1)
            },
            "0 samples",
        ),
        (chunk(203, 10), "expected step 200: 3 steps are missing"),
        (chunk(150, 10), "expected step 200"),
        (
            spoilt(|sample| sample.body_rates_rad_s[1] = f32::NAN),
            "step 230 (sample 31 of the chunk): body_rates_rad_s[1] is NaN",
        ),
        (
            spoilt(|sample| sample.battery_voltage_v = f32::INFINITY),
            "battery_voltage_v is inf",
        ),
        (
            spoilt(|sample| sample.duty[5] = 1.5),
            "duty[5] is 1.5, expected a fraction",
        ),
        (spoilt(|sample| sample.duty[6] = 0.5), "no such rotor"),
        (spoilt(|sample| sample.time_s = Some(0.0)), "expected 0.0025 s ± 50 %"),
        (
            spoilt(|sample| sample.time_s = sample.time_s.map(|time_s| time_s + 0.01)),
            "0.012500 s after the sample before",
        ),
        (slow, "0.002"),
    ] {
        let refusal = session.feed(&bad).expect_err(words).to_string();
        assert!(refusal.contains(words), "{refusal}");
        let message = refusal_message(bad.first_step, session.next_step(), &refusal);
        assert_eq!((message.next_step, message.refusal), (200, refusal));
    }
    // As if nothing had been: the bits of the run.
    let answer = feed(&mut session, 200, 600);
    let recorded = flown().reports[..800].iter().rfind(|report| report.window_end != 0);
    assert_eq!(
        answer.windows.last().map(|window| window.engine),
        recorded.map(|report| report.canonical())
    );
}

#[test]
fn scenario_short_gaps_are_bridged_and_long_ones_begin_again() {
    let mut session = session();
    feed(&mut session, 0, 2000);
    assert_eq!(session.calibration(), Calibration::Done);
    let after = |first: usize, count: usize| Chunk {
        after_gap: true,
        ..chunk(first, count)
    };
    let short = 2000 + LONGEST_BRIDGE as usize;
    let answer = session.feed(&after(short, 200)).expect("bridged");
    assert!(answer.notes[0].contains("extrapolated over"), "{:?}", answer.notes);
    assert_eq!(
        (session.calibration(), session.bridged_steps()),
        (Calibration::Done, LONGEST_BRIDGE)
    );
    assert!(
        answer.windows.iter().all(|window| window.report.sequential == 0),
        "{:?}",
        answer.windows
    );
    let long = short + 200 + LONGEST_BRIDGE as usize + 1;
    let answer = session.feed(&after(long, 100)).expect("begun again");
    assert!(
        answer.notes[0].contains("calibration began again"),
        "{:?}",
        answer.notes
    );
    assert_eq!((session.restarts(), session.calibration()), (1, Calibration::Noise));
    assert_eq!(session.verdicts_from_step(), long as u64 + 1900);
    assert!(answer.windows.iter().all(|window| window.report.sequential == -2));
}

#[test]
fn val_messages_carry_every_number() {
    let whole = chunk(0, 40);
    let message = whole.to_message(6);
    assert_eq!(Chunk::from_message(&message, 6), Ok(whole));
    let refused = Chunk::from_message(&message, 4).expect_err("six duties a sample");
    assert!(
        refused
            .to_string()
            .contains("FdiMeasurements.duty has 240 entries, expected 160"),
        "{refused}"
    );
    assert!(flown().samples[0].duty[6..MAX_ROTORS].iter().all(|duty| *duty == 0.0));
}
