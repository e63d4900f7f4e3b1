//! Small errors of everything that was not named, at the values that a fit gives them.

use rotortwin_plant::effects::EffectDeclaration;

use super::columns::Active;
use super::problem::Problem;

/// The active effects, and the clutter of the effects taken at its mean. An error with a sign that no effect of the
/// catalogue can have is in the second list, mirrored; `None` if there are none.
///
/// * `mean`: step of the linear parameters from the present point, in plausible sizes
pub(crate) fn with_clutter(
    problem: &Problem,
    mean: &[f64],
    take: impl Fn(&EffectDeclaration) -> bool,
) -> (Vec<Active>, Option<Vec<Active>>) {
    let offset = problem.nuisances();
    let (mut plain, mut mirrored) = (problem.active.clone(), problem.active.clone());
    for (candidate, entry) in problem.library.candidates.iter().enumerate() {
        let columns = problem.library.columns_of(candidate);
        let known = problem.active.iter().any(|a| a.candidate == candidate);
        if known || !take(entry.declaration) || columns.iter().all(|&j| mean[offset + j] == 0.0) {
            continue;
        }
        let values = |sign: f64| -> Option<Vec<f64>> {
            let mut values = entry.neutral();
            for &j in &columns {
                let column = &problem.library.columns[j];
                let value = values[column.parameter] + sign * mean[offset + j] * column.size;
                if entry.clamped(column.parameter, value) != value {
                    return None;
                }
                values[column.parameter] = value;
            }
            Some(values)
        };
        let active = |values| Active {
            candidate,
            values,
            onset_s: None,
        };
        match values(1.0) {
            Some(values) => plain.push(active(values)),
            None => mirrored.extend(values(-1.0).map(active)),
        }
    }
    let any = mirrored.len() > problem.active.len();
    (plain, any.then_some(mirrored))
}
