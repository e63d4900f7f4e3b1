//! The picture in `ARCHITECTURE.md`: layers of crates, and layers of modules in each crate.

use super::crates::Crates;
use super::graph::Graph;
use anyhow::{Context, Result};
use std::collections::BTreeMap;

const BEGIN: &str = "<!-- Written by `cargo xtask rooms`; change the code, not this block. -->";
const END: &str = "<!-- End of what `cargo xtask rooms` writes. -->";

/// Longest line.
const WIDTH: usize = 120;

/// The block of the page.
///
/// * `tops`: the top-layer modules of each crate, by folder
pub(super) fn draw(crates: &Crates, tops: &BTreeMap<&str, &Graph>) -> String {
    let mut text = String::from("```text\n");
    let floors = crates.graph.floors();
    for (floor, groups) in floors.iter().enumerate().rev() {
        for room in groups.iter().flatten() {
            let line = format!("{:>2}  {room:<12} {}", floor + 1, crates.graph.nearest(room).join(", "));
            text.push_str(line.trim_end());
            text.push('\n');
        }
    }
    text.push_str("```\n\n```text");
    for (place, graph) in tops {
        let floors = graph.floors();
        if graph.0.len() < 2 {
            continue;
        }
        text.push_str(&format!("\n{place}\n"));
        for (floor, groups) in floors.iter().enumerate().rev() {
            let names = groups.iter().flat_map(|group| match group.as_slice() {
                [room] => vec![(*room).to_owned()],
                [first, between @ .., last] => [format!("(circle: {first}")]
                    .into_iter()
                    .chain(between.iter().map(|room| (*room).to_owned()))
                    .chain([format!("{last})")])
                    .collect(),
                [] => Vec::new(),
            });
            text.push_str(&wrapped(&format!("{:>2}", floor + 1), names));
        }
    }
    text.push_str("```\n");
    text
}

/// Words after a label, wrapped.
fn wrapped(label: &str, words: impl Iterator<Item = String>) -> String {
    let (mut text, mut line) = (String::new(), label.to_owned());
    for word in words {
        if line.len() + 2 + word.len() > WIDTH {
            text += &line;
            text.push('\n');
            line = " ".repeat(label.len());
        }
        line += "  ";
        line += &word;
    }
    text + &line + "\n"
}

/// The page with the block inserted.
pub(super) fn inserted(page: &str, picture: &str) -> Result<String> {
    let (before, rest) = page.split_once(BEGIN).with_context(|| format!("no line {BEGIN:?}"))?;
    let (_, after) = rest.split_once(END).with_context(|| format!("no line {END:?}"))?;
    Ok(format!("{before}{BEGIN}\n{picture}{END}{after}"))
}
