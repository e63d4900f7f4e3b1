//! Fits as text for a terminal, as JSON and as one HTML file that stands alone, with data, fit and residual plots (SVG).

use super::fit::{Fit, FittedModel};

fn number(value: f64) -> String {
    if !value.is_finite() {
        return if value > 0.0 {
            "∞".to_owned()
        } else {
            "−∞".to_owned()
        };
    }
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        format!("{value:.3e}")
    } else {
        format!("{value:.4}")
    }
}

/// The fits as lines of text.
pub fn text(fits: &[Fit]) -> String {
    let mut out = String::new();
    for fit in fits {
        out += &format!("{} · {}\n", fit.kind, fit.files.join(", "));
        for note in &fit.notes {
            out += &format!("  {note}\n");
        }
        let best = fit.models.first().map_or(0.0, |model| model.aicc);
        for model in &fit.models {
            out += &format!(
                "  {:<24} rmse {}  held out {}  R2 {:.5}  dAICc {:.1}  lag-1 correlation {:.2}\n",
                model.name,
                number(model.rmse),
                number(model.held_out_rmse),
                model.r2,
                model.aicc - best,
                model.correlation
            );
            for p in &model.parameters {
                out += &format!(
                    "    {:<14} {}  [{} … {}]\n",
                    p.name,
                    number(p.value),
                    number(p.low),
                    number(p.high)
                );
            }
            for note in &model.notes {
                out += &format!("    {note}\n");
            }
        }
    }
    out
}

fn quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' => out += "\\\"",
            '\\' => out += "\\\\",
            c if (c as u32) < 0x20 => out += &format!("\\u{:04x}", c as u32),
            c => out.push(c),
        }
    }
    out + "\""
}

/// The fits as JSON; an unbounded interval is `null`.
pub fn json(fits: &[Fit]) -> String {
    let value = |x: f64| {
        if x.is_finite() {
            format!("{x:?}")
        } else {
            "null".to_owned()
        }
    };
    let list = |items: Vec<String>| format!("[{}]", items.join(", "));
    let strings = |items: &[String]| list(items.iter().map(|item| quoted(item)).collect());
    let fits = fits.iter().map(|fit| {
        let models = fit.models.iter().map(|model| {
            let parameters = model.parameters.iter().map(|p| {
                format!(
                    "{{\"name\": {}, \"value\": {}, \"low\": {}, \"high\": {}}}",
                    quoted(p.name),
                    value(p.value),
                    value(p.low),
                    value(p.high)
                )
            });
            format!(
                "{{\"name\": {}, \"equation\": {}, \"rmse\": {}, \"held_out_rmse\": {}, \"r2\": {}, \"aicc\": {}, \
                 \"lag_one_correlation\": {}, \"intervals\": {}, \"parameters\": {}, \"notes\": {}}}",
                quoted(model.name),
                quoted(model.equation),
                value(model.rmse),
                value(model.held_out_rmse),
                value(model.r2),
                value(model.aicc),
                value(model.correlation),
                quoted(model.intervals),
                list(parameters.collect()),
                strings(&model.notes)
            )
        });
        format!(
            "{{\"kind\": {}, \"files\": {}, \"points\": {}, \"models\": {}, \"notes\": {}}}",
            quoted(fit.kind),
            strings(&fit.files),
            fit.y.len(),
            list(models.collect()),
            strings(&fit.notes)
        )
    });
    list(fits.collect()) + "\n"
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 260.0;
const LEFT: f64 = 62.0;
const BOTTOM: f64 = 36.0;

/// Round steps of an axis: 1, 2 or 5 times a power of ten, about five of them.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let raw = (high - low) / 5.0;
    if raw.is_nan() || raw <= 0.0 {
        return vec![low];
    }
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * power)
        .find(|step| *step >= raw)
        .unwrap_or(10.0 * power);
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last).map(|k| k as f64 * step).collect()
}

fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let pad = 0.05 * (high - low).max(1e-9);
    (low - pad, high + pad)
}

/// A plot of points and, if given, a curve through (x, curve), both sorted by x.
fn plot(x: &[f64], y: &[f64], curve: Option<&[f64]>, x_name: &str, y_name: &str) -> String {
    let (x0, x1) = range(x.iter().copied());
    let (y0, y1) = range(y.iter().copied().chain(curve.into_iter().flatten().copied()));
    let px = |v: f64| LEFT + (v - x0) / (x1 - x0) * (WIDTH - LEFT - 10.0);
    let py = |v: f64| HEIGHT - BOTTOM - (v - y0) / (y1 - y0) * (HEIGHT - BOTTOM - 12.0);
    let mut svg = format!("<svg viewBox='0 0 {WIDTH} {HEIGHT}' role=img>");
    for t in ticks(x0, x1) {
        svg += &format!(
            "<line class=g x1={0:.1} x2={0:.1} y1=12 y2={1:.1} /><text x={0:.1} y={2:.1} text-anchor=middle>{3}</text>",
            px(t),
            HEIGHT - BOTTOM,
            HEIGHT - BOTTOM + 14.0,
            label(t)
        );
    }
    for t in ticks(y0, y1) {
        svg += &format!(
            "<line class=g x1={LEFT} x2={1:.1} y1={0:.1} y2={0:.1} /><text x={2:.1} y={3:.1} text-anchor=end>{4}</text>",
            py(t),
            WIDTH - 10.0,
            LEFT - 6.0,
            py(t) + 3.5,
            label(t)
        );
    }
    // At most 1500 marks: more cannot be seen and make the file large.
    let stride = (x.len() / 1500).max(1);
    for k in (0..x.len()).step_by(stride) {
        svg += &format!("<circle cx={:.1} cy={:.1} r=2.2 />", px(x[k]), py(y[k]));
    }
    if let Some(curve) = curve {
        let mut order: Vec<usize> = (0..x.len()).collect();
        order.sort_by(|&a, &b| x[a].total_cmp(&x[b]));
        if order.windows(2).any(|pair| x[pair[0]] == x[pair[1]]) {
            // Several values over one abscissa (thrust at several voltages) are no curve.
            for k in order {
                svg += &format!("<circle class=f cx={:.1} cy={:.1} r=4 />", px(x[k]), py(curve[k]));
            }
        } else {
            let mut path = String::new();
            for (n, &k) in order.iter().step_by(stride).enumerate() {
                path += &format!("{}{:.1} {:.1}", if n == 0 { "M" } else { "L" }, px(x[k]), py(curve[k]));
            }
            svg += &format!("<path d='{path}'/>");
        }
    }
    svg + &format!(
        "<text x={:.1} y={:.1} text-anchor=middle>{}</text><text x=4 y=10>{}</text></svg>",
        0.5 * (LEFT + WIDTH),
        HEIGHT - 4.0,
        escape(x_name),
        escape(y_name)
    )
}

