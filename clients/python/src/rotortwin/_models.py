"""Requests on models that grow, shared by both clients."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ._exchange import Operation, Settings
from ._stream import in_path
from .errors import problem_of
from .models import Json

#: The default branch.
MAIN = "main"


class ModelOperations:
    """The operations of `/api/v1/models/NAME`."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings

    def create(self, name: str, model: Mapping[str, Any]) -> Operation[Json]:
        # Created by the attempt whose answer was lost.
        body = {"name": name, "model": dict(model)}
        answer = yield from self.settings.call("POST", "/api/v1/models", json=body, ok_when_repeated=(409,))
        if answer.status_code == 409:
            return (yield from self.history(name))
        return dict(answer.json())

    def history(self, name: str) -> Operation[Json]:
        answer = yield from self.settings.call("GET", self._path(name, "history"))
        return dict(answer.json())

    def version(self, name: str, at: str) -> Operation[Json]:
        answer = yield from self.settings.call("GET", self._path(name, "versions", at), params={"format": "json"})
        return dict(answer.json())

    def export(self, name: str, at: str) -> Operation[str]:
        answer = yield from self.settings.call("GET", self._path(name, "versions", at))
        return answer.text

    def diff(self, name: str, before: str, after: str) -> Operation[Json]:
        answer = yield from self.settings.call("GET", self._path(name, "diff"), params={"from": before, "to": after})
        return dict(answer.json())

    def add(self, name: str, branch: str, seen: str | None, body: Mapping[str, Any]) -> Operation[Json]:
        path = self._path(name, "versions")
        return (yield from self._once(name, branch, seen, path, {**body, "branch": branch}))

    def undo(self, name: str, branch: str, seen: str | None) -> Operation[Json]:
        return (yield from self._once(name, branch, seen, self._path(name, "undo"), {"branch": branch}))

    def make_branch(self, name: str, branch: str, at: str) -> Operation[Json]:
        body = {"name": branch, "at": at}
        answer = yield from self.settings.call("POST", self._path(name, "branches"), json=body, ok_when_repeated=(409,))
        if answer.status_code == 409:
            return (yield from self.history(name))
        return dict(answer.json())

    def _once(self, name: str, branch: str, seen: str | None, path: str, body: Json) -> Operation[Json]:
        """A change that a retry cannot make twice: it names the version at which the branch was seen."""
        before = yield from self.history(name)
        if seen is None:
            heads = {head["name"]: head["hash"] for head in before["branches"]}
            # A missing one is refused by the server, in its words.
            seen = heads.get(branch)
        headers = {} if seen is None else {"if-match": f'"{seen}"'}
        answer = yield from self.settings.call("POST", path, json=body, headers=headers, ok_when_repeated=(412,))
        if answer.status_code != 412:
            return dict(answer.json())
        # The first attempt succeeded and its answer was lost, or another client wrote in between.
        head = yield from self.version(name, branch)
        numbers = {version["hash"]: version["version"] for version in before["versions"]}
        left = numbers.get(seen or "")
        parents = {version["version"]: version["parent"] for version in before["versions"]}
        if left is not None and (head["parent"] == left or parents.get(left) == head["version"]):
            return {"model": name, "branch": branch, "version": head}
        raise problem_of(answer)

    def _path(self, name: str, *more: str) -> str:
        return "/".join(["/api/v1/models", in_path(name), *(in_path(part) for part in more)])
