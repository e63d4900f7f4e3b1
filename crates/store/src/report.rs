//! `report.html`: the run on one page, with the paper's figures; one file, no network, light and dark, printable.
//!
//! Facts, results and the verdict table are plain HTML, readable without scripts. The figures are drawn in the browser by uPlot
//! (inlined with its licence) from the thinned-out numbers of [`Plots`], embedded as f32 in base64.
//!
//! The looks stand in `assets/report.css`, the drawing in `assets/report.js`, the frame in `assets/report.html`.

use crate::files::{FIGURES_FOLDER, MCAP_FILE, SUMMARY_FILE, TELEMETRY_FILE};
use crate::page::{Page, escape};
use crate::plots::{Plots, Sample, normal_grid, normal_line, scale_from_s};
use crate::summary::{Evaluator, Interval, Score, Status, Summary, verdict_text};
use rotortwin_flight_core::fdi::verdict_code::{HEALTHY, UNKNOWN};
use serde_json::{Value, json};
use std::fmt::Write as _;

const CSS: &str = include_str!("../assets/report.css");
const JS: &str = include_str!("../assets/report.js");
/// Share of windows from which a verdict on a fault counts as good.
const GOOD_SHARE: f64 = 0.9;

/// The page; `plots` is absent if no step was recorded.
pub(crate) fn render(summary: &Summary, plots: Option<&Plots>) -> String {
    let title = format!("{} · {}", summary.scenario.name, summary.run);
    let body = body(summary, plots);
    let data = payload(summary, plots).to_string();
    Page {
        title: &title,
        css: CSS,
        body: &body,
        data: &data,
        js: JS,
    }
    .render()
}

/// An integer in groups of three.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut out = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(digit);
    }
    out
}

/// A number with the decimals that three significant digits need.
fn short(number: f64) -> String {
    let magnitude = number.abs();
    match magnitude {
        m if !m.is_finite() => "–".to_owned(),
        m if m >= 1000.0 => grouped(number.round() as u64),
        m if m >= 100.0 => format!("{number:.0}"),
        m if m >= 10.0 => format!("{number:.1}"),
        m if m >= 0.1 || m == 0.0 => format!("{number:.2}"),
        _ => format!("{number:.3}"),
    }
}

fn plural(count: u64, one: &str, many: &str) -> String {
    format!("{} {}", grouped(count), if count == 1 { one } else { many })
}

fn body(summary: &Summary, plots: Option<&Plots>) -> String {
    let mut html = String::new();
    header(&mut html, summary);
    ending(&mut html, summary);
    html.push_str(
        "<noscript><p class=\"box note\">The figures of this page are drawn by a script, which this browser does not run. The \
         facts and tables are complete without it; the folder of the run has the figures as SVG files.</p></noscript>",
    );
    tiles(&mut html, summary);
    if plots.is_some() {
        verdict_table(&mut html, summary);
        figures(&mut html, summary);
    } else {
        html.push_str("<p class=\"box note\">No step was recorded, so there is nothing to draw.</p>");
    }
    footer(&mut html, summary);
    html
}

/// `write!` into a String cannot fail.
macro_rules! put {
    ($html:expr, $($part:tt)*) => { write!($html, $($part)*).expect("a String takes everything") };
}

fn header(html: &mut String, summary: &Summary) {
    let status = summary.status.as_str();
    let mut facts: Vec<String> = Vec::new();
    if !summary.scenario.vehicle.is_empty() {
        facts.push(escape(&summary.scenario.vehicle));
    }
    if summary.rotor_count > 0 {
        facts.push(plural(summary.rotor_count as u64, "rotor", "rotors"));
    }
    facts.push(format!("seed {}", summary.seed));
    for fact in [&summary.link, &summary.pace, &summary.started_at] {
        if !fact.is_empty() {
            facts.push(escape(fact));
        }
    }
    put!(
        html,
        "<header><div class=\"top\"><h1>{name}</h1><span class=\"pill {status}\">{status}</span><span class=\"spacer\"></span>\
         <button type=\"button\" id=\"theme\" hidden>light / dark</button></div><p class=\"sub\">{facts}</p></header>",
        name = escape(&summary.scenario.name),
        facts = facts.join(" · "),
    );
}

