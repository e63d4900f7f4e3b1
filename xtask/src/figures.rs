//! Checks that figures repeated on another page are identical.
//!
//! A page that repeats figures is listed in [`REPEATED`] with the heading and the page repeated. Below that heading, every table row and
//! every figure with a decimal point must also be on that page: after a new measurement, the check names the other page to update.

use anyhow::{Context, Result, bail};
use std::collections::BTreeSet;
use std::path::Path;

/// Page, heading, and the page with the original figures.
const REPEATED: [(&str, &str, &str); 2] = [
    ("README.md", "## A hundred flights", "docs/figures.md"),
    ("README.md", "## The paper's tables", "docs/figures.md"),
];

/// Fails with a line for each row and each figure that is on only one of the pages.
pub(crate) fn check(root: &Path) -> Result<()> {
    let mut complaints = Vec::new();
    for (page, heading, source) in REPEATED {
        let read = |page: &str| std::fs::read_to_string(root.join(page)).with_context(|| page.to_owned());
        let (text, known) = (read(page)?, read(source)?);
        let Some(section) = section(&text, heading) else {
            bail!(
                "{page}: there is no heading '{heading}'; expected it there, or its line gone from xtask/src/figures.rs"
            );
        };
        for row in section.lines().filter(|line| line.starts_with('|')) {
            if !known.lines().any(|line| line == row) {
                complaints.push(format!("{page}, {heading}: {source} has no row {row}"));
            }
        }
        let known = figures(&known);
        for figure in figures(section).difference(&known) {
            complaints.push(format!("{page}, {heading}: {figure} is not in {source}"));
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

/// Numbers with a decimal point, as text.
fn figures(text: &str) -> BTreeSet<&str> {
    text.split(|letter: char| !letter.is_ascii_digit() && letter != '.')
        .map(|word| word.trim_matches('.'))
        .filter(|word| word.split('.').count() == 2)
        .collect()
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
    fn val_a_figure_that_was_changed_on_one_page_is_told() {
        let place = std::env::temp_dir().join(format!("figures-{}", std::process::id()));
        std::fs::create_dir_all(place.join("docs")).unwrap();
        let page = |alarms: &str, figure: &str| {
            format!(
                "## A hundred flights\n| T-test | {alarms} |\n## The paper's tables\nTable 6: {figure} %\n## Speed\n9.9\n"
            )
        };
        std::fs::write(
            place.join("docs/figures.md"),
            "| T-test | 230 |\n| Table 6 | 95.39 % |\n",
        )
        .unwrap();
        std::fs::write(place.join("README.md"), page("230", "95.39")).unwrap();
        check(&place).unwrap();
        std::fs::write(place.join("README.md"), page("231", "95.40")).unwrap();
        let complaint = check(&place).unwrap_err().to_string();
        std::fs::remove_dir_all(&place).unwrap();
        assert!(complaint.contains("95.40 is not in docs/figures.md"), "{complaint}");
        assert!(complaint.contains("has no row | T-test | 231 |"), "{complaint}");
    }
}
