"""What the server says, as dataclasses. Field names are those of the OpenAPI document (a test compares them).

A field that a later server adds is ignored, so that an older client keeps working.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, Literal, TypedDict, TypeVar, Union

from .errors import UnexpectedAnswer

Json = dict[str, Any]
Status = Literal["queued", "running", "done", "failed", "canceled"]
Link = Literal["in-process", "iceoryx2", "zenoh"]
Pace = Literal["fast", "real-time"]
Place = Literal["beside", "worker", "external"]
#: Who flies: a place, or `{"autopilot": NAME}`, one that the operator of the server has listed.
Controller = Union[Place, Mapping[str, str]]
Method = Literal["paper", "improved"]
#: What a generated log shows.
ExamplePreset = Literal["hidden-effect", "damaged-blade", "healthy"]
#: What a whole run can be written as.
ExportFormat = Literal["ulog", "mcap", "parquet", "csv"]
CalibrationState = Literal["noise", "disturbances", "done"]

_T = TypeVar("_T")

#: States that never change.
FINAL = ("done", "failed", "canceled")


def read(cls: type[_T], data: object) -> _T:
    """An object of this dataclass from JSON."""
    if not isinstance(data, Mapping):
        raise UnexpectedAnswer(f"expected an object with the fields of {cls.__name__}, not {data!r:.100}")
    wanted = fields(cls)  # type: ignore[arg-type]
    needed = {f.name for f in wanted if f.default is MISSING and f.default_factory is MISSING}
    if missing := needed - data.keys():
        raise UnexpectedAnswer(f"{cls.__name__} without {', '.join(sorted(missing))}: is this a rotortwin server?")
    return cls(**{f.name: _field(cls, f.name, data[f.name]) for f in wanted if f.name in data})


def _field(cls: type, name: str, value: Any) -> Any:
    inner = _NESTED.get((cls, name))
    if inner is None or value is None:
        return value
    return [read(inner, item) for item in value] if isinstance(value, list) else read(inner, value)


@dataclass(frozen=True)
class QueryColumn:
    """A column of the answer to SQL."""

    name: str
    #: As DuckDB calls it: `DOUBLE`, `BIGINT`, `VARCHAR`, …
    type: str


@dataclass(frozen=True)
class QueryAnswer:
    """The answer to SQL: `rows[i][j]` belongs to `columns[j]`; None is no value, or no number."""

    columns: list[QueryColumn]
    rows: list[list[Any]]
    #: True if there are more rows than these.
    more: bool

    def dicts(self) -> list[Json]:
        """A dict for each row; `pandas.DataFrame` takes them."""
        return [{column.name: value for column, value in zip(self.columns, row, strict=True)} for row in self.rows]


@dataclass(frozen=True)
class Run:
    """A flight. Times are ms since 1970, UTC."""

    id: str
    #: Of the scenario.
    name: str
    vehicle: str
    status: Status
    #: Of all noise.
    seed: int
    link: str
    pace: str
    #: Larger values run first.
    priority: int
    submitted_ms: int
    #: How often it was begun.
    attempts: int
    #: Somebody wants it stopped.
    cancel_requested: bool
    #: On whose account.
    tenant: str = ""
    #: Who flies, who detects: `beside` the plant, on a `worker`, `external`; `{"autopilot": NAME}`.
    controller: str | Mapping[str, str] = "beside"
    fdi: str = "beside"
    #: The run that it was forked from, or the campaign that the flight belongs to.
    parent: str | None = None
    #: Who has or had it.
    worker: str | None = None
    #: What it waits for in the queue, besides a free worker: its autopilot is busy or away. Not in lists.
    waits_because: str | None = None
    #: Size of its files, bytes.
    bytes: int = 0
    started_ms: int | None = None
    finished_ms: int | None = None
    #: What the sequential detector said at the end: 0 healthy, a rotor from 1, 100 i + j two rotors, -1 unknown fault, -2 not ready,
    #: -3 ambiguous.
    verdict: int | None = None
    #: Equal for equal scenario, seed and program, whatever the link.
    run_hash: str | None = None
    #: Why it failed, one sentence.
    error: str | None = None
    #: Settings that are allowed but probably unintended.
    warnings: Sequence[str] = ()
    #: What it was, what the detectors said (`summary.json`); not in lists.
    summary: Json | None = None
    #: As every job: its kind, and its result, which is the summary.
    kind: str = "run"
    result: Json | None = None

    @property
    def ended(self) -> bool:
        """It is done, failed or canceled."""
        return self.status in FINAL


@dataclass(frozen=True)
class Job:
    """A job that is no run: a campaign, a diagnosis, … Times are ms since 1970, UTC."""

    id: str
    #: What it is, such as `campaign`.
    kind: str
    #: Name of the campaign, of the log, …
    name: str
    status: Status
    submitted_ms: int
    #: How often it was begun.
    attempts: int
    #: Somebody wants it stopped.
    cancel_requested: bool
    #: Jobs of a tenant with larger values run first.
    priority: int = 0
    #: On whose account.
    tenant: str = ""
    #: What was asked for, in short.
    facts: Json = field(default_factory=dict)
    #: The job that it was made from.
    parent: str | None = None
    #: Parts that are not done.
    waits_for: int = 0
    started_ms: int | None = None
    finished_ms: int | None = None
    #: Who has or had it.
    worker: str | None = None
    #: Size of its files, bytes.
    bytes: int = 0
    #: Why it failed, one sentence.
    error: str | None = None
    #: What came out; not in lists.
    result: Any = None

    @property
    def ended(self) -> bool:
        """It is done, failed or canceled."""
        return self.status in FINAL


@dataclass(frozen=True)
class CampaignFlight:
    """A flight of a campaign, as one detector saw it."""

    #: From 0.
    flight: int
    #: Of all noise.
    seed: int
    #: `done`, `failed`, `refused`.
    status: str
    #: That of the run of the same flight.
    run_hash: str
    #: Windows with the truth and verdict that were asked for.
    windows: int
    #: Its verdict at the end; -2 if it was never ready.
    verdict_at_end: int
    #: Rows of windows with a false alarm.
    false_alarm_events: int
    #: What was set on each axis.
    parameters: Mapping[str, Any] = field(default_factory=dict)
    #: Rotors that were faulty at any time, from 1.
    faulty_rotors: Sequence[int] = ()
    #: Why it was not flown to its end.
    reason: str | None = None
    #: First onset of a fault, s.
    fault_onset_s: float | None = None
    #: From the onset to the first verdict other than healthy, and to the first right one, s.
    detected_after_s: float | None = None
    isolated_after_s: float | None = None
    #: Id of the run that it was flown as.
    run: str | None = None


@dataclass(frozen=True)
class BlindCase:
    """A case of a blind bench: what was hidden in a log, and what the diagnosis said of it."""

    #: From 0, over all presets.
    case: int
    #: What it belongs to, such as `singles`.
    preset: str
    #: Name of the vehicle.
    vehicle: str
    #: Built-in flight.
    flight: str
    #: Of the flight.
    seed: int
    #: Row of the confusion matrix.
    hidden: str
    #: Column of the confusion matrix.
    named: str
    #: The effects that were named, with their rotors; empty: none.
    answer: str
    #: What the answer is worth, such as `right`, `missed`.
    outcome: str
    #: Duration of the diagnosis, s.
    seconds: float
    #: What was hidden: `id`, `rotor`, `onset_s`, `parameters`.
    effects: Sequence[Json] = ()
    #: With small deviations in all other parameters.
    clutter: bool = False
    #: ln of the Bayes factor of the first named effect.
    evidence: float | None = None
    #: Largest relative error of the parameters of each correctly named effect.
    parameter_errors: Sequence[float] = ()
    #: Of the onset, s.
    onset_error_s: float | None = None
    #: Why there is no answer.
    failure: str | None = None
    #: Id of the log that it was flown again as.
    log: str | None = None
    #: What was hidden, with the lift biases and the charge at the start; only of a single case.
    truth: Json | None = None
    #: The diagnosis in full; only of a single case.
    diagnosis: Json | None = None


@dataclass(frozen=True)
class Ticket:
    """How a controller or an FDI engine from elsewhere joins a run."""

    #: `controller` or `fdi`.
    role: str
    #: Address of the plant: `zenoh:connect=tcp/HOST:PORT`.
    link: str
    #: 16 hex digits; part of all topics of the run.
    run_id: str
    #: Version of the messages of `proto/` that the plant uses.
    messages: int
    #: Longest wait of the plant for all peers to join, ms from the event `join`.
    join_timeout_ms: int
    #: Longest wait of the plant for the reply of a running peer, ms.
    step_timeout_ms: int
    #: Command that starts the built-in peer there.
    command: str


@dataclass(frozen=True)
class Artifact:
    """A file of a job."""

    #: Path in the job's folder.
    path: str
    #: Bytes.
    size: int
    #: Where to get it.
    href: str


@dataclass(frozen=True)
class Channel:
    """Something that was recorded of a run at every step."""

    #: Name, unique in the run.
    name: str
    #: Unit as written for people (`m/s`); `1` for fractions and codes.
    unit: str
    #: What it means.
    description: str
    #: `f64`, `f32`, `i32`, `i64`, `bool`; `text` and `other` cannot be asked for.
    kind: str


@dataclass(frozen=True)
class Autopilot:
    """An autopilot that the operator of the server has listed. Times are ms since 1970, UTC."""

    #: As a submission names it: `controller={"autopilot": NAME}`.
    name: str
    #: `ardupilot`, `px4`, `betaflight`.
    kind: str
    #: It waits for the plant in each of its steps; otherwise two flights of one seed differ.
    lockstep: bool
    #: `free`, `busy` with a run, `away`: the process that offers it is not running.
    state: str
    #: Process that offers or offered it.
    worker: str
    #: The run that has it, if it may be seen.
    run: str | None = None
    #: Name that it reported in its last flight.
    version: str | None = None
    #: End of that flight.
    flown_ms: int | None = None


@dataclass(frozen=True)
class Verification:
    """Result of a second execution."""

    #: The hashes are equal.
    same: bool
    #: Hash of the run.
    recorded: str
    #: Hash of the second execution, in one process.
    again: str
    #: How long it took, with its time in the queue.
    wall_ms: int
    #: Id of the job that did it.
    job: str = ""
    #: Why they need not be equal: an external controller flew the run, and the server's own flew it again.
    note: str | None = None


@dataclass(frozen=True)
class Complaint:
    """What is wrong with a document."""

    #: In one sentence.
    sentence: str
    #: Dotted path; none: the document as a whole.
    key: str | None = None
    #: Line of the text, from 1.
    line: int | None = None


@dataclass(frozen=True)
class Validation:
    """What a check of a document found."""

    #: It can be used.
    valid: bool
    #: Settings that are allowed but probably unintended.
    warnings: list[str]
    #: All that is wrong.
    complaints: list[Complaint]
    #: Why not, one sentence.
    refusal: str | None = None
    #: Every setting in effect (TOML).
    effective: str | None = None


@dataclass(frozen=True)
class Event:
    """Something that happened to a job."""

    #: Number, from 1, without gaps.
    id: int
    #: `queued`, `started`, `waiting`, `progress`, `change`, `recording`, `finished`, `requeued`, `ended`, … A job in parts has `started` when
    #: its first part does (`data["part"]`), `part` for each one that is done, and `started` again when they are merged.
    kind: str
    data: Json

    @property
    def share(self) -> float | None:
        """How much of the job is behind it, 0 to 1, if this event says so."""
        if isinstance(share := self.data.get("share"), (int, float)):
            return min(1.0, float(share))
        for done, of in (("step", "step_count"), ("flights", "of")):
            if isinstance(total := self.data.get(of), (int, float)) and total > 0:
                return min(1.0, float(self.data.get(done, 0)) / float(total))
        return None


class _Measured(TypedDict):
    #: m/s, over ground, NED.
    velocity_ned_m_s: Sequence[float]
    #: rad, Euler angles ZYX, body in NED.
    attitude_rad: Sequence[float]
    #: rad/s, p, q, r, FRD.
    body_rates_rad_s: Sequence[float]
    #: Fractions, commanded to each rotor, held from this sample to the next.
    duty: Sequence[float]
    #: V, at the terminals.
    battery_voltage_v: float


class Sample(_Measured, total=False):
    """What the detectors are fed with every 2.5 ms."""

    #: m; the detectors do not use it.
    position_ned_m: Sequence[float]
    #: s, by any clock: finds wrong rates and unnoticed gaps.
    time_s: float


@dataclass(frozen=True)
class FdiWindow:
    """What the detectors say at the end of a window."""

    #: Its last step.
    step: int
    #: Since the session's first step, s.
    time_s: float
    calibration: CalibrationState
    #: The statistical test of the paper: `verdict`, `code`, `rotors`.
    t_test: Json
    #: The classifier: also `class_probability` of healthy, rotor 1, rotor 2, …
    network: Json
    #: The same over time, of a classifier that calibrates itself: evidence of its windows added up.
    network_over_time: Json
    #: The detector that decides over time, the one to act on: also `sentence`, `probability`, `thrust_loss`, `suspect_rotors`, `hypotheses`.
    sequential: Json
    #: Why the verdicts are `cannot_judge`: on the ground, upset, or the model does not explain the motion.
    cannot_judge: Json | None = None
    #: Smallest loss of each rotor, as a fraction of its thrust, that would now be detected within 10 s; empty
    #: without a verdict and while a fault or an obstacle is reported.
    smallest_loss: list[float] = field(default_factory=list)
    #: The last load that was dropped or taken up since the calibration began: `time_s`, `named_s`, `mass_kg`, `probability`.
    load: Json | None = None
    #: What `sequential` was before the second look, as a run would record it; only where it says something else.
    engine: Json | None = None


@dataclass(frozen=True)
class FdiAnswer:
    """Result of a chunk of measurements."""

    first_step: int
    #: Step at which the next chunk must begin.
    next_step: int
    #: The chunk had already been accepted; this is the original response.
    repeated: bool
    #: Windows that ended in it.
    windows: list[FdiWindow]
    #: What else happened, one sentence each.
    notes: list[str]


@dataclass(frozen=True)
class FdiState:
    """An FDI session as it stands."""

    id: str
    #: Vehicle, classifier and settings in effect.
    detectors: Json
    #: Expected samples per second.
    rate_hz: float
    #: Step at which the next chunk must begin.
    next_step: int
    #: Samples taken.
    samples: int
    calibration: CalibrationState
    #: Step from which verdicts are given, unless a gap is too long.
    verdicts_from_step: int
    #: Samples with values that no flight can have; left out.
    rejected_samples: int
    #: Lost steps that were coasted over.
    bridged_steps: int
    #: Number of steps on the ground, just above it, or upset, in which the detectors paused.
    paused_steps: int
    #: Calibrations begun again after longer gaps.
    restarts: int
    #: Each change of the sequential detector's verdict; the latest 1000.
    changes: list[Json]
    #: It ends when nothing is asked of it for so long, s.
    idle_limit_s: float
    #: Why there are no verdicts at present.
    cannot_judge: Json | None = None
    #: The last window.
    last: FdiWindow | None = None


@dataclass(frozen=True)
class PlacedEvent:
    """An event of the one stream of all jobs."""

    #: Where it stands in the stream: what `after` takes.
    place: str
    #: As in the stream of its job; `open` is the stream's own, with number 0.
    event: Event
    #: Id of the job; empty for `open`.
    job: str = ""
    #: Under which address such jobs are: what `client.jobs` takes, such as `campaigns`.
    collection: str = ""
    #: What the job is, such as `campaign`.
    job_kind: str = ""

    @property
    def kind(self) -> str:
        """That of the event, such as `progress`."""
        return self.event.kind


@dataclass(frozen=True)
class FdiEvent:
    """A change of one's FDI sessions."""

    #: `open`: all that are open now. `session`: one was opened or fed. `closed`: one has ended.
    kind: str
    #: Those that are open, or the one that changed.
    sessions: Sequence[FdiState] = ()
    #: Id of the one that has ended.
    closed: str | None = None


