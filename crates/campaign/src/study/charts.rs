//! The pictures of a campaign's report: inline SVG in the colours of the page, without a script.

use super::score::severity_name;
use super::tables::title;
use super::totals::{DetectorTotals, Totals};
use rotortwin_flight_core::fdi::verdict_code::{AMBIGUOUS, UNKNOWN};
use std::fmt::Write as _;

/// `write!` into a String cannot fail.
macro_rules! put {
    ($html:expr, $($part:tt)*) => { write!($html, $($part)*).expect("a String takes everything") };
}

/// Styles of the charts, on top of the report's.
pub const CSS: &str = "
.chart { margin-top: 12px; max-width: 860px; }
.chart svg { width: 100%; height: auto; display: block; font: 12px system-ui, sans-serif; }
.chart .grid { stroke: var(--grid); stroke-width: 1; }
.chart .axis { stroke: var(--muted); stroke-width: 1; }
.chart text { fill: var(--muted); }
.chart .s0 { stroke: var(--c1); } .chart .s1 { stroke: var(--c2); } .chart .s2 { stroke: var(--c3); }
.chart .s3 { stroke: var(--c4); } .chart .s4 { stroke: var(--c5); } .chart .s5 { stroke: var(--c6); }
.chart .s6 { stroke: var(--c7); } .chart .s7 { stroke: var(--c8); }
.chart .line { fill: none; stroke-width: 2; stroke-linejoin: round; }
.chart .dot { fill: var(--page); stroke-width: 2; }
.chart .none { stroke-dasharray: 3 3; }
table.confusion { border-collapse: collapse; font-size: 12.5px; font-variant-numeric: tabular-nums; margin-top: 8px; }
table.confusion th, table.confusion td { padding: 4px 9px; text-align: right; border: 1px solid var(--page); white-space: nowrap; }
table.confusion th { color: var(--muted); font-weight: 600; }
.matrices { display: flex; flex-wrap: wrap; gap: 18px 34px; margin-top: 12px; }
.list { color: var(--muted); font-size: 13.5px; max-width: 100ch; padding-left: 18px; margin: 8px 0 0; }
";

const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 46.0;

/// A rectangle of the page with its scales; x may be logarithmic.
struct Frame {
    x: [f64; 2],
    y: [f64; 2],
    log_x: bool,
}

impl Frame {
    fn px(&self, x: f64) -> f64 {
        let scale = |x: f64| if self.log_x { libm::log10(x) } else { x };
        let part = (scale(x) - scale(self.x[0])) / (scale(self.x[1]) - scale(self.x[0]));
        LEFT + part.clamp(0.0, 1.0) * (WIDTH - LEFT - RIGHT)
    }

    fn py(&self, y: f64) -> f64 {
        let part = (y - self.y[0]) / (self.y[1] - self.y[0]);
        HEIGHT - BOTTOM - part.clamp(0.0, 1.0) * (HEIGHT - TOP - BOTTOM)
    }

    fn open(&self, x_label: &str, y_label: &str, x_ticks: &[f64], y_ticks: &[f64]) -> String {
        let mut svg = format!(
            "<div class=\"chart\"><svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{x_label}; {y_label}\">"
        );
        let (bottom, right) = (HEIGHT - BOTTOM, WIDTH - RIGHT);
        for y in y_ticks {
            let at = self.py(*y);
            put!(
                svg,
                "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/><text x=\"{:.1}\" y=\"{:.1}\" \
                 text-anchor=\"end\">{}</text>",
                LEFT - 8.0,
                at + 4.0,
                number(*y)
            );
        }
        for x in x_ticks {
            let at = self.px(*x);
            put!(
                svg,
                "<line class=\"grid\" x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{TOP}\" y2=\"{bottom}\"/><text x=\"{at:.1}\" y=\"{:.1}\" \
                 text-anchor=\"middle\">{}</text>",
                bottom + 17.0,
                number(*x)
            );
        }
        put!(
            svg,
            "<line class=\"axis\" x1=\"{LEFT}\" x2=\"{right}\" y1=\"{bottom}\" y2=\"{bottom}\"/><text x=\"{:.1}\" y=\"{:.1}\" \
             text-anchor=\"middle\">{x_label}</text><text transform=\"rotate(-90)\" x=\"{:.1}\" y=\"15\" text-anchor=\"middle\">{y_label}</text>",
            (LEFT + right) / 2.0,
            HEIGHT - 8.0,
            -(TOP + bottom) / 2.0
        );
        svg
    }

