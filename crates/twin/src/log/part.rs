//! A part of a log: some seconds, or a named segment.
//!
//! Written `LOG@35:65` (seconds of the log's own time) or `LOG@climb` (a segment of its side file), so that the good
//! part of a flight with a launch by hand or a crash can be used. `LOG@order:2-5-6-3-1-4` reads the columns of its
//! rotors in another order: rotor 1 of the vehicle file is `duty_2`. Both kinds can be combined: `LOG@35:65@order:…`.
//! Errors state the log's own clock as well as ours, where it has one.

use std::path::Path;

use super::findings::FindingKind;
use super::flight_parts::PartKind;
use super::{FlightLog, ReadOptions, checks, rotor_order};
use crate::content_hash::content_hash;

impl FlightLog {
    /// Reads `LOG`, `LOG@FROM:TO`, `LOG@SEGMENT` or `LOG@order:N-N-…`.
    ///
    /// # Errors
    /// The log is refused, or it has no such part: one sentence.
    pub fn read_part(text: &Path) -> Result<Self, String> {
        Self::read_part_with(text, &ReadOptions::default())
    }

    /// As [`FlightLog::read_part`], with options.
    ///
    /// # Errors
    /// The log is refused, or it has no such part: one sentence.
    pub fn read_part_with(text: &Path, options: &ReadOptions) -> Result<Self, String> {
        let whole = |path: &Path| Self::read_with(path, options).map_err(|error| error.to_string());
        let Some((path, part)) = text
            .to_str()
            .and_then(|text| text.rsplit_once('@'))
            .filter(|_| !text.exists())
        else {
            return whole(text);
        };
        // Several parts one after the other: `LOG@35:65@order:2-5-6-3-1-4`.
        let log = Self::read_part_with(Path::new(path), options)?;
        if let Some(list) = part.strip_prefix(rotor_order::PREFIX) {
            return log.in_stated_order(list);
        }
        if let Some(segment) = log.segments.iter().find(|segment| segment.name == part) {
            let (start_s, end_s) = (segment.start_s, segment.end_s);
            return log.part(start_s, end_s);
        }
        let bounds = part
            .split_once(':')
            .and_then(|(from, to)| Some((from.trim().parse().ok()?, to.trim().parse().ok()?)));
        let Some((start_s, end_s)) = bounds else {
            let names: Vec<&str> = log.segments.iter().map(|segment| segment.name.as_str()).collect();
            let known = if names.is_empty() {
                "this log has none".to_owned()
            } else {
                format!("its segments: {}", names.join(", "))
            };
            return Err(format!(
                "{}: expected FROM:TO in seconds or a segment after `@`, got `{part}`; {known}",
                text.display()
            ));
        };
        log.part(start_s, end_s)
    }

    /// The rows from `start_s` to `end_s`, s of the log's time, examined anew.
    ///
    /// # Errors
    /// Fewer than two rows are in it: one sentence.
    pub fn part(&self, start_s: f64, end_s: f64) -> Result<Self, String> {
        let first = self.time_s.partition_point(|t| *t < start_s);
        let last = self.time_s.partition_point(|t| *t <= end_s);
        if last < first + 2 {
            let (from, to) = (self.time_s[0], self.time_s[self.time_s.len() - 1]);
            let own = self.report.clock_start_s.map_or_else(String::new, |clock| {
                format!(
                    "; the log's own clock, {:.3} to {:.3} s, is ours plus {clock:.3} s",
                    clock + from,
                    clock + to
                )
            });
            return Err(format!(
                "{}: expected a part within its {from:.3} to {to:.3} s, got {start_s} to {end_s} s{own}",
                self.name,
            ));
        }
        let mut part = self.clone();
        part.time_s = self.time_s[first..last].to_vec();
        for values in part.columns.values_mut() {
            *values = values[first..last].to_vec();
        }
        part.name = format!("{} {start_s}–{end_s} s", self.name);
        part.source.content_hash = content_hash(format!("{}@{start_s}:{end_s}", self.source.content_hash).as_bytes());
        part.report.rows = last - first;
        checks::examine(&mut part);
        if part.says_no_flight().is_some() && self.flies_within(start_s, end_s) {
            part.report
                .findings
                .retain(|finding| finding.kind != FindingKind::NoFlight);
        }
        Ok(part)
    }

