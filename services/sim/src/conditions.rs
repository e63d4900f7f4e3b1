//! Condition of each rotor and sensor at each step, from the scenario's fault schedule, with descriptions.
//!
//! The telemetry contains a code per rotor and a bit per sensor fault; this module computes them and defines their meaning.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::powertrain::faults::{Cycle, FaultEntry};
use rotortwin_plant::sensing::faults::SensorFaultEntry;
use rotortwin_plant::sensing::readings::Sensor;
use rotortwin_plant::{STEP_S, nearest_step};
use rotortwin_scenario::Scenario;
use rotortwin_store::spool::DroppedLoad;
use std::collections::{BTreeMap, VecDeque};

/// The schedule of one scenario, stepped through in order.
#[derive(Clone)]
pub struct ConditionSchedule {
    /// Sorted by first step.
    rotor_changes: Vec<RotorChange>,
    /// Number of entries of `rotor_changes` already in force.
    passed: usize,
    /// Current code of each rotor, intermittent faults aside.
    rotors: [i32; MAX_ROTORS],
    /// The changes in force that are intermittent.
    intermittent: Vec<RotorChange>,
    /// (first step, step after the last, bit).
    sensor_faults: Vec<(u64, u64, u32)>,
    descriptions: BTreeMap<i32, String>,
    sensor_fault_names: Vec<String>,
    /// Step and mass, kg, of each dropped load, in this order.
    loads: VecDeque<(u64, f64)>,
}

/// A rotor from one entry of the scenario to the next.
#[derive(Clone, Copy)]
struct RotorChange {
    first_step: u64,
    /// From 0.
    rotor: usize,
    /// Codes; where bit 1 of the place is set, the thrust is as it was before its intermittent fault, and with bit 0 so is the torque.
    codes: [i32; 4],
    /// Onset and periods of the intermittent faults of thrust and of torque.
    cycles: [Option<(u64, Cycle)>; 2],
}

impl RotorChange {
    fn code(&self, step: u64) -> i32 {
        let place = self.cycles.iter().fold(0, |place, cycle| {
            let rests = cycle.is_some_and(|(onset, cycle)| !cycle.acts(step - onset));
            2 * place + usize::from(rests)
        });
        self.codes[place]
    }
}

/// One of a rotor's quantities in words; `None`: as on a healthy rotor.
#[derive(Clone, Default)]
struct Words {
    /// What lasts.
    settled: Option<String>,
    /// What comes and goes in its place.
    intermittent: Option<(u64, Cycle, Option<String>)>,
}

impl Words {
    /// Takes a change from an entry.
    fn take(&mut self, entry: &FaultEntry, words: Option<String>) {
        if let Some(cycle) = entry.cycle() {
            let [period, on] = [entry.period_s, entry.on_s].map(Option::unwrap_or_default);
            let words = words.map(|words| format!("{words} for {on} s in every {period} s"));
            self.intermittent = Some((nearest_step(entry.time_s), cycle, words));
            return;
        }
        let ramp = entry.ramp_s.filter(|ramp| *ramp > 0.0);
        let ramp = ramp.map(|ramp| format!(" over {ramp} s")).unwrap_or_default();
        *self = Self {
            settled: words.map(|words| words + &ramp),
            intermittent: None,
        };
    }

    fn now(&self, rests: bool) -> Option<&str> {
        match &self.intermittent {
            Some((.., words)) if !rests => words.as_deref(),
            _ => self.settled.as_deref(),
        }
    }

    fn cycle(&self) -> Option<(u64, Cycle)> {
        self.intermittent.as_ref().map(|(onset, cycle, _)| (*onset, *cycle))
    }
}

/// "−5 %", "+5 %"; `None`: nothing is changed.
fn signed(percent: f64) -> Option<String> {
    let sign = if percent > 0.0 { '+' } else { '−' };
    (percent != 0.0).then(|| format!("{sign}{} %", percent.abs()))
}

