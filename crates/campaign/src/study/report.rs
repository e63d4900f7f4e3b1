//! `report.html` of a campaign: the components of the web page, and these numbers.

use super::folder::program;
use super::plan::Campaign;
use super::score::severity_name;
use super::summary::CampaignSummary;
use super::tables::{listed_flights, ready, tables};
use super::totals::{DetectorTotals, Totals};
use crate::result_table::ResultTable;
use rotortwin_page::Report;
use serde::Serialize;

/// Maximum number of curves in the operating chart: more are indistinguishable.
const MOST_CURVES: usize = 8;

/// Embedded data of the page.
#[derive(Serialize)]
struct Inside<'a> {
    name: &'a str,
    description: &'a str,
    seed: u64,
    planned: u64,
    /// As in `summary.json` and on the server.
    result: CampaignSummary,
    tables: Vec<ResultTable>,
    delays: Vec<Delays<'a>>,
    operating: Vec<Operating>,
    facts: Vec<(&'static str, String)>,
    notes: Vec<String>,
}

/// Delays to isolation of one detector, sorted, and how many flights had been isolated by then.
#[derive(Serialize)]
struct Delays<'a> {
    detector: &'a str,
    fault_flights: u64,
    delay_s: Vec<f64>,
    isolated: Vec<u64>,
}

/// False alarms per hour versus median delay over the thresholds, for one severity.
#[derive(Serialize)]
struct Operating {
    severity: String,
    level: Vec<f32>,
    delay_s: Vec<f64>,
    alarms_per_h: Vec<f64>,
}

/// The page.
///
/// # Panics
/// Never: text and numbers are JSON.
pub fn render(campaign: &Campaign, totals: &Totals) -> String {
    let document = campaign.document();
    let mut all = tables(campaign, totals);
    all.extend(listed_flights(campaign, totals));
    let summary = format!("{}: {}", document.description, totals.in_words(campaign.flights()));
    let axes = campaign
        .axes()
        .iter()
        .map(|axis| format!("{}: {}", axis.name, axis.words()));
    let rest = "In the same folder: campaign.parquet and campaign.csv, a row for each flight; summary.json, these numbers. The same command \
                and program give the same numbers on every machine, with any number of threads.";
    let inside = Inside {
        name: &document.name,
        description: &document.description,
        seed: document.seed,
        planned: campaign.flights(),
        result: CampaignSummary::new(campaign, totals),
        tables: all,
        delays: delays(totals),
        operating: operating(totals),
        facts: vec![
            ("command", campaign.command()),
            ("program", program()),
            ("hash of all flights", totals.hash()),
        ],
        notes: axes.chain([rest.to_owned()]).collect(),
    };
    Report {
        kind: "campaign",
        title: &format!("{} · campaign", document.name),
        summary: &summary,
        program: &program(),
        data: &inside,
    }
    .render()
    .expect("text and numbers are JSON")
}

fn delays(totals: &Totals) -> Vec<Delays<'_>> {
    ready(totals)
        .filter(|(_, detector)| detector.isolated.total() > 0)
        .map(|(name, detector)| {
            let (delay_s, isolated) = detector.isolated.cumulative().unzip();
            Delays {
                detector: name,
                fault_flights: detector.fault_flights,
                delay_s,
                isolated,
            }
        })
        .collect()
}

fn operating(totals: &Totals) -> Vec<Operating> {
    let point = |detector: &DetectorTotals, bin: usize| {
        let (_, delays) = detector.delay_by_severity.get(&bin)?;
        Some((delays.quantile_s(0.5)?, detector.false_alarms_per_h()?))
    };
    let curves = totals.severities().into_iter().map(|bin| {
        let points = totals
            .curve
            .iter()
            .filter_map(|(level, detector)| Some((*level, point(detector, bin)?)));
        let mut curve = Operating {
            severity: format!("{} lost", severity_name(bin)),
            level: Vec::new(),
            delay_s: Vec::new(),
            alarms_per_h: Vec::new(),
        };
        for (level, (delay_s, alarms_per_h)) in points {
            curve.level.push(level);
            curve.delay_s.push(delay_s);
            curve.alarms_per_h.push(alarms_per_h);
        }
        curve
    });
    curves
        .filter(|curve| !curve.level.is_empty())
        .take(MOST_CURVES)
        .collect()
}
