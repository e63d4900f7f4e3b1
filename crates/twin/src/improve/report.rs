//! `report.html` and `improvement.json` of an improvement: the waterfall as plots and as a table; one file, no network, no script
//! needed.

use std::fmt::Write as _;
use std::path::Path;

use rotortwin_store::REPORT_CSS;
use rotortwin_store::page::{Page, escape};

use super::{End, Improvement, OnLog, Row, Value};

const CSS: &str = include_str!("../../assets/improve.css");
const THEME_JS: &str = "const b=document.getElementById('theme');b.hidden=false;b.onclick=()=>{const r=document.documentElement,\
    d=r.dataset.theme||(matchMedia('(prefers-color-scheme: dark)').matches?'dark':'light');r.dataset.theme=d==='dark'?'light':'dark';};";

/// Quantities of the waterfall, beside open loop.
pub const QUANTITIES: [&str; 3] = ["force", "torque", "voltage"];
/// Horizon of the open-loop plot, s.
pub const HORIZON_S: f64 = 1.0;

macro_rules! put {
    ($html:expr, $($part:tt)*) => { write!($html, $($part)*).expect("a String takes everything") };
}

/// Writes both files into a folder.
///
/// # Errors
/// One sentence with the path.
pub fn write(folder: &Path, improvement: &Improvement) -> Result<(), String> {
    let json = serde_json::to_string_pretty(improvement).expect("text and numbers are JSON");
    let fail = |path: &Path, error: std::io::Error| format!("cannot write {}: {error}", path.display());
    std::fs::create_dir_all(folder).map_err(|error| fail(folder, error))?;
    for (name, content) in [("improvement.json", json + "\n"), ("report.html", render(improvement))] {
        let path = folder.join(name);
        std::fs::write(&path, content).map_err(|error| fail(&path, error))?;
    }
    Ok(())
}

/// `k_d = 0.2530 ± 0.0020 N·s/m`, with the half width of the 95 % interval.
pub fn value_text(p: &Value) -> String {
    let digits = if p.interval_95 > 0.0 {
        (1 - p.interval_95.log10().floor() as i32).clamp(0, 8) as usize
    } else {
        4
    };
    let unit = if p.unit.is_empty() {
        String::new()
    } else {
        format!(" {}", p.unit)
    };
    format!("{} = {:.digits$} ± {:.digits$}{unit}", p.symbol, p.value, p.interval_95)
}

/// Three significant digits.
pub fn short(value: f64) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let decimals = (2 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    format!("{value:.decimals$}")
}

/// Open-loop position error after [`HORIZON_S`], m.
pub fn open_loop_m(log: &OnLog) -> Option<f64> {
    log.open_loop
        .iter()
        .find(|open| (open.horizon_s - HORIZON_S).abs() < 1e-9)
        .map(|open| open.position_m)
        .filter(|error| error.is_finite())
}

/// The page.
pub fn render(improvement: &Improvement) -> String {
    let names: Vec<&str> = improvement.fitted.iter().map(|log| log.name.as_str()).collect();
    Page {
        title: &format!("Improvement · {}", names.join(", ")),
        css: &format!("{REPORT_CSS}\n{CSS}"),
        body: &body(improvement),
        data: "{}",
        js: THEME_JS,
    }
    .render()
}

fn body(improvement: &Improvement) -> String {
    let mut html = String::new();
    put!(
        html,
        "<header><div class=\"top\"><h1>Version by version</h1><span class=\"spacer\"></span>\
         <button type=\"button\" id=\"theme\" hidden>light / dark</button></div></header>"
    );
    let class = if improvement.end == End::Agrees { "good" } else { "bad" };
    put!(
        html,
        "<p class=\"verdictline {class}\">{}</p>",
        escape(&improvement.reason)
    );
    if let Some(advice) = &improvement.next_flight {
        put!(html, "<p class=\"verdictline bad\">{}</p>", escape(advice));
    }
    versions(&mut html, improvement);
    let logs = improvement.rows.first().map_or(0, |row| row.logs.len());
    for place in 0..logs {
        waterfall(&mut html, improvement, place);
    }
    if let Some(diagnosis) = &improvement.diagnosis {
        put!(
            html,
            "<section><div class=\"head\"><h2>The last diagnosis</h2></div><p>{}</p>",
            escape(&diagnosis.sentence)
        );
        if !diagnosis.not_testable.is_empty() {
            html.push_str("<p class=\"muted\">Not testable on these flights: ");
            let names: Vec<String> = diagnosis
                .not_testable
                .iter()
                .map(|row| escape(&row.label.to_lowercase()))
                .collect();
            put!(html, "{}.</p>", names.join(", "));
        }
        html.push_str("</section>");
    }
    put!(
        html,
        "<footer>{}. Errors are root mean squares of means over 0.1 s; rotor biases and the charge at the start are fitted to each log \
         for each version. Made without network access; works offline.</footer>",
        escape(improvement.tool)
    );
    html
}