    /// True if the log as a whole shows a flight in these seconds: with take-off and landing cut away, a quiet hover looks like rest.
    fn flies_within(&self, start_s: f64, end_s: f64) -> bool {
        /// Shortest flight that counts, s.
        const LEAST_S: f64 = 0.5;
        let air = self.flight_parts(None).of(&[PartKind::Air]);
        let within = air
            .iter()
            .map(|(from, to)| (to.min(end_s) - from.max(start_s)).max(0.0));
        within.sum::<f64>() >= LEAST_S
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::names;

    fn ten_seconds() -> FlightLog {
        let time: Vec<f64> = (0..=100).map(|k| 0.1 * f64::from(k)).collect();
        let columns = [(
            "battery_voltage_v".to_owned(),
            time.iter().map(|t| 16.0 - 0.1 * t).collect(),
        )];
        FlightLog::from_columns("ten", time, columns).expect("a log")
    }

    #[test]
    fn val_a_part_has_the_rows_between_its_bounds_and_a_hash_of_its_own() {
        let whole = ten_seconds();
        let part = whole.part(2.0, 4.0).expect("inside");
        assert_eq!((part.time_s[0], part.time_s.len()), (whole.time_s[20], 21));
        assert_eq!(
            part.columns["battery_voltage_v"][0],
            whole.columns["battery_voltage_v"][20]
        );
        assert_ne!(part.source.content_hash, whole.source.content_hash);
        let refused = whole.part(20.0, 30.0).expect_err("outside");
        assert!(refused.contains("0.000 to 10.000 s, got 20 to 30 s"), "{refused}");
    }

    /// 100 Hz: 3 s at rest with the motors off, a climb to 3 m in 4 s, 30 s of hover without any wind, down again in 3 s,
    /// 3 s at rest. Where `lifts` is false the motors turn as much and nothing moves.
    fn quiet_hover(lifts: bool) -> FlightLog {
        let time: Vec<f64> = (0..4100).map(|k| 0.01 * f64::from(k)).collect();
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { time.iter().map(|t| f(*t)).collect() };
        let turns = |t: f64| f64::from(u8::from((3.0..38.0).contains(&t)));
        let lifted = |t: f64| turns(t) * f64::from(u8::from(lifts));
        // Up and down along sines: speed, and its derivative.
        let phase = |t: f64, from: f64, over: f64| ((t - from) / over).clamp(0.0, 1.0) * std::f64::consts::TAU;
        let speed = |t: f64| -0.75 * (1.0 - phase(t, 3.0, 4.0).cos()) + (1.0 - phase(t, 35.0, 3.0).cos());
        let accel = |t: f64| (speed(t + 0.005) - speed(t - 0.005)) / 0.01;
        let up = |t: f64| {
            let climbed = (0..=400)
                .map(|k| speed(3.0 + 0.01 * f64::from(k)) * f64::from(u8::from(3.0 + 0.01 * f64::from(k) <= t)));
            let sunk = (0..=300)
                .map(|k| speed(35.0 + 0.01 * f64::from(k)) * f64::from(u8::from(35.0 + 0.01 * f64::from(k) <= t)));
            0.01 * (climbed.sum::<f64>() + sunk.sum::<f64>())
        };
        let mut columns: Vec<(String, Vec<f64>)> = (1..=4)
            .map(|rotor| {
                let duty = |t: f64| turns(t) * (0.38 - 0.02 * accel(t) + 0.0005 * (f64::from(rotor as u8) * t).sin());
                (names::duty(rotor), of(&duty))
            })
            .collect();
        let still = |scale: f64| of(&|t| scale * (7.0 * t).sin());
        columns.extend(names::RATES.map(|name| (name.to_owned(), still(0.002))));
        columns.extend(names::ATTITUDE.map(|name| (name.to_owned(), still(0.0003))));
        columns.extend(names::ACCEL[..2].iter().map(|name| ((*name).to_owned(), still(0.01))));
        columns.push((
            names::ACCEL[2].to_owned(),
            of(&|t| -9.81 + lifted(t) * accel(t) + 0.01 * (9.0 * t).sin()),
        ));
        columns.extend(
            names::VELOCITY[..2]
                .iter()
                .map(|name| ((*name).to_owned(), still(0.01))),
        );
        columns.push((names::VELOCITY[2].to_owned(), of(&|t| lifted(t) * speed(t))));
        columns.push((names::POSITION[2].to_owned(), of(&|t| lifted(t) * up(t))));
        FlightLog::from_columns("hover", time, columns).expect("a log")
    }

    #[test]
    fn val_a_part_of_a_quiet_hover_is_in_the_air_and_one_of_a_vehicle_at_rest_is_not() {
        let hover = quiet_hover(true).part(10.0, 30.0).expect("inside");
        assert_eq!(hover.says_no_flight(), None);
        assert_eq!(
            hover.flight_parts(None).in_the_air().len(),
            1,
            "{:?}",
            hover.flight_parts(None).parts
        );
        // Taken out of a part as out of the whole.
        assert_eq!(hover.part(12.0, 20.0).expect("inside").says_no_flight(), None);
        let ground = quiet_hover(true).part(0.0, 2.0).expect("inside");
        assert!(ground.says_no_flight().is_some());
        let rest = quiet_hover(false).part(10.0, 30.0).expect("inside");
        assert!(
            rest.says_no_flight().is_some_and(|why| why.contains("rests")),
            "{:?}",
            rest.report.findings
        );
    }
}
