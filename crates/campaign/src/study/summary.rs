//! `summary.json` of a campaign: its totals as written to file and documented in the API.

use super::document::Criteria;
use super::folder::program;
use super::intervals::{ClusterSums, poisson_rate, wilson};
use super::plan::Campaign;
use super::record::DETECTORS;
use super::score::severity_name;
use super::totals::{AxisTotals, Delays, DetectorTotals, GroupTotals, LossError, Totals};
use serde::Serialize;
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// Totals of a campaign, without wall-clock times, so that the same flights give the same bytes.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct CampaignSummary {
    /// Its name.
    campaign: String,
    /// Program and version.
    program: String,
    /// Seed of the campaign; those of the flights are drawn from it.
    seed: u64,
    /// Number of flights of the whole campaign.
    planned_flights: u64,
    /// True if no flight is missing.
    complete: bool,
    /// Number of flights present.
    flights: u64,
    /// Flown to their end.
    done: u64,
    /// Lost, or ended by an error.
    failed: u64,
    /// Rejected because their documents are invalid.
    refused: u64,
    /// Number of steps of 2.5 ms.
    steps: u64,
    /// Simulated time, h.
    flown_h: f64,
    /// XXH3-128 over the records of all flights in order.
    hash: String,
    /// Limits for isolation in time and for a lost flight.
    criteria: Criteria,
    /// By name of the detector.
    // Those of the user's own begin with `own_`.
    detectors: BTreeMap<String, DetectorSummary>,
    /// The sequential detector at other evidence thresholds.
    operating_curve: Vec<OperatingPoint>,
    /// By axis and value. An axis with too many distinct values is left out.
    axes: Vec<AxisSummary>,
    /// Estimated minus true loss of thrust at the end, where the correct rotor is named.
    thrust_loss_error: Option<LossErrorSummary>,
    /// The same of further detectors that give sizes, by name as in `detectors`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    own_thrust_loss_errors: BTreeMap<String, LossErrorSummary>,
}

/// One detector over a set of flights.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct BriefSummary {
    /// Windows of flights in which the detector was ready.
    windows: u64,
    /// Fraction of these that are correct.
    right: Option<f64>,
    /// Its 95 % interval over flights.
    right_95: Option<[f64; 2]>,
    /// False alarms; consecutive windows count once.
    false_alarm_events: u64,
    /// Time without a fault, h.
    healthy_h: f64,
    /// Flights with a fault.
    fault_flights: u64,
    /// Delay from the onset to the first correct verdict.
    isolated: DelaySummary,
    /// Flights isolated within `criteria.isolate_within_s`.
    isolated_in_time: u64,
}

/// A detector over all flights.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct DetectorSummary {
    #[serde(flatten)]
    brief: BriefSummary,
    /// Fraction of correct windows among those without a fault.
    healthy_right: Option<f64>,
    /// Fraction of correct windows among those with a fault.
    faulty_right: Option<f64>,
    /// Windows with a fault and the verdict healthy.
    missed: u64,
    /// Windows naming a healthy rotor.
    wrong_rotor: u64,
    /// Flights with any verdict after the onset that named a healthy rotor.
    wrong_rotor_flights: u64,
    /// Windows neither correct nor missed, naming no healthy rotor.
    unclear: u64,
    /// Per hour without a fault.
    false_alarms_per_h: Option<f64>,
    /// Its 95 % interval (Poisson).
    false_alarms_per_h_95: Option<[f64; 2]>,
    /// Flights with a false alarm.
    false_alarm_flights: u64,
    /// Delay from the onset to the first verdict other than healthy.
    detected: DelaySummary,
    /// Delay from the onset to the first of the correct verdicts that last to the end.
    settled: DelaySummary,
    /// 95 % interval of the fraction isolated in time (Wilson).
    isolated_in_time_95: Option<[f64; 2]>,
    /// Rows of truth, verdict, windows; codes as in `verdict` of the telemetry.
    confusion_truth_verdict_windows: Vec<[i64; 3]>,
    /// Windows with a fault by the loss of thrust.
    windows_by_severity: Vec<SeverityWindows>,
    /// Flights with a fault by the loss of thrust.
    onsets_by_severity: Vec<SeverityOnsets>,
}

