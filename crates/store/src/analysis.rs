//! Statistics of a flight, computed from its telemetry: intervals of the fault schedule, verdict table, residual statistics,
//! tracking, battery.
//!
//! One pass over the rows; the summary, the report and every other table take their numbers from here.
//!
//! * **Interval**: a maximal stretch in which `fault_label`, all `rotor_condition_i` and `sensor_faults` are constant and no load is dropped.
//! * **Window**: verdicts are counted where `window_end` is 1; between window ends they are held and not counted. A window that
//!   straddles the onset of a fault counts in the interval in which it ends, although part of its samples are older.
//! * **False alarm**: a window with a fault verdict (a rotor or "unknown") that ends while no rotor is faulty. Consecutive windows
//!   are one event, even across two intervals without a fault.

use crate::spool::{Chunk, SpoolHeader};
use crate::summary::{BatteryUse, Evaluator, Interval, LossRecord, Score, Severity, Tracking};
use crate::telemetry::Column;
use rotortwin_flight_core::fdi::verdict_code::{AMBIGUOUS, HEALTHY, NOT_READY, UNKNOWN, named_rotors};

/// After this time, observers with the paper's gain of 5 /s have forgotten their initial state, s.
const SETTLE_S: f64 = 1.0;

/// Index of a column; the schema was checked when the spool was opened.
pub(crate) fn column(columns: &[Column], name: &str) -> usize {
    columns
        .iter()
        .position(|column| column.name == name)
        .expect("the schema has this column for every rotor count")
}

/// Results of [`Analysis`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Findings {
    /// Absent if there are no rows.
    pub tracking: Option<Tracking>,
    /// Absent if there are no rows.
    pub battery: Option<BatteryUse>,
    /// In chronological order, without gaps.
    pub intervals: Vec<Interval>,
}

/// Sums of one stretch of residual samples.
#[derive(Clone, Debug, Default)]
struct Moments {
    count: u64,
    /// Per component: sum of (x − shift), sum of (x − shift)², shift = first sample.
    sums: Vec<[f64; 3]>,
}

impl Moments {
    fn new(components: usize) -> Self {
        Self {
            count: 0,
            sums: vec![[0.0; 3]; components],
        }
    }

    #[inline]
    fn push(&mut self, samples: impl Iterator<Item = f64>) {
        let first = self.count == 0;
        for (sums, sample) in self.sums.iter_mut().zip(samples) {
            if first {
                sums[2] = sample;
            }
            let centred = sample - sums[2];
            sums[0] += centred;
            sums[1] += centred * centred;
        }
        self.count += 1;
    }

    fn mean(&self, component: usize) -> f64 {
        let [sum, _, shift] = self.sums[component];
        shift + sum / self.count.max(1) as f64
    }

    fn deviation(&self, component: usize) -> f64 {
        let count = self.count as f64;
        let [sum, squares, _] = self.sums[component];
        if self.count < 2 {
            0.0
        } else {
            ((squares - sum * sum / count) / (count - 1.0)).max(0.0).sqrt()
        }
    }
}

/// Rows with equal keys belong to the same interval.
#[derive(Clone, Debug, PartialEq)]
struct Key {
    label: i32,
    conditions: Vec<i32>,
    sensor_faults: u64,
    /// Number of loads dropped so far.
    dropped: usize,
}

/// The interval being read.
struct Open {
    key: Key,
    interval: Interval,
    rows: u64,
    squared_distance: f64,
    all: Moments,
    settled: Moments,
    settled_from_s: f64,
}

/// Indices of the columns read.
struct Places {
    time: usize,
    label: usize,
    faulty: usize,
    conditions: usize,
    sensor_faults: usize,
    residuals: usize,
    verdicts: [usize; 3],
    window_end: usize,
    losses: [usize; 2],
    hypothesis_count: usize,
    suspects: usize,
    reference: usize,
    position: usize,
    attitude: usize,
    setpoint: usize,
    reference_yaw: usize,
    charge: usize,
    voltage: usize,
    current: usize,
}

