"""Logs, comparisons, diagnoses, improvements, classifiers and FDI sessions against a real server."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from conftest import Server
from proxy import proxied
from rotortwin import AsyncClient, Client, Conflict, FdiWindow, Job, JobFailed, NotFound, Run, Unprocessable


@pytest.fixture(scope="session")
def flown(server: Server) -> Run:
    """A hover of which everybody here needs the telemetry."""
    with Client(server.url) as client:
        run = client.runs.submit("short-hover", seed=11, link="in-process", set={"duration_s": 8.0})
        return client.runs.wait(run.id, check=True)


@pytest.fixture(scope="session")
def log(server: Server, flown: Run, tmp_path_factory: pytest.TempPathFactory) -> Job:
    """Its telemetry, uploaded as somebody's flight log."""
    with Client(server.url) as client:
        path = client.runs.download(flown.id, "telemetry.parquet", tmp_path_factory.mktemp("log") / "hover.parquet")
        job = client.logs.submit(path)
        return client.logs.wait(job.id, check=True)


def test_scenario_a_log_is_uploaded_once_and_read_back(client: Client, flown: Run, log: Job, tmp_path: Path) -> None:
    assert (log.kind, log.name, log.facts["file"]) == ("log", "hover.parquet", "hover.parquet")
    data = client.runs.artifact(flown.id, "telemetry.parquet")
    assert client.logs.submit(data, name="hover.parquet").id == log.id, "the same file is the same log"
    slow = client.logs.submit(data, name="hover.parquet", rate_hz=100.0)
    assert slow.id != log.id
    frame, slower = client.logs.frame(log.id), client.logs.frame(client.logs.wait(slow.id, check=True).id)
    assert flown.summary is not None and len(frame) == flown.summary["steps"]
    assert len(slower) < len(frame) / 3
    pictures = client.logs.flight(log.id), client.runs.flight(flown.id)
    assert all(len(one["outputs"]) == 6 and one["vibration"]["accelerometer"] and len(one["time_s"]) <= 800 for one in pictures)
    with pytest.raises(NotFound):
        client.runs.flight(log.id)
    drag = client.effects.picture("rotor-drag", parameters={"drag_n_s_m": 0.3}, flight="fast-circle")
    assert drag["channels"][0]["conditions"] and drag["parameters"] == {"drag_n_s_m": 0.3}
    with pytest.raises(Unprocessable, match="no such parameter"):
        client.effects.picture("rotor-drag", parameters={"nothing": 1.0})
    assert client.logs.table(log.id, ["time_s", "duty_1"]).column_names == ["time_s", "duty_1"]
    with pytest.raises(ValueError, match="name"):
        client.logs.submit(data)
    with pytest.raises(Unprocessable, match="ends with"):
        client.logs.submit(data, name="hover.xlsx")
    broken = client.logs.submit(b"no log at all", name="broken.ulg")
    with pytest.raises(JobFailed):
        client.logs.wait(broken.id, check=True)


@pytest.fixture(scope="session")
def example(server: Server) -> Job:
    """An example log that agrees with its model."""
    with Client(server.url) as client:
        job = client.logs.generate("healthy", seed=4, duration_s=60.0)
        return client.logs.wait(job.id, check=True)