/// The sequential detector at one evidence threshold.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct OperatingPoint {
    #[serde(flatten)]
    detector: DetectorSummary,
    /// Evidence threshold, nats.
    evidence_nats: f32,
}

/// Delays after onsets; nearest-rank quantiles.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct DelaySummary {
    /// Flights in which the event occurred.
    flights: u64,
    /// s.
    median_s: Option<f64>,
    /// s.
    p95_s: Option<f64>,
    /// s.
    worst_s: Option<f64>,
}

/// Windows with a fault of some size.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct SeverityWindows {
    /// Range of the loss of thrust.
    loss: String,
    /// How many.
    windows: u64,
    /// Fraction of these that are correct.
    right: Option<f64>,
    /// Its 95 % interval over flights.
    right_95: Option<[f64; 2]>,
}

/// Flights with a fault of some size.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct SeverityOnsets {
    /// Range of the loss of thrust.
    loss: String,
    /// How many.
    flights: u64,
    /// Of these, isolated in time.
    in_time: u64,
    /// Delay from the onset to the first correct verdict.
    isolated: DelaySummary,
}

/// Flights grouped by the values of one axis.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct AxisSummary {
    /// Its name.
    axis: String,
    /// One entry per value.
    groups: Vec<AxisValueSummary>,
}

/// Flights with one value of an axis.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct AxisValueSummary {
    /// The value, or a range of values.
    value: String,
    /// How many.
    flights: u64,
    /// Of these, not flown to their end.
    failed: u64,
    /// By name of the detector.
    detectors: BTreeMap<String, BriefSummary>,
}

/// How well the loss of thrust is estimated.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct LossErrorSummary {
    /// Flights that named the correct rotor at their end.
    flights: u64,
    /// Mean error, N.
    mean_n: f64,
    /// Root of the mean squared error, N.
    rms_n: f64,
    /// Flights whose 95 % interval contains the truth.
    interval_holds_truth: u64,
}

impl CampaignSummary {
    /// Summary of the existing flights.
    pub fn new(campaign: &Campaign, totals: &Totals) -> Self {
        let criteria = campaign.document().criteria;
        Self {
            campaign: campaign.document().name.clone(),
            program: program(),
            seed: campaign.document().seed,
            planned_flights: campaign.flights(),
            complete: totals.flights == campaign.flights(),
            flights: totals.flights,
            done: totals.done,
            failed: totals.failed,
            refused: totals.refused,
            steps: totals.steps,
            flown_h: totals.flown_h(),
            hash: totals.hash(),
            criteria,
            detectors: by_name(&totals.detectors, |detector| DetectorSummary::new(detector, criteria))
                .into_iter()
                .chain(
                    totals
                        .own
                        .iter()
                        .map(|own| (own.column.clone(), DetectorSummary::new(&own.totals, criteria))),
                )
                .collect(),
            operating_curve: totals
                .curve
                .iter()
                .map(|(level, detector)| OperatingPoint {
                    detector: DetectorSummary::new(detector, criteria),
                    evidence_nats: *level,
                })
                .collect(),
            axes: totals
                .axes
                .iter()
                .filter(|axis| !axis.overflown)
                .map(|axis| AxisSummary::new(axis, totals, criteria))
                .collect(),
            thrust_loss_error: LossErrorSummary::new(&totals.loss_error),
            own_thrust_loss_errors: totals
                .own
                .iter()
                .filter_map(|own| Some((own.column.clone(), LossErrorSummary::new(&own.loss_error)?)))
                .collect(),
        }
    }

    /// As printed.
    pub fn json(&self) -> String {
        let value = serde_json::to_value(self).expect("text and numbers are JSON");
        format!("{value:#}")
    }
}