/// Reads rows, chunk by chunk, and produces [`Findings`].
pub struct Analysis {
    header: SpoolHeader,
    places: Places,
    step_s: f64,
    open: Option<Open>,
    done: Vec<Interval>,
    /// Per evaluator: the previous window was a false alarm.
    alarm: [bool; 3],
    rows: u64,
    last_s: f64,
    squared_position: [f64; 3],
    squared_attitude: [f64; 3],
    largest_distance: f64,
    battery: BatteryUse,
}

impl Analysis {
    /// For a spool with this header and schema.
    pub fn new(header: &SpoolHeader, columns: &[Column]) -> Self {
        let place = |name: &str| column(columns, name);
        Self {
            header: header.clone(),
            places: Places {
                time: place("time_s"),
                label: place("fault_label"),
                faulty: place("faulty_rotors"),
                conditions: place("rotor_condition_1"),
                sensor_faults: place("sensor_faults"),
                residuals: place("residual_1_arm_nms"),
                verdicts: Evaluator::ALL.map(|evaluator| place(evaluator.column())),
                window_end: place("window_end"),
                losses: [place("thrust_loss_n"), place("second_thrust_loss_n")],
                hypothesis_count: place("hypothesis_count"),
                suspects: place("suspect_rotors"),
                reference: place("reference_north_m"),
                position: place("true_position_north_m"),
                attitude: place("true_roll_rad"),
                setpoint: place("roll_setpoint_rad"),
                reference_yaw: place("reference_yaw_rad"),
                charge: place("true_state_of_charge"),
                voltage: place("true_battery_voltage_v"),
                current: place("battery_current_a"),
            },
            step_s: header.step_ns as f64 / 1e9,
            open: None,
            done: Vec::new(),
            alarm: [false; 3],
            rows: 0,
            last_s: 0.0,
            squared_position: [0.0; 3],
            squared_attitude: [0.0; 3],
            largest_distance: 0.0,
            battery: BatteryUse {
                voltage_min_v: f64::INFINITY,
                ..BatteryUse::default()
            },
        }
    }

    /// Processes the next rows.
    pub fn push(&mut self, chunk: &Chunk) {
        for row in 0..chunk.len {
            self.push_row(chunk, row);
        }
    }

    fn push_row(&mut self, chunk: &Chunk, row: usize) {
        let at = |place: usize| chunk.columns[place][row];
        let rotors = self.header.rotor_count;
        let time = at(self.places.time);

        let dropped = self.dropped_by(time);
        let same = self.open.as_ref().is_some_and(|open| {
            open.key.label == at(self.places.label) as i32
                && open.key.dropped == dropped
                && open.key.sensor_faults == at(self.places.sensor_faults) as u64
                && (0..rotors).all(|i| open.key.conditions[i] == at(self.places.conditions + i) as i32)
        });
        if !same {
            self.close(time);
            let key = Key {
                label: at(self.places.label) as i32,
                conditions: (0..rotors).map(|i| at(self.places.conditions + i) as i32).collect(),
                sensor_faults: at(self.places.sensor_faults) as u64,
                dropped,
            };
            self.open = Some(self.begin(key, at(self.places.faulty) as u64, time));
        }
        let open = self.open.as_mut().expect("opened above");

        let mut squared = 0.0;
        for axis in 0..3 {
            let error = at(self.places.position + axis) - at(self.places.reference + axis);
            self.squared_position[axis] += error * error;
            squared += error * error;
        }
        self.largest_distance = self.largest_distance.max(squared.sqrt());
        open.squared_distance += squared;
        let targets = [
            at(self.places.setpoint),
            at(self.places.setpoint + 1),
            at(self.places.reference_yaw),
        ];
        for (axis, target) in targets.into_iter().enumerate() {
            let error = wrapped(at(self.places.attitude + axis) - target);
            self.squared_attitude[axis] += error * error;
        }

        let (charge, voltage) = (at(self.places.charge), at(self.places.voltage));
        if self.rows == 0 {
            self.battery.state_of_charge_start = charge;
            self.battery.voltage_start_v = voltage;
        }
        self.battery.state_of_charge_end = charge;
        self.battery.voltage_end_v = voltage;
        self.battery.voltage_min_v = self.battery.voltage_min_v.min(voltage);
        self.battery.charge_ah += at(self.places.current) * self.step_s / 3600.0;

        let samples = (0..3 * rotors).map(|component| at(self.places.residuals + component));
        open.all.push(samples.clone());
        if time >= open.settled_from_s {
            open.settled.push(samples);
        }

        let window_end = at(self.places.window_end) > 0.5;
        open.interval.windows += u64::from(window_end);
        let suspects = at(self.places.suspects) as u64;
        let sequential = at(self.places.verdicts[Evaluator::Sequential as usize]) as i32;
        if window_end && sequential != NOT_READY {
            open.interval.severity = severity(
                sequential,
                suspects,
                at(self.places.hypothesis_count) as u32,
                self.places.losses.map(|first| core::array::from_fn(|i| at(first + i))),
            );
        }
        for (slot, evaluator) in Evaluator::ALL.into_iter().enumerate() {
            let said = Said {
                verdict: at(self.places.verdicts[slot]) as i32,
                suspects,
                is_first: open.rows == 0,
                window_end_s: window_end.then_some(time + self.step_s),
            };
            let mut score = *open.interval.scores.of(evaluator);
            count(&mut score, &mut self.alarm[slot], said, &open.interval);
            *open.interval.scores.of_mut(evaluator) = score;
        }
        open.rows += 1;
        self.rows += 1;
        self.last_s = time;
    }