fn versions(html: &mut String, improvement: &Improvement) {
    html.push_str(
        "<section><div class=\"head\"><h2>Versions</h2><span class=\"ref\">± is the 95 % interval</span></div><div class=\"scroll\">\
         <table class=\"small\"><thead><tr><th class=\"l\">version</th><th class=\"l\">added</th><th class=\"l\">parameters</th><th>ln BF</th>\
         <th class=\"l\">hash</th></tr></thead><tbody>",
    );
    for row in &improvement.rows {
        let values: Vec<String> = row.parameters.iter().map(|p| escape(&value_text(p))).collect();
        put!(
            html,
            "<tr class=\"{}\"><td class=\"l\">{}</td><td class=\"l\">{}</td><td class=\"l\">{}</td><td>{}</td><td class=\"l mono\">{}…</td></tr>",
            if row.oracle { "oracle" } else { "" },
            escape(&row.version),
            escape(row.added.as_deref().unwrap_or("the vehicle as given")),
            values.join("<br>"),
            row.ln_bayes_factor.map_or_else(String::new, |ln| format!("{ln:.0}")),
            &row.hash[..8]
        );
    }
    html.push_str("</tbody></table></div>");
    for remark in improvement.rows.iter().flat_map(|row| &row.remarks) {
        put!(html, "<p class=\"remark\">{}</p>", escape(remark));
    }
    html.push_str("</section>");
}

fn waterfall(html: &mut String, improvement: &Improvement, place: usize) {
    let of: Vec<(&Row, &OnLog)> = improvement
        .rows
        .iter()
        .filter_map(|row| Some((row, row.logs.get(place)?)))
        .collect();
    let Some((_, first)) = of.first() else { return };
    let badge = if first.held_out {
        "held out: no fit has seen it"
    } else {
        "fitted"
    };
    put!(
        html,
        "<h2 class=\"logname\">{}<span class=\"badge\">{badge}</span></h2><section><div class=\"wf\">",
        escape(&first.log)
    );
    for quantity in QUANTITIES {
        let Some(floor) = first.error_of(quantity) else {
            continue;
        };
        let bars: Vec<(&Row, f64)> = of
            .iter()
            .filter_map(|(row, log)| Some((*row, log.error_of(quantity)?.error)))
            .collect();
        plot(html, &format!("{quantity}, {}", floor.unit), &bars, Some(floor.noise));
    }
    let bars: Vec<(&Row, f64)> = of
        .iter()
        .filter_map(|(row, log)| Some((*row, open_loop_m(log)?)))
        .collect();
    if !bars.is_empty() {
        plot(
            html,
            &format!("open loop, position after {HORIZON_S:.0} s, m"),
            &bars,
            None,
        );
    }
    html.push_str("</div></section>");
}

/// Bars of the versions, what fell between them, and the noise as a line.
fn plot(html: &mut String, title: &str, bars: &[(&Row, f64)], noise: Option<f64>) {
    const WIDTH: f64 = 340.0;
    const HEIGHT: f64 = 190.0;
    const TOP: f64 = 20.0;
    const BOTTOM: f64 = 34.0;
    let most = bars.iter().map(|b| b.1).fold(noise.unwrap_or(0.0), f64::max).max(1e-12);
    let y = |value: f64| HEIGHT - BOTTOM - (HEIGHT - BOTTOM - TOP) * value / most;
    let slot = WIDTH / bars.len() as f64;
    let wide = (0.62 * slot).min(70.0);
    let floor = noise.map_or_else(String::new, |noise| {
        format!(" <span class=\"muted\">– – noise {}</span>", short(noise))
    });
    put!(
        html,
        "<div><h3>{}{floor}</h3><svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">\
         <line class=\"base\" x1=\"0\" x2=\"{WIDTH}\" y1=\"{2}\" y2=\"{2}\"/>",
        escape(title),
        escape(title),
        y(0.0)
    );
    let mut before: Option<f64> = None;
    for (i, (row, value)) in bars.iter().enumerate() {
        let x = (i as f64 + 0.5) * slot;
        let left = x - 0.5 * wide;
        if let Some(old) = before.filter(|_| !row.oracle) {
            let (class, top, low) = if old >= *value {
                ("fallen", y(old), y(*value))
            } else {
                ("grown", y(*value), y(old))
            };
            put!(
                html,
                "<rect class=\"{class}\" x=\"{left:.1}\" y=\"{top:.1}\" width=\"{wide:.1}\" height=\"{:.1}\"/>",
                low - top
            );
        }
        put!(
            html,
            "<rect class=\"bar{}\" x=\"{left:.1}\" y=\"{:.1}\" width=\"{wide:.1}\" height=\"{:.1}\"/>\
             <text class=\"value\" x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
             <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            if row.oracle { " oracle" } else { "" },
            y(*value),
            y(0.0) - y(*value),
            y(*value) - 4.0,
            short(*value),
            HEIGHT - BOTTOM + 14.0,
            escape(row.version.rsplit('@').next().unwrap_or(&row.version))
        );
        if let Some(added) = row.added.as_deref().filter(|_| !row.oracle) {
            let most = ((slot / 5.6) as usize).max(6);
            let text: String = if added.chars().count() > most {
                added.chars().take(most - 1).chain(['…']).collect()
            } else {
                added.to_owned()
            };
            put!(
                html,
                "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">+ {}</text>",
                HEIGHT - BOTTOM + 28.0,
                escape(&text.to_lowercase())
            );
        }
        before = Some(*value);
    }
    if let Some(noise) = noise {
        put!(
            html,
            "<line class=\"noise\" x1=\"0\" x2=\"{WIDTH}\" y1=\"{0:.1}\" y2=\"{0:.1}\"/>",
            y(noise)
        );
    }
    html.push_str("</svg></div>");
}
