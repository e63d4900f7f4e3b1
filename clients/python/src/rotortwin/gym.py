"""Environments for Gymnasium: a multirotor with a real battery and blades that break. `import rotortwin.gym` registers them.

    import gymnasium
    import rotortwin.gym

    env = gymnasium.make("rotortwin/DamagedBlade-v0")
    many = gymnasium.make_vec("rotortwin/Hover-v0", num_envs=64)

| Id | Task |
|---|---|
| `rotortwin/Hover-v0` | hold a point |
| `rotortwin/Trajectory-v0` | follow a helix |
| `rotortwin/DamagedBlade-v0` | hold a point while one rotor, drawn anew in each episode, loses 5 to 40 % of its thrust at 1 to 5 s |
| `rotortwin/LowBattery-v0` | hold a point on a battery between 12 and 35 % of its charge: the same duty gives less and less thrust |

An action is a number in [−1, 1] for each rotor: the duty is that of hover plus 0.4 times the action, limited to [0, 1], held over four steps of
2.5 ms. An observation is what the vehicle's own sensors say, with their noise: position and velocity against the reference (m, m/s, NED), roll, pitch, yaw
against the reference (rad), body rates (rad/s), voltage against that at the start, then the last action. Reward of a step: 1 − min(e, 2 m)/2 −
0.02 |ω| − 0.05 mean(action²), e the true distance to the reference, ω the true body rates. An episode ends (terminated) 5 m off, tilted beyond 70°, or where the flight
breaks off, and is cut (truncated) at the end of the scenario. `info` of a single environment holds
what no learner may see: the true faulty rotors, and the verdict of our detector, which calibrates itself in the first 10 s of a flight and takes what is damaged by
then for healthy. That of a vector environment is empty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from .simulation import STEP_S, FlightError, Scenario, Simulation, SimulationBatch

#: Steps of 2.5 ms for which an action is held.
STEPS_OF_AN_ACTION = 4
#: Duty above that of hover for an action of 1.
REACH = 0.4
#: Distance at which an episode ends, m.
FAR_M = 5.0
#: Tilt at which an episode ends, rad.
TILTED_RAD = 1.22
#: Length of an observation without the last action.
_SENSED = 13

Settings = dict[str, Any]


def _as_it_is(_: np.random.Generator) -> Settings:
    return {}




def _a_blade_breaks(random: np.random.Generator, rotors: int = 6) -> Settings:
    fault = {
        "time_s": float(random.uniform(1.0, 5.0)),
        "rotor": int(random.integers(1, rotors + 1)),
        "thrust_loss_percent": float(random.uniform(5.0, 40.0)),
    }
    return {"fault": [fault]}


def _little_charge(random: np.random.Generator) -> Settings:
    return {"initial.state_of_charge": float(random.uniform(0.12, 0.35))}


@dataclass(frozen=True)
class Task:
    """The scenario, and what is drawn for each episode."""

    scenario: str
    draw: Callable[[np.random.Generator], Settings] = _as_it_is


#: By name, as the environments take them; a custom task may be given instead.
TASKS = {
    "hover": Task("hover"),
    "trajectory": Task("helix-2"),
    "damaged-blade": Task("hover", _a_blade_breaks),
    "low-battery": Task("hover", _little_charge),
}


def _task(task: str | Task) -> Task:
    if isinstance(task, Task):
        return task
    if task not in TASKS:
        raise ValueError(f"expected one of {', '.join(TASKS)} or a Task, got {task!r}")
    return TASKS[task]


class _Episodes:
    """Common part of single and vector environments."""

    def __init__(self, task: str | Task, duration_s: float, set: Settings | None) -> None:
        self.task = _task(task)
        # Faults of the scenario belong to a flight of the scenario's length.
        self.settings = {"duration_s": duration_s, "fault": [], **(set or {})}
        self.plain = Scenario(self.task.scenario, set=self.settings)
        self._drawn = self.task.draw
        if self._drawn is _a_blade_breaks:
            self._drawn = partial(_a_blade_breaks, rotors=self.plain.rotor_count)

    def draw(self, random: np.random.Generator) -> tuple[Scenario, int]:
        drawn = self._drawn(random)
        scenario = Scenario(self.task.scenario, set={**self.settings, **drawn}) if drawn else self.plain
        return scenario, int(random.integers(0, 2**63))

    def spaces(self, rotors: int) -> tuple[Any, Any]:
        return (
            spaces.Box(-np.inf, np.inf, (_SENSED + rotors,), np.float32),
            spaces.Box(-1.0, 1.0, (rotors,), np.float32),
        )


def _taken(action: NDArray[np.float32], shape: tuple[int, ...] | None) -> NDArray[np.float32]:
    """Actions within [−1, 1]. What is no action is no flight either: it must not look like a crash of the vehicle."""
    given = np.asarray(action, np.float32)
    if given.shape != shape:
        raise ValueError(f"expected an action of shape {shape}, got {given.shape}")
    if not bool(np.isfinite(given).all()):
        raise ValueError(f"expected an action of finite numbers, got {given}")
    return np.clip(given, -1.0, 1.0)


def _observation(sensed: NDArray[np.float32], start_v: NDArray[np.float32], action: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rows of `OBSERVATION` as rows for a learner."""
    yaw = sensed[:, 8] - sensed[:, 18]
    parts = [
        sensed[:, 0:3] - sensed[:, 12:15],
        sensed[:, 3:6] - sensed[:, 15:18],
        sensed[:, 6:8],
        np.arctan2(np.sin(yaw), np.cos(yaw))[:, None],
        sensed[:, 9:12],
        (sensed[:, 19] / start_v)[:, None],
        action,
    ]
    return np.concatenate(parts, axis=1, dtype=np.float32)