    fn begin(&self, key: Key, faulty: u64, start_s: f64) -> Open {
        let components = 3 * self.header.rotor_count;
        let interval = Interval {
            start_s,
            fault_label: key.label,
            faulty_rotors: (0..self.header.rotor_count as u32)
                .filter(|i| faulty >> i & 1 == 1)
                .map(|i| i + 1)
                .collect(),
            description: self.describe(&key, faulty, start_s),
            sensor_faults: self.sensor_faults(key.sensor_faults),
            expected_verdict: key.label,
            ..Interval::default()
        };
        Open {
            key,
            interval,
            rows: 0,
            squared_distance: 0.0,
            all: Moments::new(components),
            settled: Moments::new(components),
            settled_from_s: start_s + SETTLE_S,
        }
    }

    /// Number of loads dropped by the step at `time`, s.
    fn dropped_by(&self, time: f64) -> usize {
        let loads = &self.header.dropped_loads;
        loads
            .iter()
            .take_while(|load| load.time_s <= time + 0.5 * self.step_s)
            .count()
    }

    fn sensor_faults(&self, mask: u64) -> Vec<String> {
        let name = |bit: usize| match self.header.sensor_faults.get(bit) {
            Some(name) => name.clone(),
            None => format!("sensor fault {}", bit + 1),
        };
        (0..u64::BITS as usize)
            .filter(|bit| mask >> bit & 1 == 1)
            .map(name)
            .collect()
    }

    /// Rotors that are not healthy, and the loads dropped as the interval begins.
    fn describe(&self, key: &Key, faulty: u64, start_s: f64) -> String {
        let mut parts = Vec::new();
        for (i, code) in key.conditions.iter().enumerate() {
            if *code == 0 && faulty >> i & 1 == 0 {
                continue;
            }
            let condition = match self.header.conditions.get(code) {
                Some(name) => name.clone(),
                None if *code == 0 => "faulty".to_owned(),
                None => format!("condition {code}"),
            };
            parts.push(format!("rotor {}: {condition}", i + 1));
        }
        if parts.is_empty() {
            parts.push("healthy".to_owned());
        }
        let loads = self.header.dropped_loads.iter();
        let now = loads.filter(|load| (load.time_s - start_s).abs() < 0.5 * self.step_s);
        parts.extend(now.map(|load| format!("{} kg dropped", load.mass_kg)));
        parts.join(", ")
    }

