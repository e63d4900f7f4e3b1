"""Streamed answers: events without gaps, resumable files.

`Follow` and `Download` hold the state over connections and decide; the clients only move bytes.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

import httpx

from ._exchange import _AGAIN, Backoff, Settings, lost, retry_after_s
from .errors import UnexpectedAnswer, problem_of
from .models import Event

#: The server sends something every 15 s: after this long a silent connection is dead.
_SILENCE_S = 40.0


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


class Follow:
    """The events of one job over as many connections as it takes."""

    def __init__(self, settings: Settings, path: str, after: int) -> None:
        self._settings = settings
        self._path = path
        self.last = after
        #: The last event has arrived.
        self.over = False
        #: The current connection has delivered something.
        self.news = False
        self._parser = SseParser()
        self._backoff = Backoff(settings.patience_s)
        self._request = self.request()

    def request(self) -> httpx.Request:
        """For the next connection: resumes after the last event that was seen."""
        self._parser, self.news = SseParser(), False
        headers = {"accept": "text/event-stream", "last-event-id": str(self.last)}
        self._request = self._settings.request("GET", self._path, headers=headers, timeout_s=_SILENCE_S)
        return self._request

    def feed(self, chunk: bytes) -> Iterator[Event]:
        """New events. A gap ends the connection, and the next one requests the events again."""
        for number, kind, text in self._parser.feed(chunk):
            try:
                seq, data = int(number), json.loads(text)
            except ValueError as error:
                raise UnexpectedAnswer(f"{self._path}: event '{number}' {kind} cannot be read ({error})") from error
            if seq <= self.last:
                continue
            if seq != self.last + 1:
                raise httpx.RemoteProtocolError(f"event {seq} came after {self.last}")
            self.last, self.news, self.over = seq, True, kind == "ended"
            self._backoff = Backoff(self._settings.patience_s)
            yield Event(seq, kind, data if isinstance(data, dict) else {"value": data})

    def refused(self, answer: httpx.Response) -> float:
        """The pause after an answer that is not a stream; raises permanent errors. The answer must have been read."""
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


class Download:
    """One file over as many connections as it takes; also continues what an earlier call has left."""

    def __init__(self, settings: Settings, path: str, target: Path) -> None:
        self._settings = settings
        self._path = path
        self._target = target
        self._part = target.with_name(target.name + ".part")
        self._tag = target.with_name(target.name + ".part.etag")
        self._file: BinaryIO | None = None
        self._expected: int | None = None
        self._backoff = Backoff(settings.patience_s)
        self._request = settings.request("GET", path)
        target.parent.mkdir(parents=True, exist_ok=True)

    def request(self) -> httpx.Request:
        """For the next connection."""
        headers = {}
        if (have := self._have()) > 0:
            headers["range"] = f"bytes={have}-"
        self._request = self._settings.request("GET", self._path, headers=headers)
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
        os.replace(self._part, self._target)
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
