"""Every operation of the API has a method of the client, or a reason for having none.

`calls` has every method with all its arguments. What each sends, to a server that is not there, is compared with the OpenAPI document: the
operation, its query and its body. What the document offers and no call sends must be explained in the tables below.
"""

from __future__ import annotations

import contextlib
import json
import re
import typing
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest

from conftest import ROOT
from rotortwin import Client, FdiSession, FdiState, RotortwinError

Json = dict[str, typing.Any]
Call = Callable[[Client], object]

#: Operations that have no method, and why.
NO_METHOD = {
    "stream_fdi_session": "a WebSocket, for programs that feed sample by sample; `FdiSession.feed` takes the same in chunks over HTTP",
    "run_live": "a WebSocket, for pages that draw a flight while it flies; `runs.events` tells how far it is, `runs.samples` the rest",
    "run_foxglove": "a WebSocket in Foxglove's protocol, for its own viewers",
    "sign_in": "gives browsers a cookie; a program sends its token",
    "sign_out": "takes a browser's cookie back",
    "healthz": "for a watchdog beside the process; `ready` says more",
    "metrics": "for Prometheus, in its text format",
}

#: Parameters of queries that no method sends, and why.
NO_PARAMETER = {
    ("compare_runs", "format"): "JSON has types, CSV has none",
    ("all_events", "after"): "`Last-Event-ID` says the same",
}

#: Members of bodies that no method sends, and why.
NO_MEMBER = {
    ("submit_improvement", "effects"): "belongs to a diagnosis",
    ("submit_improvement", "library_effects"): "belongs to a diagnosis",
    ("submit_improvement", "more_models"): "belongs to a comparison",
    ("submit_diagnosis", "held_out"): "belongs to an improvement",
    ("submit_diagnosis", "more_models"): "belongs to a comparison",
    ("submit_comparison", "effects"): "belongs to a diagnosis",
    ("submit_comparison", "library_effects"): "belongs to a diagnosis",
    ("submit_comparison", "held_out"): "belongs to an improvement",
}

#: Kinds of jobs, with the verbs that all of them have.
KINDS = (
    "runs campaigns blind_benches logs comparisons diagnoses improvements next_flights identifications classifiers verifications"
).split()

LIST = {"vehicle": "f550", "verdict": 0, "parent": "P", "from_ms": 1, "to_ms": 2}
MODEL = {"vehicle": "f550", "improvement": "I", "version": "V", "model": "M"}


def verbs(kind: str) -> dict[str, Call]:
    """The calls that all kinds of jobs have."""

    def of(client: Client) -> typing.Any:
        return getattr(client, kind)

    return {
        f"{kind}.get": lambda client: of(client).get("ID"),
        f"{kind}.list": lambda client: next(of(client).list(status="done", name="N", **LIST)),
        f"{kind}.list, second page": lambda client: list(of(client).list()),
        f"{kind}.events": lambda client: next(of(client).events("ID", after=3)),
        f"{kind}.cancel": lambda client: of(client).cancel("ID"),
        f"{kind}.delete": lambda client: of(client).delete("ID"),
        f"{kind}.artifacts": lambda client: of(client).artifacts("ID"),
        f"{kind}.artifact": lambda client: of(client).artifact("ID", "figures/a.svg"),
    }


def documents(kind: str) -> dict[str, Call]:
    """The calls that all kinds of documents have."""

    def of(client: Client) -> typing.Any:
        return getattr(client, kind)

    return {
        f"{kind}.list": lambda client: of(client).list(own=True),
        f"{kind}.get": lambda client: of(client).get("N"),
        f"{kind}.put": lambda client: of(client).put("N", "text"),
        f"{kind}.delete": lambda client: of(client).delete("N"),
        f"{kind}.check": lambda client: of(client).check("text"),
    }


def fdi_session(client: Client) -> FdiSession:
    """A session that was opened before."""
    state = FdiState("ID", {}, 400.0, 0, 0, "noise", 0, 0, 0, 0, 0, [], 600.0)
    return FdiSession(client._transport, client.fdi._operations, state)


