//! A list of effects at work: calls the hooks that are in use, in the order of the list, from each effect's onset.

use super::constants::Constants;
use super::declaration::Place;
use super::hooks::{ActiveEffect, Hooks, Moment};
use super::instance::{Catalogue, EffectInstance};
use super::readings::Readings;
use super::wrench::Wrench;
use super::{rotor_drag, rotor_inertia};
use crate::error::Refusal;
use crate::nearest_step;
use crate::vector::Vector3;

#[derive(Debug, Clone)]
struct Member {
    effect: Box<dyn ActiveEffect>,
    hooks: Hooks,
    onset_s: f64,
    active: bool,
    /// Id of an effect of the catalogue that acts on the values or the timing of sensors.
    of_readings: Option<&'static str>,
}

impl Member {
    /// From the start.
    fn lasting(effect: Box<dyn ActiveEffect>) -> Self {
        Self {
            hooks: effect.hooks(),
            effect,
            onset_s: f64::NEG_INFINITY,
            active: false,
            of_readings: None,
        }
    }
}

/// Effects of one flight.
#[derive(Debug, Clone)]
pub struct EffectSet {
    nominal: Constants,
    constants: Constants,
    members: Vec<Member>,
    /// Hooks of all active members.
    hooks: Hooks,
    /// The first onset that is still to come, s.
    next_onset_s: f64,
    /// The flight has not begun: nothing sets in.
    waiting: bool,
}

impl EffectSet {
    /// The effects of a document on a nominal vehicle; the key of a refusal is `effect[i]…`.
    pub fn new(
        catalogue: &Catalogue,
        instances: &[EffectInstance],
        nominal: &Constants,
        seed: u64,
    ) -> Result<Self, Refusal> {
        let mut members = Vec::with_capacity(instances.len());
        for (index, instance) in instances.iter().enumerate() {
            let effect = catalogue
                .build(instance, nominal, seed, index)
                .map_err(|refusal| refusal.under(&format!("effect[{index}]")))?;
            // From the step nearest to the onset, as with faults.
            let onset_s = instance
                .onset_s
                .map_or(f64::NEG_INFINITY, |t| (nearest_step(t) as f64 - 0.5) * crate::STEP_S);
            let declaration = catalogue.find(&instance.effect);
            let of_readings = declaration
                .filter(|d| d.places.contains(&Place::Reading) || d.places.contains(&Place::Timing))
                .map(|d| d.id);
            members.push(Member {
                onset_s,
                of_readings,
                ..Member::lasting(effect)
            });
        }
        Self::from_members(members, nominal)
    }

    /// Effects that are built already, all from the start.
    pub fn from_effects(effects: Vec<Box<dyn ActiveEffect>>, nominal: &Constants) -> Result<Self, Refusal> {
        Self::from_members(effects.into_iter().map(Member::lasting).collect(), nominal)
    }

    fn from_members(mut members: Vec<Member>, nominal: &Constants) -> Result<Self, Refusal> {
        if nominal.rotor_reaction_s != 0.0 {
            // Of the vehicle's own rotors, by its document.
            members.push(Member::lasting(rotor_inertia::of_the_document()));
        }
        if nominal.rotor_drag_kg_s != 0.0 {
            members.push(Member::lasting(rotor_drag::of_the_document(nominal.rotor_drag_kg_s)));
        }
        let mut set = Self {
            nominal: *nominal,
            constants: *nominal,
            members,
            hooks: Hooks::NONE,
            next_onset_s: f64::NEG_INFINITY,
            waiting: false,
        };
        // What holds with all of them holds with the first of them only if each step of the way does: check every prefix in time.
        let mut onsets: Vec<f64> = set.members.iter().map(|m| m.onset_s).collect();
        onsets.sort_by(f64::total_cmp);
        for onset in onsets {
            let mut trial = set.clone();
            trial.begin(onset.max(0.0) + crate::STEP_S);
            trial.constants.check()?;
        }
        set.begin(0.0);
        Ok(set)
    }

