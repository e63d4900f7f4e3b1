"""The client for asyncio: the same names, to be awaited."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import httpx

from ._exchange import Operation, Settings, drive_async
from ._operations import (
    J,
    JobOperations,
    LibraryOperations,
    Progress,
    RunOperations,
    Watcher,
    as_frame,
    as_table,
    campaign_body,
    job_operations,
    scenario_body,
)
from ._stream import Download, Follow, local_path
from .models import Artifact, Channel, Event, Job, Link, Pace, Place, Run, Status, Ticket, Validation, Verification

if TYPE_CHECKING:
    import pandas
    import pyarrow

T = TypeVar("T")


class AsyncResource(Generic[J]):
    """Jobs of one kind: the verbs that all of them have."""

    def __init__(self, client: AsyncClient, operations: JobOperations[J]) -> None:
        self._client = client
        self._operations = operations

    async def _do(self, operation: Operation[T]) -> T:
        return await drive_async(self._client._http, operation)

    async def get(self, id: str) -> J:
        """One of them."""
        return await self._do(self._operations.get(id))

    async def list(
        self, *, status: Status | None = None, name: str | None = None, page_size: int = 100, **filters: Any
    ) -> AsyncIterator[J]:
        """All of them, latest first, page by page as they are asked for."""
        cursor: str | None = None
        while True:
            page = self._operations.page(cursor, page_size, {"status": status, "name": name, **filters})
            items, cursor = await self._do(page)
            for item in items:
                yield item
            if cursor is None:
                return

    async def events(self, id: str, *, after: int = 0) -> AsyncIterator[Event]:
        """Every event from the first (or after number `after`) to `ended`, over broken connections and restarts of the server."""
        follow = Follow(self._client._settings, self._operations.path(id, "events"), after)
        while not follow.over:
            try:
                answer = await self._client._http.send(follow.request(), stream=True)
                try:
                    if answer.status_code == 200:
                        async for chunk in answer.aiter_bytes():
                            for event in follow.feed(chunk):
                                yield event
                            if follow.over:
                                return
                        pause = 0.1
                    else:
                        await answer.aread()
                        pause = follow.refused(answer)
                finally:
                    await answer.aclose()
            except httpx.TransportError as error:
                pause = follow.broke(error)
            # A stream that ends without `ended` and without news: the server is ending, or there will be no more.
            else:
                if answer.status_code == 200 and not follow.news and (await self.get(id)).ended:
                    return
            await asyncio.sleep(pause)

    async def wait(self, id: str, *, progress: Progress = False, check: bool = False) -> J:
        """The job once it has ended. `check`: raise `JobFailed` unless it was done."""
        watcher = Watcher(progress)
        try:
            async for event in self.events(id):
                watcher.see(event)
        finally:
            watcher.close()
        job = await self.get(id)
        return self._operations.checked(job) if check else job

    async def cancel(self, id: str) -> J:
        """Asks it to end; what it has done so far is kept."""
        return await self._do(self._operations.cancel(id))

    async def delete(self, id: str) -> None:
        """Deletes one that has ended, with its files."""
        await self._do(self._operations.delete(id))

    async def artifacts(self, id: str) -> Sequence[Artifact]:
        """Its files."""
        return await self._do(self._operations.artifacts(id))

    async def artifact(self, id: str, path: str) -> bytes:
        """A file of it, whole."""
        return await self._do(self._operations.artifact(id, path))

    async def download(self, id: str, path: str, target: str | Path) -> Path:
        """A file of it to `target`; goes on where an earlier call was cut off."""
        target = Path(target)
        download = Download(self._client._settings, self._operations.artifact_path(id, path), target)
        while True:
            pause = 0.0
            try:
                answer = await self._client._http.send(download.request(), stream=True)
                try:
                    if answer.status_code not in (200, 206):
                        await answer.aread()
                        pause = download.refused(answer)
                    elif download.begin(answer):
                        async for chunk in answer.aiter_bytes():
                            download.write(chunk)
                        if download.complete():
                            return target
                finally:
                    download.close()
                    await answer.aclose()
            except httpx.TransportError as error:
                pause = download.broke(error)
            await asyncio.sleep(pause)

    async def download_all(self, id: str, folder: str | Path) -> Path:
        """All its files into a folder."""
        folder = Path(folder)
        for artifact in await self.artifacts(id):
            await self.download(id, artifact.path, local_path(folder, artifact.path))
        return folder


class AsyncJobs(AsyncResource[Job]):
    """Jobs of a kind that has no class of its own here."""

    async def submit(self, *, idempotency_key: str | None = None, **body: Any) -> Job:
        """Submits one; the fields are those of the kind in the OpenAPI document."""
        return await self._do(self._operations.submit(body, idempotency_key))


class AsyncCampaigns(AsyncResource[Job]):
    """Many flights: grids and random draws, with statistics of the detectors."""

    async def submit(
        self,
        campaign: str | Path | None = None,
        *,
        text: str | None = None,
        priority: int = 0,
        max_wall_s: int | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Submits a campaign: a name of the server's library, a `Path` of a file here, or a text."""
        body = campaign_body(campaign, text) | {"priority": priority, "max_wall_s": max_wall_s}
        return await self._do(self._operations.submit(body, idempotency_key))


