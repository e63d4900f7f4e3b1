//! Reports: one HTML file with the components of the web page and embedded data, which works from disk, without network.
//!
//! ```text
//! web/src/report ─ vite ─▶ web/dist-report/report.html ─┐
//! result ─ JSON ────────────────────────────────────────┼─▶ report.html of a run, a comparison, a campaign …
//! title, summary as text ───────────────────────────────┘
//! ```
//! The display logic is in `web/src/shown`; this crate only inserts title, summary and JSON. The summary stays readable in a
//! browser without scripts, and to programs that search text.
//!
//! Assumes that the page is built from the same sources as this program, so that it knows the kind and the shape of the data.

use serde::Serialize;
use serde::ser::Error as _;

/// The built page, with placeholders for title, summary and data.
const TEMPLATE: &str = include_str!("../../../web/dist-report/report.html");
/// The placeholders, in the order of the page.
const PLACES: [&str; 3] = ["{{title}}", "{{summary}}", "{{report}}"];

/// Content of a report.
#[derive(Clone, Copy, Debug)]
pub struct Report<'a, T> {
    /// Kind of result: selects how the page shows `data`.
    pub kind: &'static str,
    /// Title, plain text.
    pub title: &'a str,
    /// Summary, plain text.
    pub summary: &'a str,
    /// Program and version that created it.
    pub program: &'a str,
    /// The result, as the server returns it.
    pub data: &'a T,
}

#[derive(Serialize)]
struct Content<'a, T> {
    kind: &'a str,
    title: &'a str,
    program: &'a str,
    data: &'a T,
}

impl<T: Serialize> Report<'_, T> {
    /// The file.
    ///
    /// # Errors
    /// The data is not valid JSON: a map with non-string keys.
    pub fn render(&self) -> Result<String, serde_json::Error> {
        let data = serde_json::to_string(&Content {
            kind: self.kind,
            title: self.title,
            program: self.program,
            data: self.data,
        })?;
        let parts = [text(self.title), text(self.summary), script(&data)];
        let size = TEMPLATE.len() + parts.iter().map(String::len).sum::<usize>();
        let mut page = String::with_capacity(size);
        let mut rest = TEMPLATE;
        for (place, part) in PLACES.into_iter().zip(&parts) {
            let (before, after) = rest
                .split_once(place)
                .ok_or_else(|| serde_json::Error::custom(format!("web/dist-report/report.html has no {place}")))?;
            page.push_str(before);
            page.push_str(part);
            rest = after;
        }
        page.push_str(rest);
        Ok(page)
    }
}

/// JSON inside a script element: nothing in it ends the element or opens a comment (`<` is escaped), and it stays valid JSON.
/// U+2028 and U+2029 end a line in old scripts, so they are escaped as well.
fn script(json: &str) -> String {
    let mut out = String::with_capacity(json.len());
    for letter in json.chars() {
        match letter {
            '<' => out.push_str("\\u003c"),
            '\u{2028}' => out.push_str("\\u2028"),
            '\u{2029}' => out.push_str("\\u2029"),
            other => out.push(other),
        }
    }
    out
}

/// Text as content of an element.
fn text(plain: &str) -> String {
    let mut out = String::with_capacity(plain.len());
    for letter in plain.chars() {
        match letter {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            other => out.push(other),
        }
    }
    out
}

/// A number to six significant digits: plot resolution, in fewer bytes. `None` if it is not finite.
pub fn rounded(value: f64) -> Option<f64> {
    if !value.is_finite() {
        return None;
    }
    format!("{value:.5e}").parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(title: &str, summary: &str, data: &serde_json::Value) -> String {
        let program = "rotortwin 0";
        let kind = "comparison";
        Report {
            kind,
            title,
            summary,
            program,
            data,
        }
        .render()
        .unwrap()
    }

    /// The JSON as parsed by a browser: the text of the element `#report`.
    fn inside(page: &str) -> serde_json::Value {
        let (_, rest) = page
            .split_once("<script type=\"application/json\" id=\"report\">")
            .unwrap();
        let (json, _) = rest.split_once("</script>").unwrap();
        serde_json::from_str(json).unwrap()
    }

    #[test]
    fn regress_a_name_is_never_a_tag_nor_a_place_of_the_page() {
        let evil = "</script><script>alert(1)</script><!-- {{report}} \u{2028}\u{2029} $& \\";
        let page = report(evil, evil, &serde_json::json!({ evil: [evil] }));
        let plain = report("t", "s", &serde_json::json!({}));
        assert_eq!(page.matches("<script").count(), plain.matches("<script").count());
        assert_eq!(page.matches("<!--").count(), plain.matches("<!--").count());
        assert!(!page.contains('\u{2028}') || !script(evil).contains('\u{2028}'));
        let content = inside(&page);
        assert_eq!(content["title"], evil);
        assert_eq!(content["data"][evil][0], evil);
    }

    #[test]
    fn regress_the_page_asks_nobody_for_anything() {
        for place in PLACES {
            assert_eq!(TEMPLATE.matches(place).count(), 1, "{place}");
        }
        for forbidden in ["src=", "href=\"http", "@import", "url(http"] {
            let (head, _) = TEMPLATE.split_once("<script type=\"module\">").unwrap();
            assert!(!head.contains(forbidden), "{forbidden}");
        }
        assert!(TEMPLATE.contains("default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-"));
    }

    #[test]
    fn val_numbers_keep_six_digits() {
        assert_eq!(rounded(1.0 / 3.0), Some(0.333_333));
        assert_eq!(rounded(-123_456_789.0), Some(-123_457_000.0));
        assert_eq!(rounded(f64::NAN), None);
    }

    proptest::proptest! {
        #[test]
        fn prop_what_goes_in_comes_out(title in ".*", summary in ".*", values in proptest::collection::vec(proptest::num::f64::NORMAL, 0..9)) {
            let page = report(&title, &summary, &serde_json::json!({ "values": values }));
            let content = inside(&page);
            proptest::prop_assert_eq!(content["title"].as_str(), Some(title.as_str()));
            proptest::prop_assert_eq!(content["data"]["values"].as_array().map(Vec::len), Some(values.len()));
        }
    }
}
