//! Vibration by rotor: vibration of the inertial sensor at the speed of each rotor, in a flight and compared with
//! healthy flights.
//!
//! ```text
//! log ─▶ speeds (ESC telemetry; or duty and voltage, scaled to the lines) ─▶ orders: a line for each rotor ─▶ growth over healthy flights
//!     └▶ neither speeds nor a model: band: the vehicle as a whole ──────────────────────────────────────────▶ growth over healthy flights
//! ```
//! A chipped or bent propeller is out of balance and shakes the vehicle once per revolution, long before it costs
//! thrust that a model would miss. The amplitude is that of the sensor at the reference speed; it grows with Ω², so
//! that flights at other speeds can be compared. The influence of the sensor's position and the frame's resonances is
//! the same in all flights of a vehicle, which is why the comparison with healthy flights decides and not the amplitude
//! itself: new propellers differ, too.
//!
//! Limits: a sensor sampled at less than some 2.2 times per revolution shows nothing of it; two rotors that always turn
//! at the same speed cannot be distinguished; filters of the autopilot before logging remove the signal: notches at
//! rotor speed above all, and low-passes, which end the band where the log states their corner.

mod band;
mod growth;
mod orders;
mod speeds;

use crate::log::low_pass::LowPass;
use crate::log::{FlightLog, names};
use crate::model::ModelVersion;
use crate::predict::PredictError;
use crate::{LEAST_BASELINE, NAMED, Z95};
use growth::Level;
use orders::{LEAST_BLOCKS, Power, Shaken};
use serde::Serialize;
use std::f64::consts::TAU;
use utoipa::ToSchema;

/// Slowest rotor that counts as turning, rad/s.
const TURNING_RAD_S: f64 = 60.0;
/// A line exists if its power is this many standard errors above zero.
const LEAST_LINE: f64 = 3.0;
/// Passes over the rotors that look for the scale of each one's speed.
const SCALE_PASSES: usize = 2;
/// Share of the strongest line's power that another rotor may explain at most, if the rotor is to be named.
const MOST_RIVAL: f64 = 0.9;
/// Half seconds that are evaluated for the vibration of a vehicle as a whole.
const MOST_WHOLE_BLOCKS: usize = 400;
/// Bands whose upper ends differ by no more, Hz, are the same.
const SAME_BAND_HZ: f64 = 2.0;
/// Growth below which a rotor is not reported, at the lower end of its interval.
const LEAST_GROWTH: f64 = 1.2;

/// Sensor that measured the vibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
#[schema(as = VibrationSensor)]
pub enum Sensor {
    /// Specific force, m/s².
    Accelerometer,
    /// Body rates, rad/s.
    Gyro,
}

impl Sensor {
    /// Unit of an amplitude.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Accelerometer => "m/s²",
            Self::Gyro => "rad/s",
        }
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Accelerometer => "accelerometer",
            Self::Gyro => "gyro",
        }
    }

    fn columns(self) -> [&'static str; 3] {
        match self {
            Self::Accelerometer => names::ACCEL,
            Self::Gyro => names::RATES,
        }
    }
}

/// Line of one rotor.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = VibrationLine)]
pub struct Line {
    /// Rotor, from 1.
    pub rotor: usize,
    /// Mean speed in the air, Hz.
    pub speed_hz: f64,
    /// Amplitude over the three axes at the vehicle's mean rotor speed, in the sensor's unit; absent if another rotor
    /// turns at the same speed all the time.
    pub amplitude: Option<f64>,
    /// 95 % interval of the amplitude.
    pub interval_95: Option<[f64; 2]>,
    /// True if the line exceeds the noise.
    pub seen: bool,
    /// Half-second blocks in which the rotor can be separated from the others.
    pub blocks: usize,
}

