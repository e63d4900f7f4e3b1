"""Jobs of one kind, with asyncio: the verbs that all of them have."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import httpx

from ._exchange import Operation, drive_async
from ._operations import J, JobOperations, Progress, Watcher
from ._query import MEMORY, query_async
from ._stream import Download, E, Follow, Stream, local_path
from ._transport import AsyncTransport
from .models import Artifact, Event, Status

if TYPE_CHECKING:
    import pyarrow

T = TypeVar("T")


async def followed(transport: AsyncTransport, stream: Stream[E]) -> AsyncIterator[E]:
    """All events of a stream, over broken connections and restarts of the server."""
    while not stream.over:
        try:
            answer = await transport.http.send(stream.request(), stream=True)
            try:
                if answer.status_code == 200:
                    stream.begin()
                    async for chunk in answer.aiter_bytes():
                        for event in stream.feed(chunk):
                            yield event
                        if stream.over:
                            return
                    pause = 0.1
                else:
                    await answer.aread()
                    pause = stream.refused(answer)
            finally:
                await answer.aclose()
        except httpx.TransportError as error:
            pause = stream.broke(error)
        else:
            if answer.status_code == 200 and await drive_async(transport.http, stream.ended()):
                return
        await asyncio.sleep(pause)


async def fetched(transport: AsyncTransport, download: Download) -> Path:
    """A file, whole."""
    while True:
        pause = 0.0
        try:
            answer = await transport.http.send(download.request(), stream=True)
            try:
                if answer.status_code not in (200, 206):
                    await answer.aread()
                    pause = download.refused(answer)
                elif download.begin(answer):
                    async for chunk in answer.aiter_bytes():
                        download.write(chunk)
                    if download.complete():
                        return download.target
            finally:
                download.close()
                await answer.aclose()
        except httpx.TransportError as error:
            pause = download.broke(error)
        await asyncio.sleep(pause)


class AsyncResource(Generic[J]):
    """Jobs of one kind: the verbs that all of them have."""

    def __init__(self, transport: AsyncTransport, operations: JobOperations[J]) -> None:
        self._transport = transport
        self._operations = operations

    async def _do(self, operation: Operation[T]) -> T:
        return await drive_async(self._transport.http, operation)

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
        stream = Follow(self._transport.settings, self._operations.path(id), after)
        async for event in followed(self._transport, stream):
            yield event

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
        """A file of it to `target`; resumes where an earlier call was cut off."""
        path = self._operations.artifact_path(id, path)
        return await fetched(self._transport, Download(self._transport.settings, path, Path(target)))

    async def query(self, sql: str, ids: Sequence[str], *, file: str = "telemetry.parquet", memory: str = MEMORY) -> pyarrow.Table:
        """The answer to SQL about a Parquet file of several of them, as an Arrow table: `rotortwin.query` over copies of the files.

        The table is called as the file, `telemetry`; its column `folder` is the id. The copies go to a temporary folder.
        """
        with tempfile.TemporaryDirectory(prefix="rotortwin-query-") as folder:
            for id in ids:
                await self.download(id, file, local_path(Path(folder), f"{id}/{file}"))
            return await query_async(sql, folder, memory=memory)

    async def download_all(self, id: str, folder: str | Path) -> Path:
        """All its files into a folder."""
        folder = Path(folder)
        for artifact in await self.artifacts(id):
            await self.download(id, artifact.path, local_path(folder, artifact.path))
        return folder
