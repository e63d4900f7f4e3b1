//! Fault schedule: which propeller is damaged when.
//!
//! A fault mounts another blade, takes a share of the thrust (at once or as a ramp), or loses the rotor. Blade and thrust loss are
//! independent of each other and stay until the next fault of the same kind on the same rotor. A loss of the rotor means that the
//! motor stops: its thrust runs down with the lag and nothing brings it back. A fault that cannot have an effect is refused.

use rotortwin_flight_core::MAX_ROTORS;
use serde::{Deserialize, Serialize};

use crate::error::{Refusal, in_range};
use crate::powertrain::blades::{Blade, BladeSet};
use crate::powertrain::rotors::Powertrain;
use crate::{STEP_RATE_HZ, nearest_step};

/// One `[[fault]]` of a scenario: exactly one of `blade`, `thrust_loss_percent`, `rotor_lost`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultEntry {
    /// Onset, s; the fault acts from the step nearest to it.
    pub time_s: f64,
    /// Rotor, from 1 as in the paper.
    pub rotor: u32,
    /// Name of the blade that is mounted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blade: Option<String>,
    /// Lost share of the rotor's thrust, percent, measured from the mounted blade; replaces an earlier loss.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thrust_loss_percent: Option<f64>,
    /// Time over which the thrust loss grows linearly to its value, s; 0 for a step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ramp_s: Option<f64>,
    /// `true`: the rotor stops for good.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotor_lost: Option<bool>,
}

#[derive(Debug, Clone, PartialEq)]
enum Action {
    Mount { blade: Blade, code: i32 },
    Lose { loss: f64, ramp_steps: u64 },
}

#[derive(Debug, Clone, PartialEq)]
struct PlannedFault {
    step: u64,
    rotor: usize,
    action: Action,
}

/// The checked faults of a scenario in the order of their onset.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FaultPlan(Vec<PlannedFault>);

impl FaultPlan {
    /// Checks all entries against the vehicle and against each other; `duration_steps` is the length of the flight.
    pub fn new(
        entries: &[FaultEntry],
        rotor_count: usize,
        blades: &BladeSet,
        nominal_blade: &str,
        duration_steps: u64,
    ) -> Result<Self, Refusal> {
        let mut order: Vec<usize> = (0..entries.len()).collect();
        for (i, entry) in entries.iter().enumerate() {
            in_range("time_s", entry.time_s, 0.0, 1e6, "s").map_err(|r| r.under(&format!("fault[{i}]")))?;
        }
        order.sort_by_key(|&i| nearest_step(entries[i].time_s));
        let mut mounted = vec![nominal_blade.to_owned(); rotor_count];
        let mut loss = vec![0.0; rotor_count];
        let mut plan: Vec<PlannedFault> = Vec::with_capacity(entries.len());
        for i in order {
            let prefix = format!("fault[{i}]");
            let entry = &entries[i];
            let fault = entry
                .plan(
                    rotor_count,
                    blades,
                    nominal_blade,
                    duration_steps,
                    &mut mounted,
                    &mut loss,
                )
                .map_err(|r| r.under(&prefix))?;
            let same = |other: &&PlannedFault| {
                let same_kind = std::mem::discriminant(&other.action) == std::mem::discriminant(&fault.action);
                other.rotor == fault.rotor && other.step == fault.step && same_kind
            };
            if plan.iter().any(|other| same(&other)) {
                let reason = "this rotor has another fault of the same kind at the same time: only one can act";
                return Err(Refusal::new(prefix, reason));
            }
            plan.push(fault);
        }
        Ok(Self(plan))
    }
}

