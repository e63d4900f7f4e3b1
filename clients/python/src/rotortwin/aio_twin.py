"""Logs, comparisons, diagnoses, improvements, classifiers for asyncio: the same names, to be awaited."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ._aio_resource import AsyncResource
from ._operations import as_frame, as_table
from ._transport import AsyncTransport
from ._twin import LogOperations, effect_text, flights_body, job_operations, model_body, without_none
from .models import Job, Json, Method

if TYPE_CHECKING:
    import pandas
    import pyarrow


#: The canonical log among the files of an import.
_LOG = "log.parquet"


class AsyncLogs(AsyncResource[Job]):
    """Flight logs of any source: upload, import, canonical form."""

    _operations: LogOperations

    def __init__(self, transport: AsyncTransport) -> None:
        super().__init__(transport, LogOperations(transport.settings))

    async def submit(
        self,
        log: str | Path | bytes,
        *,
        name: str | None = None,
        rate_hz: float | None = None,
        align: bool = False,
        damaged: bool = False,
        vehicle: str | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Uploads a log and has it imported; the same file, read in the same way, is one log, however often it is sent.

        log: a file here, or its bytes with a `name` (its ending says what it is: `csv`, `parquet`, PX4 `ulg`, ArduPilot `bin` or `log`).
        rate_hz: bring every column to this rate. align: take estimated delays out. damaged: take what can be read of a file whose
        checksum is wrong. vehicle: one of the server's vehicles, whose rotors the log must have.
        """
        query = without_none(rate_hz=rate_hz, align="true" if align else None, damaged="true" if damaged else None, vehicle=vehicle)
        return await self._do(self._operations.upload(log, name, query, idempotency_key))

    async def draft_mapping(self, id: str) -> Json:
        """A mapping for an uploaded CSV whose columns have names of their own, also where its import failed.

        `mapping` is the text that `submit_again` takes; `columns` and `rows` say what was recognised and why, `questions` what only the
        owner of the log knows.
        """
        return await self._do(self._operations.draft(id))

    async def submit_again(
        self,
        id: str,
        *,
        mapping: str | Path | None = None,
        rate_hz: float | None = None,
        align: bool = False,
        damaged: bool = False,
        vehicle: str | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Imports an uploaded log once more, in another way: another log, with the first one as its parent.

        mapping: a text or `Path`, as `rotortwin log map` and `draft_mapping` write it. The rest: as for `submit`.
        """
        body: Json = {"align": align, "damaged": damaged} | without_none(rate_hz=rate_hz, vehicle=vehicle)
        return await self._do(self._operations.again(id, mapping, body, idempotency_key))

    async def table(self, id: str, columns: Sequence[str] | None = None) -> pyarrow.Table:
        """An imported log as an Arrow table."""
        return as_table(await self.artifact(id, _LOG), columns)

    async def flight(self, id: str) -> Json:
        """The flight as a page draws it: `track`, `height_m`, `parts` and events, `outputs` of the motors, `vibration`."""
        return await self._do(self._operations.flight(id))

    async def frame(self, id: str, columns: Sequence[str] | None = None) -> pandas.DataFrame:
        """An imported log as a pandas data frame."""
        return as_frame(await self.artifact(id, _LOG), columns)


class AsyncTwin(AsyncResource[Job]):
    """A model compared with flights."""

    _kind: str

    def __init__(self, transport: AsyncTransport) -> None:
        super().__init__(transport, job_operations(transport.settings, self._kind))

    async def report(self, id: str) -> str:
        """The report (HTML)."""
        return (await self.artifact(id, "report.html")).decode()


class AsyncComparisons(AsyncTwin):
    """Where, when and how much a model and flights disagree."""

    _kind = "comparisons"

    async def submit(
        self,
        *,
        vehicle: str | None = None,
        improvement: str | None = None,
        version: str | Path | None = None,
        model: str | None = None,
        more_models: Sequence[str] = (),
        logs: Sequence[str] = (),
        runs: Sequence[str] = (),
        priority: int = 0,
        max_wall_s: int | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Holds one model against flights.

        The model is one of: vehicle, a name of the server's library; improvement, an id; version, a text or `Path` as `rotortwin model
        export` writes it; model, a name of `client.models`, also `NAME@v1` or `NAME@BRANCH`. more_models: such names, compared with the same
        flights, after it in the result. The flights are ids of imported logs and of runs; `ID@35:65` takes only these seconds.
        """
        body: Json = {"model": model_body(vehicle, improvement, version, model), "flights": flights_body(logs, runs), "priority": priority}
        if more_models:
            body["more_models"] = [{"model": name} for name in more_models]
        return await self._do(self._operations.submit(body | without_none(max_wall_s=max_wall_s), idempotency_key))


class AsyncDiagnoses(AsyncTwin):
    """The physical effect that a model lacks on flights, with evidence."""

    _kind = "diagnoses"

    async def submit(
        self,
        *,
        vehicle: str | None = None,
        improvement: str | None = None,
        version: str | Path | None = None,
        model: str | None = None,
        logs: Sequence[str] = (),
        runs: Sequence[str] = (),
        effects: Sequence[str | Path] = (),
        priority: int = 0,
        max_wall_s: int | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Names what a model lacks; model and flights as for a comparison. effects: documents of your own that may be named, too."""
        body: Json = {"model": model_body(vehicle, improvement, version, model), "flights": flights_body(logs, runs), "priority": priority}
        body |= {"effects": [effect_text(effect) for effect in effects]}
        return await self._do(self._operations.submit(body | without_none(max_wall_s=max_wall_s), idempotency_key))


class AsyncImprovements(AsyncTwin):
    """Compare, diagnose, add what is missing, compare again, until the model agrees."""

    _kind = "improvements"

    async def submit(
        self,
        vehicle: str | None = None,
        *,
        version: str | Path | None = None,
        logs: Sequence[str] = (),
        runs: Sequence[str] = (),
        held_out_logs: Sequence[str] = (),
        held_out_runs: Sequence[str] = (),
        priority: int = 0,
        max_wall_s: int | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Improves the nominal model of a vehicle (a name of the library, or a version without effects) on flights.

        The held-out flights are seen by no fit: they are the proof.
        """
        body: Json = {"model": model_body(vehicle, None, version), "flights": flights_body(logs, runs), "priority": priority}
        if held_out_logs or held_out_runs:
            body["held_out"] = flights_body(held_out_logs, held_out_runs)
        return await self._do(self._operations.submit(body | without_none(max_wall_s=max_wall_s), idempotency_key))

    async def model(self, id: str) -> str:
        """The version that it ended with (TOML), as `rotortwin model import` and `version=` of a comparison take it."""
        return (await self.artifact(id, "model.toml")).decode()


class AsyncClassifiers(AsyncResource[Job]):
    """Neural networks trained on the server; a run uses one by its id."""

    def __init__(self, transport: AsyncTransport) -> None:
        super().__init__(transport, job_operations(transport.settings, "classifiers"))

    async def submit(
        self,
        *,
        method: Method = "paper",
        scenario: str = "reference-flight",
        seeds: int = 5,
        first_seed: int = 1,
        hyperparameters: Json | None = None,
        priority: int = 0,
        idempotency_key: str | None = None,
    ) -> Job:
        """Trains one on flights of a scenario of the server's library, one data set a seed; the same seeds give the same bits.

        hyperparameters: what is trained otherwise than the method says: `epochs`, `hidden`, `optimiser` (`sgdm` or `adam`), `learning_rate`,
        `momentum`, `l2`, `batch`, `seed`.
        """
        body: Json = {"method": method, "scenario": scenario, "seeds": seeds, "first_seed": first_seed, "priority": priority}
        body |= without_none(hyperparameters=hyperparameters)
        return await self._do(self._operations.submit(body, idempotency_key))

    async def evaluate(
        self,
        id: str,
        *,
        scenario: str | None = None,
        repeats: int = 5,
        seed: int = 30_001,
        priority: int = 0,
        idempotency_key: str | None = None,
    ) -> Job:
        """Flies fresh flights of the protocol with one: a campaign, for `client.campaigns`."""
        body: Json = {"scenario": scenario, "repeats": repeats, "seed": seed, "priority": priority}
        return await self._do(self._operations.submit(body, idempotency_key, self._operations.path(id, "evaluations")))

    async def file(self, id: str) -> bytes:
        """The classifier's file (JSON)."""
        return await self.artifact(id, "classifier.json")