/// The strongest line of a flight whose rotor speeds are derived from duty and voltage.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
#[schema(as = StrongestVibration)]
pub struct Strongest {
    /// Rotor that explains it best, from 1.
    pub rotor: usize,
    /// Power explained by the best other rotor, relative to that of this rotor: near 1 if all rotors turn at the same
    /// speed, as in a hover.
    pub rival: f64,
    /// True if the rotor can be separated from the others.
    pub told_apart: bool,
}

/// Vibration at the speed of each rotor in one flight.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = RotorVibration)]
pub struct Vibration {
    /// Log.
    pub log: String,
    /// Sensor.
    pub sensor: Sensor,
    /// Rate of the sensor, Hz.
    pub rate_hz: f64,
    /// Source of the rotor speeds, in words.
    pub speeds_from: String,
    /// Mean speed of all rotors in the air, to which amplitudes refer, Hz; if no speeds are known, frequency of the
    /// strongest vibration.
    pub reference_hz: f64,
    /// Combined amplitude of the rotors' lines (root sum of squares), in the sensor's unit; if no speeds are known,
    /// that of all vibration in the band.
    pub amplitude: f64,
    /// Vibration band of the whole vehicle, Hz, if neither rotor speeds nor a model are given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub band_hz: Option<[f64; 2]>,
    /// If the speeds are derived from duty and voltage: what is known of the strongest line.
    pub strongest: Option<Strongest>,
    /// Rotors in their order; empty if no speeds are known.
    pub rotors: Vec<Line>,
    /// ln of the amplitude of all over Ω².
    #[serde(skip)]
    level: f64,
    /// ln of amplitude over Ω² and its variance; none for a rotor that is not separable.
    #[serde(skip)]
    levels: Vec<Option<Level>>,
}

/// Growth of a rotor's line against healthy flights.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = VibrationGrowth)]
pub struct Growth {
    /// Rotor, from 1; absent for all together.
    pub rotor: Option<usize>,
    /// Ratio of its amplitude to that of the healthy flights, at the same speed.
    pub factor: f64,
    /// 95 % interval.
    pub interval_95: [f64; 2],
    /// Posterior probability that it has grown.
    pub posterior: f64,
}

/// Vibration compared with that of healthy flights.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = VibrationChange)]
pub struct Change {
    /// In words.
    pub sentence: String,
    /// Rotors that vibrate more with a probability of 95 %, strongest first. If speeds are derived from duty and
    /// voltage, at most one, with the growth of all lines together.
    pub named: Vec<Growth>,
    /// Growth of all lines together: factor, 95 % interval, posterior.
    pub together: Growth,
    /// Every rotor that can be separated in all flights; empty if speeds are derived from duty and voltage.
    pub rotors: Vec<Growth>,
    /// Each of the logs.
    pub flights: Vec<Vibration>,
}

/// Vibration at the rotors' speeds in one flight.
///
/// * `model`: needed for single rotors where no column holds rotor speeds; without either the vehicle is taken as a whole
///
/// # Errors
/// One sentence: no sensor fast enough, or no lines.
pub fn vibration(log: &FlightLog, model: Option<&ModelVersion>) -> Result<Vibration, PredictError> {
    vibration_up_to(log, model, f64::INFINITY)
}

/// As [`vibration`], with a band that ends at `top_hz` at the latest.
fn vibration_up_to(log: &FlightLog, model: Option<&ModelVersion>, top_hz: f64) -> Result<Vibration, PredictError> {
    let air = log.flight_parts(None).in_the_air();
    let told = speeds::measured(log);
    let (speeds, from_telemetry) = match (told, model) {
        (Some(told), _) => (told, true),
        (None, Some(model)) => (speeds::from_thrust(log, model, &air)?, false),
        (None, None) => return by_sensor(log, "no vibration", |sensor| as_a_whole(&sensor, &air, top_hz)),
    };
    let mean = speeds::mean_in(&log.time_s, &speeds, &air);
    by_sensor(log, "no vibration by rotor", |sensed| {
        let Sensed {
            sensor, axes, rate_hz, ..
        } = sensed;
        let fastest = if from_telemetry { mean / TAU } else { speeds::SLOWEST_HZ };
        if fastest > speeds::FASTEST * rate_hz {
            return Err(format!(
                "the {} comes at {rate_hz:.0} Hz, too slow for rotors at {fastest:.0} Hz{}",
                sensor.name(),
                if from_telemetry { "" } else { " and above" }
            ));
        }
        let shaken = Shaken {
            time_s: &log.time_s,
            axes,
            speeds: speeds.clone(),
            reference: mean,
            blocks: turning(
                orders::blocks(&log.time_s, &air, log.sample_rate_hz()),
                &speeds,
                from_telemetry,
            ),
        };
        of_sensor(log, sensor, rate_hz, shaken, from_telemetry).map_err(|reason| reason + &sensed.filtered())
    })
}