    /// Ends the open interval at `end_s`.
    fn close(&mut self, end_s: f64) {
        let Some(Open {
            mut interval,
            rows,
            squared_distance,
            all,
            settled,
            settled_from_s,
            ..
        }) = self.open.take()
        else {
            return;
        };
        interval.end_s = end_s;
        interval.position_rms_m = (squared_distance / rows.max(1) as f64).sqrt();
        let long = end_s - interval.start_s > 2.0 * SETTLE_S;
        interval.residuals_from_s = if long { settled_from_s } else { interval.start_s };
        let moments = if long { settled } else { all };
        let table = |value: &dyn Fn(usize) -> f64| {
            (0..self.header.rotor_count)
                .map(|i| [value(3 * i), value(3 * i + 1), value(3 * i + 2)])
                .collect()
        };
        interval.residual_means_nms = table(&|component| moments.mean(component));
        interval.residual_deviations_nms = table(&|component| moments.deviation(component));
        for evaluator in Evaluator::ALL {
            let windows = interval.windows;
            complete(interval.scores.of_mut(evaluator), windows);
        }
        self.done.push(interval);
    }

    /// Results of all rows.
    pub fn finish(mut self) -> Findings {
        self.close(self.last_s + self.step_s);
        if self.rows == 0 {
            return Findings::default();
        }
        let rms = |squares: f64| (squares / self.rows as f64).sqrt();
        Findings {
            tracking: Some(Tracking {
                position_rms_m: rms(self.squared_position.iter().sum()),
                position_max_m: self.largest_distance,
                position_rms_ned_m: self.squared_position.map(rms),
                attitude_rms_rad: self.squared_attitude.map(rms),
            }),
            battery: Some(self.battery),
            intervals: self.done,
        }
    }
}

/// A detector's output in one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Said {
    /// Code of the verdict.
    pub(crate) verdict: i32,
    /// Bit i: rotor i + 1 is or may be concerned.
    pub(crate) suspects: u64,
    /// The step is the first of its interval.
    pub(crate) is_first: bool,
    /// End of the step if a window ends with it, s.
    pub(crate) window_end_s: Option<f64>,
}

/// Counts a detector's output in a step of `interval`, of which only the truth is read.
///
/// * `alarm`: the detector's window before was a false alarm
pub(crate) fn count(score: &mut Score, alarm: &mut bool, said: Said, interval: &Interval) {
    let verdict = said.verdict;
    let right = is_right(verdict, said.suspects, interval);
    // A vehicle that has landed is no longer evaluated: the last verdict in the air is kept.
    if verdict != NOT_READY || said.is_first {
        score.verdict_at_end = verdict;
        score.right_at_end = right;
    }
    let Some(window_end_s) = said.window_end_s else { return };
    let label = interval.fault_label;
    match verdict {
        NOT_READY => score.not_ready += 1,
        UNKNOWN | AMBIGUOUS => score.unknown += 1,
        HEALTHY => score.healthy += 1,
        rotor => score.other_rotor += u64::from(rotor != label && rotor != pair_code(&interval.faulty_rotors)),
    }
    let since_start_s = window_end_s - interval.start_s;
    if right {
        score.right += 1;
        if label != HEALTHY && score.isolated_after_s.is_none() {
            score.isolated_after_s = Some(since_start_s);
        }
    }
    let names_fault = verdict != HEALTHY && verdict != NOT_READY;
    if names_fault && label != HEALTHY && score.detected_after_s.is_none() {
        score.detected_after_s = Some(since_start_s);
    }
    let is_alarm = names_fault && label == HEALTHY;
    score.false_alarm_windows += u64::from(is_alarm);
    score.false_alarm_events += u64::from(is_alarm && !*alarm);
    *alarm = is_alarm;
}

/// The shares of a score once its interval of `windows` windows is over.
pub(crate) fn complete(score: &mut Score, windows: u64) {
    let ready = windows - score.not_ready;
    score.share_right = (ready > 0).then(|| score.right as f64 / ready as f64);
}

