"""The blocking client."""

# Made from aio.py by generate_sync.py: change that file.

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import TYPE_CHECKING, Any, TypeVar

import httpx

from ._resource import Resource, fetched, followed
from ._exchange import Operation, Settings, drive
from ._models import MAIN, ModelOperations
from ._operations import (
    BlindBenchOperations,
    CampaignOperations,
    LibraryOperations,
    RunOperations,
    as_frame,
    as_table,
    as_text,
    bench_body,
    campaign_body,
    identity,
    job_operations,
    limits,
    query_files,
    scenario_body,
    verdict_codes,
)
from ._stream import Download, FollowAll
from ._transport import Transport
from .fdi import Fdi
from .twin import (
    Classifiers,
    Comparisons,
    Diagnoses,
    Identifications,
    Improvements,
    Logs,
    NextFlights,
)
from .models import (
    Autopilot,
    BlindCase,
    CampaignFlight,
    Channel,
    Controller,
    ExportFormat,
    Identity,
    Job,
    Json,
    LibraryCampaign,
    Limits,
    Link,
    Pace,
    Place,
    PlacedEvent,
    QueryAnswer,
    Run,
    RunTable,
    Status,
    Ticket,
    Validation,
    VehicleGeometry,
    Verification,
)

if TYPE_CHECKING:
    import pandas
    import pyarrow

T = TypeVar("T")

#: The server writes an export before it sends it, s.
_EXPORT_S = 600.0


class Jobs(Resource[Job]):
    """Jobs of a kind that has no class of its own here."""

    def submit(self, *, idempotency_key: str | None = None, **body: Any) -> Job:
        """Submits one; the fields are those of the kind in the OpenAPI document."""
        return self._do(self._operations.submit(body, idempotency_key))


