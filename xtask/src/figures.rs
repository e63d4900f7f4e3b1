//! Checks that figures repeated on another page are identical.
//!
//! A page that repeats figures is listed in [`REPEATED`] with the heading and the page repeated. Below that heading, every number with a
//! decimal point and every rate (`85 k`, `3 M`) must also be on that page, and every table row if the table is the same: after a new
//! measurement, the check names the other page to update. Pages that give the number of effects ([`COUNTING_EFFECTS`]) are compared with
//! the catalogue itself.

use anyhow::{Context, Result, bail};
use std::collections::BTreeSet;
use std::path::Path;

/// What a section repeats.
#[derive(Clone, Copy, PartialEq)]
enum Repeats {
    /// Figures, in words or a table of its own.
    Figures,
    /// Whole table rows, too.
    Rows,
}

/// Page, heading, the page with the original figures, and what is repeated.
const REPEATED: [(&str, &str, &str, Repeats); 4] = [
    ("README.md", "## Start here", "docs/python.md", Repeats::Figures),
    ("README.md", "## A hundred flights", "docs/figures.md", Repeats::Rows),
    ("README.md", "## The paper's tables", "docs/figures.md", Repeats::Rows),
    ("docs/hosts.md", "## Links", "docs/figures.md", Repeats::Figures),
];
/// Pages that say "The catalogue has N effects".
const COUNTING_EFFECTS: [&str; 2] = ["README.md", "docs/commands.md"];
/// The catalogue: one declaration per line.
const CATALOGUE: &str = "crates/plant/src/effects/catalogue.rs";

/// Fails with a line for each row and each figure that is on only one of the pages, and for each wrong number of effects.
pub(crate) fn check(root: &Path) -> Result<()> {
    let read = |page: &str| std::fs::read_to_string(root.join(page)).with_context(|| page.to_owned());
    let mut complaints = Vec::new();
    for (page, heading, source, repeats) in REPEATED {
        let (text, known) = (read(page)?, read(source)?);
        let Some(section) = section(&text, heading) else {
            bail!(
                "{page}: there is no heading '{heading}'; expected it there, or its line gone from xtask/src/figures.rs"
            );
        };
        for row in section.lines().filter(|line| line.starts_with('|')) {
            if repeats == Repeats::Rows && !known.lines().any(|line| line == row) {
                complaints.push(format!("{page}, {heading}: {source} has no row {row}"));
            }
        }
        let known = figures(&known);
        for figure in figures(section).difference(&known) {
            complaints.push(format!("{page}, {heading}: {figure} is not in {source}"));
        }
    }
    let effects = read(CATALOGUE)?
        .lines()
        .filter(|line| line.starts_with("    &"))
        .count();
    let sentence = format!("The catalogue has {effects} effects");
    for page in COUNTING_EFFECTS {
        if !read(page)?.contains(&sentence) {
            complaints.push(format!("{page}: expected '{sentence}', as in {CATALOGUE}"));
        }
    }
    if complaints.is_empty() {
        return Ok(());
    }
    bail!("figures that differ between pages\n  {}", complaints.join("\n  "))
}

/// The text below a heading, up to the next one of the same or a higher level.
fn section<'a>(text: &'a str, heading: &str) -> Option<&'a str> {
    let rank = heading.bytes().take_while(|byte| *byte == b'#').count();
    let mut lines = text.split_inclusive('\n').scan(0, |end, line| {
        *end += line.len();
        Some((*end, line))
    });
    let (start, _) = lines.find(|(_, line)| line.trim_end() == heading)?;
    let end = lines.find(|(_, line)| {
        let marks = line.bytes().take_while(|byte| *byte == b'#').count();
        (1..=rank).contains(&marks) && line.as_bytes().get(marks) == Some(&b' ')
    });
    let end = end.map_or(text.len(), |(end, line)| end - line.len());
    text.get(start..end)
}

