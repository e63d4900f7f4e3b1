//! Loads that are dropped or picked up in flight, in the world of the independent generator: whether sessions report
//! them, and how they judge rotors afterwards.

mod foreign;

use foreign::{VEHICLE, cases_of, scored, seconds, windows_of};
use rotortwin_blind::bench::faults::{Class, End, FaultCase, fly_case};
use rotortwin_blind::bench::sheet::Share;
use rotortwin_blind::hidden::Hidden;
use rotortwin_blind::random::Stream;
use rotortwin_fdi_session::validity::Obstacle;
use rotortwin_fdi_session::{Interval, Window};
use serde_json::json;

/// What is drawn for a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Kind {
    words: &'static str,
    /// Dropped: −1, picked up: 1.
    sign: f64,
    /// Beside the centre of mass.
    is_beside: bool,
    /// A rotor loses 5 % of its thrust 15 s later.
    is_followed: bool,
    /// Five unknown effects, wind and gusts on top.
    is_unknown: bool,
}

const KINDS: [Kind; 6] = [
    Kind::of("dropped", -1.0),
    Kind::of("taken up", 1.0),
    Kind {
        is_beside: true,
        ..Kind::of("dropped beside the centre", -1.0)
    },
    Kind {
        is_beside: true,
        ..Kind::of("taken up beside the centre", 1.0)
    },
    Kind {
        is_followed: true,
        ..Kind::of("dropped, 5 % of a rotor 15 s later", -1.0)
    },
    Kind {
        is_unknown: true,
        ..Kind::of("dropped, five effects", -1.0)
    },
];

impl Kind {
    const fn of(words: &'static str, sign: f64) -> Self {
        Self {
            words,
            sign,
            is_beside: false,
            is_followed: false,
            is_unknown: false,
        }
    }

    /// `n` flights of 60 s over waypoints and in hover: 5 to 12 % of the mass at 20 to 30 s, up to 4 cm off the centre
    /// of mass.
    fn cases(self, n: usize, seed: u64) -> Vec<FaultCase> {
        let bare = if self.is_unknown {
            Class::FiveHealthy
        } else {
            Class::Healthy
        };
        let drawn = cases_of(bare, n, seed, 60.0).into_iter().enumerate();
        drawn
            .map(|(round, mut case)| {
                let mut random = Stream::new(seed, &format!("load-{}-{round}", self.words));
                let onset_s = (10.0 * random.between(20.0, 30.0)).round() / 10.0;
                let share = self.sign * random.between(0.05, 0.12);
                let [angle, lever_m] = [random.between(0.0, std::f64::consts::TAU), random.between(0.01, 0.04)];
                let rotor = 1 + random.below(6);
                let hidden = |text: String| Hidden::parse(&text).expect("an effect");
                case.class = Class::LoadDropped;
                case.vehicle = VEHICLE.to_owned();
                case.effects
                    .push(hidden(format!("mass:share={share},onset_s={onset_s}")));
                if self.is_beside {
                    let shift = lever_m * share / (1.0 + share);
                    let [forward, right] = [shift * angle.cos(), shift * angle.sin()];
                    case.effects.push(hidden(format!(
                        "centre-of-mass:forward_m={forward},right_m={right},onset_s={onset_s}"
                    )));
                }
                if self.is_followed {
                    let later_s = onset_s + 15.0;
                    case.effects.push(hidden(format!(
                        "rotor-thrust-scale:share=-0.05,rotor={rotor},onset_s={later_s}"
                    )));
                }
                case
            })
            .collect()
    }
}

/// Results for one flight.
#[derive(Clone, Debug, Default)]
struct Said {
    /// From the change to the window that names it, s; none without a load that was named.
    after_s: Option<f64>,
    /// Its interval holds the truth.
    is_inside: bool,
    /// Loads that were named.
    named: usize,
    /// "Cannot judge" with a mass in words, from the change on within 10 s.
    is_suspected: bool,
    healthy_named: bool,
    false_alarms: usize,
    healthy_s: f64,
    /// Of the subsequent loss: found within 10 s, correctly named at the end, inside.
    found: bool,
    right: bool,
    inside: bool,
}

fn said(case: &FaultCase, windows: &[Window]) -> Said {
    let change = case
        .effects
        .iter()
        .find(|effect| effect.id == "mass" && effect.onset_s.is_some());
    let row = scored(case, windows);
    let mut said = Said {
        healthy_named: row.healthy_named,
        false_alarms: row.false_alarms,
        healthy_s: row.healthy_s,
        found: row.first_s.is_some_and(|seconds| seconds <= 10.0),
        right: row.end == Some(End::Right),
        inside: row.inside == Some(true),
        ..Said::default()
    };
    let named = windows
        .iter()
        .filter(|window| window.load.is_some_and(|load| load.is_new()));
    for window in named {
        let load = window.load.expect("it is there");
        said.named += 1;
        if let Some(change) = change
            && said.named == 1
        {
            // The generator's vehicle weighs what its document says, and an effect of the mass from the start on counts of the same.
            let truth = 1.55 * change.parameters["share"];
            let Interval { low, high, .. } = load.mass_kg;
            said.is_inside = (f64::from(low)..=f64::from(high)).contains(&truth);
            let after_s = seconds(window) - change.onset_s.expect("an onset");
            said.after_s = (after_s > 0.0).then_some(after_s);
        }
    }
    said.is_suspected = change.and_then(|change| change.onset_s).is_some_and(|onset_s| {
        let is_load = |window: &&Window| matches!(window.obstacle, Some(Obstacle::Load { .. }));
        let within = |window: &&Window| (onset_s..onset_s + 10.0).contains(&seconds(window));
        windows.iter().filter(within).any(|window| is_load(&window))
    });
    said
}

