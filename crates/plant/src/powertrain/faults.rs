//! Fault schedule: which propeller is damaged when.
//!
//! A fault mounts another blade, changes the thrust or the torque that a rotor needs for it (at once, as a ramp, or on and off
//! periodically), or loses the rotor. Blade, thrust and torque are independent of each other and stay until the next fault of the same
//! kind on the same rotor. A loss of the rotor means that the motor stops: its thrust runs down with the lag and nothing brings it back.
//! A fault that cannot have an effect is refused.

use rotortwin_flight_core::MAX_ROTORS;
use serde::{Deserialize, Serialize};

use crate::error::{Refusal, in_range};
use crate::powertrain::blades::{Blade, BladeSet};
use crate::powertrain::rotors::Powertrain;
use crate::{STEP_RATE_HZ, nearest_step};

/// Largest gain of thrust, percent: a propeller of another pitch on the same motor gives no more.
const LARGEST_GAIN_PERCENT: f64 = 30.0;
/// Range of the change of the torque-to-lift ratio, percent.
const MOMENT_RATIO_CHANGE_PERCENT: (f64, f64) = (-50.0, 200.0);

/// One `[[fault]]` of a scenario: `blade`, `rotor_lost`, or `thrust_loss_percent` and `moment_ratio_change_percent`, one of them or both.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultEntry {
    /// Onset, s; the fault acts from the step nearest to it.
    pub time_s: f64,
    /// Rotor, from 1 as in the paper.
    pub rotor: u32,
    /// Name of the blade that is mounted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blade: Option<String>,
    /// Lost share of the rotor's thrust, percent, measured from the mounted blade; negative: the rotor gives more. Replaces an earlier
    /// loss.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thrust_loss_percent: Option<f64>,
    /// Change of the rotor's torque-to-lift ratio c_D/c_L, percent, measured from the mounted blade; replaces an earlier change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[doc(alias = "torque ratio")]
    pub moment_ratio_change_percent: Option<f64>,
    /// Time over which the changes in percent grow linearly to their values, s; 0 for a step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ramp_s: Option<f64>,
    /// Intermittent: from the onset on, the changes in percent act for [`Self::on_s`] in every period of this length, s. In between,
    /// the rotor is as it was before this fault. Rounded to steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period_s: Option<f64>,
    /// Duration of the fault in each period, s. Rounded to steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub on_s: Option<f64>,
    /// `true`: the rotor stops for good.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotor_lost: Option<bool>,
}

/// When an intermittent fault acts, in steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cycle {
    /// Steps in each period in which it acts; they come first.
    pub on_steps: u64,
    /// Steps from one begin to the next.
    pub period_steps: u64,
}

impl Cycle {
    /// Whether a fault that set in `since_onset` steps ago acts.
    pub fn acts(&self, since_onset: u64) -> bool {
        since_onset % self.period_steps < self.on_steps
    }
}

/// What a fault in percent changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Quantity {
    ThrustLoss,
    MomentRatio,
}

impl Quantity {
    const ALL: [Self; 2] = [Self::ThrustLoss, Self::MomentRatio];

    /// Key, range in percent, and its words for "rotor 1 already has …".
    fn declared(self) -> (&'static str, (f64, f64), &'static str) {
        match self {
            Self::ThrustLoss => (
                "thrust_loss_percent",
                (-LARGEST_GAIN_PERCENT, 100.0),
                "a thrust loss of",
            ),
            Self::MomentRatio => (
                "moment_ratio_change_percent",
                MOMENT_RATIO_CHANGE_PERCENT,
                "a change of its moment ratio of",
            ),
        }
    }
}

/// How a change, a fraction, comes about.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Course {
    /// Reaches `value` after this many steps.
    Settle { value: f64, ramp_steps: u64 },
    /// `value` and `between` in turns.
    Alternate { value: f64, between: f64, cycle: Cycle },
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Action {
    Mount { blade: Blade, code: i32 },
    Change { quantity: Quantity, course: Course },
}