def calls(folder: Path) -> dict[str, Call]:
    """Every method that sends something, by its name, with all arguments that can go together."""
    bench = folder / "stand.csv"
    bench.write_text("throttle [%],thrust [g]\n")
    judged: Json = {"vehicle": "f550", "part": "3:9", "classifier": "c", "calibration_start_s": 0.5, "calibration_end_s": 4.0, "flight": True}
    interval: Json = {"from_s": 1.0, "to_s": 2.0, "points": 50}
    made: dict[str, Call] = {}
    for kind in KINDS:
        made |= verbs(kind)
    for kind in ("scenarios", "vehicles", "blades", "effects", "models"):
        made |= documents(kind)
    return made | {
        "runs.submit": lambda c: c.runs.submit(
            "s", text="t", documents="d", set={"a": 1}, seed=1, controller={"autopilot": "x"}, classifier="c", model={"model": "m"},
            fdi_model={"model": "m"}, join_timeout_ms=1, max_wall_s=1, max_sim_s=1.0,
        ),
        "runs.fork": lambda c: c.runs.fork("ID", healthy=True, seed=1),
        "runs.verify": lambda c: c.runs.verify("ID"),
        "runs.table": lambda c: c.runs.table(["steps"], name="N", parent="P", limit=5),
        "runs.columns": lambda c: c.runs.columns(name="N", parent="P", status="failed"),
        "runs.compare_controllers": lambda c: c.runs.compare_controllers(["A", "B"], within_m=0.2),
        "runs.autopilots": lambda c: c.runs.autopilots(),
        "runs.flight": lambda c: c.runs.flight("ID"),
        "runs.geometry": lambda c: c.runs.geometry("ID"),
        "runs.export": lambda c: c.runs.export("ID", "ulog", folder / "run.ulg"),
        "runs.ticket": lambda c: c.runs.ticket("ID"),
        "runs.channels": lambda c: c.runs.channels("ID"),
        "runs.samples": lambda c: c.runs.samples("ID", ["duty_*"], **interval),
        "runs.samples, several": lambda c: c.runs.samples(["A", "B"], ["duty_*"], **interval),
        "campaigns.submit": lambda c: c.campaigns.submit("small", text="t", classifier="c", max_wall_s=1),
        "campaigns.library": lambda c: c.campaigns.library(),
        "campaigns.flights": lambda c: next(c.campaigns.flights("ID", detector="network", truth=1, verdict=[0, 3], status="done")),
        "campaigns.flights, second page": lambda c: list(c.campaigns.flights("ID")),
        "campaigns.fly": lambda c: c.campaigns.fly("ID", 3),
        "blind_benches.submit": lambda c: c.blind_benches.submit(2, vehicles=["f550"], max_wall_s=1),
        "blind_benches.cases": lambda c: next(c.blind_benches.cases("ID", hidden="mass", named="nothing", outcome="missed", preset="null")),
        "blind_benches.cases, second page": lambda c: list(c.blind_benches.cases("ID")),
        "blind_benches.case": lambda c: c.blind_benches.case("ID", 1),
        "blind_benches.log": lambda c: c.blind_benches.log("ID", 1),
        "logs.submit": lambda c: c.logs.submit(b"log", name="a.ulg", rate_hz=100.0, align=True, damaged=True, vehicle="f550"),
        "logs.submit_again": lambda c: c.logs.submit_again("ID", mapping="m", rate_hz=100.0, align=True, damaged=True, vehicle="f550"),
        "logs.draft_mapping": lambda c: c.logs.draft_mapping("ID"),
        "logs.generate": lambda c: c.logs.generate("healthy", effect="mass", seed=1, vehicle="f550", duration_s=20.0),
        "logs.truth": lambda c: c.logs.truth("ID"),
        "logs.channels": lambda c: c.logs.channels("ID"),
        "logs.samples": lambda c: c.logs.samples("ID", ["duty_*"], **interval),
        "logs.flight": lambda c: c.logs.flight("ID"),
        "comparisons.submit": lambda c: c.comparisons.submit(**MODEL, label="L", more_models=["n@v1"], logs=["A"], runs=["B"], max_wall_s=1),
        "comparisons.series": lambda c: c.comparisons.series("ID", "fx", log=1, **interval),
        "comparisons.conditions": lambda c: c.comparisons.conditions("ID", log=1, **interval),
        "diagnoses.submit": lambda c: c.diagnoses.submit(**MODEL, logs=["A"], effects=["e"], library_effects=["n"], max_wall_s=1),
        "improvements.submit": lambda c: c.improvements.submit("f550", version="V", logs=["A"], held_out_runs=["B"], max_wall_s=1),
        "next_flights.submit": lambda c: c.next_flights.submit("mass", "air-density", **MODEL),
        "next_flights.manoeuvres": lambda c: c.next_flights.manoeuvres("ID"),
        "identifications.submit": lambda c: c.identifications.submit(
            "mine", mass_kg=1.0, arm_m=0.2, logs=["A"], runs=["B"], frame="quad-x", trust_frame=True, capacity_ah=5.0, cells=4, bench=[bench],
            held_out=True,
        ),
        "identifications.keep": lambda c: c.identifications.keep("ID"),
        "classifiers.submit": lambda c: c.classifiers.submit(hyperparameters={"epochs": 3}),
        "classifiers.evaluate": lambda c: c.classifiers.evaluate("ID", scenario="s"),
        "fdi.open": lambda c: c.fdi.open("f550", vehicle_text="t", classifier="c", settings={"calibration_end_s": 4.0}, topic=True),
        "fdi.attach": lambda c: c.fdi.attach("ID"),
        "fdi.sessions": lambda c: c.fdi.sessions(),
        "fdi.events": lambda c: next(c.fdi.events(wait=False)),
        "fdi.judge": lambda c: c.fdi.judge(id="L", **judged),
        "fdi.score": lambda c: c.fdi.score(id="L", truth="fault_label", **judged),
        "fdi.score, rows": lambda c: c.fdi.score(id="L", truth=[(1.0, 3, 0.1)], **judged),
        "session.feed": lambda c: fdi_session(c).feed([]),
        "session.close": lambda c: fdi_session(c).close(),
        "scenarios.validate": lambda c: c.scenarios.validate("s", text="t", set={"a": 1}),
        "vehicles.geometry": lambda c: c.vehicles.geometry("N"),
        "effects.catalogue": lambda c: c.effects.catalogue(),
        "effects.picture": lambda c: c.effects.picture("mass", rotor=1, parameters={"share": 0.1}, flight="hover"),
        "models.create": lambda c: c.models.create("N", {"vehicle": "f550"}),
        "models.history": lambda c: c.models.history("N"),
        "models.version": lambda c: c.models.version("N"),
        "models.geometry": lambda c: c.models.geometry("N", "v1"),
        "models.diff": lambda c: c.models.diff("N", "v0"),
        "models.add": lambda c: c.models.add("N", diagnosis="D", pick=1, proposal=True, effect={"effect": "mass"}, note="n"),
        "models.undo": lambda c: c.models.undo("N"),
        "models.branch": lambda c: c.models.branch("N", "B"),
        "query": lambda c: c.query("SELECT 1", runs=["A"], campaigns=["B"], blind_benches=["C"]),
        "events": lambda c: next(c.events(after="1.2", progress=False, wait=False)),
        "limits": lambda c: c.limits(),
        "identity": lambda c: c.identity(),
        "ready": lambda c: c.ready(),
    }


