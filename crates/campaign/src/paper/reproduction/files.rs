//! All results as files: every number of every fold and seed, every confusion count, every window.

use super::{Item, Method, Reproduction, SeedResult, TTestVariant};
use crate::paper::protocol::Course;
use crate::table_file::{TableFile, Values};

/// One row of the table of numbers.
struct Number {
    seed: u64,
    detector: &'static str,
    held_out: &'static str,
    quantity: &'static str,
    value: f64,
    windows: u64,
}

impl Reproduction {
    /// Accuracies and recalls of every detector, seed and fold. Fractions from 0 to 1.
    pub fn numbers(&self) -> TableFile {
        let mut numbers = Vec::new();
        for seed in &self.seeds {
            for (method, folds) in &seed.networks {
                for (fold, course) in folds.iter().zip(Course::ALL) {
                    let mut put = |quantity, value, windows| {
                        numbers.push(Number {
                            seed: seed.seed,
                            detector: method.key(),
                            held_out: course.name(),
                            quantity,
                            value,
                            windows,
                        });
                    };
                    let training = fold.training_rows as u64;
                    put("training accuracy", fold.training, training);
                    put("validation accuracy", fold.validation, fold.validation_rows as u64);
                    put("test accuracy", fold.test.accuracy(), fold.test.total());
                    put(
                        "healthy recall",
                        fold.test.share(0, 0),
                        fold.test.counts()[0].iter().sum(),
                    );
                    put(
                        "fault recall",
                        fold.test.fault_recall(),
                        fold.test.counts()[1..].iter().flatten().sum(),
                    );
                }
            }
            for (variant, courses) in &seed.t_tests {
                for (confusion, course) in courses.iter().zip(Course::ALL) {
                    for (quantity, value) in [
                        ("test accuracy", confusion.accuracy()),
                        ("healthy recall", confusion.share(0, 0)),
                        ("fault recall", confusion.fault_recall()),
                        ("faults called unknown", confusion.unknown_share()),
                        ("faults called the opposite rotor", confusion.opposite_share()),
                    ] {
                        numbers.push(Number {
                            seed: seed.seed,
                            detector: variant.key(),
                            held_out: course.name(),
                            quantity,
                            value,
                            windows: confusion.total(),
                        });
                    }
                }
            }
        }
        let mut table = TableFile::default();
        table
            .column("seed", Values::Integer(numbers.iter().map(|n| n.seed as i64).collect()))
            .column("detector", texts(numbers.iter().map(|n| n.detector)))
            .column("trajectory", texts(numbers.iter().map(|n| n.held_out)))
            .column("quantity", texts(numbers.iter().map(|n| n.quantity)))
            .column("value", Values::Double(numbers.iter().map(|n| n.value).collect()))
            .column(
                "windows",
                Values::Integer(numbers.iter().map(|n| n.windows as i64).collect()),
            );
        table
    }

    /// Counts of every verdict for every truth, by detector, seed and trajectory. Verdict −1 is the unknown fault.
    pub fn confusions(&self) -> TableFile {
        let (mut seeds, mut detectors, mut courses) = (Vec::new(), Vec::new(), Vec::new());
        let (mut truths, mut verdicts, mut counts) = (Vec::new(), Vec::new(), Vec::new());
        for (seed, detector, course, confusion) in self.seeds.iter().flat_map(confusions_of) {
            for (truth, row) in confusion.counts().iter().enumerate() {
                for (verdict, count) in row.iter().enumerate() {
                    seeds.push(seed as i64);
                    detectors.push(detector);
                    courses.push(course);
                    truths.push(truth as i64);
                    verdicts.push(if verdict + 1 == row.len() { -1 } else { verdict as i64 });
                    counts.push(*count as i64);
                }
            }
        }
        let mut table = TableFile::default();
        table
            .column("seed", Values::Integer(seeds))
            .column("detector", texts(detectors.into_iter()))
            .column("trajectory", texts(courses.into_iter()))
            .column("truth", Values::Integer(truths))
            .column("verdict", Values::Integer(verdicts))
            .column("windows", Values::Integer(counts));
        table
    }

