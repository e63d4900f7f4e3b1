//! `report.html` of a comparison: verdict, where, when, how much, what was assumed; one file, no network.
//!
//! Verdicts, tables and bars are plain HTML; the heat strip, the overlay and the plots against conditions are drawn by
//! `assets/compare.js` from buckets of 0.1 s (longer for long logs): means, and for the residual the lowest and highest sample as
//! well, so that no spike disappears.

use std::fmt::Write as _;

use rotortwin_store::REPORT_CSS;
use rotortwin_store::page::{Page, escape};
use serde_json::{Value, json};

use super::evaluate::{ChannelResult, ChannelVerdict, ModelOnLog};
use super::{Comparison, LogComparison, LogSeries};
use crate::predict::{CHANNELS, NAMES, UNITS};

const CSS: &str = include_str!("../../assets/compare.css");
const JS: &str = include_str!("../../assets/compare.js");

/// Shortest bucket of the plots, s.
const BUCKET_S: f64 = 0.1;
/// Most buckets of a plot.
const MOST_BUCKETS: usize = 1800;

macro_rules! put {
    ($html:expr, $($part:tt)*) => { write!($html, $($part)*).expect("a String takes everything") };
}

/// The page.
pub fn render(comparison: &Comparison, series: &[LogSeries]) -> String {
    let logs: Vec<&str> = comparison.logs.iter().map(|log| log.log.name.as_str()).collect();
    let title = format!("Comparison · {}", logs.join(", "));
    let css = format!("{REPORT_CSS}\n{CSS}");
    let data = json!({
        "channels": NAMES,
        "units": UNITS,
        "logs": comparison.logs.iter().zip(series).map(|(log, series)| payload(log, series)).collect::<Vec<_>>(),
    });
    Page {
        title: &title,
        css: &css,
        body: &body(comparison),
        data: &data.to_string(),
        js: JS,
    }
    .render()
}

fn body(comparison: &Comparison) -> String {
    let mut html = String::new();
    put!(
        html,
        "<header><div class=\"top\"><h1>Model against measurement</h1><span class=\"spacer\"></span>\
         <button type=\"button\" id=\"theme\" hidden>light / dark</button></div><p class=\"sub\">"
    );
    let models: Vec<String> = comparison
        .models
        .iter()
        .map(|model| {
            let effects = if model.effects.is_empty() {
                "no effects".to_owned()
            } else {
                model.effects.join(", ")
            };
            format!(
                "<b>{}</b> ({}; {}…)",
                escape(&model.label),
                escape(&effects),
                &model.hash[..8]
            )
        })
        .collect();
    put!(html, "{}</p></header>", models.join(" · "));
    for (place, log) in comparison.logs.iter().enumerate() {
        log_section(&mut html, place, log);
    }
    put!(
        html,
        "<footer>{}. Made without network access; works offline.</footer>",
        escape(comparison.tool)
    );
    html
}

fn log_section(html: &mut String, place: usize, log: &LogComparison) {
    put!(
        html,
        "<article data-log=\"{place}\"><h2 class=\"logname\">{} <small>{:.1} s at {:.0} Hz</small></h2>",
        escape(&log.log.name),
        log.duration_s,
        log.rate_hz
    );
    for model in &log.models {
        let class = if model.agrees { "good" } else { "bad" };
        put!(
            html,
            "<p class=\"verdictline {class}\">{}</p>",
            escape(&model.sentence())
        );
    }
    put!(
        html,
        "<noscript><p class=\"box note\">The plots of this page are drawn by a script, which this browser does not run. The verdicts \
         and tables are complete without it.</p></noscript>\
         <section class=\"drawn\"><div class=\"head\"><h2>Where and when it fails</h2><span class=\"ref\">chi²/N of each channel in \
         blocks of 5 s; click a block to look at it</span></div><div class=\"controls\"><label>model <select class=\"model\"></select></label>\
         <label>only where <select class=\"condition\"></select></label><label>from <input class=\"low\" type=\"number\" step=\"any\"></label>\
         <label>to <input class=\"high\" type=\"number\" step=\"any\"></label><button type=\"button\" class=\"clear\">all</button>\
         <span class=\"share muted\"></span></div><div class=\"strip\"></div><div class=\"scale\"></div></section>\
         <section class=\"drawn\"><div class=\"head\"><h2 class=\"overlaytitle\"></h2><span class=\"ref\">means over the bucket; shaded: ± 2 sigma \
         of such a mean by noise; light: lowest and highest sample; drag to zoom, double click for all</span></div>\
         <div class=\"overlay\"></div><div class=\"residual\"></div></section>\
         <section class=\"drawn\"><div class=\"head\"><h2 class=\"conditiontitle\"></h2><span class=\"ref\">binned means with the 95 % band of \
         pure noise</span></div><div class=\"conditions\"></div></section>"
    );
    waterfall(html, log);
    for model in log.models.iter().rev().take(1) {
        moments(html, model);
        channel_table(html, model);
    }
    honesty(html, log);
    html.push_str("</article>");
}