def document() -> Json:
    """The OpenAPI document."""
    found: Json = json.loads((ROOT / "tests/golden/openapi.json").read_text())
    return found


def operations() -> Iterator[tuple[str, str, Json]]:
    """Method, path and description of every operation."""
    for path, item in document()["paths"].items():
        for method, operation in item.items():
            if method in ("get", "post", "put", "patch", "delete"):
                yield method.upper(), path, operation


def operation_of(request: httpx.Request) -> Json:
    """The one that a request calls; of several that fit, the one with more of its path spelt out."""
    sent = request.url.path
    fitting = []
    for method, path, operation in operations():
        pattern = re.sub(r"\\\{(\w+)\\\}", lambda name: ".+" if name[1] == "path" else "[^/]+", re.escape(path))
        if method == request.method and re.fullmatch(pattern, sent):
            fitting.append((path.count("{"), operation))
    assert fitting, f"{request.method} {sent} is no operation of the document"
    return dict(min(fitting, key=lambda one: one[0])[1])


def sent_by(call: Call, client: Client) -> list[httpx.Request]:
    """What a method sends to a server whose lists never end and whose other answers say nothing."""
    sent: list[httpx.Request] = []

    def answer(request: httpx.Request) -> httpx.Response:
        sent.append(request)
        if len(sent) > 2:
            return httpx.Response(404)
        return httpx.Response(200, json={"items": [], "next": "more", "branches": [], "versions": []})

    client._transport.http = httpx.Client(transport=httpx.MockTransport(answer))
    # Such answers cannot be read: only what was asked matters.
    with contextlib.suppress(RotortwinError, KeyError, ValueError, StopIteration):
        call(client)
    assert sent, "it sends nothing"
    return sent