/// Flights of a list, judged on all cores; a flight that the pilot loses counts nowhere.
fn all_said(cases: &[FaultCase]) -> Vec<Said> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let judge = |case: &FaultCase| {
        let rows = fly_case(case).ok()?;
        Some(said(case, &windows_of(&rows)))
    };
    std::thread::scope(|scope| {
        let parts = cases.chunks(cases.len().div_ceil(cores).max(1));
        let parts: Vec<_> = parts
            .map(|part| scope.spawn(move || part.iter().filter_map(judge).collect::<Vec<_>>()))
            .collect();
        parts
            .into_iter()
            .flat_map(|part| part.join().expect("judged"))
            .collect()
    })
}

fn share(count: usize, of: usize) -> String {
    let Share { low, high, .. } = Share::new(count, of);
    format!("{count} of {of} [{:.0}, {:.0}]", 100.0 * low, 100.0 * high)
}

#[test]
fn val_a_load_is_named_and_rotors_are_judged_with_it() {
    for kind in KINDS.iter().filter(|kind| !kind.is_unknown && !kind.is_beside) {
        let all = all_said(&kind.cases(6, 5));
        let count = |is: &dyn Fn(&Said) -> bool| all.iter().filter(|said| is(said)).count();
        let named = count(&|said| said.after_s.is_some_and(|seconds| seconds <= 5.0) && said.named == 1);
        let inside = count(&|said| said.is_inside);
        assert!(
            named >= 5 && inside >= 5,
            "{}: named {named}, inside {inside} of 6",
            kind.words
        );
        assert!(
            all.iter().all(|said| !said.healthy_named && said.false_alarms == 0),
            "{}: {all:?}",
            kind.words
        );
        // Healthy again, or the rotor that is damaged later.
        let right = count(&|said| said.right && (said.found || !kind.is_followed));
        assert!(right >= 5, "{}: right at the end {right} of 6", kind.words);
    }
}

#[test]
fn val_no_load_is_named_for_a_rotor() {
    for class in [Class::Step, Class::TwoRotors, Class::ThreeRotors, Class::Gain] {
        let all = all_said(&cases_of(class, 4, 5, 60.0));
        assert!(all.iter().all(|said| said.named == 0), "{class:?}: {all:?}");
    }
}

/// The figures of docs/detector.md of changed loads: `ROTORTWIN_FAULTS_N` flights of each kind, `ROTORTWIN_FAULTS_SEED`; and of classes of the preset in which no load
/// changes (`ROTORTWIN_FAULTS_CLASS`), `ROTORTWIN_FAULTS_S` seconds each.
#[test]
#[ignore = "a measurement: cargo test --release -p rotortwin-fdi-session --test changed_load -- --ignored --nocapture bench_changed_loads"]
fn bench_changed_loads() {
    let of = |name: &str, default: &str| std::env::var(name).unwrap_or_else(|_| default.to_owned());
    let number = |name: &str, default: &str| of(name, default).parse::<usize>().expect("a number");
    let (n, seed) = (
        number("ROTORTWIN_FAULTS_N", "24"),
        number("ROTORTWIN_FAULTS_SEED", "1") as u64,
    );
    for kind in KINDS
        .iter()
        .filter(|kind| of("ROTORTWIN_LOAD_KINDS", kind.words).contains(kind.words))
    {
        let all = all_said(&kind.cases(n, seed));
        let count = |is: &dyn Fn(&Said) -> bool| all.iter().filter(|said| is(said)).count();
        let mut after: Vec<f64> = all.iter().filter_map(|said| said.after_s).collect();
        after.sort_by(f64::total_cmp);
        println!(
            "{}: named in 10 s {}, median {:.1} s; more than once {}; size inside {}; \"cannot judge\" with a mass in 10 s {}; healthy rotor named {}; right at the end {}",
            kind.words,
            share(count(&|said| said.after_s.is_some_and(|s| s <= 10.0)), all.len()),
            after.get(after.len() / 2).copied().unwrap_or(f64::NAN),
            count(&|said| said.named > 1),
            share(count(&|said| said.is_inside), count(&|said| said.after_s.is_some())),
            share(count(&|said| said.is_suspected), all.len()),
            share(count(&|said| said.healthy_named), all.len()),
            share(count(&|said| said.right), all.len()),
        );
        if kind.is_followed {
            println!(
                "  the loss after it: found in 10 s {}; inside at the end {}",
                share(count(&|said| said.found), all.len()),
                share(count(&|said| said.inside), all.len()),
            );
        }
    }
    let classes = of(
        "ROTORTWIN_FAULTS_CLASS",
        "healthy,step,ramp,gain,two-rotors,three-rotors,five-healthy,five-step",
    );
    for class in classes.split(',').filter(|class| !class.is_empty()) {
        let class: Class = serde_json::from_value(json!(class)).expect("a class");
        let all = all_said(&cases_of(class, n, seed, number("ROTORTWIN_FAULTS_S", "60") as f64));
        let count = |is: &dyn Fn(&Said) -> bool| all.iter().filter(|said| is(said)).count();
        println!(
            "{class:?}: a load named in {} flights; healthy rotor named {}; false alarms {} in {:.2} h; right at the end {}",
            share(count(&|said| said.named > 0), all.len()),
            share(count(&|said| said.healthy_named), all.len()),
            all.iter().map(|said| said.false_alarms).sum::<usize>(),
            all.iter().map(|said| said.healthy_s).sum::<f64>() / 3600.0,
            share(count(&|said| said.right), all.len()),
        );
    }
}
