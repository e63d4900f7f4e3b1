"""Errors, each with one sentence: what, where, what was expected."""

from __future__ import annotations

import httpx


class RotortwinError(Exception):
    """Every error of this package; its text is one sentence."""


class ConnectionLost(RotortwinError):
    """The server did not answer within the client's patience."""


class UnexpectedAnswer(RotortwinError):
    """An answer that the API does not describe: another program, another version, or a proxy in between."""


class JobFailed(RotortwinError):
    """A job that was waited for, or whose result was asked for, ended as failed or canceled."""

    def __init__(self, sentence: str, status: str) -> None:
        super().__init__(sentence)
        #: `failed` or `canceled`.
        self.status = status


class CampaignFailed(RotortwinError):
    """A campaign of this machine or of an executor cannot be flown, or a task of it failed."""


class Problem(RotortwinError):
    """The server refused (RFC 9457, `application/problem+json`); the text is its `detail`."""

    def __init__(self, status: int, kind: str, title: str, detail: str, request_id: str | None) -> None:
        super().__init__(detail)
        #: HTTP status.
        self.status = status
        #: A stable name for programs, such as `/problems/not-found`.
        self.kind = kind
        #: Kind of problem, in words.
        self.title = title
        #: One sentence: what, where, what was expected.
        self.detail = detail
        #: `x-request-id`: names this request in the server's log.
        self.request_id = request_id
        #: All errors in a document, that of `detail` first.
        self.complaints: list[str] = []


class BadRequest(Problem):
    """400, 413, 415: the request cannot be read."""


class Unauthorized(Problem):
    """401, 403: no token, or one without permission."""


class NotFound(Problem):
    """404."""


class Conflict(Problem):
    """409, 412: it conflicts with the current state."""


class Unprocessable(Problem):
    """422: it is readable, but cannot be done."""


class Unavailable(Problem):
    """429, 503: not now, and not within the client's patience."""


class DiskFull(Problem):
    """507."""


_CLASSES: dict[int, type[Problem]] = {
    400: BadRequest,
    413: BadRequest,
    415: BadRequest,
    401: Unauthorized,
    403: Unauthorized,
    404: NotFound,
    409: Conflict,
    412: Conflict,
    422: Unprocessable,
    429: Unavailable,
    502: Unavailable,
    503: Unavailable,
    504: Unavailable,
    507: DiskFull,
}


def problem_of(answer: httpx.Response) -> RotortwinError:
    """The error for an answer of status 400 or more, whose body must have been read."""
    where = f"{answer.request.method} {answer.request.url}"
    complaints: list[str] = []
    try:
        body = answer.json()
        detail, kind, title = str(body["detail"]), str(body["type"]), str(body["title"])
        complaints = [str(complaint) for complaint in body.get("complaints", [])]
    except (ValueError, KeyError, TypeError):
        text = answer.text.strip().splitlines()
        words = f": {text[0][:200]}" if text else ""
        detail = f"{where} was answered with {answer.status_code}{words}; expected an answer of a rotortwin server"
        kind, title = "about:blank", answer.reason_phrase
    cls = _CLASSES.get(answer.status_code, Problem)
    problem = cls(answer.status_code, kind, title, detail, answer.headers.get("x-request-id"))
    problem.complaints = complaints
    return problem