@dataclass(frozen=True)
class RotorGeometry:
    """One rotor."""

    #: From 1.
    number: int
    #: m, from the centre of mass, FRD.
    position_body_m: Sequence[float]
    #: `cw` or `ccw`, seen from above.
    spin: str
    #: Drag torque per thrust, m.
    moment_ratio_m: float


@dataclass(frozen=True)
class Effectiveness:
    """`matrix` times the rotors' thrusts (N): total thrust (N), then torques about x, y, z (N m)."""

    #: `thrust`, `roll`, `pitch`, `yaw`.
    rows: Sequence[str]
    #: One row for each of these, one column per rotor.
    matrix: Sequence[Sequence[float]]


@dataclass(frozen=True)
class Hover:
    """Hover in still air."""

    #: Weight, N.
    thrust_n: float
    #: Minimum-norm thrusts that carry the weight without torque, N.
    rotor_thrust_n: Sequence[float]
    #: Duties for these thrusts at that voltage, fraction.
    duty: Sequence[float]
    #: State of charge, fraction.
    state_of_charge: float
    #: Battery voltage under this load, V.
    voltage_v: float


@dataclass(frozen=True)
class VehicleGeometry:
    """A vehicle as its document says; x forward, y right, z down (FRD), from the centre of mass."""

    #: Of the vehicle.
    name: str
    mass_kg: float
    #: Distance to the farthest rotor, m.
    arm_m: float
    gravity_m_s2: float
    #: Principal moments of inertia.
    inertia_body_kg_m2: Sequence[float]
    #: Ordered by number.
    rotors: list[RotorGeometry]
    #: What thrusts do.
    effectiveness: Effectiveness
    #: None: the battery cannot lift it.
    hover: Hover | None = None


