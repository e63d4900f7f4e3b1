"""Flights in this process."""

import copy
import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import rotortwin
from rotortwin.simulation import MOTION, OBSERVATION, STEP_S

PROGRAM = os.environ.get("ROTORTWIN_PROGRAM", "rotortwin")


def test_regress_a_flight_has_the_hash_of_the_command(tmp_path: Path) -> None:
    flown = subprocess.run(
        [PROGRAM, "fly", "short-hover", "--seed", "11", "--set", "duration_s=4", "--out", str(tmp_path / "run")],
        check=True,
        capture_output=True,
        text=True,
    )
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    flight = rotortwin.Simulation("short-hover", seed=11, set={"duration_s": 4.0}).run()
    assert flight.done and flight.time_s == 4.0
    assert flight.run_hash in flown.stdout and flight.run_hash in json.dumps(summary)


def test_val_a_lost_share_of_thrust_is_named_with_an_interval_that_holds_it() -> None:
    fault = {"time_s": 12.0, "rotor": 2, "thrust_loss_percent": 10.0}
    flight = rotortwin.Simulation("hover", seed=5, set={"duration_s": 20.0, "fault": [fault]}).run()
    verdict = flight.verdict
    assert verdict.rotors == (2,) == tuple(flight.truth["faulty_rotors"])
    assert verdict.loss_low <= 0.1 <= verdict.loss_high and "rotor 2 lost" in str(verdict)


def test_val_steps_by_hand_fly_what_they_are_given() -> None:
    flight = rotortwin.Simulation("short-hover", seed=1)
    sensed = flight.observation
    assert sensed.shape == (len(OBSERVATION),) and sensed.dtype == np.float32
    assert flight.motion.shape == (len(MOTION),)
    full = np.ones(flight.rotor_count)
    for _ in range(100):
        flight.step(full)
    kept = flight.telemetry()
    assert (kept["duty_1"] == 1.0).all() and kept["time_s"][-1] == pytest.approx(99 * STEP_S)
    assert flight.motion[5] < -0.5, "it climbs"
    again = rotortwin.Simulation("short-hover", seed=1)
    again.step(full, steps=100)
    assert again.run_hash == flight.run_hash
    assert flight.reset().tolist() == sensed.tolist()


def test_val_our_controllers_duty_given_back_is_our_controllers_flight() -> None:
    own = rotortwin.Simulation("short-hover", seed=2, set={"duration_s": 1.0}).run()
    by_hand = rotortwin.Simulation("short-hover", seed=2, set={"duration_s": 1.0})
    while not by_hand.done:
        by_hand.step(by_hand.controller_duty)
    assert np.array_equal(by_hand.telemetry()["true_position_down_m"], own.telemetry()["true_position_down_m"])


def test_regress_flights_side_by_side_are_those_one_by_one() -> None:
    scenario = rotortwin.Scenario("short-hover", set={"duration_s": 2.0})
    flown = rotortwin.fly(scenario, range(5), columns=["roll_rad"], every=100)
    assert flown["roll_rad"].shape == (5, 8) and flown.failures == (None,) * 5
    batch = rotortwin.SimulationBatch(scenario, range(5))
    while not batch.done.all():
        batch.step(steps=50)
    alone = [rotortwin.Simulation(scenario, seed=seed).run() for seed in range(5)]
    hashes = [flight.run_hash for flight in alone]
    assert list(flown.run_hashes) == hashes == batch.run_hashes
    assert np.array_equal(flown["roll_rad"][3], alone[3].telemetry()["roll_rad"][::100].astype(float))


def test_scenario_a_flight_that_breaks_off_leaves_the_others() -> None:
    batch = rotortwin.SimulationBatch(rotortwin.Scenario("short-hover"), [1, 2])
    duty = np.full((2, batch.rotor_count), 0.4)
    duty[0] = np.nan
    batch.step(duty)
    assert batch.failures[0] is not None and "duty" in batch.failures[0] and batch.failures[1] is None
    batch.reset([0], [3])
    assert batch.failures == [None, None]