/// How it ended, unless all is well; then what came out of it in a sentence or two.
fn ending(html: &mut String, summary: &Summary) {
    match (summary.status, &summary.failure) {
        (Status::Failed, Some(failure)) => {
            put!(
                html,
                "<div class=\"box failed\"><h2>This run failed</h2><p>{}</p><dl><div><dt>peer</dt><dd>{}</dd></div>\
                 <div><dt>last complete step</dt><dd class=\"num\">{}</dd></div>",
                escape(&failure.sentence),
                escape(&failure.peer),
                grouped(failure.step),
            );
            if failure.silence_ms > 0 {
                put!(
                    html,
                    "<div><dt>silent for</dt><dd class=\"num\">{} ms</dd></div>",
                    grouped(failure.silence_ms)
                );
            }
            html.push_str("</dl></div>");
        }
        (Status::Failed, None) => {
            html.push_str(
                "<div class=\"box failed\"><h2>This run failed</h2><p>The reason was not recorded.</p></div>",
            );
        }
        (Status::Canceled, _) => put!(
            html,
            "<div class=\"box canceled\"><h2>This run was stopped</h2><p>after {}; what follows covers these.</p></div>",
            plural(summary.steps, "step", "steps"),
        ),
        (Status::Done, _) => {}
    }
}

fn tile(html: &mut String, what: &str, value: &str, more: &str) {
    put!(
        html,
        "<div class=\"tile\"><div class=\"what\">{what}</div><div class=\"value\">{value}</div><div class=\"more\">{more}</div></div>"
    );
}

fn tiles(html: &mut String, summary: &Summary) {
    html.push_str("<div class=\"tiles\">");
    let mut steps = plural(summary.steps, "step", "steps");
    if summary.steps > 0 {
        put!(
            steps,
            " of {} ms",
            short(1e3 * summary.simulated_s / summary.steps as f64)
        );
    }
    tile(
        html,
        "simulated",
        &format!("{} <small>s</small>", short(summary.simulated_s)),
        &steps,
    );
    if summary.wall_s > 0.0 && summary.steps > 0 {
        let ratio = summary.simulated_s / summary.wall_s;
        let more = format!(
            "{} steps/s, {} × real time",
            grouped(summary.steps_per_s.round() as u64),
            short(ratio)
        );
        tile(
            html,
            "wall time",
            &format!("{} <small>s</small>", short(summary.wall_s)),
            &more,
        );
    }
    if let Some(tracking) = &summary.tracking {
        let value = format!("{} <small>m rms</small>", short(tracking.position_rms_m));
        tile(
            html,
            "position error",
            &value,
            &format!("at most {} m", short(tracking.position_max_m)),
        );
    }
    if let Some(battery) = &summary.battery {
        let value = format!(
            "{:.1} → {:.1} <small>%</small>",
            100.0 * battery.state_of_charge_start,
            100.0 * battery.state_of_charge_end
        );
        let more = format!("{:.2} → {:.2} V", battery.voltage_start_v, battery.voltage_end_v);
        tile(html, "battery", &value, &more);
    }
    if let Some(real_time) = summary.real_time.as_ref().filter(|_| summary.steps > 0) {
        let value = format!("{} <small>µs, 99 %</small>", short(real_time.jitter_us_p99));
        let more = format!(
            "median {} µs, worst {} µs; {}",
            short(real_time.jitter_us_p50),
            short(real_time.jitter_us_max),
            plural(real_time.deadline_misses, "deadline missed", "deadlines missed"),
        );
        tile(html, "lateness against the clock", &value, &more);
    }
    html.push_str("</div>");
}

