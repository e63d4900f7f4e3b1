//! Windows of a campaign's flights as rows for training: the network's inputs, and the truth.
//!
//! ```text
//!  plan ─▶ scenario and seed of flight i ─▶ paper::windows ─▶ one row a window ─▶ Parquet, one row group for every few flights
//! ```
//! Columns: `flight` (from 0), `seed`, `time_s` (end of the window), `ready` (0 until the calibration has ended; a
//! network that calibrates itself has no verdict there), `label` (0 healthy, i rotor i, the median over the window) and
//! the 3 n_a window means `residual_1_arm_nms`, `residual_1_lever_nms`, `residual_1_yaw_nms`, …, N·m·s. Bit-identical
//! to those that `rotortwin train` computes from the same scenario and seed.
//!
//! Limits: our PID controller flies, whatever controller a run would have. Flights that end before their calibration, crash, or have several faulty rotors at a time are left out.

use super::plan::Campaign;
use crate::paper::windows::{self, Collect};
use crate::parallel::map_in_order;
use crate::table_file::{TableFile, TableFileWriter, Values};
use rotortwin_flight_core::fdi::FaultVerdict;
use rotortwin_plant::STEP_S;
use rotortwin_scenario::settings::NominalThrustModel;
use std::num::NonZeroUsize;
use std::path::Path;

/// Flights of a row group.
const GROUP: u64 = 32;

/// The request.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Rotor model of the residual generators.
    pub model: NominalThrustModel,
    /// Subtract the mean over the calibration, as networks that calibrate themselves have it.
    pub self_calibrated: bool,
    /// Maximum number of flights.
    pub limit: Option<u64>,
    /// Threads.
    pub threads: NonZeroUsize,
}

/// What was written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// Flights in the file.
    pub flights: u64,
    /// Rows.
    pub windows: u64,
    /// Flights that were left out, and why.
    pub left_out: Vec<(u64, String)>,
}

impl Wanted {
    /// Flights to fly.
    pub fn flights(&self, campaign: &Campaign) -> u64 {
        self.limit
            .map_or(campaign.flights(), |limit| limit.min(campaign.flights()))
    }
}

/// Flies a campaign and writes its windows; `done` is called from any thread after each flight.
///
/// # Errors
/// One sentence: no flight can be used, or the file cannot be written.
pub fn write(campaign: &Campaign, wanted: &Wanted, path: &Path, done: &(dyn Fn() + Sync)) -> Result<Written, String> {
    let mut written = Written::default();
    let mut writer: Option<TableFileWriter> = None;
    let flights = wanted.flights(campaign);
    for first in (0..flights).step_by(GROUP as usize) {
        let group: Vec<u64> = (first..flights.min(first + GROUP)).collect();
        let flown = map_in_order(
            wanted.threads,
            &group,
            |flight| rows_of(campaign, wanted, *flight),
            done,
        );
        let mut rows = Rows::new(campaign.rotor_count());
        for (flight, result) in group.into_iter().zip(flown) {
            match result {
                Ok(own) => {
                    rows.add(own);
                    written.flights += 1;
                }
                Err(why) => written.left_out.push((flight, why)),
            }
        }
        if rows.label.is_empty() {
            continue;
        }
        written.windows += rows.label.len() as u64;
        let table = rows.table();
        let writer = match &mut writer {
            Some(writer) => writer,
            None => writer.insert(TableFileWriter::create(path, &table).map_err(|error| error.to_string())?),
        };
        writer.push(&table).map_err(|error| error.to_string())?;
    }
    let Some(writer) = writer else {
        let why = written.left_out.first().map_or("it has none", |(_, why)| why.as_str());
        return Err(format!("no flight of the campaign can be used: {why}"));
    };
    writer.finish().map_err(|error| error.to_string())?;
    Ok(written)
}

/// Columns of several flights.
struct Rows {
    flight: Vec<i64>,
    seed: Vec<i64>,
    time_s: Vec<f64>,
    ready: Vec<i64>,
    label: Vec<i64>,
    /// One for each residual.
    features: Vec<Vec<f32>>,
}

impl Rows {
    fn new(rotor_count: usize) -> Self {
        Self {
            flight: Vec::new(),
            seed: Vec::new(),
            time_s: Vec::new(),
            ready: Vec::new(),
            label: Vec::new(),
            features: vec![Vec::new(); 3 * rotor_count],
        }
    }

    fn add(&mut self, other: Self) {
        self.flight.extend(other.flight);
        self.seed.extend(other.seed);
        self.time_s.extend(other.time_s);
        self.ready.extend(other.ready);
        self.label.extend(other.label);
        for (own, other) in self.features.iter_mut().zip(other.features) {
            own.extend(other);
        }
    }

