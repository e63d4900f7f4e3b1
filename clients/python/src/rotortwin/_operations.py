"""What can be asked of the server, once for both clients."""

from __future__ import annotations

import io
import re
import sys
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar, Union

from ._exchange import Operation, Settings
from ._stream import in_path
from .errors import JobFailed, RotortwinError, UnexpectedAnswer, problem_of
from .models import (
    Artifact,
    Autopilot,
    BlindCase,
    CampaignFlight,
    Channel,
    Event,
    Identity,
    Job,
    Json,
    LibraryCampaign,
    Limits,
    QueryAnswer,
    Run,
    RunTable,
    Ticket,
    Validation,
    VehicleGeometry,
    Verification,
    read,
)

if TYPE_CHECKING:
    import pandas
    import pyarrow

J = TypeVar("J", bound=Union[Run, Job])
T = TypeVar("T")

#: Receives every event of a job that is waited for; True draws a bar on standard error.
Progress = Union[bool, Callable[[Event], None]]


def new_key() -> str:
    """A key for one submission, kept over its tries."""
    return uuid.uuid4().hex


def _noun(kind: str) -> str:
    """One of a kind, in words."""
    if kind.endswith("ies"):
        return f"{kind[:-3]}y"
    one = kind[:-2] if kind.endswith("ches") else kind.rstrip("s")
    return one.replace("-", " ")


class JobOperations(Generic[J]):
    """The verbs of `/api/v1/KIND`."""

    def __init__(self, settings: Settings, kind: str, parse: Callable[[object], J]) -> None:
        self.settings = settings
        self.root = f"/api/v1/{kind}"
        #: Its singular, in words.
        self.noun = _noun(kind)
        self.parse = parse

    def path(self, id: str, *more: str) -> str:
        return "/".join([self.root, in_path(id), *more])

    def submit(self, body: Mapping[str, Any], key: str | None, path: str | None = None) -> Operation[J]:
        headers = {"idempotency-key": key or new_key()}
        place = path or self.root
        # Read by a process of the server before it is accepted.
        is_campaign = place.endswith(("/campaigns", "/campaign"))
        timeout_s = max(130.0, self.settings.timeout_s) if is_campaign else None
        answer = yield from self.settings.call("POST", place, json=dict(body), headers=headers, timeout_s=timeout_s)
        return self.parse(answer.json())

    def get(self, id: str) -> Operation[J]:
        answer = yield from self.settings.call("GET", self.path(id))
        return self.parse(answer.json())

    def page(self, cursor: str | None, limit: int, filters: Mapping[str, Any]) -> Operation[tuple[list[J], str | None]]:
        params = {"cursor": cursor, "limit": limit, **filters}
        answer = yield from self.settings.call("GET", self.root, params=params)
        body = answer.json()
        return [self.parse(item) for item in body["items"]], body.get("next")

    def flight(self, id: str) -> Operation[Json]:
        # Read again by a process of the server.
        answer = yield from self.settings.call("GET", self.path(id, "flight"), timeout_s=max(130.0, self.settings.timeout_s))
        picture: Json = answer.json()
        return picture

    def channels(self, id: str) -> Operation[list[Channel]]:
        answer = yield from self.settings.call("GET", self.path(id, "channels"))
        return [read(Channel, item) for item in answer.json()["items"]]

    def samples(self, id: str, channels: Sequence[str], query: Mapping[str, Any]) -> Operation[bytes]:
        params = {"channels": ",".join(channels), "format": "parquet", **query}
        answer = yield from self.settings.call("GET", self.path(id, "telemetry"), params=params)
        return answer.content

    def cancel(self, id: str) -> Operation[J]:
        # Ended between two attempts, as intended.
        answer = yield from self.settings.call("POST", self.path(id, "cancel"), ok_when_repeated=(409,))
        if answer.status_code == 409:
            return (yield from self.get(id))
        return self.parse(answer.json())

    def delete(self, id: str) -> Operation[None]:
        yield from self.settings.call("DELETE", self.path(id), ok_when_repeated=(404,))

    def artifacts(self, id: str) -> Operation[list[Artifact]]:
        answer = yield from self.settings.call("GET", self.path(id, "artifacts"))
        return [read(Artifact, item) for item in answer.json()["items"]]

    def artifact(self, id: str, name: str) -> Operation[bytes]:
        answer = yield from self.settings.call("GET", self.artifact_path(id, name))
        return answer.content

    def artifact_path(self, id: str, name: str) -> str:
        return self.path(id, "artifacts", in_path(name))

    def done(self, id: str) -> Operation[J]:
        """The job with its result; raises unless it is done."""
        job = yield from self.get(id)
        if not job.ended:
            raise RotortwinError(f"{self.noun} {id} is {job.status}, and has no result yet; expected one that is done")
        return self.checked(job)

    def checked(self, job: J) -> J:
        """The job, if it ended as done."""
        if job.status != "done":
            why = f": {job.error}" if job.error else ""
            raise JobFailed(f"{self.noun} {job.id} ended as {job.status}{why}", job.status)
        return job


