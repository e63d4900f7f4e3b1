"""Jobs of one kind, with threads: the verbs that all of them have."""

# Made from _aio_resource.py by generate_sync.py: change that file.

from __future__ import annotations

import time
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import httpx

from ._exchange import Operation, drive
from ._operations import J, JobOperations, Progress, Watcher
from ._query import MEMORY, query
from ._stream import Download, E, Follow, Stream, local_path
from ._transport import Transport
from .models import Artifact, Event, Status

if TYPE_CHECKING:
    import pyarrow

T = TypeVar("T")


def followed(transport: Transport, stream: Stream[E]) -> Iterator[E]:
    """All events of a stream, over broken connections and restarts of the server."""
    while not stream.over:
        try:
            answer = transport.http.send(stream.request(), stream=True)
            try:
                if answer.status_code == 200:
                    stream.begin()
                    for chunk in answer.iter_bytes():
                        for event in stream.feed(chunk):
                            yield event
                        if stream.over:
                            return
                    pause = 0.1
                else:
                    answer.read()
                    pause = stream.refused(answer)
            finally:
                answer.close()
        except httpx.TransportError as error:
            pause = stream.broke(error)
        else:
            if answer.status_code == 200 and drive(transport.http, stream.ended()):
                return
        time.sleep(pause)


def fetched(transport: Transport, download: Download) -> Path:
    """A file, whole."""
    while True:
        pause = 0.0
        try:
            answer = transport.http.send(download.request(), stream=True)
            try:
                if answer.status_code not in (200, 206):
                    answer.read()
                    pause = download.refused(answer)
                elif download.begin(answer):
                    for chunk in answer.iter_bytes():
                        download.write(chunk)
                    if download.complete():
                        return download.target
            finally:
                download.close()
                answer.close()
        except httpx.TransportError as error:
            pause = download.broke(error)
        time.sleep(pause)


class Resource(Generic[J]):
    """Jobs of one kind: the verbs that all of them have."""

    def __init__(self, transport: Transport, operations: JobOperations[J]) -> None:
        self._transport = transport
        self._operations = operations

    def _do(self, operation: Operation[T]) -> T:
        return drive(self._transport.http, operation)

    def get(self, id: str) -> J:
        """One of them."""
        return self._do(self._operations.get(id))

    def list(
        self, *, status: Status | None = None, name: str | None = None, page_size: int = 100, **filters: Any
    ) -> Iterator[J]:
        """All of them, latest first, page by page as they are asked for."""
        cursor: str | None = None
        while True:
            page = self._operations.page(cursor, page_size, {"status": status, "name": name, **filters})
            items, cursor = self._do(page)
            for item in items:
                yield item
            if cursor is None:
                return

    def events(self, id: str, *, after: int = 0) -> Iterator[Event]:
        """Every event from the first (or after number `after`) to `ended`, over broken connections and restarts of the server."""
        stream = Follow(self._transport.settings, self._operations.path(id), after)
        for event in followed(self._transport, stream):
            yield event

    def wait(self, id: str, *, progress: Progress = False, check: bool = False) -> J:
        """The job once it has ended. `check`: raise `JobFailed` unless it was done."""
        watcher = Watcher(progress)
        try:
            for event in self.events(id):
                watcher.see(event)
        finally:
            watcher.close()
        job = self.get(id)
        return self._operations.checked(job) if check else job

    def cancel(self, id: str) -> J:
        """Asks it to end; what it has done so far is kept."""
        return self._do(self._operations.cancel(id))

    def delete(self, id: str) -> None:
        """Deletes one that has ended, with its files."""
        self._do(self._operations.delete(id))

    def artifacts(self, id: str) -> Sequence[Artifact]:
        """Its files."""
        return self._do(self._operations.artifacts(id))

    def artifact(self, id: str, path: str) -> bytes:
        """A file of it, whole."""
        return self._do(self._operations.artifact(id, path))

    def download(self, id: str, path: str, target: str | Path) -> Path:
        """A file of it to `target`; resumes where an earlier call was cut off."""
        path = self._operations.artifact_path(id, path)
        return fetched(self._transport, Download(self._transport.settings, path, Path(target)))

    def query(self, sql: str, ids: Sequence[str], *, file: str = "telemetry.parquet", memory: str = MEMORY) -> pyarrow.Table:
        """The answer to SQL about a Parquet file of several of them, as an Arrow table: `rotortwin.query` over copies of the files.

        The table is called as the file, `telemetry`; its column `folder` is the id. The copies go to a temporary folder.
        """
        with tempfile.TemporaryDirectory(prefix="rotortwin-query-") as folder:
            for id in ids:
                self.download(id, file, local_path(Path(folder), f"{id}/{file}"))
            return query(sql, folder, memory=memory)

    def download_all(self, id: str, folder: str | Path) -> Path:
        """All its files into a folder."""
        folder = Path(folder)
        for artifact in self.artifacts(id):
            self.download(id, artifact.path, local_path(folder, artifact.path))
        return folder
