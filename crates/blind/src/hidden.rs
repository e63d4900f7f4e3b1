//! A hidden effect as the user or a draw states it, and the numbers that the world reads at one instant.
//!
//! [`Hidden`] is plain data: id, rotor, onset, parameters. [`Active`] is the sum of all hidden effects (and of the clutter) that are
//! in force at one time; 0 means absent everywhere.

use crate::catalogue::{self, Kind};
use crate::error::{BlindError, Result};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// Time profile of the size of an effect after its onset; without one it is constant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = HiddenProfile)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Profile {
    /// Grows linearly.
    Ramp {
        /// Duration of the ramp, s.
        ramp_s: f64,
    },
    /// Intermittent: full size for a while, again and again.
    Intermittent {
        /// Time at full size in each period, s.
        on_s: f64,
        /// Period, s.
        every_s: f64,
    },
    /// Full size, then nothing.
    Recovery {
        /// Duration, s after the onset.
        heals_after_s: f64,
    },
}

impl Profile {
    /// Share of the size at this time after the onset.
    pub fn factor(&self, since_s: f64) -> f64 {
        match *self {
            _ if since_s < 0.0 => 0.0,
            Self::Ramp { ramp_s } => (since_s / ramp_s).min(1.0),
            Self::Intermittent { on_s, every_s } => f64::from(u8::from(since_s % every_s < on_s)),
            Self::Recovery { heals_after_s } => f64::from(u8::from(since_s < heals_after_s)),
        }
    }

    /// As arguments of an effect.
    pub fn arguments(&self) -> Vec<String> {
        match *self {
            Self::Ramp { ramp_s } => vec![format!("ramp_s={ramp_s:?}")],
            Self::Intermittent { on_s, every_s } => vec![format!("on_s={on_s:?}"), format!("every_s={every_s:?}")],
            Self::Recovery { heals_after_s } => vec![format!("heals_after_s={heals_after_s:?}")],
        }
    }

    /// From the arguments of an effect: at most one profile, all of its times above 0.
    fn of(times: &BTreeMap<&str, f64>) -> Option<Option<Self>> {
        let get = |name: &str| times.get(name).copied().filter(|time| *time > 0.0);
        match times.len() {
            0 => Some(None),
            1 if times.contains_key("ramp_s") => get("ramp_s").map(|ramp_s| Some(Self::Ramp { ramp_s })),
            1 => get("heals_after_s").map(|heals_after_s| Some(Self::Recovery { heals_after_s })),
            2 => get("on_s")
                .zip(get("every_s"))
                .map(|(on_s, every_s)| Some(Self::Intermittent { on_s, every_s })),
            _ => None,
        }
    }
}

/// One hidden effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = HiddenEffect)]
pub struct Hidden {
    /// Id of the kind, as `rotortwin blind effects` lists them.
    pub id: String,
    /// Rotor, from 1, for kinds that act on one rotor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotor: Option<usize>,
    /// Start, s; absent: from the beginning.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub onset_s: Option<f64>,
    /// Time profile of its size after the start; absent: constant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<Profile>,
    /// Values of the kind's parameters; absent ones have their typical value.
    pub parameters: BTreeMap<String, f64>,
}

impl Hidden {
    /// An effect with every parameter at its typical value.
    pub fn typical(kind: &Kind, rotor: Option<usize>) -> Self {
        Self {
            id: kind.id.to_owned(),
            rotor,
            onset_s: None,
            profile: None,
            parameters: kind.parameters.iter().map(|p| (p.name.to_owned(), p.typical)).collect(),
        }
    }