def query_files(
    settings: Settings, sql: str, runs: Sequence[str], campaigns: Sequence[str], blind_benches: Sequence[str], rows: int
) -> Operation[QueryAnswer]:
    """SQL over files of jobs, answered by the server."""
    body = {"sql": sql, "runs": list(runs), "campaigns": list(campaigns), "blind_benches": list(blind_benches), "rows": rows}
    # 30 s in the server unless its operator allows more, and as long in its queue.
    answer = yield from settings.call("POST", "/api/v1/queries", json=body, timeout_s=max(90.0, settings.timeout_s))
    return read(QueryAnswer, answer.json())


class CampaignOperations(JobOperations[Job]):
    """What only campaigns have."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, "campaigns", lambda data: read(Job, data))

    def flights(self, id: str, filters: Mapping[str, Any], cursor: str | None) -> Operation[tuple[list[CampaignFlight], str | None]]:
        answer = yield from self.settings.call("GET", self.path(id, "flights"), params={**filters, "cursor": cursor})
        body = answer.json()
        return [campaign_flight(item) for item in body["items"]], body.get("next")

    def library(self) -> Operation[list[LibraryCampaign]]:
        answer = yield from self.settings.call("GET", "/api/v1/library/campaigns")
        return [read(LibraryCampaign, item) for item in answer.json()["items"]]

    def fly(self, id: str, flight: int) -> Operation[Run]:
        # The address identifies the run: a repeated request gives the same one.
        answer = yield from self.settings.call("POST", self.path(id, "flights", str(flight), "run"))
        return read(Run, answer.json())


def campaign_flight(item: Json) -> CampaignFlight:
    """A row of the flights of a campaign."""
    parameters = {one["axis"]: one["value"] for one in item["parameters"]}
    return read(CampaignFlight, {**item, "seed": int(item["seed"]), "parameters": parameters})


class BlindBenchOperations(JobOperations[Job]):
    """What only blind benches have."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, "blind-benches", lambda data: read(Job, data))

    def cases(self, id: str, filters: Mapping[str, Any], cursor: str | None) -> Operation[tuple[list[BlindCase], str | None]]:
        answer = yield from self.settings.call("GET", self.path(id, "cases"), params={**filters, "cursor": cursor})
        body = answer.json()
        return [blind_case(item) for item in body["items"]], body.get("next")

    def case(self, id: str, number: int) -> Operation[BlindCase]:
        answer = yield from self.settings.call("GET", self.path(id, "cases", str(number)))
        return blind_case(answer.json())

    def log(self, id: str, number: int) -> Operation[Job]:
        # The address says which: asked twice, it is the same log.
        answer = yield from self.settings.call("POST", self.path(id, "cases", str(number), "log"))
        return read(Job, answer.json())


def blind_case(item: Json) -> BlindCase:
    """A row of the cases of a blind bench."""
    return read(BlindCase, {**item, "seed": int(item["seed"])})


def verdict_codes(verdict: int | Sequence[int] | None) -> str | None:
    """Codes as a filter has them."""
    if verdict is None:
        return None
    return ",".join(str(code) for code in ([verdict] if isinstance(verdict, int) else verdict))