impl Action {
    /// Only one fault of a kind can act on a rotor.
    fn same_kind(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Mount { .. }, Self::Mount { .. }) => true,
            (Self::Change { quantity: one, .. }, Self::Change { quantity: other, .. }) => one == other,
            _ => false,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct PlannedFault {
    step: u64,
    rotor: usize,
    action: Action,
}

/// The checked faults of a scenario in the order of their onset.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FaultPlan(Vec<PlannedFault>);

/// What the entries so far have made of a rotor.
#[derive(Clone)]
struct Rotor<'a> {
    blade: &'a str,
    /// Of each [`Quantity`]: where it has settled, between the bursts of an intermittent fault if there is one.
    settled: [f64; 2],
    alternates: [bool; 2],
}

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
        let healthy = Rotor {
            blade: nominal_blade,
            settled: [0.0; 2],
            alternates: [false; 2],
        };
        let mut rotors = vec![healthy; rotor_count];
        let mut plan: Vec<PlannedFault> = Vec::with_capacity(entries.len());
        for i in order {
            let prefix = format!("fault[{i}]");
            let entry = &entries[i];
            let (step, rotor) = entry.place(rotor_count, duration_steps).map_err(|r| r.under(&prefix))?;
            let actions = entry
                .actions(blades, nominal_blade, &mut rotors[rotor])
                .map_err(|r| r.under(&prefix))?;
            for action in actions {
                let fault = PlannedFault { step, rotor, action };
                let same = |other: &&PlannedFault| {
                    other.rotor == fault.rotor && other.step == fault.step && other.action.same_kind(&fault.action)
                };
                if plan.iter().any(|other| same(&other)) {
                    let reason = "this rotor has another fault of the same kind at the same time: only one can act";
                    return Err(Refusal::new(prefix, reason));
                }
                plan.push(fault);
            }
        }
        Ok(Self(plan))
    }
}

impl FaultEntry {
    /// The periods of an intermittent fault; `None`: it lasts. The scenario has been checked.
    pub fn cycle(&self) -> Option<Cycle> {
        let (period_s, on_s) = (self.period_s?, self.on_s?);
        Some(Cycle {
            on_steps: nearest_step(on_s),
            period_steps: nearest_step(period_s),
        })
    }

    /// Step and rotor, from 0.
    fn place(&self, rotor_count: usize, duration_steps: u64) -> Result<(u64, usize), Refusal> {
        let step = nearest_step(self.time_s);
        if step >= duration_steps {
            let duration_s = duration_steps as f64 / STEP_RATE_HZ;
            let reason = format!(
                "this fault cannot have an effect: it sets in at {} s, the flight ends at {duration_s} s",
                self.time_s
            );
            return Err(Refusal::new("time_s", reason));
        }
        match self.rotor as usize {
            number if (1..=rotor_count).contains(&number) => Ok((step, number - 1)),
            number => Err(Refusal::new(
                "rotor",
                format!("expected a rotor from 1 to {rotor_count}, got {number}"),
            )),
        }
    }

    fn percent(&self, quantity: Quantity) -> Option<f64> {
        match quantity {
            Quantity::ThrustLoss => self.thrust_loss_percent,
            Quantity::MomentRatio => self.moment_ratio_change_percent,
        }
    }

    /// Refuses keys on the course of a change in an entry that has none.
    fn check_course(&self) -> Result<(), Refusal> {
        let in_percent = Quantity::ALL.iter().any(|&quantity| self.percent(quantity).is_some());
        let courses = [
            ("ramp_s", "a ramp", self.ramp_s),
            ("period_s", "a period", self.period_s),
            ("on_s", "a duration", self.on_s),
        ];
        for (key, what, value) in courses {
            if value.is_some() && !in_percent {
                let reason = format!(
                    "{what} needs thrust_loss_percent or moment_ratio_change_percent: a blade is changed and a rotor is lost at once"
                );
                return Err(Refusal::new(key, reason));
            }
        }
        match (self.period_s, self.on_s) {
            (None, None) => return Ok(()),
            (Some(_), None) => {
                return Err(Refusal::new(
                    "period_s",
                    "an intermittent fault needs on_s with it, s in each period",
                ));
            }
            (None, Some(_)) => return Err(Refusal::new("on_s", "an intermittent fault needs period_s with it, s")),
            (Some(period_s), Some(on_s)) => {
                in_range("period_s", period_s, 2.0 / STEP_RATE_HZ, 1e6, "s")?;
                in_range("on_s", on_s, 1.0 / STEP_RATE_HZ, 1e6, "s")?;
            }
        }
        if self.ramp_s.is_some() {
            let reason = "an intermittent fault sets in and ends at once: expected ramp_s or period_s, not both";
            return Err(Refusal::new("ramp_s", reason));
        }
        match self.cycle() {
            Some(Cycle { on_steps, period_steps }) if on_steps >= period_steps => {
                let reason = format!(
                    "expected less than period_s, {} s, got {} s: without a pause the fault is not intermittent",
                    period_steps as f64 / STEP_RATE_HZ,
                    on_steps as f64 / STEP_RATE_HZ,
                );
                Err(Refusal::new("on_s", reason))
            }
            _ => Ok(()),
        }
    }