class Campaigns(Resource[Job]):
    """Many flights: grids and random draws, with statistics of the detectors."""

    _operations: CampaignOperations

    def __init__(self, transport: Transport) -> None:
        super().__init__(transport, CampaignOperations(transport.settings))

    def submit(
        self,
        campaign: str | Path | None = None,
        *,
        text: str | None = None,
        classifier: str | None = None,
        priority: int = 0,
        max_wall_s: int | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Submits a campaign: a name of the server's library, a `Path` of a file here, or a text.

        classifier: id of one that was trained on the server, for the network in every flight.
        """
        body = campaign_body(campaign, text) | {"priority": priority, "max_wall_s": max_wall_s}
        body |= {} if classifier is None else {"classifier": classifier}
        return self._do(self._operations.submit(body, idempotency_key))

    def flights(
        self,
        id: str,
        *,
        detector: str = "sequential",
        truth: int | None = None,
        verdict: int | Sequence[int] | None = None,
        status: str | None = None,
        page_size: int = 100,
    ) -> Iterator[CampaignFlight]:
        """Its flights, or those with windows in a cell of a detector's confusion matrix, page by page as they are asked for.

        detector: `sequential`, `network`, `t_test`. truth: 0 healthy, a rotor from 1, -1 several. verdict: a code, or several: 0 healthy, a
        rotor from 1, 100 i + j two rotors, -1 unknown fault, -3 ambiguous. status: `done`, `failed`, `refused`.
        """
        filters = {"detector": detector, "truth": truth, "verdict": verdict_codes(verdict), "status": status, "limit": page_size}
        cursor: str | None = None
        while True:
            items, cursor = self._do(self._operations.flights(id, filters, cursor))
            for item in items:
                yield item
            if cursor is None:
                return

    def library(self) -> Sequence[LibraryCampaign]:
        """The campaigns that `submit` can name."""
        return self._do(self._operations.library())

    def fly(self, id: str, flight: int) -> Run:
        """One of its flights as a run, with the seed and scenario of that flight: the same run hash. Asked for again, the same run."""
        return self._do(self._operations.fly(id, flight))


class BlindBenches(Resource[Job]):
    """Tests of the diagnosis: logs with hidden effects, diagnosed and scored."""

    _operations: BlindBenchOperations

    def __init__(self, transport: Transport) -> None:
        super().__init__(transport, BlindBenchOperations(transport.settings))

    def submit(
        self,
        n: int,
        *,
        presets: Sequence[str] = ("mixed",),
        seed: int = 1,
        vehicles: Sequence[str | Path] = (),
        duration_s: float = 90.0,
        priority: int = 0,
        max_wall_s: int | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Submits a bench: n cases of each preset (`singles`, `pairs`, `null`, …), done in parts by all workers.

        vehicles: names of the server's library, or a `Path` of a file here, which is sent with its blades; taken in turn, `f550` without.
        The result is the score sheet; `rows.parquet` among the files has a row for each case.
        """
        body = bench_body(presets, n, seed, vehicles, duration_s) | {"priority": priority, "max_wall_s": max_wall_s}
        return self._do(self._operations.submit(body, idempotency_key))

    def cases(
        self,
        id: str,
        *,
        hidden: str | None = None,
        named: str | None = None,
        outcome: str | None = None,
        preset: str | None = None,
        page_size: int = 100,
    ) -> Iterator[BlindCase]:
        """Its cases, or those in a cell of the confusion matrix, page by page as they are asked for.

        hidden: a row of the matrix, such as `rotor-drag`. named: a column, such as `nothing`. outcome: `right`, `missed`, `false-alarm`, …
        """
        filters = {"hidden": hidden, "named": named, "outcome": outcome, "preset": preset, "limit": page_size}
        cursor: str | None = None
        while True:
            items, cursor = self._do(self._operations.cases(id, filters, cursor))
            for item in items:
                yield item
            if cursor is None:
                return

    def case(self, id: str, number: int) -> BlindCase:
        """One of its cases, with `truth` and `diagnosis`."""
        return self._do(self._operations.case(id, number))

    def log(self, id: str, number: int) -> Job:
        """The log of one of its cases, flown again with its seed: a job of `logs`. Asked for again, the same log."""
        return self._do(self._operations.log(id, number))

    def rows(self, id: str) -> pyarrow.Table:
        """What became of each case, as an Arrow table."""
        return as_table(self.artifact(id, "rows.parquet"), None)

    def report(self, id: str) -> str:
        """The report (HTML)."""
        return (self.artifact(id, "report.html")).decode()


class Runs(Resource[Run]):
    """Flights."""

    _operations: RunOperations

    def __init__(self, transport: Transport) -> None:
        super().__init__(transport, RunOperations(transport.settings))

    def submit(
        self,
        scenario: str | Path | None = None,
        *,
        text: str | None = None,
        documents: str | None = None,
        set: Mapping[str, Any] | Sequence[str] = (),
        seed: int | None = None,
        link: Link = "iceoryx2",
        pace: Pace = "fast",
        priority: int = 0,
        controller: Controller = "beside",
        fdi: Place = "beside",
        classifier: str | None = None,
        model: Mapping[str, str] | None = None,
        fdi_model: Mapping[str, str] | None = None,
        join_timeout_ms: int | None = None,
        max_wall_s: int | None = None,
        max_sim_s: float | None = None,
        idempotency_key: str | None = None,
    ) -> Run:
        """Submits a flight; when this returns it is on the server's disk, and will end.

        scenario: a name of the server's library, with keys changed by `set`; or a `Path` of a file here, which is sent.
        model, fdi_model: what flies, and the model assumed by the detectors: `{"model": NAME}` of the library, `{"improvement": ID}`, …
        text: a scenario document instead. documents: all documents of a run, as its summary holds them.
        idempotency_key: the same key gives the same run; by default a new one, kept over the tries of this call.
        """
        body = scenario_body(scenario, text, documents, set)
        body |= {"seed": seed, "link": link, "pace": pace, "priority": priority, "controller": controller, "fdi": fdi}
        given: dict[str, Any] = {"classifier": classifier, "model": model, "fdi_model": fdi_model, "join_timeout_ms": join_timeout_ms}
        given |= {"max_wall_s": max_wall_s, "max_sim_s": max_sim_s}
        body |= {key: value for key, value in given.items() if value is not None}
        return self._do(self._operations.submit(body, idempotency_key))

    def fork(
        self,
        id: str,
        *,
        healthy: bool = False,
        seed: int | None = None,
        priority: int = 0,
        idempotency_key: str | None = None,
    ) -> Run:
        """The same flight with a difference."""
        body = {"healthy": healthy, "seed": seed, "priority": priority}
        return self._do(self._operations.fork(id, body, idempotency_key))

    def verify(self, id: str) -> Verification:
        """Flies it again in one process and compares the run hash."""
        return self._do(self._operations.verify(id))

    def table(
        self,
        columns: Sequence[str],
        *,
        name: str | None = None,
        parent: str | None = None,
        status: Status = "done",
        limit: int | None = None,
    ) -> RunTable:
        """Runs side by side, latest first: a row for each with `id`, `name`, `vehicle`, `seed`, `run_hash` and these numbers of its summary.

        columns: such as `steps`, `detectors.sequential.delay_s`; `columns` says which there are, and `Unprocessable` is raised for one that
        no summary can have. name: of the scenario. parent: only runs forked from this one, or flights of this campaign. limit: most rows;
        20,000 without it, and never more.
        """
        if not columns:
            raise ValueError("no columns; expected names of numbers of a summary, which `columns` lists")
        return self._do(self._operations.table(columns, {"name": name, "parent": parent, "status": status, "limit": limit}))

    def columns(self, *, name: str | None = None, parent: str | None = None, status: Status = "done") -> Sequence[str]:
        """Columns that `table` can have for such runs, by the summaries of the latest of them."""
        return self._do(self._operations.columns({"name": name, "parent": parent, "status": status}))

    def compare_controllers(self, ids: Sequence[str], *, within_m: float | None = None) -> Json:
        """Runs of one scenario that different controllers have flown: `rows` with tracking, energy, what the fault did and what was seen of it.

        within_m: a vehicle has recovered when it stays so close to its reference, 0.5 m without it. `differences` says in what the runs
        differ besides their controllers.
        """
        return self._do(self._operations.compare_controllers(ids, within_m))

    def autopilots(self) -> Sequence[Autopilot]:
        """The autopilots that a run can name: `controller={"autopilot": NAME}`."""
        return self._do(self._operations.autopilots())

    def telemetry(self, id: str, columns: Sequence[str] | None = None) -> pyarrow.Table:
        """Its samples, every step, as an Arrow table."""
        return as_table(self.artifact(id, "telemetry.parquet"), columns)

    def telemetry_frame(self, id: str, columns: Sequence[str] | None = None) -> pandas.DataFrame:
        """Its samples, every step, as a pandas data frame."""
        return as_frame(self.artifact(id, "telemetry.parquet"), columns)

    def flight(self, id: str) -> Json:
        """The flight as a page draws it: `track`, `height_m`, `parts` and events, `outputs` of the motors, `vibration`."""
        return self._do(self._operations.flight(id))

    def geometry(self, id: str) -> VehicleGeometry:
        """What its vehicle looks like: rotors with places and spins, effectiveness, hover at the initial charge of the run."""
        return self._do(self._operations.geometry(id))

    def export(self, id: str, format: ExportFormat, target: str | Path) -> Path:
        """The whole run as one file to `target`: `ulog` (PX4 tools), `mcap` (Foxglove), `parquet`, `csv`.

        The same run gives the same bytes each time. One that has not ended raises `Conflict`. A download of `ulog` or `csv` that is cut off
        begins again: the server writes such a file anew each time.
        """
        path = self._operations.path(id, "export")
        timeout_s = max(_EXPORT_S, self._transport.settings.timeout_s)
        download = Download(self._transport.settings, path, Path(target), params={"format": format}, timeout_s=timeout_s)
        return fetched(self._transport, download)

    def ticket(self, id: str) -> Sequence[Ticket]:
        """How parts from elsewhere join; there once the plant waits for them (event `join`)."""
        return self._do(self._operations.ticket(id))

    def channels(self, id: str) -> Sequence[Channel]:
        """What was recorded of it."""
        return self._do(self._operations.channels(id))

    def samples(
        self,
        id: str | Sequence[str],
        channels: Sequence[str],
        *,
        from_s: float | None = None,
        to_s: float | None = None,
        points: int | None = None,
    ) -> pyarrow.Table:
        """Some channels in an interval, with as many rows as a picture needs: the server keeps least and largest value of each bucket.

        id: of a run, or of several that are to be compared (then the first column is `run`). channels: names; one `*` stands for
        anything (`duty_*`). points: most rows of a run, 2000 without it.
        """
        query = {"from_s": from_s, "to_s": to_s, "points": points}
        if isinstance(id, str):
            return as_table(self._do(self._operations.samples(id, channels, query)), None)
        return as_table(self._do(self._operations.samples_of(id, channels, query)), None)


class Library:
    """Documents of one kind: the server's, and one's own."""

    def __init__(self, transport: Transport, kind: str) -> None:
        self._transport = transport
        self._kind = kind
        self._operations = LibraryOperations(transport.settings)

    def list(self, *, own: bool = False) -> Sequence[str]:
        """Their names. own: only of those that one has left there."""
        return drive(self._transport.http, self._operations.names(self._kind, own))

    def get(self, name: str) -> str:
        """One of them (TOML)."""
        return drive(self._transport.http, self._operations.text(self._kind, name))

    def put(self, name: str, document: str | Path, *, only_new: bool = False, replaces: str | None = None) -> str:
        """Leaves one there, on one's own account; it hides the server's of the same name. Its content hash.

        document: a text (TOML), or the `Path` of a file here. only_new: refused with `Conflict` if one has left such a one already.
        replaces: content hash of the one that is there; `Conflict` if it has changed meanwhile.
        A document that is refused raises `Unprocessable`, whose `complaints` are all that is wrong with it.
        """
        operation = self._operations.put(self._kind, name, as_text(document), only_new, replaces)
        return drive(self._transport.http, operation)

    def delete(self, name: str) -> None:
        """Takes away what one has left there."""
        drive(self._transport.http, self._operations.delete(self._kind, name))

    def check(self, document: str | Path) -> Validation:
        """All that is wrong with a document."""
        return drive(self._transport.http, self._operations.check(self._kind, as_text(document)))


class Vehicles(Library):
    """Vehicles that the server has."""

    def geometry(self, name: str) -> VehicleGeometry:
        """What one looks like: rotors with places and spins, effectiveness, hover with a full battery."""
        return drive(self._transport.http, self._operations.geometry(self._kind, name))


class Effects(Library):
    """Effects of one's own; and what each effect of the catalogue does."""

    def catalogue(self) -> Sequence[Json]:
        """The effects that a model can have, built-in and of the library: `id`, `equation`, `parameters` with units, `excited_by`, `source`, …"""
        return drive(self._transport.http, self._operations.catalogue())

    def picture(
        self,
        effect: str,
        vehicle: str = "f550",
        *,
        rotor: int | None = None,
        parameters: Mapping[str, float] = MappingProxyType({}),
        flight: str | None = None,
    ) -> Json:
        """What an effect does to the `channels` of a simulated flight, over time and over the conditions that excite it.

        rotor: from 1, of an effect of one rotor. parameters: by name, typical values without them. flight: manoeuvre, the one that shows it
        best without it.
        """
        operation = self._operations.effect_picture(effect, vehicle, rotor, parameters, flight)
        return drive(self._transport.http, operation)


class Scenarios(Library):
    """Scenarios that the server has."""

    def validate(
        self, scenario: str | Path | None = None, *, text: str | None = None, set: Mapping[str, Any] | Sequence[str] = ()
    ) -> Validation:
        """Checks a scenario without flying it."""
        body = scenario_body(scenario, text, None, set)
        return drive(self._transport.http, self._operations.validate(body))


class Models(Library):
    """Versioned models: add, undo, branch."""

    def __init__(self, transport: Transport) -> None:
        super().__init__(transport, "models")
        self._models = ModelOperations(transport.settings)

    def create(self, name: str, model: Mapping[str, str]) -> Json:
        """Begins a model: model is `{"vehicle": NAME}`, `{"model": NAME}`, `{"improvement": ID}` or `{"version": TOML}`; its history."""
        return self._do(self._models.create(name, model))

    def history(self, name: str) -> Json:
        """All versions, oldest first, and where the branches stand."""
        return self._do(self._models.history(name))

    def version(self, name: str, at: str = MAIN) -> Json:
        """One version in short; at: `v1`, or a branch."""
        return self._do(self._models.version(name, at))

    def export(self, name: str, at: str = MAIN) -> str:
        """The file that says everything of a version (TOML)."""
        return self._do(self._models.export(name, at))

    def geometry(self, name: str, at: str = MAIN) -> VehicleGeometry:
        """What the vehicle of a version looks like, without the effects; at: `v1`, or a branch."""
        return self._do(self._operations.geometry(self._kind, name, at))

    def diff(self, name: str, before: str, after: str = MAIN) -> Json:
        """What differs between two versions."""
        return self._do(self._models.diff(name, before, after))

    def add(
        self,
        name: str,
        *,
        diagnosis: str | None = None,
        pick: int | None = None,
        proposal: bool = False,
        effect: Mapping[str, Any] | None = None,
        branch: str = MAIN,
        note: str = "",
        seen: str | None = None,
    ) -> Json:
        """Makes the next version: with what a diagnosis found (pick: only this one of it, from 1; proposal: what it proposes), or with an
        effect by hand, `{"effect": ID, "parameters": {…}}`.

        seen: content hash of the version that it is to follow, by default the one at which the branch stands now; `Conflict` if the branch
        has moved on. What was added is in `difference`.
        """
        body = {"diagnosis": diagnosis, "pick": pick, "proposal": proposal, "effect": effect, "note": note}
        return self._do(self._models.add(name, branch, seen, body))

    def undo(self, name: str, *, branch: str = MAIN, seen: str | None = None) -> Json:
        """Puts a branch back to the version before; no version goes."""
        return self._do(self._models.undo(name, branch, seen))

    def branch(self, name: str, branch: str, at: str = MAIN) -> Json:
        """Makes a branch at a version or at the head of another branch; the history."""
        return self._do(self._models.make_branch(name, branch, at))

    def _do(self, operation: Operation[T]) -> T:
        return drive(self._transport.http, operation)


class Client:
    """A rotortwin server.

    url: such as `http://127.0.0.1:8400`. token: for servers that ask for one. ca: file of the authority that signed the server's
    certificate. patience_s: how long to try again when the server cannot be reached. timeout_s: longest silence within one answer.
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8400",
        token: str | None = None,
        *,
        ca: str | None = None,
        patience_s: float = 60.0,
        timeout_s: float = 30.0,
    ) -> None:
        settings = Settings(url.rstrip("/"), token, ca, patience_s, timeout_s)
        transport = Transport(settings, httpx.Client(verify=settings.verify()))
        self._transport = transport
        self.runs = Runs(transport)
        self.campaigns = Campaigns(transport)
        self.blind_benches = BlindBenches(transport)
        self.logs = Logs(transport)
        self.comparisons = Comparisons(transport)
        self.diagnoses = Diagnoses(transport)
        self.improvements = Improvements(transport)
        self.next_flights = NextFlights(transport)
        self.identifications = Identifications(transport)
        self.classifiers = Classifiers(transport)
        self.verifications = Resource[Job](transport, job_operations(settings, "verifications"))
        self.fdi = Fdi(transport)
        self.scenarios = Scenarios(transport, "scenarios")
        self.vehicles = Vehicles(transport, "vehicles")
        self.blades = Library(transport, "blades")
        self.effects = Effects(transport, "effects")
        self.models = Models(transport)

    def jobs(self, kind: str) -> Jobs:
        """Jobs of any kind that the server has, by the name in its addresses."""
        return Jobs(self._transport, job_operations(self._transport.settings, kind))

    def query(
        self,
        sql: str,
        *,
        runs: Sequence[str] = (),
        campaigns: Sequence[str] = (),
        blind_benches: Sequence[str] = (),
        rows: int = 1000,
    ) -> QueryAnswer:
        """SQL over the Parquet files of jobs, answered by the server: 30 s and 32 MiB at most.

        Tables are called as the files (`telemetry`, `campaign`, …); their column `folder` begins with the id of the job. One SELECT in
        DuckDB's SQL, which reaches the files of these jobs and nothing else. `runs.query` and the like fetch the files instead, and have
        no such limits.
        """
        operation = query_files(self._transport.settings, sql, runs, campaigns, blind_benches, rows)
        return drive(self._transport.http, operation)

    def events(self, *, after: str | None = None, progress: bool = True, wait: bool = True) -> Iterator[PlacedEvent]:
        """The events of all jobs of the caller as they happen, over broken connections and restarts of the server, without gaps.

        The first is `open`, at the place of now: what is listed after it misses nothing. after: the `place` of the last event that was seen;
        the stream resumes after it, without `open`. progress: with the events `progress`, the most frequent ones. wait: False ends with what
        there is now. Parts of campaigns and benches are left out. An unknown place raises `BadRequest`.
        """
        for event in followed(self._transport, FollowAll(self._transport.settings, after, progress, wait)):
            yield event

    def limits(self) -> Limits:
        """What the caller's account may have, and has: bytes of all files, jobs that wait or run, size of a log."""
        return drive(self._transport.http, limits(self._transport.settings))

    def identity(self) -> Identity:
        """Who the caller is for the server, and whether it asks for a token; also answered without one."""
        return drive(self._transport.http, identity(self._transport.settings))

    def ready(self) -> bool:
        """The server takes work; raises otherwise."""
        return drive(self._transport.http, LibraryOperations(self._transport.settings).ready())

    def close(self) -> None:
        """Closes all connections."""
        self._transport.http.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
