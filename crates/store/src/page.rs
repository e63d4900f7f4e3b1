//! The frame of every HTML page that this project writes: one file, no network, uPlot and its licence inlined.
//!
//! `assets/report.html` is the frame, with a content policy that allows nothing from outside. Body and data come from the caller;
//! the data is embedded as JSON and can be read by the page's script under `#data`.

const FRAME: &str = include_str!("../assets/report.html");
const UPLOT_CSS: &str = include_str!("../assets/uPlot.min.css");
const UPLOT_JS: &str = include_str!("../assets/uPlot.iife.min.js");
const UPLOT_LICENCE: &str = include_str!("../assets/uPlot.LICENSE");

/// What a page consists of.
#[derive(Clone, Copy, Debug)]
pub struct Page<'a> {
    /// Title as plain text.
    pub title: &'a str,
    /// Style sheet.
    pub css: &'a str,
    /// Content of `main`, HTML.
    pub body: &'a str,
    /// JSON for the script.
    pub data: &'a str,
    /// Script.
    pub js: &'a str,
}

impl Page<'_> {
    /// The file.
    pub fn render(&self) -> String {
        let title = escape(self.title);
        // "</" would end the script element.
        let data = self.data.replace("</", "<\\/");
        let size = FRAME.len() + self.css.len() + self.js.len() + UPLOT_JS.len() + self.body.len() + data.len();
        let mut page = String::with_capacity(size);
        let mut rest = FRAME;
        while let Some((before, after)) = rest.split_once("{{") {
            let (name, after) = after.split_once("}}").expect("placeholders of the frame are closed");
            page.push_str(before);
            page.push_str(match name {
                "title" => &title,
                "css" => self.css,
                "uplot_css" => UPLOT_CSS,
                "uplot_js" => UPLOT_JS,
                "uplot_licence" => UPLOT_LICENCE,
                "body" => self.body,
                "data" => &data,
                "js" => self.js,
                _ => unreachable!("the frame has no other placeholder"),
            });
            rest = after;
        }
        page.push_str(rest);
        page
    }
}

/// Text for HTML content and attributes.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            other => out.push(other),
        }
    }
    out
}