/// Three significant digits.
fn short(value: f64) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let decimals = (2 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    format!("{value:.decimals$}")
}

fn waterfall(html: &mut String, log: &LogComparison) {
    let Some(first) = log.models.first() else { return };
    html.push_str(
        "<section><div class=\"head\"><h2>How much</h2><span class=\"ref\">root mean square of means over 0.1 s; the mark is what \
         noise alone gives</span></div><div class=\"falls\">",
    );
    for error in &first.errors {
        let of = |model: &ModelOnLog| model.error_of(error.quantity).map_or(f64::NAN, |e| e.error);
        let most = log.models.iter().map(of).fold(error.noise, f64::max);
        put!(html, "<div class=\"fall\"><h3>{}, {}</h3>", error.quantity, error.unit);
        let share = |value: f64| (100.0 * value / most).clamp(0.0, 100.0);
        for model in &log.models {
            let value = of(model);
            put!(
                html,
                "<div class=\"rung\"><span class=\"who\">{}</span><span class=\"track\"><i style=\"width:{:.2}%\"></i>\
                 <b style=\"left:{:.2}%\"></b></span><span class=\"num\">{}</span></div>",
                escape(&model.model),
                share(value),
                share(error.noise),
                short(value)
            );
        }
        put!(
            html,
            "<div class=\"rung floor\"><span class=\"who\">noise</span><span class=\"track\"><i style=\"width:{:.2}%\"></i></span>\
             <span class=\"num\">{}</span></div></div>",
            share(error.noise),
            short(error.noise)
        );
    }
    html.push_str("</div>");
    if !first.open_loop.is_empty() {
        html.push_str(
            "<h3 class=\"tabletitle\">Open loop: the model alone, from the measured state, with the logged commands</h3><div class=\"scroll\">\
             <table class=\"small\"><thead><tr><th>after</th><th>starts</th>",
        );
        for model in &log.models {
            put!(html, "<th>{0}: m</th><th>m/s</th><th>°</th>", escape(&model.model));
        }
        html.push_str("</tr></thead><tbody>");
        for (row, open) in first.open_loop.iter().enumerate() {
            put!(html, "<tr><td>{} s</td><td>{}</td>", open.horizon_s, open.starts);
            for model in &log.models {
                if let Some(open) = model.open_loop.get(row) {
                    put!(
                        html,
                        "<td>{}</td><td>{}</td><td>{}</td>",
                        short(open.position_m),
                        short(open.velocity_m_s),
                        short(open.attitude_rad.to_degrees())
                    );
                }
            }
            html.push_str("</tr>");
        }
        html.push_str("</tbody></table></div>");
    }
    html.push_str("</section>");
}

fn moments(html: &mut String, model: &ModelOnLog) {
    if model.worst.is_empty() {
        return;
    }
    put!(
        html,
        "<section><div class=\"head\"><h2>Worst moments</h2><span class=\"ref\">{}; windows of 0.5 s, one per channel</span></div>\
         <div class=\"scroll\"><table class=\"small\"><thead><tr><th class=\"l\">time, s</th><th class=\"l\">channel</th><th>mean error</th>\
         <th>deviations</th><th class=\"l\">conditions</th></tr></thead><tbody>",
        escape(&model.model)
    );
    for moment in &model.worst {
        let conditions: Vec<String> = moment
            .conditions
            .iter()
            .filter(|(title, ..)| {
                ["forward speed", "sideways speed", "climb rate", "mean duty", "yaw rate"].contains(title)
            })
            .map(|(title, value, unit)| format!("{title} {} {unit}", short(*value)))
            .collect();
        put!(
            html,
            "<tr><td class=\"l\">{:.1} – {:.1}</td><td class=\"l\">{}</td><td>{} {}</td><td>{:.0}</td><td class=\"l\">{}</td></tr>",
            moment.start_s,
            moment.end_s,
            moment.channel,
            short(moment.error),
            moment.unit,
            moment.deviations,
            escape(&conditions.join(" · "))
        );
    }
    html.push_str("</tbody></table></div></section>");
}

