"""The blocking client."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import httpx

from ._exchange import Settings, drive
from ._operations import (
    LibraryOperations,
    RunOperations,
    as_frame,
    as_table,
    as_text,
    bench_body,
    campaign_body,
    job_operations,
    scenario_body,
)
from ._resource import Resource
from .fdi import Fdi
from .models import Channel, Job, Link, Pace, Place, Run, Ticket, Validation, Verification
from .twin import Classifiers, Comparisons, Diagnoses, Improvements, Logs

if TYPE_CHECKING:
    import pandas
    import pyarrow

class Jobs(Resource[Job]):
    """Jobs of a kind that has no class of its own here."""

    def submit(self, *, idempotency_key: str | None = None, **body: Any) -> Job:
        """Submits one; the fields are those of the kind in the OpenAPI document."""
        return self._do(self._operations.submit(body, idempotency_key))


class Campaigns(Resource[Job]):
    """Many flights: grids and random draws, with statistics of the detectors."""

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


class BlindBenches(Resource[Job]):
    """Does the diagnosis find what is missing in a model? Logs with hidden effects, diagnosed and scored."""

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

    def rows(self, id: str) -> pyarrow.Table:
        """What became of each case, as an Arrow table."""
        return as_table(self.artifact(id, "rows.parquet"), None)

    def report(self, id: str) -> str:
        """The report (HTML)."""
        return (self.artifact(id, "report.html")).decode()


class Runs(Resource[Run]):
    """Flights."""

    _operations: RunOperations

    def __init__(self, client: Client) -> None:
        super().__init__(client, RunOperations(client._settings))

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
        controller: Place = "beside",
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
        model, fdi_model: what flies, and what the detectors believe in: `{"model": NAME}` of the library, `{"improvement": ID}`, …
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

    def telemetry(self, id: str, columns: Sequence[str] | None = None) -> pyarrow.Table:
        """Its samples, every step, as an Arrow table."""
        return as_table(self.artifact(id, "telemetry.parquet"), columns)

    def telemetry_frame(self, id: str, columns: Sequence[str] | None = None) -> pandas.DataFrame:
        """Its samples, every step, as a pandas data frame."""
        return as_frame(self.artifact(id, "telemetry.parquet"), columns)

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
        return as_table(self._do(self._operations.samples(id, channels, query)), None)


class Library:
    """Documents of one kind: the server's, and one's own."""

    def __init__(self, client: Client, kind: str) -> None:
        self._client = client
        self._kind = kind
        self._operations = LibraryOperations(client._settings)

    def list(self) -> Sequence[str]:
        """Their names."""
        return drive(self._client._http, self._operations.names(self._kind))

    def get(self, name: str) -> str:
        """One of them (TOML)."""
        return drive(self._client._http, self._operations.text(self._kind, name))

    def put(self, name: str, document: str | Path, *, only_new: bool = False) -> None:
        """Leaves one there, on one's own account; it hides the server's of the same name.

        document: a text (TOML), or the `Path` of a file here. only_new: refused with `Conflict` if one has left such a one already.
        A document that is refused raises `Unprocessable`, whose `complaints` are all that is wrong with it.
        """
        drive(self._client._http, self._operations.put(self._kind, name, as_text(document), only_new))

    def delete(self, name: str) -> None:
        """Takes away what one has left there."""
        drive(self._client._http, self._operations.delete(self._kind, name))

    def check(self, document: str | Path) -> Validation:
        """All that is wrong with a document."""
        return drive(self._client._http, self._operations.check(self._kind, as_text(document)))


class Scenarios(Library):
    """Scenarios that the server has."""

    def validate(
        self, scenario: str | Path | None = None, *, text: str | None = None, set: Mapping[str, Any] | Sequence[str] = ()
    ) -> Validation:
        """Checks a scenario without flying it."""
        body = scenario_body(scenario, text, None, set)
        return drive(self._client._http, self._operations.validate(body))


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
        self._settings = Settings(url.rstrip("/"), token, ca, patience_s, timeout_s)
        self._http = httpx.Client(verify=self._settings.verify())
        self.runs = Runs(self)
        self.campaigns = Campaigns(self, job_operations(self._settings, "campaigns"))
        self.blind_benches = BlindBenches(self, job_operations(self._settings, "blind-benches"))
        self.logs = Logs(self)
        self.comparisons = Comparisons(self)
        self.diagnoses = Diagnoses(self)
        self.improvements = Improvements(self)
        self.classifiers = Classifiers(self)
        self.fdi = Fdi(self)
        self.scenarios = Scenarios(self, "scenarios")
        self.vehicles = Library(self, "vehicles")
        self.blades = Library(self, "blades")
        self.effects = Library(self, "effects")
        self.models = Library(self, "models")

    def jobs(self, kind: str) -> Jobs:
        """Jobs of any kind that the server has, by the name in its addresses."""
        return Jobs(self, job_operations(self._settings, kind))

    def ready(self) -> bool:
        """The server takes work; raises otherwise."""
        return drive(self._http, LibraryOperations(self._settings).ready())

    def close(self) -> None:
        """Closes all connections."""
        self._http.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
