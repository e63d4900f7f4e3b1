//! Everything about one step of a flight: what the loop hashes and its observers see.

use rotortwin_plant::TruthSample;
use rotortwin_wire::frames::{CommandFrame, FdiReport, SensorFrame};

/// Everything about one step.
#[derive(Clone, Debug)]
pub struct Sample {
    /// What was sensed at its start.
    pub sensors: SensorFrame,
    /// What the controller answered; held over the step.
    pub command: CommandFrame,
    /// What the FDI engine answered.
    pub report: FdiReport,
    /// The truth at its start; neither controller nor FDI engine ever sees it.
    pub truth: TruthSample,
    /// Accelerometer, m/s², body; not part of the run hash, and absent where the flight does not record it.
    pub specific_force_m_s2: Option<[f32; 3]>,
}
