//! Faults of a log that must be fixed before a model may be compared with it.
//!
//! An error of axes, units, order or clock looks like missing physics, and a diagnosis would name an effect for it. The
//! blocking findings are those of the import and those against the vehicle; all of them are reported in one sentence.

use rotortwin_plant::vehicle::model::VehicleModel;

use super::findings::{Finding, FindingKind};
use super::{FlightLog, RotorOrder};

impl FlightLog {
    /// Findings of this log, also against the vehicle, that must be resolved first.
    pub fn blocking_findings(&self, vehicle: &VehicleModel) -> Vec<Finding> {
        let mut found: Vec<Finding> = self.report.findings.iter().filter(|f| f.blocks()).cloned().collect();
        let stated = self.report.rotor_order == RotorOrder::Stated;
        let against = self.check_against_vehicle(vehicle).into_iter();
        for finding in against.filter(|finding| !(stated && finding.kind == FindingKind::SwappedMotors)) {
            if finding.blocks() && !found.iter().any(|f| f.kind == finding.kind) {
                found.push(finding);
            }
        }
        found
    }

    /// Why no model of this vehicle may be compared with the log: one sentence, or `None`.
    pub fn refusal_against(&self, vehicle: &VehicleModel) -> Option<String> {
        self.refusal(&self.blocking_findings(vehicle))
    }

    /// The same before a diagnosis, which names swapped motors by itself.
    pub fn refusal_before_diagnosis(&self, vehicle: &VehicleModel) -> Option<String> {
        let mut found = self.blocking_findings(vehicle);
        found.retain(|finding| finding.kind != FindingKind::SwappedMotors);
        self.refusal(&found)
    }

    /// The same for detectors: of the blocking findings, rotors in another order cause false faults, and without a
    /// flight, or with rows seconds apart, a verdict would be meaningless; the others are reported in addition.
    pub fn refusal_before_detection(&self, vehicle: &VehicleModel) -> Option<String> {
        let mut found = self.blocking_findings(vehicle);
        found.retain(|finding| {
            matches!(
                finding.kind,
                FindingKind::SwappedMotors | FindingKind::NoFlight | FindingKind::SlowRows
            )
        });
        self.refusal(&found)
    }

    fn refusal(&self, found: &[Finding]) -> Option<String> {
        if found.is_empty() {
            return None;
        }
        let list: Vec<String> = found.iter().map(ToString::to_string).collect();
        // What no mapping can mend.
        let other_vehicle = found.iter().any(|finding| finding.kind == FindingKind::RotorCount);
        let no_flight = found.iter().any(|finding| finding.kind == FindingKind::NoFlight);
        let (blame, advice) = match (other_vehicle, no_flight) {
            (_, true) => ("nothing can be compared", "expected a log of a flight"),
            (true, false) => (
                "the model is of another vehicle",
                "expected a model of this one (`rotortwin vehicle from-log` makes it from the log)",
            ),
            (false, false) => (
                "the log is at fault, not the physics",
                "fix it (a mapping for 'rotortwin log import' converts axes and units) and try again",
            ),
        };
        Some(format!("{}: {blame}: {}; {advice}", self.name, list.join("; and ")))
    }
}