impl FaultEntry {
    fn plan(
        &self,
        rotor_count: usize,
        blades: &BladeSet,
        nominal_blade: &str,
        duration_steps: u64,
        mounted: &mut [String],
        loss: &mut [f64],
    ) -> Result<PlannedFault, Refusal> {
        let step = nearest_step(self.time_s);
        if step >= duration_steps {
            let duration_s = duration_steps as f64 / STEP_RATE_HZ;
            let reason = format!(
                "this fault cannot have an effect: it sets in at {} s, the flight ends at {duration_s} s",
                self.time_s
            );
            return Err(Refusal::new("time_s", reason));
        }
        let rotor = match self.rotor as usize {
            number if (1..=rotor_count).contains(&number) => number - 1,
            number => {
                return Err(Refusal::new(
                    "rotor",
                    format!("expected a rotor from 1 to {rotor_count}, got {number}"),
                ));
            }
        };
        if loss[rotor] == 1.0 {
            let reason = format!(
                "this fault cannot have an effect: rotor {} was already lost",
                self.rotor
            );
            return Err(Refusal::new("rotor", reason));
        }
        if self.ramp_s.is_some() && self.thrust_loss_percent.is_none() {
            let reason = "a ramp needs thrust_loss_percent: a blade is changed and a rotor is lost at once";
            return Err(Refusal::new("ramp_s", reason));
        }
        let action = match (&self.blade, self.thrust_loss_percent, self.rotor_lost) {
            (Some(name), None, None) => {
                let Some(&blade) = blades.blade.get(name) else {
                    let names = blades.names().collect::<Vec<_>>().join(", ");
                    return Err(Refusal::new(
                        "blade",
                        format!("expected one of the blades {names}, got {name}"),
                    ));
                };
                if mounted[rotor] == *name {
                    let reason = format!(
                        "this fault cannot have an effect: rotor {} already has blade {name}",
                        self.rotor
                    );
                    return Err(Refusal::new("blade", reason));
                }
                mounted[rotor].clone_from(name);
                let code = if name == nominal_blade {
                    0
                } else {
                    blades.code(name).map_or(0, |code| code + 1)
                };
                Action::Mount { blade, code }
            }
            (None, Some(percent), None) => {
                in_range("thrust_loss_percent", percent, 0.0, 100.0, "%")?;
                let share = percent / 100.0;
                if share == loss[rotor] {
                    let reason = format!(
                        "this fault cannot have an effect: rotor {} already has a thrust loss of {percent} %",
                        self.rotor
                    );
                    return Err(Refusal::new("thrust_loss_percent", reason));
                }
                let ramp_s = self.ramp_s.unwrap_or(0.0);
                in_range("ramp_s", ramp_s, 0.0, 1e6, "s")?;
                loss[rotor] = share;
                Action::Lose {
                    loss: share,
                    ramp_steps: nearest_step(ramp_s),
                }
            }
            (None, None, Some(true)) => {
                loss[rotor] = 1.0;
                Action::Lose {
                    loss: 1.0,
                    ramp_steps: 0,
                }
            }
            (None, None, Some(false)) => {
                return Err(Refusal::new(
                    "rotor_lost",
                    "this fault cannot have an effect: expected true, got false",
                ));
            }
            _ => {
                return Err(Refusal::new(
                    "",
                    "expected exactly one of blade, thrust_loss_percent, rotor_lost",
                ));
            }
        };
        Ok(PlannedFault { step, rotor, action })
    }
}

/// A thrust loss that is still growing or shrinking.
#[derive(Debug, Clone, Copy)]
struct Ramp {
    rotor: usize,
    per_step: f64,
    target: f64,
    steps_left: u64,
}

/// The faults of one flight and how far they have gone.
#[derive(Debug, Clone)]
pub(crate) struct FaultSchedule {
    plan: FaultPlan,
    next: usize,
    ramps: Vec<Ramp>,
    /// Mounted blade of each rotor: 0 nominal, otherwise 1 + `BladeSet::code`.
    pub(crate) blade_code: [i32; MAX_ROTORS],
    /// Thrust loss of each rotor, fraction.
    pub(crate) thrust_loss: [f64; MAX_ROTORS],
}

impl FaultSchedule {
    pub(crate) fn new(plan: FaultPlan) -> Self {
        Self {
            plan,
            next: 0,
            ramps: Vec::new(),
            blade_code: [0; MAX_ROTORS],
            thrust_loss: [0.0; MAX_ROTORS],
        }
    }

    /// Brings the rotors into the condition of `step`; true if any has changed.
    #[inline]
    pub(crate) fn apply(&mut self, step: u64, powertrain: &mut Powertrain) -> bool {
        let due = self.plan.0.get(self.next).is_some_and(|fault| fault.step <= step);
        if !due && self.ramps.is_empty() {
            return false;
        }
        self.change(step, powertrain);
        true
    }

    #[cold]
    fn change(&mut self, step: u64, powertrain: &mut Powertrain) {
        while let Some(fault) = self.plan.0.get(self.next).filter(|fault| fault.step <= step) {
            self.next += 1;
            match &fault.action {
                Action::Mount { blade, code } => {
                    powertrain.rotor_mut(fault.rotor).blade = *blade;
                    self.blade_code[fault.rotor] = *code;
                }
                Action::Lose { loss, ramp_steps } => {
                    self.ramps.retain(|ramp| ramp.rotor != fault.rotor);
                    // A step is a ramp of one step: it is complete when the step named in the plan is integrated.
                    let steps = (*ramp_steps).max(1);
                    let per_step = (loss - self.thrust_loss[fault.rotor]) / steps as f64;
                    self.ramps.push(Ramp {
                        rotor: fault.rotor,
                        per_step,
                        target: *loss,
                        steps_left: steps,
                    });
                }
            }
        }
        for ramp in &mut self.ramps {
            ramp.steps_left -= 1;
            let loss = ramp.target - ramp.per_step * ramp.steps_left as f64;
            self.thrust_loss[ramp.rotor] = loss;
            powertrain.rotor_mut(ramp.rotor).thrust_loss = loss;
        }
        self.ramps.retain(|ramp| ramp.steps_left > 0);
    }

    /// Bit mask of rotors that are not healthy; bit 0 is rotor 1.
    pub(crate) fn faulty_rotors(&self) -> u32 {
        (0..MAX_ROTORS).fold(0, |mask, i| {
            mask | (u32::from(self.blade_code[i] != 0 || self.thrust_loss[i] != 0.0) << i)
        })
    }
}