def test_regress_bad_input_is_one_sentence() -> None:
    cases: list[tuple[Callable[[], object], str]] = [
        (lambda: rotortwin.Simulation("hovr"), "did you mean 'hover'"),
        (lambda: rotortwin.Simulation("hover", set={"duraton_s": 1.0}), "duraton_s"),
        (lambda: rotortwin.Simulation("hover", set={"duration_s": object()}), "expected a number"),
        (lambda: rotortwin.Simulation("hover", record=["rol_rad"]), "roll_rad"),
        (lambda: rotortwin.fly("hover", [1], every=0), "every: expected a whole number from 1 to"),
        (lambda: rotortwin.fly("hover", []), "at least one seed"),
        (lambda: rotortwin.fly("hover", [1.7]), "seed: expected a whole number"),  # type: ignore[list-item]
        (lambda: rotortwin.Simulation("hover", seed=-1), "seed: expected a whole number from 0"),
        (lambda: rotortwin.Simulation("hover", set=["duration_s=1"]), "expected a dict"),  # type: ignore[arg-type]
        (lambda: rotortwin.SimulationBatch(rotortwin.Scenario("hover"), []), "at least one"),
    ]
    for make, words in cases:
        with pytest.raises(ValueError, match=words):
            make()
    flight = rotortwin.Simulation("short-hover", set={"duration_s": 0.1})
    refused: list[tuple[Callable[[], object], str]] = [
        (lambda: flight.step([0.5]), r"shape \(6,\), got \(1,\)"),
        (lambda: flight.step(np.full((1, 6), 0.5)), r"shape \(6,\), got \(1, 6\)"),
        (lambda: flight.step([0.5] * 5 + [float("nan")]), "from 0 to 1, got .*nan"),
        (lambda: flight.step([0.5] * 5 + [1.1]), "from 0 to 1, got .*1.1"),
        (lambda: flight.step(steps=0), "steps: expected a whole number from 1"),
        (lambda: flight.run(-1.0), "until_s"),
    ]
    for call, words in refused:
        with pytest.raises(rotortwin.InputError, match=words):
            call()
    batch = rotortwin.SimulationBatch("short-hover", [1, 2, 3])
    for shape in ((6, 3), (18,)):
        with pytest.raises(rotortwin.InputError, match=r"shape \(3, 6\)"):
            batch.step(np.full(shape, 0.4))
    flight.run()
    with pytest.raises(rotortwin.FlightError, match="over"):
        flight.step()


def test_scenario_a_flight_is_a_frame_and_a_plot() -> None:
    pytest.importorskip("matplotlib").use("Agg")
    flight = rotortwin.Simulation("short-hover", set={"duration_s": 1.0}).run()
    assert len(flight.frame()) == 400
    assert len(flight.plot().axes) == 3


def test_scenario_a_flight_is_a_picture_in_a_notebook() -> None:
    svg = "{http://www.w3.org/2000/svg}"
    fault = {"time_s": 12.0, "rotor": 2, "thrust_loss_percent": 10.0}
    flight = rotortwin.Simulation("hover", seed=5, set={"duration_s": 20.0, "fault": [fault]})
    assert "<svg" not in flight._repr_html_(), "nothing is flown yet"
    words, picture = flight.run()._repr_html_().split("</p>", 1)
    assert "rotor 2 lost" in words
    drawing = ElementTree.fromstring(picture)
    # Height, a line for each rotor, loss; the damage is shaded in each of the three, from 12 of 20 s on.
    assert len(drawing.findall(f"{svg}path")) == 2 + flight.rotor_count
    shaded = drawing.findall(f"{svg}rect")
    across = drawing.findall(f"{svg}line")[1]
    begin, end = float(across.attrib["x1"]), float(across.attrib["x2"])
    assert len(shaded) == 3
    for each in shaded:
        assert float(each.attrib["x"]) == pytest.approx(begin + 0.6 * (end - begin), abs=1.0)
    assert len(picture) < 100_000, "whatever the number of steps"
    # What is not recorded is not drawn.
    few = rotortwin.Simulation("short-hover", record=["time_s", "position_down_m"]).run()
    drawing = ElementTree.fromstring(few._repr_html_().split("</p>", 1)[1])
    assert len(drawing.findall(f"{svg}path")) == 1
    assert "<svg" not in rotortwin.Simulation("short-hover", record=[]).run()._repr_html_()