/// An angle in [−π, π).
pub(crate) fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (angle + PI).rem_euclid(TAU) - PI
}

/// Numbers (from 1) of the rotors in a mask.
fn rotors_of(mask: u64) -> Vec<u32> {
    (0..32).filter(|i| mask >> i & 1 == 1).map(|i| i + 1).collect()
}

/// Verdict code of two faulty rotors, 0 for any other number of them.
fn pair_code(faulty_rotors: &[u32]) -> i32 {
    match faulty_rotors {
        [first, second] => (100 * first + second).cast_signed(),
        _ => 0,
    }
}

/// True for the expected verdict, for both names of two faulty rotors, for an ambiguous verdict whose suspects include all of several
/// faulty rotors, and for one that suspects the one faulty rotor only: a rotor that gives more has no code.
fn is_right(verdict: i32, suspects: u64, interval: &Interval) -> bool {
    let several = interval.fault_label == UNKNOWN;
    let faulty = || {
        interval
            .faulty_rotors
            .iter()
            .all(|rotor| suspects >> (rotor - 1) & 1 == 1)
    };
    verdict == interval.expected_verdict
        || several && verdict == pair_code(&interval.faulty_rotors)
        || several && verdict == AMBIGUOUS && faulty()
        || interval.fault_label > 0 && verdict == AMBIGUOUS && suspects == 1 << (interval.fault_label - 1)
}

