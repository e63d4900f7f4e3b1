"""A detector of your own, step by step, beside ours and two of the literature on the same flights."""

from cmath import phase
from collections import deque
from collections.abc import Sequence

from rotortwin import detectors, reference_detectors


class TorqueDirection(detectors.StepDetector):
    """Where does the unexplained torque point? A rotor that loses thrust lets the vehicle roll and pitch towards it."""

    name = "torque direction"

    def learn(self, flights: Sequence[detectors.LabelledFlight]) -> None:
        """The direction of each rotor, from flights in which it was damaged."""
        self.directions: dict[int, complex] = {}
        for each in flights:
            if each.case.rotor is not None:
                torque = each.flight["wrench_residual_mx_nms"] + 1j * each.flight["wrench_residual_my_nms"]
                fault = each.flight["time_s"] > each.case.onset_s
                shift = complex(torque[fault].mean() - torque[~fault].mean())
                self.directions[each.case.rotor] = shift / abs(shift)

    def begin(self, rotor_count: int) -> None:
        self.recent: deque[complex] = deque(maxlen=80)
        self.sum, self.sum_of_squares, self.count = 0j, 0.0, 0

    def step(self, sample: dict[str, float]) -> int:
        torque = complex(sample["wrench_residual_mx_nms"], sample["wrench_residual_my_nms"])
        if sample["time_s"] < detectors.CALIBRATED_S:
            if sample["time_s"] > 1.0:
                self.sum, self.sum_of_squares, self.count = self.sum + torque, self.sum_of_squares + abs(torque) ** 2, self.count + 1
            return detectors.NOT_READY
        self.recent.append(torque)
        mean = self.sum / self.count
        spread = (self.sum_of_squares / self.count - abs(mean) ** 2) ** 0.5
        shift = sum(self.recent) / len(self.recent) - mean
        if len(self.recent) < 80 or abs(shift) < 3.0 * spread:
            return detectors.HEALTHY
        return min(self.directions, key=lambda rotor: abs(phase(shift / self.directions[rotor])))


if __name__ == "__main__":
    own: list[detectors.Detector] = [TorqueDirection(), reference_detectors.Cusum()]
    try:
        own.append(reference_detectors.BoostedTrees())
    except ImportError:
        print("without scikit-learn: no boosted trees")
    lessons = detectors.steps(losses=[0.05, 0.1], seeds=[100, 101])
    print(detectors.score(own, detectors.steps(losses=[0.05, 0.1], seeds=[1]), learn_from=lessons))
