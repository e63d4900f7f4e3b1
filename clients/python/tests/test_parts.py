"""Parts of the client without a server."""

from __future__ import annotations

import dataclasses
import json
import typing
from pathlib import Path

import httpx
import pytest

import rotortwin.models as models
from conftest import ROOT
from rotortwin import Conflict, ConnectionLost, JobFailed, RotortwinError, UnexpectedAnswer
from rotortwin._exchange import Backoff, Settings, drive, retry_after_s
from rotortwin._operations import LibraryOperations, toml_value
from rotortwin._stream import Follow, FollowAll, FollowFdi, SseParser, local_path
from rotortwin._twin import NextFlightOperations

SETTINGS = Settings("http://nowhere", None, None, patience_s=60.0, timeout_s=30.0)

#: Dataclasses and their schemas; fields that exist only here.
MODELS: dict[type, str] = {
    models.Run: "Run",
    models.Job: "JobView",
    models.Ticket: "Ticket",
    models.Artifact: "Artifact",
    models.Channel: "ChannelInfo",
    models.Verification: "Verification",
    models.Autopilot: "ListedAutopilot",
    models.Validation: "Validation",
    models.Complaint: "Complaint",
    models.FdiWindow: "WindowView",
    models.FdiAnswer: "ChunkAnswer",
    models.FdiState: "SessionView",
    models.VehicleGeometry: "VehicleGeometry",
    models.RotorGeometry: "RotorView",
    models.Effectiveness: "Effectiveness",
    models.Hover: "Hover",
    models.ChannelSeries: "ChannelSeries",
    models.ModelSeries: "ModelSeries",
    models.Buckets: "Buckets",
    models.BucketNoise: "NoiseOfBucket",
    models.ConditionSeries: "ConditionSeries",
    models.FlightCondition: "ConditionMeans",
    models.HiddenTruth: "HiddenTruth",
    models.HiddenEffect: "HiddenEffect",
    models.ProposedManoeuvre: "ProposedManoeuvre",
    models.ManoeuvreEvidence: "ManoeuvreEvidence",
    models.Limits: "Limits",
    models.Identity: "SignedIn",
    models.LibraryCampaign: "LibraryCampaign",
    models.RunTable: "Table",
}


def document() -> typing.Any:
    return json.loads((ROOT / "tests/golden/openapi.json").read_text())


@pytest.mark.parametrize("model", MODELS, ids=lambda model: str(model.__name__))
def test_val_the_fields_are_those_of_the_openapi_document(model: type) -> None:
    schema = document()["components"]["schemas"][MODELS[model]]
    fields = {field.name: field for field in dataclasses.fields(model)}
    assert fields.keys() == schema["properties"].keys()
    optional = {n for n, f in fields.items() if f.default is not dataclasses.MISSING or f.default_factory is not dataclasses.MISSING}
    assert fields.keys() - optional <= set(schema.get("required", [])), "what the server may leave out needs a default"


def test_val_the_words_are_those_of_the_openapi_document() -> None:
    schemas = document()["components"]["schemas"]

    def words(name: str) -> set[str]:
        schema = schemas[name]
        return set(schema.get("enum", ())) or {word for one in schema["oneOf"] for word in one.get("enum", [one.get("const")])}

    assert words("Status") == set(typing.get_args(models.Status))
    assert words("Link") == set(typing.get_args(models.Link))
    assert words("Place") == set(typing.get_args(models.Place))
    assert words("Pace") == set(typing.get_args(models.Pace))
    assert words("Method") == set(typing.get_args(models.Method))
    assert words("ExamplePreset") == set(typing.get_args(models.ExamplePreset))
    export = document()["paths"]["/api/v1/runs/{id}/export"]["get"]["parameters"]
    formats = next(one["schema"]["enum"] for one in export if one["name"] == "format")
    assert set(formats) == set(typing.get_args(models.ExportFormat))
    assert words("CalibrationState") == set(typing.get_args(models.CalibrationState))