    /// Reads `id:parameter=value,parameter=value`, with `rotor=` (from 1), `onset_s=` and the times of a [`Profile`] among the parameters.
    pub fn parse(text: &str) -> Result<Self> {
        let place = || format!("--effect {text}");
        let (id, rest) = text.split_once(':').unwrap_or((text, ""));
        let kind = catalogue::kind(id).ok_or_else(|| {
            let known: Vec<&str> = catalogue::KINDS.iter().map(|kind| kind.id).collect();
            BlindError::input(
                place(),
                format!("unknown effect `{id}`; expected one of {}", known.join(", ")),
            )
        })?;
        let mut effect = Self::typical(kind, None);
        let mut times = BTreeMap::new();
        for pair in rest.split(',').filter(|pair| !pair.is_empty()) {
            let (name, value) = pair
                .split_once('=')
                .ok_or_else(|| BlindError::input(place(), format!("expected parameter=value, got `{pair}`")))?;
            let value: f64 =
                value.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
                    BlindError::input(place(), format!("expected a number for `{name}`, got `{value}`"))
                })?;
            match name {
                "rotor" if kind.per_rotor && value.fract() == 0.0 && value >= 1.0 => {
                    effect.rotor = Some(value as usize)
                }
                "onset_s" => effect.onset_s = Some(value),
                "ramp_s" | "on_s" | "every_s" | "heals_after_s" => {
                    times.insert(name, value);
                }
                _ if effect.parameters.contains_key(name) => {
                    effect.parameters.insert(name.to_owned(), value);
                }
                _ => {
                    let known: Vec<&str> = kind.parameters.iter().map(|p| p.name).collect();
                    let rotor = if kind.per_rotor { ", rotor (from 1)" } else { "" };
                    let reason = format!(
                        "`{id}` has no parameter `{name}`; expected {}{rotor}, onset_s",
                        known.join(", ")
                    );
                    return Err(BlindError::input(place(), reason));
                }
            }
        }
        effect.profile = Profile::of(&times).ok_or_else(|| {
            let reason = "expected ramp_s, or heals_after_s, or on_s with every_s, above 0";
            BlindError::input(place(), reason)
        })?;
        if kind.per_rotor && effect.rotor.is_none() {
            return Err(BlindError::input(
                place(),
                format!("`{id}` acts on one rotor: expected rotor=1, 2, …"),
            ));
        }
        Ok(effect)
    }

    /// Checks id, rotor and parameter names against the catalogue and a rotor count.
    pub fn check(&self, rotors: usize) -> Result<()> {
        let kind = catalogue::kind(&self.id)
            .ok_or_else(|| BlindError::input("effect", format!("there is no effect `{}`", self.id)))?;
        if kind.per_rotor && !self.rotor.is_some_and(|rotor| (1..=rotors).contains(&rotor)) {
            let reason = format!("expected a rotor from 1 to {rotors}, got {:?}", self.rotor);
            return Err(BlindError::input(format!("effect {}", self.id), reason));
        }
        Ok(())
    }

    /// Whether the effect is in force at a time.
    pub fn active_at(&self, time: f64) -> bool {
        self.onset_s.is_none_or(|onset| time >= onset)
    }

    /// Share of its size at a time.
    pub fn factor_at(&self, time: f64) -> f64 {
        let since = time - self.onset_s.unwrap_or(0.0);
        match &self.profile {
            Some(profile) => profile.factor(since),
            None => f64::from(u8::from(self.active_at(time))),
        }
    }
}