    /// To be called at the start of every step, before the other hooks: lets effects set in. Returns true where the constants
    /// may have changed.
    #[inline]
    pub fn begin(&mut self, time_s: f64) -> bool {
        let sets_in = time_s >= self.next_onset_s;
        if sets_in {
            self.next_onset_s = f64::INFINITY;
            self.hooks = Hooks::NONE;
            let now_s = if self.waiting { f64::NEG_INFINITY } else { time_s };
            for member in &mut self.members {
                member.active = now_s >= member.onset_s;
                if member.active {
                    self.hooks = self.hooks.and(member.hooks);
                } else if !self.waiting {
                    self.next_onset_s = self.next_onset_s.min(member.onset_s);
                }
            }
        }
        let changed = sets_in || self.hooks.uses(Hooks::VARYING_CONSTANTS);
        if changed {
            self.take_constants();
        }
        changed
    }

    fn take_constants(&mut self) {
        self.constants = self.nominal;
        for member in &self.members {
            if member.active {
                member.effect.constants(&mut self.constants);
            }
        }
    }

    /// From now on the same effects act on another nominal vehicle.
    pub(crate) fn set_nominal(&mut self, nominal: &Constants) {
        self.nominal = *nominal;
        self.take_constants();
    }

    /// Before a flight: from now on only effects without an onset act, until [`EffectSet::release_onsets`].
    pub fn hold_onsets(&mut self) {
        self.waiting = true;
        self.next_onset_s = f64::NEG_INFINITY;
        self.begin(0.0);
    }

    /// The flight begins: onsets count from the next step on.
    pub fn release_onsets(&mut self) {
        self.waiting = false;
        self.next_onset_s = f64::NEG_INFINITY;
    }

    /// Id of the first effect of the catalogue that acts on the values or the timing of sensors, if there is one.
    pub fn of_readings(&self) -> Option<&'static str> {
        self.members.iter().find_map(|member| member.of_readings)
    }

    /// The vehicle with the effects on its constants.
    #[inline]
    pub fn constants(&self) -> &Constants {
        &self.constants
    }

    /// The vehicle without effects.
    pub fn nominal(&self) -> &Constants {
        &self.nominal
    }

    /// Hooks of the effects that act now.
    #[inline]
    pub fn hooks(&self) -> Hooks {
        self.hooks
    }

    /// True if the constants or the hooks in use may still become others.
    pub fn may_change(&self) -> bool {
        self.next_onset_s.is_finite() || self.hooks.uses(Hooks::VARYING_CONSTANTS)
    }

    #[inline]
    fn each(&mut self, hook: Hooks, mut call: impl FnMut(&mut dyn ActiveEffect)) {
        if !self.hooks.uses(hook) {
            return;
        }
        for member in &mut self.members {
            if member.active && member.hooks.uses(hook) {
                call(&mut *member.effect);
            }
        }
    }

    /// See [`ActiveEffect::wind`].
    #[inline]
    pub fn wind(&mut self, at: &Moment<'_>, wind_ned: &mut Vector3) {
        self.each(Hooks::WIND, |effect| effect.wind(at, wind_ned));
    }

    /// See [`ActiveEffect::command`].
    #[inline]
    pub fn command(&mut self, at: &Moment<'_>, duty: &mut [f64]) {
        self.each(Hooks::COMMAND, |effect| effect.command(at, duty));
    }

    /// See [`ActiveEffect::static_lift`].
    #[inline]
    pub fn static_lift(&mut self, at: &Moment<'_>, lift: &mut [f64]) {
        self.each(Hooks::STATIC_LIFT, |effect| effect.static_lift(at, lift));
    }

    /// See [`ActiveEffect::rotor_thrust`].
    #[inline]
    pub fn rotor_thrust(&mut self, at: &Moment<'_>, thrust: &mut [f64]) {
        self.each(Hooks::ROTOR_THRUST, |effect| effect.rotor_thrust(at, thrust));
    }

    /// See [`ActiveEffect::wrench`].
    #[inline]
    pub fn wrench(&mut self, at: &Moment<'_>, wrench: &mut Wrench) {
        self.each(Hooks::WRENCH, |effect| effect.wrench(at, wrench));
    }

    /// See [`ActiveEffect::readings`].
    #[inline]
    pub fn readings(&mut self, at: &Moment<'_>, readings: &mut Readings) {
        self.each(Hooks::READINGS, |effect| effect.readings(at, readings));
    }

    /// See [`ActiveEffect::advance`].
    #[inline]
    pub fn advance(&mut self, at: &Moment<'_>, step_s: f64) {
        self.each(Hooks::ADVANCE, |effect| effect.advance(at, step_s));
    }
}