class RunOperations(JobOperations[Run]):
    """What only runs have."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, "runs", lambda data: read(Run, data))

    def fork(self, id: str, body: Mapping[str, Any], key: str | None) -> Operation[Run]:
        return (yield from self.submit(body, key, self.path(id, "fork")))

    def verify(self, id: str) -> Operation[Verification]:
        # As long as the flight takes in one process, plus its time in the queue: the server answers 202 now and then, and the same key goes on
        # waiting for the same job.
        headers = {"idempotency-key": new_key()}
        while True:
            answer = yield from self.settings.call("POST", self.path(id, "verify"), headers=headers, timeout_s=60.0)
            if answer.status_code != 202:
                return read(Verification, answer.json())

    def compare_controllers(self, ids: Sequence[str], within_m: float | None) -> Operation[Json]:
        params = {"runs": ",".join(ids), "within_m": within_m}
        answer = yield from self.settings.call("GET", "/api/v1/controllers", params=params)
        table: Json = answer.json()
        return table

    def autopilots(self) -> Operation[list[Autopilot]]:
        answer = yield from self.settings.call("GET", "/api/v1/autopilots")
        return [read(Autopilot, item) for item in answer.json()["items"]]

    def ticket(self, id: str) -> Operation[list[Ticket]]:
        answer = yield from self.settings.call("GET", self.path(id, "ticket"))
        return [read(Ticket, item) for item in answer.json()["peers"]]

    def samples_of(self, ids: Sequence[str], channels: Sequence[str], query: Mapping[str, Any]) -> Operation[bytes]:
        params = {"runs": ",".join(ids), "channels": ",".join(channels), "format": "parquet", **query}
        answer = yield from self.settings.call("GET", "/api/v1/telemetry", params=params)
        return answer.content

    def table(self, columns: Sequence[str], filters: Mapping[str, Any]) -> Operation[RunTable]:
        params = {"columns": ",".join(columns), **filters}
        answer = yield from self.settings.call("GET", "/api/v1/table", params=params)
        table = read(RunTable, answer.json())
        # A text, as no number of JavaScript holds all seeds.
        seed = table.columns.index("seed")
        return RunTable(table.columns, [[*row[:seed], int(row[seed]), *row[seed + 1 :]] for row in table.rows])

    def columns(self, filters: Mapping[str, Any]) -> Operation[list[str]]:
        answer = yield from self.settings.call("GET", "/api/v1/table", params=filters)
        return [str(name) for row in answer.json()["rows"] for name in row]

    def geometry(self, id: str) -> Operation[VehicleGeometry]:
        return (yield from geometry(self.settings, self.path(id)))


def geometry(settings: Settings, path: str, at: str | None = None) -> Operation[VehicleGeometry]:
    """Of a run, a vehicle or a model."""
    answer = yield from settings.call("GET", f"{path}/geometry", params={"at": at})
    return read(VehicleGeometry, answer.json())


def limits(settings: Settings) -> Operation[Limits]:
    """Of the caller's account."""
    answer = yield from settings.call("GET", "/api/v1/limits")
    return read(Limits, answer.json())


def identity(settings: Settings) -> Operation[Identity]:
    """Of the caller."""
    answer = yield from settings.call("GET", "/api/v1/session")
    return read(Identity, answer.json())


def job_operations(settings: Settings, kind: str) -> JobOperations[Job]:
    """Of a kind of job that has no class of its own."""
    return JobOperations(settings, kind, lambda data: read(Job, data))


