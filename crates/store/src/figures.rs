//! `figures/*.svg`: the paper's figures 9 to 14 for this run as static images, for documents and slides.
//!
//! Drawn from the same decimated data as the report, on white, with the fault intervals shaded. Only lines, text and
//! rectangles, so that every SVG program renders them alike.

use crate::plots::{Plots, Sample, Verdicts, normal_grid, normal_line, scale_from_s};
use crate::summary::{Evaluator, Interval, Summary};
use rotortwin_flight_core::fdi::verdict_code::{HEALTHY, UNKNOWN};
use std::fmt::Write as _;

const WIDTH: f64 = 900.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 24.0;
const GAP: f64 = 16.0;
/// Below the lowest panel: axis numbers and label.
const BOTTOM: f64 = 40.0;

const TEXT: &str = "#1b2430";
const MUTED: &str = "#5b6777";
const GRID: &str = "#e3e7ed";
const BLUE: &str = "#1f6fd1";
const PALE: &str = "#a9c8ee";
const GOOD: &str = "#18794e";
const WARN: &str = "#b87400";
const BAD: &str = "#c0262d";
const COMPONENTS: [(&str, &str); 3] = [("arm", "#0072b2"), ("lever", "#c8641b"), ("yaw", "#118a63")];

/// `write!` into a String cannot fail.
macro_rules! put {
    ($svg:expr, $($part:tt)*) => { write!($svg, $($part)*).expect("a String takes everything") };
}

/// File name and content of each figure.
pub(crate) fn render(plots: &Plots, summary: &Summary) -> Vec<(String, String)> {
    [
        ("figure-09-position.svg", position(plots, summary)),
        ("figure-10-attitude.svg", attitude(plots, summary)),
        ("figure-11-battery.svg", battery(plots, summary)),
        ("figure-12-residuals.svg", residuals(plots, summary)),
        ("figure-13-normal-plot.svg", normal(plots, summary)),
        ("figure-14-verdicts.svg", verdicts(plots, summary)),
    ]
    .into_iter()
    .map(|(name, svg)| (name.to_owned(), svg))
    .collect()
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// One pair of axes.
#[derive(Clone, Copy)]
struct Panel {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    x: [f64; 2],
    y: [f64; 2],
}

impl Panel {
    fn px(&self, x: f64) -> f64 {
        self.left + (x - self.x[0]) / (self.x[1] - self.x[0]) * self.width
    }

    fn py(&self, y: f64) -> f64 {
        self.top + self.height - (y - self.y[0]) / (self.y[1] - self.y[0]) * self.height
    }

    /// Shaded faults, grid, numbers.
    fn frame(
        &self,
        svg: &mut String,
        intervals: &[Interval],
        y_ticks: &[(f64, String)],
        x_ticks: &[(f64, String)],
        last: bool,
    ) {
        let mut strong = false;
        for interval in intervals {
            if interval.fault_label == HEALTHY && interval.sensor_faults.is_empty() {
                strong = false;
                continue;
            }
            let (from, to) = (
                self.px(interval.start_s.max(self.x[0])),
                self.px(interval.end_s.min(self.x[1])),
            );
            let fill = if strong { "#f6e3c8" } else { "#fbf0e2" };
            put!(
                svg,
                "<rect x=\"{from:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{fill}\"/>",
                self.top,
                to - from,
                self.height
            );
            strong = !strong;
        }
        for (value, text) in y_ticks {
            let y = self.py(*value);
            put!(
                svg,
                "<path d=\"M{:.1} {y:.1}h{:.1}\" stroke=\"{GRID}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"{MUTED}\">{text}</text>",
                self.left,
                self.width,
                self.left - 6.0,
                y + 4.0
            );
        }
        for (value, text) in x_ticks {
            let x = self.px(*value);
            put!(
                svg,
                "<path d=\"M{x:.1} {:.1}v{:.1}\" stroke=\"{GRID}\"/>",
                self.top,
                self.height
            );
            if last {
                put!(
                    svg,
                    "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"{MUTED}\">{text}</text>",
                    self.top + self.height + 15.0
                );
            }
        }
    }

    fn x_label(&self, svg: &mut String, text: &str) {
        put!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"{TEXT}\">{text}</text>",
            self.left + self.width / 2.0,
            self.top + self.height + 32.0
        );
    }

    fn y_label(&self, svg: &mut String, text: &str) {
        let (x, y) = (self.left - 46.0, self.top + self.height / 2.0);
        put!(
            svg,
            "<text transform=\"translate({x:.1} {y:.1}) rotate(-90)\" text-anchor=\"middle\" fill=\"{TEXT}\">{text}</text>"
        );
    }

    fn line(&self, svg: &mut String, points: impl Iterator<Item = (f64, f64)>, style: &str) {
        // Points outside the panel are clamped to its edge.
        let (low, high) = (self.y[0].min(self.y[1]), self.y[0].max(self.y[1]));
        let mut path = String::new();
        let mut pen_down = false;
        for (x, y) in points {
            if !y.is_finite() {
                pen_down = false;
                continue;
            }
            put!(
                path,
                "{}{:.1} {:.1}",
                if pen_down { 'L' } else { 'M' },
                self.px(x),
                self.py(y.clamp(low, high))
            );
            pen_down = true;
        }
        put!(svg, "<path d=\"{path}\" fill=\"none\" {style}/>");
    }

    /// Fault labels above the panel.
    fn names(&self, svg: &mut String, intervals: &[Interval]) {
        for interval in intervals.iter().filter(|interval| interval.fault_label != HEALTHY) {
            // About 6 px per letter; a label that does not fit is omitted.
            if self.px(interval.end_s) - self.px(interval.start_s) > 6.0 * interval.description.len() as f64 {
                put!(
                    svg,
                    "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"#8a4b00\">{}</text>",
                    self.px(interval.start_s),
                    self.top - 6.0,
                    escape(&interval.description)
                );
            }
        }
    }
}