def test_val_submit_offers_every_field_of_a_submission() -> None:
    import inspect

    from rotortwin import AsyncBlindBenches, AsyncCampaigns, AsyncClassifiers, AsyncFdi, AsyncRuns
    from rotortwin import BlindBenches, Campaigns, Classifiers, Fdi, Runs

    schemas = document()["components"]["schemas"]
    submits: list[tuple[typing.Any, str]] = [(cls.submit, "Submission") for cls in (Runs, AsyncRuns)]
    submits += [(cls.fork, "Fork") for cls in (Runs, AsyncRuns)]
    submits += [(cls.submit, "CampaignSubmission") for cls in (Campaigns, AsyncCampaigns)]
    submits += [(cls.submit, "BlindBenchSubmission") for cls in (BlindBenches, AsyncBlindBenches)]
    submits += [(cls.submit, "Training") for cls in (Classifiers, AsyncClassifiers)]
    submits += [(cls.evaluate, "Evaluation") for cls in (Classifiers, AsyncClassifiers)]
    submits += [(cls.open, "SessionBody") for cls in (Fdi, AsyncFdi)]
    for method, schema in submits:
        offered = inspect.signature(method).parameters.keys() - {"self", "id", "idempotency_key"}
        assert offered == schemas[schema]["properties"].keys(), schema


@pytest.mark.parametrize("size", [1, 2, 3, 1000])
def test_val_server_sent_events_in_pieces_of_any_size(size: int) -> None:
    stream = (
        b": hello\n\nid: 1\nevent: queued\ndata: {}\n\n"
        b"event: change\r\nid: 2\r\ndata: [1,\r\ndata:  2]\r\n\r\n"
        + 'data:{"text":"a\u2028b\x85c"}\nid:3\n\nid: 4\ndata: "cut off'.encode()
    )
    parser = SseParser()
    events = [event for i in range(0, len(stream), size) for event in parser.feed(stream[i : i + size])]
    assert events == [
        ("1", "queued", "{}"),
        ("2", "change", "[1,\n 2]"),
        ("3", "message", '{"text":"a\u2028b\x85c"}'),
    ]


def test_val_the_stream_of_all_jobs_resumes_behind_its_last_event() -> None:
    stream = FollowAll(SETTINGS, None, progress=False, wait=True)
    asked = stream.request()
    assert "last-event-id" not in asked.headers and dict(asked.url.params) == {"progress": "false"}
    told = b'id: 4.17\nevent: open\ndata: {}\n\nid: 5.18\nevent: ended\n'
    told += b'data: {"job":"a","collection":"runs","kind":"run","seq":7,"data":{"status":"done"}}\n\nid: 5.19\nevent: cut off'
    opened, ended = stream.feed(told)
    assert (opened.kind, opened.place, opened.job, opened.event.id) == ("open", "4.17", "", 0)
    assert ended == models.PlacedEvent("5.18", models.Event(7, "ended", {"status": "done"}), "a", "runs", "run")
    assert stream.request().headers["last-event-id"] == "5.18"
    assert FollowAll(SETTINGS, "3.1", progress=True, wait=False).request().headers["last-event-id"] == "3.1"
    with pytest.raises(UnexpectedAnswer, match="cannot be read"):
        list(stream.feed(b'id: 6.1\nevent: ended\ndata: {"job": 1}\n\n'))


def test_val_sessions_are_told_anew_after_a_broken_connection() -> None:
    stream = FollowFdi(SETTINGS, wait=True)
    assert "last-event-id" not in stream.request().headers
    (opened,) = stream.feed(b'event: open\ndata: {"items": []}\n\n')
    (closed,) = stream.feed(b'event: closed\ndata: {"id": "a"}\n\n')
    assert (opened.kind, opened.sessions, closed.kind, closed.closed) == ("open", [], "closed", "a")
    (again,) = stream.feed(b'event: open\ndata: {"items": []}\n\n')
    assert again == opened


def test_val_a_stream_may_be_silent_for_longer_than_the_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    stream = Follow(SETTINGS, "/api/v1/runs/a", 0)
    stream.request()
    stream.begin()
    now = 1000.0
    assert stream.broke(httpx.ReadError("cut")) < 1.0
    # Now the server is away, and patience ends.
    now = 1059.0
    assert stream.broke(httpx.ConnectError("refused")) < 1.0
    now = 1061.0
    with pytest.raises(ConnectionLost):
        stream.broke(httpx.ConnectError("refused"))
    # A connection that is accepted and cut off at once, again and again, is no use either.
    stream, now = Follow(SETTINGS, "/api/v1/runs/a", 0), 2000.0
    with pytest.raises(ConnectionLost):
        for _ in range(1000):
            stream.request()
            stream.begin()
            now += stream.broke(httpx.ReadError("cut"))


