"""Detectors of the literature behind the interface of `rotortwin.detectors`: to be beaten, and to be read.

    from rotortwin import detectors, reference_detectors

    lessons = detectors.steps(losses=[0.05, 0.1, 0.2], seeds=range(100, 103))
    print(detectors.score(reference_detectors.everything(), detectors.steps(), learn_from=lessons))

| Class | Method | Source |
|---|---|---|
| `Cusum` | cumulative sum | Page, Biometrika 41 (1954) |
| `Glr` | generalized likelihood ratio over unknown onset and size | Willsky & Jones, IEEE TAC 21 (1976); Basseville & Nikiforov, *Detection of Abrupt Changes* (1993), §7.2 |
| `Imm` | interacting multiple models | Blom & Bar-Shalom, IEEE TAC 33 (1988); for faults: Zhang & Li, IEEE TAES 34 (1998) |
| `SlidingMode` | sliding-mode observer, equivalent injection | Edwards, Spurgeon & Patton, Automatica 36 (2000) |
| `BoostedTrees` | gradient-boosted trees | Friedman, Annals of Statistics 29 (2001); scikit-learn's histograms |
| `Convolutional` | 1-D convolutions over time | Ince et al., IEEE TIE 63 (2016) |
| `Recurrent` | long short-term memory | Hochreiter & Schmidhuber, Neural Computation 9 (1997) |

All see the residual of our four-axis observer (`wrench_residual_…`, h r = unexplained thrust and torques), less its mean in the calibration and
in units of its spread there, so that one threshold serves all flights; all learn from flights with their truth what the loss of each rotor looks like.
They are our own short forms of these methods, with thresholds that nobody tuned: `detectors.curve` sweeps them.
The last two need PyTorch, the trees scikit-learn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .detectors import CALIBRATED_S, WINDOW_S, Detector, EvidenceDetector, Flight, LabelledFlight
from .simulation import STEP_S, InputError

if TYPE_CHECKING:
    import torch

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


def directions(flights: Sequence[LabelledFlight], name: str) -> NDArray[np.float64]:
    """The unit direction in which the loss of each rotor moves the standardized residual, shape (rotors, 4): its mean over the flights with that fault."""
    rotors = flights[0].flight.rotor_count
    shifts = np.zeros((rotors, len(AXES)))
    for each in flights:
        if each.case.rotor is not None:
            shift = standardized(each.flight)[each.truth == each.case.rotor].mean(axis=0)
            shifts[each.case.rotor - 1] += shift / max(float(np.linalg.norm(shift)), 1e-12)
    lengths = np.linalg.norm(shifts, axis=1)
    if (lengths == 0).any():
        raise InputError(f"{name}: expected flights with a fault of each rotor to learn from, rotor {lengths.argmin() + 1} has none")
    return np.asarray(shifts / lengths[:, None])


def _learnt(what: NDArray[np.float64] | None, name: str) -> NDArray[np.float64]:
    if what is None:
        raise InputError(f"{name}: expected flights to learn from (`learn_from`)")
    return what


class Cusum(EvidenceDetector):
    """A cumulative sum for each rotor (Page 1954) along the direction in which its loss moves the residual.

    S_i ← max(0, S_i + d_i·z − κ), d_i the unit direction of rotor i, learnt as the mean shift of z over the flights with its fault; the
    verdict is the rotor with the largest S_i once that is beyond the threshold, ambiguous while the second is within a tenth of it.
    """

    name = "CUSUM"
    rivalry = 0.9

    def __init__(self, threshold: float = 40.0, drift: float = 1.5, largest: float | None = None) -> None:
        self.threshold = threshold
        self.drift = drift
        #: Upper bound of the sums, so that a rotor that recovers is released; twice the threshold by default.
        self.largest = 2.0 * threshold if largest is None else largest
        self._directions: NDArray[np.float64] | None = None

    def learn(self, flights: Sequence[LabelledFlight]) -> None:
        self._directions = directions(flights, self.name)

    def evidence(self, flight: Flight) -> NDArray[np.float64]:
        along = standardized(flight) @ _learnt(self._directions, self.name).T
        found = np.zeros_like(along)
        sums = np.zeros(along.shape[1])
        for window in np.flatnonzero(flight.window_end_s > CALIBRATED_S):
            sums = np.maximum(sums + along[window] - self.drift, 0.0)
            # Scaled together, so that its neighbours do not catch up.
            sums *= min(1.0, self.largest / max(float(sums.max()), 1e-12))
            found[window] = sums
        return found


class _Whitened(EvidenceDetector):
    """Common part of `Glr` and `Imm`: the healthy residual as z⁺ = A z + w, A diagonal, w of covariance Σ, learnt from healthy time."""

    def __init__(self) -> None:
        self._directions: NDArray[np.float64] | None = None
        self._a = np.zeros(len(AXES))
        self._precision: NDArray[np.float64] = np.eye(len(AXES))

    def learn(self, flights: Sequence[LabelledFlight]) -> None:
        self._directions = directions(flights, self.name)
        before, after = [], []
        for each in flights:
            z = standardized(each.flight)
            calm = (each.truth == 0) & (each.flight.window_end_s > SETTLED_S)
            pairs = calm[1:] & calm[:-1]
            before.append(z[:-1][pairs])
            after.append(z[1:][pairs])
        x, y = np.vstack(before), np.vstack(after)
        self._a = np.clip((x * y).sum(axis=0) / (x * x).sum(axis=0), 0.0, 0.99)
        self._precision = np.asarray(np.linalg.inv(np.cov((y - self._a * x).T) + 1e-9 * np.eye(len(AXES))), dtype=np.float64)

    def _innovation(self, flight: Flight) -> NDArray[np.float64]:
        """z − A z of the window before, shape (windows, 4)."""
        z = standardized(flight)
        return np.vstack([np.zeros((1, z.shape[1])), z[1:] - self._a * z[:-1]])


class Glr(_Whitened):
    """Generalized likelihood ratio (Willsky & Jones 1976) of a step of unknown onset and size along the direction of each rotor.

    ℓ_i(t) = max over onsets k of ½ (Σ sᵀΣ⁻¹e)² / (Σ sᵀΣ⁻¹s), nats, sums from k to t; e the innovation, s the signature of a step that sets in at k: the observer
    answers it with 1 − exp(−h t), h = 5 /s. Sizes below 0, gains, count as none. Onsets of the last `horizon` windows, and the likeliest of the older ones.
    """

    name = "GLR"
    rivalry = 0.9

    def __init__(self, threshold: float = 25.0, horizon: int = 64, observer_gain: float = 5.0) -> None:
        super().__init__()
        self.threshold = threshold
        self.horizon = horizon
        self.observer_gain = observer_gain

    def evidence(self, flight: Flight) -> NDArray[np.float64]:
        d = _learnt(self._directions, self.name)
        weighed = self._innovation(flight) @ self._precision
        first = int(np.argmax(flight.window_end_s > CALIBRATED_S))
        weighed[:first] = 0.0
        answer = 1.0 - np.exp(-self.observer_gain * WINDOW_S * (np.arange(self.horizon) + 0.5))
        step = np.concatenate([[0.0], answer])
        # Response to a step of size 1 in each axis, after whitening, shape (horizon, 4).
        shape = step[1:, None] - self._a * step[:-1, None]
        found = np.zeros((flight.window_count, len(d)))
        for age in range(1, self.horizon + 1):
            along = np.column_stack([np.convolve(weighed[:, axis], shape[:age, axis][::-1])[: len(weighed)] for axis in range(len(AXES))])
            signatures = shape[:age, None, :] * d[None, :, :]
            information = np.einsum("jia,ab,jib->i", signatures, self._precision, signatures)
            size = np.maximum(along @ d.T, 0.0)
            ratio = 0.5 * size**2 / np.maximum(information, 1e-12)
            # Onsets before the end of the calibration do not count.
            ratio[: first + age - 1] = 0.0
            found = np.maximum(found, ratio)
        # `size` and `information` are of the oldest onset now: the best of those that leave the horizon is kept and goes on, a rival while it leads.
        steady = shape[-1] * d
        gained = np.einsum("ia,ab,ib->i", steady, self._precision, steady)
        kept, known = np.zeros(len(d)), np.full(len(d), 1e-12)
        for window in range(first + self.horizon, flight.window_count):
            kept = kept + steady @ weighed[window]
            known = known + gained
            leaving = ratio[window] > 0.5 * np.maximum(kept, 0.0) ** 2 / known
            kept, known = np.where(leaving, size[window], kept), np.where(leaving, information, known)
            found[window] = np.maximum(found[window], 0.5 * np.maximum(kept, 0.0) ** 2 / known)
        return found


class Imm(_Whitened):
    """Interacting multiple models (Blom & Bar-Shalom 1988; Zhang & Li 1998): a Kalman filter for healthy and some for each rotor, mixed by a Markov chain.

    As in Zhang & Li, each model has a fault of a fixed size m: `sizes` times the median size of the faults it has learnt from. State: the disturbance n of four
    axes, n⁺ = A n + w, and the observer's answer q⁺ = q + κ (m − q), κ = 1 − exp(−h T); z = n + d_i q. Healthy: m = 0. Evidence is the logarithm of the odds
    of all models of rotor i against healthy, nats. The chain leaves healthy once in `mean_time_s`, and a fault as seldom.
    """

    name = "IMM"

    def __init__(
        self, threshold: float = 7.0, mean_time_s: float = 3600.0, sizes: Sequence[float] = (0.25, 0.5, 1.0, 2.0), observer_gain: float = 5.0
    ) -> None:
        super().__init__()
        self.threshold = threshold
        self.mean_time_s = mean_time_s
        self.sizes = tuple(sizes)
        self.observer_gain = observer_gain
        self._size = 0.0

    def learn(self, flights: Sequence[LabelledFlight]) -> None:
        super().learn(flights)
        faulty = [each for each in flights if each.case.rotor is not None]
        self._size = float(np.median([np.linalg.norm(standardized(each.flight)[each.truth != 0].mean(axis=0)) for each in faulty]))

    def evidence(self, flight: Flight) -> NDArray[np.float64]:
        d = _learnt(self._directions, self.name)
        rotors, axes, levels = len(d), len(AXES), len(self.sizes)
        models = 1 + rotors * levels
        z = standardized(flight)
        leave = WINDOW_S / self.mean_time_s
        moves = np.zeros((models, models))
        moves[0, 1:] = leave / (models - 1)
        moves[1:, 0] = leave
        np.fill_diagonal(moves, 1.0 - moves.sum(axis=1))
        answer = 1.0 - np.exp(-self.observer_gain * WINDOW_S)
        size = np.concatenate([[0.0], np.tile(self._size * np.asarray(self.sizes), rotors)])
        push = np.zeros((models, axes + 1))
        push[:, axes] = answer * size
        pace = np.append(self._a, 1.0 - answer)
        walk = np.zeros((axes + 1, axes + 1))
        walk[:axes, :axes] = np.linalg.inv(self._precision)
        along = np.concatenate([np.zeros((1, axes)), np.repeat(d, levels, axis=0)])
        look = np.concatenate([np.broadcast_to(np.eye(axes), (models, axes, axes)), along[:, :, None]], axis=2)
        # The size is nowhere exactly that of a model: an answer that is a tenth off is no surprise.
        walk_of = np.repeat(walk[None], models, axis=0)
        walk_of[:, axes, axes] = (0.1 * answer * size) ** 2
        seen_noise = 1e-4 * np.eye(axes)
        weight = np.concatenate([[1.0], np.full(models - 1, 1e-30)])
        mean = np.zeros((models, axes + 1))
        spread = np.zeros((models, axes + 1, axes + 1))
        spread[:, :axes, :axes] = walk[:axes, :axes] / (1.0 - self._a.max() ** 2)
        found = np.full((flight.window_count, rotors), -np.inf)
        for window in range(flight.window_count):
            calibrated = bool(flight.window_end_s[window] > CALIBRATED_S)
            predicted = weight @ moves if calibrated else weight
            # Share of a model's own estimate in its mixed initial state; the rest comes from healthy, without a response yet.
            own = np.ones((models, 1))
            if calibrated:
                own[1:, 0] = weight[1:] * moves.diagonal()[1:] / predicted[1:]
            mixed = own * mean + (1.0 - own) * mean[0]
            from_own, from_healthy = mean - mixed, mean[0] - mixed
            spread = own[:, :, None] * (spread + from_own[:, :, None] * from_own[:, None, :]) + (1.0 - own[:, :, None]) * (
                spread[0] + from_healthy[:, :, None] * from_healthy[:, None, :]
            )
            mean = mixed * pace + push
            spread = spread * pace[:, None] * pace[None, :] + walk_of
            surprise = z[window] - (look @ mean[:, :, None])[:, :, 0]
            gain = spread @ look.transpose(0, 2, 1)
            covariance = look @ gain + seen_noise
            inverse = np.linalg.inv(covariance)
            log_likelihood = -0.5 * ((surprise[:, None, :] @ inverse @ surprise[:, :, None])[:, 0, 0] + np.linalg.slogdet(covariance)[1])
            step = gain @ inverse
            mean = mean + (step @ surprise[:, :, None])[:, :, 0]
            spread = spread - step @ gain.transpose(0, 2, 1)
            # Healthy has no response.
            mean[0, axes] = 0.0
            spread[0, axes, :], spread[0, :, axes] = 0.0, 0.0
            if not calibrated:
                continue
            log_weight = np.log(predicted) + log_likelihood
            weight = np.maximum(np.exp(log_weight - log_weight.max()), 1e-30)
            weight /= weight.sum()
            found[window] = np.log(weight[1:].reshape(rotors, levels).sum(axis=1) / weight[0])
        return found


class SlidingMode(EvidenceDetector):
    """Sliding-mode observer (Edwards, Spurgeon & Patton 2000): the injection that keeps it on the residual is the unexplained wrench.

    The residual r of our observer obeys ṙ = δ − h r, δ the unexplained wrench. The copy r̂˙ = −h r̂ + ν with ν = ρ sat((r − r̂)/φ) slides along it, and the
    low-passed ν (`time_s`) is δ. Evidence is ν along the direction of rotor i in units of its spread in the calibration.
    """

    name = "sliding mode"
    rivalry = 0.9

    def __init__(self, threshold: float = 6.0, time_s: float = 0.5, observer_gain: float = 5.0, reach: float = 8.0, layer: float = 0.5) -> None:
        self.threshold = threshold
        self.time_s = time_s
        self.observer_gain = observer_gain
        self.reach = reach
        self.layer = layer
        self._directions: NDArray[np.float64] | None = None

    def _injection(self, flight: Flight) -> NDArray[np.float64]:
        """The low-passed injection at the end of each window in calibration standard deviations, shape (windows, 4)."""
        r = np.column_stack([flight[axis].astype(np.float64) for axis in AXES])
        time_s = flight["time_s"]
        calm = (time_s > SETTLED_S) & (time_s <= CALIBRATED_S)
        if calm.sum() < 400:
            raise InputError(f"expected a flight longer than {CALIBRATED_S:g} s, the time of the calibration")
        spread = np.maximum(r[calm].std(axis=0), 1e-12)
        r = r / spread
        # 1/s: beyond the variations of a healthy residual, with a margin for a fault.
        reach = self.reach * self.observer_gain
        copy, smooth = np.zeros(len(AXES)), np.zeros(len(AXES))
        kept = np.empty_like(r)
        share = STEP_S / self.time_s
        for step, seen in enumerate(r):
            injected = reach * np.clip((seen - copy) / self.layer, -1.0, 1.0)
            copy = copy + STEP_S * (injected - self.observer_gain * copy)
            smooth = smooth + share * (injected - smooth)
            kept[step] = smooth
        ends = kept[np.arange(1, flight.window_count + 1) * (len(flight["time_s"]) // flight.window_count) - 1]
        calm = (flight.window_end_s > 2.0 * SETTLED_S) & (flight.window_end_s <= CALIBRATED_S)
        return np.asarray((ends - ends[calm].mean(axis=0)) / np.maximum(ends[calm].std(axis=0), 1e-12))

    def learn(self, flights: Sequence[LabelledFlight]) -> None:
        self._directions = directions(flights, self.name)

    def evidence(self, flight: Flight) -> NDArray[np.float64]:
        along = self._injection(flight) @ _learnt(self._directions, self.name).T
        along[flight.window_end_s <= CALIBRATED_S] = 0.0
        return np.asarray(along)


class _Classifier(EvidenceDetector):
    """Learns the classes 0 healthy, i rotor i. Evidence is the log odds of rotor i against healthy."""

    @staticmethod
    def _odds(probabilities: NDArray[np.float64]) -> NDArray[np.float64]:
        logs = np.log(np.maximum(probabilities, 1e-9))
        return np.asarray(logs[:, 1:] - logs[:, :1])


class BoostedTrees(_Classifier):
    """Gradient-boosted trees over windows: the standardized residual and its means over the last 4 and 16 windows. Needs scikit-learn."""

    name = "boosted trees"

    def __init__(self, threshold: float = 0.0, **settings: Any) -> None:
        from sklearn.ensemble import HistGradientBoostingClassifier

        self.threshold = threshold
        self._model = HistGradientBoostingClassifier(**{"max_iter": 150, "random_state": 0, **settings})
        self._rotors: int | None = None

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
        self._rotors = flights[0].flight.rotor_count

    def evidence(self, flight: Flight) -> NDArray[np.float64]:
        if self._rotors is None:
            raise InputError(f"{self.name}: expected flights to learn from (`learn_from`)")
        probabilities = np.zeros((flight.window_count, self._rotors + 1))
        probabilities[:, np.asarray(self._model.classes_, dtype=np.int64)] = self._model.predict_proba(self._features(flight))
        return self._odds(probabilities)


class _Sequences(_Classifier):
    """A PyTorch network over the standardized residuals of the last `memory` windows; learns by Adam on all windows after the calibration.

    Healthy windows weigh as much as all faults together. The same seed gives the same weights on the same machine and version of PyTorch.
    """

    def __init__(self, threshold: float = 0.0, *, memory: int = 32, hidden: int = 32, epochs: int = 8, rate: float = 2e-3, batch: int = 256, seed: int = 0) -> None:
        try:
            import torch  # noqa: F401
        except ImportError as error:
            raise InputError(f"{self.name}: expected PyTorch, `pip install torch`: {error}") from error
        self.threshold = threshold
        self.memory, self.hidden, self.epochs, self.rate, self.batch, self.seed = memory, hidden, epochs, rate, batch, seed
        self._model: torch.nn.Module | None = None

    def _network(self, classes: int) -> torch.nn.Module:
        raise NotImplementedError

    def _sequences(self, flight: Flight) -> NDArray[np.float32]:
        """The last `memory` windows up to each one, shape (windows, memory, 4); zeros before the flight."""
        # Beyond 30 standard deviations there is nothing to learn.
        z = np.clip(standardized(flight), -30.0, 30.0).astype(np.float32)
        padded = np.vstack([np.zeros((self.memory - 1, z.shape[1]), dtype=np.float32), z])
        return np.lib.stride_tricks.sliding_window_view(padded, self.memory, axis=0).transpose(0, 2, 1)

    def learn(self, flights: Sequence[LabelledFlight]) -> None:
        import torch

        used = [each.flight.window_end_s > CALIBRATED_S for each in flights]
        x = torch.from_numpy(np.concatenate([self._sequences(each.flight)[part] for each, part in zip(flights, used, strict=True)]))
        y = torch.from_numpy(np.concatenate([each.truth[part] for each, part in zip(flights, used, strict=True)]))
        classes = flights[0].flight.rotor_count + 1
        counts = torch.bincount(y, minlength=classes).clamp(min=1).double()
        weights = 1.0 / counts
        weights[0] *= classes - 1
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self.seed)
            model = self._network(classes)
            optimizer = torch.optim.Adam(model.parameters(), lr=self.rate)
            loss = torch.nn.CrossEntropyLoss(weight=(weights / weights.sum()).float())
            model.train()
            for _ in range(self.epochs):
                for part in torch.split(torch.randperm(len(x)), self.batch):
                    optimizer.zero_grad()
                    loss(model(x[part]), y[part]).backward()
                    optimizer.step()
        model.eval()
        self._model = model

    def evidence(self, flight: Flight) -> NDArray[np.float64]:
        import torch

        if self._model is None:
            raise InputError(f"{self.name}: expected flights to learn from (`learn_from`)")
        with torch.no_grad():
            found = self._model(torch.from_numpy(np.ascontiguousarray(self._sequences(flight))))
            return self._odds(torch.softmax(found.double(), dim=1).numpy())


class Convolutional(_Sequences):
    """Two layers of 1-D convolutions over time and their mean (Ince et al. 2016 in short). Needs PyTorch."""

    name = "1-D CNN"

    def _network(self, classes: int) -> torch.nn.Module:
        import torch
        from torch import nn

        class Net(nn.Module):  # type: ignore[misc, unused-ignore]
            def __init__(self, hidden: int) -> None:
                super().__init__()
                self.layers = nn.Sequential(
                    nn.Conv1d(len(AXES), hidden, 5, padding=2), nn.ReLU(), nn.Conv1d(hidden, hidden, 5, stride=2, padding=2), nn.ReLU(),
                )  # fmt: skip
                # The mean over all time and the latest value: for an old fault and a new one.
                self.out = nn.Linear(2 * hidden, classes)

            def forward(self, x: torch.Tensor) -> torch.Tensor:
                found = self.layers(x.transpose(1, 2))
                result: torch.Tensor = self.out(torch.cat([found.mean(dim=2), found[:, :, -2:].mean(dim=2)], dim=1))
                return result

        return Net(self.hidden)


class Recurrent(_Sequences):
    """Long short-term memory (Hochreiter & Schmidhuber 1997) over the last windows. Needs PyTorch."""

    name = "LSTM"

    def _network(self, classes: int) -> torch.nn.Module:
        from torch import nn

        class Net(nn.Module):  # type: ignore[misc, unused-ignore]
            def __init__(self, hidden: int) -> None:
                super().__init__()
                self.memory = nn.LSTM(len(AXES), hidden, batch_first=True)
                self.out = nn.Linear(hidden, classes)

            def forward(self, x: torch.Tensor) -> torch.Tensor:
                found, _ = self.memory(x)
                result: torch.Tensor = self.out(found[:, -1])
                return result

        return Net(self.hidden)


def everything() -> list[Detector]:
    """One of each with its defaults, except those whose library is missing, which `missing` names."""
    made: list[Detector] = [Cusum(), Glr(), Imm(), SlidingMode()]
    absent = missing()
    if "scikit-learn" not in absent:
        made.append(BoostedTrees())
    if "torch" not in absent:
        made += [Convolutional(), Recurrent()]
    return made


def missing() -> list[str]:
    """Packages that some detectors here need and that are not installed."""
    from importlib.util import find_spec

    return [package for package, module in (("scikit-learn", "sklearn"), ("torch", "torch")) if find_spec(module) is None]
