"""What can be asked of the twin, of classifiers and of the FDI service, once for both clients."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._exchange import Operation, Settings
from ._operations import JobOperations
from ._stream import in_path
from .models import (
    ChannelSeries,
    ConditionSeries,
    FdiAnswer,
    FdiState,
    HiddenTruth,
    Job,
    Json,
    ProposedManoeuvre,
    Sample,
    read,
)

if TYPE_CHECKING:
    import pandas

#: Samples per chunk; the server accepts up to 4000.
CHUNK = 2000


def job_operations(settings: Settings, kind: str) -> JobOperations[Job]:
    """The verbs of a kind of job."""
    return JobOperations(settings, kind, lambda data: read(Job, data))


class LogOperations(JobOperations[Job]):
    """What only logs have."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, "logs", lambda data: read(Job, data))

    def upload(self, log: str | Path | bytes, name: str | None, query: Mapping[str, Any], key: str | None) -> Operation[Job]:
        if isinstance(log, bytes):
            if name is None:
                raise ValueError("bytes have no name: expected name='flight.ulg' or the like, as its ending says what they are")
            content = log
        else:
            name, content = name or Path(log).name, Path(log).read_bytes()
        params = {"name": name, **query}
        if key is None:
            # The same file, imported with the same settings, is one log.
            words = json.dumps(params, sort_keys=True).encode()
            key = f"log-{hashlib.sha256(words + content).hexdigest()}"
        headers = {"idempotency-key": key, "content-type": "application/octet-stream"}
        answer = yield from self.settings.call("POST", self.root, params=params, content=content, headers=headers)
        return self.parse(answer.json())

    def generate(self, body: Json, key: str | None) -> Operation[Job]:
        return (yield from self.submit(body, key, f"{self.root}/generate"))

    def truth(self, id: str) -> Operation[HiddenTruth]:
        answer = yield from self.settings.call("GET", self.path(id, "truth"))
        return read(HiddenTruth, answer.json())

    def draft(self, id: str) -> Operation[Json]:
        # Read by a process of the server.
        answer = yield from self.settings.call("GET", self.path(id, "mapping"), timeout_s=max(130.0, self.settings.timeout_s))
        found: Json = answer.json()
        return found

    def again(self, id: str, mapping: str | Path | None, body: Json, key: str | None) -> Operation[Job]:
        text = mapping.read_text(encoding="utf-8") if isinstance(mapping, Path) else mapping
        return (yield from self.submit(body | without_none(mapping=text), key, self.path(id, "import")))


class ComparisonOperations(JobOperations[Job]):
    """What only comparisons have."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, "comparisons", lambda data: read(Job, data))

    def series(self, id: str, query: Json) -> Operation[ChannelSeries]:
        answer = yield from self.settings.call("GET", self.path(id, "series"), params=query)
        return read(ChannelSeries, answer.json())

    def conditions(self, id: str, query: Json) -> Operation[ConditionSeries]:
        answer = yield from self.settings.call("GET", self.path(id, "conditions"), params=query)
        return read(ConditionSeries, answer.json())


class IdentificationOperations(JobOperations[Job]):
    """What only identifications have."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, "identifications", lambda data: read(Job, data))

    def keep(self, id: str) -> Operation[str]:
        # Kept twice, it is the same documents.
        answer = yield from self.settings.call("POST", self.path(id, "keep"))
        return str(answer.json()["vehicle"])

    def document(self, id: str, name: str) -> Operation[str]:
        found = (yield from self.done(id)).result
        return str(found[name])