    fn table(self) -> TableFile {
        let mut table = TableFile::default();
        table
            .column("flight", Values::Integer(self.flight))
            .column("seed", Values::Integer(self.seed))
            .column("time_s", Values::Double(self.time_s))
            .column("ready", Values::Integer(self.ready))
            .column("label", Values::Integer(self.label));
        for (place, values) in self.features.into_iter().enumerate() {
            let axis = ["arm", "lever", "yaw"][place % 3];
            table.column(
                &format!("residual_{}_{axis}_nms", place / 3 + 1),
                Values::Single(values),
            );
        }
        table
    }
}

/// The windows of one flight.
fn rows_of(campaign: &Campaign, wanted: &Wanted, flight: u64) -> Result<Rows, String> {
    let planned = campaign.flight(flight).map_err(|error| error.to_string())?;
    let scenario = campaign.scenario(&planned).map_err(|error| error.to_string())?;
    let settings = &scenario.document().fdi;
    let collect = Collect {
        models: vec![wanted.model],
        calibration_s: [settings.calibration_start_s, settings.calibration_end_s],
        attitude_errors: false,
    };
    let flown = windows::fly(&scenario, planned.seed, &collect)?;
    let of_model = flown.of(wanted.model);
    let geometry = scenario.fdi_config().geometry;
    let rotor_count = geometry.rotor_count();
    let mut rows = Rows::new(rotor_count);
    for (i, label) in flown.labels.iter().enumerate() {
        rows.flight.push(flight as i64);
        rows.seed.push(planned.seed as i64);
        rows.time_s.push((i + 1) as f64 * flown.window_len as f64 * STEP_S);
        rows.ready.push(i64::from(of_model.t_test[i] != FaultVerdict::NotReady));
        rows.label.push(i64::from(*label));
        let input = of_model.network_input(&geometry, i, wanted.self_calibrated);
        let values = input.component[..rotor_count].as_flattened();
        for (column, value) in rows.features.iter_mut().zip(values) {
            column.push(*value);
        }
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_store::query::TelemetryFile;

    const CAMPAIGN: &str = "name = \"windows\"\ndescription = \"a test\"\nscenario = \"SCENARIOS/hover.toml\"\nseed = 3\nrepeats = 3\nset.duration_s = 14.0\n\
                            set.fault = [{ time_s = 12.0, rotor = 2, thrust_loss_percent = 8.0 }]\n";

    /// Rows are those of the flight itself, window by window, for any number of threads.
    #[test]
    fn val_rows_are_the_windows_of_the_flights() {
        let folder = tempfile::tempdir().expect("a folder");
        let scenarios = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/scenarios");
        let text = CAMPAIGN.replace("SCENARIOS", scenarios);
        let campaign = Campaign::parse(&text, &folder.path().join("c.toml")).expect("a good campaign");
        let path = folder.path().join("windows.parquet");
        let wanted = |threads| Wanted {
            model: NominalThrustModel::Lagged,
            self_calibrated: true,
            limit: Some(2),
            threads: NonZeroUsize::new(threads).expect("not 0"),
        };
        let written = write(&campaign, &wanted(2), &path, &|| ()).expect("flown");
        // 14 s are 224 windows of 62.5 ms.
        assert_eq!((written.flights, written.windows, written.left_out.len()), (2, 448, 0));
        let two = std::fs::read(&path).expect("there");
        write(&campaign, &wanted(1), &path, &|| ()).expect("flown");
        assert_eq!(std::fs::read(&path).expect("there"), two);

        let file = TelemetryFile::open(&path).expect("Parquet");
        assert_eq!(file.rows(), 448);
        let mut labels = Vec::new();
        let mut arms = Vec::new();
        file.for_each_block(
            &["label", "residual_2_arm_nms"],
            |block| -> Result<(), rotortwin_store::StoreError> {
                labels.extend_from_slice(&block[0]);
                arms.extend_from_slice(&block[1]);
                Ok(())
            },
        )
        .expect("read");
        // The fault sets in with window 192 of each flight.
        for flight in 0..2 {
            let own = &labels[224 * flight..][..224];
            assert!(own[..192].iter().all(|label| *label == 0.0) && own[192..].iter().all(|label| *label == 2.0));
        }
        let planned = campaign.flight(1).expect("planned");
        let scenario = campaign.scenario(&planned).expect("good");
        let collect = Collect {
            models: vec![NominalThrustModel::Lagged],
            calibration_s: [2.0, 10.0],
            attitude_errors: false,
        };
        let flown = windows::fly(&scenario, planned.seed, &collect).expect("flown");
        let geometry = scenario.fdi_config().geometry;
        for (i, arm) in arms[224..].iter().enumerate() {
            let input = flown.of(NominalThrustModel::Lagged).network_input(&geometry, i, true);
            assert_eq!(f64::from(input.component[1][0]), *arm, "window {i}");
        }
    }
}