    fn actions<'a>(
        &self,
        blades: &'a BladeSet,
        nominal_blade: &str,
        rotor: &mut Rotor<'a>,
    ) -> Result<Vec<Action>, Refusal> {
        let lost = Quantity::ThrustLoss as usize;
        if rotor.settled[lost] == 1.0 && !rotor.alternates[lost] {
            let reason = format!(
                "this fault cannot have an effect: rotor {} was already lost",
                self.rotor
            );
            return Err(Refusal::new("rotor", reason));
        }
        self.check_course()?;
        let in_percent = Quantity::ALL.iter().any(|&quantity| self.percent(quantity).is_some());
        match (&self.blade, self.rotor_lost, in_percent) {
            (Some(name), None, false) => Ok(vec![self.mount(name, blades, nominal_blade, rotor)?]),
            (None, None, true) => {
                let mut actions = Vec::with_capacity(2);
                for quantity in Quantity::ALL {
                    if let Some(percent) = self.percent(quantity) {
                        let course = self.course(quantity, percent, rotor)?;
                        actions.push(Action::Change { quantity, course });
                    }
                }
                Ok(actions)
            }
            (None, Some(true), false) => {
                (rotor.settled[lost], rotor.alternates[lost]) = (1.0, false);
                Ok(vec![Action::Change {
                    quantity: Quantity::ThrustLoss,
                    course: Course::Settle {
                        value: 1.0,
                        ramp_steps: 0,
                    },
                }])
            }
            (None, Some(false), false) => Err(Refusal::new(
                "rotor_lost",
                "this fault cannot have an effect: expected true, got false",
            )),
            _ => Err(Refusal::new(
                "",
                "expected blade, rotor_lost, or thrust_loss_percent and moment_ratio_change_percent (one of them or both)",
            )),
        }
    }

    fn mount<'a>(
        &self,
        name: &str,
        blades: &'a BladeSet,
        nominal_blade: &str,
        rotor: &mut Rotor<'a>,
    ) -> Result<Action, Refusal> {
        let Some((found, &blade)) = blades.blade.get_key_value(name) else {
            let names = blades.names().collect::<Vec<_>>().join(", ");
            return Err(Refusal::new(
                "blade",
                format!("expected one of the blades {names}, got {name}"),
            ));
        };
        if rotor.blade == name {
            let reason = format!(
                "this fault cannot have an effect: rotor {} already has blade {name}",
                self.rotor
            );
            return Err(Refusal::new("blade", reason));
        }
        rotor.blade = found;
        let code = if name == nominal_blade {
            0
        } else {
            blades.code(name).map_or(0, |code| code + 1)
        };
        Ok(Action::Mount { blade, code })
    }

    fn course(&self, quantity: Quantity, percent: f64, rotor: &mut Rotor<'_>) -> Result<Course, Refusal> {
        let (key, (low, high), has) = quantity.declared();
        in_range(key, percent, low, high, "%")?;
        let value = percent / 100.0;
        let place = quantity as usize;
        if value == rotor.settled[place] && !rotor.alternates[place] {
            let reason = format!(
                "this fault cannot have an effect: rotor {} already has {has} {percent} %",
                self.rotor
            );
            return Err(Refusal::new(key, reason));
        }
        rotor.alternates[place] = false;
        if let Some(cycle) = self.cycle() {
            let between = rotor.settled[place];
            rotor.alternates[place] = true;
            return Ok(Course::Alternate { value, between, cycle });
        }
        let ramp_s = self.ramp_s.unwrap_or(0.0);
        in_range("ramp_s", ramp_s, 0.0, 1e6, "s")?;
        rotor.settled[place] = value;
        Ok(Course::Settle {
            value,
            ramp_steps: nearest_step(ramp_s),
        })
    }
}

/// A change that is still growing or shrinking.
#[derive(Debug, Clone, Copy)]
struct Ramp {
    rotor: usize,
    quantity: Quantity,
    per_step: f64,
    target: f64,
    steps_left: u64,
}

/// An intermittent change.
#[derive(Debug, Clone, Copy)]
struct Burst {
    rotor: usize,
    quantity: Quantity,
    value: f64,
    between: f64,
    cycle: Cycle,
    acts: bool,
    /// Step at which it sets in or ends next.
    next: u64,
}

/// The faults of one flight and how far they have gone.
#[derive(Debug, Clone)]
pub(crate) struct FaultSchedule {
    plan: FaultPlan,
    next: usize,
    /// First step at which something sets in or ends, ramps aside.
    next_change: u64,
    ramps: Vec<Ramp>,
    bursts: Vec<Burst>,
    /// Mounted blade of each rotor: 0 nominal, otherwise 1 + `BladeSet::code`.
    pub(crate) blade_code: [i32; MAX_ROTORS],
    /// Thrust loss of each rotor, fraction.
    pub(crate) thrust_loss: [f64; MAX_ROTORS],
    /// Change of each rotor's torque-to-lift ratio, fraction.
    moment_ratio_change: [f64; MAX_ROTORS],
}

