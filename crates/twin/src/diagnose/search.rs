//! Forward selection: rank, refine, add, linearise anew; then goodness, verdict, words.

use rotortwin_plant::effects::{Catalogue, EffectClass, EffectInstance};

use super::named::Named;
use super::passes::elimination::{in_place_of_two, reconsider, superfluous};
use super::passes::goodness::judge;
use super::passes::gusts::{gusts_lead, without_stand_in};
use super::passes::onset::doubt_onsets;
use super::passes::selection::{LEFT_FACTOR, best_of};
use super::passes::{charge, held_out, wiring};
use super::ranking::{detectable, table};
use super::result::{DiagnosedModel, Diagnosis, Goodness, Timing, Verdict};
use super::strategies::covariance;
use super::strategies::trials::{Trials, trials};
use super::{Options, THRESHOLD, THRESHOLD_AT_REST, findings, picture, words};
use crate::estimation::candidates::Library;
use crate::estimation::columns::LogState;
use crate::estimation::posterior::posterior_of;
use crate::estimation::problem::Problem;
use crate::estimation::scores::score;
use crate::estimation::settle::{averaged, move_to, settled, trust};
use crate::estimation::whiteness::{coloured, fits};
use crate::predict::{CHANNELS, Nuisances, PredictError, Predictor};

/// Speed and rate (root mean square about the mean) below which a flight counts as at rest.
const REST_SPEED_M_S: f64 = 0.3;
const REST_RATE_RAD_S: f64 = 0.08;

