"""The twin and the detectors in this process, without a server: logs from files or data frames against models.

    import pandas
    import rotortwin

    log = pandas.read_csv("flight.csv")                     # canonical columns: docs/logs.md
    found = rotortwin.diagnose(log, "f550")
    print(found.sentence)
    print(rotortwin.fdi_log(log, "f550").sentence)          # has a rotor lost thrust?

A log is the path of a file of any format that `rotortwin compare` reads (`"flight.ulg"`, `"flight.bin@35:65"`), a run folder, or a table:
a data frame of pandas, polars or arrow, or a dict of arrays. A model is a vehicle's name or file, or `MODEL@v2` of a folder of models.
Results hold what the commands of the same name print with `--json`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from . import _picture
from ._here import native

_native = native()

#: A path, a table, or a table with the name used for it in answers.
Log = Any


class Result(dict[str, Any]):
    """The answer as the command gives it with `--json`."""

    @property
    def sentence(self) -> str:
        """The answer in one sentence; empty for a comparison, which has a row for each channel."""
        return str(self.get("sentence") or self.get("reason") or "")

    def __repr__(self) -> str:
        return self.sentence or super().__repr__()

    def _picture(self) -> str:
        """The result as SVG; empty where it has nothing to draw."""
        if "ranking" in self:
            return _of_a_diagnosis(self)
        if "logs" in self and "models" in self:
            return _of_a_comparison(self)
        return _of_an_improvement(self) if "rows" in self else ""

    def _repr_html_(self) -> str:
        from html import escape

        said = self.sentence or str(self.get("verdict") or "")
        if "±" in said:
            said += " (± is half of a 95 % interval)"
        picture = self._picture()
        if said or picture:
            return f"<p>{escape(said)}</p>{picture}"
        return f"<pre>{escape(json.dumps(self, indent=1)[:4000])}</pre>"


def _of_a_diagnosis(found: Mapping[str, Any]) -> str:
    """The parameters of what was found, each with its interval; how well the model fits where nothing was."""
    rows = [
        (f"{effect['label']}, {each['symbol']}", each["value"], each["interval_95"], f"{each['value']:.4g} ± {each['interval_95']:.2g} {each['unit']}")
        for effect in [*found["effects"], *found["sensor_or_timing"]]
        for each in effect["parameters"]
    ]
    if rows:
        return _picture.intervals("What was found, with its 95 % intervals", rows)
    fit = [(each["channel"], float(each["chi2_after"])) for each in found["goodness"]["channels"] if each["chi2_after"] is not None]
    return _picture.bars("Error of each channel, squared, over that of its noise", fit, 1.0, "") if fit else ""


def _of_a_comparison(compared: Mapping[str, Any]) -> str:
    """The error of each channel over its noise, both smoothed as where channels fail, for each model on the first log."""
    rows = [
        (f"{each['model']}, {channel['channel']}" if len(compared["models"]) > 1 else channel["channel"], channel["smoothed_rms"] / channel["smoothed_noise"])
        for each in compared["logs"][0]["models"]
        for channel in each["channels"]
        if channel["smoothed_rms"] is not None and channel["smoothed_noise"]
    ]
    return _picture.bars("Error of each channel over its noise", rows, 1.0, "× noise") if rows else ""


def _of_an_improvement(improved: Mapping[str, Any]) -> str:
    """The error of each version on the first log, in the quantity that was furthest above its noise."""
    of_version = [(row["version"], {each["quantity"]: each for each in row["logs"][0]["errors"]}) for row in improved["rows"] if row["logs"]]
    if not of_version or not of_version[0][1]:
        return ""
    first = max(of_version[0][1].values(), key=lambda each: float(each["error"]) / (float(each["noise"]) or 1e-300))
    rows = [(version, errors[first["quantity"]]["error"]) for version, errors in of_version if first["quantity"] in errors]
    return _picture.bars(f"Error of {first['quantity']} by version; the line is the noise", rows, first["noise"], first["unit"])


def _log(log: Log, number: int) -> Any:
    if isinstance(log, (str, PathLike)):
        return fspath(log)
    name = f"table {number}"
    if isinstance(log, tuple):
        if len(log) != 2 or not isinstance(log[0], str):
            raise _native.InputError("expected a list for several logs; a tuple is (name, table)")
        name, log = log
    if isinstance(log, Mapping):
        columns = log
    else:
        names = [str(key) for key in _names(log)]
        twice = next((key for key in names if names.count(key) > 1), None)
        if twice is not None:
            raise _native.InputError(f"{name}: expected each column once, got '{twice}' {names.count(twice)} times")
        columns = {str(key): log[key] for key in _names(log)}
    return str(name), {str(key): _doubles(name, key, values) for key, values in columns.items()}


def _names(table: Any) -> Sequence[str]:
    # Arrow's `columns` holds the columns, not their names.
    names = getattr(table, "column_names", None)
    names = getattr(table, "columns", None) if names is None else names
    if names is None:
        raise _native.InputError(f"expected a path, a data frame or a dict of arrays as a log, got {type(table).__name__}")
    return list(names)


def _doubles(name: str, key: object, values: Any) -> bytes:
    kind = str(getattr(values, "dtype", ""))
    if kind.startswith(("datetime", "timedelta", "<M8", "<m8", "Datetime", "Duration")):
        raise _native.InputError(f"{name}, column '{key}': expected numbers in SI units (seconds for a time), got {kind}")
    try:
        return np.ascontiguousarray(values, dtype=np.float64).tobytes()
    except (TypeError, ValueError) as error:
        raise _native.InputError(f"{name}, column '{key}': expected numbers ({error})") from error


def _logs(logs: Log | Sequence[Log]) -> list[Any]:
    # Two paths are two logs; a name and a table are one.
    paths = isinstance(logs, tuple) and all(isinstance(log, (str, PathLike)) for log in logs)
    several = list(logs) if isinstance(logs, list) or paths else [logs]
    return [_log(log, number) for number, log in enumerate(several, start=1)]


def compare(
    logs: Log | list[Log], models: str | PathLike[str] | Sequence[str | PathLike[str]], *, store: str | PathLike[str] = "models"
) -> Result:
    """Compares models with logs: the error of each channel over its noise, by flight condition, with the worst moments."""
    names = [models] if isinstance(models, (str, PathLike)) else models
    return Result(json.loads(_native.compare(_logs(logs), [fspath(name) for name in names], fspath(store))))


def diagnose(
    logs: Log | list[Log],
    model: str | PathLike[str],
    *,
    effects: Sequence[str | PathLike[str]] = (),
    baseline: list[Log] | None = None,
    store: str | PathLike[str] = "models",
) -> Result:
    """Which physical effect the model lacks, with its parameters and their intervals; or that none does, or that the logs cannot show it.

    `effects`: documents of effects of one's own; `baseline`: three healthy flights of the same vehicle at least.
    """
    found = _native.diagnose(_logs(logs), fspath(model), fspath(store), [fspath(path) for path in effects], _logs(baseline or []))
    return Result(json.loads(found))


@dataclass(frozen=True)
class Improved:
    """What `improve` gives."""

    result: Result
    #: The last version as a file for `--model`.
    model_toml: str

    @property
    def sentence(self) -> str:
        return self.result.sentence

    def write(self, path: str | PathLike[str]) -> None:
        """Writes the last version."""
        Path(path).write_text(self.model_toml, encoding="utf-8")

    def _repr_html_(self) -> str:
        return self.result._repr_html_()


def improve(
    logs: Log | list[Log],
    model: str | PathLike[str],
    *,
    held_out: list[Log] | None = None,
    store: str | PathLike[str] = "models",
) -> Improved:
    """Diagnoses and adds what is missing until the model agrees or the reason why it does not is known; `held_out` logs are seen by no fit.

    Nothing is written into the folder of models.
    """
    result, text = _native.improve(_logs(logs), _logs(held_out or []), fspath(model), fspath(store))
    return Improved(Result(json.loads(result)), text)


class JudgedLog(Result):
    """What the detectors say of one log."""

    @property
    def sentence(self) -> str:
        """The last verdict of each stretch that was judged, or why nothing was."""
        stretches = self["stretches"]
        if stretches:
            return "; ".join(f"{each['from_s']:.1f} to {each['to_s']:.1f} s: {_verdict(each['sequential'])}" for each in stretches)
        for lack in self["lacks"]:
            if lack["prevents_verdicts"]:
                return f"cannot judge: the log lacks {', '.join(lack['columns'])}"
        reasons = {each["why"]: None for each in self["not_judged"]}
        return f"cannot judge: {'; '.join(reasons) or 'no step has a value in every channel that the detectors need'}"

    def _picture(self) -> str:
        """Share of the thrust that the named rotor lost, with its interval, over the time that was judged."""
        said = self.get("windows") or self["timeline"]
        # A change holds until the next one, the last one to the end.
        last = self["final_window"]
        said = [*said, last] if last else said
        if not said:
            return ""
        time_s: list[float] = []
        values: dict[str, list[float]] = {"share": [], "share_low": [], "share_high": []}
        for number, each in enumerate(said):
            until = said[number + 1]["time_s"] if number + 1 < len(said) else each["time_s"]
            time_s += [each["time_s"], until]
            lost = next(iter(each["sequential"]["thrust_loss"]), None)
            judged = each["sequential"]["verdict"] in ("healthy", "faulty") or lost is not None
            for key, column in values.items():
                column += [100.0 * lost[key] if lost else 0.0 if judged else np.nan] * 2
        series = [("", values["share"]), ("", values["share_low"]), ("", values["share_high"])]
        return _picture.lines("Lost thrust of the named rotor and its 95 % interval over time", time_s, [_picture.Lines("lost thrust, %", series)])

    def frame(self) -> Any:
        """Verdicts of the sequential detector as a data frame of pandas: each window if `fdi_log` was asked for them, else each change."""
        import pandas

        said = self.get("windows") or self["timeline"]
        rows = [
            {
                "time_s": each["time_s"],
                "verdict": each["sequential"]["verdict"],
                "code": each["sequential"]["code"],
                "probability": each["sequential"]["probability"],
                "loss": next((loss["share"] for loss in each["sequential"]["thrust_loss"]), np.nan),
                "loss_low": next((loss["share_low"] for loss in each["sequential"]["thrust_loss"]), np.nan),
                "loss_high": next((loss["share_high"] for loss in each["sequential"]["thrust_loss"]), np.nan),
            }
            for each in said
        ]
        return pandas.DataFrame(rows)


def _verdict(said: Mapping[str, Any]) -> str:
    return f"{said['sentence']}, probability {said['probability']:.4f}"


def fdi_log(
    log: Log,
    model: str | PathLike[str],
    *,
    classifier: str | PathLike[str] | None = None,
    set: Mapping[str, object] | None = None,
    windows: bool = False,
    store: str | PathLike[str] = "models",
) -> JudgedLog:
    """Has a rotor lost thrust, which, since when, how much; or why the detectors reach no verdict.

    `model` is what they take for healthy. `classifier`: a file, for verdicts of the network. `set`: keys of the `[fdi]` table of scenarios, such
    as `{"calibration_end_s": 5.0}`; what is damaged by the end of the calibration counts as healthy. `windows` keeps every window of 62.5 ms.
    """
    settings = [f"{key}={json.dumps(value)}" for key, value in (set or {}).items()]
    told = _native.fdi_log([_log(log, 1)], fspath(model), fspath(store), fspath(classifier) if classifier else None, settings, windows)
    return JudgedLog(json.loads(told)[0])


@dataclass(frozen=True)
class IdentifiedVehicle:
    """What `vehicle_from_log` gives: every value with its interval and source, and the files of the vehicle."""

    result: Result
    name: str
    #: Contents of NAME.toml, NAME.blades.toml, NAME.intervals.toml.
    files: tuple[str, str, str]

    def write(self, folder: str | PathLike[str] = ".") -> Path:
        """Writes the three files into a folder, which is made if need be; the path of the vehicle's, which `--model` and `diagnose` take."""
        Path(folder).mkdir(parents=True, exist_ok=True)
        paths = [Path(folder) / f"{self.name}{ending}" for ending in (".toml", ".blades.toml", ".intervals.toml")]
        for path, text in zip(paths, self.files, strict=True):
            path.write_text(text, encoding="utf-8")
        return paths[0]


def vehicle_from_log(
    logs: Log | list[Log],
    *,
    mass_kg: float,
    arm_m: float,
    name: str = "my-vehicle",
    frame: str | None = None,
    trust_frame: bool = False,
    capacity_ah: float | None = None,
    cells: int | None = None,
    bench: str | PathLike[str] | Sequence[str | PathLike[str]] = (),
) -> IdentifiedVehicle:
    """A vehicle from a log, a scale (mass with battery) and a ruler (centre to the furthest rotor).

    A `frame` that the motion contradicts is refused, unless you `trust_frame`. `bench`: files of a thrust bench of one rotor, or a datasheet
    table, as `rotortwin vehicle from-log --bench` takes them.
    """
    tables = [fspath(table) for table in ([bench] if isinstance(bench, str | PathLike) else bench)]
    found, files = _native.identify(_logs(logs), mass_kg, arm_m, name, frame, trust_frame, capacity_ah, cells, tables)
    return IdentifiedVehicle(Result(json.loads(found)), name, (files[0], files[1], files[2]))
