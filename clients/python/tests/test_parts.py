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
from rotortwin import UnexpectedAnswer
from rotortwin._exchange import Backoff, retry_after_s
from rotortwin._operations import toml_value
from rotortwin._stream import SseParser, local_path

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


def test_val_pauses_grow_and_end() -> None:
    backoff = Backoff(patience_s=1e9)
    pauses = [backoff.pause() or 0.0 for _ in range(20)]
    assert 0.05 <= pauses[0] <= 0.1 and all(2.5 <= pause <= 5.0 for pause in pauses[10:])
    assert backoff.pause(asked_s=17.0) == 17.0
    assert Backoff(patience_s=0.0).pause() is None


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
