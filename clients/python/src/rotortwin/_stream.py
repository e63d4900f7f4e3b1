"""Streamed answers: events without gaps, resumable files.

`Stream` and `Download` hold the state over connections and decide; the clients only move bytes.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Generic, TypeVar
from urllib.parse import quote

import httpx

from ._exchange import _AGAIN, Backoff, Operation, Settings, lost, retry_after_s
from .errors import UnexpectedAnswer, problem_of
from .models import FINAL, Event, FdiEvent, FdiState, Json, PlacedEvent, read

E = TypeVar("E")

#: The server sends something every 15 s: after this long a silent connection is dead.
_SILENCE_S = 40.0
#: A connection that has lasted so long was of use, even if nothing happened meanwhile.
_LIVED_S = 5.0


class SseParser:
    """Server-sent events from bytes (WHATWG HTML, 9.2.6): lines end with LF, CR or CRLF, and with nothing else."""

    def __init__(self) -> None:
        self._rest = b""
        self._id: str = ""
        self._kind = ""
        self._data: list[str] = []

    def feed(self, chunk: bytes) -> Iterator[tuple[str, str, str]]:
        """(id, kind, data) of every complete event."""
        text = self._rest + chunk
        # A CR at the very end may be half of a CRLF.
        held = text[-1:] == b"\r"
        lines = (text[:-1] if held else text).replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
        self._rest = lines.pop() + (b"\r" if held else b"")
        for line in lines:
            if not line:
                if self._data or self._kind:
                    yield self._id, self._kind or "message", "\n".join(self._data)
                self._kind, self._data = "", []
                continue
            name, _, value = line.decode("utf-8", "replace").partition(":")
            value = value.removeprefix(" ")
            if name == "id":
                self._id = value
            elif name == "event":
                self._kind = value
            elif name == "data":
                self._data.append(value)


class Stream(Generic[E]):
    """Server-sent events over as many connections as it takes; what is done with them is said by its kinds below."""

    def __init__(self, settings: Settings, path: str, params: Mapping[str, Any]) -> None:
        self._settings = settings
        self._path = path
        self._params = params
        #: End of the stream.
        self.over = False
        #: The current connection has delivered something.
        self.news = False
        self._opened: float | None = None
        self._parser = SseParser()
        self._backoff = Backoff(settings.patience_s)
        self._request = self.request()

    def resumed(self) -> dict[str, str]:
        """Headers that resume after the last event that was seen."""
        return {}

    def take(self, id: str, kind: str, data: Json) -> E | None:
        """An event; None: it was seen already."""
        raise NotImplementedError

    def ended(self) -> Operation[bool]:
        """Whether a stream that the server has closed is complete; otherwise the server is shutting down."""
        raise NotImplementedError

    def request(self) -> httpx.Request:
        """For the next connection."""
        self._renew()
        self._parser, self.news = SseParser(), False
        headers = {"accept": "text/event-stream", **self.resumed()}
        self._request = self._settings.request("GET", self._path, params=self._params, headers=headers, timeout_s=_SILENCE_S)
        return self._request

    def begin(self) -> None:
        """The server has accepted the connection."""
        self._opened = time.monotonic()

    def feed(self, chunk: bytes) -> Iterator[E]:
        """New events."""
        for id, kind, text in self._parser.feed(chunk):
            try:
                data = json.loads(text)
                event = self.take(id, kind, data if isinstance(data, dict) else {"value": data})
            except (ValueError, KeyError, TypeError) as error:
                raise UnexpectedAnswer(f"{self._path}: event '{id}' {kind} cannot be read ({error})") from error
            if event is not None:
                self.news = True
                yield event

    def refused(self, answer: httpx.Response) -> float:
        """The pause after an answer that is not a stream; raises permanent errors. The answer must have been read."""
        pause = self._backoff.pause(retry_after_s(answer)) if answer.status_code in _AGAIN else None
        if pause is None:
            raise problem_of(answer)
        return pause

    def broke(self, error: Exception) -> float:
        """The pause after a connection that failed or broke."""
        self._renew()
        pause = self._backoff.pause()
        if pause is None:
            raise lost(self._request, error, self._backoff) from error
        return pause

    def _renew(self) -> None:
        """Patience counts from the end of the last connection that was of use: a stream may be silent for longer than that."""
        if self._opened is not None and (self.news or time.monotonic() - self._opened >= _LIVED_S):
            self._backoff = Backoff(self._settings.patience_s)
        self._opened = None


class Follow(Stream[Event]):
    """The events of one job."""

    def __init__(self, settings: Settings, job: str, after: int) -> None:
        self.last = after
        self._job = job
        super().__init__(settings, f"{job}/events", {})

    def resumed(self) -> dict[str, str]:
        return {"last-event-id": str(self.last)}

    def take(self, id: str, kind: str, data: Json) -> Event | None:
        number = int(id)
        if number <= self.last:
            return None
        if number != self.last + 1:
            # The next connection requests the events again.
            raise httpx.RemoteProtocolError(f"event {number} came after {self.last}")
        self.last, self.over = number, kind == "ended"
        return Event(number, kind, data)

    def ended(self) -> Operation[bool]:
        if self.news:
            return False
        answer = yield from self._settings.call("GET", self._job)
        return answer.json()["status"] in FINAL


class FollowAll(Stream[PlacedEvent]):
    """The events of all jobs."""

    def __init__(self, settings: Settings, after: str | None, progress: bool, wait: bool) -> None:
        self.last = after
        self._wait = wait
        flags = {name: "false" for name, given in (("progress", progress), ("wait", wait)) if not given}
        super().__init__(settings, "/api/v1/events", flags)

    def resumed(self) -> dict[str, str]:
        return {} if self.last is None else {"last-event-id": self.last}

    def take(self, id: str, kind: str, data: Json) -> PlacedEvent | None:
        if not id:
            raise ValueError("it has no place")
        self.last = id
        if kind == "open":
            return PlacedEvent(id, Event(0, kind, data))
        event = Event(int(data["seq"]), kind, dict(data["data"]))
        return PlacedEvent(id, event, str(data["job"]), str(data["collection"]), str(data["kind"]))

    def ended(self) -> Operation[bool]:
        yield from ()
        return not self._wait


class FollowFdi(Stream[FdiEvent]):
    """The caller's FDI sessions: nothing is numbered, and each connection begins with all of them."""

    def __init__(self, settings: Settings, wait: bool) -> None:
        self._wait = wait
        super().__init__(settings, "/api/v1/fdi/events", {} if wait else {"wait": "false"})

    def take(self, id: str, kind: str, data: Json) -> FdiEvent | None:
        if kind == "open":
            return FdiEvent(kind, [read(FdiState, session) for session in data["items"]])
        if kind == "closed":
            return FdiEvent(kind, closed=str(data["id"]))
        return FdiEvent(kind, [read(FdiState, data)])

    def ended(self) -> Operation[bool]:
        yield from ()
        return not self._wait


