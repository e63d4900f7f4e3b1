//! The paper's tables on fresh seeds, within predefined bounds; the shipped classifiers equal the output of training.

use rotortwin_campaign::paper::classifiers;
use rotortwin_campaign::paper::protocol::Course;
use rotortwin_campaign::paper::reproduction::{self, Item, Method, Options, Reproduction, TTestVariant, tables};
use rotortwin_campaign::paper::scores::{Confusion, mean};
use rotortwin_scenario::{Classifier, Scenario};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Not used for any choice of this project.
const FRESH_SEED: u64 = 90_001;

fn config(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(path)
}

fn base() -> Scenario {
    Scenario::load_without_classifier(config("scenarios/reference-flight.toml")).expect("a good scenario")
}

fn options(items: &[Item], seeds: &[u64], threads: usize) -> Options {
    Options {
        items: items.iter().copied().collect(),
        methods: Default::default(),
        seeds: seeds.to_vec(),
        threads: NonZeroUsize::new(threads).expect("above 0"),
        // Enough to show that tracking errors are uninformative; see `reproduce` for the length used in the paper.
        tracking_epochs: 2,
        overrides: Default::default(),
    }
}

fn tests(result: &Reproduction, method: Method) -> Vec<f64> {
    result.seeds[0].networks[&method]
        .iter()
        .map(|fold| 100.0 * fold.test.accuracy())
        .collect()
}

fn t_test(result: &Reproduction, variant: TTestVariant) -> Confusion {
    let mut all = Confusion::new(6);
    result.seeds[0].t_tests[&variant]
        .iter()
        .for_each(|part| all.merge(part));
    all
}

#[test]
fn scenario_tables_are_within_the_bounds_set_before() {
    let options = options(&Item::ALL, &[FRESH_SEED], 2);
    let ticks = AtomicU64::new(0);
    let result = reproduction::run(&base(), &options, &|| {
        ticks.fetch_add(1, Ordering::Relaxed);
    })
    .expect("every flight is flown");
    assert_eq!(ticks.into_inner(), options.jobs(6));
    assert_eq!(result.seeds[0].flights, 3 * 48);

    let within = |what: &str, value: f64, low: f64, high: f64| {
        assert!(
            value >= low && value <= high,
            "{what}: {value:.3} is not within {low} to {high}"
        );
    };
    // Table 6: the paper has 95.04 ± 6.28, an independent implementation 95.47 with one bad fold.
    let paper = tests(&result, Method::Paper);
    within("test", mean(&paper), 94.0, 96.5);
    for course in [Course::Helix1, Course::Helix2, Course::Hover] {
        // Below the 97.5 of a well-trained quiet fold only by chance in five epochs (down to 96.8 in 20 folds).
        within(course.name(), paper[course.index()], 96.0, 100.0);
    }
    within("waypoints", paper[Course::Waypoints.index()], 83.0, 89.0);
    // Table 7.
    let mut all = Confusion::new(6);
    result.seeds[0].networks[&Method::Paper]
        .iter()
        .for_each(|fold| all.merge(&fold.test));
    assert_eq!(all.total(), 48 * 1440);
    within("healthy recall", 100.0 * all.share(0, 0), 96.0, 98.5);
    within("fault recall", 100.0 * all.fault_recall(), 91.0, 95.5);
    // Table 8: the normalisation decides.
    within(
        "pooled z-score",
        mean(&tests(&result, Method::UncompensatedPooled)),
        45.0,
        55.0,
    );
    within(
        "z-score per feature",
        mean(&tests(&result, Method::Uncompensated)),
        88.0,
        97.0,
    );
    // Table 9: the paper's 80.35 lies between choices that it does not state.
    within(
        "linear map",
        100.0 * t_test(&result, TTestVariant::Paper).accuracy(),
        90.0,
        93.0,
    );
    within(
        "inverse map",
        100.0 * t_test(&result, TTestVariant::InverseMap).accuracy(),
        79.0,
        83.0,
    );
    within(
        "start-up",
        100.0 * t_test(&result, TTestVariant::StartUp).accuracy(),
        67.0,
        73.0,
    );
    within(
        "no battery model",
        100.0 * t_test(&result, TTestVariant::Uncompensated).accuracy(),
        57.0,
        65.0,
    );
    // Table 10.
    within(
        "tracking errors",
        mean(&tests(&result, Method::TrackingErrors)),
        49.0,
        51.0,
    );
    // Beyond the paper.
    within("improved", mean(&tests(&result, Method::Improved)), 99.7, 100.0);

    let shown = tables::tables(&result);
    assert_eq!(shown.len(), 7);
    for table in &shown {
        assert!(
            table.rows.iter().all(|row| row.len() == table.columns.len()),
            "{}",
            table.title
        );
    }
    assert_eq!(result.numbers().rows(), 7 * 4 * 5 + 5 * 4 * 5);
    assert_eq!(result.confusions().rows(), (7 + 5) * 4 * 7 * 8);
    assert_eq!(result.windows().expect("flights were kept").rows(), 48 * 1440);
}

#[test]
fn scenario_same_seed_same_bits_for_any_number_of_threads() {
    let run = |threads| {
        let result = reproduction::run(&base(), &options(&[Item::Table6], &[7], threads), &|| ()).expect("flown");
        (
            result.seeds[0].data_hash.clone(),
            result.seeds[0].networks.clone(),
            result.numbers().to_csv(),
        )
    };
    let one = run(1);
    assert_eq!(run(2), one);
    assert_eq!(run(5), one);
}

/// If this fails after an intended change of flights or training, rewrite both files with the commands in them.
#[test]
fn regress_shipped_classifiers_are_what_training_writes() {
    let base = base();
    for (file, method) in [
        ("classifiers/f550-paper.json", Method::Paper),
        ("classifiers/f550-improved.json", Method::Improved),
    ] {
        let path = config(file);
        let shipped = Classifier::read(&path).expect("a good file");
        let provenance = &shipped.provenance;
        // One seed suffices to compare bits: the weights, and its column of the cross-validation.
        let wanted = Options {
            methods: [method].into(),
            ..options(&[], &[provenance.seed], 2)
        };
        let result = reproduction::run(&base, &wanted, &|| ()).expect("flown");
        let fold = classifiers::train(&result, method, provenance.seed, None).expect("flights were kept");
        let mut made = classifiers::classifier_file(
            &base,
            &result,
            method,
            provenance.seed,
            &fold,
            &provenance.command,
            classifiers::cross_validation(&result, method),
        )
        .expect("a network on residuals");
        let column = made.provenance.cross_validation.folds.clone();
        for (made, shipped) in column.iter().zip(&provenance.cross_validation.folds) {
            assert_eq!((&made.held_out, made.test[0]), (&shipped.held_out, shipped.test[0]));
        }
        made.provenance.cross_validation = provenance.cross_validation.clone();
        assert!(made == shipped, "{} is not what training writes now", path.display());
        assert_eq!(provenance.cross_validation.seeds, [1, 2, 3, 4, 5]);
    }
}