def test_scenario_an_example_log_hides_its_truth_until_asked(client: Client, server: Server, example: Job, log: Job) -> None:
    truth = client.logs.truth(example.id)
    assert (truth.effects, truth.seed, truth.duration_s, len(truth.lift_biases_n)) == ([], 4, 60.0, 6)
    hidden = client.logs.generate(effect="rotor-drag:drag_n_s_m=0.3", seed=5, duration_s=10.0, idempotency_key="hidden")
    assert client.logs.generate(effect="rotor-drag:drag_n_s_m=0.3", seed=5, duration_s=10.0, idempotency_key="hidden").id == hidden.id
    long = client.logs.generate("healthy", duration_s=600.0)
    with pytest.raises(Conflict):
        client.logs.truth(long.id)
    client.logs.cancel(long.id)
    done = client.logs.wait(hidden.id, check=True)
    assert "drag" not in json.dumps([done.name, done.facts, done.result]), "nothing of the job says what is hidden"
    (effect,) = client.logs.truth(hidden.id).effects
    assert (effect.id, effect.parameters) == ("rotor-drag", {"drag_n_s_m": 0.3})
    with pytest.raises(NotFound, match="not an example"):
        client.logs.truth(log.id)
    with pytest.raises(Unprocessable, match="either `preset` or `effect`"):
        client.logs.generate()
    with pytest.raises(Unprocessable, match="duration_s"):
        client.logs.generate("healthy", duration_s=1.0)

    async def again() -> None:
        async with AsyncClient(server.url) as other:
            assert await other.logs.truth(example.id) == truth
            job = await other.logs.generate("damaged-blade", seed=6, duration_s=10.0)
            assert (await other.logs.cancel(job.id)).cancel_requested

    asyncio.run(again())


def test_scenario_channels_of_a_log_are_asked_for_by_name_and_interval(client: Client, server: Server, log: Job) -> None:
    channels = {channel.name: channel for channel in client.logs.channels(log.id)}
    assert channels["roll_rad"].unit == "rad"
    some = client.logs.samples(log.id, ["roll_rad", "duty_*"], from_s=1.0, to_s=2.0, points=50)
    assert some.num_rows <= 50 and {"time_s", "roll_rad", "duty_6"} <= set(some.column_names)
    times = some.column("time_s").to_pylist()
    assert times == sorted(times) and times[0] >= 1.0 and times[-1] <= 2.0
    with pytest.raises(Unprocessable, match="nothing"):
        client.logs.samples(log.id, ["nothing"])
    broken = client.logs.submit(b"no log at all", name="broken.ulg")
    client.logs.wait(broken.id)
    with pytest.raises(Conflict):
        client.logs.channels(broken.id)

    async def again() -> None:
        async with AsyncClient(server.url) as other:
            assert await other.logs.channels(log.id) == list(channels.values())
            assert (await other.logs.samples(log.id, ["roll_rad", "duty_*"], from_s=1.0, to_s=2.0, points=50)).equals(some)

    asyncio.run(again())


def test_scenario_what_a_comparison_draws_comes_as_numbers(client: Client, server: Server, flown: Run, log: Job) -> None:
    client.models.create("drawn", {"vehicle": "f550"})
    version = client.models.export("drawn")
    job = client.comparisons.submit(
        vehicle="f550", label="ours", more_models=["drawn@v0", {"version": version, "label": "again"}], logs=[log.id, f"{log.id}@1:4"]
    )
    client.models.delete("drawn")
    job = client.comparisons.wait(job.id, check=True)
    series = client.comparisons.series(job.id, "fz", log=1, from_s=2.0, to_s=3.0, points=20)
    assert (series.log, series.channel, len(series.time_s), [one.label for one in series.models]) == (1, "fz", 20, ["ours", "drawn@v0", "again"])
    assert all(2.0 <= time <= 3.0 for time in series.time_s) and 1.0 <= 20 * series.bucket_s < 1.1 and series.unit
    first, *_, last = series.models
    assert first.residual == last.residual
    rows = zip(series.measured.mean, first.predicted.mean, first.residual.mean, series.measured.low, series.measured.high, strict=True)
    for measured, predicted, residual, low, high in rows:
        assert measured is not None and predicted is not None and residual is not None and low is not None and high is not None
        assert measured - predicted == pytest.approx(residual, abs=1e-9) and low <= measured <= high
    assert series.noise.mean < series.noise.sample
    conditions = client.comparisons.conditions(job.id, log=1, from_s=2.0, to_s=3.0, points=20)
    assert conditions.time_s == series.time_s and conditions.items and all(len(one.mean) == 20 and one.title for one in conditions.items)
    with pytest.raises(Unprocessable):
        client.comparisons.series(job.id, "nothing")
    with pytest.raises(NotFound):
        client.comparisons.series(job.id, "fz", log=7)

    async def again() -> None:
        async with AsyncClient(server.url) as other:
            assert await other.comparisons.series(job.id, "fz", log=1, from_s=2.0, to_s=3.0, points=20) == series
            assert await other.comparisons.conditions(job.id, log=1, from_s=2.0, to_s=3.0, points=20) == conditions

    asyncio.run(again())


