"""What the server says, as dataclasses. Field names are those of the OpenAPI document (a test compares them).

A field that a later server adds is ignored, so that an older client keeps working.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, Literal, TypeVar

from .errors import UnexpectedAnswer

Json = dict[str, Any]
Status = Literal["queued", "running", "done", "failed", "canceled"]
Link = Literal["in-process", "iceoryx2", "zenoh"]
Pace = Literal["fast", "real-time"]
Place = Literal["beside", "worker", "external"]

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
    return cls(**{f.name: data[f.name] for f in wanted if f.name in data})


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
    #: Larger goes first.
    priority: int
    submitted_ms: int
    #: How often it was begun.
    attempts: int
    #: Somebody wants it stopped.
    cancel_requested: bool
    #: On whose account.
    tenant: str = ""
    #: Who flies, who detects: `beside` the plant, on a `worker`, `external`.
    controller: str = "beside"
    fdi: str = "beside"
    #: The run that it was forked from.
    parent: str | None = None
    #: Who has or had it.
    worker: str | None = None
    #: Bytes of its files.
    bytes: int = 0
    started_ms: int | None = None
    finished_ms: int | None = None
    #: Equal for equal scenario, seed and program, whatever the link.
    run_hash: str | None = None
    #: Why it failed, one sentence.
    error: str | None = None
    #: What it was, what the detectors said (`summary.json`); not in lists.
    summary: Json | None = None

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
    #: Of the campaign, of the log, …
    name: str
    status: Status
    submitted_ms: int
    #: How often it was begun.
    attempts: int
    #: Somebody wants it stopped.
    cancel_requested: bool
    #: Larger goes first among the jobs of a tenant.
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
    #: Bytes of its files.
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
class Ticket:
    """How a controller or an FDI engine from elsewhere joins a run."""

    #: `controller` or `fdi`.
    role: str
    #: Where the plant is met: `zenoh:connect=tcp/HOST:PORT`.
    link: str
    #: 16 hex digits; part of all topics of the run.
    run_id: str
    #: Version of the messages of `proto/` that the plant speaks.
    messages: int
    #: The plant waits this long for all parts to join, ms from the event `join`.
    join_timeout_ms: int
    #: The plant waits this long for the answer of a part that lives, ms.
    step_timeout_ms: int
    #: What starts our own part there.
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

    #: Unique in the run.
    name: str
    #: As people write it (`m/s`); `1` for fractions and codes.
    unit: str
    #: What it means.
    description: str
    #: `f64`, `f32`, `i32`, `i64`, `bool`; `text` and `other` cannot be asked for.
    kind: str


@dataclass(frozen=True)
class Verification:
    """What a second execution gave."""

    #: The hashes are equal.
    same: bool
    #: Hash of the run.
    recorded: str
    #: Hash of the second execution, in one process.
    again: str
    #: How long it took.
    wall_ms: int


@dataclass(frozen=True)
class Validation:
    """What a check of a scenario found."""

    #: It can be flown.
    valid: bool
    #: What is allowed and most likely not meant.
    warnings: list[str]
    #: Why not, one sentence.
    refusal: str | None = None
    #: Every setting in effect (TOML).
    effective: str | None = None


@dataclass(frozen=True)
class Event:
    """Something that happened to a job."""

    #: Number, from 1, without gaps.
    id: int
    #: `queued`, `started`, `waiting`, `progress`, `change`, `recording`, `finished`, `requeued`, `ended`, …
    kind: str
    data: Json

    @property
    def share(self) -> float | None:
        """How much of the job is behind it, 0 to 1, if this event says so."""
        for done, of in (("step", "step_count"), ("flights", "of")):
            if isinstance(total := self.data.get(of), (int, float)) and total > 0:
                return min(1.0, float(self.data.get(done, 0)) / float(total))
        return None