@dataclass(frozen=True)
class Buckets:
    """One value per bucket; None: no sample counts."""

    #: Mean of the samples that count.
    mean: Sequence[float | None]
    #: The lowest sample.
    low: Sequence[float | None]
    #: The highest sample.
    high: Sequence[float | None]


@dataclass(frozen=True)
class ModelSeries:
    """Prediction of one model for a channel."""

    #: As in the result of the comparison.
    label: str
    #: Predicted: measured minus residual.
    predicted: Buckets
    #: Residual: measured minus predicted.
    residual: Buckets


@dataclass(frozen=True)
class BucketNoise:
    """Deviations of pure noise, 1 sigma, in the unit of the channel."""

    #: Of a sample.
    sample: float
    #: That of the mean of a whole bucket.
    mean: float


@dataclass(frozen=True)
class ChannelSeries:
    """One channel of a compared log: what was measured, and what each model makes of it."""

    #: Index of the log in the result, from 0.
    log: int
    #: Name of the log.
    name: str
    channel: str
    #: Of all values.
    unit: str
    #: First and last sample of the log, s.
    start_s: float
    end_s: float
    #: Length of a bucket, s.
    bucket_s: float
    #: Samples in the interval.
    source_rows: int
    #: Middle of each bucket, s.
    time_s: Sequence[float]
    measured: Buckets
    #: In the order of the result.
    models: list[ModelSeries]
    #: Level of pure noise.
    noise: BucketNoise


