"""The twin in this process: the same answers from files, frames and dicts."""

import json
import os
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

import rotortwin

PROGRAM = os.environ.get("ROTORTWIN_PROGRAM", "rotortwin")
DRAG = {"effect": "rotor-drag", "parameters": {"drag_n_s_m": 0.25}}
MEASURED = (
    "time_s", "position_", "velocity_", "roll_rad", "pitch_rad", "yaw_rad", "roll_rate", "pitch_rate", "yaw_rate", "duty_",
    "battery_voltage_v",
)  # fmt: skip


@pytest.fixture(scope="module")
def log() -> dict[str, Any]:
    """What a vehicle with a drag that the F550's file does not have would have logged."""
    settings = {"duration_s": 26.0, "fault": [], "effect": [DRAG]}
    kept = rotortwin.Simulation("helix-2", seed=4, set=settings).run().telemetry()
    return {name: values for name, values in kept.items() if name.startswith(MEASURED)}


@pytest.mark.of_the_engine
def test_val_a_hidden_drag_is_named_from_any_table(log: dict[str, Any], tmp_path: Path) -> None:
    found = rotortwin.diagnose(log, "f550")
    assert found.sentence.startswith("Missing: rotor drag")
    [effect] = found["effects"]
    [drag] = effect["parameters"]
    assert abs(drag["value"] - 0.25) < 4 * drag["deviation"] + 0.002
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(log)
    frame.to_csv(tmp_path / "flight.csv", index=False)
    others: list[Any] = [frame, ("flight", frame), tmp_path / "flight.csv"]
    if polars := pytest.importorskip("polars"):
        others.append(polars.DataFrame(log))
    others.append(pytest.importorskip("pyarrow").Table.from_pandas(frame))
    for other in others:
        assert rotortwin.diagnose(other, "f550").sentence.startswith("Missing: rotor drag, k_d = 0.250")
    assert "rotor drag" in repr(found) and "rotor drag" in found._repr_html_()


@pytest.mark.of_the_engine
def test_val_the_error_falls_once_the_effect_is_added(log: dict[str, Any], tmp_path: Path) -> None:
    improved = rotortwin.improve(log, "f550")
    improved.write(tmp_path / "better.toml")
    before, after = (rotortwin.compare(log, model)["verdict"] for model in ("f550", tmp_path / "better.toml"))
    assert "agrees" not in before and "agrees" in after
    assert rotortwin.diagnose(log, tmp_path / "better.toml")["verdict"]["kind"] == "agrees"


def test_regress_an_empty_column_is_none(log: dict[str, Any]) -> None:
    import numpy as np

    empty = np.full(len(log["time_s"]), np.nan)
    with_empty = {**log, "accel_x_m_s2": empty, "accel_y_m_s2": empty, "accel_z_m_s2": empty}
    assert rotortwin.diagnose(with_empty, "f550").sentence.startswith("Missing: rotor drag")


def test_regress_bad_logs_are_one_sentence(log: dict[str, Any]) -> None:
    without_time = {name: values for name, values in log.items() if name != "time_s"}
    for bad, words in [
        (without_time, "time_s"),
        ({**log, "roll_rad": ["level"] * len(log["time_s"])}, "roll_rad"),
        ("nowhere.csv", "nowhere.csv"),
        (7, "expected a path"),
    ]:
        with pytest.raises(ValueError, match=words):
            rotortwin.diagnose(bad, "f550")
    with pytest.raises(ValueError, match="f550"):
        rotortwin.diagnose(log, "f55")
    with pytest.raises(ValueError, match="mass"):
        rotortwin.vehicle_from_log(log, mass_kg=-1.0, arm_m=0.3)
    with pytest.raises(ValueError, match="nowhere.csv"):
        rotortwin.vehicle_from_log(log, mass_kg=1.55, arm_m=0.275, bench="nowhere.csv")


@pytest.fixture(scope="module")
def damaged() -> dict[str, Any]:
    """What would have been logged of a flight that loses 8 % of the thrust of rotor 4 at 12 s."""
    fault = {"time_s": 12.0, "rotor": 4, "thrust_loss_percent": 8.0}
    kept = rotortwin.Simulation("hover", seed=7, set={"duration_s": 20.0, "fault": [fault]}).run().telemetry()
    return {name: values for name, values in kept.items() if name.startswith(MEASURED)}