/// What an evaluator achieved, in a clause.
fn achievement(summary: &Summary, evaluator: Evaluator) -> String {
    let faults: Vec<&Interval> = summary
        .intervals
        .iter()
        .filter(|interval| interval.fault_label > HEALTHY)
        .collect();
    let alarms = summary.false_alarm_events(evaluator);
    let alarms = if alarms == 0 {
        "no false alarm".to_owned()
    } else {
        plural(alarms, "false alarm", "false alarms")
    };
    if faults.is_empty() {
        return format!("<b>{}</b>: {alarms}", evaluator.title());
    }
    let isolated = faults
        .iter()
        .filter(|interval| interval.scores.of(evaluator).isolated_after_s.is_some())
        .count();
    let first = faults
        .iter()
        .find_map(|interval| interval.scores.of(evaluator).isolated_after_s);
    let delay = first.map_or_else(String::new, |delay| format!(", first after {delay:.2} s"));
    format!(
        "<b>{}</b>: right rotor named in {isolated} of {}{delay}; {alarms}",
        evaluator.title(),
        plural(faults.len() as u64, "interval with a fault", "intervals with a fault"),
    )
}

fn verdict_table(html: &mut String, summary: &Summary) {
    let clauses: Vec<String> = Evaluator::ALL
        .into_iter()
        .filter(|evaluator| !summary.is_absent(*evaluator))
        .map(|evaluator| achievement(summary, evaluator))
        .collect();
    html.push_str("<section id=\"verdict\"><div class=\"head\"><h2>Verdicts against the truth</h2></div>");
    if !clauses.is_empty() {
        put!(html, "<p class=\"about\">{}.</p>", clauses.join(". "));
    }
    html.push_str("<div class=\"scroll\"><table class=\"data\"><thead><tr><th>time, s</th><th>truth</th>");
    for evaluator in Evaluator::ALL {
        put!(html, "<th class=\"v\">{}</th>", evaluator.title());
    }
    html.push_str("</tr></thead><tbody>");
    for interval in &summary.intervals {
        let mut truth = escape(&interval.description).replace(", ", "<br>");
        for fault in &interval.sensor_faults {
            put!(truth, "<br>{}", escape(fault));
        }
        put!(
            html,
            "<tr><td class=\"when\">{} – {}</td><td class=\"truth\">{truth}</td>",
            seconds(interval.start_s),
            seconds(interval.end_s)
        );
        for evaluator in Evaluator::ALL {
            let absent = summary.is_absent(evaluator);
            html.push_str(&verdict_cell(
                interval,
                interval.scores.of(evaluator),
                absent,
                evaluator,
            ));
        }
        html.push_str("</tr>");
    }
    put!(
        html,
        "</tbody></table></div><p class=\"marks\">✓ without a fault: no false alarm; with one: right at the end and in at least {:.0} % \
         of the windows &nbsp; ! less than that &nbsp; ✗ never right. A delay counts from the start of the interval to the end of the \
         first window with the right verdict.</p></section>",
        100.0 * GOOD_SHARE,
    );
}