@dataclass(frozen=True)
class FlightCondition:
    """One flight condition over time."""

    #: Key, as in the result of the comparison.
    name: str
    #: For people.
    title: str
    unit: str
    #: Mean of each bucket; None: unknown.
    mean: Sequence[float | None]


@dataclass(frozen=True)
class ConditionSeries:
    """The flight conditions of a compared log."""

    #: Index of the log in the result, from 0.
    log: int
    #: Name of the log.
    name: str
    #: Length of a bucket, s.
    bucket_s: float
    #: Samples in the interval.
    source_rows: int
    #: Middle of each bucket, s: those of a channel's series with the same interval and number of buckets.
    time_s: Sequence[float]
    items: list[FlightCondition]


@dataclass(frozen=True)
class HiddenEffect:
    """An effect that was hidden in a log."""

    #: Of the kind, such as `rotor-drag`.
    id: str
    #: Values of its parameters; absent ones have their typical value.
    parameters: Mapping[str, float]
    #: From 1, for kinds that act on one rotor.
    rotor: int | None = None
    #: Start, s; None: from the beginning.
    onset_s: float | None = None
    #: How its size changes after the onset; None: it does not.
    profile: Json | None = None


@dataclass(frozen=True)
class HiddenTruth:
    """What was hidden in a generated log."""

    #: Empty: nothing.
    effects: list[HiddenEffect]
    #: Name of the vehicle.
    vehicle: str
    #: Seed of all random streams.
    seed: int
    duration_s: float
    #: At the start, fraction.
    state_of_charge: float
    #: Of each rotor, N: what a comparison takes as nuisance.
    lift_biases_n: Sequence[float]


