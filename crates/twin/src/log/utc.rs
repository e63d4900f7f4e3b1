//! Date of a flight: the calendar time contained in a log.
//!
//! | source | what says it |
//! |---|---|
//! | ULog | `time_utc_usec` of a GPS topic, from the first fix on |
//! | DataFlash | week and milliseconds of the `GPS` messages, less the leap seconds |
//! | blackbox | header line `Log start datetime` |
//! | tlog | the ground station's clock before each frame |
//! | MCAP, SQLite of ROS 2 | stamps or times of the recording, where they count from 1970 |
//! | tables | times that count from 1970 |
//!
//! Limits: leap seconds are those since 2017 (18 s), so that the time of an older log is up to 4 s late; a board that was never told the
//! date says 1970 or 2000, which is no date.

use super::report::Flown;
use super::resample::median;
use super::sources::SourceLog;

/// 2005 to 2100, s since 1970: no flight log is of another time.
const POSSIBLE_S: std::ops::Range<f64> = 1_104_537_600.0..4_102_444_800.0;
/// 1980-01-06, where GPS time begins, s since 1970.
const GPS_EPOCH_S: f64 = 315_964_800.0;
/// GPS time is ahead of UTC since 2017, s.
const LEAP_S: f64 = 18.0;
const WEEK_S: f64 = 604_800.0;

/// Of the streams of a file: seconds since 1970 at their 0 s.
pub(super) fn of_source(log: &SourceLog) -> Option<Flown> {
    let told = |(unix_s, from): (f64, &str)| {
        POSSIBLE_S.contains(&unix_s).then(|| Flown {
            unix_s,
            from: from.to_owned(),
        })
    };
    let recorded = (log.clock_s, "times of the recording, since 1970");
    let of_streams = || {
        let first = log.streams.iter().filter_map(|stream| stream.time_s.first());
        let is_absolute = first.copied().fold(f64::INFINITY, f64::min);
        POSSIBLE_S.contains(&is_absolute).then(|| Flown {
            unix_s: 0.0,
            from: "times of the table, since 1970".to_owned(),
        })
    };
    log.utc
        .and_then(told)
        .or_else(|| of_receiver(log).and_then(told))
        .or_else(|| told(recorded))
        .or_else(of_streams)
}

/// Of a table whose times count from 1970.
pub(super) fn of_times(time_s: &[f64]) -> Option<Flown> {
    time_s
        .first()
        .filter(|first| POSSIBLE_S.contains(first))
        .map(|_| Flown {
            unix_s: 0.0,
            from: "times of the table, since 1970".to_owned(),
        })
}

/// What a GPS receiver says: the middle one of the offsets of its messages, those without a date left out.
fn of_receiver(log: &SourceLog) -> Option<(f64, &'static str)> {
    let offset = |times: &[f64], unix_s: &mut dyn Iterator<Item = f64>| {
        let pairs = times.iter().zip(unix_s).filter(|(_, unix)| POSSIBLE_S.contains(unix));
        median(&mut pairs.map(|(time, unix)| unix - time).collect::<Vec<f64>>()).filter(|offset| offset.is_finite())
    };
    log.streams.iter().find_map(|stream| {
        let field = |wanted: &str| {
            let found = stream.fields.iter().find(|(name, _)| name == wanted);
            found.map(|(_, values)| values)
        };
        if let Some(micros) = field("time_utc_usec") {
            let unix = offset(&stream.time_s, &mut micros.iter().map(|micros| 1e-6 * micros));
            return unix.map(|unix| (unix, "GPS time in the log"));
        }
        let weeks = field("GWk").zip(field("GMS"));
        // Before 2014 the time of the week was in TimeMS.
        let weeks = weeks.or_else(|| field("Week").zip(field("TimeMS")));
        let (week, milliseconds) = weeks.filter(|_| stream.name == "GPS")?;
        let mut unix = week
            .iter()
            .zip(milliseconds)
            .map(|(week, milliseconds)| GPS_EPOCH_S + WEEK_S * week + 1e-3 * milliseconds - LEAP_S);
        offset(&stream.time_s, &mut unix).map(|unix| (unix, "GPS week and time in the log"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::sources::RawStream;

    /// 2026-03-01T12:00:00Z.
    const NOON_S: f64 = 1_772_366_400.0;

    fn with(name: &str, fields: &[(&str, &[f64])]) -> SourceLog {
        let fields: Vec<(String, Vec<f64>)> = fields
            .iter()
            .map(|(name, values)| ((*name).to_owned(), values.to_vec()))
            .collect();
        SourceLog {
            streams: vec![RawStream {
                name: name.to_owned(),
                time_s: vec![10.0, 11.0, 12.0],
                fields,
                ..RawStream::default()
            }],
            ..SourceLog::default()
        }
    }

    #[test]
    fn val_a_receiver_says_when_its_log_began() {
        // Before the fix the receiver reports 0, which is not a date.
        let ulog = with(
            "sensor_gps",
            &[("time_utc_usec", &[0.0, 1e6 * (NOON_S + 11.0), 1e6 * (NOON_S + 12.0)])],
        );
        assert_eq!(of_source(&ulog).expect("a date").unix_s, NOON_S);
        // Week 2408 begins on Sunday, 2026-03-01, at 0 h of GPS time.
        let noon_ms = 43_200_000.0 + 18_000.0;
        let times = [0.0, noon_ms + 11_000.0, noon_ms + 12_000.0];
        let weeks = [("GWk", &[0.0, 2408.0, 2408.0][..]), ("GMS", &times[..])];
        assert_eq!(of_source(&with("GPS", &weeks)).expect("a date").unix_s, NOON_S);
        assert_eq!(of_source(&with("BARO", &weeks)), None);
        assert_eq!(of_source(&with("GPS", &[("GWk", &[0.0; 3]), ("GMS", &[0.0; 3])])), None);
    }

    #[test]
    fn val_only_times_since_1970_are_a_date() {
        assert_eq!(of_times(&[NOON_S, NOON_S + 1.0]).expect("a date").unix_s, 0.0);
        assert_eq!(of_times(&[0.0, 1.0]), None);
        let recording = SourceLog {
            clock_s: NOON_S,
            ..SourceLog::default()
        };
        assert_eq!(of_source(&recording).expect("a date").unix_s, NOON_S);
    }
}
