//! A term that an error may be made of: places and expressions that share one factor.

use crate::predict::channels::{F, KA, KV, M};
use rotortwin_plant::effects::{EffectDocument, ParameterEntry, TermEntry, factor_unit};

/// A term: its expression times one common factor acts at each place.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub(super) acts: Vec<(String, String)>,
}

impl Candidate {
    pub(super) fn new(acts: impl IntoIterator<Item = (impl Into<String>, impl Into<String>)>) -> Self {
        Self {
            acts: acts
                .into_iter()
                .map(|(place, what)| (place.into(), what.into()))
                .collect(),
        }
    }

    /// True for a term that shifts the mean of a channel in flight: a constant addition to the thrust, and a thrust
    /// that acts off the centre of mass or turns the vehicle.
    pub(super) fn is_level(&self) -> bool {
        let [(place, what)] = self.acts.as_slice() else {
            return false;
        };
        what == "thrust" && matches!(place.as_str(), "force_z" | "torque_x" | "torque_y" | "torque_z")
    }

    /// False for an error of a sensor in a channel of forces or torques, whose reading is what the channel measures.
    pub(super) fn acts_on(&self, channel: usize) -> bool {
        let reading = |(place, _): &(String, String)| place.starts_with("accelerometer") || place.starts_with("gyro");
        !((F..KV).contains(&channel) || (M..KA).contains(&channel)) || !self.acts.iter().any(reading)
    }

    /// `force_x: air_velocity_x`.
    pub(super) fn acts(&self) -> Vec<String> {
        self.acts
            .iter()
            .map(|(place, what)| format!("{place}: {what}"))
            .collect()
    }

    /// Unit of the factor.
    pub(super) fn unit(&self) -> String {
        let (place, what) = &self.acts[0];
        factor_unit(place, what).expect("the table holds places and expressions of variables")
    }

    /// As terms of a document with this factor.
    pub(super) fn entries(&self, factor: &str) -> Vec<TermEntry> {
        self.acts
            .iter()
            .map(|(place, what)| TermEntry {
                place: place.clone(),
                expression: format!("{factor} * ({what})"),
            })
            .collect()
    }

    /// As an effect of its own, with the factor `c`.
    pub(super) fn alone(&self) -> EffectDocument {
        let id: String = self
            .acts()
            .join("-")
            .chars()
            .map(|c| {
                if c.is_ascii_alphanumeric() {
                    c.to_ascii_lowercase()
                } else {
                    '-'
                }
            })
            .collect();
        // Ids are short; the hash keeps long ones apart.
        let hash = crate::content_hash::content_hash(id.as_bytes());
        EffectDocument {
            id: format!("term-{hash}"),
            name: self.acts().join(", "),
            excited_by: String::new(),
            confused_with: Vec::new(),
            source: String::new(),
            per_rotor: false,
            parameter: vec![ParameterEntry {
                name: "c".to_owned(),
                unit: self.unit(),
                meaning: String::new(),
                shape: false,
                low: -1e9,
                high: 1e9,
                size: Some(1.0),
                typical: 1.0,
            }],
            term: self.entries("c"),
        }
    }
}
