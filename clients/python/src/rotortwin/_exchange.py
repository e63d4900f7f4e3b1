"""Requests with retries, independent of I/O.

An operation is a generator: it yields what is to be done (`Send`, `Sleep`), is resumed with the answer, and returns its result.
`drive` does that with threads, `drive_async` with asyncio, so that every operation is written once.

Tried again: no connection, a connection that breaks, 429, 502, 503, 504 (with `Retry-After` if the server says it). Submissions carry an
idempotency key, so that a second try cannot make a second job.
"""

from __future__ import annotations

import asyncio
import datetime
import random
import ssl
import time
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from email.utils import parsedate_to_datetime
from typing import Any, TypeVar, Union

import httpx

from .errors import ConnectionLost, problem_of

T = TypeVar("T")

#: Statuses that mean "try again later".
_AGAIN = (429, 502, 503, 504)
#: Upper bound of the retry delay that the server requests.
_LONGEST_PAUSE_S = 60.0


@dataclass(frozen=True)
class Send:
    """Send this and read the whole answer."""

    request: httpx.Request


@dataclass(frozen=True)
class Sleep:
    """Wait."""

    seconds: float


#: What it sends and waits for, what it receives, its result.
Operation = Generator[Union[Send, Sleep], httpx.Response, T]


@dataclass
class Backoff:
    """Pauses between attempts: 0.1 s, doubling up to 5 s, each shortened at random by up to a half; until `patience_s` have passed."""

    patience_s: float
    tries: int = 0
    began: float = field(default_factory=lambda: time.monotonic())

    def pause(self, asked_s: float | None = None) -> float | None:
        """Seconds until the next attempt; None: out of patience."""
        pause = min(5.0, 0.1 * 2.0 ** min(self.tries, 10)) * random.uniform(0.5, 1.0)
        if asked_s is not None:
            pause = min(max(asked_s, pause), _LONGEST_PAUSE_S)
        self.tries += 1
        return pause if time.monotonic() - self.began + pause <= self.patience_s else None


def retry_after_s(answer: httpx.Response) -> float | None:
    """The delay in `Retry-After`: seconds, or a date."""
    text = answer.headers.get("retry-after", "").strip()
    if text.isdigit():
        return float(text)
    try:
        at = parsedate_to_datetime(text)
    except ValueError:
        return None
    now = datetime.datetime.now(datetime.timezone.utc)
    return max(0.0, (at.replace(tzinfo=at.tzinfo or datetime.timezone.utc) - now).total_seconds())


@dataclass(frozen=True)
class Settings:
    """Address of the server, and how long to retry."""

    url: str
    token: str | None
    ca: str | None
    patience_s: float
    timeout_s: float

    def headers(self) -> dict[str, str]:
        """Headers of every request."""
        headers = {"user-agent": "rotortwin-python/0.1.0"}
        if self.token is not None:
            headers["authorization"] = f"Bearer {self.token}"
        return headers

    def verify(self) -> ssl.SSLContext | bool:
        """Certificates to trust."""
        return ssl.create_default_context(cafile=self.ca) if self.ca is not None else True

    def request(
        self,
        method: str,
        path: str,
        *,
        params: Mapping[str, Any] | None = None,
        json: Any = None,
        content: bytes | None = None,
        headers: Mapping[str, str] | None = None,
        timeout_s: float | None = None,
    ) -> httpx.Request:
        """A request; `params` that are None are left out."""
        given = {key: value for key, value in (params or {}).items() if value is not None}
        timeout = httpx.Timeout(self.timeout_s if timeout_s is None else timeout_s, connect=min(self.timeout_s, 10.0))
        return httpx.Request(
            method,
            f"{self.url}{path}",
            params=given or None,
            json=json,
            content=content,
            # Identity by default: a range of a compressed file would be a range of something else.
            headers={"accept-encoding": "identity", **self.headers(), **(headers or {})},
            extensions={"timeout": timeout.as_dict()},
        )

    def call(self, method: str, path: str, *, ok_when_repeated: tuple[int, ...] = (), **more: Any) -> Operation[httpx.Response]:
        """One request with retries; refusals are raised.

        `ok_when_repeated`: refusals that, on a second try, say that the first one did its work although its answer was lost.
        """
        backoff = Backoff(self.patience_s)
        while True:
            request = self.request(method, path, **more)
            request.headers["accept-encoding"] = "gzip"
            try:
                answer = yield Send(request)
            except httpx.TransportError as error:
                pause = backoff.pause()
                if pause is None:
                    raise lost(request, error, backoff) from error
            else:
                if answer.status_code < 400 or (backoff.tries > 0 and answer.status_code in ok_when_repeated):
                    return answer
                pause = backoff.pause(retry_after_s(answer)) if answer.status_code in _AGAIN else None
                if pause is None:
                    raise problem_of(answer)
            yield Sleep(pause)


def lost(request: httpx.Request, error: Exception, backoff: Backoff) -> ConnectionLost:
    """The error message after the last attempt."""
    words = str(error) or type(error).__name__
    seconds = time.monotonic() - backoff.began
    return ConnectionLost(
        f"{request.url.scheme}://{request.url.netloc.decode()} gave no answer in {backoff.tries} tries over {seconds:.0f} s "
        f"({words}); expected a rotortwin server there"
    )


def drive(client: httpx.Client, operation: Operation[T]) -> T:
    """Runs an operation with a blocking client."""
    try:
        step = next(operation)
        while True:
            if isinstance(step, Sleep):
                time.sleep(step.seconds)
                step = next(operation)
                continue
            try:
                answer = client.send(step.request)
            except httpx.TransportError as error:
                step = operation.throw(error)
            else:
                step = operation.send(answer)
    except StopIteration as end:
        return end.value  # type: ignore[no-any-return]


async def drive_async(client: httpx.AsyncClient, operation: Operation[T]) -> T:
    """Runs an operation with asyncio."""
    try:
        step = next(operation)
        while True:
            if isinstance(step, Sleep):
                await asyncio.sleep(step.seconds)
                step = next(operation)
                continue
            try:
                answer = await client.send(step.request)
            except httpx.TransportError as error:
                step = operation.throw(error)
            else:
                step = operation.send(answer)
    except StopIteration as end:
        return end.value  # type: ignore[no-any-return]

