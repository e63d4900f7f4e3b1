"""What the server says, as dataclasses. Field names are those of the OpenAPI document (a test compares them).

A field that a later server adds is ignored, so that an older client keeps working.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, Literal, TypeVar, cast

from .errors import UnexpectedAnswer

Json = dict[str, Any]
Status = Literal["queued", "running", "done", "failed", "canceled"]
Link = Literal["in-process", "iceoryx2", "zenoh"]
Pace = Literal["fast", "real-time"]

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
    #: The run that it was forked from.
    parent: str | None = None
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
    """A job of any other kind: what all of them have, and everything as it came in `raw`."""

    id: str
    status: Status
    error: str | None = None
    raw: Json = field(default_factory=dict, repr=False)

    @property
    def ended(self) -> bool:
        """It is done, failed or canceled."""
        return self.status in FINAL

    def __getitem__(self, key: str) -> Any:
        return self.raw[key]


def read_job(data: object) -> Job:
    """A job from JSON."""
    job = read(Job, data)
    return Job(job.id, job.status, job.error, dict(cast(Mapping[str, Any], data)))


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
        for done, of in (("step", "step_count"), ("done", "total")):
            if isinstance(total := self.data.get(of), (int, float)) and total > 0:
                return min(1.0, float(self.data.get(done, 0)) / float(total))
        return None