/// An inertial sensor of a log, the rate that it comes at, Hz, and the autopilot's filter before it was logged.
struct Sensed<'a> {
    log: &'a FlightLog,
    sensor: Sensor,
    axes: [&'a [f64]; 3],
    rate_hz: f64,
    low_pass: Option<LowPass>,
}

impl Sensed<'_> {
    /// What the filter has removed, at the end of a reason.
    fn filtered(&self) -> String {
        self.low_pass
            .map_or_else(String::new, |LowPass { corner_hz, setting }| {
                format!(" (the autopilot filters it above {corner_hz:.0} Hz before it logs it: {setting})")
            })
    }
}

/// What the first sensor that shows anything shows.
///
/// # Errors
/// One sentence: `nothing`, and the reason of each sensor.
fn by_sensor<'a>(
    log: &'a FlightLog,
    nothing: &str,
    of: impl Fn(Sensed<'a>) -> Result<Vibration, String>,
) -> Result<Vibration, PredictError> {
    let mut reasons = Vec::new();
    for sensor in [Sensor::Accelerometer, Sensor::Gyro] {
        let low_pass = match sensor {
            Sensor::Accelerometer => log.accelerometer_low_pass(),
            Sensor::Gyro => log.gyro_low_pass(),
        };
        let rate_hz = log.source_rate(sensor.columns()[2]).map_or(0.0, |rate| rate.source_hz);
        let found = match log.vector(sensor.columns()) {
            Some(axes) => of(Sensed {
                log,
                sensor,
                axes,
                rate_hz,
                low_pass,
            }),
            None => Err(format!("no {}", sensor.name())),
        };
        match found {
            Ok(found) => return Ok(found),
            Err(reason) => reasons.push(reason),
        }
    }
    Err(PredictError(format!("{}: {nothing}: {}", log.name, reasons.join("; "))))
}

/// Vibration of the vehicle as a whole, without rotor speeds.
fn as_a_whole(sensed: &Sensed<'_>, air: &[(f64, f64)], top_hz: f64) -> Result<Vibration, String> {
    let Sensed {
        log,
        sensor,
        axes,
        rate_hz,
        low_pass,
    } = *sensed;
    let [low, mut high] = band::of_rate(rate_hz).ok_or_else(|| {
        format!(
            "the {} comes at {rate_hz:.0} Hz; at least {:.0} Hz are needed",
            sensor.name(),
            band::least_rate()
        )
    })?;
    if let Some(LowPass { corner_hz, setting }) = low_pass {
        if corner_hz < band::least_top() {
            return Err(format!(
                "the autopilot filters the {} above {corner_hz:.0} Hz before it logs it ({setting}), so its vibration is not in the log; a corner of at least {:.0} Hz is needed",
                sensor.name(),
                band::least_top()
            ));
        }
        high = high.min(corner_hz);
    }
    let shaken = Shaken {
        time_s: &log.time_s,
        axes,
        speeds: Vec::new(),
        reference: f64::NAN,
        blocks: orders::blocks(&log.time_s, air, log.sample_rate_hz()),
    };
    if shaken.blocks.len() < LEAST_BLOCKS {
        return Err(format!(
            "{} half-second blocks of the {} in the air; {LEAST_BLOCKS} are needed",
            shaken.blocks.len(),
            sensor.name()
        ));
    }
    let band_hz = [low, high.min(top_hz)];
    let whole = band::whole(&shaken, band_hz, MOST_WHOLE_BLOCKS)
        .ok_or_else(|| format!("the {} has no whole half second", sensor.name()))?;
    Ok(Vibration {
        log: log.name.clone(),
        sensor,
        rate_hz,
        speeds_from: "nothing: no rotor speeds from the ESCs in the log, and no model".to_owned(),
        reference_hz: whole.strongest_hz,
        amplitude: whole.power.sqrt(),
        band_hz: Some(band_hz),
        strongest: None,
        rotors: Vec::new(),
        level: 0.5 * whole.power.max(f64::MIN_POSITIVE).ln(),
        levels: Vec::new(),
    })
}

