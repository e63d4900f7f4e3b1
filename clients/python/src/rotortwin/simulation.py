"""Flights in this process, without a server: one step at a time, or many in parallel.

    import rotortwin

    flight = rotortwin.Simulation("hover", seed=1, set={
        "duration_s": 20.0, "fault": [{"time_s": 12.0, "rotor": 2, "thrust_loss_percent": 10.0}]})
    flight.run()
    print(flight.verdict)                                  # rotor 2 lost 9.8 % [9.2, 10.4] of its thrust, probability 1.0000

Plant, controller and detectors are those of the `rotortwin` command, with the same bits: `flight.run_hash` is what `rotortwin fly` prints. Long calls
end with `KeyboardInterrupt` on Ctrl-C; an interrupted flight stays where it was interrupted and can be resumed.
World NED, body FRD, SI units, rotors from 1 in the order of the vehicle file; a step is 2.5 ms.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _picture
from ._here import native

if TYPE_CHECKING:
    import pandas

_native = native()

InputError = _native.InputError
FlightError = _native.FlightError

#: Length of a step, s.
STEP_S = 0.0025

#: Layout of an observation.
OBSERVATION = (
    "position_north_m", "position_east_m", "position_down_m",
    "velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s",
    "roll_rad", "pitch_rad", "yaw_rad",
    "roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s",
    "reference_north_m", "reference_east_m", "reference_down_m",
    "reference_velocity_north_m_s", "reference_velocity_east_m_s", "reference_velocity_down_m_s",
    "reference_yaw_rad", "battery_voltage_v",
)  # fmt: skip

#: Layout of a true motion: the first twelve entries of an observation, without noise.
MOTION = OBSERVATION[:12]

#: Values of a scenario document: numbers, strings, and lists and tables of them.
Settings = Mapping[str, Any]


def _toml(value: object) -> str:
    """A value as written after the `=` in a TOML document."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, Iterable):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    raise InputError(f"expected a number, a word, a list or a table as a setting, got {type(value).__name__}")