/// Round numbers that divide `range` into about `count` parts.
fn ticks(range: [f64; 2], count: f64) -> Vec<(f64, String)> {
    let raw = (range[1] - range[0]) / count;
    if !raw.is_finite() || raw <= 0.0 {
        return Vec::new();
    }
    let power = 10f64.powf(raw.log10().floor());
    // Rather a little finer than requested than much coarser.
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|factor| factor * power)
        .into_iter()
        .find(|step| *step >= 0.7 * raw)
        .unwrap_or(raw);
    let decimals = (-step.log10().floor()).max(0.0) as usize;
    let first = (range[0] / step).ceil() as i64;
    let last = (range[1] / step).floor() as i64;
    (first..=last)
        .map(|i| {
            (
                i as f64 * step,
                format!("{:.decimals$}", i as f64 * step).replace('-', "−"),
            )
        })
        .collect()
}

/// Range of some series with margins; at least `least` wide.
fn range<'a>(series: impl Iterator<Item = &'a [f32]>, least: f64) -> [f64; 2] {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for value in series
        .flatten()
        .map(|value| f64::from(*value))
        .filter(|value| value.is_finite())
    {
        low = low.min(value);
        high = high.max(value);
    }
    if low > high {
        return [-1.0, 1.0];
    }
    let air = 0.06 * (high - low).max(least) + (least - (high - low)).max(0.0) / 2.0;
    [low - air, high + air]
}

/// A line of [`lines`].
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Label.
    pub name: String,
    /// CSS colour.
    pub colour: &'static str,
    /// Dashed or solid.
    pub dashed: bool,
    /// x, y; y increases upwards.
    pub points: Vec<(f64, f64)>,
}