/// Everything that differs from the nominal vehicle at one time. Units as in the catalogue.
#[derive(Debug, Clone, Default)]
#[expect(missing_docs, reason = "each field is the parameter of the catalogue with its name")]
pub struct Active {
    pub rotor_drag: f64,
    pub parasitic_drag: f64,
    pub linear_drag: f64,
    pub drag_share: f64,
    pub wind: Vector3<f64>,
    pub gust_sigma: f64,
    pub gust_correlation: f64,
    pub translational_lift: f64,
    pub axial_inflow: f64,
    pub vortex_ring: f64,
    pub ground_effect: f64,
    pub ceiling_effect: f64,
    pub ceiling_height: f64,
    pub wall: f64,
    pub wall_distance: f64,
    pub wall_azimuth: f64,
    pub interference: f64,
    pub flapping: f64,
    pub drag_height: f64,
    pub rotational_damping: f64,
    pub yaw_damping: f64,
    pub arm_share: f64,
    pub thrust_scale_all: f64,
    pub mass: f64,
    pub mass_rate: f64,
    pub slung_mass: f64,
    pub slung_length: f64,
    pub slung_damping: f64,
    pub slung_weight: f64,
    pub centre: Vector3<f64>,
    pub inertia: Vector3<f64>,
    /// J_xy, J_xz, J_yz.
    pub products: Vector3<f64>,
    pub tilt_tangential: Vec<f64>,
    pub tilt_radial: Vec<f64>,
    pub flex_share: f64,
    pub flex_frequency: f64,
    pub flex_damping: f64,
    pub thrust_scale: Vec<f64>,
    pub rotor_moment_ratio: Vec<f64>,
    pub lag: f64,
    pub lag_asymmetry: f64,
    pub speed_lag: f64,
    pub delay: f64,
    pub dead_zone: f64,
    /// Largest duty; 0: no limit.
    pub saturation: f64,
    pub esc_resistance: f64,
    pub curve_shape: f64,
    pub voltage_exponent: f64,
    pub gyroscopic: f64,
    pub reaction: f64,
    pub moment_ratio: f64,
    pub internal_resistance: f64,
    pub pair_resistance: f64,
    pub pair_time: f64,
    pub capacity: f64,
    pub cold_below: f64,
    pub cold_warming: f64,
    pub voltage_gain: f64,
    pub voltage_offset: f64,
    pub accel_bias: Vector3<f64>,
    pub accel_scale: f64,
    pub gyro_bias: Vector3<f64>,
    pub gyro_scale: f64,
    pub misalignment: Vector3<f64>,
    pub lever_arm: Vector3<f64>,
    pub imu_latency: f64,
    pub attitude_latency: f64,
    pub velocity_latency: f64,
    pub position_latency: f64,
    pub heading_offset: f64,
    /// Forward and right, at the current of hover.
    pub current_field: [f64; 2],
    /// Roll and pitch.
    pub level_offset: [f64; 2],
    pub vibration: f64,
    /// Rotors from 0 whose duty columns are swapped.
    pub swapped: Option<(usize, usize)>,
    pub reversed: Vec<f64>,
    pub stuck_moment: f64,
    pub backlash: f64,
    pub imbalance: f64,
    pub imbalance_frequency: f64,
    pub fade: f64,
    pub fade_time: f64,
    pub threshold_drag: f64,
    pub threshold_speed: f64,
    pub slosh_mass: f64,
    pub slosh_frequency: f64,
    pub slosh_damping: f64,
    pub tether: f64,
    pub tether_slack: f64,
    /// Rotor from 0, loss, mean interval in s.
    pub dropouts: Option<(usize, f64, f64)>,
}

impl Active {
    /// Nothing hidden, for this number of rotors.
    pub fn none(rotors: usize) -> Self {
        Self {
            tilt_tangential: vec![0.0; rotors],
            tilt_radial: vec![0.0; rotors],
            thrust_scale: vec![0.0; rotors],
            rotor_moment_ratio: vec![0.0; rotors],
            reversed: vec![0.0; rotors],
            ..Self::default()
        }
    }

    /// The sum of the effects in force at a time.
    pub fn at(time: f64, effects: &[Hidden], rotors: usize) -> Self {
        let mut active = Self::none(rotors);
        for effect in effects.iter().filter(|effect| effect.active_at(time)) {
            active.add_share(effect, effect.factor_at(time));
        }
        active
    }

    /// Adds one effect; amplitudes add up, shape parameters are replaced.
    pub fn add(&mut self, effect: &Hidden) {
        self.add_share(effect, 1.0);
    }

