"""Other people's methods: each against numbers by hand, or on flights whose answer is known."""

from math import exp
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rotortwin import InputError, detectors, reference_detectors
from rotortwin.reference_detectors import AXES

STEPS_PER_S = 400
#: Directions in which the loss of each of four rotors moves the residual.
WAYS = np.array([[-1.0, 1.0, 1.0, 0.5], [-1.0, -1.0, 1.0, -0.5], [-1.0, -1.0, -1.0, 0.5], [-1.0, 1.0, -1.0, -0.5]])


def flight(seed: int, rotor: int | None = None, size: float = 0.0, until_s: float = 20.0, onset_s: float = 12.0) -> detectors.LabelledFlight:
    """Residuals as our observer answers (5 /s) a sudden `size` along the way of a rotor, in white noise."""
    random = np.random.default_rng(seed)
    time_s = np.arange(round(until_s * STEPS_PER_S)) / STEPS_PER_S
    residual = 0.1 * random.normal(size=(len(time_s), 4))
    if rotor is not None:
        residual += size * np.clip(1.0 - np.exp(-5.0 * (time_s - onset_s)), 0.0, None)[:, None] * WAYS[rotor - 1]
    columns: dict[str, NDArray[Any]] = {"time_s": time_s, **{axis: residual[:, place].astype(np.float32) for place, axis in enumerate(AXES)}}
    seen = detectors.Flight(columns, rotor_count=4)
    truth = np.where(seen.window_end_s > onset_s + 1e-9, rotor or 0, 0)
    return detectors.LabelledFlight(seen, detectors.Case("synthetic", "none", seed, rotor, onset_s if rotor else float("nan")), truth)


LESSONS = [flight(10 * rotor + number, rotor, 0.1) for rotor in range(1, 5) for number in range(2)] + [flight(100 + number) for number in range(4)]
FAULTY = [flight(1000 + rotor, rotor, 0.1) for rotor in range(1, 5)]
HEALTHY = [flight(2000 + number) for number in range(4)]
NAMES = ["CUSUM", "GLR", "IMM", "sliding mode", "boosted trees", "1-D CNN", "LSTM"]


@pytest.fixture(scope="module")
def taught() -> dict[str, detectors.Detector]:
    made = {detector.name: detector for detector in reference_detectors.everything()}
    for detector in made.values():
        detector.learn(LESSONS)
    return made


@pytest.mark.parametrize("name", NAMES)
def test_val_each_names_the_rotor_and_is_quiet_before(taught: dict[str, detectors.Detector], name: str) -> None:
    if name not in taught:
        pytest.skip(f"{name}: needs {', '.join(reference_detectors.missing())}")
    for each in FAULTY:
        said = np.asarray(taught[name].judge(each.flight))
        end_s = each.flight.window_end_s
        assert (said[end_s <= detectors.CALIBRATED_S] == detectors.NOT_READY).all()
        settled = said[end_s > 14.0]
        assert (settled == each.case.rotor).mean() > 0.9, (name, each.case.rotor, settled)
    wrong = sum(int((np.asarray(taught[name].judge(each.flight))[160:] != 0).sum()) for each in HEALTHY)
    # Of 4 × 160 windows.
    assert wrong < 20, (name, wrong)


def test_val_the_ratio_of_a_step_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    # A = 0, Σ = 1: half of the energy of the signature, once the step is older than the horizon is long.
    glr = reference_detectors.Glr(horizon=3, observer_gain=5.0)
    glr.learn(LESSONS)
    glr._a, glr._precision = np.zeros(4), np.eye(4)
    glr._directions = np.eye(4)
    each = flight(1)
    z = np.zeros((each.flight.window_count, 4))
    answer = 1.0 - np.array([exp(-5.0 * 0.0625 * (age + 0.5)) for age in range(3)])
    z[200:203, 2] = 4.0 * answer
    monkeypatch.setattr(glr, "_innovation", lambda _: z.copy())
    evidence = glr.evidence(each.flight)
    assert evidence[202, 2] == pytest.approx(0.5 * 16.0 * float((answer**2).sum()))
    assert evidence[202, 0] == 0.0 and evidence[199].max() == 0.0


def test_val_the_injection_is_what_the_observer_did_not_know() -> None:
    # ṙ = δ − h r settles at r = δ/h: the injection must be h r, in standard deviations of r.
    sliding = reference_detectors.SlidingMode()
    seen = flight(3, 1, 0.3)
    injected = sliding._injection(seen.flight)
    before, after = injected[170:190].mean(axis=0), injected[-32:].mean(axis=0)
    moved = (after - before) / np.linalg.norm(after - before)
    way = WAYS[0] / np.linalg.norm(WAYS[0])
    assert float(moved @ way) > 0.98


def test_scenario_a_curve_goes_from_alarms_to_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    flown = {each.case.seed: detectors._Flown(each, dict.fromkeys(detectors._OURS, np.full(each.flight.window_count, -2))) for each in FAULTY + HEALTHY + LESSONS}
    monkeypatch.setattr(detectors, "_fly_all", lambda cases: [flown[case.seed] for case in cases])
    cases = [each.case for each in FAULTY + HEALTHY]
    found = detectors.curve([reference_detectors.Cusum(largest=1e6), reference_detectors.Glr()], cases, learn_from=[each.case for each in LESSONS])
    for one in found:
        alarms = [point.row.false_alarms for point in one.points]
        assert alarms[-1] <= alarms[0] and alarms[-1] == 0
        best = one.at(0.0)
        assert best is not None and best.row.found == len(FAULTY) and best.row.faults == len(FAULTY)
        assert len(one.frame()) == len(one.points) and "threshold" in str(one)
    table = detectors.compare([reference_detectors.Cusum()], {"calm": detectors.World(cases, [each.case for each in LESSONS])})
    assert [world for world, _ in table.rows] == ["calm"] and table.rows[0][1].cost_us > 0.0
    with pytest.raises(InputError, match="healthy flights"):
        detectors.curve([reference_detectors.Glr()], cases[: len(FAULTY)], learn_from=[each.case for each in LESSONS])


def test_scenario_what_has_not_learnt_says_so() -> None:
    for detector in reference_detectors.everything():
        with pytest.raises(InputError, match="expected flights to learn from"):
            detector.judge(HEALTHY[0].flight)