class NextFlightOperations(JobOperations[Job]):
    """What only proposals of a next flight have."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, "next-flights", lambda data: read(Job, data))

    def manoeuvres(self, id: str) -> Operation[list[ProposedManoeuvre]]:
        found = (yield from self.done(id)).result
        return [read(ProposedManoeuvre, item) for item in found]


def model_body(vehicle: str | None, improvement: str | None, version: str | Path | None, model: str | None = None) -> Json:
    """Which model a submission means."""
    if isinstance(version, Path):
        version = version.read_text(encoding="utf-8")
    given = {"vehicle": vehicle, "improvement": improvement, "version": version, "model": model}
    return {key: value for key, value in given.items() if value is not None}


def more_model(model: str | Mapping[str, str | Path]) -> Json:
    """Another model of a comparison: a name of `client.models`, or what says which."""
    if isinstance(model, str):
        return {"model": model}
    return {key: effect_text(value) if key == "version" else value for key, value in model.items()}


def bench_table(table: str | Path) -> Json:
    """A file of a thrust bench here."""
    path = Path(table)
    return {"name": path.name, "text": path.read_text(encoding="utf-8")}


def flights_body(logs: Sequence[str], runs: Sequence[str]) -> Json:
    """Which flights a submission means."""
    return {"logs": list(logs), "runs": list(runs)}


def effect_text(effect: str | Path) -> str:
    """A document: a text, or a `Path` of a file here."""
    return effect.read_text(encoding="utf-8") if isinstance(effect, Path) else effect


def without_none(**given: Any) -> Json:
    """Fields that were given."""
    return {key: value for key, value in given.items() if value is not None}


class FdiOperations:
    """The verbs of `/api/v1/fdi/sessions`."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.root = "/api/v1/fdi/sessions"

    def open(self, body: Json) -> Operation[FdiState]:
        answer = yield from self.settings.call("POST", self.root, json=body)
        return read(FdiState, answer.json()["session"])

    def sessions(self) -> Operation[list[FdiState]]:
        answer = yield from self.settings.call("GET", self.root)
        return [read(FdiState, item) for item in answer.json()["items"]]

    def state(self, id: str) -> Operation[FdiState]:
        answer = yield from self.settings.call("GET", f"{self.root}/{in_path(id)}")
        return read(FdiState, answer.json())

    def feed(self, id: str, first_step: int, samples: Sequence[Sample] | str, after_gap: bool) -> Operation[FdiAnswer]:
        params = {"first_step": first_step, "after_gap": "true" if after_gap else "false"}
        kind = "text/csv" if isinstance(samples, str) else "application/json"
        content = samples if isinstance(samples, str) else json.dumps(list(samples))
        # A chunk that was accepted although its answer was lost gets the same answer.
        answer = yield from self.settings.call(
            "POST", f"{self.root}/{in_path(id)}/measurements", params=params, content=content.encode(), headers={"content-type": kind}
        )
        return read(FdiAnswer, answer.json())

    def close(self, id: str) -> Operation[None]:
        yield from self.settings.call("DELETE", f"{self.root}/{in_path(id)}", ok_when_repeated=(404,))

    def judge(self, log: str | Path | bytes | None, params: Json, what: str) -> Operation[Json]:
        """what: `reports` or `scores`."""
        content = b"" if log is None else log if isinstance(log, bytes) else Path(log).read_bytes()
        headers = {"content-type": "application/octet-stream"}
        # Judged by a process of the server, which has two minutes. It keeps nothing: what is asked again is judged again.
        timeout_s = max(150.0, self.settings.timeout_s)
        answer = yield from self.settings.call(
            "POST", f"/api/v1/fdi/{what}", params=params, content=content, headers=headers, timeout_s=timeout_s
        )
        found: Json = answer.json()
        return found


def judge_params(
    log: str | Path | bytes | None,
    id: str | None,
    vehicle: str,
    part: str | None,
    classifier: str | None,
    calibration_start_s: float | None,
    calibration_end_s: float | None,
    flight: bool,
) -> Json:
    """Which log, and which detectors."""
    if (log is None) == (id is None):
        raise ValueError("expected a log or the id of one, got " + ("neither" if log is None else "both"))
    calibration = {"calibration_start_s": calibration_start_s, "calibration_end_s": calibration_end_s}
    return without_none(log=id, vehicle=vehicle, part=part, classifier=classifier, flight="true" if flight else None, **calibration)


def truth_params(truth: str | Sequence[tuple[float, int, float | None]]) -> Json:
    """What is true: the name of a column, or rows."""
    rows = truth if isinstance(truth, str) else ";".join(f"{at},{rotor},{'' if loss is None else loss}" for at, rotor, loss in truth)
    return {"truth_column" if isinstance(truth, str) else "truth": rows}


def session_body(
    vehicle: str | None,
    vehicle_text: str | Path | None,
    classifier: str | None,
    settings: Mapping[str, Any] | None,
    topic: bool,
) -> Json:
    """A session to open."""
    if isinstance(vehicle_text, Path):
        vehicle_text = vehicle_text.read_text(encoding="utf-8")
    body = without_none(vehicle=vehicle, vehicle_text=vehicle_text, classifier=classifier)
    return {**body, "settings": dict(settings or {}), "topic": topic}


def chunks_of(frame: pandas.DataFrame, chunk: int) -> Iterator[str]:
    """The columns of a frame that the service reads, as CSV, so many rows at a time."""
    ned = ("north", "east", "down")
    angles = ("roll", "pitch", "yaw")
    wanted = [f"velocity_{axis}_m_s" for axis in ned] + [f"{angle}_rad" for angle in angles]
    wanted += [f"{angle}_rate_rad_s" for angle in angles] + ["battery_voltage_v"]
    missing = [name for name in wanted if name not in frame.columns]
    duties = [f"duty_{rotor}" for rotor in range(1, 100) if f"duty_{rotor}" in frame.columns]
    if missing or not duties:
        raise ValueError(f"the frame has no column {', '.join(missing or ['duty_1'])}; expected those of a run's telemetry or of a log")
    columns = wanted + duties + [name for name in ("time_s",) if name in frame.columns]
    for first in range(0, len(frame), chunk):
        yield frame[columns].iloc[first : first + chunk].to_csv(index=False)