def _outcome(
    motion: NDArray[np.float64], sensed: NDArray[np.float32], action: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Reward of a step and whether it ends the episode; see the module."""
    away_m = np.linalg.norm(motion[:, 0:3] - sensed[:, 12:15], axis=1)
    spin = np.linalg.norm(motion[:, 9:12], axis=1)
    tilt = np.arccos(np.clip(np.cos(motion[:, 6]) * np.cos(motion[:, 7]), -1.0, 1.0))
    reward = 1.0 - np.minimum(away_m, 2.0) / 2.0 - 0.02 * spin - 0.05 * np.mean(action.astype(np.float64) ** 2, axis=1)
    return reward, (away_m > FAR_M) | (tilt > TILTED_RAD)


class FlightEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One flight; see the module."""

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": round(1.0 / (STEP_S * STEPS_OF_AN_ACTION))}

    def __init__(self, task: str | Task = "hover", *, duration_s: float = 20.0, set: Settings | None = None) -> None:
        self._episodes = _Episodes(task, duration_s, set)
        self.observation_space, self.action_space = self._episodes.spaces(self._episodes.plain.rotor_count)
        self._flight: Simulation | None = None
        self._start_v = np.ones(1, np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[NDArray[np.float32], dict[str, Any]]:
        super().reset(seed=seed)
        scenario, flight_seed = self._episodes.draw(self.np_random)
        self._flight = Simulation(scenario, seed=flight_seed, record=[])
        sensed = self._flight.observation[None]
        self._start_v = sensed[:, 19].copy()
        return _observation(sensed, self._start_v, np.zeros((1, scenario.rotor_count), np.float32))[0], self._info()

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        if self._flight is None:
            raise gymnasium.error.ResetNeeded("expected reset() before the first step()")
        taken = _taken(action, self.action_space.shape)[None]
        duty = np.clip(self._flight.hover_duty + REACH * taken[0], 0.0, 1.0)
        broken = False
        for _ in range(STEPS_OF_AN_ACTION):
            if self._flight.done:
                break
            try:
                self._flight.step(duty)
            except FlightError:
                broken = True
                break
        sensed = self._flight.observation[None]
        reward, ended = _outcome(self._flight.motion[None], sensed, taken)
        terminated = bool(ended[0]) or broken
        observation = _observation(sensed, self._start_v, taken)[0]
        return observation, float(reward[0]), terminated, self._flight.done and not terminated, self._info()

    def _info(self) -> dict[str, Any]:
        assert self._flight is not None
        verdict = self._flight.verdict
        return {"faulty_rotors": tuple(self._flight.truth["faulty_rotors"]), "verdict": verdict.code, "loss": verdict.loss}


class FlightVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """Many flights on all cores; an episode that has ended restarts with the next step."""

    metadata: dict[str, Any] = {**FlightEnv.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self, num_envs: int = 1, task: str | Task = "hover", *, duration_s: float = 20.0, set: Settings | None = None
    ) -> None:
        self.num_envs = num_envs
        self._episodes = _Episodes(task, duration_s, set)
        self.single_observation_space, self.single_action_space = self._episodes.spaces(self._episodes.plain.rotor_count)
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)
        self._batch: SimulationBatch | None = None
        self._last = np.zeros((num_envs, self._episodes.plain.rotor_count), np.float32)
        self._start_v = np.ones(num_envs, np.float32)
        self._ended = np.zeros(num_envs, np.bool_)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        if isinstance(seed, list):
            raise ValueError("expected one seed for all flights: each draws its own from it")
        super().reset(seed=seed)
        drawn = [self._episodes.draw(self.np_random) for _ in range(self.num_envs)]
        self._batch = SimulationBatch([scenario for scenario, _ in drawn], [number for _, number in drawn])
        self._ended[:] = False
        self._last[:] = 0.0
        sensed = self._batch.observation
        self._start_v = sensed[:, 19].copy()
        return _observation(sensed, self._start_v, self._last), {}

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        if self._batch is None:
            raise gymnasium.error.ResetNeeded("expected reset() before the first step()")
        taken = _taken(actions, self.action_space.shape)
        begun = np.flatnonzero(self._ended)
        duty = np.clip(self._batch.hover_duty[:, None] + REACH * taken, 0.0, 1.0)
        sensed = self._batch.step(duty, steps=STEPS_OF_AN_ACTION)
        reward, terminated = _outcome(self._batch.motion, sensed, taken)
        terminated |= np.asarray([failure is not None for failure in self._batch.failures])
        truncated = self._batch.done & ~terminated
        if len(begun):
            # The step after the end of an episode is its reset: the action is not flown.
            drawn = [self._episodes.draw(self.np_random) for _ in begun]
            self._batch.reset([int(place) for place in begun], [number for _, number in drawn], [scenario for scenario, _ in drawn])
            sensed = self._batch.observation
            self._start_v[begun] = sensed[begun, 19]
            taken[begun] = 0.0
            reward[begun] = 0.0
            terminated[begun] = truncated[begun] = False
        self._ended = terminated | truncated
        self._last = taken
        return _observation(sensed, self._start_v, taken), reward, terminated, truncated, {}


for _name, _word in (
    ("Hover", "hover"),
    ("Trajectory", "trajectory"),
    ("DamagedBlade", "damaged-blade"),
    ("LowBattery", "low-battery"),
):
    gymnasium.register(
        id=f"rotortwin/{_name}-v0",
        entry_point="rotortwin.gym:FlightEnv",
        vector_entry_point="rotortwin.gym:FlightVectorEnv",
        kwargs={"task": _word},
    )
