"""Custom detectors compared with ours: the same flights, the same score.

    import numpy as np
    from rotortwin import detectors

    class Yawing(detectors.Detector):
        name = "yaw rate"

        def judge(self, flight):
            mean = flight.windows("yaw_rate_rad_s").mean(axis=1)
            return np.where(abs(mean) > 0.1, detectors.UNKNOWN, detectors.HEALTHY)

    print(detectors.score([Yawing()], detectors.steps(losses=[0.05, 0.1], seeds=range(5))))

A detector gets what was measured and commanded, never the truth, and gives a verdict for each window of 25 steps (62.5 ms). Windows that
end before `CALIBRATED_S` are not scored: until then a vehicle counts as healthy and a detector may calibrate itself.
"""

from __future__ import annotations

import json
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from math import ceil, exp, isnan, lgamma, log, nan, sqrt
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._here import native
from .simulation import STEP_S, InputError, Scenario, Settings, Simulation

if TYPE_CHECKING:
    import pandas

_native = native()

#: Verdict codes other than rotors, which count from 1: as in `telemetry.parquet`.
HEALTHY, UNKNOWN, NOT_READY, AMBIGUOUS = 0, -1, -2, -3

#: Steps per window.
WINDOW = 25
#: Length of a window, s.
WINDOW_S = WINDOW * STEP_S
#: The flight up to this time is for calibration, s.
CALIBRATED_S = 10.0

#: A detector's inputs, by prefix of the column's name; the residuals are those of our observers (Eq. 32 of the paper).
MEASURED = (
    "time_s", "position_", "velocity_", "roll_rad", "pitch_rad", "yaw_rad", "roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s",
    "duty_", "battery_voltage_v", "residual_", "wrench_residual_",
)  # fmt: skip
_OURS = {"our T-test": "verdict_t_test", "our network": "verdict_network", "our sequential": "verdict_sequential"}


@dataclass(frozen=True)
class Case:
    """A flight of a protocol. Without a rotor it is healthy."""

    #: Rows of the score are grouped by label.
    label: str
    scenario: str | PathLike[str]
    seed: int
    rotor: int | None = None
    #: Onset of the fault, s.
    onset_s: float = nan
    set: Settings = field(default_factory=dict)


@dataclass(frozen=True)
class Flight:
    """A detector's view of a flight."""

    columns: dict[str, NDArray[Any]]
    #: Number of rotors of the vehicle.
    rotor_count: int

    def __getitem__(self, column: str) -> NDArray[Any]:
        """Shape (steps,)."""
        return self.columns[column]

    @property
    def window_count(self) -> int:
        return len(self.columns["time_s"]) // WINDOW

    def windows(self, column: str) -> NDArray[Any]:
        """A column by window, shape (windows, 25)."""
        return self.columns[column][: self.window_count * WINDOW].reshape(-1, WINDOW)

    @property
    def window_end_s(self) -> NDArray[np.float64]:
        """Shape (windows,)."""
        return np.asarray((np.arange(self.window_count) + 1) * WINDOW_S, dtype=np.float64)


@dataclass(frozen=True)
class LabelledFlight:
    """A training flight."""

    flight: Flight
    case: Case
    #: The right verdict in each window: 0, or the damaged rotor.
    truth: NDArray[np.int64]


class Detector(ABC):
    """Judges flights. For one that works step by step use `StepDetector`."""

    #: Name in tables.
    name = "own"

    def learn(self, flights: Sequence[LabelledFlight]) -> None:  # noqa: B027 - not everybody learns
        """Called once before the score if there are training flights, none of which are scored."""

    @abstractmethod
    def judge(self, flight: Flight) -> ArrayLike:
        """A verdict for each window, shape (windows,): 0 healthy, i rotor i, `UNKNOWN`, `NOT_READY`, `AMBIGUOUS`."""