/// Sizes of the losses that a verdict names, and who is suspected.
///
/// * `suspects`: bit i, rotor i + 1 is or may be concerned
/// * `losses`: N, ends, fraction, ends; of the first and the second rotor named
pub fn severity(verdict: i32, suspects: u64, hypothesis_count: u32, losses: [[f64; 6]; 2]) -> Severity {
    let suspect_rotors = rotors_of(suspects);
    let losses = named_rotors(verdict)
        .zip(losses)
        .map(
            |(rotor, [loss_n, low_n, high_n, share, share_low, share_high])| LossRecord {
                rotor,
                loss_n,
                interval_n: [low_n, high_n],
                share,
                interval_share: [share_low, share_high],
            },
        )
        .collect();
    Severity {
        suspect_rotors,
        hypothesis_count,
        losses,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spool::{SpoolReader, SpoolWriter};
    use crate::telemetry::TelemetryRow;
    use std::collections::BTreeMap;

    /// Sums of a few hundred decimal fractions.
    const TOLERANCE: f64 = 1e-9;
    const STEP_NS: u64 = 10_000_000;
    const WINDOW: u64 = 4;

    fn findings(rows: &[TelemetryRow]) -> Findings {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("spool");
        let header = SpoolHeader {
            rotor_count: 4,
            step_ns: STEP_NS,
            conditions: BTreeMap::from([(1, "blade b".to_owned())]),
            sensor_faults: vec!["gyro stuck".to_owned()],
            rotor_positions_body_m: Vec::new(),
            hover_thrust_n: 0.0,
            dropped_loads: Vec::new(),
        };
        let mut writer = SpoolWriter::create(&path, &header).unwrap();
        rows.iter().for_each(|row| writer.push(row).unwrap());
        writer.finish().unwrap();
        let mut reader = SpoolReader::open(&path).unwrap();
        let mut analysis = Analysis::new(&header, reader.columns());
        reader
            .for_each_chunk(|chunk| {
                analysis.push(chunk);
                Ok(())
            })
            .unwrap();
        analysis.finish()
    }

    /// `window` returns the T-test's verdict and the faulty rotors (mask) of each window.
    fn rows(windows: &[(i32, u32)]) -> Vec<TelemetryRow> {
        let mut rows = Vec::new();
        for (verdict, faulty) in windows {
            for at in 0..WINDOW {
                let step = rows.len() as u64;
                let label = match faulty.count_ones() {
                    0 => 0,
                    1 => faulty.trailing_zeros() as i32 + 1,
                    _ => -1,
                };
                let mut row = TelemetryRow {
                    step,
                    sim_time_ns: step * STEP_NS,
                    t_test: *verdict,
                    network: NOT_READY,
                    fault_label: label,
                    faulty_rotors: *faulty,
                    window_end: at == WINDOW - 1,
                    ..TelemetryRow::default()
                };
                for rotor in 0..4 {
                    row.rotor_condition[rotor] = i32::from(faulty >> rotor & 1 == 1);
                }
                rows.push(row);
            }
        }
        rows
    }

    #[test]
    fn val_verdict_table_counted_by_hand() {
        let (not_ready, unknown, healthy) = (NOT_READY, UNKNOWN, HEALTHY);
        let third = 1 << 2;
        let two = third | 1 << 3;
        let windows = [
            (not_ready, 0),
            (healthy, 0),
            (unknown, 0),
            (unknown, 0),
            (healthy, 0),
            (4, 0),
            (healthy, third),
            (unknown, third),
            (3, third),
            (4, third),
            (3, third),
            (3, two),
            (unknown, two),
            (3, 0),
        ];
        let found = findings(&rows(&windows));
        let [before, fault, several, after] = &found.intervals[..] else {
            panic!("{:#?}", found.intervals)
        };

        assert_eq!((before.start_s, before.end_s, before.windows), (0.0, 0.24, 6));
        assert_eq!(before.description, "healthy");
        let expected = crate::summary::Score {
            not_ready: 1,
            right: 2,
            share_right: Some(0.4),
            healthy: 2,
            unknown: 2,
            other_rotor: 1,
            isolated_after_s: None,
            detected_after_s: None,
            false_alarm_windows: 3,
            false_alarm_events: 2,
            verdict_at_end: 4,
            right_at_end: false,
        };
        assert_eq!(before.scores.t_test, expected);
        assert_eq!(before.scores.network.share_right, None);
        assert_eq!(before.scores.sequential.right, 6);

        assert_eq!((fault.start_s, fault.end_s, fault.windows), (0.24, 0.44, 5));
        assert_eq!(
            (fault.description.as_str(), &fault.faulty_rotors[..]),
            ("rotor 3: blade b", &[3][..])
        );
        let score = fault.scores.t_test;
        assert_eq!(
            (
                score.right,
                score.healthy,
                score.unknown,
                score.other_rotor,
                score.not_ready
            ),
            (2, 1, 1, 1, 0)
        );
        // The second window, of an unknown fault, ends with the step from 0.31 s to 0.32 s, the third one with that from 0.35 s to 0.36 s.
        assert!((score.detected_after_s.unwrap() - 0.08).abs() < TOLERANCE);
        assert!((score.isolated_after_s.unwrap() - 0.12).abs() < TOLERANCE);
        assert_eq!((score.false_alarm_windows, score.verdict_at_end), (0, 3));

        assert_eq!(several.expected_verdict, UNKNOWN);
        assert_eq!(several.description, "rotor 3: blade b, rotor 4: blade b");
        assert_eq!((several.scores.t_test.right, several.scores.t_test.other_rotor), (1, 1));

        assert_eq!(
            (
                after.scores.t_test.false_alarm_windows,
                after.scores.t_test.false_alarm_events
            ),
            (1, 1)
        );
        assert!((after.end_s - 0.56).abs() < TOLERANCE);
    }

    #[test]
    fn val_a_gain_that_is_named_without_a_code_counts() {
        let interval = |fault_label: i32, faulty_rotors: &[u32]| Interval {
            fault_label,
            expected_verdict: fault_label,
            faulty_rotors: faulty_rotors.to_vec(),
            ..Interval::default()
        };
        let right = |suspects: u64, interval: &Interval| is_right(AMBIGUOUS, suspects, interval);
        assert!(right(0b10, &interval(2, &[2])));
        assert!(!right(0b110, &interval(2, &[2])), "two suspects");
        assert!(!right(0b100, &interval(2, &[2])), "another rotor");
        assert!(!right(0b10, &interval(0, &[])), "a healthy vehicle");
        assert!(right(0b110, &interval(UNKNOWN, &[2, 3])));
    }

    #[test]
    fn val_alarm_across_two_healthy_intervals_is_one_event() {
        let mut rows = rows(&[(UNKNOWN, 0), (UNKNOWN, 0)]);
        rows[4..].iter_mut().for_each(|row| row.sensor_faults = 1);
        let found = findings(&rows);
        assert_eq!(found.intervals.len(), 2);
        assert_eq!(found.intervals[1].sensor_faults, ["gyro stuck"]);
        let events: Vec<u64> = found
            .intervals
            .iter()
            .map(|interval| interval.scores.t_test.false_alarm_events)
            .collect();
        assert_eq!(events, [1, 0]);
    }

    #[test]
    fn val_residual_statistics_leave_out_the_settling() {
        let mut rows = rows(&[(0, 0); 75]);
        for (step, row) in rows.iter_mut().enumerate() {
            // 1 s of settling, then 2 s of 1 ± 0.5.
            let settled = if step % 2 == 0 { 1.5 } else { 0.5 };
            row.residuals_nms[1][2] = if step < 100 { 9.0 } else { settled };
        }
        let interval = &findings(&rows).intervals[0];
        assert!((interval.residuals_from_s - 1.0).abs() < TOLERANCE);
        assert!((interval.residual_means_nms[1][2] - 1.0).abs() < TOLERANCE);
        // Sample deviation of 200 values ±0.5.
        let expected = 0.5 * (200.0f64 / 199.0).sqrt();
        assert!((interval.residual_deviations_nms[1][2] - expected).abs() < TOLERANCE);
        assert_eq!(interval.residual_means_nms[0][0], 0.0);

        // Short: everything counts.
        let interval = &findings(&rows[..150]).intervals[0];
        assert_eq!(interval.residuals_from_s, 0.0);
        assert!((interval.residual_means_nms[1][2] - (100.0 * 9.0 + 50.0) / 150.0).abs() < TOLERANCE);
    }

    #[test]
    fn val_tracking_and_battery_by_hand() {
        let mut rows = rows(&[(0, 0); 25]);
        for (step, row) in rows.iter_mut().enumerate() {
            row.truth.position_ned_m = [1.3, 2.4, -5.0];
            row.reference_position_ned_m = [1.0, 2.0, -5.0];
            row.truth.attitude_rad = [0.1, 0.0, 3.1];
            // 0.083… rad across the ±π seam.
            row.reference_yaw_rad = -3.1;
            row.battery_current_a = 36.0;
            row.truth.state_of_charge = 0.9 - 0.001 * step as f64;
            row.truth.battery_voltage_v = if step == 50 { 14.0 } else { 15.0 };
        }
        let found = findings(&rows);
        let tracking = found.tracking.unwrap();
        assert!((tracking.position_rms_m - 0.5).abs() < TOLERANCE && (tracking.position_max_m - 0.5).abs() < TOLERANCE);
        assert!((tracking.position_rms_ned_m[1] - 0.4).abs() < TOLERANCE);
        assert!((tracking.attitude_rms_rad[0] - 0.1).abs() < TOLERANCE);
        // The reference is an f32.
        const F32_TOLERANCE: f64 = 1e-6;
        assert!((tracking.attitude_rms_rad[2] - (std::f64::consts::TAU - 6.2)).abs() < F32_TOLERANCE);
        let battery = found.battery.unwrap();
        // 36 A for 1 s.
        assert!((battery.charge_ah - 0.01).abs() < TOLERANCE);
        assert!((battery.state_of_charge_end - 0.801).abs() < TOLERANCE);
        assert_eq!((battery.voltage_min_v, battery.voltage_end_v), (14.0, 15.0));
    }

    #[test]
    fn val_no_row_gives_nothing() {
        assert_eq!(findings(&[]), Findings::default());
    }
}