/// Lines on one pair of axes, both starting at 0, with a legend: an SVG document.
pub fn lines(title: &str, x_label: &str, y_label: &str, lines: &[Line]) -> String {
    let largest = |value: fn(&(f64, f64)) -> f64| {
        let all = lines.iter().flat_map(|line| &line.points);
        all.map(value).filter(|value| value.is_finite()).fold(0.0, f64::max)
    };
    let (x, y) = ([0.0, largest(|point| point.0)], [0.0, 1.05 * largest(|point| point.1)]);
    let panel = Panel {
        left: LEFT,
        top: TOP,
        width: WIDTH - LEFT - RIGHT,
        height: 420.0,
        x,
        y,
    };
    let mut svg = String::new();
    panel.frame(&mut svg, &[], &ticks(y, 8.0), &ticks(x, 10.0), true);
    panel.x_label(&mut svg, &escape(x_label));
    panel.y_label(&mut svg, &escape(y_label));
    for (row, line) in lines.iter().enumerate() {
        let dashes = if line.dashed { " stroke-dasharray=\"6 4\"" } else { "" };
        let style = format!("stroke=\"{}\" stroke-width=\"1.6\"{dashes}", line.colour);
        panel.line(&mut svg, line.points.iter().copied(), &style);
        let (left, top) = (panel.left + 14.0, panel.top + 18.0 + 18.0 * row as f64);
        put!(
            svg,
            "<path d=\"M{left:.1} {:.1}h26\" fill=\"none\" {style}/><text x=\"{:.1}\" y=\"{top:.1}\" fill=\"{TEXT}\">{}</text>",
            top - 4.0,
            left + 34.0,
            escape(&line.name)
        );
    }
    page(panel.top + panel.height + BOTTOM, &svg, title)
}

fn page(height: f64, content: &str, title: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height:.0}\" width=\"{WIDTH}\" height=\"{height:.0}\" \
         font-family=\"system-ui, 'Segoe UI', Roboto, Arial, sans-serif\" font-size=\"12\"><title>{}</title>\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>{content}</svg>\n",
        escape(title)
    )
}

fn zip<'a>(times: &'a [f32], values: &'a [f32]) -> impl Iterator<Item = (f64, f64)> + 'a {
    times
        .iter()
        .zip(values)
        .map(|(time, value)| (f64::from(*time), f64::from(*value)))
}

const STATE_STYLE: &str = "stroke=\"#1b2430\" stroke-width=\"2\"";
const REFERENCE_STYLE: &str = "stroke=\"#1f6fd1\" stroke-width=\"1.3\" stroke-dasharray=\"6 6\"";
const SETPOINT_STYLE: &str = "stroke=\"#a9c8ee\" stroke-width=\"0.8\"";