def test_scenario_the_next_flight_tells_two_effects_apart(client: Client, server: Server, tmp_path: Path) -> None:
    job = client.next_flights.submit("mass", "air-density", vehicle="f550", idempotency_key="next")
    assert client.next_flights.submit("mass", "air-density", vehicle="f550", idempotency_key="next").id == job.id
    job = client.next_flights.wait(job.id, check=True)
    assert (job.kind, job.facts["between"]) == ("next-flight", ["mass", "air-density"])
    best, *_ = found = client.next_flights.manoeuvres(job.id)
    assert best.duration_s > 0.0 and best.description and best.first.strongest_rival
    assert "duration_s" in client.next_flights.scenario(job.id)
    client.models.create("heavier", {"vehicle": "f550"})
    client.models.add("heavier", effect={"effect": "mass", "parameters": {"share": 0.1}})
    other = client.next_flights.wait(client.next_flights.submit("inertia-yaw", "moment-ratio", model="heavier").id, check=True)
    client.models.delete("heavier")
    folder = client.next_flights.download_all(other.id, tmp_path / "next")
    assert 'vehicle = "next-flight-vehicle.toml"' in (folder / "next-flight.toml").read_text()
    assert (folder / "next-flight-vehicle.toml").exists() and (folder / "next-flight-blades.toml").exists()
    with pytest.raises(Unprocessable, match="two different effects"):
        client.next_flights.submit("mass", "mass", vehicle="f550")
    with pytest.raises(Unprocessable, match="between"):
        client.next_flights.submit("mass", "a b", vehicle="f550")
    with pytest.raises(NotFound):
        client.next_flights.submit("mass", "air-density", vehicle="nowhere")

    async def again() -> None:
        async with AsyncClient(server.url) as other:
            assert await other.next_flights.manoeuvres(job.id) == found
            assert "duration_s" in await other.next_flights.scenario(job.id)

    asyncio.run(again())


def test_scenario_a_vehicle_is_identified_and_kept(client: Client, server: Server, example: Job, tmp_path: Path) -> None:
    job = client.identifications.submit("found", mass_kg=1.55, arm_m=0.275, logs=[example.id])
    job = client.identifications.wait(job.id, check=True)
    assert (job.kind, job.facts["vehicle"]) == ("identification", "found") and len(job.result["identified"]["values"]) > 5
    assert "mass_kg = 1.55" in client.identifications.vehicle(job.id) and "blades" in client.identifications.vehicle(job.id)
    assert client.identifications.keep(job.id) == client.identifications.keep(job.id) == "found"
    assert client.blades.get("found") == client.identifications.blades(job.id)
    assert client.vehicles.geometry("found").mass_kg == 1.55 and len(client.vehicles.geometry("found").rotors) == 6
    comparison = client.comparisons.wait(client.comparisons.submit(vehicle="found", logs=[example.id]).id, check=True)
    assert comparison.result["models"][0]["label"] == "found"
    table = tmp_path / "stand.csv"
    table.write_text("a,b\n1,2\n")
    wrong = client.identifications.submit("found", mass_kg=1.55, arm_m=0.275, logs=[example.id], bench=[table])
    with pytest.raises(JobFailed, match="stand.csv"):
        client.identifications.wait(wrong.id, check=True)
    with pytest.raises(JobFailed, match="identification"):
        client.identifications.blades(wrong.id)
    with pytest.raises(Conflict):
        client.identifications.keep(wrong.id)
    with pytest.raises(Unprocessable, match="mass_kg"):
        client.identifications.submit("found", mass_kg=0.0, arm_m=0.275, logs=[example.id])

    async def again() -> None:
        async with AsyncClient(server.url) as other:
            assert await other.identifications.vehicle(job.id) == client.identifications.vehicle(job.id)
            assert await other.identifications.keep(job.id) == "found"

    asyncio.run(again())
    client.vehicles.delete("found")
    client.blades.delete("found")