/// A time without trailing zeros.
fn seconds(time: f64) -> String {
    let text = format!("{time:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn verdict_cell(interval: &Interval, score: &Score, absent: bool, evaluator: Evaluator) -> String {
    if absent {
        let why = if evaluator == Evaluator::Network {
            "no network loaded"
        } else {
            "never ready"
        };
        return format!("<td class=\"verdict\"><span class=\"muted\">{why}</span></td>");
    }
    let Some(share) = score.share_right else {
        let why = if interval.windows == 0 {
            "no window ended here"
        } else {
            "calibrating"
        };
        return format!("<td class=\"verdict\"><span class=\"muted\">{why}</span></td>");
    };
    let healthy = interval.fault_label == HEALTHY;
    let held = score.verdict_at_end == interval.expected_verdict || (!healthy && score.right_at_end);
    let mostly = held && share >= GOOD_SHARE;
    let (class, mark) = match (healthy, score.false_alarm_events, score.isolated_after_s, mostly) {
        (true, 0, _, _) | (false, _, Some(_), true) => ("good", "✓"),
        (true, ..) | (false, _, Some(_), false) => ("warn", "!"),
        (false, _, None, _) => ("bad", "✗"),
    };
    let main = match (healthy, score.isolated_after_s) {
        (true, _) if score.false_alarm_events == 0 => "no false alarm".to_owned(),
        (true, _) => plural(score.false_alarm_events, "false alarm", "false alarms"),
        (false, Some(delay)) => format!("{} after {delay:.2} s", verdict_text(interval.expected_verdict)),
        (false, None) => format!("never {}", verdict_text(interval.expected_verdict)),
    };
    let mut details = vec![format!(
        "{:.1} % of {} right",
        100.0 * share,
        plural(interval.windows - score.not_ready, "window", "windows")
    )];
    for (count, what) in [
        (if healthy { 0 } else { score.healthy }, "healthy"),
        (
            if interval.expected_verdict == UNKNOWN {
                0
            } else {
                score.unknown
            },
            "unknown",
        ),
        (score.other_rotor, if healthy { "named a rotor" } else { "other rotor" }),
        (score.not_ready, "calibrating"),
    ] {
        if count > 0 {
            details.push(format!("{} {what}", grouped(count)));
        }
    }
    if evaluator == Evaluator::Sequential
        && let Some(text) = interval.severity.text()
    {
        details.push(format!("loses {text}"));
    }
    if !held {
        details.push(format!("at the end: {}", verdict_text(score.verdict_at_end)));
    }
    // Never 100 % unless it is.
    let width = (1000.0 * share).floor() / 10.0;
    format!(
        "<td class=\"verdict {class}\"><div class=\"line\"><span class=\"mark\">{mark}</span><span class=\"main\">{main}</span></div>\
         <div class=\"bar\"><i style=\"width:{width}%\"></i></div><div class=\"more\">{}</div></td>",
        details.join(" · ")
    )
}

fn section(html: &mut String, title: &str, reference: &str, about: &str, content: &str) {
    put!(
        html,
        "<section><div class=\"head\"><h2>{title}</h2><span class=\"ref\">{reference}</span></div><p class=\"about\">{about}</p>{content}</section>"
    );
}

fn figures(html: &mut String, summary: &Summary) {
    let tracking = summary.tracking.unwrap_or_default();
    let [north, east, down] = tracking.position_rms_ned_m;
    section(
        html,
        "Position",
        "paper, Fig. 9",
        &format!(
            "Reference against the true state. Rms error: north {} m, east {} m, down {} m. Shaded: a fault is in force. \
             <span class=\"hint\">Drag to zoom, all time plots follow; double-click to see all.</span>",
            short(north),
            short(east),
            short(down)
        ),
        "<div id=\"figure-position\"></div>",
    );
    let [roll, pitch, yaw] = tracking.attitude_rms_rad.map(f64::to_degrees);
    section(
        html,
        "Attitude",
        "paper, Fig. 10",
        &format!(
            "Yaw follows its reference, roll and pitch what the position loop asks for. Rms error: roll {}°, pitch {}°, yaw {}°.",
            short(roll),
            short(pitch),
            short(yaw)
        ),
        "<div id=\"figure-attitude\"></div>",
    );
    let battery = summary.battery.unwrap_or_default();
    section(
        html,
        "Charge and voltage",
        "paper, Fig. 11",
        &format!(
            "{} A h drawn; lowest voltage at the terminals {:.2} V.",
            short(battery.charge_ah),
            battery.voltage_min_v
        ),
        "<div id=\"figure-battery\"></div>",
    );
    section(
        html,
        "Residuals",
        "paper, Fig. 12",
        "r<sub>i</sub> in N·m·s: by design, r<sub>i</sub> does not see a fault of rotor i. Thin: every sample, as highest and lowest \
         values; thick: mean. One scale per column, set by what comes after the first two seconds.",
        "<div class=\"grid3\" id=\"figure-residuals\"></div>",
    );
    residual_table(html, summary);
    section(
        html,
        "Normal plot",
        "paper, Fig. 13",
        "Quantiles of the residual samples against those of a normal distribution; dashed: through the quartiles. Straight means \
         normal, a step up or down is a shift of the mean.",
        "<div class=\"grid2\" id=\"figure-normal\"></div>",
    );
    section(
        html,
        "Verdicts over time",
        "paper, Figs. 14 and 17",
        "Broad lane: the truth. Marks: the verdict in force.",
        "<div class=\"key\"><span><i style=\"background:var(--lane);height:12px\"></i>truth</span>\
         <span><i style=\"background:var(--good)\"></i>right</span>\
         <span><i style=\"background:var(--warn)\"></i>unknown fault</span>\
         <span><i style=\"background:var(--bad)\"></i>wrong</span></div><div id=\"figure-verdicts\"></div><div id=\"figure-loss\"></div>",
    );
    section(
        html,
        "Motor commands",
        "beyond the paper",
        "Mean duty cycle of each rotor. It rises as the battery discharges; a damaged rotor is driven harder.",
        "<div id=\"figure-duty\"></div>",
    );
}

fn residual_table(html: &mut String, summary: &Summary) {
    // Belongs to the section before: goes inside it.
    let closing = "</section>";
    html.truncate(html.len() - closing.len());
    html.push_str("<details><summary>Mean and standard deviation of each residual, per interval, in mN·m·s</summary>");
    html.push_str("<div class=\"scroll\"><table class=\"small\"><thead><tr><th>time, s</th><th class=\"l\">truth</th><th class=\"l\">component</th>");
    for rotor in 1..=summary.rotor_count {
        put!(html, "<th>r<sub>{rotor}</sub></th>");
    }
    html.push_str("</tr></thead><tbody>");
    for interval in &summary.intervals {
        for (component, name) in ["arm", "lever", "yaw"].into_iter().enumerate() {
            if component == 0 {
                put!(
                    html,
                    "<tr><td>{} – {}</td><td class=\"l\">{}</td>",
                    seconds(interval.residuals_from_s),
                    seconds(interval.end_s),
                    escape(&interval.description)
                );
            } else {
                html.push_str("<tr><td></td><td></td>");
            }
            put!(html, "<td class=\"l\">{name}</td>");
            for (mean, deviation) in interval
                .residual_means_nms
                .iter()
                .zip(&interval.residual_deviations_nms)
            {
                put!(
                    html,
                    "<td>{:.1} ± {:.1}</td>",
                    1e3 * mean[component],
                    1e3 * deviation[component]
                );
            }
            html.push_str("</tr>");
        }
    }
    html.push_str("</tbody></table></div></details>");
    html.push_str(closing);
}

fn footer(html: &mut String, summary: &Summary) {
    html.push_str("<footer><dl>");
    for (name, value) in [
        ("run", &summary.run),
        ("run hash", &summary.run_hash),
        ("vehicle model", &summary.model_hash),
        ("scenario file", &summary.scenario.path),
        ("program", &summary.program_version),
    ] {
        if !value.is_empty() {
            let class = if name.contains("hash") || name == "vehicle model" {
                " class=\"mono\""
            } else {
                ""
            };
            put!(html, "<dt>{name}</dt><dd{class}>{}</dd>", escape(value));
        }
    }
    let files = match summary.steps {
        0 => String::new(),
        _ => format!(
            ", {TELEMETRY_FILE} (every column of every step, for pandas, Polars, DuckDB, MATLAB), {MCAP_FILE} (for Foxglove and \
             Lichtblick), {FIGURES_FOLDER}/ (SVG)"
        ),
    };
    put!(
        html,
        "</dl><p>In the same folder: {SUMMARY_FILE}{files}. Equal scenario, seed and program give an equal run hash, over every link \
         and at every pace.</p>"
    );
    if !summary.scenario.text.is_empty() {
        put!(
            html,
            "<details><summary>Effective configuration of this run</summary><pre>{}</pre></details>",
            escape(&summary.scenario.text)
        );
    }
    html.push_str("</footer>");
}

/// Little-endian bytes in base64 (RFC 4648).
fn base64(numbers: &[f32]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let word = group.iter().fold(0u32, |word, byte| word << 8 | u32::from(*byte)) << (8 * (3 - group.len()));
        for at in 0..4 {
            if at <= group.len() {
                out.push(char::from(LETTERS[(word >> (18 - 6 * at) & 63) as usize]));
            } else {
                out.push('=');
            }
        }
    }
    out
}

