//! Fits as text for a terminal, as JSON, and as a self-contained page with data, fit and residual.

use super::fit::{Fit, FittedParameter};
use rotortwin_page::{Report, rounded};
use serde::Serialize;

fn number(value: f64) -> String {
    if !value.is_finite() {
        return if value > 0.0 {
            "∞".to_owned()
        } else {
            "−∞".to_owned()
        };
    }
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        format!("{value:.3e}")
    } else {
        format!("{value:.4}")
    }
}

/// The fits as lines of text.
pub fn text(fits: &[Fit]) -> String {
    let mut out = String::new();
    for fit in fits {
        out += &format!("{} · {}\n", fit.kind, fit.files.join(", "));
        for note in &fit.notes {
            out += &format!("  {note}\n");
        }
        let best = fit.models.first().map_or(0.0, |model| model.aicc);
        for model in &fit.models {
            out += &format!(
                "  {:<24} rmse {}  held out {}  R2 {:.5}  dAICc {:.1}  lag-1 correlation {:.2}\n",
                model.name,
                number(model.rmse),
                number(model.held_out_rmse),
                model.r2,
                model.aicc - best,
                model.correlation
            );
            for p in &model.parameters {
                out += &format!(
                    "    {:<14} {}  [{} … {}]\n",
                    p.name,
                    number(p.value),
                    number(p.low),
                    number(p.high)
                );
            }
            for note in &model.notes {
                out += &format!("    {note}\n");
            }
        }
    }
    out
}

/// What was fitted, as JSON has it; an interval without an end is `null` there.
#[derive(Serialize)]
struct FitJson<'a> {
    kind: &'a str,
    files: &'a [String],
    points: usize,
    models: Vec<ModelJson<'a>>,
    notes: &'a [String],
}

#[derive(Serialize)]
struct ModelJson<'a> {
    name: &'a str,
    equation: &'a str,
    rmse: f64,
    held_out_rmse: f64,
    r2: f64,
    aicc: f64,
    lag_one_correlation: f64,
    intervals: &'a str,
    parameters: &'a [FittedParameter],
    notes: &'a [String],
}

impl<'a> From<&'a Fit> for FitJson<'a> {
    fn from(fit: &'a Fit) -> Self {
        let models = fit.models.iter().map(|model| ModelJson {
            name: model.name,
            equation: model.equation,
            rmse: model.rmse,
            held_out_rmse: model.held_out_rmse,
            r2: model.r2,
            aicc: model.aicc,
            lag_one_correlation: model.correlation,
            intervals: model.intervals,
            parameters: &model.parameters,
            notes: &model.notes,
        });
        Self {
            kind: fit.kind,
            files: &fit.files,
            points: fit.y.len(),
            models: models.collect(),
            notes: &fit.notes,
        }
    }
}

/// The fits as JSON.
///
/// # Panics
/// Never: text and numbers are JSON.
pub fn json(fits: &[Fit]) -> String {
    let fits: Vec<FitJson<'_>> = fits.iter().map(FitJson::from).collect();
    serde_json::to_string(&fits).expect("text and numbers are JSON") + "\n"
}

/// Marks of a plot, at most: more cannot be seen.
const MOST_MARKS: usize = 1500;

/// A fit with its data, by rising abscissa.
#[derive(Serialize)]
struct Drawn<'a> {
    #[serde(flatten)]
    fit: FitJson<'a>,
    x_name: &'a str,
    y_name: &'a str,
    x: Vec<Option<f64>>,
    y: Vec<Option<f64>>,
    /// Of the best structure.
    fitted: Vec<Option<f64>>,
}

impl<'a> From<&'a Fit> for Drawn<'a> {
    fn from(fit: &'a Fit) -> Self {
        let mut order: Vec<usize> = (0..fit.x.len()).collect();
        order.sort_by(|&a, &b| fit.x[a].total_cmp(&fit.x[b]));
        let stride = fit.x.len().div_ceil(MOST_MARKS).max(1);
        let marks = |values: &[f64]| {
            order
                .iter()
                .step_by(stride)
                .filter_map(|&k| values.get(k))
                .map(|v| rounded(*v))
                .collect()
        };
        Self {
            x_name: fit.x_name,
            y_name: fit.y_name,
            x: marks(&fit.x),
            y: marks(&fit.y),
            fitted: fit.models.first().map_or_else(Vec::new, |model| marks(&model.fitted)),
            fit: fit.into(),
        }
    }
}

/// The page: `report.html`.
///
/// # Panics
/// Never: text and numbers are JSON.
pub fn html(title: &str, fits: &[Fit]) -> String {
    let data: Vec<Drawn<'_>> = fits.iter().map(Drawn::from).collect();
    let page = Report {
        kind: "fit",
        title,
        summary: &text(fits),
        program: crate::model::TOOL,
        data: &data,
    };
    page.render().expect("text and numbers are JSON")
}