class Use:
    """What the calls made of an operation."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.query: set[str] = set()
        self.body: set[str] = set()


@pytest.fixture(scope="module")
def used(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Use]:
    """By the id of the operation."""
    found: dict[str, Use] = {}
    client = Client("http://nowhere", patience_s=0.0)
    client.close()
    for name, call in calls(tmp_path_factory.mktemp("calls")).items():
        for request in sent_by(call, client):
            use = found.setdefault(operation_of(request)["operationId"], Use())
            use.calls.append(name)
            use.query |= set(request.url.params.keys())
            if request.headers.get("content-type") == "application/json":
                body = json.loads(request.content)
                use.body |= {key for key, value in body.items() if value is not None} if isinstance(body, dict) else set()
    return found


def test_val_every_operation_has_a_method_or_a_reason(used: dict[str, Use]) -> None:
    there = {operation["operationId"] for _, _, operation in operations()}
    missing = sorted(there - used.keys() - NO_METHOD.keys())
    assert not missing, f"{', '.join(missing)}: expected a method of the client and a call of it in `calls`, or a reason in NO_METHOD"
    assert not (stale := sorted(NO_METHOD.keys() & used.keys() | NO_METHOD.keys() - there)), f"NO_METHOD: {', '.join(stale)} has a method, or is gone"


def test_val_every_parameter_can_be_given_or_has_a_reason(used: dict[str, Use]) -> None:
    for _, path, operation in operations():
        id = operation["operationId"]
        if id in NO_METHOD:
            continue
        offered = {one["name"] for one in operation.get("parameters", []) if one["in"] == "query"}
        explained = {name for of, name in NO_PARAMETER if of == id}
        assert used[id].query <= offered, f"{path}: the document has no {used[id].query - offered} ({', '.join(used[id].calls)})"
        assert explained <= offered - used[id].query, f"{path}: NO_PARAMETER explains {explained}, which is sent, or is gone"
        missing = offered - used[id].query - explained
        assert not missing, f"{path}: no call sends {missing}; expected an argument of {used[id].calls[0]}, or a reason in NO_PARAMETER"


def test_val_every_member_of_a_body_can_be_given_or_has_a_reason(used: dict[str, Use]) -> None:
    schemas = document()["components"]["schemas"]
    for _, path, operation in operations():
        id = operation["operationId"]
        content = operation.get("requestBody", {}).get("content", {}).get("application/json")
        if id in NO_METHOD or content is None or "$ref" not in content["schema"]:
            continue
        offered = set(schemas[content["schema"]["$ref"].rpartition("/")[2]].get("properties", {}))
        explained = {name for of, name in NO_MEMBER if of == id}
        assert explained <= offered - used[id].body, f"{path}: NO_MEMBER explains {explained}, which is sent, or is gone"
        assert used[id].body <= offered, f"{path}: the document has no {used[id].body - offered} ({', '.join(used[id].calls)})"
        missing = offered - used[id].body - explained
        assert not missing, f"{path}: no call sends {missing}; expected an argument of {used[id].calls[0]}, or a reason in NO_MEMBER"


def test_val_the_readme_names_every_method(tmp_path: Path) -> None:
    text = (ROOT / "clients/python/README.md").read_text(encoding="utf-8")
    methods = {name.partition(",")[0].rpartition(".")[2] for name in calls(tmp_path)}
    assert not (missing := sorted(name for name in methods if f"`{name}`" not in text and f".{name}`" not in text)), ", ".join(missing)