fn channel_table(html: &mut String, model: &ModelOnLog) {
    put!(
        html,
        "<section><div class=\"head\"><h2>Tests of every channel</h2><span class=\"ref\">{}</span></div><p class=\"about\">chi²/N: mean square \
         of the whitened residual; slow: of its sums over 0.25 s; both 1 for pure noise. Ljung–Box: probability that white noise looks \
         this coloured. Inputs: correlation of the residual with what came before it, 0.05 s to 0.5 s, against the 99 % band; what \
         came after it is left out, because the controller feeds residuals back.</p><div class=\"scroll\"><table class=\"small\"><thead><tr>\
         <th class=\"l\">channel</th><th class=\"l\"></th><th>error</th><th>noise</th><th class=\"l\">unit</th><th>chi²/N</th><th>slow</th>\
         <th>Ljung–Box p</th><th class=\"l\">depends most on</th><th class=\"l\">follows</th></tr></thead><tbody>",
        escape(&model.model)
    );
    for channel in &model.channels {
        let (class, word) = match channel.verdict {
            ChannelVerdict::Agrees => ("good", "✓ agrees"),
            ChannelVerdict::Fails => ("bad", "✗ fails"),
            ChannelVerdict::NotTestable => ("idle", "not testable"),
        };
        put!(
            html,
            "<tr class=\"{class}\"><td class=\"l\">{}</td><td class=\"l word\">{word}</td><td>{}</td><td>{}</td><td class=\"l\">{}</td><td>{}</td>\
             <td>{}</td><td>{}</td><td class=\"l\">{}</td><td class=\"l\">{}</td></tr>",
            channel.channel,
            short(channel.smoothed_rms),
            short(channel.smoothed_noise),
            channel.unit,
            short(channel.chi2),
            short(channel.low_frequency),
            channel.ljung_box.map_or_else(
                || "–".to_owned(),
                |test| if test.p_value < 0.001 {
                    "< 0.001".to_owned()
                } else {
                    format!("{:.3}", test.p_value)
                }
            ),
            depends(channel),
            follows(channel)
        );
    }
    html.push_str("</tbody></table></div></section>");
}

fn depends(channel: &ChannelResult) -> String {
    channel
        .conditions
        .first()
        .filter(|dependence| dependence.explained >= 0.01)
        .map_or_else(String::new, |dependence| {
            format!("{} ({:.0} %)", dependence.title, 100.0 * dependence.explained)
        })
}

fn follows(channel: &ChannelResult) -> String {
    channel
        .inputs
        .first()
        .filter(|test| test.is_outside())
        .map_or_else(String::new, |test| {
            format!(
                "{} by {:.2} s: {:.2} (band {:.2})",
                test.input, test.lag_s, test.correlation, test.band_99
            )
        })
}

fn honesty(html: &mut String, log: &LogComparison) {
    let noise = &log.noise;
    put!(
        html,
        "<section class=\"honesty\"><div class=\"head\"><h2>What was assumed</h2></div><dl>\
         <dt>noise, from the log itself</dt><dd>position {} m, velocity {} m/s, attitude {} rad, rates {} rad/s, accelerometer {} m/s² (white \
         disturbance included), voltage {} V</dd>\
         <dt>timing</dt><dd>a row is the state at its time, its duty holds to the next row; half a sample off would show as a latency</dd>",
        short(noise.position_m),
        short(noise.velocity_m_s),
        short(noise.attitude_rad),
        short(noise.rates_rad_s),
        short(noise.accel_m_s2),
        short(noise.voltage_v)
    );
    for model in &log.models {
        let biases: Vec<String> = model
            .nuisances
            .rotor_bias_n
            .iter()
            .map(|bias| format!("{:+.1}", 1e3 * bias))
            .collect();
        put!(
            html,
            "<dt>fitted to this log, {}</dt><dd>lift error of the rotors {} mN, charge at the start {:.1} %</dd>",
            escape(&model.model),
            biases.join(" "),
            100.0 * model.nuisances.charge_at_start
        );
    }
    let excluded: Vec<String> = log
        .excluded
        .iter()
        .map(|e| format!("{:.1} – {:.1} s", e.start_s, e.end_s))
        .collect();
    let excluded = if excluded.is_empty() {
        "nothing".to_owned()
    } else {
        excluded.join(", ")
    };
    put!(html, "<dt>left out (ends, ground)</dt><dd>{excluded}</dd>");
    for note in &log.notes {
        put!(html, "<dt>note</dt><dd>{}</dd>", escape(note));
    }
    put!(
        html,
        "<dt>this page cannot show</dt><dd>errors that look like white noise of a sensor, as the noise is estimated from the log; what the \
         flight did not excite (a diagnosis lists it with sizes)</dd><dt>content hash of the log</dt><dd>{}</dd></dl></section>",
        escape(if log.log.hash.is_empty() {
            "made in memory"
        } else {
            &log.log.hash
        })
    );
}