def _whole(name: str, value: object, low: int, high: int) -> int:
    """A whole number of a range."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)) or not low <= int(value) <= high:
        raise InputError(f"{name}: expected a whole number from {low} to {high}, got {value!r}")
    return int(value)


def _seed(value: object) -> int:
    return _whole("seed", value, 0, 2**64 - 1)


def _steps(value: object) -> int:
    return _whole("steps", value, 1, 2**40)


def _duties(duty: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Duties of this shape, in the layout that the native module takes."""
    try:
        held = np.ascontiguousarray(duty, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise InputError(f"expected duties of shape {shape}, got {type(duty).__name__} ({error})") from error
    if held.shape != shape:
        raise InputError(f"expected duties of shape {shape}, got {held.shape}")
    return held


class Scenario:
    """What is flown: read and checked once, flown as often as wanted.

    `scenario` is the path of a scenario file or a name that `rotortwin list scenarios` shows; `set` replaces keys of it, the key a dotted
    path (`{"initial.state_of_charge": 0.4}`).
    """

    def __init__(self, scenario: str | PathLike[str] = "reference-flight", *, set: Settings | None = None) -> None:
        if set is not None and not isinstance(set, Mapping):
            raise InputError(f"set: expected a dict of keys and values, got {type(set).__name__}")
        settings = [f"{key}={_toml(value)}" for key, value in (set or {}).items()]
        self._native = _native.Scenario(fspath(scenario), settings)

    @property
    def name(self) -> str:
        return str(self._native.name)

    @property
    def seed(self) -> int:
        """Seed of the document."""
        return int(self._native.seed)

    @property
    def duration_s(self) -> float:
        return float(self._native.steps) * STEP_S

    @property
    def rotor_count(self) -> int:
        return int(self._native.rotor_count)

    @property
    def warnings(self) -> list[str]:
        """Settings that are allowed but probably not intended."""
        return list(self._native.warnings)

    def __repr__(self) -> str:
        return f"<Scenario {self.name}: {self.duration_s:g} s, {self.rotor_count} rotors>"


def _scenario(scenario: Scenario | str | PathLike[str], set: Settings | None) -> Scenario:
    if isinstance(scenario, Scenario):
        if set:
            raise InputError("expected `set` where the scenario is made, not where it is flown")
        return scenario
    return Scenario(scenario, set=set)


@dataclass(frozen=True)
class Verdict:
    """The sequential detector's verdict after a step."""

    #: 0 healthy, i rotor i, 100 i + j the rotors i and j, −1 unknown fault, −2 not ready, −3 ambiguous.
    code: int
    #: Probability of this verdict, 0 to 1.
    probability: float
    #: Lost share of the named rotor's thrust at hover and its 95 % interval, fractions; 0 where none is named.
    loss: float
    loss_low: float
    loss_high: float

    @property
    def rotors(self) -> tuple[int, ...]:
        """The named rotors, from 1."""
        if self.code >= 100:
            return (self.code // 100, self.code % 100)
        return (self.code,) if self.code > 0 else ()

    def __str__(self) -> str:
        words = {0: "healthy", -1: "unknown fault", -2: "not ready", -3: "ambiguous"}.get(self.code)
        if words is not None:
            return f"{words}, probability {self.probability:.4f}"
        if len(self.rotors) == 2:
            return f"rotors {self.rotors[0]} and {self.rotors[1]}, probability {self.probability:.4f}"
        interval = f"[{100 * self.loss_low:.1f}, {100 * self.loss_high:.1f}]"
        lost = f"rotor {self.code} lost {100 * self.loss:.1f} % {interval} of its thrust"
        return f"{lost}, probability {self.probability:.4f}"


def _array(data: bytearray, kind: str) -> NDArray[Any]:
    return np.frombuffer(data, dtype=kind)


def _damaged(time_s: NDArray[Any], label: NDArray[Any] | None) -> list[tuple[float, float]]:
    """Stretches of time with a damaged rotor."""
    if label is None:
        return []
    damaged = np.concatenate([[False], label != 0, [False]])
    begins, ends = (np.flatnonzero(change) for change in (damaged[1:] & ~damaged[:-1], ~damaged[1:] & damaged[:-1]))
    return [(float(time_s[begin]), float(time_s[end - 1])) for begin, end in zip(begins, ends, strict=True)]


class Simulation:
    """One flight with controller and detectors.

    `record` names the columns of the telemetry that are kept (`duty_*` for all that begin so); an empty list keeps none and is faster.

    `copy.deepcopy(flight)` is the same flight at the same step, noise to come included: to try several duties from one state.
    """

    def __init__(
        self,
        scenario: Scenario | str | PathLike[str] = "reference-flight",
        *,
        seed: int | None = None,
        set: Settings | None = None,
        record: Sequence[str] = ("*",),
    ) -> None:
        self._native = _native.Simulation(_scenario(scenario, set)._native, None if seed is None else _seed(seed), list(record))

    def __copy__(self) -> Simulation:
        raise TypeError("a shallow copy would be the same flight, stepped by both; expected copy.deepcopy")

    def reset(self, seed: int | None = None) -> NDArray[np.float32]:
        """Restarts the flight, by default with the previous seed; returns the first observation."""
        self._native.reset(None if seed is None else _seed(seed))
        return self.observation

    def step(self, duty: ArrayLike | None = None, *, steps: int = 1) -> NDArray[np.float32]:
        """Flies one step, or several, with these duties (fraction by rotor) or with our controller; the next observation.

        A controller that is not asked in a step does not see it. Raises InputError for what are no duties, FlightError where the flight
        cannot go on.
        """
        held = None if duty is None else _duties(duty, (self.rotor_count,))
        # NaN compares as false.
        if held is not None and not bool(((held >= 0.0) & (held <= 1.0)).all()):
            raise InputError(f"expected duties from 0 to 1, got {held.tolist()}")
        self._native.step(None if held is None else held.tobytes(), _steps(steps))
        return self.observation

    def run(self, until_s: float | None = None) -> Simulation:
        """Continues with our controller, to the end or to this time, without Python's lock; returns this flight."""
        if until_s is not None and not 0.0 <= until_s < float("inf"):
            raise InputError(f"until_s: expected a time from 0 s on, got {until_s}")
        self._native.run(None if until_s is None else round(until_s / STEP_S))
        return self

    @property
    def scenario(self) -> str:
        return str(self._native.scenario)

    @property
    def seed(self) -> int:
        return int(self._native.seed)

    @property
    def rotor_count(self) -> int:
        return int(self._native.rotor_count)

    @property
    def hover_duty(self) -> float:
        """Duty at which the nominal vehicle hovers at the initial charge."""
        return float(self._native.hover_duty)

    @property
    def time_s(self) -> float:
        return float(self._native.steps) * STEP_S

    @property
    def done(self) -> bool:
        """All steps of the scenario were flown."""
        return bool(self._native.done)

    @property
    def run_hash(self) -> str:
        """Hash over all steps so far, as `rotortwin fly` prints it."""
        return str(self._native.run_hash)

    @property
    def observation(self) -> NDArray[np.float32]:
        """The sensor values, shape (20,), in the order of `OBSERVATION`."""
        return _array(self._native.observation, "f4")

    @property
    def motion(self) -> NDArray[np.float64]:
        """The true motion, shape (12,), in the order of `MOTION`."""
        return _array(self._native.motion, "f8")

    @property
    def truth(self) -> dict[str, Any]:
        """Data known only to the simulator: true motion, thrust by rotor, battery, wind, faults."""
        return dict(self._native.truth)

    @property
    def controller_duty(self) -> NDArray[np.float32]:
        """Our controller's output now: to add to, or to learn from."""
        return _array(self._native.controller_duty(), "f4")

    @property
    def verdict(self) -> Verdict:
        """The sequential detector's verdict after the last step."""
        report = self._native.report
        return Verdict(int(report["sequential"]), float(report["probability"]), *map(float, report["loss"]))

    @property
    def report(self) -> dict[str, Any]:
        """Outputs of all detectors after the last step: verdict codes, residuals."""
        return dict(self._native.report)

    def telemetry(self) -> dict[str, NDArray[Any]]:
        """All steps so far by column, names and precision as in `telemetry.parquet`."""
        return {name: _array(data, kind) for name, (kind, data) in self._native.telemetry().items()}

    def frame(self) -> pandas.DataFrame:
        """`telemetry()` as a data frame; needs pandas."""
        import pandas

        return pandas.DataFrame(self.telemetry())

    def plot(self) -> Any:
        """Height, duties and the detector's loss over time, as a figure of matplotlib."""
        import matplotlib.pyplot as plt

        kept = self.telemetry()
        missing = [name for name in ("time_s", "position_down_m", "duty_1", "thrust_loss_n", "fault_label") if name not in kept]
        if missing:
            raise InputError(f"expected {', '.join(missing)} among the recorded columns")
        time_s = kept["time_s"]
        figure, (height, duties, loss) = plt.subplots(3, 1, sharex=True, figsize=(8, 6), layout="constrained")
        height.plot(time_s, -kept["position_down_m"])
        height.set_ylabel("height, m")
        for rotor in range(1, self.rotor_count + 1):
            duties.plot(time_s, kept[f"duty_{rotor}"], label=f"{rotor}", linewidth=0.8)
        duties.set_ylabel("duty")
        duties.legend(title="rotor", ncols=self.rotor_count, fontsize="small")
        loss.plot(time_s, kept["thrust_loss_n"])
        loss.set_ylabel("estimated loss, N")
        loss.set_xlabel("time, s")
        for axes in (height, duties, loss):
            axes.fill_between(time_s, 0, 1, where=kept["fault_label"] != 0, transform=axes.get_xaxis_transform(), alpha=0.1, color="red")
        figure.suptitle(f"{self.scenario}, seed {self.seed}: {self.verdict}")
        return figure

    def __repr__(self) -> str:
        return f"<Simulation {self.scenario}, seed {self.seed}, {self.time_s:g} s: {self.verdict}>"

    def _repr_html_(self) -> str:
        """Height, duties and the detector's loss over time, as far as their columns are recorded; damage is shaded."""
        from html import escape

        said = f"<p>{escape(f'{self.scenario}, seed {self.seed}, {self.time_s:g} s: {self.verdict}')}</p>"
        kept = self.telemetry()
        time_s = kept.get("time_s")
        if time_s is None or len(time_s) < 2:
            return said
        panels = []
        if "position_down_m" in kept:
            panels.append(_picture.Lines("height, m", [("", -kept["position_down_m"])]))
        duties = [(str(rotor), kept[f"duty_{rotor}"]) for rotor in range(1, self.rotor_count + 1) if f"duty_{rotor}" in kept]
        if duties:
            panels.append(_picture.Lines("duty of rotor", duties))
        if "thrust_loss_n" in kept:
            panels.append(_picture.Lines("estimated loss, N", [("", kept["thrust_loss_n"])]))
        if not panels:
            return said
        return said + _picture.lines(f"{self.scenario}, over time", time_s, panels, _damaged(time_s, kept.get("fault_label")))


class SimulationBatch:
    """Flights of vehicles with the same number of rotors, stepped together on all cores without Python's lock.

    `copy.deepcopy(batch)` holds the same flights at the same steps.
    """

    def __init__(self, scenarios: Scenario | str | PathLike[str] | Sequence[Scenario], seeds: Sequence[int]) -> None:
        if isinstance(scenarios, (Scenario, str, PathLike)):
            flown = [_scenario(scenarios, None)] * len(seeds)
        else:
            flown = list(scenarios)
        self._native = _native.SimulationBatch([scenario._native for scenario in flown], list(map(_seed, seeds)))

    def __copy__(self) -> SimulationBatch:
        raise TypeError("a shallow copy would be the same flights, stepped by both; expected copy.deepcopy")

    def __len__(self) -> int:
        return len(self._native)

    @property
    def rotor_count(self) -> int:
        return int(self._native.rotor_count)

    @property
    def hover_duty(self) -> NDArray[np.float32]:
        """Shape (flights,)."""
        return np.asarray(self._native.hover_duty, dtype=np.float32)

    def reset(self, places: Sequence[int], seeds: Sequence[int], scenarios: Sequence[Scenario] | None = None) -> None:
        """Restarts the flights at these indices."""
        other = None if scenarios is None else [scenario._native for scenario in scenarios]
        self._native.reset(list(map(int, places)), list(map(_seed, seeds)), other)

    def step(self, duty: ArrayLike | None = None, *, steps: int = 1) -> NDArray[np.float32]:
        """Holds duties of shape (flights, rotors) over `steps` steps, or lets our controllers fly; the observations.

        A flight that is over, or cannot go on (`failures`), stays where it is; the others go on.
        """
        held = None if duty is None else _duties(duty, (len(self), self.rotor_count)).tobytes()
        self._native.step(held, _steps(steps))
        return self.observation

    @property
    def observation(self) -> NDArray[np.float32]:
        """Shape (flights, 20), in the order of `OBSERVATION`."""
        return _array(self._native.observation, "f4").reshape(len(self), -1)

    @property
    def motion(self) -> NDArray[np.float64]:
        """Shape (flights, 12), in the order of `MOTION`."""
        return _array(self._native.motion, "f8").reshape(len(self), -1)

    @property
    def done(self) -> NDArray[np.bool_]:
        return np.asarray(self._native.done, dtype=np.bool_)

    @property
    def failures(self) -> list[str | None]:
        """One sentence for each flight that cannot continue."""
        return list(self._native.failures)

    @property
    def run_hashes(self) -> list[str]:
        return list(self._native.run_hashes)


@dataclass(frozen=True)
class Flights:
    """The result of `fly`."""

    seeds: tuple[int, ...]
    #: Times of the rows, s.
    time_s: NDArray[np.float64]
    #: Arrays of shape (flights, rows) by column; NaN where a flight ended early.
    columns: dict[str, NDArray[np.float64]]
    run_hashes: tuple[str, ...]
    #: One sentence for each flight that ended early.
    failures: tuple[str | None, ...]

    def __getitem__(self, column: str) -> NDArray[np.float64]:
        return self.columns[column]

    def __len__(self) -> int:
        return len(self.seeds)


def fly(
    scenario: Scenario | str | PathLike[str],
    seeds: Iterable[int],
    *,
    columns: Sequence[str] = ("fault_label", "verdict_sequential"),
    every: int = 40,
    set: Settings | None = None,
) -> Flights:
    """Flies a scenario with each seed from start to end with our controller, side by side in vector registers and on all cores.

    Keeps these columns of the telemetry (`rotortwin.Simulation(…).telemetry()` has all names) of every `every`-th step.
    """
    made = _scenario(scenario, set)
    flown = tuple(map(_seed, seeds))
    if not flown:
        raise InputError("expected at least one seed, got none")
    every = _whole("every", every, 1, 2**31)
    kept, hashes, failures = _native.fly(made._native, list(flown), list(columns), every)
    arrays = {name: _array(data, "f8").reshape(len(flown), -1) for name, data in kept.items()}
    rows = next((values.shape[1] for values in arrays.values()), 0)
    return Flights(flown, np.arange(rows, dtype=np.float64) * (every * STEP_S), arrays, tuple(hashes), tuple(failures))