/// Blocks in which all rotors turn.
fn turning(blocks: Vec<std::ops::Range<usize>>, speeds: &[Vec<f64>], absolute: bool) -> Vec<std::ops::Range<usize>> {
    let least = if absolute { TURNING_RAD_S } else { 0.1 };
    let turns = |rows: &std::ops::Range<usize>| speeds.iter().all(|s| s[rows.clone()].iter().all(|x| *x > least));
    blocks.into_iter().filter(turns).collect()
}

fn of_sensor(
    log: &FlightLog,
    sensor: Sensor,
    rate_hz: f64,
    mut shaken: Shaken<'_>,
    from_telemetry: bool,
) -> Result<Vibration, String> {
    if shaken.blocks.len() < LEAST_BLOCKS {
        return Err(format!(
            "{} half-second blocks of the {} in the air with all rotors turning; {LEAST_BLOCKS} are needed",
            shaken.blocks.len(),
            sensor.name()
        ));
    }
    let mut speeds_from = "ESC telemetry".to_owned();
    if !from_telemetry {
        let Some(scale) = speeds::scale_of(&shaken, rate_hz) else {
            return Err(format!(
                "the {} shows no lines at speeds that follow duty and voltage between {:.0} and {:.0} Hz",
                sensor.name(),
                speeds::SLOWEST_HZ,
                speeds::FASTEST * rate_hz
            ));
        };
        for speed in shaken.speeds.iter_mut().flatten() {
            *speed *= scale;
        }
        shaken.reference *= scale;
        speeds_from = format!(
            "duty and voltage, scaled to the lines at {:.1} Hz",
            shaken.reference / TAU
        );
    }
    let mut strongest = None;
    let mut total = None;
    if from_telemetry {
        for _ in 0..SCALE_PASSES {
            for rotor in 0..shaken.speeds.len() {
                let scale = shaken.best_scale(rotor, speeds::OWN_SCALE_TOLD, speeds::SEARCH_BLOCKS);
                shaken.speeds[rotor].iter_mut().for_each(|speed| *speed *= scale);
            }
        }
    } else {
        let pursuit = shaken.pursue(speeds::OWN_SCALE_FROM_DUTY, speeds::SEARCH_BLOCKS);
        for (speeds, scale) in shaken.speeds.iter_mut().zip(&pursuit.scales) {
            speeds.iter_mut().for_each(|speed| *speed *= scale);
        }
        total = Some(pursuit.power);
        strongest = Some(Strongest {
            rotor: pursuit.first + 1,
            rival: pursuit.rival,
            told_apart: pursuit.rival < MOST_RIVAL,
        });
    }
    let powers = shaken.powers();
    let total = total.unwrap_or_else(|| powers.iter().flatten().map(|power| power.mean.max(0.0)).sum());
    let air_mean = |rotor: usize| {
        let rows: Vec<usize> = shaken.blocks.iter().flat_map(Clone::clone).collect();
        rows.iter().map(|k| shaken.speeds[rotor][*k]).sum::<f64>() / rows.len() as f64 / TAU
    };
    let rotors: Vec<Line> = powers
        .iter()
        .enumerate()
        .map(|(r, power)| line(r + 1, air_mean(r), *power))
        .collect();
    if from_telemetry && !rotors.iter().any(|line| line.seen) {
        return Err(format!(
            "no line of any rotor exceeds the noise of the {}",
            sensor.name()
        ));
    }
    let level = |power: &Power| -> Level {
        let at_least = power.mean.max(power.error).max(f64::MIN_POSITIVE);
        let relative = power.error / at_least;
        (
            0.5 * at_least.ln() - 2.0 * shaken.reference.ln(),
            0.25 * relative * relative,
        )
    };
    Ok(Vibration {
        log: log.name.clone(),
        sensor,
        rate_hz,
        speeds_from,
        reference_hz: shaken.reference / TAU,
        amplitude: total.sqrt(),
        band_hz: None,
        strongest,
        rotors,
        level: 0.5 * total.max(f64::MIN_POSITIVE).ln() - 2.0 * shaken.reference.ln(),
        levels: powers.iter().map(|power| power.as_ref().map(level)).collect(),
    })
}

