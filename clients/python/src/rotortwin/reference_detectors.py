"""Detectors of the literature behind the interface of `rotortwin.detectors`: to be beaten, and to be read.

    from rotortwin import detectors, reference_detectors

    lessons = detectors.steps(losses=[0.05, 0.1, 0.2], seeds=range(100, 103))
    print(detectors.score([reference_detectors.Cusum(), reference_detectors.BoostedTrees()], detectors.steps(), learn_from=lessons))

Both see the residual of our four-axis observer (`wrench_residual_…`, h r = unexplained thrust and torques), less its mean in the calibration and
in units of its spread there, so that one threshold serves all flights.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .detectors import AMBIGUOUS, CALIBRATED_S, HEALTHY, NOT_READY, Detector, Flight, LabelledFlight
from .simulation import InputError

AXES = ("wrench_residual_fz_ns", "wrench_residual_mx_nms", "wrench_residual_my_nms", "wrench_residual_mz_nms")
#: The observer has settled, s.
SETTLED_S = 1.0


def standardized(flight: Flight) -> NDArray[np.float64]:
    """Mean residual of each window, shape (windows, 4), less the mean of the calibration, in units of its standard deviation."""
    means = np.column_stack([flight.windows(axis).astype(np.float64).mean(axis=1) for axis in AXES])
    calm = (flight.window_end_s > SETTLED_S) & (flight.window_end_s <= CALIBRATED_S)
    if calm.sum() < 10:
        raise InputError(f"expected a flight longer than {CALIBRATED_S:g} s, the time of the calibration")
    return np.asarray((means - means[calm].mean(axis=0)) / np.maximum(means[calm].std(axis=0), 1e-12))


class Cusum(Detector):
    """A cumulative sum for each rotor (Page 1954) along the direction in which its loss moves the residual.

    S_i ← max(0, S_i + d_i·z − κ), d_i the unit direction of rotor i, learnt as the mean shift of z over the flights with its fault; the
    verdict is the rotor with the largest S_i once that is beyond the threshold, ambiguous while the second is within a tenth of it.
    """

    name = "CUSUM"

    def __init__(self, threshold: float = 40.0, drift: float = 1.5) -> None:
        self.threshold = threshold
        self.drift = drift
        self._directions: NDArray[np.float64] | None = None

    def learn(self, flights: Sequence[LabelledFlight]) -> None:
        rotors = flights[0].flight.rotor_count
        shifts = np.zeros((rotors, len(AXES)))
        for each in flights:
            if each.case.rotor is not None:
                shift = standardized(each.flight)[each.truth == each.case.rotor].mean(axis=0)
                shifts[each.case.rotor - 1] += shift / max(float(np.linalg.norm(shift)), 1e-12)
        lengths = np.linalg.norm(shifts, axis=1)
        if (lengths == 0).any():
            raise InputError(f"{self.name}: expected flights with a fault of each rotor to learn from, rotor {lengths.argmin() + 1} has none")
        self._directions = shifts / lengths[:, None]

    def judge(self, flight: Flight) -> NDArray[np.int64]:
        if self._directions is None:
            raise InputError(f"{self.name}: expected flights to learn from (`learn_from`)")
        along = standardized(flight) @ self._directions.T
        said = np.full(flight.window_count, NOT_READY, dtype=np.int64)
        sums = np.zeros(len(self._directions))
        for window in np.flatnonzero(flight.window_end_s > CALIBRATED_S):
            sums = np.maximum(sums + along[window] - self.drift, 0.0)
            # Bounded as a whole, so that a rotor that recovers is released and its neighbours do not catch up.
            sums *= min(1.0, 2.0 * self.threshold / max(float(sums.max()), 1e-12))
            first, second = np.sort(sums)[::-1][:2]
            if first < self.threshold:
                said[window] = HEALTHY
            else:
                said[window] = AMBIGUOUS if second > 0.9 * first else int(sums.argmax()) + 1
        return said


class BoostedTrees(Detector):
    """Gradient-boosted trees over windows: the standardized residual and its means over the last 4 and 16 windows. Needs scikit-learn."""

    name = "boosted trees"

    def __init__(self, **settings: Any) -> None:
        from sklearn.ensemble import HistGradientBoostingClassifier

        self._model = HistGradientBoostingClassifier(**{"max_iter": 150, "random_state": 0, **settings})
        self._has_learnt = False

    @staticmethod
    def _features(flight: Flight) -> NDArray[np.float64]:
        now = standardized(flight)
        sums = np.vstack([np.zeros((1, now.shape[1])), now.cumsum(axis=0)])
        at = np.arange(1, len(sums))
        trailing = [(sums[at] - sums[np.maximum(at - n, 0)]) / np.minimum(at, n)[:, None] for n in (4, 16)]
        return np.column_stack([now, *trailing])

    def learn(self, flights: Sequence[LabelledFlight]) -> None:
        used = [each.flight.window_end_s > CALIBRATED_S for each in flights]
        features = np.vstack([self._features(each.flight)[part] for each, part in zip(flights, used, strict=True)])
        self._model.fit(features, np.concatenate([each.truth[part] for each, part in zip(flights, used, strict=True)]))
        self._has_learnt = True

    def judge(self, flight: Flight) -> NDArray[np.int64]:
        if not self._has_learnt:
            raise InputError(f"{self.name}: expected flights to learn from (`learn_from`)")
        said = np.asarray(self._model.predict(self._features(flight)), dtype=np.int64)
        said[flight.window_end_s <= CALIBRATED_S] = NOT_READY
        return said