    fn line(&self, svg: &mut String, series: usize, points: &[(f64, f64)]) {
        let mut path = String::new();
        for (i, (x, y)) in points.iter().enumerate() {
            put!(
                path,
                "{}{:.1} {:.1}",
                if i == 0 { "M" } else { "L" },
                self.px(*x),
                self.py(*y)
            );
        }
        put!(svg, "<path class=\"line s{series}\" d=\"{path}\"/>");
    }
}

fn key(names: &[String]) -> String {
    let mut html = String::from("<div class=\"key\">");
    for (i, name) in names.iter().enumerate() {
        put!(
            html,
            "<span><i style=\"background: var(--c{})\"></i>{name}</span>",
            i + 1
        );
    }
    html.push_str("</div></div>");
    html
}

fn number(x: f64) -> String {
    if x != 0.0 && !(1e-3..1e4).contains(&x.abs()) {
        return format!("{x:e}");
    }
    let text = format!("{x:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Round numbers from 0 to a little above `max`, five or so.
fn ticks(max: f64) -> Vec<f64> {
    let rough = max.max(1e-9) / 5.0;
    let power = libm::pow(10.0, libm::floor(libm::log10(rough)));
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * power)
        .find(|s| *s >= rough)
        .unwrap_or(rough);
    let count = libm::ceil(max / step - 1e-9) as usize;
    (0..=count.max(1)).map(|i| i as f64 * step).collect()
}

/// Powers of ten and their halves that cover a range.
fn decades(low: f64, high: f64) -> Vec<f64> {
    let first = libm::floor(libm::log10(low)) as i32;
    let last = libm::ceil(libm::log10(high) - 1e-12) as i32;
    (first..=last.max(first + 1))
        .map(|power| libm::pow(10.0, f64::from(power)))
        .collect()
}

/// Share of the flights with a fault that are isolated after a time, detector by detector.
pub fn delay_chart(totals: &Totals) -> Option<String> {
    let shown: Vec<(usize, &DetectorTotals)> = totals
        .detectors
        .iter()
        .enumerate()
        .filter(|(_, detector)| detector.isolated.total() > 0)
        .collect();
    let delays = || {
        shown
            .iter()
            .flat_map(|(_, detector)| detector.isolated.cumulative().map(|(time, _)| time))
    };
    let (low, high) = delays().fold((f64::INFINITY, 0.0f64), |(low, high), time| {
        (low.min(time), high.max(time))
    });
    if shown.is_empty() || low <= 0.0 {
        return None;
    }
    let x_ticks = decades(low, high);
    let frame = Frame {
        x: [x_ticks[0], *x_ticks.last().expect("two ticks at least")],
        y: [0.0, 100.0],
        log_x: true,
    };
    let mut svg = frame.open(
        "delay from the onset to the right verdict, s",
        "flights isolated, %",
        &x_ticks,
        &[0.0, 20.0, 40.0, 60.0, 80.0, 100.0],
    );
    for (series, (_, detector)) in shown.iter().enumerate() {
        let flights = detector.fault_flights as f64;
        let mut points = vec![(frame.x[0], 0.0)];
        let mut before = 0.0;
        for (time, seen) in detector.isolated.cumulative() {
            let share = 100.0 * seen as f64 / flights;
            points.extend([(time, before), (time, share)]);
            before = share;
        }
        points.push((frame.x[1], before));
        frame.line(&mut svg, series, &points);
    }
    svg.push_str("</svg>");
    let names: Vec<String> = shown.iter().map(|(place, _)| title(*place).to_owned()).collect();
    Some(svg + &key(&names))
}

/// False alarms per hour against the median delay, severity by severity, along the thresholds.
pub fn operating_chart(totals: &Totals) -> Option<String> {
    let bins: Vec<usize> = totals
        .severities()
        .into_iter()
        .filter(|bin| {
            totals.curve.iter().any(|(_, d)| {
                d.delay_by_severity
                    .get(bin)
                    .is_some_and(|(_, delays)| delays.total() > 0)
            })
        })
        .take(8)
        .collect();
    let point = |detector: &DetectorTotals, bin: usize| {
        let (_, delays) = detector.delay_by_severity.get(&bin)?;
        Some((delays.quantile_s(0.5)?, detector.false_alarms_per_h()?))
    };
    let all = || {
        totals
            .curve
            .iter()
            .flat_map(|(_, d)| bins.iter().filter_map(move |bin| point(d, *bin)))
    };
    let (low, high, rate) = all().fold((f64::INFINITY, 0.0f64, 0.0f64), |(low, high, rate), (delay, alarms)| {
        (low.min(delay), high.max(delay), rate.max(alarms))
    });
    if bins.is_empty() || low <= 0.0 || !low.is_finite() {
        return None;
    }
    let x_ticks = decades(low, high);
    let y_ticks = ticks(rate.max(1.0));
    let frame = Frame {
        x: [x_ticks[0], *x_ticks.last().expect("two ticks at least")],
        y: [0.0, *y_ticks.last().expect("two ticks at least")],
        log_x: true,
    };
    let mut svg = frame.open(
        "median delay to isolation, s",
        "false alarms per hour",
        &x_ticks,
        &y_ticks,
    );
    for (series, bin) in bins.iter().enumerate() {
        let points: Vec<(f32, f64, f64)> = totals
            .curve
            .iter()
            .filter_map(|(level, d)| point(d, *bin).map(|(x, y)| (*level, x, y)))
            .collect();
        let line: Vec<(f64, f64)> = points.iter().map(|(_, x, y)| (*x, *y)).collect();
        frame.line(&mut svg, series, &line);
        for (level, x, y) in points {
            put!(
                svg,
                "<circle class=\"dot s{series}\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"3.5\"><title>{level} nats: {x:.3} s, {y:.2} /h</title></circle>",
                frame.px(x),
                frame.py(y)
            );
        }
    }
    svg.push_str("</svg>");
    let names: Vec<String> = bins.iter().map(|bin| format!("{} lost", severity_name(*bin))).collect();
    Some(svg + &key(&names))
}

/// Rows truth, columns verdict, as shares of the row; the colour says right or wrong, its depth how often.
pub fn confusion_matrix(detector: &DetectorTotals, name: &str) -> String {
    let mut truths: Vec<i32> = detector.confusion.keys().map(|(truth, _)| *truth).collect();
    let mut verdicts: Vec<i32> = detector.confusion.keys().map(|(_, verdict)| *verdict).collect();
    // Healthy, the rotors, pairs, then what names nothing.
    let order = |code: &i32| if *code < 0 { i32::MAX + code } else { *code };
    for codes in [&mut truths, &mut verdicts] {
        codes.sort_unstable_by_key(order);
        codes.dedup();
    }
    // Pairs by the dozen fit no page.
    let pairs = verdicts.iter().filter(|code| **code >= 100).count();
    let joined = pairs > 4;
    if joined {
        verdicts.retain(|code| *code < 100);
    }
    let mut html = format!("<div><h3>{name}</h3><table class=\"confusion\"><thead><tr><th>truth \\ verdict</th>");
    for verdict in &verdicts {
        put!(html, "<th>{}</th>", code_name(*verdict, false));
    }
    html.push_str(if joined {
        "<th>a pair</th><th>windows</th>"
    } else {
        "<th>windows</th>"
    });
    html.push_str("</tr></thead><tbody>");
    for truth in truths {
        let count = |verdict: i32| detector.confusion.get(&(truth, verdict)).copied().unwrap_or(0);
        let total: u64 = detector
            .confusion
            .iter()
            .filter(|((of, _), _)| *of == truth)
            .map(|(_, count)| count)
            .sum();
        put!(html, "<tr><th>{}</th>", code_name(truth, true));
        let mut shown = 0;
        for verdict in &verdicts {
            shown += count(*verdict);
            html.push_str(&cell(count(*verdict), total, truth == *verdict));
        }
        if joined {
            html.push_str(&cell(total - shown, total, truth < 0));
        }
        put!(html, "<td class=\"muted\">{total}</td></tr>");
    }
    html.push_str("</tbody></table></div>");
    html
}

fn cell(count: u64, total: u64, right: bool) -> String {
    if count == 0 {
        return "<td class=\"muted\">·</td>".to_owned();
    }
    let share = count as f64 / total as f64;
    let colour = if right { "--good" } else { "--bad" };
    // Rare errors must be seen.
    let depth = if right { 30.0 * share } else { 12.0 + 48.0 * share };
    format!(
        "<td style=\"background: color-mix(in srgb, var({colour}) {depth:.0}%, transparent)\" title=\"{count} windows\">{}</td>",
        super::tables::percent(Some(share))
    )
}

fn code_name(code: i32, truth: bool) -> String {
    match code {
        0 => "healthy".to_owned(),
        UNKNOWN if truth => "several".to_owned(),
        UNKNOWN => "unknown".to_owned(),
        AMBIGUOUS => "ambiguous".to_owned(),
        100.. => format!("{}+{}", code / 100, code % 100),
        rotor => rotor.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_ticks_cover_their_range() {
        assert_eq!(ticks(1.0), [0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0]);
        assert_eq!(ticks(7.0).last(), Some(&8.0));
        assert_eq!(decades(0.0625, 2.0), [0.01, 0.1, 1.0, 10.0]);
        assert_eq!(
            (number(0.1), number(10.0), number(1e-5)),
            ("0.1".into(), "10".into(), "1e-5".into())
        );
    }
}