fn line(rotor: usize, speed_hz: f64, power: Option<Power>) -> Line {
    let root = |x: f64| x.max(0.0).sqrt();
    Line {
        rotor,
        speed_hz,
        amplitude: power.map(|p| root(p.mean)),
        interval_95: power.map(|p| [root(p.mean - Z95 * p.error), root(p.mean + Z95 * p.error)]),
        seen: power.is_some_and(|p| p.mean > LEAST_LINE * p.error),
        blocks: power.map_or(0, |p| p.blocks),
    }
}

/// Which rotors shake more than in healthy flights of the same vehicle; several logs count as one flight.
///
/// # Errors
/// One sentence: fewer than [`LEAST_BASELINE`] healthy flights, or a log that shows no vibration of single rotors, or sensors that differ.
pub fn change(logs: &[FlightLog], healthy: &[FlightLog], model: Option<&ModelVersion>) -> Result<Change, PredictError> {
    if healthy.len() < LEAST_BASELINE || logs.is_empty() {
        return Err(PredictError(format!(
            "expected a log and at least {LEAST_BASELINE} healthy flights, because their spread is needed to detect a change, got {} and {}",
            logs.len(),
            healthy.len()
        )));
    }
    let of = |logs: &[FlightLog], top_hz: f64| {
        logs.iter()
            .map(|log| vibration_up_to(log, model, top_hz))
            .collect::<Result<Vec<_>, _>>()
    };
    let (mut flights, mut baseline) = (of(logs, f64::INFINITY)?, of(healthy, f64::INFINITY)?);
    let tops = || flights.iter().chain(&baseline).filter_map(|one| Some(one.band_hz?[1]));
    let (least, most) = tops().fold((f64::INFINITY, 0.0), |(a, b), top| (top.min(a), top.max(b)));
    if most > least + SAME_BAND_HZ {
        (flights, baseline) = (of(logs, least)?, of(healthy, least)?);
    }
    let (flights, healthy) = (flights, baseline);
    let first = &flights[0];
    let whole = |one: &Vibration| one.band_hz.is_some();
    if let Some(other) = flights.iter().chain(&healthy).find(|one| whole(one) != whole(first)) {
        let (with, without) = if whole(first) { (other, first) } else { (first, other) };
        return Err(PredictError(format!(
            "{}: expected rotor speeds as in {}, or a model that gives them from duty and voltage (--model)",
            without.log, with.log
        )));
    }
    if let Some(other) = flights.iter().chain(&healthy).find(|one| one.sensor != first.sensor) {
        return Err(PredictError(format!(
            "{}: expected the vibration of the {} as in {}, only the {} shows it",
            other.log,
            first.sensor.name(),
            first.log,
            other.sensor.name()
        )));
    }
    let all = |of: &[Vibration]| of.iter().map(|one| (one.level, 0.0)).collect::<Vec<Level>>();
    let levels = |of: &[Vibration]| of.iter().map(|one| one.levels.clone()).collect::<Vec<_>>();
    let count = flights.len() as f64;
    let flown = (all(&flights).iter().map(|level| level.0).sum::<f64>() / count, 0.0);
    let together = grown(None, growth::whole(flown, &all(&healthy)));
    let told = flights.iter().chain(&healthy).all(|one| one.strongest.is_none());
    let rotors: Vec<Growth> = if told {
        let changes = growth::changes(&growth::together(&levels(&flights)), &levels(&healthy));
        let of_rotors = changes.iter().enumerate();
        of_rotors
            .filter_map(|(r, change)| change.map(|c| grown(Some(r + 1), c)))
            .collect()
    } else {
        Vec::new()
    };
    let mut named: Vec<Growth> = rotors.iter().filter(|one| one.is_certain()).cloned().collect();
    named.sort_by(|a, b| b.factor.total_cmp(&a.factor));
    if !told && together.is_certain() {
        let strongest = |one: &Vibration| one.strongest.filter(|s| s.told_apart).map(|s| s.rotor);
        let rotor = strongest(first).filter(|rotor| flights.iter().all(|one| strongest(one) == Some(*rotor)));
        named.extend(rotor.map(|rotor| Growth {
            rotor: Some(rotor),
            ..together.clone()
        }));
    }
    let mut change = Change {
        sentence: String::new(),
        named,
        together,
        rotors,
        flights,
    };
    change.sentence = sentence(&change, healthy.len(), told);
    Ok(change)
}