fn payload(summary: &Summary, plots: Option<&Plots>) -> Value {
    let Some(plots) = plots else { return json!({}) };
    let many = |series: &[Vec<f32>]| series.iter().map(|values| base64(values)).collect::<Vec<_>>();
    let verdicts: Vec<Value> = Evaluator::ALL
        .into_iter()
        .zip(&plots.verdicts)
        .map(|(evaluator, verdicts)| {
            let absent = match (summary.is_absent(evaluator), evaluator) {
                (false, _) => Value::Null,
                (true, Evaluator::Network) => json!("No network was loaded in this run."),
                (true, _) => json!("It gave no verdict: the run ended before it was calibrated."),
            };
            let seen: Vec<Value> = verdicts
                .seen
                .iter()
                .map(|seen| json!([seen.start_s, seen.end_s, seen.codes]))
                .collect();
            json!({ "title": evaluator.title(), "absent": absent, "seen": seen })
        })
        .collect();
    json!({
        "rotors": plots.rotor_count,
        "end": plots.end_s,
        "intervals": summary.intervals.iter().map(interval_payload).collect::<Vec<_>>(),
        "time": base64(&plots.wide.times),
        "wide": many(&plots.wide.values),
        "scale_from": scale_from_s(plots.end_s),
        "residual_time": base64(&plots.residuals.times),
        "residuals": many(&plots.residuals.values),
        "mean_time": base64(&plots.residual_means.times),
        "residual_means": many(&plots.residual_means.values),
        "duty": many(&plots.duty.values),
        "verdicts": verdicts,
        "normal": normal_payload(summary, plots),
    })
}