def test_val_a_damaged_rotor_of_a_table_is_named(damaged: dict[str, Any], log: dict[str, Any]) -> None:
    seen = rotortwin.fdi_log(damaged, "f550", windows=True)
    assert "rotor 4 lost" in seen.sentence and seen.sentence in repr(seen)
    [loss] = seen["final_window"]["sequential"]["thrust_loss"]
    assert loss["share_low"] <= 0.08 <= loss["share_high"]
    frame = seen.frame()
    assert frame.query("code == 4").time_s.min() < 13.0
    assert len(frame) > 200 > len(rotortwin.fdi_log(damaged, "f550").frame())
    assert set(rotortwin.fdi_log(log, "f550").frame().verdict) <= {"not_ready", "healthy", "cannot_judge"}


def test_regress_what_cannot_be_judged_says_why(damaged: dict[str, Any]) -> None:
    without = {name: values for name, values in damaged.items() if not name.startswith("roll_rate")}
    assert rotortwin.fdi_log(without, "f550").sentence == "cannot judge: the log lacks roll_rate_rad_s"
    for arguments, words in [({"set": {"calibration": 3}}, "calibration"), ({"classifier": "nothing.json"}, "nothing.json")]:
        with pytest.raises(ValueError, match=words):
            rotortwin.fdi_log(damaged, "f550", **arguments)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="4 of the vehicle"):
        rotortwin.fdi_log(damaged, "quad-x")


