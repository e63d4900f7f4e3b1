"""Logs, comparisons, diagnoses, improvements, classifiers."""

# Made from aio_twin.py by generate_sync.py: change that file.

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ._resource import Resource
from ._operations import as_frame, as_table
from ._transport import Transport
from ._twin import (
    ComparisonOperations,
    IdentificationOperations,
    LogOperations,
    NextFlightOperations,
    bench_table,
    effect_text,
    flights_body,
    job_operations,
    model_body,
    more_model,
    without_none,
)
from .models import (
    Channel,
    ChannelSeries,
    ConditionSeries,
    ExamplePreset,
    HiddenTruth,
    Job,
    Json,
    Method,
    ProposedManoeuvre,
)

if TYPE_CHECKING:
    import pandas
    import pyarrow


#: The canonical log among the files of an import.
_LOG = "log.parquet"


class Logs(Resource[Job]):
    """Flight logs of any source: upload, import, canonical form."""

    _operations: LogOperations

    def __init__(self, transport: Transport) -> None:
        super().__init__(transport, LogOperations(transport.settings))

    def submit(
        self,
        log: str | Path | bytes,
        *,
        name: str | None = None,
        rate_hz: float | None = None,
        align: bool = False,
        damaged: bool = False,
        vehicle: str | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Uploads a log and has it imported; the same file, read in the same way, is one log, however often it is sent.

        log: a file here, or its bytes with a `name` (its ending says what it is: `csv`, `parquet`, PX4 `ulg`, ArduPilot `bin` or `log`).
        rate_hz: bring every column to this rate. align: take estimated delays out. damaged: take what can be read of a file whose
        checksum is wrong. vehicle: one of the server's vehicles, whose rotors the log must have.
        """
        query = without_none(rate_hz=rate_hz, align="true" if align else None, damaged="true" if damaged else None, vehicle=vehicle)
        return self._do(self._operations.upload(log, name, query, idempotency_key))

    def generate(
        self,
        preset: ExamplePreset | None = None,
        *,
        effect: str | None = None,
        seed: int | None = None,
        vehicle: str | None = None,
        duration_s: float | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Has an example log flown by the independent simulator: a log like any other, which does not say what is hidden in it; `truth` does.

        One of: preset, `hidden-effect` (one that the model lacks), `damaged-blade` (a rotor loses thrust in mid-flight), `healthy`; effect,
        an id of the catalogue such as `rotor-drag`, or `ID:PARAMETER=VALUE,…`. seed: of all noise and of what is drawn; another flight each
        time without it. vehicle: one of the library's, `f550` without it. duration_s: 10 to 600 s, 60 s without it.
        """
        body = without_none(preset=preset, effect=effect, seed=seed, vehicle=vehicle, duration_s=duration_s)
        return self._do(self._operations.generate(body, idempotency_key))

    def truth(self, id: str) -> HiddenTruth:
        """What was hidden in a generated log. `Conflict` before it is done, `NotFound` for a log of another origin."""
        return self._do(self._operations.truth(id))

    def draft_mapping(self, id: str) -> Json:
        """A mapping for an uploaded CSV whose columns have names of their own, also where its import failed.

        `mapping` is the text that `submit_again` takes; `columns` and `rows` say what was recognised and why, `questions` what only the
        owner of the log knows.
        """
        return self._do(self._operations.draft(id))

    def submit_again(
        self,
        id: str,
        *,
        mapping: str | Path | None = None,
        rate_hz: float | None = None,
        align: bool = False,
        damaged: bool = False,
        vehicle: str | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Imports an uploaded log again with other settings, as a new log whose parent is the first one.

        mapping: a text or `Path`, as `rotortwin log map` and `draft_mapping` write it. The rest: as for `submit`.
        """
        body: Json = {"align": align, "damaged": damaged} | without_none(rate_hz=rate_hz, vehicle=vehicle)
        return self._do(self._operations.again(id, mapping, body, idempotency_key))

    def table(self, id: str, columns: Sequence[str] | None = None) -> pyarrow.Table:
        """An imported log as an Arrow table."""
        return as_table(self.artifact(id, _LOG), columns)

    def channels(self, id: str) -> Sequence[Channel]:
        """What it holds. `Conflict` before it is imported, as for `samples`."""
        return self._do(self._operations.channels(id))

    def samples(
        self,
        id: str,
        channels: Sequence[str],
        *,
        from_s: float | None = None,
        to_s: float | None = None,
        points: int | None = None,
    ) -> pyarrow.Table:
        """Some channels in an interval, with as many rows as a picture needs: as for runs.

        channels: names; one `*` stands for anything (`duty_*`). points: most rows, 2000 without it.
        """
        query = {"from_s": from_s, "to_s": to_s, "points": points}
        return as_table(self._do(self._operations.samples(id, channels, query)), None)

    def flight(self, id: str) -> Json:
        """The flight as a page draws it: `track`, `height_m`, `parts` and events, `outputs` of the motors, `vibration`."""
        return self._do(self._operations.flight(id))

    def frame(self, id: str, columns: Sequence[str] | None = None) -> pandas.DataFrame:
        """An imported log as a pandas data frame."""
        return as_frame(self.artifact(id, _LOG), columns)


class Twin(Resource[Job]):
    """A model compared with flights."""

    _kind: str

    def __init__(self, transport: Transport) -> None:
        super().__init__(transport, job_operations(transport.settings, self._kind))

    def report(self, id: str) -> str:
        """The report (HTML)."""
        return (self.artifact(id, "report.html")).decode()


class Comparisons(Twin):
    """Where, when and how much a model and flights disagree."""

    _kind = "comparisons"
    _operations: ComparisonOperations

    def __init__(self, transport: Transport) -> None:
        super().__init__(transport)
        self._operations = ComparisonOperations(transport.settings)

    def submit(
        self,
        *,
        vehicle: str | None = None,
        improvement: str | None = None,
        version: str | Path | None = None,
        model: str | None = None,
        label: str | None = None,
        more_models: Sequence[str | Mapping[str, str | Path]] = (),
        logs: Sequence[str] = (),
        runs: Sequence[str] = (),
        priority: int = 0,
        max_wall_s: int | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Compares one model with flights.

        The model is one of: vehicle, a name of the server's library; improvement, an id; version, a text or `Path` as `rotortwin model
        export` writes it; model, a name of `client.models`, also `NAME@v1` or `NAME@BRANCH`. label: what the result calls it. more_models: such
        names, or `{"improvement": ID, "label": …}` and the like, compared with the same flights, after it in the result. The flights are ids
        of imported logs and of runs; `ID@35:65` takes only these seconds.
        """
        which = model_body(vehicle, improvement, version, model) | without_none(label=label)
        body: Json = {"model": which, "flights": flights_body(logs, runs), "priority": priority}
        if more_models:
            body["more_models"] = [more_model(one) for one in more_models]
        return self._do(self._operations.submit(body | without_none(max_wall_s=max_wall_s), idempotency_key))


    def series(
        self,
        id: str,
        channel: str,
        *,
        log: int = 0,
        from_s: float | None = None,
        to_s: float | None = None,
        points: int | None = None,
    ) -> ChannelSeries:
        """One channel, such as `fx`, of a compared log: measured, predicted and residual of each model, in buckets with mean, lowest and highest sample.

        log: its place in the result, from 0. points: most buckets, 900 without it, at most 20,000; with as many as samples each is one.
        A channel that the log lacks raises `Unprocessable`, a comparison that is not done `Conflict`.
        """
        query: Json = {"channel": channel, "log": log, "from_s": from_s, "to_s": to_s, "points": points}
        return self._do(self._operations.series(id, query))

    def conditions(
        self, id: str, *, log: int = 0, from_s: float | None = None, to_s: float | None = None, points: int | None = None
    ) -> ConditionSeries:
        """The flight conditions of a compared log (forward speed, yaw rate, …), in the same buckets as `series`."""
        query: Json = {"log": log, "from_s": from_s, "to_s": to_s, "points": points}
        return self._do(self._operations.conditions(id, query))


class Diagnoses(Twin):
    """The physical effect that a model lacks on flights, with evidence."""

    _kind = "diagnoses"

    def submit(
        self,
        *,
        vehicle: str | None = None,
        improvement: str | None = None,
        version: str | Path | None = None,
        model: str | None = None,
        logs: Sequence[str] = (),
        runs: Sequence[str] = (),
        effects: Sequence[str | Path] = (),
        library_effects: Sequence[str] = (),
        priority: int = 0,
        max_wall_s: int | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Names what a model lacks; model and flights as for a comparison.

        effects: documents of your own that may be named, too. library_effects: names of such documents in `client.effects`.
        """
        body: Json = {"model": model_body(vehicle, improvement, version, model), "flights": flights_body(logs, runs), "priority": priority}
        body |= {"effects": [effect_text(effect) for effect in effects], "library_effects": list(library_effects)}
        return self._do(self._operations.submit(body | without_none(max_wall_s=max_wall_s), idempotency_key))


class Improvements(Twin):
    """Compare, diagnose, add what is missing, compare again, until the model agrees."""

    _kind = "improvements"

    def submit(
        self,
        vehicle: str | None = None,
        *,
        version: str | Path | None = None,
        logs: Sequence[str] = (),
        runs: Sequence[str] = (),
        held_out_logs: Sequence[str] = (),
        held_out_runs: Sequence[str] = (),
        priority: int = 0,
        max_wall_s: int | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Improves the nominal model of a vehicle (a name of the library, or a version without effects) on flights.

        The held-out flights are seen by no fit: they are the proof.
        """
        body: Json = {"model": model_body(vehicle, None, version), "flights": flights_body(logs, runs), "priority": priority}
        if held_out_logs or held_out_runs:
            body["held_out"] = flights_body(held_out_logs, held_out_runs)
        return self._do(self._operations.submit(body | without_none(max_wall_s=max_wall_s), idempotency_key))

    def model(self, id: str) -> str:
        """The version that it ended with (TOML), as `rotortwin model import` and `version=` of a comparison take it."""
        return (self.artifact(id, "model.toml")).decode()


class NextFlights(Resource[Job]):
    """What to fly next: the manoeuvre that distinguishes two effects which a flight could not."""

    _operations: NextFlightOperations

    def __init__(self, transport: Transport) -> None:
        super().__init__(transport, NextFlightOperations(transport.settings))

    def submit(
        self,
        first: str,
        second: str,
        *,
        vehicle: str | None = None,
        improvement: str | None = None,
        version: str | Path | None = None,
        model: str | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Searches for that manoeuvre.

        first, second: two different ids of the catalogue; with the rotor where an effect has one: `rotor-thrust-scale#3`. The model as it
        stands: as for a comparison.
        """
        body: Json = {"model": model_body(vehicle, improvement, version, model), "between": [first, second]}
        return self._do(self._operations.submit(body, idempotency_key))

    def manoeuvres(self, id: str) -> Sequence[ProposedManoeuvre]:
        """What it found, the best manoeuvre first. `JobFailed` where it failed."""
        return self._do(self._operations.manoeuvres(id))

    def scenario(self, id: str) -> str:
        """The best manoeuvre as a scenario (TOML). Of a version of a model, the vehicle is next to it among the files: `download_all`."""
        return (self.artifact(id, "next-flight.toml")).decode()


class Identifications(Resource[Job]):
    """Vehicles from flight logs: what no log holds is mass and arm."""

    _operations: IdentificationOperations

    def __init__(self, transport: Transport) -> None:
        super().__init__(transport, IdentificationOperations(transport.settings))

    def submit(
        self,
        name: str,
        *,
        mass_kg: float,
        arm_m: float,
        logs: Sequence[str] = (),
        runs: Sequence[str] = (),
        frame: str | None = None,
        trust_frame: bool = False,
        capacity_ah: float | None = None,
        cells: int | None = None,
        bench: Sequence[str | Path] = (),
        held_out: bool = False,
        idempotency_key: str | None = None,
    ) -> Job:
        """Identifies a vehicle from ids of imported logs and of runs, all with the same rotors.

        name: what it is called in the library, if it is kept. mass_kg: with battery. arm_m: from its centre to the furthest rotor. frame:
        such as `quad-x`, where no log says it; one that the motion contradicts fails the job, unless you `trust_frame`. capacity_ah, cells:
        of the battery (cells in series). bench: files here of a thrust bench of one rotor, or a datasheet table, 1 MiB together. held_out:
        fit each half of each flight and score it on the other, too.
        """
        body: Json = {"name": name, "flights": flights_body(logs, runs), "mass_kg": mass_kg, "arm_m": arm_m}
        body |= without_none(frame=frame, capacity_ah=capacity_ah, cells=cells)
        body |= {"trust_frame": trust_frame, "held_out": held_out, "bench": [bench_table(table) for table in bench]}
        return self._do(self._operations.submit(body, idempotency_key))

    def vehicle(self, id: str) -> str:
        """The vehicle document (TOML); it names its blades as `NAME.blades.toml`. `JobFailed` where it failed."""
        return self._do(self._operations.document(id, "vehicle"))

    def blades(self, id: str) -> str:
        """The blade document (TOML). `JobFailed` where it failed."""
        return self._do(self._operations.document(id, "blades"))

    def keep(self, id: str) -> str:
        """Leaves vehicle and blades in the library; an earlier one of the same name is replaced. The name, for `client.vehicles`."""
        return self._do(self._operations.keep(id))


class Classifiers(Resource[Job]):
    """Neural networks trained on the server; a run uses one by its id."""

    def __init__(self, transport: Transport) -> None:
        super().__init__(transport, job_operations(transport.settings, "classifiers"))

    def submit(
        self,
        *,
        method: Method = "paper",
        scenario: str = "reference-flight",
        seeds: int = 5,
        first_seed: int = 1,
        hyperparameters: Json | None = None,
        priority: int = 0,
        idempotency_key: str | None = None,
    ) -> Job:
        """Trains one on flights of a scenario of the server's library, one data set a seed; the same seeds give the same bits.

        hyperparameters: what is trained otherwise than the method says: `epochs`, `hidden`, `optimiser` (`sgdm` or `adam`), `learning_rate`,
        `momentum`, `l2`, `batch`, `seed`.
        """
        body: Json = {"method": method, "scenario": scenario, "seeds": seeds, "first_seed": first_seed, "priority": priority}
        body |= without_none(hyperparameters=hyperparameters)
        return self._do(self._operations.submit(body, idempotency_key))

    def evaluate(
        self,
        id: str,
        *,
        scenario: str | None = None,
        repeats: int = 5,
        seed: int = 30_001,
        priority: int = 0,
        idempotency_key: str | None = None,
    ) -> Job:
        """Flies fresh flights of the protocol with one: a campaign, for `client.campaigns`."""
        body: Json = {"scenario": scenario, "repeats": repeats, "seed": seed, "priority": priority}
        return self._do(self._operations.submit(body, idempotency_key, self._operations.path(id, "evaluations")))

    def file(self, id: str) -> bytes:
        """The classifier's file (JSON)."""
        return self.artifact(id, "classifier.json")
