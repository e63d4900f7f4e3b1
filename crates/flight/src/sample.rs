//! One step of a flight: everything that the loop hashes and its observers see.

use rotortwin_plant::TruthSample;
use rotortwin_wire::frames::{CommandFrame, FdiReport, SensorFrame};

/// Everything about one step.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Sensor values at its start.
    pub sensors: SensorFrame,
    /// The controller's command, held over the step.
    pub command: CommandFrame,
    /// The FDI engine's report.
    pub report: FdiReport,
    /// The truth at its start; neither controller nor FDI engine ever sees it.
    pub truth: TruthSample,
    /// Accelerometer, m/s², body; not part of the run hash, and absent where the flight does not record it.
    pub specific_force_m_s2: Option<[f32; 3]>,
}