impl FaultSchedule {
    pub(crate) fn new(plan: FaultPlan) -> Self {
        Self {
            plan,
            next: 0,
            next_change: 0,
            ramps: Vec::new(),
            bursts: Vec::new(),
            blade_code: [0; MAX_ROTORS],
            thrust_loss: [0.0; MAX_ROTORS],
            moment_ratio_change: [0.0; MAX_ROTORS],
        }
    }

    /// Brings the rotors into the condition of `step`; true if any has changed.
    #[inline]
    pub(crate) fn apply(&mut self, step: u64, powertrain: &mut Powertrain) -> bool {
        if step < self.next_change && self.ramps.is_empty() {
            return false;
        }
        self.change(step, powertrain);
        true
    }

    #[cold]
    fn change(&mut self, step: u64, powertrain: &mut Powertrain) {
        while let Some(fault) = self.plan.0.get(self.next).copied().filter(|fault| fault.step <= step) {
            self.next += 1;
            let rotor = fault.rotor;
            match fault.action {
                Action::Mount { blade, code } => {
                    powertrain.change(rotor, |truth| truth.blade = blade);
                    self.blade_code[rotor] = code;
                }
                Action::Change { quantity, course } => {
                    self.ramps
                        .retain(|ramp| (ramp.rotor, ramp.quantity) != (rotor, quantity));
                    self.bursts
                        .retain(|burst| (burst.rotor, burst.quantity) != (rotor, quantity));
                    match course {
                        Course::Settle { value, ramp_steps } => {
                            // A step is a ramp of one step: it is complete when the step named in the plan is integrated.
                            let steps = ramp_steps.max(1);
                            let per_step = (value - self.level(quantity)[rotor]) / steps as f64;
                            self.ramps.push(Ramp {
                                rotor,
                                quantity,
                                per_step,
                                target: value,
                                steps_left: steps,
                            });
                        }
                        Course::Alternate { value, between, cycle } => self.bursts.push(Burst {
                            rotor,
                            quantity,
                            value,
                            between,
                            cycle,
                            acts: false,
                            next: fault.step,
                        }),
                    }
                }
            }
        }
        let mut bursts = std::mem::take(&mut self.bursts);
        for burst in bursts.iter_mut().filter(|burst| burst.next <= step) {
            burst.acts = !burst.acts;
            let Cycle { on_steps, period_steps } = burst.cycle;
            burst.next += if burst.acts { on_steps } else { period_steps - on_steps };
            let level = if burst.acts { burst.value } else { burst.between };
            self.take(burst.quantity, burst.rotor, level, powertrain);
        }
        self.bursts = bursts;
        let mut ramps = std::mem::take(&mut self.ramps);
        for ramp in &mut ramps {
            ramp.steps_left -= 1;
            let level = ramp.target - ramp.per_step * ramp.steps_left as f64;
            self.take(ramp.quantity, ramp.rotor, level, powertrain);
        }
        ramps.retain(|ramp| ramp.steps_left > 0);
        self.ramps = ramps;
        let planned = self.plan.0.get(self.next).map_or(u64::MAX, |fault| fault.step);
        self.next_change = self.bursts.iter().map(|burst| burst.next).fold(planned, u64::min);
    }

    fn level(&mut self, quantity: Quantity) -> &mut [f64; MAX_ROTORS] {
        match quantity {
            Quantity::ThrustLoss => &mut self.thrust_loss,
            Quantity::MomentRatio => &mut self.moment_ratio_change,
        }
    }

    fn take(&mut self, quantity: Quantity, rotor: usize, level: f64, powertrain: &mut Powertrain) {
        self.level(quantity)[rotor] = level;
        powertrain.change(rotor, |truth| match quantity {
            Quantity::ThrustLoss => truth.thrust_loss = level,
            Quantity::MomentRatio => truth.moment_ratio_change = level,
        });
    }

    /// Bit mask of rotors that are not healthy; bit 0 is rotor 1.
    pub(crate) fn faulty_rotors(&self) -> u32 {
        (0..MAX_ROTORS).fold(0, |mask, i| {
            let faulty = self.blade_code[i] != 0 || self.thrust_loss[i] != 0.0 || self.moment_ratio_change[i] != 0.0;
            mask | (u32::from(faulty) << i)
        })
    }
}
