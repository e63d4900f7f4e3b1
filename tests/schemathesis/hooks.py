"""Makes what schemathesis sends meet what the server has: half of the requests name things that exist.

Otherwise nearly every request would end with 404, or, a submission, with 422. Which half is decided by the request itself, so that the same
seed gives the same requests as far as ids allow.
"""

from __future__ import annotations

import json
import os
import urllib.request
import zlib
from functools import cache
from typing import Any

import schemathesis

URL = os.environ["ROTORTWIN_URL"]
#: A flight of 5 s: short enough for hundreds of them.
SCENARIO = "short-hover"
CAMPAIGN = """
name = "one"
description = "one flight"
scenario = "../scenarios/short-hover.toml"
seed = 5
flights = 1
[[axis]]
name = "charge"
key = "initial.state_of_charge"
uniform = [0.5, 1.0]
"""
#: Kinds of documents.
LIBRARY = ("scenarios", "vehicles", "blades", "effects", "models")
#: Kinds of jobs, each of which takes seconds: few of the requests that make them succeed.
TASKS = ("comparisons", "diagnoses", "improvements", "classifiers", "evaluations")
FILES = ["summary.json", "report.html", "telemetry.parquet", "run.mcap", "sim.log", "figures"]


def ask(path: str) -> Any:
    """What the server says now; None: it refuses."""
    try:
        with urllib.request.urlopen(URL + path, timeout=20) as answer:
            return json.load(answer)
    except (OSError, ValueError):
        return None


@cache
def names(kind: str) -> list[str]:
    """Of the library."""
    items = (ask(f"/api/v1/{kind}") or {}).get("items", [])
    return [item for item in items if isinstance(item, str)]


def ids(kind: str) -> list[str]:
    """Of jobs, the latest ones."""
    items = (ask(f"/api/v1/{kind}?limit=20") or {}).get("items", [])
    return [item["id"] for item in items if isinstance(item, dict) and "id" in item]


@schemathesis.serializer("application/toml")
def toml(context: Any, value: Any) -> dict[str, Any]:
    """A document as it is; what is none, as some text."""
    return {"data": (value if isinstance(value, str) else json.dumps(value)).encode()}


@cache
def document(kind: str) -> str:
    """The text of one that the server has."""
    known = names(kind)
    if not known:
        return ""
    with urllib.request.urlopen(f"{URL}/api/v1/{kind}/{known[0]}", timeout=20) as answer:
        return answer.read().decode()


def parameters(case: schemathesis.Case, choice: int) -> None:
    """Ids and names that exist."""
    given = case.path_parameters
    parts = case.operation.path.strip("/").split("/")
    if not isinstance(given, dict) or len(parts) < 3:
        return
    kind = parts[2]
    if "id" in given and (known := ids(kind)):
        given["id"] = known[choice % len(known)]
    if "name" in given and (known := names(kind)):
        given["name"] = known[choice % len(known)]
    if "at" in given:
        given["at"] = ["main", "v0"][choice % 2]
    if "case" in given:
        given["case"] = choice % 2
    if kind == "fdi" and "id" in given:
        given["id"] = os.environ["FDI_SESSION"]
    if "path" in given and "id" in given:
        files = ask(f"/api/v1/{kind}/{given['id']}/artifacts") or {}
        there = [item["path"] for item in files.get("items", []) if "path" in item] or FILES
        given["path"] = there[choice % len(there)]


def not_linked(case: schemathesis.Case) -> bool:
    """Its ids are made up: those of a stateful test come from the answer before."""
    return case.meta is None or case.meta.phase.name != "stateful"


def query(case: schemathesis.Case) -> None:
    """Channels and runs that exist."""
    if isinstance(case.query, dict):
        if "channels" in case.query:
            case.query["channels"] = "roll_rad,duty_*"
        if "channel" in case.query:
            case.query["channel"] = "fx"
        if "runs" in case.query:
            case.query["runs"] = ",".join(ids("runs")[:3])


def body(case: schemathesis.Case, choice: int) -> None:
    """Scenarios and campaigns that can be flown, documents that are some, models and flights that are there."""
    parts = case.operation.path.strip("/").split("/")
    # Also methods that an address does not take are sent.
    if case.method == "PUT" and parts[2:3] and parts[2] in LIBRARY:
        case.body = document(parts[2])
    if not isinstance(case.body, dict):
        return
    if parts[-1] in TASKS:
        if choice % 8:
            return
        if "flights" in case.body:
            case.body = {"model": {"vehicle": "f550"}, "flights": {"runs": ids("runs")[:1]}}
        else:
            case.body = {}
        return
    if parts[-1] == "validate" and parts[2] != "scenarios":
        case.body = {"text": document(parts[2])}
        return
    if parts[2] == "models" and parts[-1] == "versions":
        case.body = {"effect": {"effect": "mass", "parameters": {"share": 0.1}}}
        return
    if case.operation.path.endswith("/sessions"):
        case.body = {"vehicle": "f550", "classifier": "f550-paper"}
        return
    if case.operation.path.endswith("/campaigns"):
        case.body.pop("campaign", None)
        case.body["text"] = CAMPAIGN
    elif case.operation.path.endswith("/blind-benches"):
        case.body["vehicles"] = [{"vehicle": "f550"}]
    elif "scenario" in case.body or "text" in case.body:
        for key in ("text", "documents", "set"):
            case.body.pop(key, None)
        case.body["scenario"] = SCENARIO


def quick(case: schemathesis.Case) -> None:
    """Nothing that takes as long as the wall clock says, goes on for ever, or waits for somebody who never joins."""
    if case.operation.path in ("/api/v1/events", "/api/v1/fdi/events") and case.method == "GET":
        case.query = {**(case.query or {}), "wait": "false"}
    if not isinstance(case.body, dict):
        return
    if case.operation.path.endswith("/logs/generate") and isinstance(value := case.body.get("duration_s", 60), (int, float)) and 10 < value <= 600:
        case.body["duration_s"] = 10
    if case.body.get("pace") == "real-time":
        case.body["pace"] = "fast"
    if case.operation.path.endswith("/blind-benches"):
        # What the document forbids is sent as it is.
        for key, most, allowed in (("n", 2, 10_000), ("duration_s", 5, 3600)):
            if isinstance(value := case.body.get(key), (int, float)) and most < value <= allowed:
                case.body[key] = most
    for part in ("controller", "fdi"):
        if case.body.get(part) in ("external", "worker"):
            case.body[part] = "beside"


@schemathesis.hook
def before_call(context: schemathesis.HookContext, case: schemathesis.Case, kwargs: dict[str, Any]) -> None:
    """Every second request means something that is there."""
    words = json.dumps([case.method, case.path, case.path_parameters, str(case.body), str(case.query)], default=str)
    choice = zlib.crc32(words.encode())
    if choice % 2 == 0:
        if not_linked(case):
            parameters(case, choice // 2)
        query(case)
        body(case, choice // 2)
    quick(case)
