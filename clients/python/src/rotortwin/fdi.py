"""The detectors as a service, over HTTP in chunks."""

# Made from aio_fdi.py by generate_sync.py: change that file.

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from ._resource import followed
from ._exchange import drive
from ._stream import FollowFdi
from ._transport import Transport
from ._twin import CHUNK, FdiOperations, chunks_of, judge_params, session_body, truth_params
from .models import FdiAnswer, FdiEvent, FdiState, FdiWindow, Json, Sample

if TYPE_CHECKING:
    import pandas


class FdiSession:
    """Detectors of one flight. Closed by `close`, at the end of a `with`, or when nothing is asked of it for its idle time."""

    def __init__(self, transport: Transport, operations: FdiOperations, state: FdiState) -> None:
        self._transport = transport
        self._operations = operations
        self.id = state.id
        #: State when it was opened.
        self.opened = state
        #: First step of the next chunk.
        self.next_step = state.next_step

    def feed(self, samples: Sequence[Sample] | str, *, lost: int = 0) -> FdiAnswer:
        """Feeds 1 to 4000 samples, 2.5 ms apart: JSON objects, or a CSV text with a head line.

        lost: samples between the last chunk and this one that will never come. A chunk that is refused changes nothing.
        """
        first = self.next_step + lost
        answer = drive(self._transport.http, self._operations.feed(self.id, first, samples, lost > 0))
        self.next_step = answer.next_step
        return answer

    def feed_frame(self, frame: pandas.DataFrame, *, chunk: int = CHUNK) -> list[FdiWindow]:
        """Feeds the rows of a data frame with the columns of a run's telemetry or of an imported log, at 400 Hz; all windows."""
        windows: list[FdiWindow] = []
        for text in chunks_of(frame, chunk):
            windows += (self.feed(text)).windows
        return windows

    def state(self) -> FdiState:
        """Calibration, last window, every change of the verdict."""
        return drive(self._transport.http, self._operations.state(self.id))

    def close(self) -> None:
        """Ends it."""
        drive(self._transport.http, self._operations.close(self.id))

    def __enter__(self) -> FdiSession:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class Fdi:
    """Fault detection as a service: sessions that take measurements."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._operations = FdiOperations(transport.settings)

    def open(
        self,
        vehicle: str | None = None,
        *,
        vehicle_text: str | Path | None = None,
        classifier: str | None = None,
        settings: Mapping[str, Any] | None = None,
        topic: bool = False,
    ) -> FdiSession:
        """Opens a session.

        vehicle: a name of the server's library; or vehicle_text, a document or a `Path`. classifier: one of the library's; without one
        the network says nothing. settings: keys of the `[fdi]` table of a scenario, such as `calibration_end_s`. topic: also take
        measurements over zenoh.
        """
        body = session_body(vehicle, vehicle_text, classifier, settings, topic)
        state = drive(self._transport.http, self._operations.open(body))
        return FdiSession(self._transport, self._operations, state)

    def attach(self, id: str) -> FdiSession:
        """A session that is open already, such as one of another program: to be fed from its next step."""
        state = drive(self._transport.http, self._operations.state(id))
        return FdiSession(self._transport, self._operations, state)

    def sessions(self) -> Sequence[FdiState]:
        """One's open sessions. Listing them keeps none alive."""
        return drive(self._transport.http, self._operations.sessions())

    def events(self, *, wait: bool = True) -> Iterator[FdiEvent]:
        """One's sessions as they change, whoever feeds them; watching keeps none alive, and a token that may only read is enough.

        It begins with `open`, all that are open. Then `session`, one that was opened or fed since, at most ten times a second, and `closed`.
        After a broken connection it begins again, with another `open`: what was sent in the meantime is in the states that it lists. wait: False
        ends after `open`.
        """
        for event in followed(self._transport, FollowFdi(self._transport.settings, wait)):
            yield event

    def judge(
        self,
        log: str | Path | bytes | None = None,
        *,
        vehicle: str,
        id: str | None = None,
        part: str | None = None,
        classifier: str | None = None,
        calibration_start_s: float | None = None,
        calibration_end_s: float | None = None,
        flight: bool = False,
    ) -> Json:
        """Runs the detectors on a flight log: `timeline` of the verdicts, `final_window`, `not_judged` with reasons, `lacks`, …; nothing is stored.

        log: a file, or its bytes; or id, of a log or run that the server has. part: seconds `35:65`, or `order:2-5-6-3-1-4` where the columns
        are those of other rotors. classifier: one of the library's; without one the network says nothing. calibration_start_s,
        calibration_end_s: until then the vehicle is taken for healthy. flight: with `flight` in the answer, as `logs.flight` gives it.
        """
        params = judge_params(log, id, vehicle, part, classifier, calibration_start_s, calibration_end_s, flight)
        return drive(self._transport.http, self._operations.judge(log, params, "reports"))

    def score(
        self,
        log: str | Path | bytes | None = None,
        *,
        vehicle: str,
        truth: str | Sequence[tuple[float, int, float | None]],
        id: str | None = None,
        part: str | None = None,
        classifier: str | None = None,
        calibration_start_s: float | None = None,
        calibration_end_s: float | None = None,
        flight: bool = False,
    ) -> Json:
        """Judges a flight log whose truth is known, and scores the verdicts of all detectors: a dictionary with `report` and `score`.

        truth: the column of the log that holds it, or rows (time in s, rotor from 1, lost share of its thrust): from this time on it has lost
        that share; 0: recovered, None: unknown size. A healthy log has `[(0, 0, None)]`. The rest: as for `judge`.
        """
        params = judge_params(log, id, vehicle, part, classifier, calibration_start_s, calibration_end_s, flight)
        return drive(self._transport.http, self._operations.judge(log, params | truth_params(truth), "scores"))