fn label(value: f64) -> String {
    let text = if value != 0.0 && value.abs() < 1e-2 {
        format!("{value:.1e}")
    } else {
        format!("{value:.3}")
    };
    if text.contains('.') && !text.contains('e') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:76rem;padding:0 1rem;color:#1d2330}\
h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:2rem}table{border-collapse:collapse;font-size:.86rem;margin:.5rem 0}\
th,td{text-align:left;padding:.28rem .6rem;border-bottom:1px solid #e2e6ee}th{background:#f4f6fa}td.n{font-variant-numeric:tabular-nums}\
tr.best{background:#eaf6ee}.plots{display:flex;flex-wrap:wrap;gap:1rem}svg{width:560px;max-width:100%;font-size:10px;fill:#3d4658}\
svg circle{fill:#1d4ed8;fill-opacity:.55}svg circle.f{fill:none;stroke:#c2410c;stroke-width:1.5}svg path{fill:none;stroke:#c2410c;stroke-width:1.8}svg .g{stroke:#e2e6ee}\
p.note{color:#5a6478;font-size:.86rem;margin:.15rem 0}";

fn model_rows(model: &FittedModel, best: f64, first: bool) -> String {
    let mut text = String::new();
    for (k, p) in model.parameters.iter().enumerate() {
        text += &format!("<tr class='{}'>", if first { "best" } else { "" });
        if k == 0 {
            text += &format!(
                "<td rowspan={0}><b>{1}</b><br>{2}<td class=n rowspan={0}>{3}<td class=n rowspan={0}>{4}<td class=n rowspan={0}>{5:.5}\
                 <td class=n rowspan={0}>{6:.1}<td class=n rowspan={0}>{7:.2}",
                model.parameters.len(),
                escape(model.name),
                escape(model.equation),
                number(model.rmse),
                number(model.held_out_rmse),
                model.r2,
                model.aicc - best,
                model.correlation
            );
        }
        text += &format!(
            "<td>{}<td class=n>{}<td class=n>{} … {}",
            p.name,
            number(p.value),
            number(p.low),
            number(p.high)
        );
        if k == 0 {
            let doubt = model.notes.join("; ");
            text += &format!(
                "<td rowspan={}>{}{}{}",
                model.parameters.len(),
                model.intervals,
                if doubt.is_empty() { "" } else { "; " },
                escape(&doubt)
            );
        }
        text += "</tr>";
    }
    text
}

/// The report.
pub fn html(title: &str, fits: &[Fit]) -> String {
    let mut text = format!(
        "<!doctype html><html lang=en><meta charset=utf-8><title>{0}</title><style>{STYLE}</style><h1>{0}</h1>\
         <p class=note>Rivals ordered by AICc (ΔAICc above about 10: much worse). Held-out error: points that the fit did not see, in contiguous \
         tenths, or one by one below 30 points. Intervals: 95 %. A lag-1 correlation far from 0 means structure that the model lacks.</p>",
        escape(title)
    );
    for fit in fits {
        text += &format!("<h2>{} · {}</h2>", fit.kind, escape(&fit.files.join(", ")));
        for note in &fit.notes {
            text += &format!("<p class=note>{}</p>", escape(note));
        }
        text += "<table><tr><th>structure<th>rmse<th>held out<th>R²<th>ΔAICc<th>lag-1<th>parameter<th>value<th>95 %<th>intervals from</tr>";
        let best = fit.models.first().map_or(0.0, |model| model.aicc);
        for (k, model) in fit.models.iter().enumerate() {
            text += &model_rows(model, best, k == 0);
        }
        text += "</table><div class=plots>";
        if let Some(model) = fit.models.first() {
            let residuals: Vec<f64> = fit.y.iter().zip(&model.fitted).map(|(y, f)| y - f).collect();
            let name = format!("{} (points) and {} (line or rings)", fit.y_name, model.name);
            text += &plot(&fit.x, &fit.y, Some(&model.fitted), fit.x_name, &name);
            text += &plot(
                &fit.x,
                &residuals,
                None,
                fit.x_name,
                &format!("residual of {}, {}", model.name, fit.y_name),
            );
        }
        text += "</div>";
    }
    text + "</html>\n"
}