def test_prop_a_deep_copy_goes_on_as_the_flight_would_have() -> None:
    fault = {"time_s": 1.0, "rotor": 2, "thrust_loss_percent": 10.0}
    flight = rotortwin.Simulation("hover", seed=3, set={"duration_s": 4.0, "fault": [fault]})
    flight.step(steps=300)
    apart = copy.deepcopy(flight)
    apart.step(np.full(flight.rotor_count, 0.2), steps=40)
    again = copy.deepcopy(flight)
    assert flight.time_s == again.time_s != apart.time_s
    assert flight.run().run_hash == again.run().run_hash == rotortwin.Simulation("hover", seed=3, set={"duration_s": 4.0, "fault": [fault]}).run().run_hash
    assert apart.run().run_hash != flight.run_hash
    # A sensor that the vehicle lacks reads NaN.
    for name, kept in flight.telemetry().items():
        np.testing.assert_array_equal(kept, again.telemetry()[name], err_msg=name)


def test_prop_a_deep_copy_of_a_batch_goes_on_as_the_flights_would_have() -> None:
    batch = rotortwin.SimulationBatch("short-hover", [1, 2])
    batch.step(steps=100)
    apart = copy.deepcopy(batch)
    batch.step(steps=50)
    assert apart.run_hashes != batch.run_hashes
    apart.step(steps=50)
    assert apart.run_hashes == batch.run_hashes


@pytest.mark.parametrize("make", [lambda: rotortwin.Simulation("short-hover"), lambda: rotortwin.SimulationBatch("short-hover", [1])])
def test_scenario_a_shallow_copy_and_a_pickle_are_refused_with_what_to_do_instead(make: Callable[[], object]) -> None:
    with pytest.raises(TypeError, match="expected copy.deepcopy"):
        copy.copy(make())
    with pytest.raises(TypeError, match="cannot be pickled; expected .* seed"):
        pickle.dumps(make())


def test_scenario_a_scenario_is_shared_by_copies_and_names_what_to_send_instead_of_a_pickle() -> None:
    scenario = rotortwin.Scenario("short-hover", set={"duration_s": 1.0})
    assert copy.deepcopy(scenario).duration_s == copy.copy(scenario).duration_s == 1.0
    with pytest.raises(TypeError, match="cannot be pickled; expected its name or file"):
        pickle.dumps(scenario)


#: Calls of minutes, in seconds of flight; each must end soon after Ctrl-C.
LONG = {
    "run": "rotortwin.Simulation('hover', set={'duration_s': 86_400.0}, record=[]).run()",
    "step": "rotortwin.Simulation('hover', set={'duration_s': 86_400.0}, record=[]).step(steps=34_560_000)",
    "batch": "rotortwin.SimulationBatch(rotortwin.Scenario('hover', set={'duration_s': 36_000.0}), range(8)).step(steps=14_400_000)",
    "fly": "rotortwin.fly('hover', range(2000), set={'duration_s': 600.0})",
}


@pytest.mark.parametrize("call", LONG.values(), ids=LONG)
def test_scenario_ctrl_c_ends_a_long_call(call: str) -> None:
    program = f"""
import rotortwin, signal, sys
# A shell's background job, as tests may be, ignores Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
print("begun", flush=True)
try:
    {call}
except KeyboardInterrupt:
    sys.exit(7)
"""
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "begun\n"
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        try:
            # The calls would take minutes.
            assert process.wait(timeout=20.0) == 7
        finally:
            process.kill()


def test_scenario_an_interrupted_flight_goes_on_where_it_was_interrupted() -> None:
    flight = rotortwin.Simulation("hover", seed=4, set={"duration_s": 36_000.0}, record=[])
    # A shell's background job, as this may be, ignores Ctrl-C. This thread is the main one, which handles signals.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):
            flight.run()
    finally:
        signal.signal(signal.SIGINT, before)
    assert 0.0 < flight.time_s < 36_000.0
    by_hand = rotortwin.Simulation("hover", seed=4, set={"duration_s": 36_000.0}, record=[])
    assert by_hand.run(until_s=flight.time_s).run_hash == flight.run_hash