@dataclass(frozen=True)
class ManoeuvreEvidence:
    """What data with an effect in them are expected to say; natural logarithms of Bayes factors (above 10: decisive)."""

    #: Against the other effect of the pair.
    against_other: float
    #: Against the strongest of all other candidates, "nothing" included.
    against_all: float
    #: That candidate.
    strongest_rival: str


@dataclass(frozen=True)
class ProposedManoeuvre:
    """A manoeuvre with its expected evidence."""

    #: Its name.
    manoeuvre: str
    #: In words.
    description: str
    duration_s: float
    #: With the first effect in the data.
    first: ManoeuvreEvidence
    #: With the second effect in the data.
    second: ManoeuvreEvidence


@dataclass(frozen=True)
class Limits:
    """What the caller's account may have, and has."""

    #: Size of an uploaded flight log, bytes.
    largest_log: int
    #: Size of a flight log that is judged directly and not stored (`fdi.judge`, `fdi.score`), bytes.
    largest_judged_log: int
    #: Size of all files: limit and now, bytes.
    most_bytes: int
    bytes: int
    #: Queued and running jobs: limit and now.
    most_open_jobs: int
    open_jobs: int
    #: Of simulated time, s.
    longest_flight_s: float


@dataclass(frozen=True)
class Identity:
    """Who the caller is for the server."""

    #: The caller is known.
    signed_in: bool
    #: Every request needs a token.
    needs_token: bool
    #: `read`, `write`, `admin`.
    scopes: Sequence[str]
    #: On whose account.
    tenant: str | None = None


