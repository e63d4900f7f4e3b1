//! Dates as text.

/// `2026-03-01T12:34:56.789+01:00`, s since 1970; `None` for anything else.
pub(crate) fn of_rfc3339(text: &str) -> Option<f64> {
    let (date, clock) = text.split_once('T')?;
    let (clock, zone) = match clock.find(['+', '-', 'Z']) {
        Some(place) => clock.split_at(place),
        None => (clock, "Z"),
    };
    let zone_s = match zone {
        "Z" => 0.0,
        zone => {
            let (hours, minutes) = zone[1..].split_once(':')?;
            let seconds = 3600.0 * hours.parse::<f64>().ok()? + 60.0 * minutes.parse::<f64>().ok()?;
            if zone.starts_with('-') { -seconds } else { seconds }
        }
    };
    let time = humantime::parse_rfc3339_weak(&format!("{date}T{clock}")).ok()?;
    let since = time.duration_since(std::time::UNIX_EPOCH).ok()?;
    Some(since.as_secs_f64() - zone_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2026-03-01T12:00:00Z.
    const NOON_S: f64 = 1_772_366_400.0;

    #[test]
    fn val_a_header_line_is_read_with_its_zone() {
        for text in [
            "2026-03-01T12:00:00.000+00:00",
            "2026-03-01T13:00:00+01:00",
            "2026-03-01T06:30:00-05:30",
            "2026-03-01T12:00:00Z",
        ] {
            assert_eq!(of_rfc3339(text), Some(NOON_S), "{text}");
        }
        // A board without a clock.
        for text in [
            "0000-01-01T00:00:00.000+00:00",
            "",
            "T",
            "2026-03-01",
            "2026-03-01T12:00:00+1",
        ] {
            assert_eq!(of_rfc3339(text), None, "{text}");
        }
    }
}