/// Label, series of the wide plots with their style (drawn in this order), least range, positive downwards.
struct Row {
    label: &'static str,
    series: Vec<(usize, &'static str)>,
    least: f64,
    flipped: bool,
}

/// Panels over time, stacked vertically.
fn stack(plots: &Plots, summary: &Summary, rows: &[Row], title: &str) -> String {
    const HEIGHT: f64 = 130.0;
    let mut svg = String::new();
    let x = [0.0, plots.end_s];
    let mut top = TOP;
    for (at, row) in rows.iter().enumerate() {
        let last = at + 1 == rows.len();
        let mut y = range(
            row.series
                .iter()
                .map(|(series, _)| plots.wide.values[*series].as_slice()),
            row.least,
        );
        let numbers = ticks(y, 4.0);
        if row.flipped {
            y.swap(0, 1);
        }
        let panel = Panel {
            left: LEFT,
            top,
            width: WIDTH - LEFT - RIGHT,
            height: HEIGHT,
            x,
            y,
        };
        panel.frame(&mut svg, &summary.intervals, &numbers, &ticks(x, 9.0), last);
        for (series, style) in &row.series {
            panel.line(&mut svg, zip(&plots.wide.times, &plots.wide.values[*series]), style);
        }
        panel.y_label(&mut svg, row.label);
        if at == 0 {
            panel.names(&mut svg, &summary.intervals);
        }
        if last {
            panel.x_label(&mut svg, "time, s");
        }
        top += HEIGHT + GAP;
    }
    page(top - GAP + BOTTOM, &svg, title)
}

fn position(plots: &Plots, summary: &Summary) -> String {
    let row = |label, at: usize, flipped| Row {
        label,
        series: vec![(2 * at + 1, STATE_STYLE), (2 * at, REFERENCE_STYLE)],
        least: 0.5,
        flipped,
    };
    let rows = [
        row("north, m", 0, false),
        row("east, m", 1, false),
        row("down, m", 2, true),
    ];
    stack(
        plots,
        summary,
        &rows,
        "Position: reference (blue, dashed) and state (black)",
    )
}

fn attitude(plots: &Plots, summary: &Summary) -> String {
    let row = |label, series| Row {
        label,
        series,
        least: 1.0,
        flipped: false,
    };
    let rows = [
        row("roll, °", vec![(6, SETPOINT_STYLE), (7, STATE_STYLE)]),
        row("pitch, °", vec![(8, SETPOINT_STYLE), (9, STATE_STYLE)]),
        row("yaw, °", vec![(11, STATE_STYLE), (10, REFERENCE_STYLE)]),
    ];
    stack(
        plots,
        summary,
        &rows,
        "Attitude: setpoint or reference (blue) and state (black)",
    )
}

fn battery(plots: &Plots, summary: &Summary) -> String {
    let rows = [
        Row {
            label: "state of charge, %",
            series: vec![(12, STATE_STYLE)],
            least: 2.0,
            flipped: false,
        },
        Row {
            label: "voltage, V",
            series: vec![(13, REFERENCE_STYLE), (14, STATE_STYLE)],
            least: 0.2,
            flipped: false,
        },
    ];
    stack(
        plots,
        summary,
        &rows,
        "State of charge; open-circuit voltage (blue, dashed) and voltage at the terminals (black)",
    )
}

fn residuals(plots: &Plots, summary: &Summary) -> String {
    const HEIGHT: f64 = 64.0;
    const SPACE: f64 = 52.0;
    let width = (WIDTH - LEFT - RIGHT - 2.0 * SPACE) / 3.0;
    let mut svg = String::new();
    let from_s = scale_from_s(plots.end_s);
    let start = plots.residuals.times.partition_point(|time| f64::from(*time) < from_s);
    for (component, (name, _)) in COMPONENTS.into_iter().enumerate() {
        let of_component = |rotor: usize| &plots.residuals.values[3 * rotor + component];
        let y = range((0..plots.rotor_count).map(|rotor| &of_component(rotor)[start..]), 1e-6);
        let left = LEFT + component as f64 * (width + SPACE);
        put!(
            svg,
            "<text x=\"{:.1}\" y=\"16\" text-anchor=\"middle\" font-weight=\"600\" fill=\"{TEXT}\">{name} component, N·m·s</text>",
            left + width / 2.0
        );
        for rotor in 0..plots.rotor_count {
            let last = rotor + 1 == plots.rotor_count;
            let top = TOP + rotor as f64 * (HEIGHT + 8.0);
            let panel = Panel {
                left,
                top,
                width,
                height: HEIGHT,
                x: [0.0, plots.end_s],
                y,
            };
            panel.frame(
                &mut svg,
                &summary.intervals,
                &ticks(y, 3.0),
                &ticks([0.0, plots.end_s], 4.0),
                last,
            );
            panel.line(
                &mut svg,
                zip(&plots.residuals.times, of_component(rotor)),
                &format!("stroke=\"{PALE}\" stroke-width=\"0.6\""),
            );
            panel.line(
                &mut svg,
                zip(
                    &plots.residual_means.times,
                    &plots.residual_means.values[3 * rotor + component],
                ),
                &format!("stroke=\"{BLUE}\" stroke-width=\"1.3\""),
            );
            if component == 0 {
                put!(
                    svg,
                    "<text x=\"6\" y=\"{:.1}\" font-weight=\"600\" fill=\"{TEXT}\">r<tspan dy=\"3\" font-size=\"9\">{}</tspan></text>",
                    top + HEIGHT / 2.0 + 4.0,
                    rotor + 1
                );
            }
            if last {
                panel.x_label(&mut svg, "time, s");
            }
        }
    }
    let height = TOP + plots.rotor_count as f64 * (HEIGHT + 8.0) - 8.0 + BOTTOM;
    page(height, &svg, "Residuals: every sample (pale) and mean")
}

fn normal(plots: &Plots, summary: &Summary) -> String {
    const HEIGHT: f64 = 300.0;
    const SPACE: f64 = 70.0;
    let width = (WIDTH - LEFT - RIGHT - SPACE) / 2.0;
    let grid = normal_grid();
    let lines = |sample: &Sample| {
        [0, 1, 2].map(|component| normal_line(&sample.sorted(plots.second_residual, component), &grid))
    };
    let first_fault = summary
        .intervals
        .iter()
        .find(|interval| interval.fault_label != HEALTHY);
    let panels = [
        ("healthy", lines(&plots.healthy)),
        (
            first_fault.map_or("no fault in this run", |interval| interval.description.as_str()),
            lines(&plots.faulty),
        ),
    ];
    let y = range(
        panels
            .iter()
            .flat_map(|(_, lines)| lines)
            .flatten()
            .map(|line| line.quantiles.as_slice()),
        1e-9,
    );
    let probabilities = [
        (-3.0902, "0.001"),
        (-2.3263, "0.01"),
        (-1.6449, "0.05"),
        (-0.6745, "0.25"),
        (0.0, "0.5"),
        (0.6745, "0.75"),
        (1.6449, "0.95"),
        (2.3263, "0.99"),
        (3.0902, "0.999"),
    ]
    .map(|(z, text)| (z, text.to_owned()));
    let mut svg = String::new();
    for (at, (title, lines)) in panels.iter().enumerate() {
        let left = LEFT + at as f64 * (width + SPACE);
        let panel = Panel {
            left,
            top: TOP,
            width,
            height: HEIGHT,
            x: [-3.6, 3.6],
            y,
        };
        panel.frame(&mut svg, &[], &ticks(y, 6.0), &probabilities, true);
        put!(
            svg,
            "<text x=\"{left:.1}\" y=\"16\" font-weight=\"600\" fill=\"{TEXT}\">{}</text>",
            escape(title)
        );
        for (component, line) in lines.iter().enumerate() {
            let (name, colour) = COMPONENTS[component];
            put!(
                svg,
                "<text x=\"{:.1}\" y=\"16\" text-anchor=\"end\" fill=\"{colour}\">{name}</text>",
                left + width - 44.0 * (2 - component) as f64
            );
            let Some(line) = line else { continue };
            let ends = [-3.6, 3.6].map(|z| (z, (line.reference[0] + z * line.reference[1]).clamp(y[0], y[1])));
            panel.line(
                &mut svg,
                ends.into_iter(),
                &format!("stroke=\"{colour}\" stroke-width=\"0.8\" stroke-dasharray=\"4 4\""),
            );
            for (z, value) in grid.iter().zip(&line.quantiles).filter(|(_, value)| value.is_finite()) {
                put!(
                    svg,
                    "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.6\" fill=\"{colour}\"/>",
                    panel.px(*z),
                    panel.py(f64::from(*value))
                );
            }
        }
        panel.x_label(&mut svg, "probability");
        if at == 0 {
            let label = if plots.second_residual {
                "residual 2, N·m·s"
            } else {
                "residual 1, N·m·s"
            };
            panel.y_label(&mut svg, label);
        }
    }
    page(TOP + HEIGHT + BOTTOM, &svg, "Normal plot of the first residual")
}

fn verdicts(plots: &Plots, summary: &Summary) -> String {
    const LANE: f64 = 15.0;
    let rotors = plots.rotor_count as f64;
    let height = LANE * (rotors + 2.2);
    let x = [0.0, plots.end_s];
    let present: Vec<(Evaluator, &Verdicts)> = Evaluator::ALL
        .into_iter()
        .zip(&plots.verdicts)
        .filter(|(evaluator, _)| !summary.is_absent(*evaluator))
        .collect();
    let mut lanes = vec![(-1.0, "unknown".to_owned()), (0.0, "healthy".to_owned())];
    lanes.extend((1..=plots.rotor_count).map(|rotor| (rotor as f64, rotor.to_string())));
    let mut svg = String::new();
    let mut top = TOP;
    for (at, (evaluator, verdicts)) in present.iter().enumerate() {
        let last = at + 1 == present.len();
        let panel = Panel {
            left: LEFT,
            top,
            width: WIDTH - LEFT - RIGHT,
            height,
            x,
            y: [-1.6, rotors + 0.6],
        };
        panel.frame(&mut svg, &summary.intervals, &lanes, &ticks(x, 9.0), last);
        let mut mark = |from: f64, to: f64, code: i32, thick: f64, fill: &str| {
            put!(
                svg,
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{thick}\" fill=\"{fill}\"/>",
                panel.px(from),
                panel.py(f64::from(code)) - thick / 2.0,
                (panel.px(to) - panel.px(from)).max(1.0)
            );
        };
        for interval in &summary.intervals {
            let healthy = [HEALTHY];
            let faulty: Vec<i32> = interval.faulty_rotors.iter().map(|rotor| rotor.cast_signed()).collect();
            for code in if faulty.is_empty() { &healthy[..] } else { &faulty } {
                mark(interval.start_s, interval.end_s, *code, 0.85 * LANE, "#d5e4f7");
            }
        }
        for interval in &summary.intervals {
            for seen in &verdicts.seen {
                let (from, to) = (seen.start_s.max(interval.start_s), seen.end_s.min(interval.end_s));
                if from >= to {
                    continue;
                }
                // Bit (code + 2); "not ready" is not drawn.
                for code in (UNKNOWN..=plots.rotor_count as i32).filter(|code| seen.codes >> (code + 2) & 1 == 1) {
                    let colour = match code {
                        code if code == interval.expected_verdict => GOOD,
                        1.. if interval.faulty_rotors.contains(&code.unsigned_abs()) => GOOD,
                        UNKNOWN => WARN,
                        _ => BAD,
                    };
                    mark(from, to, code, 5.0, colour);
                }
            }
        }
        put!(
            svg,
            "<text x=\"{LEFT}\" y=\"{:.1}\" font-weight=\"600\" fill=\"{TEXT}\">{}</text>",
            top - 6.0,
            evaluator.title()
        );
        panel.names(&mut svg, &summary.intervals);
        if last {
            panel.x_label(&mut svg, "time, s");
        }
        top += height + GAP + 14.0;
    }
    if present.is_empty() {
        put!(
            svg,
            "<text x=\"{LEFT}\" y=\"40\" fill=\"{MUTED}\">no evaluator gave a verdict in this run</text>"
        );
        top += 40.0;
    }
    page(
        top - GAP - 14.0 + BOTTOM,
        &svg,
        "Verdicts: truth (pale), right (green), unknown fault (amber), wrong (red)",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_ticks_are_round_and_inside() {
        let text = |range, count| {
            ticks(range, count)
                .into_iter()
                .map(|(_, text)| text)
                .collect::<Vec<_>>()
        };
        assert_eq!(
            text([0.0, 90.0], 9.0),
            ["0", "10", "20", "30", "40", "50", "60", "70", "80", "90"]
        );
        assert_eq!(text([-0.13, 0.12], 3.0), ["−0.1", "0.0", "0.1"]);
        assert_eq!(text([1.0, 1.0], 3.0), Vec::<String>::new());
    }

    #[test]
    fn val_range_survives_what_is_not_a_number() {
        assert_eq!(range([&[f32::NAN][..]].into_iter(), 0.1), [-1.0, 1.0]);
        let [low, high] = range([&[2.0, f32::NAN, 2.0][..]].into_iter(), 0.1);
        assert!(low < 1.96 && high > 2.04);
    }
}
