//! Condition of each rotor and sensor at each step, from the scenario's fault schedule, with descriptions.
//!
//! The telemetry contains a code per rotor and a bit per sensor fault; this module computes them and defines their meaning.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::nearest_step;
use rotortwin_plant::sensing::faults::SensorFaultEntry;
use rotortwin_plant::sensing::readings::Sensor;
use rotortwin_scenario::Scenario;
use std::collections::BTreeMap;

/// The schedule of one scenario, stepped through in order.
#[derive(Clone)]
pub struct ConditionSchedule {
    /// (first step, rotor from 0, code), sorted by first step.
    rotor_changes: Vec<(u64, usize, i32)>,
    /// Number of entries of `rotor_changes` already in force.
    passed: usize,
    /// Current code of each rotor.
    rotors: [i32; MAX_ROTORS],
    /// (first step, step after the last, bit).
    sensor_faults: Vec<(u64, u64, u32)>,
    descriptions: BTreeMap<i32, String>,
    sensor_fault_names: Vec<String>,
}

impl ConditionSchedule {
    /// The schedule of `scenario`.
    pub fn new(scenario: &Scenario) -> Self {
        let document = scenario.document();
        let mut entries: Vec<_> = document.fault.iter().collect();
        entries.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let nominal = &scenario.vehicle().rotors.nominal_blade;
        let mut state: Vec<(Option<&str>, Option<String>)> = vec![(None, None); MAX_ROTORS];
        let mut rotor_changes = Vec::new();
        let mut descriptions = BTreeMap::new();
        for (number, entry) in (1..).zip(entries) {
            let rotor = entry.rotor as usize - 1;
            let (blade, loss) = &mut state[rotor];
            if let Some(name) = &entry.blade {
                *blade = (name != nominal).then_some(name);
            }
            if let Some(percent) = entry.thrust_loss_percent {
                let ramp = entry
                    .ramp_s
                    .filter(|ramp| *ramp > 0.0)
                    .map(|ramp| format!(" over {ramp} s"))
                    .unwrap_or_default();
                *loss = (percent > 0.0).then(|| format!("−{percent} % thrust{ramp}"));
            }
            if entry.rotor_lost == Some(true) {
                *loss = Some("lost".to_owned());
            }
            let words: Vec<String> = blade
                .iter()
                .map(|name| format!("blade {name}"))
                .chain(loss.iter().cloned())
                .collect();
            let code = if words.is_empty() { 0 } else { number };
            if code != 0 {
                descriptions.insert(code, words.join(", "));
            }
            rotor_changes.push((nearest_step(entry.time_s), rotor, code));
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
        Self {
            rotor_changes,
            passed: 0,
            rotors: [0; MAX_ROTORS],
            sensor_faults,
            descriptions,
            sensor_fault_names: document.sensor_fault.iter().map(sensor_fault_name).collect(),
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

    /// Codes of the rotors and mask of the sensor faults in force at `step`. Steps must not decrease.
    #[inline]
    pub fn at(&mut self, step: u64) -> ([i32; MAX_ROTORS], u32) {
        while let Some(&(_, rotor, code)) = self.rotor_changes.get(self.passed).filter(|change| change.0 <= step) {
            self.rotors[rotor] = code;
            self.passed += 1;
        }
        let mask = self
            .sensor_faults
            .iter()
            .filter(|(first, end, _)| (*first..*end).contains(&step))
            .fold(0, |mask, (.., bit)| mask | 1 << bit);
        (self.rotors, mask)
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
