//! Results of jobs, for the document: the types that the command line writes as JSON.

use super::jobs::JobView;
use crate::problem::Problem;
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

pub(crate) use rotortwin_blind::bench::sheet::Sheet as BlindBenchResult;
pub(crate) use rotortwin_campaign::study::summary::CampaignSummary as CampaignResult;
pub(crate) use rotortwin_jobs::Verified as VerificationResult;
pub(crate) use rotortwin_twin::compare::Comparison as ComparisonResult;
pub(crate) use rotortwin_twin::diagnose::Diagnosis as DiagnosisResult;
pub(crate) use rotortwin_twin::improve::Improvement as ImprovementResult;

pub(crate) type LogResult = rotortwin_twin::log::ImportAccount<'static>;
pub(crate) type IdentificationResult = rotortwin_twin::identify::Identification<'static>;

/// Manoeuvres, the best one first.
#[derive(ToSchema)]
#[schema(as = NextFlightProposals)]
#[expect(
    dead_code,
    reason = "for the OpenAPI document: the list alone would be called `Vec` there"
)]
pub(crate) struct NextFlightResult(Vec<rotortwin_twin::next_flight::Proposal>);

pub(crate) type ClassifierResult = rotortwin_scenario::classifier::TrainedClassifier<'static>;

/// A job with its result.
#[derive(Serialize, ToSchema)]
pub(crate) struct JobWithResult<R: ToSchema> {
    #[serde(flatten)]
    job: JobView,
    /// What came out; none before it is done.
    result: Option<R>,
}

/// An effect of the catalogue.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct DeclaredEffect {
    /// Key in documents: `rotor-drag`.
    id: String,
    /// Readable name.
    name: String,
    /// Row of the catalogue, from 1; absent for user-defined effects.
    catalogue_number: Option<u8>,
    /// `physics`, `sensor-fault`, `timing-fault`, `nuisance`, `noise`.
    class: String,
    /// In the symbols of the parameters.
    equation: String,
    /// Where it acts.
    places: Vec<String>,
    /// Groups of channels in which it is visible.
    channels: Vec<String>,
    /// Parameters: sizes and shapes.
    parameters: Vec<DeclaredParameter>,
    /// Each instance belongs to one rotor.
    per_rotor: bool,
    /// It can begin in mid-flight; `false`: the constant that it is an error of does not change by itself.
    may_set_in: bool,
    /// Effects of which at least one must be present for this one to act.
    needs: Vec<String>,
    /// What a flight must contain to make it visible.
    excited_by: String,
    /// Ids of effects with a similar signature.
    confused_with: Vec<String>,
    /// Source of the equation and the sizes.
    source: String,
}

/// A parameter of an effect of the catalogue.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct DeclaredParameter {
    /// Key in documents, with the unit: `drag_n_s_m`.
    name: String,
    /// Letter in the equation.
    symbol: String,
    /// Unit; empty for fractions.
    unit: String,
    /// What it is.
    meaning: String,
    /// `size`, or `shape`.
    kind: String,
    /// Lowest value found on real vehicles.
    plausible_low: f64,
    /// Highest value found on real vehicles.
    plausible_high: f64,
    /// Standard deviation of the slab of the prior.
    size: f64,
    /// Standard deviation of the spike of the prior: deviations that every real vehicle has.
    clutter: f64,
    /// Typical value.
    typical: f64,
    /// The constant of the vehicle whose error it is; absent if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    corrects: Option<CorrectedConstant>,
}

/// A constant of a vehicle whose error a parameter represents.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct CorrectedConstant {
    /// Key of the vehicle document, or a name of its own.
    key: String,
    /// `share`, `difference` or `whole`: how the parameter counts the error.
    scale: String,
}

impl DeclaredEffect {
    /// # Errors
    /// 500: a word of the plant's that is no text.
    pub(crate) fn of(entry: &rotortwin_plant::effects::EffectDeclaration) -> Result<Self, Problem> {
        let texts = |list: &[&str]| list.iter().map(|text| (*text).to_owned()).collect();
        Ok(Self {
            id: entry.id.to_owned(),
            name: entry.name.to_owned(),
            catalogue_number: entry.catalogue_number,
            class: word(&entry.class)?,
            equation: entry.equation.to_owned(),
            places: entry.places.iter().map(word).collect::<Result<_, Problem>>()?,
            channels: entry.channels.iter().map(word).collect::<Result<_, Problem>>()?,
            parameters: entry
                .parameters
                .iter()
                .map(|parameter| {
                    Ok(DeclaredParameter {
                        name: parameter.name.to_owned(),
                        symbol: parameter.symbol.to_owned(),
                        unit: parameter.unit.to_owned(),
                        meaning: parameter.meaning.to_owned(),
                        kind: word(&parameter.kind)?,
                        plausible_low: parameter.plausible_low,
                        plausible_high: parameter.plausible_high,
                        size: parameter.size,
                        clutter: parameter.clutter,
                        typical: parameter.typical,
                        corrects: match &parameter.corrects {
                            Some(correction) => Some(CorrectedConstant {
                                key: correction.key.to_owned(),
                                scale: word(&correction.scale)?,
                            }),
                            None => None,
                        },
                    })
                })
                .collect::<Result<_, Problem>>()?,
            per_rotor: entry.per_rotor,
            may_set_in: entry.may_set_in,
            needs: texts(entry.needs),
            excited_by: entry.excited_by.to_owned(),
            confused_with: texts(entry.confused_with),
            source: entry.source.to_owned(),
        })
    }
}

/// As the command line writes it.
fn word(value: &impl Serialize) -> Result<String, Problem> {
    match serde_json::to_value(value) {
        Ok(Value::String(text)) => Ok(text),
        other => Err(Problem::internal(&format!("{other:?} is no word"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_plant::effects::Catalogue;

    #[test]
    fn val_the_catalogue_is_told_as_the_plant_writes_it() {
        let catalogue = Catalogue::built_in();
        for entry in catalogue.entries() {
            let told = serde_json::to_value(DeclaredEffect::of(entry).expect("words")).expect("JSON");
            assert_eq!(told, serde_json::to_value(entry).expect("JSON"), "{}", entry.id);
        }
    }
}