def test_val_pauses_grow_and_end() -> None:
    backoff = Backoff(patience_s=1e9)
    pauses = [backoff.pause() or 0.0 for _ in range(20)]
    assert 0.05 <= pauses[0] <= 0.1 and all(2.5 <= pause <= 5.0 for pause in pauses[10:])
    assert backoff.pause(asked_s=17.0) == 17.0
    assert Backoff(patience_s=0.0).pause() is None


@pytest.mark.parametrize(("there", "ok"), [("mine", True), ("theirs", False)])
def test_val_a_document_that_was_stored_although_the_answer_is_lost(there: str, ok: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("time.sleep", lambda _: None)
    tried: list[str] = []

    def answer(request: httpx.Request) -> httpx.Response:
        tried.append(request.method)
        if len(tried) == 1:
            raise httpx.ReadError("cut", request=request)
        if request.method == "GET":
            return httpx.Response(200, text=there, headers={"etag": '"a1"'})
        assert request.headers["if-none-match"] == "*"
        return httpx.Response(412, json={"type": "/problems/precondition", "title": "Conflict", "detail": "it exists"})

    client = httpx.Client(transport=httpx.MockTransport(answer))
    put = LibraryOperations(SETTINGS).put("vehicles", "a", "mine", True, None)
    if ok:
        assert drive(client, put) == "a1"
    else:
        with pytest.raises(Conflict, match="it exists"):
            drive(client, put)
    assert tried == ["PUT", "PUT", "GET"]


@pytest.mark.parametrize(("status", "error"), [("running", RotortwinError), ("failed", JobFailed), ("done", None)])
def test_val_a_result_is_that_of_a_job_that_is_done(status: str, error: type[Exception] | None) -> None:
    evidence = {"against_other": 1.0, "against_all": 0.5, "strongest_rival": "nothing"}
    manoeuvre = {"manoeuvre": "punches", "description": "up and down", "duration_s": 30.0, "first": evidence, "second": evidence}
    job = {"id": "a", "kind": "next-flight", "name": "f550", "status": status, "submitted_ms": 1, "attempts": 1, "cancel_requested": False}
    job["result"] = [manoeuvre] if status == "done" else None
    client = httpx.Client(transport=httpx.MockTransport(lambda _: httpx.Response(200, json=job)))
    if error is None:
        (found,) = drive(client, NextFlightOperations(SETTINGS).manoeuvres("a"))
        assert (found.manoeuvre, found.second.against_all) == ("punches", 0.5)
        return
    with pytest.raises(error, match=f"next flight a (is|ended as) {status}") as refused:
        drive(client, NextFlightOperations(SETTINGS).manoeuvres("a"))
    assert type(refused.value) is error


def test_val_retry_after_is_seconds_or_a_date() -> None:
    def asked(text: str) -> float | None:
        return retry_after_s(httpx.Response(503, headers={"retry-after": text}))

    assert asked("7") == 7.0
    assert asked("Wed, 21 Oct 2015 07:28:00 GMT") == 0.0
    assert asked("soon") is None and retry_after_s(httpx.Response(503)) is None


def test_val_settings_are_written_as_toml() -> None:
    assert toml_value([1, 2.5, True, 'a"b']) == '[1, 2.5, true, "a\\"b"]'
    with pytest.raises(TypeError, match="cannot set"):
        toml_value(object())


def test_val_files_stay_in_their_folder(tmp_path: Path) -> None:
    assert local_path(tmp_path, "figures/a.svg") == tmp_path / "figures/a.svg"
    assert local_path(tmp_path, "/etc/passwd").is_relative_to(tmp_path)
    for bad in ("../x", "a/../../x"):
        with pytest.raises(UnexpectedAnswer, match="outside"):
            local_path(tmp_path, bad)


def test_val_models_ignore_what_is_new_and_name_what_is_missing() -> None:
    assert models.read(models.Artifact, {"path": "a", "size": 1, "href": "b", "new": 2}).size == 1
    with pytest.raises(UnexpectedAnswer, match="href"):
        models.read(models.Artifact, {"path": "a", "size": 1})
