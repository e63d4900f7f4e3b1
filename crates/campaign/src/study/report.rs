//! `report.html` of a campaign: one file, no script, no network, light and dark, in the style of the report of a run.

use super::charts;
use super::folder::program;
use super::plan::Campaign;
use super::tables::{alarm_rate, listed_flights, percent, seconds, tables, title};
use super::totals::Totals;
use crate::result_table::ResultTable;
use std::fmt::Write as _;

/// `write!` into a String cannot fail.
macro_rules! put {
    ($html:expr, $($part:tt)*) => { write!($html, $($part)*).expect("a String takes everything") };
}

/// The page; `css` is the style sheet of the reports of runs.
pub fn render(campaign: &Campaign, totals: &Totals, css: &str) -> String {
    let document = campaign.document();
    let mut html = String::with_capacity(1 << 18);
    put!(
        html,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\">\n<meta name=\"color-scheme\" content=\"light dark\">\n<meta \
         http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; img-src data:\">\n\
         <title>{name} · campaign</title>\n<link rel=\"icon\" href=\"data:,\">\n<style>{css}\n{}</style>\n</head>\n<body>\n<main>\n",
        charts::CSS,
        name = escape(&document.name),
    );
    let complete = totals.flights == campaign.flights();
    put!(
        html,
        "<header><div class=\"top\"><h1>{}</h1><span class=\"pill {}\">{}</span></div><p class=\"sub\">{} · seed {}</p></header>",
        escape(&document.name),
        if complete { "done" } else { "canceled" },
        if complete { "complete" } else { "in part" },
        escape(&document.description),
        document.seed
    );
    if !complete {
        put!(
            html,
            "<div class=\"box canceled\"><p>{} of {} flights are there; the same command goes on.</p></div>",
            totals.flights,
            campaign.flights()
        );
    }
    tiles(&mut html, totals);
    let all = tables(campaign, totals);
    let (first, rest) = all.split_at(2.min(all.len()));
    first.iter().for_each(|table| result_table(&mut html, table));
    if let Some(chart) = charts::delay_chart(totals) {
        put!(
            html,
            "<section><div class=\"head\"><h2>Delay to isolation</h2></div><p class=\"about\">Share of the flights with a fault whose \
             rotor has been named.</p>{chart}</section>"
        );
    }
    html.push_str(
        "<section><div class=\"head\"><h2>Confusion matrices</h2></div><p class=\"about\">Shares of the windows of each truth, percent; \
         rotors by number, from 1.</p><div class=\"matrices\">",
    );
    for (place, detector) in totals.detectors.iter().enumerate() {
        if detector.windows.total() > 0 {
            html.push_str(&charts::confusion_matrix(detector, title(place)));
        }
    }
    html.push_str("</div></section>");
    for table in rest {
        result_table(&mut html, table);
        if table.key == "operating"
            && let Some(chart) = charts::operating_chart(totals)
        {
            html.push_str(&chart);
        }
    }
    listed_flights(campaign, totals)
        .iter()
        .for_each(|table| result_table(&mut html, table));
    footer(&mut html, campaign, totals);
    html.push_str("</main>\n</body>\n</html>\n");
    html
}

fn tiles(html: &mut String, totals: &Totals) {
    let sequential = &totals.detectors[0];
    let mut tiles = vec![(
        "flights",
        totals.flights.to_string(),
        format!(
            "{:.2} h flown; {} failed, {} could not be flown",
            totals.flown_h(),
            totals.failed,
            totals.refused
        ),
    )];
    if sequential.windows.total() > 0 {
        let interval = sequential.windows.interval().map_or_else(String::new, |[low, high]| {
            format!("95 %: {} to {} %", percent(Some(low)), percent(Some(high)))
        });
        tiles.push((
            "windows right, sequential",
            format!("{} <small>%</small>", percent(sequential.windows.share())),
            interval,
        ));
        tiles.push((
            "false alarms, sequential",
            sequential.false_alarm_events.to_string(),
            escape(&alarm_rate(sequential)),
        ));
    }
    if sequential.isolated.total() > 0 {
        tiles.push((
            "isolated after, sequential",
            format!(
                "{} <small>s, median</small>",
                seconds(sequential.isolated.quantile_s(0.5))
            ),
            format!(
                "worst {} s; {} of {} flights",
                seconds(sequential.isolated.quantile_s(1.0)),
                sequential.isolated.total(),
                sequential.fault_flights
            ),
        ));
    }
    html.push_str("<div class=\"tiles\">");
    for (what, value, more) in tiles {
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
        for cell in row {
            let words = cell.starts_with("rotortwin campaign");
            put!(
                html,
                "<td{}>{}</td>",
                if words { " class=\"mono l\"" } else { "" },
                escape(cell)
            );
        }
        html.push_str("</tr>");
    }
    html.push_str("</tbody></table></div>");
    if !table.notes.is_empty() {
        html.push_str("<ul class=\"list\">");
        for note in &table.notes {
            put!(html, "<li>{}.</li>", escape(note));
        }
        html.push_str("</ul>");
    }
    html.push_str("</section>");
}

fn footer(html: &mut String, campaign: &Campaign, totals: &Totals) {
    html.push_str("<footer><dl>");
    for (name, value) in [
        ("command", format!("rotortwin campaign {}", campaign.path().display())),
        ("program", program()),
        ("hash of all flights", totals.hash()),
    ] {
        put!(html, "<dt>{name}</dt><dd class=\"mono\">{}</dd>", escape(&value));
    }
    html.push_str("</dl>");
    for axis in campaign.axes() {
        put!(html, "<p>{}: {}</p>", escape(&axis.name), escape(&axis.words()));
    }
    html.push_str(
        "<p>In the same folder: campaign.parquet and campaign.csv, a row for each flight; summary.json, these numbers. The same command and \
         program give the same numbers on every machine, with any number of threads.</p></footer>",
    );
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
