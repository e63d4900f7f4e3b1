"""The twin in this process: the same answers from files, frames and dicts."""

from pathlib import Path
from typing import Any

import pytest

import rotortwin

DRAG = {"effect": "rotor-drag", "parameters": {"drag_n_s_m": 0.25}}
MEASURED = (
    "time_s", "position_", "velocity_", "roll_rad", "pitch_rad", "yaw_rad", "roll_rate", "pitch_rate", "yaw_rate", "duty_",
    "battery_voltage_v",
)  # fmt: skip


@pytest.fixture(scope="module")
def log() -> dict[str, Any]:
    """What a vehicle with a drag that the F550's file does not have would have logged."""
    settings = {"duration_s": 40.0, "fault": [], "effect": [DRAG]}
    kept = rotortwin.Simulation("helix-2", seed=4, set=settings).run().telemetry()
    return {name: values for name, values in kept.items() if name.startswith(MEASURED)}


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