impl ConditionSchedule {
    /// The schedule of `scenario`.
    pub fn new(scenario: &Scenario) -> Self {
        let document = scenario.document();
        let mut entries: Vec<_> = document.fault.iter().collect();
        entries.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let count = i32::try_from(entries.len()).unwrap_or(i32::MAX / 4);
        let nominal = &scenario.vehicle().rotors.nominal_blade;
        let mut state: Vec<(Option<&str>, Words, Words)> = vec![Default::default(); MAX_ROTORS];
        let mut rotor_changes = Vec::new();
        let mut descriptions = BTreeMap::new();
        for (number, entry) in (1..).zip(entries) {
            let rotor = entry.rotor as usize - 1;
            let (blade, thrust, torque) = &mut state[rotor];
            if let Some(name) = &entry.blade {
                *blade = (name != nominal).then_some(name);
            }
            if let Some(percent) = entry.thrust_loss_percent {
                thrust.take(entry, signed(-percent).map(|percent| format!("{percent} thrust")));
            }
            if let Some(percent) = entry.moment_ratio_change_percent {
                torque.take(
                    entry,
                    signed(percent).map(|percent| format!("{percent} torque for its thrust")),
                );
            }
            if entry.rotor_lost == Some(true) {
                thrust.take(entry, Some("lost".to_owned()));
            }
            let cycles = [thrust.cycle(), torque.cycle()];
            let mut codes = [0; 4];
            for (place, code) in codes.iter_mut().enumerate() {
                let rests = [place & 2 != 0, place & 1 != 0];
                if rests
                    .iter()
                    .zip(&cycles)
                    .any(|(rests, cycle)| *rests && cycle.is_none())
                {
                    continue;
                }
                let words: Vec<String> = blade
                    .iter()
                    .map(|name| format!("blade {name}"))
                    .chain(thrust.now(rests[0]).map(str::to_owned))
                    .chain(torque.now(rests[1]).map(str::to_owned))
                    .collect();
                if !words.is_empty() {
                    *code = number + count * place as i32;
                    descriptions.insert(*code, words.join(", "));
                }
            }
            rotor_changes.push(RotorChange {
                first_step: nearest_step(entry.time_s),
                rotor,
                codes,
                cycles,
            });
        }
        let sensor_faults = (0u32..)
            .zip(&document.sensor_fault)
            .map(|(bit, entry)| {
                (
                    nearest_step(entry.time_s),
                    entry.end_s.map_or(u64::MAX, nearest_step),
                    bit,
                )
            })
            .collect();
        let mut loads: Vec<_> = document
            .load_drop
            .iter()
            .map(|drop| (nearest_step(drop.time_s), drop.mass_kg))
            .collect();
        loads.sort_by_key(|(step, _)| *step);
        Self {
            rotor_changes,
            passed: 0,
            rotors: [0; MAX_ROTORS],
            intermittent: Vec::new(),
            sensor_faults,
            descriptions,
            sensor_fault_names: document.sensor_fault.iter().map(sensor_fault_name).collect(),
            loads: loads.into(),
        }
    }

    /// Meaning of the rotor codes; 0 is healthy and has no entry.
    pub fn descriptions(&self) -> &BTreeMap<i32, String> {
        &self.descriptions
    }

    /// Meaning of the bits of the sensor-fault mask, from bit 0.
    pub fn sensor_fault_names(&self) -> &[String] {
        &self.sensor_fault_names
    }

    /// The loads that are dropped, in the order of time.
    pub fn dropped_loads(&self) -> Vec<DroppedLoad> {
        self.loads
            .iter()
            .map(|&(step, mass_kg)| DroppedLoad {
                time_s: step as f64 * STEP_S,
                mass_kg,
            })
            .collect()
    }

    /// Codes of the rotors and mask of the sensor faults in force at `step`. Steps must not decrease.
    #[inline]
    pub fn at(&mut self, step: u64) -> ([i32; MAX_ROTORS], u32) {
        while let Some(change) = self
            .rotor_changes
            .get(self.passed)
            .filter(|change| change.first_step <= step)
        {
            self.rotors[change.rotor] = change.codes[0];
            self.intermittent.retain(|other| other.rotor != change.rotor);
            if change.cycles.iter().any(Option::is_some) {
                self.intermittent.push(*change);
            }
            self.passed += 1;
        }
        let mut rotors = self.rotors;
        for change in &self.intermittent {
            rotors[change.rotor] = change.code(step);
        }
        let mask = self
            .sensor_faults
            .iter()
            .filter(|(first, end, _)| (*first..*end).contains(&step))
            .fold(0, |mask, (.., bit)| mask | 1 << bit);
        (rotors, mask)
    }

    /// Mass of the next load that has been dropped at `step` or before, kg. Steps must not decrease.
    #[inline]
    pub fn next_load(&mut self, step: u64) -> Option<f64> {
        self.loads.front().filter(|(at, _)| *at <= step)?;
        self.loads.pop_front().map(|(_, mass)| mass)
    }
}

/// "gyroscope: bias 0.02, 0, 0", and so on.
fn sensor_fault_name(entry: &SensorFaultEntry) -> String {
    let sensor = match entry.sensor {
        Sensor::Position => "position",
        Sensor::Velocity => "velocity",
        Sensor::Attitude => "attitude",
        Sensor::BodyRates => "body rates",
        Sensor::BatteryVoltage => "battery voltage",
    };
    let kind = match (&entry.bias_si, entry.dropout_probability, entry.delay_s) {
        (Some(bias), ..) => format!(
            "bias {}",
            bias.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
        ),
        (_, Some(share), _) => format!("{} % of the samples lost", 100.0 * share),
        (.., Some(delay)) => format!("{delay} s late"),
        (None, None, None) => "stuck".to_owned(),
    };
    format!("{sensor}: {kind}")
}
