//! A remainder in a sentence.

use super::{Follows, FrequencyBand, Remainder, RemainderOnset};
use crate::estimation::parameters::number;

/// Frequency of which a block holds one period and a half: a range that begins there has no lower end.
const SLOW_HZ: f64 = 0.3;

/// Frequency in words.
fn hz(value: f64) -> String {
    if value < 10.0 {
        format!("{value:.1}")
    } else {
        format!("{value:.0}")
    }
}

fn band(band: &FrequencyBand) -> String {
    if band.flat {
        "alike at all frequencies, as more noise than was assumed".to_owned()
    } else if band.low_hz < SLOW_HZ {
        format!("slower than {} Hz", hz(band.high_hz.max(SLOW_HZ)))
    } else {
        format!("between {} and {} Hz", hz(band.low_hz), hz(band.high_hz))
    }
}

fn onset(onset: &RemainderOnset) -> String {
    let (before, after) = (number(onset.before), number(onset.after));
    if onset.of_mean {
        format!("steps from {before} to {after} {} at {:.1} s", onset.unit, onset.at_s)
    } else {
        let grows = if onset.after > onset.before { "grows" } else { "shrinks" };
        format!("{grows} from {before} to {after} {} at {:.1} s", onset.unit, onset.at_s)
    }
}

fn follows(one: &Follows) -> String {
    let share = 100.0 * one.r_squared;
    match one.late_s {
        Some(late_s) => format!(
            "follows the {} ({share:.0} % of its square on unseen blocks), as if it were {:.1} ms late",
            one.signal,
            1e3 * late_s
        ),
        None => format!(
            "follows {} ({share:.0} % of its square on unseen blocks)",
            with_article(&one.signal)
        ),
    }
}

fn with_article(signal: &str) -> String {
    if signal.starts_with("what ") || signal == "time" {
        signal.to_owned()
    } else {
        format!("the {signal}")
    }
}

/// In a sentence; without its log where there is only one.
pub(super) fn sentence(one: &Remainder, several: bool) -> String {
    let of = if several {
        format!(" of {}", one.log)
    } else {
        String::new()
    };
    let mut says = Vec::new();
    if let Some(line) = &one.line {
        says.push(format!(
            "periodic at {} Hz ({} Hz wide)",
            hz(line.hz),
            hz(line.width_hz)
        ));
    }
    if let Some(found) = &one.band
        && one.line.is_none()
    {
        says.push(band(found));
    }
    if let Some(seconds) = one.correlation_s {
        says.push(format!("alike over some {seconds:.2} s"));
    }
    if let Some(found) = &one.onset {
        says.push(onset(found));
    }
    says.extend(one.follows.as_ref().map(follows));
    if let Some(found) = &one.size_follows {
        says.push(format!(
            "its size varies with {} ({:.0} % of it on unseen blocks)",
            with_article(&found.signal),
            100.0 * found.r_squared
        ));
    }
    if let Some(corner) = one.quiet_above_hz {
        says.push(format!("above {} Hz less than noise, as after a low-pass", hz(corner)));
    }
    if says.is_empty() {
        says.push("no frequency, time or signal that unseen blocks confirm".to_owned());
    }
    format!(
        "{} ({}){of}: {} {}, noise {}; {}",
        one.what,
        one.channel,
        number(one.size),
        one.unit,
        number(one.noise),
        says.join("; ")
    )
}