class StepDetector(Detector):
    """Sees one step after the other, as on board."""

    @abstractmethod
    def begin(self, rotor_count: int) -> None:
        """A new flight."""

    @abstractmethod
    def step(self, sample: dict[str, float]) -> int:
        """The verdict after this step; `sample` holds the columns of `MEASURED`."""

    def judge(self, flight: Flight) -> ArrayLike:
        self.begin(flight.rotor_count)
        names = list(flight.columns)
        rows = np.column_stack([flight.columns[name] for name in names]).tolist()
        said = [self.step(dict(zip(names, row, strict=True))) for row in rows]
        return np.asarray(said[WINDOW - 1 :: WINDOW])


class EvidenceDetector(Detector):
    """Says how much speaks for each rotor, and names one beyond a threshold. `curve` sweeps that."""

    #: Evidence above which a rotor is named.
    threshold: float
    #: The verdict is `AMBIGUOUS` while the second has more than this share of the first's evidence; None: never.
    rivalry: float | None = None

    @abstractmethod
    def evidence(self, flight: Flight) -> NDArray[np.float64]:
        """What speaks for a fault of each rotor in each window, shape (windows, rotors); of any scale."""

    def judge(self, flight: Flight) -> NDArray[np.int64]:
        return self.named(flight, self.evidence(flight), self.threshold)

    def named(self, flight: Flight, evidence: NDArray[np.float64], threshold: float) -> NDArray[np.int64]:
        """The verdicts at this threshold."""
        order = np.sort(evidence, axis=1)
        best = order[:, -1]
        said = np.where(best >= threshold, evidence.argmax(axis=1) + 1, HEALTHY)
        if self.rivalry is not None:
            said[(best >= threshold) & (order[:, -2] > self.rivalry * best)] = AMBIGUOUS
        said[flight.window_end_s <= CALIBRATED_S] = NOT_READY
        return said.astype(np.int64)


def steps(
    losses: Iterable[float] = (0.05, 0.1, 0.2),
    *,
    seeds: Iterable[int] = range(2),
    rotors: Iterable[int] | None = None,
    healthy: int = 3,
    scenario: str | PathLike[str] = "hover",
    duration_s: float = 20.0,
    onset_s: float = 12.0,
    set: Settings | None = None,
) -> list[Case]:
    """For each of `seeds`: flights with a sudden loss of thrust (fractions) of each rotor, and `healthy` ones of the same scenario.

    `rotors`: by default all of the scenario's vehicle.

    Each flight has a seed of its own, made of these: no two share their noise, and other `seeds` are other flights. `set` replaces further keys of the
    scenario: wind, battery, mismatch of the model.
    """
    rest = {**(set or {}), "duration_s": float(duration_s)}
    wanted, losses = list(seeds), list(losses)
    if rotors is None:
        rotors = range(1, Scenario(scenario, set={**rest, "fault": []}).rotor_count + 1)
    rotors = list(rotors)
    if len(losses) > 90 or healthy > 1000 or any(rotor > 99 for rotor in rotors):
        raise InputError("expected at most 90 losses, 1000 healthy flights and rotors up to 99: seeds beyond would be shared")
    first = {seed: 1_000_000 + 10_000 * seed for seed in wanted}
    calm = [first[seed] + 9_000 + number for seed in wanted for number in range(healthy)]
    cases = [Case("healthy", scenario, seed, set={**rest, "fault": []}) for seed in calm]
    for seed in wanted:
        for rotor in rotors:
            for place, loss in enumerate(losses):
                fault = {"time_s": onset_s, "rotor": rotor, "thrust_loss_percent": 100.0 * loss}
                own = first[seed] + 100 * place + rotor
                cases.append(Case(f"−{100 * loss:g} %", scenario, own, rotor, onset_s, {**rest, "fault": [fault]}))
    return cases


def fly(cases: Sequence[Case]) -> list[LabelledFlight]:
    """The flights of a protocol with what is right, to learn from or to look at."""
    return [flown.labelled for flown in _fly_all(cases)]


