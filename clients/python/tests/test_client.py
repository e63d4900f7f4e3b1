"""The client against a real server."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from pathlib import Path

import httpx
import pytest

from conftest import ROOT, Server
from proxy import proxied
from rotortwin import (
    AsyncClient,
    BadRequest,
    Client,
    Conflict,
    ConnectionLost,
    Event,
    JobFailed,
    NotFound,
    Run,
    Unavailable,
    UnexpectedAnswer,
    Unprocessable,
)


def slow(client: Client, seconds: float) -> Run:
    """A hover as long in wall time."""
    return client.runs.submit("short-hover", pace="real-time", set={"duration_s": seconds})


@pytest.fixture(scope="session")
def done(server: Server) -> Run:
    """A flight that was done, for all tests that only look at it."""
    with Client(server.url) as client:
        run = client.runs.submit("short-hover", seed=7)
        return client.runs.wait(run.id, check=True)


def test_scenario_a_flight_is_submitted_watched_and_fetched(client: Client, done: Run, tmp_path: Path) -> None:
    assert done.seed == 7 and done.run_hash is not None and done.summary is not None
    assert done.summary["run_hash"] == done.run_hash
    kinds = [event.kind for event in client.runs.events(done.id)]
    assert kinds[0] == "queued" and kinds[-1] == "ended" and "progress" in kinds
    assert list(client.runs.events(done.id, after=len(kinds))) == []
    verified = client.runs.verify(done.id)
    assert verified.same and verified.again == done.run_hash

    files = {artifact.path: artifact.size for artifact in client.runs.artifacts(done.id)}
    folder = client.runs.download_all(done.id, tmp_path / "run")
    assert {str(p.relative_to(folder)): p.stat().st_size for p in folder.rglob("*") if p.is_file()} == files
    assert json.loads((folder / "summary.json").read_text())["run_hash"] == done.run_hash


def test_scenario_controllers_are_compared_and_autopilots_listed(client: Client, done: Run) -> None:
    assert client.runs.autopilots() == []
    with pytest.raises(Unprocessable, match="is not configured; this server has none"):
        client.runs.submit("autopilot-hover", controller={"autopilot": "bench-1"})
    again = client.runs.wait(client.runs.submit("short-hover", seed=8).id, check=True)
    table = client.runs.compare_controllers([done.id, again.id], within_m=0.2)
    assert table["within_m"] == 0.2 and table["differences"] == ["the seed differs: 7; 8"]
    rows = table["rows"]
    assert [row["run"] for row in rows] == [done.id, again.id]
    assert all(row["lockstep"] and row["position_m"]["rms"] <= row["position_m"]["max"] for row in rows)
    answer = client.runs.query("SELECT folder, count(*) AS steps FROM telemetry GROUP BY folder ORDER BY folder", [done.id, again.id])
    assert done.summary is not None
    assert answer.to_pylist() == [{"folder": id, "steps": done.summary["steps"]} for id in sorted([done.id, again.id])]


def test_scenario_telemetry_is_a_table(client: Client, done: Run) -> None:
    assert done.summary is not None
    table = client.runs.telemetry(done.id)
    frame = client.runs.telemetry_frame(done.id)
    assert table.num_rows == len(frame) == done.summary["steps"]
    assert list(frame.columns) == table.column_names
    one = table.column_names[0]
    assert client.runs.telemetry(done.id, columns=[one]).column_names == [one]


def test_scenario_channels_are_asked_for_by_name_and_interval(client: Client, done: Run) -> None:
    channels = {channel.name: channel for channel in client.runs.channels(done.id)}
    assert channels["roll_rad"].unit == "rad"
    some = client.runs.samples(done.id, ["roll_rad", "duty_*"], from_s=1.0, to_s=2.0, points=50)
    assert some.num_rows <= 50 and {"time_s", "roll_rad", "duty_1"} <= set(some.column_names)
    times = some.column("time_s").to_pylist()
    assert times == sorted(times) and times[0] >= 1.0 and times[-1] <= 2.0
    two = client.runs.samples([done.id, done.id], ["roll_rad"], points=10)
    assert two.column_names[0] == "run" and set(two.column("run").to_pylist()) == {done.id}
    with pytest.raises(Unprocessable):
        client.runs.samples(done.id, ["nothing"])


def test_scenario_runs_stand_side_by_side_and_leave_as_one_file(client: Client, done: Run, tmp_path: Path) -> None:
    assert done.summary is not None
    assert "steps" in client.runs.columns(name=done.name)
    table = client.runs.table(["steps"], name=done.name, limit=1000)
    row = next(row for row in table.dicts() if row["id"] == done.id)
    assert row == {"id": done.id, "name": done.name, "vehicle": done.vehicle, "seed": 7, "run_hash": done.run_hash, "steps": done.summary["steps"]}
    assert len(client.runs.table(["steps"], limit=1).rows) == 1 and client.runs.table(["steps"], parent=done.id).rows == []
    with pytest.raises(Unprocessable, match="no run has 'nothing'"):
        client.runs.table(["nothing"])
    with pytest.raises(ValueError, match="columns"):
        client.runs.table([])

    ulog = client.runs.export(done.id, "ulog", tmp_path / "run.ulg")
    assert ulog.read_bytes()[:4] == b"ULog" and [path.name for path in tmp_path.iterdir()] == ["run.ulg"]
    parquet = client.runs.export(done.id, "parquet", tmp_path / "run.parquet")
    assert parquet.read_bytes() == client.runs.artifact(done.id, "telemetry.parquet")
    long = slow(client, 60.0)
    with pytest.raises(Conflict):
        client.runs.export(long.id, "csv", tmp_path / "run.csv")
    client.runs.cancel(long.id)


def test_scenario_an_export_that_is_cut_off_begins_again(server: Server, done: Run, tmp_path: Path) -> None:
    with Client(server.url) as client:
        whole = client.runs.export(done.id, "ulog", tmp_path / "whole.ulg").read_bytes()
    with proxied(server.port, ["cut:50000", "refuse"]) as proxy, Client(proxy.url, patience_s=20.0) as client:
        assert client.runs.export(done.id, "ulog", tmp_path / "cut.ulg").read_bytes() == whole
        assert proxy.connections >= 3


def test_scenario_a_vehicle_is_drawn(client: Client, done: Run) -> None:
    flown, named = client.runs.geometry(done.id), client.vehicles.geometry("f550")
    assert [rotor.number for rotor in flown.rotors] == [1, 2, 3, 4, 5, 6] and flown.rotors == named.rotors
    assert named.effectiveness.rows == ["thrust", "roll", "pitch", "yaw"] and len(named.effectiveness.matrix[0]) == 6
    assert named.hover is not None and sum(named.hover.rotor_thrust_n) == pytest.approx(named.mass_kg * named.gravity_m_s2)
    assert client.models.geometry("f550") == named
    with pytest.raises(NotFound):
        client.vehicles.geometry("nowhere")
    with pytest.raises(NotFound):
        client.models.geometry("f550", "v9")


def test_scenario_the_server_says_who_one_is_and_what_there_is(client: Client, done: Run) -> None:
    identity = client.identity()
    assert not identity.needs_token and "write" in identity.scopes
    limits = client.limits()
    assert 0 < limits.bytes < limits.most_bytes and limits.open_jobs <= limits.most_open_jobs and limits.longest_flight_s > 0
    assert "detector-ideal" in [campaign.name for campaign in client.campaigns.library()]
    drag = next(effect for effect in client.effects.catalogue() if effect["id"] == "rotor-drag")
    assert drag["per_rotor"] in (True, False) and all(parameter["meaning"] for parameter in drag["parameters"])
    verified = client.runs.verify(done.id)
    assert client.verifications.get(verified.job).result["same"] and verified.job in [job.id for job in client.verifications.list()]


def test_scenario_one_stream_tells_the_events_of_all_jobs(fresh: Server) -> None:
    """Over broken connections and the death of the server, without gaps or repetition."""
    with proxied(fresh.port, ["cut:200", "503", "pass", "cut:900", "refuse"]) as proxy, Client(proxy.url, patience_s=30.0) as watcher:
        with Client(fresh.url, patience_s=30.0) as client:
            stream = watcher.events()
            opened = next(stream)
            assert (opened.kind, opened.job, opened.event.data) == ("open", "", {})
            runs = [client.runs.submit("short-hover", seed=1, link="in-process"), slow(client, 4.0)]
            ended: list[str] = []
            seen = [opened]
            killed = False
            while len(ended) < 2:
                event = next(stream)
                seen.append(event)
                if event.job == runs[1].id and event.kind == "progress" and not killed:
                    killed = True
                    fresh.kill()
                    fresh.start()
                if event.kind == "ended":
                    ended.append(event.job)
            assert set(ended) == {run.id for run in runs} and all(one.collection == "runs" and one.job_kind == "run" for one in seen[1:])
            for run in runs:
                assert [one.event for one in seen if one.job == run.id] == list(client.runs.events(run.id))
            assert "requeued" in [one.kind for one in seen]
            # From any place, what follows; and without the most frequent events.
            again = list(client.events(after=opened.place, wait=False))
            assert again == seen[1:]
            assert list(client.events(after=seen[5].place, wait=False)) == seen[6:]
            quiet = client.events(after=opened.place, progress=False, wait=False)
            assert list(quiet) == [one for one in seen[1:] if one.kind != "progress"]
            assert [one.kind for one in client.events(wait=False)] == ["open"]
            with pytest.raises(BadRequest, match="yesterday"):
                list(client.events(after="yesterday"))

            async def there() -> None:
                async with AsyncClient(fresh.url) as other:
                    assert [event async for event in other.events(after=opened.place, wait=False)] == again

            asyncio.run(there())


def test_scenario_sql_is_answered_by_the_server(client: Client, server: Server, done: Run) -> None:
    assert done.summary is not None
    sql = "SELECT folder, count(*) AS rows, max(time_s) AS last_s FROM telemetry GROUP BY folder"
    answer = client.query(sql, runs=[done.id])
    assert answer.dicts() == [{"folder": done.id, "rows": done.summary["steps"], "last_s": 4.9975}]
    assert [column.type for column in answer.columns] == ["VARCHAR", "BIGINT", "DOUBLE"] and not answer.more
    assert client.query("SELECT time_s FROM telemetry", runs=[done.id], rows=2).more
    with pytest.raises(Unprocessable, match="SQL"):
        client.query("SELEC 1", runs=[done.id])
    with pytest.raises(NotFound, match="nobody"):
        client.query("SELECT 1", runs=["nobody"])

    async def there() -> int:
        async with AsyncClient(server.url) as other:
            return len((await other.query("SELECT 1", runs=[done.id])).rows)

    assert asyncio.run(there()) == 1


def test_scenario_the_library_is_listed_and_scenarios_are_checked(client: Client) -> None:
    assert client.ready()
    assert "short-hover" in client.scenarios.list() and "f550" in client.vehicles.list()
    text = client.scenarios.get("short-hover")
    assert "duration_s" in text and "mass_kg" in client.vehicles.get("f550")
    assert client.scenarios.validate(text=text).valid
    refused = client.scenarios.validate("short-hover", set={"duration_s": -1})
    assert not refused.valid and refused.refusal is not None and "duration_s" in refused.refusal


def test_scenario_documents_of_ones_own_are_left_used_and_taken_away(client: Client) -> None:
    text = client.vehicles.get("f550")
    client.vehicles.put("mine", text.replace("mass_kg = 1.55", "mass_kg = 1.75"))
    assert "mine" in client.vehicles.list()
    with pytest.raises(Conflict):
        client.vehicles.put("mine", text, only_new=True)
    bad = text.replace("mass_kg = 1.55", "mass_kg = -1").replace("moment_ratio_m = 0.016", "moment_ratio_m = 16")
    with pytest.raises(Unprocessable) as refused:
        client.vehicles.put("mine", bad)
    assert len(refused.value.complaints) == 2
    found = client.vehicles.check(bad)
    assert not found.valid and [complaint.key for complaint in found.complaints] == ["body.mass_kg", "rotors.layout.moment_ratio_m"]
    scenario = client.scenarios.get("short-hover").replace("../vehicles/f550.toml", "../vehicles/mine.toml")
    run = client.runs.submit(text=scenario, link="in-process")
    assert client.runs.wait(run.id, check=True).vehicle == "DJI F550"
    own = client.runs.submit("short-hover", link="in-process", model={"vehicle": "mine"}, fdi_model={"vehicle": "f550"})
    assert client.runs.wait(own.id, check=True).status == "done"
    assert "mine" in client.vehicles.list(own=True) and "f550" not in client.vehicles.list(own=True)
    first = client.vehicles.put("mine", text)
    second = client.vehicles.put("mine", text + "\n# again\n", replaces=first)
    assert second != first
    with pytest.raises(Conflict):
        client.vehicles.put("mine", text, replaces=first)
    client.vehicles.delete("mine")
    with pytest.raises(NotFound):
        client.vehicles.get("mine")


def test_scenario_a_blind_bench_is_scored(client: Client, tmp_path: Path) -> None:
    for name in ("vehicles/f550.toml", "blades/t9545.toml"):
        target = tmp_path / name.replace("f550", "mine")
        target.parent.mkdir()
        target.write_text((ROOT / "config" / name).read_text())
    job = client.blind_benches.submit(2, presets=["null-hover"], vehicles=["f550", tmp_path / "vehicles/mine.toml"], duration_s=10.0)
    seen: list[str] = []
    done = client.blind_benches.wait(job.id, check=True, progress=lambda event: seen.append(event.kind))
    assert done.kind == "blind-bench" and done.result["groups"][0]["cases"] == 2
    assert seen.count("case") == 2
    vehicles = client.blind_benches.rows(done.id).column("vehicle").to_pylist()
    assert vehicles == ["config/vehicles/f550.toml", "config/vehicles/mine.toml"]
    assert "Blind bench" in client.blind_benches.report(done.id)

    cases = list(client.blind_benches.cases(done.id, page_size=1))
    assert [(one.case, one.vehicle, one.hidden, one.log) for one in cases] == [(0, "f550", "nothing", None), (1, "mine", "nothing", None)]
    assert cases[1] in list(client.blind_benches.cases(done.id, hidden="nothing", named=cases[1].named, outcome=cases[1].outcome, preset="null-hover"))
    assert not list(client.blind_benches.cases(done.id, hidden="mass"))
    whole = client.blind_benches.case(done.id, 1)
    assert whole.truth is not None and whole.truth["effects"] == [] and whole.diagnosis is not None and whole.diagnosis["verdict"]["kind"]
    log = client.blind_benches.log(done.id, 1)
    assert client.logs.wait(log.id, check=True).parent == done.id
    assert client.blind_benches.log(done.id, 1).id == log.id == client.blind_benches.case(done.id, 1).log
    with pytest.raises(Unprocessable, match="nonsense"):
        client.blind_benches.submit(1, presets=["nonsense"])
    with pytest.raises(NotFound, match="vehicle"):
        client.blind_benches.submit(1, vehicles=["nobody"])


CAMPAIGN = """
name = "small"
description = "eight flights"
scenario = "../scenarios/short-hover.toml"
seed = 5
flights = 8
[set]
duration_s = 6.0
[set.fdi]
calibration_start_s = 0.75
calibration_end_s = 4.75
[[axis]]
name = "charge"
key = "initial.state_of_charge"
uniform = [0.5, 1.0]
"""


def test_scenario_a_campaign_is_flown(client: Client, server: Server, tmp_path: Path) -> None:
    job = client.campaigns.submit(text=CAMPAIGN)
    done = client.campaigns.wait(job.id, check=True)
    assert done.result["flights"] == 8 and done.kind == "campaign"
    assert done.id in [one.id for one in client.campaigns.list()]
    assert client.jobs("campaigns").get(done.id) == done
    folder = client.campaigns.download_all(done.id, tmp_path / "campaign")
    assert (folder / "report.html").exists()
    with pytest.raises(Unprocessable, match="name"):
        client.campaigns.submit(text="name = 3")
    with pytest.raises(Conflict, match="started by the server"):
        client.runs.ticket(client.runs.submit("short-hover", link="in-process").id)

    healthy = list(client.campaigns.flights(done.id, truth=0, verdict=[0, 3], page_size=3))
    windows = done.result["detectors"]["sequential"]["confusion_truth_verdict_windows"]
    assert sum(one.windows for one in healthy) == sum(count for truth, verdict, count in windows if truth == 0 and verdict in (0, 3))
    assert not list(client.campaigns.flights(done.id, detector="t_test", truth=4))
    assert 0.5 <= healthy[3].parameters["charge"] <= 1.0 and healthy[3].run is None
    run = client.runs.wait(client.campaigns.fly(done.id, 3).id, check=True)
    assert (run.run_hash, run.seed, run.parent, run.verdict) == (healthy[3].run_hash, healthy[3].seed, done.id, healthy[3].verdict_at_end)
    assert [one.run for one in client.campaigns.flights(done.id)][3] == run.id
    assert [one.id for one in client.runs.list(parent=done.id, verdict=run.verdict)] == [run.id]
    with pytest.raises(NotFound, match="expected 0 to 7"):
        client.campaigns.fly(done.id, 8)

    async def again() -> None:
        async with AsyncClient(server.url) as other:
            twin = await other.campaigns.submit(text=CAMPAIGN)
            assert (await other.campaigns.wait(twin.id)).result["hash"] == done.result["hash"]
            assert [one.flight async for one in other.campaigns.flights(done.id, page_size=3)] == list(range(8))
            assert (await other.campaigns.fly(done.id, 3)).id == run.id

    asyncio.run(again())


def test_scenario_a_file_of_this_machine_is_flown(client: Client) -> None:
    run = client.runs.submit(ROOT / "config/scenarios/short-hover.toml", seed=3, link="in-process")
    named = client.runs.submit("short-hover", seed=3, link="in-process")
    assert client.runs.wait(run.id, check=True).run_hash == client.runs.wait(named.id, check=True).run_hash


def test_scenario_refusals_are_exceptions_with_the_servers_sentence(client: Client) -> None:
    with pytest.raises(NotFound, match="short-hover") as missing:
        client.runs.submit("nowhere")
    assert missing.value.status == 404 and missing.value.request_id
    with pytest.raises(Unprocessable, match="duration_s"):
        client.runs.submit("short-hover", set={"duration_s": -3})
    with pytest.raises(NotFound, match="no run"):
        client.runs.get("nothing")
    with pytest.raises(NotFound, match="no run"):
        list(client.runs.events("nothing"))
    client.runs.submit("short-hover", idempotency_key="one", link="in-process")
    with pytest.raises(Conflict):
        client.runs.submit("short-hover", seed=2, idempotency_key="one")


def test_scenario_runs_are_listed_over_pages_forked_canceled_and_deleted(client: Client, done: Run) -> None:
    fork = client.runs.fork(done.id, healthy=True, seed=9)
    assert (fork.parent, fork.seed) == (done.id, 9)
    everything = [run.id for run in client.runs.list()]
    assert everything == sorted(everything, reverse=True) and {fork.id, done.id} <= set(everything)
    assert [run.id for run in client.runs.list(page_size=1)] == everything
    assert done.id in {run.id for run in client.runs.list(status="done", name=done.name, page_size=2)}
    client.runs.wait(fork.id)

    run = slow(client, 60.0)
    assert client.runs.cancel(run.id).cancel_requested
    with pytest.raises(JobFailed, match="canceled") as failed:
        client.runs.wait(run.id, check=True)
    assert failed.value.status == "canceled"
    client.runs.delete(run.id)
    with pytest.raises(NotFound):
        client.runs.get(run.id)


def test_scenario_progress_is_told_and_drawn(client: Client, done: Run, capfd: pytest.CaptureFixture[str]) -> None:
    seen: list[Event] = []
    client.runs.wait(done.id, progress=seen.append)
    shares = [event.share for event in seen if event.share is not None]
    assert shares == sorted(shares) and shares[-1] == 1.0
    client.runs.wait(done.id, progress=True)
    assert "100 %" in capfd.readouterr().err


def test_scenario_a_server_that_is_killed_and_started_again_leaves_no_gap(fresh: Server) -> None:
    with Client(fresh.url, patience_s=30.0) as client:
        run = slow(client, 4.0)
        events: list[Event] = []
        flying, again = threading.Event(), threading.Event()

        def killer() -> None:
            assert flying.wait(20.0)
            fresh.kill()
            time.sleep(0.5)
            fresh.start()
            again.set()

        thread = threading.Thread(target=killer)
        thread.start()

        def see(event: Event) -> None:
            events.append(event)
            if event.kind == "progress":
                flying.set()

        ended = client.runs.wait(run.id, progress=see)
        thread.join()
        assert again.is_set() and ended.status == "done" and ended.attempts == 2
        assert [event.id for event in events] == list(range(1, len(events) + 1))
        kinds = [event.kind for event in events]
        assert kinds.count("started") == 2 and kinds.count("ended") == 1 and "requeued" in kinds
        assert events == list(client.runs.events(run.id))


def test_scenario_a_submission_whose_answer_is_lost_makes_one_run(fresh: Server) -> None:
    with proxied(fresh.port, ["refuse", "swallow", "503", "cut:20", "pass"]) as proxy:
        with Client(proxy.url, patience_s=20.0) as client:
            run = client.runs.submit("short-hover", link="in-process")
            assert proxy.connections == 5
    with Client(fresh.url) as client:
        assert [one.id for one in client.runs.list()] == [run.id]
        client.runs.wait(run.id)


def test_scenario_events_and_files_go_on_after_broken_connections(server: Server, done: Run, tmp_path: Path) -> None:
    with Client(server.url) as client:
        events = list(client.runs.events(done.id))
        whole = client.runs.artifact(done.id, "run.mcap")
    with proxied(server.port, ["cut:300", "503", "cut:700", "refuse"]) as proxy, Client(proxy.url, patience_s=20.0) as client:
        assert list(client.runs.events(done.id)) == events
        assert proxy.connections >= 5
    target = tmp_path / "run.mcap"
    with proxied(server.port, ["cut:50000", "refuse", "cut:60000"]) as proxy, Client(proxy.url, patience_s=20.0) as client:
        client.runs.download(done.id, "run.mcap", target)
        assert proxy.connections >= 4 and target.read_bytes() == whole
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_scenario_a_download_goes_on_where_an_earlier_one_was_given_up(server: Server, done: Run, tmp_path: Path) -> None:
    target = tmp_path / "run.mcap"
    with proxied(server.port, ["cut:50000"] + ["refuse"] * 50) as proxy, Client(proxy.url, patience_s=0.3) as client:
        with pytest.raises(ConnectionLost, match="no answer"):
            client.runs.download(done.id, "run.mcap", target)
    part = tmp_path / "run.mcap.part"
    begun = part.stat().st_size
    assert 0 < begun < 50000 and not target.exists()
    with Client(server.url) as client:
        client.runs.download(done.id, "run.mcap", target)
        assert target.read_bytes() == client.runs.artifact(done.id, "run.mcap")
        # A partial download of another file is not continued.
        other = tmp_path / "other"
        (tmp_path / "other.part").write_bytes(b"x" * 100)
        (tmp_path / "other.part.etag").write_text('"another"')
        client.runs.download(done.id, "run.mcap", other)
        assert other.read_bytes() == target.read_bytes()


def test_scenario_patience_ends_with_one_sentence(server: Server) -> None:
    with Client("http://127.0.0.1:9", patience_s=0.3) as client, pytest.raises(ConnectionLost, match="127.0.0.1:9 gave no answer"):
        client.runs.get("x")
    with proxied(server.port, ["503"] * 9) as proxy, Client(proxy.url, patience_s=0.5) as client, pytest.raises(Unavailable):
        client.runs.get("x")


def test_scenario_the_same_with_asyncio(server: Server, done: Run, tmp_path: Path) -> None:
    async def fly() -> None:
        async with AsyncClient(server.url) as client:
            assert await client.ready() and "short-hover" in await client.scenarios.list()
            assert (await client.scenarios.validate("short-hover")).valid
            await client.effects.put("fin", ROOT / "config/effects/fin-drag.toml")
            assert "drag" in await client.effects.get("fin") and (await client.effects.check("x = 1")).complaints
            await client.effects.delete("fin")
            runs = [await client.runs.submit("short-hover", seed=seed, link="in-process") for seed in (7, 8)]
            ended = await asyncio.gather(*(client.runs.wait(run.id, check=True) for run in runs))
            assert ended[0].run_hash == done.run_hash != ended[1].run_hash
            numbers = [event.id async for event in client.runs.events(ended[0].id)]
            assert numbers == list(range(1, len(numbers) + 1))
            assert {run.id for run in runs} <= {run.id async for run in client.runs.list(page_size=1)}
            assert (await client.runs.telemetry(ended[0].id)).num_rows == len(await client.runs.telemetry_frame(ended[0].id))
            assert "roll_rad" in [channel.name for channel in await client.runs.channels(ended[0].id)]
            assert (await client.runs.samples(ended[0].id, ["roll_rad"], points=20)).num_rows <= 20
            assert (await client.runs.verify(ended[1].id)).same
            fork = await client.runs.fork(ended[1].id, healthy=True)
            assert (await client.runs.wait(fork.id)).status == "done"
            folder = await client.runs.download_all(fork.id, tmp_path / "run")
            assert (folder / "report.html").exists()
            long = await client.runs.submit("short-hover", pace="real-time", set=["duration_s=60.0"])
            await client.runs.cancel(long.id)
            assert (await client.runs.wait(long.id)).status == "canceled"
            await client.runs.delete(long.id)
            with pytest.raises(NotFound):
                await client.runs.get(long.id)

    asyncio.run(fly())


def test_scenario_asyncio_comes_back_over_broken_connections(server: Server, done: Run, tmp_path: Path) -> None:
    async def fetch(url: str) -> list[Event]:
        async with AsyncClient(url, patience_s=20.0) as client:
            await client.runs.download(done.id, "run.mcap", tmp_path / "run.mcap")
            return [event async for event in client.runs.events(done.id)]

    with proxied(server.port, ["refuse", "cut:50000", "pass", "cut:400", "503"]) as proxy:
        events = asyncio.run(fetch(proxy.url))
    with Client(server.url) as client:
        assert events == list(client.runs.events(done.id))
        assert (tmp_path / "run.mcap").read_bytes() == client.runs.artifact(done.id, "run.mcap")


def test_scenario_another_program_is_told_apart() -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        return httpx.Response(200, json={"hello": "world"})

    with Client("http://elsewhere") as client:
        client._transport.http = httpx.Client(transport=httpx.MockTransport(answer))
        with pytest.raises(UnexpectedAnswer, match="rotortwin server"):
            client.runs.get("x")