fn interval_payload(interval: &Interval) -> Value {
    let mut text = if interval.fault_label == HEALTHY {
        String::new()
    } else {
        interval.description.clone()
    };
    for fault in &interval.sensor_faults {
        if !text.is_empty() {
            text.push_str(", ");
        }
        text.push_str(fault);
    }
    let short: Vec<String> = interval.faulty_rotors.iter().map(u32::to_string).collect();
    json!({
        "start": interval.start_s,
        "end": interval.end_s,
        "label": interval.fault_label,
        "fault": interval.fault_label != HEALTHY || !interval.sensor_faults.is_empty(),
        "text": text,
        "short": short.join(", "),
    })
}

fn normal_payload(summary: &Summary, plots: &Plots) -> Value {
    let grid = normal_grid();
    let second = plots.second_residual;
    let panel = |title: String, sample: &Sample| {
        let lines: Option<Vec<Value>> = (0..3)
            .map(|component| {
                let line = normal_line(&sample.sorted(second, component), &grid)?;
                Some(json!({ "quantiles": base64(&line.quantiles), "reference": line.reference }))
            })
            .collect();
        lines.map(|lines| json!({ "title": title, "lines": lines }))
    };
    let first_fault = summary
        .intervals
        .iter()
        .find(|interval| interval.fault_label != HEALTHY);
    let fault = first_fault.map_or_else(String::new, |interval| interval.description.clone());
    let panels: Vec<Value> = [panel("healthy".to_owned(), &plots.healthy), panel(fault, &plots.faulty)]
        .into_iter()
        .flatten()
        .collect();
    if panels.is_empty() {
        return Value::Null;
    }
    let unit = format!("residual {}, N·m·s", if second { 2 } else { 1 });
    json!({ "z": grid, "unit": unit, "panels": panels })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_base64_against_rfc_4648() {
        // Bytes 00 00 80 3f = 1.0f32; the expected text is that of any other encoder.
        assert_eq!(base64(&[1.0]), "AACAPw==");
        assert_eq!(base64(&[1.0, -2.5]), "AACAPwAAIMA=");
        assert_eq!(base64(&[1.0, -2.5, 0.0]), "AACAPwAAIMAAAAAA");
        assert_eq!(base64(&[]), "");
    }

    #[test]
    fn val_text_of_the_user_cannot_break_the_page() {
        let mut summary = Summary::default();
        summary.scenario.name = "</script><b>\"&".to_owned();
        summary.scenario.text = "a < b".to_owned();
        let page = render(&summary, None);
        assert!(!page.contains("</script><b>"));
        assert!(page.contains("&lt;/script&gt;&lt;b&gt;&quot;&amp;"));
        assert!(page.contains("a &lt; b"));
    }

    #[test]
    fn val_numbers_are_written_for_people() {
        assert_eq!(grouped(36_000), "36\u{202f}000");
        assert_eq!(grouped(999), "999");
        assert_eq!(short(0.01234), "0.012");
        assert_eq!(short(43_912.4), "43\u{202f}912");
        assert_eq!(seconds(45.0), "45");
        assert_eq!(seconds(53.0875), "53.0875");
    }
}