    /// Adds a share of the size of one effect.
    pub fn add_share(&mut self, effect: &Hidden, share: f64) {
        let kind = catalogue::kind(&effect.id);
        let value = |name: &str| {
            let typical = || {
                kind.and_then(|kind| kind.parameters.iter().find(|p| p.name == name))
                    .map_or(0.0, |p| p.typical)
            };
            let scales = kind.is_some_and(|kind| kind.parameters.iter().any(|p| p.name == name && p.scales));
            effect.parameters.get(name).copied().unwrap_or_else(typical) * if scales { share } else { 1.0 }
        };
        let rotor = effect.rotor.unwrap_or(1) - 1;
        match effect.id.as_str() {
            "rotor-drag" => self.rotor_drag += value("drag_n_s_m"),
            "quadratic-drag" => self.parasitic_drag += value("drag_kg_m"),
            "linear-friction" => self.linear_drag += value("drag_kg_s"),
            "drag-anisotropy" => self.drag_share += value("share"),
            "wind" => self.wind += Vector3::new(value("north_m_s"), value("east_m_s"), 0.0),
            "gusts" => {
                self.gust_sigma += value("rms_m_s");
                self.gust_correlation = value("correlation_s");
            }
            "translational-lift" => self.translational_lift += value("lift_n_s2_m2"),
            "axial-inflow" => self.axial_inflow += value("loss_n_s_m"),
            "vortex-ring" => self.vortex_ring += value("loss"),
            "ground-effect" => self.ground_effect += value("strength"),
            "ceiling-effect" => {
                self.ceiling_effect += value("strength");
                self.ceiling_height = value("height_m");
            }
            "wall-effect" => {
                self.wall += value("strength");
                self.wall_distance = value("distance_m");
                self.wall_azimuth = value("azimuth_rad");
            }
            "rotor-interference" => self.interference += value("loss_s_m"),
            "flapping-moment" => self.flapping += value("moment_n_s"),
            "drag-centre" => self.drag_height += value("height_m"),
            "rotational-damping" => self.rotational_damping += value("damping_n_m_s"),
            "yaw-damping" => self.yaw_damping += value("damping_n_m_s"),
            "arm-length" => self.arm_share += value("share"),
            "air-density" => self.thrust_scale_all += value("share"),
            "mass" => self.mass += value("share"),
            "mass-loss" => self.mass_rate += value("rate_kg_s"),
            "slung-load" => {
                self.slung_mass += value("mass_kg");
                self.slung_length = value("length_m");
                self.slung_damping = value("damping_1_s");
                self.slung_weight += value("weight_kg");
            }
            "centre-of-mass" => self.centre += Vector3::new(value("forward_m"), value("right_m"), 0.0),
            "inertia-roll" => self.inertia.x += value("share"),
            "inertia-pitch" => self.inertia.y += value("share"),
            "inertia-yaw" => self.inertia.z += value("share"),
            "inertia-product-xy" => self.products.x += value("value_kg_m2"),
            "inertia-product-xz" => self.products.y += value("value_kg_m2"),
            "inertia-product-yz" => self.products.z += value("value_kg_m2"),
            "rotor-tilt-tangential" => self.tilt_tangential[rotor] += value("angle_rad"),
            "rotor-tilt-radial" => self.tilt_radial[rotor] += value("angle_rad"),
            "frame-flex" => {
                self.flex_share += value("share");
                self.flex_frequency = value("frequency_hz");
                self.flex_damping = value("damping");
            }
            "rotor-thrust-scale" => self.thrust_scale[rotor] += value("share"),
            "motor-time-constant" => self.lag += value("share"),
            "lag-asymmetry" => self.lag_asymmetry += value("share"),
            "speed-domain-lag" => self.speed_lag = value("share"),
            "command-delay" => self.delay += value("delay_s"),
            "dead-zone" => self.dead_zone += value("duty"),
            "saturation" => self.saturation = 1.0 - value("lost_duty"),
            "esc-resistance" => self.esc_resistance += value("resistance_ohm"),
            "thrust-curve-shape" => self.curve_shape += value("share"),
            "voltage-exponent" => self.voltage_exponent += value("exponent"),
            "gyroscopic-torque" => self.gyroscopic += value("inertia_kg_m2"),
            "rotor-reaction" => self.reaction += value("inertia_kg_m2"),
            "moment-ratio" => self.moment_ratio += value("share"),
            "rotor-moment-ratio" => self.rotor_moment_ratio[rotor] += value("share"),
            "internal-resistance" => self.internal_resistance += value("added_ohm"),
            "battery-rc" => {
                self.pair_resistance += value("resistance_ohm");
                self.pair_time = value("time_s");
            }
            "battery-capacity" => self.capacity += value("share"),
            "cold-battery" => {
                self.cold_below += value("below_25_k");
                self.cold_warming = value("warming_s");
            }
            "voltage-gain" => self.voltage_gain += value("share"),
            "voltage-offset" => self.voltage_offset += value("offset_v"),
            "accelerometer-bias" => self.accel_bias += Vector3::new(value("x_m_s2"), value("y_m_s2"), value("z_m_s2")),
            "accelerometer-scale" => self.accel_scale += value("share"),
            "gyro-bias" => self.gyro_bias += Vector3::new(value("x_rad_s"), value("y_rad_s"), value("z_rad_s")),
            "gyro-scale" => self.gyro_scale += value("share"),
            "imu-misalignment" => self.misalignment += Vector3::new(value("x_rad"), value("y_rad"), value("z_rad")),
            "imu-lever-arm" => self.lever_arm += Vector3::new(value("x_m"), value("y_m"), value("z_m")),
            "imu-latency" => self.imu_latency += value("delay_s"),
            "attitude-latency" => self.attitude_latency += value("delay_s"),
            "velocity-latency" => self.velocity_latency += value("delay_s"),
            "position-latency" => self.position_latency += value("delay_s"),
            "heading-offset" => self.heading_offset += value("offset_rad"),
            "current-heading" => {
                self.current_field[0] += value("forward_share");
                self.current_field[1] += value("right_share");
            }
            "level-offset" => {
                self.level_offset[0] += value("roll_rad");
                self.level_offset[1] += value("pitch_rad");
            }
            "vibration-rectification" => self.vibration += value("hover_bias_m_s2"),
            "swapped-rotors" => self.swapped = Some((rotor, (value("partner") as usize).max(1) - 1)),
            "reversed-spin" => self.reversed[rotor] += value("share"),
            "stuck-moment" => self.stuck_moment += value("moment_nm"),
            "thrust-backlash" => self.backlash += value("width"),
            "rotating-imbalance" => {
                self.imbalance += value("force_n");
                self.imbalance_frequency = value("frequency_hz");
            }
            "thrust-fade" => {
                self.fade += value("loss");
                self.fade_time = value("time_s");
            }
            "threshold-drag" => {
                self.threshold_drag += value("drag_n_s3_m3");
                self.threshold_speed = value("threshold_m_s");
            }
            "sloshing-tank" => {
                self.slosh_mass += value("mass_kg");
                self.slosh_frequency = value("frequency_hz");
                self.slosh_damping = value("damping");
            }
            "tether" => {
                self.tether += value("stiffness_n_m");
                self.tether_slack = value("slack_m");
            }
            "rotor-dropouts" => self.dropouts = Some((rotor, value("loss"), value("interval_s"))),
            // Ids were checked where they entered; the test below walks the whole catalogue through here.
            other => unreachable!("effect `{other}` is in the catalogue and not in Active::add"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_every_kind_of_the_catalogue_changes_something() {
        let nothing = format!("{:?}", Active::none(6));
        for kind in catalogue::KINDS {
            let mut active = Active::none(6);
            active.add(&Hidden::typical(kind, kind.per_rotor.then_some(2)));
            assert_ne!(format!("{active:?}"), nothing, "{}", kind.id);
        }
    }

    #[test]
    fn val_a_profile_shapes_the_size_and_reads_back() {
        let text = "rotor-thrust-scale:rotor=3,share=-0.1,onset_s=10";
        for (more, at) in [
            ("", [(9.9, 0.0), (10.0, -0.1), (80.0, -0.1)]),
            (",ramp_s=20", [(9.9, 0.0), (15.0, -0.025), (40.0, -0.1)]),
            (",on_s=0.5,every_s=2", [(10.4, -0.1), (11.0, 0.0), (12.1, -0.1)]),
            (",heals_after_s=15", [(10.0, -0.1), (24.9, -0.1), (25.0, 0.0)]),
        ] {
            let effect = Hidden::parse(&format!("{text}{more}")).unwrap();
            for (time, share) in at {
                let active = Active::at(time, std::slice::from_ref(&effect), 6);
                assert!((active.thrust_scale[2] - share).abs() < 1e-12, "{more} at {time} s");
            }
            let mut again = vec![text.to_owned()];
            again.extend(effect.profile.iter().flat_map(Profile::arguments));
            assert_eq!(Hidden::parse(&again.join(",")).unwrap(), effect, "{more}");
        }
        let refused = Hidden::parse(&format!("{text},on_s=1")).unwrap_err().to_string();
        assert!(refused.contains("on_s with every_s"), "{refused}");
    }

    #[test]
    fn scenario_an_effect_is_read_or_refused_in_a_sentence() {
        let effect = Hidden::parse("rotor-thrust-scale:rotor=3,share=-0.05,onset_s=45").unwrap();
        assert_eq!((effect.rotor, effect.onset_s), (Some(3), Some(45.0)));
        for (text, part) in [
            ("rotor-drga", "unknown effect `rotor-drga`"),
            ("rotor-thrust-scale:share=1", "acts on one rotor"),
            ("rotor-drag:mass=1", "has no parameter `mass`"),
            ("rotor-drag:drag_n_s_m=x", "expected a number"),
            ("rotor-drag:rotor=1", "has no parameter `rotor`"),
        ] {
            let sentence = Hidden::parse(text).unwrap_err().to_string();
            assert!(sentence.contains(part), "{sentence}");
        }
    }
}