    /// Every window of every flight: truth, means of the 4-axis residual for each rotor model, verdicts of the T-test. `None` if no
    /// network was requested.
    pub fn windows(&self) -> Option<TableFile> {
        let sets: Vec<_> = self
            .seeds
            .iter()
            .filter_map(|seed| Some((seed.seed, seed.data.as_ref()?)))
            .collect();
        let models: Vec<_> = sets
            .first()?
            .1
            .flights
            .first()?
            .1
            .residuals
            .iter()
            .map(|r| r.model)
            .collect();
        let integers = |value: &dyn Fn(u64, usize, usize) -> i64| {
            let rows = sets.iter().flat_map(|(seed, data)| {
                data.flights
                    .iter()
                    .enumerate()
                    .flat_map(move |(flight, (_, windows))| (0..windows.labels.len()).map(move |i| (*seed, flight, i)))
            });
            Values::Integer(rows.map(|(seed, flight, i)| value(seed, flight, i)).collect())
        };
        // The sets have the same plan except for the seeds.
        let flights = &sets[0].1.flights;
        let set = |seed: u64| {
            let (_, data) = sets.iter().find(|(s, _)| *s == seed).expect("one of the sets");
            data
        };
        let mut table = TableFile::default();
        table
            .column("seed", integers(&|seed, _, _| seed as i64))
            .column("flight", integers(&|_, flight, _| flight as i64 + 1))
            .column(
                "charge_percent",
                integers(&|_, flight, _| (100.0 * flights[flight].0.charge).round() as i64),
            )
            .column(
                "faulty_rotor",
                integers(&|_, flight, _| flights[flight].0.rotor as i64 + 1),
            )
            .column("window", integers(&|_, _, i| i as i64))
            .column(
                "label",
                integers(&|seed, flight, i| i64::from(set(seed).flights[flight].1.labels[i])),
            );
        let all = || sets.iter().flat_map(|(_, data)| &data.flights);
        table.column(
            "trajectory",
            texts(all().flat_map(|(plan, windows)| windows.labels.iter().map(|_| plan.course.name()))),
        );
        for model in models {
            let name = model.as_str();
            let verdicts = all().flat_map(|(_, windows)| windows.of(model).t_test.iter().map(|v| i64::from(v.code())));
            table.column(&format!("t_test_{name}"), Values::Integer(verdicts.collect()));
            for (axis, unit) in ["fz_ns", "mx_nms", "my_nms", "mz_nms"].into_iter().enumerate() {
                let means = all().flat_map(|(_, windows)| windows.of(model).mean.iter().map(move |mean| mean[axis]));
                table.column(&format!("residual_{name}_{unit}"), Values::Single(means.collect()));
            }
        }
        Some(table)
    }

    /// Whether a table was requested.
    pub fn has(&self, item: Item) -> bool {
        self.options.items.contains(&item)
    }
}

fn texts<'a>(values: impl Iterator<Item = &'a str>) -> Values {
    Values::Text(values.map(str::to_owned).collect())
}

/// Seed, detector, trajectory and verdicts.
fn confusions_of(
    seed: &SeedResult,
) -> impl Iterator<Item = (u64, &'static str, &'static str, &crate::paper::scores::Confusion)> {
    let networks = seed.networks.iter().flat_map(|(method, folds): (&Method, _)| {
        folds
            .iter()
            .zip(Course::ALL)
            .map(|(fold, course)| (method.key(), course.name(), &fold.test))
    });
    let t_tests = seed.t_tests.iter().flat_map(|(variant, courses): (&TTestVariant, _)| {
        courses
            .iter()
            .zip(Course::ALL)
            .map(|(confusion, course)| (variant.key(), course.name(), confusion))
    });
    networks
        .chain(t_tests)
        .map(move |(detector, course, confusion)| (seed.seed, detector, course, confusion))
}