/// f32, little-endian, base64.
fn packed(values: impl IntoIterator<Item = f64>) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let bytes: Vec<u8> = values
        .into_iter()
        .flat_map(|value| (value as f32).to_le_bytes())
        .collect();
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = chunk
            .iter()
            .enumerate()
            .fold(0_u32, |word, (i, byte)| word | u32::from(*byte) << (16 - 8 * i));
        for i in 0..4 {
            let letter = LETTERS[(word >> (18 - 6 * i)) as usize & 63];
            text.push(if i <= chunk.len() { char::from(letter) } else { '=' });
        }
    }
    text
}

fn payload(log: &LogComparison, series: &LogSeries) -> Value {
    let step = 1.0 / log.rate_hz;
    let samples = series.time_s.len();
    let bucket = ((BUCKET_S / step).round() as usize)
        .max(samples.div_ceil(MOST_BUCKETS))
        .max(1);
    let all = vec![true; samples];
    let times = series
        .time_s
        .chunks(bucket)
        .map(|chunk| 0.5 * (chunk[0] + chunk[chunk.len() - 1]));
    let conditions: Vec<Value> = series
        .conditions
        .iter()
        .map(|condition| {
            json!({
                "name": condition.name, "title": condition.title, "unit": condition.unit,
                "values": packed(super::statistics::block_means(&condition.values, &all, bucket)),
            })
        })
        .collect();
    let covariances = log.noise.covariances(step);
    let sigma: Vec<f64> = (0..CHANNELS)
        .map(|c| covariances[c].deviation_of_mean(bucket))
        .collect();
    // The same samples count for every model.
    let mask = |channel: usize| {
        series
            .models
            .first()
            .map_or(&[] as &[bool], |r| r.mask[channel].as_slice())
    };
    let measured: Vec<Value> = (0..CHANNELS)
        .map(|channel| match mask(channel) {
            [] => Value::Null,
            mask => packed(super::statistics::block_means(&series.measured[channel], mask, bucket)).into(),
        })
        .collect();
    let models: Vec<Value> = log
        .models
        .iter()
        .zip(&series.models)
        .map(|(model, residuals)| {
            let channels: Vec<Value> = (0..CHANNELS)
                .map(|channel| {
                    let (raw, mask) = (&residuals.raw[channel], &residuals.mask[channel]);
                    if mask.is_empty() {
                        return Value::Null;
                    }
                    let extreme = |pick: fn(f64, f64) -> f64| {
                        let of = |(values, mask): (&[f64], &[bool])| {
                            values
                                .iter()
                                .zip(mask)
                                .filter(|&(_, &m)| m)
                                .map(|(v, _)| *v)
                                .reduce(pick)
                                .unwrap_or(f64::NAN)
                        };
                        packed(raw.chunks(bucket).zip(mask.chunks(bucket)).map(of))
                    };
                    json!({
                        "mean": packed(super::statistics::block_means(raw, mask, bucket)),
                        "low": extreme(f64::min), "high": extreme(f64::max),
                    })
                })
                .collect();
            let strips: Vec<&Vec<Option<f64>>> = model.channels.iter().map(|c| &c.strip).collect();
            let first = model
                .channels
                .iter()
                .enumerate()
                .filter(|(_, c)| c.low_frequency.is_finite())
                .max_by(|a, b| a.1.low_frequency.total_cmp(&b.1.low_frequency))
                .map_or(0, |(place, _)| place);
            json!({ "label": model.model, "channels": channels, "strips": strips, "first": first })
        })
        .collect();
    json!({
        "start": series.time_s.first(), "end": series.time_s.last(), "block": super::evaluate::STRIP_BLOCK_S,
        "bucket": bucket as f64 * step, "time": packed(times), "conditions": conditions, "sigma": sigma, "measured": measured,
        "models": models,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_numbers_are_packed_as_base64() {
        // 1.0f32 is 00 00 80 3f; two of them and their padding.
        assert_eq!(packed([1.0]), "AACAPw==");
        assert_eq!(packed([1.0, 1.0]), "AACAPwAAgD8=");
        assert_eq!(packed([0.0, 0.0, 1.0]), "AAAAAAAAAAAAAIA/");
    }
}
