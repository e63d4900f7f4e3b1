//! Autopilots that operators have listed: which are available, which are busy, and whether a run can be flown with one.

use super::jobs::Shared;
use crate::App;
use crate::access::Caller;
use crate::jobs::Job;
use crate::jobs::autopilots::Listed;
use crate::problem::Problem;
use axum::Json;
use rotortwin_jobs::Status;
use rotortwin_jobs::flight::{Link, Pace, Place};
use rotortwin_scenario::Scenario;
use rotortwin_scenario::autopilot_frame::{AutopilotFrame, AutopilotKind};
use serde::Serialize;
use utoipa::ToSchema;

/// An autopilot that runs can name.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ListedAutopilot {
    /// Name for `{"controller": {"autopilot": NAME}}` in a submission.
    name: String,
    /// `ardupilot`, `px4`, `betaflight`.
    kind: String,
    /// True if it waits for the plant in each step. Otherwise two flights with the same seed differ.
    lockstep: bool,
    /// `free`; `busy`: used by a run; `away`: the process that offers it is not running.
    state: AutopilotState,
    /// The run that uses it, if the caller may see that run.
    run: Option<String>,
    /// Process that offers or offered it.
    worker: String,
    /// Name that it reported in its last flight.
    version: Option<String>,
    /// End of that flight, ms since 1970, UTC.
    flown_ms: Option<i64>,
}

/// Whether it is available now.
#[derive(Debug, Clone, Copy, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum AutopilotState {
    /// A run would have it at once.
    Free,
    /// A run has it.
    Busy,
    /// The process that lists it is not there.
    Away,
}

/// All of them.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Autopilots {
    /// By name.
    items: Vec<ListedAutopilot>,
}

impl ListedAutopilot {
    fn new(listed: Listed, caller: &Caller) -> Self {
        Self {
            state: match (&listed.run, listed.offered) {
                (Some(_), _) => AutopilotState::Busy,
                (None, true) => AutopilotState::Free,
                (None, false) => AutopilotState::Away,
            },
            run: seen_run(&listed, caller),
            name: listed.name,
            kind: listed.protocol,
            lockstep: listed.lockstep,
            worker: listed.worker,
            version: listed.version,
            flown_ms: listed.flown_ms,
        }
    }
}

/// The run that an autopilot flies, unless it is another user's.
fn seen_run(listed: &Listed, caller: &Caller) -> Option<String> {
    let (run, tenant) = listed.run.as_ref()?;
    let sees = caller.tenant_filter().is_none_or(|own| own == tenant);
    sees.then(|| run.clone())
}

/// The autopilots that operators have configured (`rotortwin serve --autopilot NAME=ADDRESS`), by name.
#[utoipa::path(get, path = "/api/v1/autopilots", tag = "autopilots", operation_id = "list_autopilots", responses(
    (status = 200, description = "the complete list", body = Autopilots)
))]
pub(crate) async fn list(app: Shared, caller: Caller) -> Result<Json<Autopilots>, Problem> {
    let listed = app.database.autopilots().await?;
    let items = listed.into_iter().map(|one| ListedAutopilot::new(one, &caller));
    Ok(Json(Autopilots { items: items.collect() }))
}

/// Why a queued run is not begun although workers are free; `None`: nothing is known that it waits for.
pub(super) async fn waits_because(app: &App, caller: &Caller, run: &Job) -> Result<Option<String>, Problem> {
    let (Some(name), Status::Queued) = (&run.new.autopilot, run.status) else {
        return Ok(None);
    };
    let listed = app.database.autopilots().await?;
    let Some(listed) = listed.into_iter().find(|one| one.name == *name) else {
        return Ok(Some(format!("autopilot '{name}' is no longer configured")));
    };
    if listed.run.is_some() {
        let who = seen_run(&listed, caller).map_or_else(|| "another user's run".to_owned(), |run| format!("run {run}"));
        return Ok(Some(format!("the autopilot '{name}' is busy with {who}")));
    }
    Ok((!listed.offered).then(|| {
        format!(
            "the autopilot '{name}' is away: its worker ({}) is not running",
            listed.worker
        )
    }))
}

/// Whether a run can be flown with the autopilot of this name.
///
/// # Errors
/// 422: nobody has listed it, or the run cannot be flown with it.
pub(super) async fn check(
    app: &App,
    name: &str,
    scenario: &Scenario,
    seed: Option<u64>,
    (link, fdi, pace): (Link, Place, Pace),
) -> Result<(), Problem> {
    let listed = app.database.autopilots().await?;
    let Some(one) = listed.iter().find(|one| one.name == name) else {
        let names: Vec<&str> = listed.iter().map(|one| one.name.as_str()).collect();
        let expected = if names.is_empty() {
            "this server has none".to_owned()
        } else {
            format!("expected one of: {}", names.join(", "))
        };
        let hint = if name.contains([':', '/']) {
            "; a request cannot give an address, the operator configures it with `--autopilot NAME=ADDRESS`"
        } else {
            ""
        };
        return Err(Problem::unprocessable(format!(
            "`controller` names the autopilot '{name}', which is not configured; {expected}{hint}"
        )));
    };
    if link == Link::Zenoh || fdi != Place::Beside {
        return Err(Problem::unprocessable(
            "with an autopilot, plant and FDI engine are one process; expected no `link`, and `fdi` = beside",
        ));
    }
    if pace != Pace::Fast {
        return Err(Problem::unprocessable(
            "an autopilot sets its own pace; expected `pace` = fast",
        ));
    }
    let kind = match one.protocol.as_str() {
        "ardupilot" => AutopilotKind::ArduPilot,
        "px4" => AutopilotKind::Px4,
        _ => AutopilotKind::Betaflight,
    };
    AutopilotFrame::of_vehicle(kind, scenario.vehicle()).map_err(Problem::unprocessable)?;
    let mut simulation = scenario
        .simulation(seed.unwrap_or_else(|| scenario.seed()))
        .map_err(|error| Problem::unprocessable(error.to_string()))?;
    simulation
        .begin_prelude()
        .map_err(|refusal| Problem::unprocessable(format!("key `{}`: {}", refusal.key, refusal.reason)))
}