class LibraryOperations:
    """Documents that jobs can name: the server's and one's own."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings

    def effect_picture(
        self, effect: str, vehicle: str, rotor: int | None, parameters: Mapping[str, float], flight: str | None
    ) -> Operation[Json]:
        values = ",".join(f"{name}:{value!r}" for name, value in parameters.items())
        params = {"vehicle": vehicle, "rotor": rotor, "parameters": values or None, "flight": flight}
        path = f"/api/v1/catalogue/{in_path(effect)}/picture"
        answer = yield from self.settings.call("GET", path, params=params, timeout_s=max(130.0, self.settings.timeout_s))
        picture: Json = answer.json()
        return picture

    def catalogue(self) -> Operation[list[Json]]:
        answer = yield from self.settings.call("GET", "/api/v1/catalogue")
        return [dict(item) for item in answer.json()["items"]]

    def geometry(self, kind: str, name: str, at: str | None = None) -> Operation[VehicleGeometry]:
        return (yield from geometry(self.settings, f"/api/v1/{kind}/{in_path(name)}", at))

    def names(self, kind: str, own: bool) -> Operation[list[str]]:
        answer = yield from self.settings.call("GET", f"/api/v1/{kind}")
        return [str(name) for name in answer.json()["own" if own else "items"]]

    def text(self, kind: str, name: str) -> Operation[str]:
        answer = yield from self.settings.call("GET", f"/api/v1/{kind}/{in_path(name)}")
        return answer.text

    def put(self, kind: str, name: str, text: str, only_new: bool, replaces: str | None) -> Operation[str]:
        headers = {"content-type": "application/toml"}
        if only_new:
            headers["if-none-match"] = "*"
        if replaces is not None:
            headers["if-match"] = f'"{replaces}"'
        path = f"/api/v1/{kind}/{in_path(name)}"
        answer = yield from self.settings.call("PUT", path, content=text.encode(), headers=headers, ok_when_repeated=(412,))
        if answer.status_code == 412:
            # The first attempt succeeded and its answer was lost, or another client wrote in between.
            there = yield from self.settings.call("GET", path)
            if there.text != text:
                raise problem_of(answer)
            return str(there.headers.get("etag", "")).strip('"')
        return str(answer.json()["hash"])

    def delete(self, kind: str, name: str) -> Operation[None]:
        yield from self.settings.call("DELETE", f"/api/v1/{kind}/{in_path(name)}", ok_when_repeated=(404,))

    def check(self, kind: str, text: str) -> Operation[Validation]:
        answer = yield from self.settings.call("POST", f"/api/v1/{kind}/validate", json={"text": text})
        return read(Validation, answer.json())

    def validate(self, body: Json) -> Operation[Validation]:
        answer = yield from self.settings.call("POST", "/api/v1/scenarios/validate", json=body)
        return read(Validation, answer.json())

    def ready(self) -> Operation[bool]:
        yield from self.settings.call("GET", "/readyz")
        return True


def scenario_body(
    scenario: str | Path | None, text: str | None, documents: str | None, changes: Mapping[str, Any] | Sequence[str]
) -> Json:
    """Which scenario a request means."""
    body: Json = {}
    if isinstance(scenario, Path):
        if text is not None:
            raise ValueError("give a path or a text, not both")
        text = scenario.read_text(encoding="utf-8")
    elif scenario is not None:
        body["scenario"] = scenario
    if text is not None:
        body["text"] = text
    if documents is not None:
        body["documents"] = documents
    if changes:
        items = changes.items() if isinstance(changes, Mapping) else None
        body["set"] = list(changes) if items is None else [f"{key}={toml_value(value)}" for key, value in items]
    return body


def as_text(document: str | Path) -> str:
    """A document, from a file or as it is."""
    return document.read_text(encoding="utf-8") if isinstance(document, Path) else document


def campaign_body(campaign: str | Path | None, text: str | None) -> Json:
    """Which campaign a request means."""
    if isinstance(campaign, Path):
        return {"text": campaign.read_text(encoding="utf-8")}
    return {"campaign": campaign, "text": text}


def bench_body(presets: Sequence[str], n: int, seed: int, vehicles: Sequence[str | Path], duration_s: float) -> Json:
    """Which blind bench a request means."""
    sent = [_bench_vehicle(vehicle) for vehicle in vehicles]
    return {"presets": list(presets), "n": n, "seed": seed, "vehicles": sent, "duration_s": duration_s}


def _bench_vehicle(vehicle: str | Path) -> Json:
    """A name of the library, or a file here with the blades that it names."""
    if not isinstance(vehicle, Path):
        return {"vehicle": vehicle}
    text = vehicle.read_text(encoding="utf-8")
    body: Json = {"vehicle": vehicle.stem, "text": text}
    # Python 3.10 has no TOML parser: the only key needed is on a line of its own.
    named = re.search(r"""^\s*blades\s*=\s*(["'])(.+?)\1""", text, re.MULTILINE)
    if named:
        body["blades"] = (vehicle.parent / named[2]).read_text(encoding="utf-8")
    return body


def toml_value(value: Any) -> str:
    """A value as the server's `set` reads it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    if isinstance(value, (int, float)):
        return repr(value)
    raise TypeError(f"cannot set {value!r}; expected a number, a text, true or false, or a list of them")


def as_table(data: bytes, columns: Sequence[str] | None) -> pyarrow.Table:
    """Parquet as an Arrow table."""
    try:
        import pyarrow.parquet
    except ImportError as error:
        raise RotortwinError("telemetry needs pyarrow: pip install 'rotortwin[arrow]'") from error
    return pyarrow.parquet.read_table(io.BytesIO(data), columns=None if columns is None else list(columns))


def as_frame(data: bytes, columns: Sequence[str] | None) -> pandas.DataFrame:
    """Parquet as a pandas data frame."""
    try:
        import pandas
    except ImportError as error:
        raise RotortwinError("a data frame needs pandas: pip install 'rotortwin[pandas]'") from error
    frame = as_table(data, columns).to_pandas()
    if not isinstance(frame, pandas.DataFrame):
        raise UnexpectedAnswer("the telemetry is no table")
    return frame


class Watcher:
    """Reports the progress of a job."""

    def __init__(self, progress: Progress) -> None:
        self._tell: Callable[[Event], None] | None = None
        self._drawn = False
        if callable(progress):
            self._tell = progress
        elif progress:
            self._tell = self._draw

    def see(self, event: Event) -> None:
        if self._tell is not None:
            self._tell(event)

    def _draw(self, event: Event) -> None:
        share = event.share
        if share is None:
            return
        full = round(28 * share)
        time = event.data.get("sim_time_s")
        words = f"  t {time:5.1f} s" if isinstance(time, float) else ""
        sys.stderr.write(f"\r{'━' * full}{'─' * (28 - full)} {100 * share:3.0f} %{words}")
        sys.stderr.flush()
        self._drawn = True

    def close(self) -> None:
        if self._drawn:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
