//! `report.html` of a reproduction: tables, choices, figures; the components of the web page, and these numbers.

use super::Reproduction;
use super::tables::choices;
use crate::result_table::ResultTable;
use rotortwin_page::Report;
use serde::Serialize;

/// Length of a step, s.
const STEP_S: f64 = 0.0025;

/// A static figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// `Fig. 9`, ….
    pub label: String,
    /// What it shows.
    pub title: String,
    /// Explanation.
    pub about: String,
    /// The picture, an SVG document.
    pub svg: String,
    /// Interactive report of the flight, relative to the page; `None` for a figure that no flight produced.
    pub report: Option<String>,
}

/// Text of the page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PageFacts {
    /// Command line that recreates the page.
    pub command: String,
    /// Program and version.
    pub program: String,
    /// Other files of the folder, human-readable.
    pub files: Vec<String>,
}

/// Embedded data of the page.
#[derive(Serialize)]
struct Inside<'a> {
    vehicle: &'a str,
    rotor_count: usize,
    world: &'a str,
    seeds: Vec<u64>,
    flights: usize,
    hours: f64,
    tables: &'a [ResultTable],
    choices: [(&'static str, &'static str); 9],
    figures: &'a [Figure],
    facts: [(&'static str, String); 4],
    files: &'a [String],
}

/// The page.
///
/// # Panics
/// Never: text and numbers are JSON.
pub fn render(reproduction: &Reproduction, tables: &[ResultTable], figures: &[Figure], facts: &PageFacts) -> String {
    let seeds = &reproduction.seeds;
    let hashes: Vec<&str> = seeds.iter().map(|seed| seed.data_hash.as_str()).collect();
    let inside = Inside {
        vehicle: &reproduction.vehicle,
        rotor_count: reproduction.rotor_count,
        world: &reproduction.world,
        seeds: seeds.iter().map(|seed| seed.seed).collect(),
        flights: seeds.iter().map(|seed| seed.flights).sum(),
        hours: seeds.iter().map(|seed| seed.steps).sum::<u64>() as f64 * STEP_S / 3600.0,
        tables,
        choices: choices(),
        figures,
        facts: [
            ("command", facts.command.clone()),
            ("program", facts.program.clone()),
            ("vehicle model", reproduction.model_hash.clone()),
            ("data, seed by seed", hashes.join(" ")),
        ],
        files: &facts.files,
    };
    let lines = tables.iter().map(|table| {
        let rows = table.rows.iter().map(|row| row.join("  "));
        [table.title.clone(), table.columns.join("  ")]
            .into_iter()
            .chain(rows)
            .collect::<Vec<_>>()
            .join("\n")
    });
    Report {
        kind: "reproduction",
        title: "The paper's tables, reproduced",
        summary: &lines.collect::<Vec<_>>().join("\n\n"),
        program: &facts.program,
        data: &inside,
    }
    .render()
    .expect("text and numbers are JSON")
}
