"""Detectors of one's own: what they see, how they are scored."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

import rotortwin
from rotortwin import InputError, detectors, reference_detectors

# The command of the wheel that is tested.
PROGRAM = os.environ.get("ROTORTWIN_PROGRAM", "rotortwin")
CASES = detectors.steps([0.1], seeds=[1], rotors=[1, 4], healthy=1)


class Says(detectors.Detector):
    """Always the same."""

    name = "says"

    def __init__(self, code: int) -> None:
        self.code = code

    def judge(self, flight: detectors.Flight) -> ArrayLike:
        return np.full(flight.window_count, self.code)


class Counts(detectors.StepDetector):
    name = "counts"
    seen: set[str]

    def begin(self, rotor_count: int) -> None:
        self.steps = 0

    def step(self, sample: dict[str, float]) -> int:
        self.seen = set(sample)
        self.steps += 1
        return 1 if self.steps > 6000 else 0


def rows(scores: detectors.Scores, name: str) -> list[detectors.Row]:
    return [row for row in scores.rows if row.detector == name]


def test_val_intervals() -> None:
    # Table of the Poisson distribution (Garwood 1936); Wilson's for 9 of 10.
    assert detectors.poisson(0) == pytest.approx((0.0, 3.6889), abs=1e-3)
    assert detectors.poisson(3) == pytest.approx((0.6187, 8.7673), abs=1e-3)
    assert detectors.wilson(9, 10) == pytest.approx((0.5958, 0.9821), abs=1e-3)


def test_val_a_score_counts_what_was_said() -> None:
    # 20 s, the fault at 12 s: windows from 10 s on are scored, 32 of 160 before it.
    calm, faulty = rows(detectors.score([Says(0)], CASES), "says")
    assert (calm.flights, calm.right, calm.false_alarms, calm.found) == (1, 1.0, 0, None)
    assert (faulty.flights, faulty.found, faulty.settled, faulty.wrong_rotor) == (2, 0, 0, 0)
    assert faulty.right == pytest.approx(32 / 160)
    calm, faulty = rows(detectors.score([Says(1)], CASES), "says")
    assert (calm.right, calm.wrong_rotor, calm.false_alarms) == (0.0, 1, 0)  # the alarm began before the scored time
    assert (faulty.found, faulty.settled, faulty.wrong_rotor) == (1, 1, 2)
    assert faulty.first_s == pytest.approx(detectors.WINDOW_S)
    scores = detectors.score([Counts()], CASES)
    calm, faulty = rows(scores, "counts")
    assert calm.false_alarms == 1
    assert calm.healthy_h == pytest.approx(10.0 / 3600.0)
    assert faulty.first_s == pytest.approx(15.0 + detectors.WINDOW_S - 12.0)
    assert max(map(len, str(scores).splitlines())) <= 80 and len(scores.frame()) == len(scores.rows)


def test_scenario_a_detector_never_sees_the_truth() -> None:
    own = Counts()
    detectors.score([own], CASES[:1])
    assert own.seen >= {"time_s", "duty_6", "yaw_rate_rad_s", "wrench_residual_mz_nms"}
    assert not [name for name in own.seen if "true" in name or "fault" in name or "verdict" in name or "loss" in name]


def test_val_ours_are_scored_as_the_flight_recorded_them() -> None:
    _, faulty = rows(detectors.score([Says(0)], CASES), "our sequential")
    assert (faulty.found, faulty.settled, faulty.wrong_rotor, faulty.false_alarms) == (2, 2, 0, 0)
    assert faulty.first_s < 0.3


def test_scenario_detectors_of_the_literature_learn_and_find() -> None:
    pytest.importorskip("sklearn")
    lessons = detectors.steps([0.1], seeds=[100])
    own = [reference_detectors.Cusum(), reference_detectors.BoostedTrees(max_iter=30)]
    scores = detectors.score(own, CASES, learn_from=lessons)
    for name in ("CUSUM", "boosted trees"):
        assert rows(scores, name)[1].found == 2


def test_regress_refusals_are_one_sentence() -> None:
    class Short(Says):
        def judge(self, flight: detectors.Flight) -> ArrayLike:
            return [0]

    class Fractions(Says):
        def judge(self, flight: detectors.Flight) -> ArrayLike:
            return np.full(flight.window_count, 0.5)

    refused: list[tuple[Any, Any, str]] = [
        (Short(0), {}, "says: expected 320 verdicts"),
        (Fractions(0), {}, "whole numbers"),
        (reference_detectors.Cusum(), {}, "expected flights to learn from"),
        (reference_detectors.Cusum(), {"learn_from": detectors.steps([0.1], seeds=[2], rotors=[1])}, "rotor 2 has none"),
        (Says(0), {"learn_from": CASES}, "expected other flights to learn from"),
    ]
    for own, more, words in refused:
        with pytest.raises(InputError, match=words):
            detectors.score([own], CASES[:1], **more)
    with pytest.raises(InputError, match="at least one case"):
        detectors.score([Says(0)], [])


def test_a_run_gets_the_verdicts_of_a_detector_under_its_name(tmp_path: Path) -> None:
    run = tmp_path / "run"
    flown = [PROGRAM, "fly", "hover", "--link", "in-process", "--set", "duration_s=12", "--out", str(run)]
    subprocess.run(flown, check=True, capture_output=True, timeout=120)
    flight = detectors.of_run(run)
    assert flight.rotor_count == 6 and flight.window_count == 192
    assert not any(name.startswith(("true_", "fault")) for name in flight.columns)

    summary = detectors.judge(run, [Says(0), Counts()])
    # Every run has the second look.
    second, says, counts = summary["own_detectors"]
    assert second["name"] == "Second look"
    assert (says["name"], says["column"]) == ("says", "verdict_own_says")
    assert says["scores"][0]["share_right"] == 1.0
    # From the end of window 241 on, which is not reached; the first step said is that of the first window's end.
    assert counts["scores"][0]["healthy"] == 192
    shown = subprocess.run([PROGRAM, "show", str(run)], check=True, capture_output=True, text=True, timeout=60).stdout
    assert "says" in shown and "counts" in shown

    again = detectors.judge(run, [Says(3)])
    assert [one["name"] for one in again["own_detectors"]] == ["Second look", "says", "counts"]
    assert again["own_detectors"][1]["scores"][0]["false_alarm_events"] == 1
    with pytest.raises(InputError, match="says 7"):
        detectors.judge(run, [Says(7)])


def test_regress_detectors_are_told_apart_and_cannot_hurt_one_another() -> None:
    class Named(detectors.Detector):
        def __init__(self, name: str, code: int) -> None:
            self.name, self.code = name, code

        def judge(self, flight: detectors.Flight) -> ArrayLike:
            with pytest.raises(ValueError, match="read-only"):
                flight["duty_1"][:] = 0.0
            return np.full(flight.window_count, self.code)

    cases = detectors.steps([0.1], seeds=[1], rotors=[2], healthy=0, duration_s=12.5, onset_s=12.0)
    for wrong, words in (
        ([Named("x", 0), Named("x", 0)], "'x' 2 times"),
        ([Named("our sequential", 0)], "another name"),
        ([Named("x", 7)], "x says 7"),
        ([Named("x", 203), Named("y", 201)], "y says 201"),
    ):
        with pytest.raises(InputError, match=words):
            detectors.score(wrong, cases)
    octo = {"vehicle": "../vehicles/octo-x.toml"}
    assert {case.rotor for case in detectors.steps([0.1], seeds=[1], healthy=0, set=octo)} == set(range(1, 9))


CAMPAIGN = """
name = "own"
description = "a hover in which a rotor loses thrust"
scenario = "hover.toml"
seed = 5
repeats = 3