def test_scenario_a_table_of_another_program_is_read_by_a_drafted_mapping(client: Client, tmp_path: Path) -> None:
    rows = [f"{10 * k},{k % 7 - 3}.5,0,1,0.01,0.02,0.998,{1500 + k % 9},1500,1498,1502,AUTO" for k in range(400)]
    table = "\n".join(["Clock [ms],GyrX [dps],GyrY [dps],GyrZ [dps],AccX,AccY,AccZ,Motor1,Motor2,Motor3,Motor4,Mode", *rows])
    refused = client.logs.submit(table.encode(), name="logger.csv")
    with pytest.raises(JobFailed, match="column time_s is missing"):
        client.logs.wait(refused.id, check=True)
    draft = client.logs.draft_mapping(refused.id)
    assert draft["layout"]["clock"] == "Clock [ms]" and draft["left_out"] == ["Mode"]
    assert {row["to"]: row["unit"] for row in draft["rows"]} == {"accel": "g", "rates": "deg/s", "duty": None}
    assert [question["about"] for question in draft["questions"]] == ["duty"]
    mapping = tmp_path / "map.toml"
    mapping.write_text(draft["mapping"], encoding="utf-8")
    read = client.logs.wait(client.logs.submit_again(refused.id, mapping=mapping).id, check=True)
    assert read.parent == refused.id and client.logs.frame(read.id)["duty_1"][0] == 0.5


def test_scenario_a_model_is_held_against_flights(client: Client, server: Server, flown: Run, log: Job) -> None:
    comparison = client.comparisons.submit(vehicle="f550", logs=[log.id], runs=[f"{flown.id}@1:4"])
    comparison = client.comparisons.wait(comparison.id, check=True)
    assert len(comparison.result["logs"]) == 2 and comparison.kind == "comparison"
    assert "<html" in client.comparisons.report(comparison.id).lower()
    with pytest.raises(NotFound):
        client.comparisons.submit(vehicle="nowhere", logs=[log.id])
    with pytest.raises(Unprocessable, match="one of"):
        client.comparisons.submit(logs=[log.id])

    async def again() -> None:
        async with AsyncClient(server.url) as other:
            same = await other.logs.submit(client.runs.artifact(flown.id, "telemetry.parquet"), name="hover.parquet")
            assert same.id == log.id
            twin = await other.comparisons.submit(vehicle="f550", logs=[log.id])
            twin = await other.comparisons.wait(twin.id, check=True)
            assert twin.result["logs"][0] == comparison.result["logs"][0]

    asyncio.run(again())


def test_scenario_diagnosis_and_improvement_of_a_flight(client: Client, flown: Run) -> None:
    diagnosis = client.diagnoses.submit(vehicle="f550", runs=[flown.id])
    improvement = client.improvements.submit("f550", runs=[flown.id])
    diagnosis = client.diagnoses.wait(diagnosis.id, check=True)
    assert diagnosis.result["sentence"] and isinstance(diagnosis.result["ranking"], list)
    improvement = client.improvements.wait(improvement.id, check=True)
    assert improvement.result["reason"] and improvement.result["rows"]
    model = client.improvements.model(improvement.id)
    assert "model_format" in model
    # Nothing was missing: it is still a plain vehicle, from which another model can start.
    again = client.improvements.submit(version=model, runs=[flown.id])
    assert client.improvements.wait(again.id, check=True).result["reason"] == improvement.result["reason"]
    named = client.comparisons.submit(improvement=improvement.id, runs=[flown.id])
    sent = client.comparisons.submit(version=model, runs=[flown.id])
    results = [client.comparisons.wait(job.id, check=True).result for job in (named, sent)]
    assert [r["logs"][0]["models"][0]["channels"] for r in results][0] == results[1]["logs"][0]["models"][0]["channels"]


def test_scenario_a_classifier_is_submitted_and_canceled(client: Client) -> None:
    # Training takes minutes; the server's own tests do it.
    job = client.classifiers.submit(method="paper", seeds=1, priority=-100)
    assert (job.kind, job.facts["seeds"]) == ("classifier", 1)
    client.classifiers.cancel(job.id)
    assert client.classifiers.wait(job.id).status == "canceled"
    with pytest.raises(NotFound):
        client.classifiers.submit(scenario="nowhere")