class Download:
    """One file over as many connections as it takes; also continues what an earlier call has left."""

    def __init__(
        self, settings: Settings, path: str, target: Path, *, params: Mapping[str, Any] | None = None, timeout_s: float | None = None
    ) -> None:
        self._settings = settings
        self._path = path
        self._params = params
        self._timeout_s = timeout_s
        self.target = target
        self._part = target.with_name(target.name + ".part")
        self._tag = target.with_name(target.name + ".part.etag")
        self._file: BinaryIO | None = None
        self._expected: int | None = None
        self._backoff = Backoff(settings.patience_s)
        self._request = settings.request("GET", path, params=params)
        target.parent.mkdir(parents=True, exist_ok=True)

    def request(self) -> httpx.Request:
        """For the next connection."""
        headers = {}
        if (have := self._have()) > 0:
            headers["range"] = f"bytes={have}-"
        self._request = self._settings.request("GET", self._path, headers=headers, params=self._params, timeout_s=self._timeout_s)
        return self._request

    def _have(self) -> int:
        return self._part.stat().st_size if self._part.exists() and self._tag.exists() else 0

    def begin(self, answer: httpx.Response) -> bool:
        """Processes the head of an answer; False: it does not continue the existing part, start again."""
        tag, have = answer.headers.get("etag", ""), self._have()
        if answer.status_code == 206:
            span, _, total = answer.headers.get("content-range", "").removeprefix("bytes ").partition("/")
            same = tag != "" and self._tag.read_text() == tag and span.startswith(f"{have}-") and total.isdigit()
            if not same:
                self.discard()
                return False
            self._file, self._expected = self._part.open("ab"), int(total)
            return True
        length = answer.headers.get("content-length", "")
        self._expected = int(length) if length.isdigit() else None
        self._file = self._part.open("wb")
        self._tag.write_text(tag)
        return True

    def write(self, chunk: bytes) -> None:
        """Appends a piece."""
        assert self._file is not None
        self._file.write(chunk)
        self._backoff = Backoff(self._settings.patience_s)

    def close(self) -> None:
        """The connection has ended."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def complete(self) -> bool:
        """The file is complete: moves it into place."""
        self.close()
        if self._expected is not None and self._part.stat().st_size != self._expected:
            return False
        os.replace(self._part, self.target)
        self._tag.unlink(missing_ok=True)
        return True

    def discard(self) -> None:
        """Discards the existing part."""
        self._part.unlink(missing_ok=True)
        self._tag.unlink(missing_ok=True)

    def refused(self, answer: httpx.Response) -> float:
        """The pause after a refusal; raises permanent errors. The answer must have been read."""
        if answer.status_code == 416 and self._have() > 0:
            # The existing part is as long as the file, or longer: not worth finding out which.
            self.discard()
            return 0.0
        pause = self._backoff.pause(retry_after_s(answer)) if answer.status_code in _AGAIN else None
        if pause is None:
            raise problem_of(answer)
        return pause

    def broke(self, error: Exception) -> float:
        """The pause after a connection that failed or broke."""
        pause = self._backoff.pause()
        if pause is None:
            raise lost(self._request, error, self._backoff) from error
        return pause


def in_path(text: str) -> str:
    """A part of an address; slashes in it remain."""
    return quote(text, safe="/")


def local_path(folder: Path, name: str) -> Path:
    """Path for a file of a job; a server cannot place it outside the folder."""
    path = folder.joinpath(*name.split("/"))
    if not path.resolve().is_relative_to(folder.resolve()):
        raise UnexpectedAnswer(f"the server names a file '{name}' that would be outside {folder}")
    return path