[set]
duration_s = 14.0

[[axis]]
name = "rotor"
key = "fault"
values = [[], [{ time_s = 12.0, rotor = 1, thrust_loss_percent = 20.0 }]]
"""


def campaign_in(folder: Path) -> Path:
    subprocess.run([PROGRAM, "new", "scenario", "hover", "--from", "hover"], check=True, cwd=folder, capture_output=True)
    (folder / "campaign.toml").write_text(CAMPAIGN)
    return folder / "campaign.toml"


def test_val_a_campaign_has_a_detector_of_ones_own_beside_ours(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    file, out = campaign_in(tmp_path), tmp_path / "out"
    plain = rotortwin.campaign(file, program=PROGRAM)
    table = rotortwin.campaign(file, program=PROGRAM, out=out, detectors=[Counts(), Says(0)])
    # The flights are those without it.
    assert table["run_hash"].equals(plain["run_hash"]) and table["sequential_right"].equals(plain["sequential_right"])
    for flight in table.to_pylist():
        # 224 windows; the fault, and from the same step on the verdict of `Counts`, at 12 s: step 4800 of 2.5 ms; it says 1 from step 6001.
        faulty = flight["fault_onset_s"] == 12.0
        assert (flight["own_says_windows"], flight["own_says_false_alarm_events"]) == (224, 0)
        assert flight["own_says_right"] == (192 if faulty else 224) and flight["own_says_missed"] == (32 if faulty else 0)
        assert flight["own_counts_right"] == flight["own_says_right"] and np.isnan(flight["own_counts_isolated_after_s"])
    summary = json.loads((out / "summary.json").read_text())
    assert summary["detectors"]["own_says"]["windows"] == 6 * 224 and summary["detectors"]["own_says"]["missed"] == 3 * 32
    shown = subprocess.run([PROGRAM, "campaign", str(file), "--out", str(out)], check=True, capture_output=True, text=True).stdout
    assert "says, %" in shown and "\n  counts " in shown, shown
    again = detectors.judge_campaign(file, [Says(1)], out)
    assert again["detectors"]["own_says"]["false_alarm_events"] > 0, "judging again replaces"
    assert "own_counts" in again["detectors"], "the other one stays"


def test_scenario_a_campaign_refuses_detectors_before_it_flies(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    file = campaign_in(tmp_path)
    with pytest.raises(InputError, match="a name of its own"):
        rotortwin.campaign(file, program=PROGRAM, out=tmp_path / "out", detectors=[Says(0), Says(1)])
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="expected a folder that 'rotortwin campaign' has written"):
        detectors.judge_campaign(file, [Says(0)], tmp_path / "out")
    with pytest.raises(InputError, match="expected at least one detector"):
        detectors.judge_campaign(file, [], tmp_path / "out")