def test_scenario_an_fdi_session_says_what_the_run_said(client: Client, server: Server, flown: Run) -> None:
    frame = client.runs.telemetry_frame(flown.id)
    settings = {"calibration_start_s": 0.75, "calibration_end_s": 4.75}
    with client.fdi.open("f550", classifier="f550-improved", settings=settings) as session:
        assert session.opened.rate_hz == 400.0 and session.opened.detectors["calibration_end_s"] == 4.75
        windows = session.feed_frame(frame, chunk=500)
        assert windows and all(isinstance(window, FdiWindow) for window in windows)
        assert session.next_step == len(frame)
        last = windows[-1]
        assert last.calibration == "done" and last.sequential["verdict"] == "healthy"
        state = session.state()
        assert (state.samples, state.next_step, state.last) == (len(frame), len(frame), last)
        # What is refused changes nothing.
        with pytest.raises(Unprocessable):
            session.feed([])
        assert session.state().next_step == len(frame)
        one = json.loads(SAMPLE)
        assert session.feed([one], lost=4).first_step == len(frame) + 4
        session.next_step = 7
        with pytest.raises(Conflict):
            session.feed([one])
    with pytest.raises(NotFound):
        session.state()

    async def again() -> None:
        async with AsyncClient(server.url) as other:
            async with await other.fdi.open("f550", classifier="f550-improved", settings=settings) as twin:
                assert await twin.feed_frame(frame) == windows
                assert (await twin.state()).samples == len(frame)

    asyncio.run(again())
    with pytest.raises(ValueError, match="duty_1"):
        client.fdi.open("f550").feed_frame(frame.drop(columns=[f"duty_{rotor}" for rotor in range(1, 7)]))


def test_scenario_fdi_sessions_are_listed_watched_and_taken_over(client: Client, server: Server) -> None:
    sample = json.loads(SAMPLE)
    session = client.fdi.open("f550")
    with Client(server.url) as other:
        stream = other.fdi.events()
        opened = next(stream)
        assert opened.kind == "open" and session.id in [state.id for state in opened.sessions]
        assert session.id in [state.id for state in other.fdi.sessions()]
        session.feed([sample] * 10)
        fed = next(event for event in stream if event.kind == "session" and event.sessions[0].id == session.id)
        assert fed.sessions[0].next_step == 10
        # Another program goes on where this one was.
        taken = other.fdi.attach(session.id)
        assert taken.next_step == 10 and taken.feed([sample] * 5).next_step == 15
        taken.close()
        assert next(event for event in stream if event.kind == "closed").closed == session.id
        assert session.id not in [state.id for state in next(other.fdi.events(wait=False)).sessions]
        with pytest.raises(NotFound):
            other.fdi.attach(session.id)

    async def again() -> None:
        async with AsyncClient(server.url) as third:
            async with await third.fdi.open("f550") as twin:
                told = [event async for event in third.fdi.events(wait=False)]
                assert [event.kind for event in told] == ["open"] and twin.id in [state.id for state in told[0].sessions]
                assert twin.id in [state.id for state in await third.fdi.sessions()]
                assert (await third.fdi.attach(twin.id)).next_step == 0

    asyncio.run(again())


def test_scenario_watching_sessions_begins_again_after_broken_connections(fresh: Server) -> None:
    with proxied(fresh.port, ["503", "refuse", "cut:6000", "503"]) as proxy, Client(proxy.url, patience_s=20.0) as watcher:
        with Client(fresh.url) as client, client.fdi.open("f550") as session:
            opens = fed = 0
            for event in watcher.fdi.events():
                states = {state.id: state for state in event.sessions}
                if event.kind == "open":
                    assert states[session.id].next_step >= fed, "what was told meanwhile is in the states"
                    opens += 1
                if opens == 2:
                    break
                fed = session.feed([json.loads(SAMPLE)]).next_step
            assert fed > 1 and proxy.connections == 5