def of_run(run: str | PathLike[str]) -> Flight:
    """The flight in a run folder, as a detector sees it."""
    rotor_count, columns = _native.recorded(os.fspath(run), list(MEASURED))
    return Flight({name: np.frombuffer(values, dtype=np.float64) for name, values in columns.items()}, rotor_count)


def judge(run: str | PathLike[str], detectors: Sequence[Detector]) -> dict[str, Any]:
    """Detectors judge the run in a folder. Returns its new `summary.json`.

    Each then has its row in `rotortwin show` and in `report.html`, its lane under the true faults, its column in `telemetry.parquet` and its topic in
    `run.mcap`, under its name. A detector that judges a run again replaces what it said before.
    """
    if not detectors:
        raise InputError("expected at least one detector, got none")
    told_apart(detectors)
    flight = of_run(run)
    summary = ""
    for detector in detectors:
        summary = _native.judge(os.fspath(run), detector.name, _held(detector, flight).tolist())
    found: dict[str, Any] = json.loads(summary)
    return found


def judge_campaign(
    campaign: str | PathLike[str],
    detectors: Sequence[Detector],
    folder: str | PathLike[str],
    *,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Detectors judge the flights of a campaign (a file or a name) that are in its folder. Returns its new `summary.json`.

    Each flight is flown again in this process, bit by bit as it was, and judged; windows, false alarms and delays are counted as for ours. Each detector
    then has its rows and columns in the tables of `rotortwin campaign` and in `report.html`, its columns `own_NAME_…` in `campaign.parquet`, and its scores
    in `summary.json`. A detector that judges a campaign again replaces what it said before. Nothing is kept unless all flights were judged.

    progress: called with flights that were judged or left out and flights of all.
    """
    if not detectors:
        raise InputError("expected at least one detector, got none")
    told_apart(detectors)
    flights = _native.CampaignFlights(os.fspath(campaign), os.fspath(folder), [detector.name for detector in detectors])
    columns = _columns(())
    parts = flights.parts
    for place, (shard, first) in enumerate(parts):
        for number, rotor_count, recorded in flights.fly(shard, first, columns):
            flight = Flight(_fixed({name: np.frombuffer(values, dtype=np.float64) for name, values in recorded.items()}), rotor_count)
            for index, detector in enumerate(detectors):
                flights.judge(number, index, _held(detector, flight).astype(np.int32).tobytes())
        if progress is not None:
            progress(place + 1, len(parts))
    found: dict[str, Any] = json.loads(flights.keep())
    return found


def _held(detector: Detector, flight: Flight) -> NDArray[np.int64]:
    """The verdict in each step: it holds from the last step of its window until the next one ends."""
    said = np.append(_checked(detector, flight), NOT_READY)
    return np.asarray(said[(np.arange(len(flight["time_s"])) + 1) // WINDOW - 1], dtype=np.int64)


def _columns(others: Iterable[str]) -> list[str]:
    """The columns of `MEASURED` and some others, as `Simulation` records them."""
    return [*(name if name.endswith(("_s", "_rad", "_v")) else f"{name}*" for name in MEASURED), *others]


def _fixed(columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """One detector must not change what the next one sees."""
    for values in columns.values():
        values.flags.writeable = False
    return columns


@dataclass(frozen=True)
class _Flown:
    labelled: LabelledFlight
    ours: dict[str, NDArray[Any]]


def _fly(case: Case) -> _Flown:
    flown = Simulation(case.scenario, seed=case.seed, set=case.set, record=_columns(_OURS.values())).run()
    kept = flown.telemetry()
    flight = Flight(_fixed({name: values for name, values in kept.items() if name.startswith(MEASURED)}), flown.rotor_count)
    truth = np.zeros(flight.window_count, dtype=np.int64)
    if case.rotor is not None:
        truth[flight.window_end_s > case.onset_s + 1e-9] = case.rotor
    # A verdict holds from the last step of its window until the next one ends.
    ours = {name: kept[column][WINDOW - 1 :: WINDOW] for name, column in _OURS.items()}
    return _Flown(LabelledFlight(flight, case, truth), ours)


def _fly_all(cases: Sequence[Case]) -> list[_Flown]:
    if not cases:
        raise InputError("expected at least one case, got none")
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(_fly, cases))


@dataclass(frozen=True)
class Row:
    """What a detector did with the flights of one label."""

    detector: str
    label: str
    flights: int
    #: Share of the scored windows with the right verdict; windows without a verdict are wrong.
    right: float
    #: Flights with a fault that was named right at least once, and of those the ones that ended so; None where there is no fault.
    found: int | None
    settled: int | None
    #: Median time from the fault to the end of the first correct window, and to the one after which no window was wrong, s.
    first_s: float
    settled_s: float
    #: Flights in which a healthy rotor was named.
    wrong_rotor: int
    #: Alarms raised while everything was healthy, and the healthy time that was scored, h.
    false_alarms: int
    healthy_h: float
    #: Computing time per step, µs; 0 for ours, which run during the flight.
    cost_us: float
    #: Flights with a fault; in `found` of them it was named right.
    faults: int

    @property
    def found_interval(self) -> tuple[float, float]:
        """95 % interval (Wilson) of the share of faults that are named."""
        return wilson(self.found or 0, self.faults)

    @property
    def false_alarms_per_hour(self) -> tuple[float, float, float]:
        """Rate, and its exact 95 % interval for a Poisson count."""
        low, high = poisson(self.false_alarms)
        return (self.false_alarms / self.healthy_h, low / self.healthy_h, high / self.healthy_h) if self.healthy_h else (nan, nan, nan)


@dataclass(frozen=True)
class Scores:
    """Detectors side by side. Prints as a table of 80 columns."""

    rows: tuple[Row, ...]

    def frame(self) -> pandas.DataFrame:
        """All figures as a data frame; needs pandas."""
        import pandas

        def values(row: Row) -> dict[str, Any]:
            low, high = row.found_interval if row.found is not None else (nan, nan)
            rate = row.false_alarms_per_hour
            return {
                **vars(row), "found_low": low, "found_high": high,
                "false_alarms_per_h": rate[0], "false_alarms_per_h_low": rate[1], "false_alarms_per_h_high": rate[2],
            }  # fmt: skip

        return pandas.DataFrame([values(row) for row in self.rows])

    def __str__(self) -> str:
        head = ("detector", "case", "n", "right", "found [95 %]", "first", "settled", "wrong", "false/h [95 %]")
        lines = _aligned([head] + [_cells(row) for row in self.rows])
        lines.append("right: of windows; first, settled: median s after the fault; wrong: flights in")
        lines.append("which a healthy rotor was named; false/h: alarms per healthy hour")
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        from html import escape

        return f"<pre>{escape(str(self))}</pre>"


def _aligned(table: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(len(line[column]) for line in table) for column in range(len(table[0]))]
    return [
        " ".join(cell.ljust(width) if at < 2 else cell.rjust(width) for at, (cell, width) in enumerate(zip(line, widths, strict=True))).rstrip() for line in table
    ]


def _cells(row: Row) -> tuple[str, ...]:
    low, high = row.found_interval
    rate, rate_low, rate_high = row.false_alarms_per_hour
    return (
        row.detector,
        row.label,
        str(row.flights),
        f"{100 * row.right:.1f}%",
        "" if row.found is None else f"{row.found} [{ceil(100 * low - 0.5)},{ceil(100 * high - 0.5)}]",
        "" if isnan(row.first_s) else f"{row.first_s:.2f}",
        "" if isnan(row.settled_s) else f"{row.settled_s:.2f}",
        str(row.wrong_rotor),
        "" if isnan(rate) else f"{_short(rate)} [{_short(rate_low)},{_short(rate_high)}]",
    )


def _short(value: float) -> str:
    """Two digits that count, without an exponent."""
    return f"{float(f'{value:.2g}'):.10g}"


def score(detectors: Sequence[Detector], cases: Sequence[Case], *, learn_from: Sequence[Case] = ()) -> Scores:
    """Flies the cases and scores these detectors and ours on them.

    `learn_from`: flights that detectors which learn may see, with the truth. None of them may be among `cases`.
    """
    # Before the flights: a refusal must not cost them.
    told_apart(detectors)
    flown = _fly_all(cases)
    _teach(detectors, cases, learn_from)
    rows: list[Row] = []
    for label in dict.fromkeys(case.label for case in cases):
        some = [each for each in flown if each.labelled.case.label == label]
        faults = sum(each.labelled.case.rotor is not None for each in some)
        rows += _rows(detectors, label, some, faults)
    return Scores(tuple(rows))


def _rows(detectors: Sequence[Detector], label: str, flown: Sequence[_Flown], faults: int) -> list[Row]:
    rows = []
    for detector in detectors:
        begun = time.perf_counter()
        said = [_checked(detector, each.labelled.flight) for each in flown]
        spent = time.perf_counter() - begun
        steps_flown = sum(len(each.labelled.flight["time_s"]) for each in flown)
        rows.append(_row(detector.name, label, flown, said, 1e6 * spent / steps_flown, faults))
    for name in _OURS:
        if any((each.ours[name] != NOT_READY).any() for each in flown):
            rows.append(_row(name, label, flown, [each.ours[name] for each in flown], 0.0, faults))
    return rows


def _teach(detectors: Sequence[Detector], cases: Sequence[Case], learn_from: Sequence[Case]) -> None:
    seen = {(str(case.scenario), case.seed) for case in learn_from}
    twice = next((case for case in cases if (str(case.scenario), case.seed) in seen), None)
    if twice is not None:
        raise InputError(f"{twice.scenario}, seed {twice.seed}: expected other flights to learn from than to be scored on")
    if learn_from:
        lessons = fly(learn_from)
        for detector in detectors:
            detector.learn(lessons)


@dataclass(frozen=True)
class World:
    """A row of `compare`: flights to score, and others to learn from."""

    cases: Sequence[Case]
    learn_from: Sequence[Case] = ()


@dataclass(frozen=True)
class Comparison:
    """Methods by worlds. Prints as a table."""

    #: World, and the score of all its flights together.
    rows: tuple[tuple[str, Row], ...]

    def frame(self) -> pandas.DataFrame:
        """All figures as a data frame; needs pandas."""
        frame = Scores(tuple(row for _, row in self.rows)).frame()
        frame.insert(0, "world", [world for world, _ in self.rows])
        return frame.drop(columns="label")

    def __str__(self) -> str:
        table: list[tuple[str, ...]] = [("world", "method", "right", "found [95 %]", "first", "settled", "wrong", "false/h [95 %]", "µs/step")]
        for world, row in self.rows:
            cells = _cells(row)
            table.append((world, row.detector, *cells[3:], f"{row.cost_us:.1f}" if row.cost_us else "in flight"))
        return "\n".join([
            *_aligned(table),
            "right: of windows; first, settled: median s after the fault; wrong: flights in",
            "which a healthy rotor was named; false/h: alarms per healthy hour; µs/step: Python",
        ])  # fmt: skip

    __repr__ = __str__


def compare(detectors: Sequence[Detector], worlds: Mapping[str, World]) -> Comparison:
    """Scores these detectors and ours in each world, all its flights together: accuracy, delays, false alarms, cost."""
    rows = []
    for name, world in worlds.items():
        flown = _fly_all(world.cases)
        _teach(detectors, world.cases, world.learn_from)
        faults = sum(each.labelled.case.rotor is not None for each in flown)
        for row in _rows(detectors, name, flown, faults):
            rows.append((name, row))
    return Comparison(tuple(rows))


@dataclass(frozen=True)
class Point:
    """A detector at one threshold."""

    threshold: float
    row: Row


@dataclass(frozen=True)
class Curve:
    """The operating curve of a detector: what it finds, over its false alarms. Prints as a table."""

    points: tuple[Point, ...]

    def frame(self) -> pandas.DataFrame:
        """All figures as a data frame; needs pandas."""
        frame = Scores(tuple(point.row for point in self.points)).frame()
        frame.insert(1, "threshold", [point.threshold for point in self.points])
        return frame.drop(columns="label")

    def at(self, false_alarms_per_h: float) -> Point | None:
        """The point with the most correct windows of those with at most so many false alarms an hour; None if there is none."""
        quiet = [point for point in self.points if point.row.false_alarms_per_hour[0] <= false_alarms_per_h]
        return max(quiet, key=lambda point: point.row.right, default=None)

    def __str__(self) -> str:
        table: list[tuple[str, ...]] = [("detector", "threshold", "right", "found [95 %]", "first", "settled", "wrong", "false/h [95 %]")]
        table += [(point.row.detector, _short(point.threshold), *_cells(point.row)[3:]) for point in self.points]
        return "\n".join(_aligned(table))

    __repr__ = __str__


def curve(
    detectors: Sequence[EvidenceDetector], cases: Sequence[Case], *, learn_from: Sequence[Case] = (), thresholds: Sequence[float] | None = None, points: int = 12
) -> list[Curve]:
    """Sweeps the threshold of each detector over the same flights.

    Without `thresholds`, `points` of them: quantiles of the largest evidence of all flights, healthy ones and others, so that the curve goes from alarms
    everywhere to silence.
    """
    flown = _fly_all(cases)
    _teach(detectors, cases, learn_from)
    if not any(each.labelled.case.rotor is None for each in flown):
        raise InputError("expected healthy flights among the cases: there are no false alarms without them")
    faults = sum(each.labelled.case.rotor is not None for each in flown)
    curves = []
    for detector in detectors:
        found = [detector.evidence(each.labelled.flight) for each in flown]
        swept: Sequence[float] = thresholds if thresholds is not None else _spread(flown, found, points)
        rows = []
        for threshold in swept:
            said = [detector.named(each.labelled.flight, evidence, threshold) for each, evidence in zip(flown, found, strict=True)]
            rows.append(Point(float(threshold), _row(detector.name, "all", flown, said, 0.0, faults)))
        curves.append(Curve(tuple(rows)))
    return curves


def _spread(flown: Sequence[_Flown], found: Sequence[NDArray[np.float64]], points: int) -> list[float]:
    largest = [evidence[each.labelled.flight.window_end_s > CALIBRATED_S].max(axis=1) for each, evidence in zip(flown, found, strict=True)]
    peaks = np.array([each.max() for each in largest])
    windows = np.concatenate(largest)
    # Half of them at quantiles of windows, half at quantiles of whole flights.
    half = max(points // 2, 1)
    low = np.quantile(windows, np.linspace(0.5, 1.0, half, endpoint=False))
    high = np.quantile(peaks, np.linspace(0.0, 1.0, points - half))
    return sorted({float(value) for value in np.concatenate([low, high])})


def _checked(detector: Detector, flight: Flight) -> NDArray[np.int64]:
    said = np.asarray(detector.judge(flight))
    if said.shape != (flight.window_count,):
        raise InputError(f"{detector.name}: expected {flight.window_count} verdicts, one a window, got an array of shape {said.shape}")
    if said.dtype.kind not in "iu" and not np.array_equal(said, np.round(said)):
        raise InputError(f"{detector.name}: expected verdict codes, whole numbers, got {said.dtype}")
    codes = said.astype(np.int64)
    impossible = codes[~np.isin(codes, _possible(flight.rotor_count))]
    if len(impossible):
        raise InputError(
            f"{detector.name} says {impossible[0]}; expected 0, a rotor from 1 to {flight.rotor_count}, 100 i + j for two of them, or −1 to −3"
        )
    return codes


def _possible(rotor_count: int) -> list[int]:
    """All verdict codes for a vehicle."""
    rotors = range(1, rotor_count + 1)
    return [HEALTHY, UNKNOWN, NOT_READY, AMBIGUOUS, *rotors, *(100 * i + j for i in rotors for j in rotors if i < j)]


def told_apart(detectors: Sequence[Detector]) -> None:
    """Refuses names that stand twice in a table, or are ours."""
    names = [detector.name for detector in detectors]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"expected a name of its own for each detector, got '{name}' {names.count(name)} times")
        if name in _OURS:
            raise InputError(f"'{name}' is a detector of this program; expected another name")


def _row(name: str, label: str, flown: Sequence[_Flown], verdicts: Sequence[NDArray[Any]], cost_us: float, faults: int) -> Row:
    right, scored, alarms, healthy_windows, wrong = 0, 0, 0, 0, 0
    first: list[float] = []
    settled: list[float] = []
    for each, said in zip(flown, verdicts, strict=True):
        case, truth = each.labelled.case, each.labelled.truth
        said = said[: len(truth)]
        end_s = each.labelled.flight.window_end_s
        used = end_s > CALIBRATED_S + 1e-9
        right += int((said == truth)[used].sum())
        scored += int(used.sum())
        alarm = (said != HEALTHY) & (said != NOT_READY)
        calm = used & (truth == 0)
        healthy_windows += int(calm.sum())
        begins = alarm & ~np.concatenate(([False], alarm[:-1])) & calm
        alarms += int(begins.sum())
        wrong += int(((said > 0) & (said != truth) & used).any())
        if case.rotor is not None:
            after = truth != 0
            good = (said == truth) & after
            if good.any():
                first.append(float(end_s[good.argmax()] - case.onset_s))
            bad = np.flatnonzero(after & ~good)
            begin = int(bad[-1]) + 1 if len(bad) else int(after.argmax())
            if after.any() and begin < len(truth):
                settled.append(float(end_s[begin] - case.onset_s))
    return Row(
        detector=name,
        label=label,
        flights=len(flown),
        right=right / max(scored, 1),
        found=len(first) if faults else None,
        settled=len(settled) if faults else None,
        first_s=float(np.median(first)) if first else nan,
        settled_s=float(np.median(settled)) if settled else nan,
        wrong_rotor=wrong,
        false_alarms=alarms,
        healthy_h=healthy_windows * WINDOW_S / 3600.0,
        cost_us=cost_us,
        faults=faults,
    )


def wilson(hits: int, of: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    if of == 0:
        return (0.0, 1.0)
    z = 1.959964
    centre, spread = (hits + z * z / 2) / (of + z * z), z * sqrt(hits * (of - hits) / of + z * z / 4) / (of + z * z)
    return (max(0.0, centre - spread), min(1.0, centre + spread))


def poisson(count: int) -> tuple[float, float]:
    """Exact 95 % interval of the mean of a Poisson count (Garwood 1936)."""

    def below(most: int, mean: float) -> float:
        return sum(exp(-mean + k * log(mean) - lgamma(k + 1)) for k in range(most + 1))

    def solve(most: int, probability: float) -> float:
        low, high = 1e-9, 10.0 * (most + 5)
        for _ in range(100):
            middle = (low + high) / 2
            low, high = (middle, high) if below(most, middle) > probability else (low, middle)
        return low

    return (0.0 if count == 0 else solve(count - 1, 0.975), solve(count, 0.025))