class AsyncRuns(AsyncResource[Run]):
    """Flights; see `rotortwin.client.Runs`."""

    _operations: RunOperations

    def __init__(self, client: AsyncClient) -> None:
        super().__init__(client, RunOperations(client._settings))

    async def submit(
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
        join_timeout_ms: int | None = None,
        max_wall_s: int | None = None,
        max_sim_s: float | None = None,
        idempotency_key: str | None = None,
    ) -> Run:
        """Submits a flight; when this returns it is on the server's disk, and will end."""
        body = scenario_body(scenario, text, documents, set)
        body |= {"seed": seed, "link": link, "pace": pace, "priority": priority, "controller": controller, "fdi": fdi}
        given: dict[str, Any] = {"classifier": classifier, "join_timeout_ms": join_timeout_ms}
        given |= {"max_wall_s": max_wall_s, "max_sim_s": max_sim_s}
        body |= {key: value for key, value in given.items() if value is not None}
        return await self._do(self._operations.submit(body, idempotency_key))

    async def fork(
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
        return await self._do(self._operations.fork(id, body, idempotency_key))

    async def verify(self, id: str) -> Verification:
        """Flies it again in one process and compares the run hash."""
        return await self._do(self._operations.verify(id))

    async def telemetry(self, id: str, columns: Sequence[str] | None = None) -> pyarrow.Table:
        """Its samples, every step, as an Arrow table."""
        return as_table(await self.artifact(id, "telemetry.parquet"), columns)

    async def telemetry_frame(self, id: str, columns: Sequence[str] | None = None) -> pandas.DataFrame:
        """Its samples, every step, as a pandas data frame."""
        return as_frame(await self.artifact(id, "telemetry.parquet"), columns)

    async def ticket(self, id: str) -> Sequence[Ticket]:
        """How parts from elsewhere join; there once the plant waits for them (event `join`)."""
        return await self._do(self._operations.ticket(id))

    async def channels(self, id: str) -> Sequence[Channel]:
        """What was recorded of it."""
        return await self._do(self._operations.channels(id))

    async def samples(
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
        return as_table(await self._do(self._operations.samples(id, channels, query)), None)


class AsyncLibrary:
    """Documents of one kind that the server has."""

    def __init__(self, client: AsyncClient, kind: str) -> None:
        self._client = client
        self._kind = kind
        self._operations = LibraryOperations(client._settings)

    async def list(self) -> Sequence[str]:
        """Their names."""
        return await drive_async(self._client._http, self._operations.names(self._kind))

    async def get(self, name: str) -> str:
        """One of them (TOML)."""
        return await drive_async(self._client._http, self._operations.text(self._kind, name))


class AsyncScenarios(AsyncLibrary):
    """Scenarios that the server has."""

    async def validate(
        self, scenario: str | Path | None = None, *, text: str | None = None, set: Mapping[str, Any] | Sequence[str] = ()
    ) -> Validation:
        """Checks a scenario without flying it."""
        body = scenario_body(scenario, text, None, set)
        return await drive_async(self._client._http, self._operations.validate(body))


class AsyncClient:
    """A rotortwin server; see `rotortwin.Client`."""

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
        self._http = httpx.AsyncClient(verify=self._settings.verify())
        self.runs = AsyncRuns(self)
        self.campaigns = AsyncCampaigns(self, job_operations(self._settings, "campaigns"))
        self.scenarios = AsyncScenarios(self, "scenarios")
        self.vehicles = AsyncLibrary(self, "vehicles")

    def jobs(self, kind: str) -> AsyncJobs:
        """Jobs of another kind, such as `logs`, `comparisons`, `diagnoses`."""
        return AsyncJobs(self, job_operations(self._settings, kind))

    async def ready(self) -> bool:
        """The server takes work; raises otherwise."""
        return await drive_async(self._http, LibraryOperations(self._settings).ready())

    async def close(self) -> None:
        """Closes all connections."""
        await self._http.aclose()

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()