def test_scenario_a_log_is_judged(client: Client, server: Server, flown: Run, tmp_path: Path) -> None:
    report = client.fdi.judge(id=flown.id, vehicle="f550", classifier="f550-improved", flight=True)
    assert report["log"]["rows"] == 3200 and report["flight"]["outputs"] and report["detectors"]["classifier"]
    path = client.runs.download(flown.id, "telemetry.parquet", tmp_path / "hover.parquet")
    part = client.fdi.judge(path, vehicle="f550", part="1:7", calibration_start_s=0.75, calibration_end_s=4.75)
    assert part["log"]["rows"] < 3200 and part["detectors"]["calibration_end_s"] == 4.75 and "flight" not in part
    with pytest.raises(ValueError, match="got both"):
        client.fdi.judge(path, id=flown.id, vehicle="f550")
    with pytest.raises(NotFound):
        client.fdi.judge(path, vehicle="nowhere")

    async def again() -> None:
        async with AsyncClient(server.url) as other:
            assert (await other.fdi.judge(path.read_bytes(), vehicle="f550"))["log"]["rows"] == 3200

    asyncio.run(again())


def test_scenario_a_log_with_its_truth_is_scored(client: Client, server: Server, flown: Run, tmp_path: Path) -> None:
    answer = client.fdi.score(id=flown.id, vehicle="f550", truth="fault_label")
    assert answer["score"]["onset_s"] is None and answer["report"]["log"]["rows"] == 3200
    path = client.runs.download(flown.id, "telemetry.parquet", tmp_path / "hover.parquet")
    assert client.fdi.score(path, vehicle="f550", truth=[(0.0, 0, None)])["score"] == answer["score"]

    async def again() -> None:
        async with AsyncClient(server.url) as other:
            damaged = await other.fdi.score(path.read_bytes(), vehicle="f550", truth=[(5.0, 3, 0.1), (7.0, 3, 0.0)])
            assert damaged["score"]["onset_s"] == 5.0

    asyncio.run(again())
    with pytest.raises(Unprocessable, match="rotor 9"):
        client.fdi.score(path, vehicle="f550", truth=[(5.0, 9, 0.1)])
    with pytest.raises(ValueError, match="got neither"):
        client.fdi.score(vehicle="f550", truth="fault_label")


SAMPLE = """{"velocity_ned_m_s": [0, 0, 0], "attitude_rad": [0, 0, 0], "body_rates_rad_s": [0, 0, 0],
 "duty": [0.4, 0.4, 0.4, 0.4, 0.4, 0.4], "battery_voltage_v": 16.0}"""


def test_scenario_a_model_grows_by_versions(client: Client, server: Server) -> None:
    before = client.models.history("quad-x")
    assert before["begun"] is False and [version["version"] for version in before["versions"]] == [0]
    first = before["branches"][0]["hash"]
    added = client.models.add("quad-x", effect={"effect": "mass", "parameters": {"share": 0.1}}, note="heavier", seen=first)
    assert added["version"]["label"] == "quad-x@v1" and added["difference"]["parameters"][0]["after"]["value"] == 0.1
    with pytest.raises(Conflict, match="has changed in the meantime"):
        client.models.add("quad-x", effect={"effect": "mass", "parameters": {"share": 0.2}}, seen=first)
    assert "share = 0.1" in client.models.export("quad-x")
    client.models.branch("quad-x", "heavy", "v1")
    assert client.models.undo("quad-x")["version"]["hash"] == first
    assert client.models.diff("quad-x", "main", "heavy")["to"] == "quad-x@v1"
    with pytest.raises(NotFound, match="model or vehicle '"):
        client.models.history("nowhere")

    async def again() -> None:
        async with AsyncClient(server.url) as other:
            assert (await other.models.version("quad-x", "heavy"))["note"] == "heavier"
            await other.models.create("copy", {"model": "quad-x@heavy"})
            assert (await other.models.history("copy"))["versions"][0]["effects"][0]["effect"] == "mass"
            await other.models.delete("copy")

    asyncio.run(again())
    client.models.delete("quad-x")
