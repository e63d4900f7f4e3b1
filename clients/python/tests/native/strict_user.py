"""A program as somebody writes it who checks it with `pyright` in strict mode: no name of the package may have an unknown type.

Only checked, never run: `cargo test --release -p rotortwin-tests --test python_client types`.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import rotortwin
from rotortwin import detectors, gym


def fly() -> NDArray[np.float64]:
    flight = rotortwin.Simulation("hover", seed=7, set={"duration_s": 20.0})
    seen = flight.reset(seed=3)
    seen = flight.step(np.full(6, 0.5), steps=4)
    assert flight.done or len(seen) > 0
    verdict = flight.run().verdict
    print(verdict.rotors, verdict.probability, verdict.loss)
    return np.asarray(flight.telemetry()["time_s"], dtype=np.float64)


def side_by_side() -> list[str | None]:
    batch = rotortwin.SimulationBatch(rotortwin.Scenario("hover"), range(4))
    batch.step(np.full((4, 6), 0.5, dtype=np.float32))
    return list(batch.failures)


def learn() -> float:
    environment = gym.FlightEnv("hover")
    observation, _ = environment.reset(seed=1)
    observation, reward, terminated, truncated, _ = environment.step(np.zeros(6, dtype=np.float32))
    return float(reward) + float(observation.sum()) + terminated + truncated


def look_at(log: Path) -> str:
    compared = rotortwin.compare(log, "f550")
    found = rotortwin.diagnose([log], "f550")
    improved = rotortwin.improve([log], "f550")
    judged = rotortwin.fdi_log(log, "f550")
    return compared.sentence + found.sentence + improved.sentence + judged.sentence


class Never(detectors.StepDetector):
    """A detector of one's own."""

    name = "never"

    def begin(self, rotor_count: int) -> None:
        self.rotors = rotor_count

    def step(self, sample: dict[str, float]) -> int:
        return detectors.HEALTHY if sample["time_s"] > 5.0 else detectors.NOT_READY


def refused(text: str) -> str | None:
    try:
        rotortwin.Scenario(text)
    except rotortwin.InputError as error:
        return str(error)
    return None