pub(crate) fn search(
    predictors: Vec<Predictor>,
    catalogue: &Catalogue,
    model: &[EffectInstance],
    options: &Options<'_>,
    start: f64,
) -> Result<Diagnosis, PredictError> {
    let rotors = predictors[0].series().rotors;
    let mut library = Library::new(catalogue, rotors, &predictors[0].vehicle_size());
    // What the model has already is not looked for; its clutter stays as that of the others.
    library.retain(|c| model.iter().all(|m| m.effect != c.declaration.id || m.rotor != c.rotor));
    library.tighten(|one| {
        predictors[0]
            .effect_set(&Nuisances::default(), std::slice::from_ref(one))
            .is_ok()
    });
    let notes: Vec<String> = predictors
        .iter()
        .flat_map(|p| p.notes().into_iter().map(|note| format!("{}: {note}", p.name)))
        .collect();
    let names: Vec<String> = predictors.iter().map(|p| p.name.clone()).collect();
    let testable = predictors.iter().any(|p| (0..CHANNELS).any(|c| p.has(c)));
    let threshold = if predictors.iter().all(at_rest) {
        THRESHOLD_AT_REST
    } else {
        THRESHOLD
    };
    let logs: Vec<LogState> = predictors
        .into_iter()
        .map(|predictor| LogState {
            predictor,
            nuisances: Nuisances::default(),
        })
        .collect();
    let mut diagnosis = Diagnosis {
        model: DiagnosedModel::default(),
        verdict: Verdict::NothingTestable,
        sentence: String::new(),
        effects: Vec::new(),
        sensor_or_timing: Vec::new(),
        ranking: Vec::new(),
        not_testable: Vec::new(),
        detectable: Vec::new(),
        goodness: Goodness {
            explained_share: None,
            channels: Vec::new(),
            unexplained: Vec::new(),
        },
        held_out: Vec::new(),
        proposal: None,
        trim: None,
        logs: names,
        notes,
        threshold,
        timing: Timing::default(),
    };
    if !testable {
        diagnosis.sentence = words::sentence(&diagnosis);
        return Ok(diagnosis);
    }
    let mut problem = Problem {
        weights: vec![[1.0; CHANNELS]; logs.len()],
        library,
        logs,
        linear: Vec::new(),
        active: Vec::new(),
    };
    (options.progress)("fitting rotor biases and charge", 0.02);
    problem.fit_nuisances()?;
    let plain: Vec<Nuisances> = problem.logs.iter().map(LogState::plain_nuisances).collect();

    let mut named: Vec<Named> = Vec::new();
    if let Some((active, gain)) = wiring::find(&problem) {
        named.push(Named {
            candidate: active.candidate,
            log_bayes_factor: gain,
            posterior: 1.0,
            minimum: f64::INFINITY,
            compatible: Vec::new(),
            lost: Vec::new(),
            together: false,
        });
        problem.active.push(active);
        problem.fit_nuisances()?;
    }
    let mut before = None;
    // Evidence that is left when nothing more is named.
    let mut left = 0.0;
    let mut looked_again = false;
    let mut to_rank = true;
    for round in 0..=options.most_effects {
        let done = round as f64 / (options.most_effects + 1) as f64;
        let text = if round == 0 {
            "sensitivities of the library"
        } else {
            "looking for a further effect"
        };
        (options.progress)(text, 0.05 + 0.9 * done);
        let per = 0.6 / (options.most_effects + 1) as f64;
        problem.linearise(&|share| (options.progress)(text, 0.05 + 0.9 * done + per * share))?;
        trust(&mut problem);
        let posterior = settled(&mut problem)?.0;
        if before.is_none() {
            before = Some(fits(&problem, &posterior.mean));
        }
        let scored = score(&problem, &posterior);
        let special = if round < options.most_effects {
            trials(&problem, &posterior, threshold)
        } else {
            Trials::default()
        };
        left = scored.first().map_or(0.0, |s| s.opened.log_bayes_factor);
        if to_rank {
            to_rank = false;
            diagnosis.ranking = table(&problem, &scored)?;
            (diagnosis.not_testable, diagnosis.detectable) =
                detectable(&problem, &scored, &special.worst_minimum, threshold);
        }
        if round == 0 {
            diagnosis.timing.ranked_s = (options.clock)() - start;
        }
        if round == options.most_effects {
            break;
        }
        if gusts_lead(&mut problem, &posterior, &scored, threshold)? {
            break;
        }
        (options.progress)("refining the leading candidates", 0.05 + 0.9 * done + per);
        let Some((fitted, found)) = best_of(&problem, &posterior, &scored, &special, threshold)? else {
            if left < LEFT_FACTOR * threshold || looked_again {
                break;
            }
            // What the ranking saw and no fit confirms may be a charge that stood on the wrong side of a kink of the battery's chart.
            looked_again = true;
            to_rank = round == 0;
            let fitted = problem.fit(&problem.active)?;
            problem.accept(&fitted);
            continue;
        };
        problem.accept(&fitted);
        named.extend(found);
    }
    if problem.active.len() > 1 {
        (options.progress)("looking again at what was found first", 0.9);
        reconsider(&mut problem, &mut named, threshold)?;
        in_place_of_two(&mut problem, &mut named, threshold)?;
        doubt_onsets(&mut problem)?;
    }
    let moved = charge::look_again(&mut problem)?;
    (options.progress)("goodness of fit", 0.95);
    let (mut posterior, mut deviations) = settled(&mut problem)?;
    if moved {
        // What was left may have been the charge.
        left = score(&problem, &posterior)
            .first()
            .map_or(0.0, |s| s.opened.log_bayes_factor);
    }
    while let Some(fitted) = superfluous(&problem, &posterior, &deviations, threshold)? {
        named.retain(|one| fitted.active.iter().any(|a| a.candidate == one.candidate));
        move_to(&mut problem, &fitted)?;
        (posterior, deviations) = settled(&mut problem)?;
    }
    let before = before.unwrap_or_default();
    let mut after = fits(&problem, &posterior.mean);
    if problem.active.is_empty() && coloured(&after) {
        // Nothing was named, but the nuisances may have stopped at a kink of the battery's chart.
        let fitted = problem.fit(&[])?;
        move_to(&mut problem, &fitted)?;
        posterior = posterior_of(&problem)?.0;
        after = fits(&problem, &posterior.mean);
    }
    let mut goodness = judge(&problem, &before, &after);
    let mut weather = None;
    if !goodness.unexplained.is_empty() && !problem.active.is_empty() {
        (options.progress)("gusts", 0.96);
        weather = covariance::find(&problem, &posterior)?;
        if let Some(first) = &weather {
            // What a wind does depends on the drag, which is another one now.
            problem.advance(&first.posterior.mean);
            problem.linearise(&|_| ())?;
            let (about, _) = posterior_of(&problem)?;
            weather = covariance::find(&problem, &about)?;
            (posterior, left) = match &weather {
                Some(second) => (second.posterior.clone(), 0.0),
                None => (about, left),
            };
        }
        while let Some(first) = &weather
            && let Some(without) = without_stand_in(&problem, &first.posterior, threshold)?
        {
            let (about, _) = posterior_of(&without)?;
            let Some(found) = covariance::find(&without, &about)? else {
                break;
            };
            named.retain(|one| without.active.iter().any(|a| a.candidate == one.candidate));
            problem = without;
            posterior = found.posterior.clone();
            weather = Some(found);
        }
        if let Some(found) = &weather {
            goodness = judge(&problem, &before, &found.fits);
        }
    }
    if left > LEFT_FACTOR * threshold && goodness.unexplained.is_empty() {
        // The clutter had to stretch far beyond its prior: white residuals then say nothing.
        goodness
            .unexplained
            .push("what only implausible parameters would explain".to_owned());
    }
    diagnosis.goodness = goodness;
    diagnosis.held_out = held_out::errors(&problem, &plain)?;
    let about = if weather.is_some() { None } else { averaged(&problem) };
    let (mut found, impossible) = findings::findings(&problem, named, about.as_ref().unwrap_or(&posterior));
    found.extend(weather.and_then(|gusts| findings::weather_finding(&problem, &gusts)));
    for finding in found {
        if matches!(finding.class, EffectClass::Physics | EffectClass::Noise) {
            diagnosis.effects.push(finding);
        } else {
            diagnosis.sensor_or_timing.push(finding);
        }
    }
    let drawn = diagnosis.effects.iter_mut().chain(&mut diagnosis.sensor_or_timing);
    picture::draw(&problem, &mut drawn.collect::<Vec<_>>())?;
    let mut doubts: Vec<String> = impossible
        .iter()
        .map(|label| format!("what only an impossible size of {} would explain", label.to_lowercase()))
        .collect();
    if findings::look_alikes(&problem) {
        doubts.push("what three effects of one kind patch together".to_owned());
    }
    if !diagnosis.effects.is_empty() {
        let risen = diagnosis.held_out.iter().filter(|error| error.rises());
        doubts.extend(risen.map(|error| {
            format!(
                "the {} error on unseen blocks, which rises with what was found,",
                error.quantity
            )
        }));
    }
    diagnosis.verdict = if doubts.is_empty() {
        findings::verdict(&diagnosis)
    } else {
        Verdict::OutsideCatalogue
    };
    diagnosis.goodness.unexplained.extend(doubts);
    diagnosis.sentence = words::sentence(&diagnosis);
    (options.progress)("done", 1.0);
    Ok(diagnosis)
}

/// True for a flight that hardly moves.
fn at_rest(predictor: &Predictor) -> bool {
    let series = predictor.series();
    let spread = |x: &[rotortwin_plant::Vector3]| {
        let count = x.len() as f64;
        (0..3)
            .map(|i| {
                let mean = x.iter().map(|v| v[i]).sum::<f64>() / count;
                x.iter().map(|v| (v[i] - mean) * (v[i] - mean)).sum::<f64>() / count
            })
            .sum::<f64>()
            .sqrt()
    };
    spread(&series.smooth.velocity) < REST_SPEED_M_S && spread(&series.smooth.rates) < REST_RATE_RAD_S
}