fn grown(rotor: Option<usize>, change: growth::Change) -> Growth {
    Growth {
        rotor,
        factor: change.growth.exp(),
        interval_95: [(change.growth - change.half).exp(), (change.growth + change.half).exp()],
        posterior: change.posterior,
    }
}

impl Growth {
    fn is_certain(&self) -> bool {
        self.posterior >= NAMED && self.interval_95[0] > LEAST_GROWTH
    }

    /// Factor with interval and probability.
    fn words(&self) -> String {
        format!(
            "{:.1} times, 95 %: {:.1} to {:.1}, probability {:.1} %",
            self.factor,
            self.interval_95[0],
            self.interval_95[1],
            100.0 * self.posterior
        )
    }
}

fn sentence(change: &Change, healthy: usize, told: bool) -> String {
    let against = format!("Against {healthy} healthy flights");
    let named: Vec<String> = change
        .named
        .iter()
        .filter_map(|one| Some(format!("rotor {} ({})", one.rotor?, one.words())))
        .collect();
    if let Some([low, high]) = change.flights[0].band_hz {
        return if change.together.is_certain() {
            format!(
                "{against} the vehicle vibrates more between {low:.0} and {high:.0} Hz ({}). Which rotor it is, is not shown without rotor \
                 speeds.",
                change.together.words()
            )
        } else {
            format!("{against} the vehicle does not vibrate significantly more between {low:.0} and {high:.0} Hz.")
        };
    }
    match (named.is_empty(), change.together.is_certain()) {
        (true, false) => format!("{against} no rotor vibrates significantly more."),
        (true, true) => format!(
            "{against} the rotors together vibrate more at their own speeds ({}); these flights do not show which of them. {}",
            change.together.words(),
            if told {
                "Manoeuvres in which the rotors turn at different speeds would."
            } else {
                "Logged rotor speeds would, or manoeuvres in which the rotors turn at different speeds."
            }
        ),
        (false, _) if told => format!("{against} these vibrate more at their own speed: {}.", named.join(", ")),
        (false, _) => format!(
            "{against} the rotors together vibrate more at their own speeds ({}), and the strongest line is that of rotor {}.",
            change.together.words(),
            change.named[0].rotor.unwrap_or(0)
        ),
    }
}

#[cfg(test)]
mod tests;