/// Numbers with a decimal point and whole thousands and millions (`85 k`), as text.
fn figures(text: &str) -> BTreeSet<&str> {
    let mut found = BTreeSet::new();
    let mut rest = text;
    while let Some(start) = rest.find(|letter: char| letter.is_ascii_digit()) {
        let number = &rest[start..];
        let end = number
            .find(|letter: char| !letter.is_ascii_digit() && letter != '.')
            .unwrap_or(number.len());
        let (word, after) = number.split_at(end);
        let trimmed = word.trim_end_matches('.');
        let unit = after.get(..2).filter(|unit| matches!(*unit, " k" | " M"));
        let is_rate = unit.is_some() && !after[2..].starts_with(char::is_alphanumeric);
        match trimmed.split('.').count() {
            1 if is_rate && trimmed == word => found.insert(&number[..end + 2]),
            2 => found.insert(trimmed),
            _ => false,
        };
        rest = after;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_section_ends_with_the_next_heading_of_its_rank() {
        let text = "# Page\n## One\n1.5\n### Below\n2.5\n## Two\n3.5\n";
        assert_eq!(section(text, "## One"), Some("1.5\n### Below\n2.5\n"));
        assert_eq!(section(text, "## Two"), Some("3.5\n"));
        assert_eq!(section(text, "## Three"), None);
    }

    #[test]
    fn val_figures_are_numbers_with_a_point() {
        let text = "**84.81** %, 0.063 / 0.188 s, 48 flights of 90 s. See 1.2.3";
        assert_eq!(figures(text), ["0.063", "0.188", "84.81"].into());
    }

    #[test]
    fn val_rates_are_figures() {
        let text = "| 1.08 M | 85 k steps/s, 21 k. 7 kg, 3 Mar, 12 µs, 4 °";
        assert_eq!(figures(text), ["1.08", "21 k", "85 k"].into());
    }

    #[test]
    fn val_a_figure_that_was_changed_on_one_page_is_told() {
        let place = std::env::temp_dir().join(format!("figures-{}", std::process::id()));
        std::fs::create_dir_all(place.join("docs")).unwrap();
        std::fs::create_dir_all(place.join(CATALOGUE).parent().unwrap()).unwrap();
        let write = |name: &str, text: &str| std::fs::write(place.join(name), text).unwrap();
        let page = |alarms: &str, figure: &str, loss: &str, effects: u32| {
            format!(
                "## Start here\nlost {loss} %\n## A hundred flights\n| T-test | {alarms} |\n## The paper's tables\nTable 6: {figure} %\n\
                 ## Speed\n9.9\nThe catalogue has {effects} effects.\n"
            )
        };
        write(
            CATALOGUE,
            "static CATALOGUE: &[&Effect] = &[\n    &one::ONE,\n    &two::TWO,\n];\n",
        );
        write("docs/commands.md", "The catalogue has 2 effects.\n");
        write("docs/python.md", "lost 7.9 %\n");
        write("docs/hosts.md", "## Links\n| iceoryx2 | 85 k |\n");
        write(
            "docs/figures.md",
            "| T-test | 230 |\n| Table 6 | 95.39 % |\n| over iceoryx2 | 85 k steps/s |\n",
        );
        write("README.md", &page("230", "95.39", "7.9", 2));
        check(&place).unwrap();
        write("README.md", &page("231", "95.40", "7.8", 3));
        write("docs/hosts.md", "## Links\n| iceoryx2 | 86 k |\n");
        let complaint = check(&place).unwrap_err().to_string();
        std::fs::remove_dir_all(&place).unwrap();
        for part in [
            "95.40 is not in docs/figures.md",
            "has no row | T-test | 231 |",
            "7.8 is not in docs/python.md",
            "docs/hosts.md, ## Links: 86 k is not in docs/figures.md",
            "README.md: expected 'The catalogue has 2 effects'",
        ] {
            assert!(complaint.contains(part), "{part}: {complaint}");
        }
        assert!(!complaint.contains("no row | iceoryx2"), "{complaint}");
    }
}