fn by_name<T>(detectors: &[DetectorTotals], of: impl Fn(&DetectorTotals) -> T) -> BTreeMap<String, T> {
    let names = DETECTORS.iter().map(|name| (*name).to_owned());
    names.zip(detectors.iter().map(of)).collect()
}

impl BriefSummary {
    fn new(detector: &DetectorTotals, criteria: Criteria) -> Self {
        Self {
            windows: detector.windows.total(),
            right: detector.windows.share(),
            right_95: detector.windows.interval(),
            false_alarm_events: detector.false_alarm_events,
            healthy_h: detector.healthy_h(),
            fault_flights: detector.fault_flights,
            isolated: DelaySummary::new(&detector.isolated),
            isolated_in_time: detector.isolated.within(criteria.isolate_within_s),
        }
    }
}

impl DetectorSummary {
    fn new(detector: &DetectorTotals, criteria: Criteria) -> Self {
        let brief = BriefSummary::new(detector, criteria);
        Self {
            healthy_right: detector.healthy.share(),
            faulty_right: detector.faulty.share(),
            missed: detector.missed,
            wrong_rotor: detector.wrong_rotor,
            wrong_rotor_flights: detector.wrong_rotor_flights,
            unclear: detector.unclear,
            false_alarms_per_h: detector.false_alarms_per_h(),
            false_alarms_per_h_95: poisson_rate(detector.false_alarm_events, detector.healthy_h()),
            false_alarm_flights: detector.false_alarm_flights,
            detected: DelaySummary::new(&detector.detected),
            settled: DelaySummary::new(&detector.settled),
            isolated_in_time_95: wilson(brief.isolated_in_time as f64, detector.fault_flights as f64),
            confusion_truth_verdict_windows: detector
                .confusion
                .iter()
                .map(|((truth, verdict), count)| [i64::from(*truth), i64::from(*verdict), *count as i64])
                .collect(),
            windows_by_severity: detector
                .by_severity
                .iter()
                .map(|(bin, sums)| SeverityWindows::new(*bin, sums))
                .collect(),
            onsets_by_severity: detector
                .delay_by_severity
                .iter()
                .map(|(bin, (flights, delays))| SeverityOnsets {
                    loss: severity_name(*bin),
                    flights: *flights,
                    in_time: delays.within(criteria.isolate_within_s),
                    isolated: DelaySummary::new(delays),
                })
                .collect(),
            brief,
        }
    }
}

impl DelaySummary {
    fn new(delays: &Delays) -> Self {
        Self {
            flights: delays.total(),
            median_s: delays.quantile_s(0.5),
            p95_s: delays.quantile_s(0.95),
            worst_s: delays.quantile_s(1.0),
        }
    }
}

impl SeverityWindows {
    fn new(bin: usize, sums: &ClusterSums) -> Self {
        Self {
            loss: severity_name(bin),
            windows: sums.total(),
            right: sums.share(),
            right_95: sums.interval(),
        }
    }
}

impl AxisSummary {
    fn new(axis: &AxisTotals, totals: &Totals, criteria: Criteria) -> Self {
        let brief = |detector: &DetectorTotals| BriefSummary::new(detector, criteria);
        let own = |group: &GroupTotals| -> Vec<(String, BriefSummary)> {
            let named = totals.own.iter().zip(&group.own);
            named
                .map(|(own, detector)| (own.column.clone(), brief(detector)))
                .collect()
        };
        Self {
            axis: axis.axis.clone(),
            groups: axis
                .groups
                .iter()
                .map(|group: &GroupTotals| AxisValueSummary {
                    value: group.name.clone(),
                    flights: group.flights,
                    failed: group.failed,
                    detectors: by_name(&group.detectors, brief).into_iter().chain(own(group)).collect(),
                })
                .collect(),
        }
    }
}

impl LossErrorSummary {
    fn new(errors: &LossError) -> Option<Self> {
        errors.summary().map(|(flights, mean_n, rms_n)| Self {
            flights,
            mean_n,
            rms_n,
            interval_holds_truth: errors.covered(),
        })
    }
}