def test_regress_what_is_no_table_is_told(log: dict[str, Any], tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(log)
    dated = frame.assign(time_s=pandas.to_datetime(frame.time_s, unit="s"))
    twice = pandas.concat([frame, frame[["duty_1"]]], axis=1)
    for wrong, words in (
        (twice, "expected each column once, got 'duty_1' 2 times"),
        ((frame, frame), "a tuple is"),
        (dated, "column 'time_s': expected numbers in SI units"),
    ):
        with pytest.raises(rotortwin.InputError, match=words):
            rotortwin.compare(wrong, "f550")
    frame.to_csv(tmp_path / "flight.csv", index=False)
    path = tmp_path / "flight.csv"
    assert len(rotortwin.compare((path, path), ("f550",))["logs"]) == 2


def commands_json(folder: Path, *arguments: str) -> Any:
    """What a command prints with `--json`."""
    said = subprocess.run([PROGRAM, *arguments, "--json"], cwd=folder, check=False, capture_output=True, text=True)
    assert said.returncode == 0, f"{arguments}: {said.stderr}"
    return json.loads(said.stdout)


@pytest.mark.of_the_engine
def test_regress_answers_are_those_of_the_commands_bit_for_bit(
    log: dict[str, Any], damaged: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pandas = pytest.importorskip("pandas")
    # Both take the models of the folder they are started in.
    monkeypatch.chdir(tmp_path)
    for name, columns in (("drag.csv", log), ("damaged.csv", damaged)):
        # Doubles are written in full, so that the file holds the same bits as the table.
        pandas.DataFrame(columns).astype("float64").to_csv(name, index=False)
    subprocess.run([PROGRAM, "model", "add", "f550", "rotor-drag", "drag_n_s_m=0.1±0.05"], check=True, capture_output=True)
    calls: tuple[tuple[str, Callable[[Any, str], Any], str, dict[str, Any], str], ...] = (
        ("diagnose", rotortwin.diagnose, "drag", log, "f550@v0"),
        ("diagnose", rotortwin.diagnose, "drag", log, "f550"),
        ("compare", rotortwin.compare, "drag", log, "f550"),
        ("compare", rotortwin.compare, "damaged", damaged, "f550@v0"),
        ("fdi-log", rotortwin.fdi_log, "damaged", damaged, "f550"),
        ("fdi-log", rotortwin.fdi_log, "drag", log, "f550@v0"),
    )
    for command, call, name, columns, model in calls:
        told = commands_json(tmp_path, command, f"{name}.csv", "--model", model)
        # Numbers are written with as many digits as their bits need: equal numbers are equal bits.
        assert dict(call(f"{name}.csv", model)) == told, f"{command} {name} {model}"
        # A table has no content of a file to be hashed.
        of_a_table = json.loads(json.dumps(dict(call((name, columns), model))))
        for found in (of_a_table, told):
            for each in [found, *found.get("logs", [])]:
                if isinstance(each, dict) and isinstance(each.get("log"), dict):
                    each["log"].pop("hash", None)
                    each["log"].pop("content_hash", None)
        assert of_a_table == told, f"{command} {name} {model}, a table"


@pytest.mark.of_the_engine
def test_scenario_other_threads_go_on_meanwhile(log: dict[str, Any]) -> None:
    flight = rotortwin.Simulation("hover", set={"duration_s": 900.0}, record=[])
    works: dict[str, Callable[[], object]] = {
        "step": lambda: flight.step(steps=300_000),
        "diagnose": lambda: rotortwin.diagnose([log] * 4, "f550"),
    }
    for name, work in works.items():
        ticks: list[float] = []
        ended = threading.Event()

        def tick(ticks: list[float] = ticks, ended: threading.Event = ended) -> None:
            while not ended.wait(0.001):
                ticks.append(time.monotonic())

        other = threading.Thread(target=tick)
        other.start()
        begin = time.monotonic()
        work()
        taken = time.monotonic() - begin
        ended.set()
        other.join(timeout=10.0)
        # Long enough to tell: with the lock held, the other thread would have stood still in the middle of it.
        assert taken > 0.05, f"{name} took {taken:.3f} s"
        inside = [at for at in ticks if begin + taken / 4 < at < begin + 3 * taken / 4]
        assert len(inside) >= 3, f"{name}: {len(inside)} ticks of another thread in the middle half of {taken:.3f} s"


def drawn(result: Any) -> ElementTree.Element:
    """The picture of a result in a notebook, which must be well-formed."""
    html = result._repr_html_()
    words, picture = html.split("</p>", 1)
    assert words.startswith("<p>") and "<script" not in html
    return ElementTree.fromstring(picture)


@pytest.mark.of_the_engine
def test_scenario_results_are_pictures_in_a_notebook(log: dict[str, Any], damaged: dict[str, Any]) -> None:
    svg = "{http://www.w3.org/2000/svg}"
    found = rotortwin.diagnose(log, "f550")
    assert "half of a 95 % interval" in found._repr_html_()
    picture = drawn(found)
    # The only parameter: a point between the ends of its interval, right of zero.
    [point] = picture.findall(f"{svg}circle")
    zero, interval = picture.findall(f"{svg}line")
    left, right = float(interval.attrib["x1"]), float(interval.attrib["x2"])
    assert float(zero.attrib["x1"]) < left < float(point.attrib["cx"]) < right
    assert any("0.25" in (text.text or "") for text in picture.findall(f"{svg}text"))

    compared = rotortwin.compare(log, "f550")
    channels = [each["channel"] for each in compared["logs"][0]["models"][0]["channels"] if each["smoothed_rms"] is not None]
    picture = drawn(compared)
    widths = [float(bar.attrib["width"]) for bar in picture.findall(f"{svg}rect")]
    assert len(widths) == len(channels) > 5 and max(widths) > 1.5 * sorted(widths)[len(widths) // 2], "the drag stands out"

    improved = rotortwin.improve(log, "f550")
    before, after = (float(bar.attrib["width"]) for bar in drawn(improved).findall(f"{svg}rect"))
    assert after < 0.7 * before

    for windows in (False, True):
        seen = rotortwin.fdi_log(damaged, "f550", windows=windows)
        picture = drawn(seen)
        assert len(picture.findall(f"{svg}path")) == 3
        assert all("nan" not in line.attrib["d"] for line in picture.findall(f"{svg}path"))
    # What has nothing to draw says why.
    without = {name: values for name, values in damaged.items() if not name.startswith("roll_rate")}
    assert "cannot judge" in rotortwin.fdi_log(without, "f550")._repr_html_()