@dataclass(frozen=True)
class LibraryCampaign:
    """A campaign of the library."""

    #: What `campaigns.submit` takes.
    name: str
    #: What it tests; empty if its document does not say.
    description: str


@dataclass(frozen=True)
class RunTable:
    """Runs side by side: `rows[i][j]` belongs to `columns[j]`; None where a run has no value."""

    columns: list[str]
    rows: list[list[Any]]

    def dicts(self) -> list[Json]:
        """A dict for each run; `pandas.DataFrame` takes them."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]


#: Fields that hold an object of another dataclass, or a list of them.
_NESTED: Mapping[tuple[type, str], type] = {
    (QueryAnswer, "columns"): QueryColumn,
    (Validation, "complaints"): Complaint,
    (FdiAnswer, "windows"): FdiWindow,
    (FdiState, "last"): FdiWindow,
    (VehicleGeometry, "rotors"): RotorGeometry,
    (VehicleGeometry, "effectiveness"): Effectiveness,
    (VehicleGeometry, "hover"): Hover,
    (ModelSeries, "predicted"): Buckets,
    (ModelSeries, "residual"): Buckets,
    (ChannelSeries, "measured"): Buckets,
    (ChannelSeries, "models"): ModelSeries,
    (ChannelSeries, "noise"): BucketNoise,
    (ConditionSeries, "items"): FlightCondition,
    (HiddenTruth, "effects"): HiddenEffect,
    (ProposedManoeuvre, "first"): ManoeuvreEvidence,
    (ProposedManoeuvre, "second"): ManoeuvreEvidence,
}
