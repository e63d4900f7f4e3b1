//! `report.html` of a reproduction: tables, choices, figures; one file, no script, no network.

use super::Reproduction;
use super::tables::choices;
use crate::result_table::ResultTable;
use std::fmt::Write as _;

/// A still picture of the reference flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// `Fig. 9`, ….
    pub label: String,
    /// What it shows.
    pub title: String,
    /// What to see in it.
    pub about: String,
    /// The picture, an SVG document.
    pub svg: String,
    /// Interactive report of the flight, relative to the page.
    pub report: String,
}

/// What the page says besides the numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PageFacts {
    /// Style sheet.
    pub css: String,
    /// Command line that makes the page again.
    pub command: String,
    /// Program and version.
    pub program: String,
    /// Other files of the folder, for people.
    pub files: Vec<String>,
}

/// `write!` into a String cannot fail.
macro_rules! put {
    ($html:expr, $($part:tt)*) => { write!($html, $($part)*).expect("a String takes everything") };
}

/// The page.
pub fn render(reproduction: &Reproduction, tables: &[ResultTable], figures: &[Figure], facts: &PageFacts) -> String {
    let mut html = String::with_capacity(1 << 20);
    put!(
        html,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\">\n<meta name=\"color-scheme\" content=\"light dark\">\n<meta \
         http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; img-src data:\">\n\
         <title>The paper's tables, reproduced</title>\n<link rel=\"icon\" href=\"data:,\">\n<style>{}\n{EXTRA_CSS}</style>\n</head>\n\
         <body>\n<main>\n",
        facts.css
    );
    let seeds: Vec<String> = reproduction.seeds.iter().map(|seed| seed.seed.to_string()).collect();
    put!(
        html,
        "<header><h1>The paper's tables, reproduced</h1><p class=\"sub\">{} · {} rotors · {} · seeds {}</p></header>",
        escape(&reproduction.vehicle),
        reproduction.rotor_count,
        escape(&reproduction.world),
        seeds.join(", ")
    );
    tiles(&mut html, reproduction);
    for table in tables {
        result_table(&mut html, table);
    }
    choice_table(&mut html);
    if !figures.is_empty() {
        html.push_str(
            "<section><div class=\"head\"><h2>Figures</h2><span class=\"ref\">reference flight, §6.1</span></div><p class=\"about\">The \
             networks of these flights were trained without the trajectory that is flown.</p></section>",
        );
    }
    for figure in figures {
        put!(
            html,
            "<section><div class=\"head\"><h2>{}</h2><span class=\"ref\">paper, {}</span></div><p class=\"about\">{} <a \
             href=\"{}\">Interactive report of this flight</a></p><div class=\"figure\">{}</div></section>",
            escape(&figure.title),
            escape(&figure.label),
            escape(&figure.about),
            escape(&figure.report),
            inline_svg(&figure.svg)
        );
    }
    footer(&mut html, reproduction, facts);
    html.push_str("</main>\n</body>\n</html>\n");
    html
}

/// Figures are drawn for white paper.
const EXTRA_CSS: &str = "
.figure { margin-top: 12px; background: #ffffff; border: 1px solid var(--line); border-radius: 8px; padding: 10px; overflow-x: auto; }
.figure svg { max-width: 100%; height: auto; display: block; }
table.small th:nth-child(2), table.small td:nth-child(2) { color: var(--muted); }
table.small td { font-size: 13.5px; }
ul.notes { color: var(--muted); font-size: 13.5px; max-width: 100ch; padding-left: 18px; }
";

fn tiles(html: &mut String, reproduction: &Reproduction) {
    let flights: usize = reproduction.seeds.iter().map(|seed| seed.flights).sum();
    let hours = reproduction.seeds.iter().map(|seed| seed.steps).sum::<u64>() as f64 * 0.0025 / 3600.0;
    html.push_str("<div class=\"tiles\">");
    for (what, value, more) in [
        (
            "seeds",
            reproduction.seeds.len().to_string(),
            "noise, lift biases, splits, initial weights".to_owned(),
        ),
        ("flights", flights.to_string(), format!("{hours:.1} h of flight")),
    ] {
        put!(
            html,
            "<div class=\"tile\"><div class=\"what\">{what}</div><div class=\"value\">{value}</div><div class=\"more\">{more}</div></div>"
        );
    }
    html.push_str("</div>");
}

fn result_table(html: &mut String, table: &ResultTable) {
    put!(
        html,
        "<section><div class=\"head\"><h2>{}</h2></div><div class=\"scroll\"><table class=\"small\"><thead><tr>",
        escape(&table.title)
    );
    for column in &table.columns {
        put!(html, "<th>{}</th>", escape(column));
    }
    html.push_str("</tr></thead><tbody>");
    for row in &table.rows {
        html.push_str("<tr>");
        for (i, cell) in row.iter().enumerate() {
            // Leading spaces mark a row that belongs to the one above.
            let indented = i == 0 && cell.starts_with(' ');
            let style = if indented { " style=\"padding-left:18px\"" } else { "" };
            put!(html, "<td{style}>{}</td>", escape(cell.trim_start()));
        }
        html.push_str("</tr>");
    }
    html.push_str("</tbody></table></div><ul class=\"notes\">");
    for note in &table.notes {
        put!(html, "<li>{}.</li>", escape(note));
    }
    html.push_str("</ul></section>");
}

fn choice_table(html: &mut String) {
    html.push_str(
        "<section><div class=\"head\"><h2>Chosen where the paper is silent</h2></div><div class=\"scroll\"><table class=\"data\"><tbody>",
    );
    for (what, choice) in choices() {
        put!(
            html,
            "<tr><td class=\"truth\">{what}</td><td>{}</td></tr>",
            escape(choice)
        );
    }
    html.push_str("</tbody></table></div></section>");
}

fn footer(html: &mut String, reproduction: &Reproduction, facts: &PageFacts) {
    html.push_str("<footer><dl>");
    let hashes: Vec<&str> = reproduction.seeds.iter().map(|seed| seed.data_hash.as_str()).collect();
    for (name, value) in [
        ("command", facts.command.as_str()),
        ("program", &facts.program),
        ("vehicle model", &reproduction.model_hash),
        ("data, seed by seed", &hashes.join(" ")),
    ] {
        put!(html, "<dt>{name}</dt><dd class=\"mono\">{}</dd>", escape(value));
    }
    html.push_str("</dl>");
    if !facts.files.is_empty() {
        put!(
            html,
            "<p>In the same folder: {}. The same command and program give the same numbers on every machine, with any number of \
             threads.</p>",
            escape(&facts.files.join(", "))
        );
    }
    html.push_str("</footer>");
}

/// The element without the declaration of a document.
fn inline_svg(svg: &str) -> &str {
    svg.find("<svg").map_or(svg, |start| &svg[start..])
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
