"""An FDI engine in Python: joins a run over zenoh and judges the flight from the duties alone.

    python3 -m venv venv && venv/bin/pip install eclipse-zenoh protobuf
    rotortwin fly hover --link zenoh --external fdi --set 'fault=[{time_s=15.0, rotor=3, thrust_loss_percent=20.0}]'
    venv/bin/python examples/python_detector.py tcp/127.0.0.1:PORT RUN_ID

Endpoint and run id are those that `rotortwin fly` prints. A rotor that lost thrust is driven harder by the controller: each window of samples, the mean duty of
each rotor, less that of all rotors, is compared with its mean and its scatter during the calibration. That is the whole method; it is no better than it looks
(a vehicle that accelerates, or a payload that shifts, looks the same). The verdict stands where that of the sequential detector stands otherwise; those of the
other evaluators stay "not ready". docs/own-controller.md explains the protocol, docs/own-detector.md other ways for a detector of one's own.
"""

import math
import os
import pathlib
import queue
import socket
import sys

import zenoh
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

PROTOCOL_VERSION = 1
FDI = 3  # Role.ROLE_FDI
NOT_READY, HEALTHY, FAULTY = 1, 2, 3  # Verdict.Kind
JOIN_PERIOD_S = 0.1  # a join is repeated until it is answered
JOIN_LIMIT_S = 10.0
SILENCE_LIMIT_S = 8.0  # longer than the plant waits for one step, so that the plant speaks first

FEWEST_WINDOWS = 16  # of a calibration, so that its scatter means something
DEVIATIONS = 8.0  # from the mean of the calibration, in its scatter


class DutyDetector:
    """Which rotor is driven harder than it was during the calibration."""

    def __init__(self, rotor_count, window_len, calibration_s):
        self.rotor_count, self.window_len = rotor_count, window_len
        self.calibration_s = calibration_s
        self.sums, self.count = [0.0] * rotor_count, 0
        self.windows = []  # of the calibration: the excess of each rotor
        self.mean, self.scatter = None, None
        self.verdict = (NOT_READY, 0)

    def step(self, time_s, duty):
        """Takes the duties of a step; true where a window ends and the verdict is new."""
        self.sums = [total + one for total, one in zip(self.sums, duty)]
        self.count += 1
        if self.count < self.window_len:
            return False
        mean = sum(self.sums) / self.rotor_count
        excess = [(total - mean) / self.count for total in self.sums]
        self.sums, self.count = [0.0] * self.rotor_count, 0
        begin_s, end_s = self.calibration_s
        if begin_s <= time_s < end_s:
            self.windows.append(excess)
        elif time_s >= end_s:
            self.judge(excess)
        return True

    def judge(self, excess):
        if self.mean is None:
            count = len(self.windows)
            if count < FEWEST_WINDOWS:
                return
            columns = list(zip(*self.windows))
            self.mean = [sum(column) / count for column in columns]
            self.scatter = [
                math.sqrt(sum((one - mean) ** 2 for one in column) / (count - 1)) for column, mean in zip(columns, self.mean)
            ]
        away = [(one - mean) / max(scatter, 1e-9) for one, mean, scatter in zip(excess, self.mean, self.scatter)]
        highest = max(range(self.rotor_count), key=lambda rotor: away[rotor])
        self.verdict = (FAULTY, highest + 1) if away[highest] > DEVIATIONS else (HEALTHY, 0)


def load_messages():
    """Message classes from the descriptor in the repository: no protoc, no generated code."""
    path = pathlib.Path(__file__).parent.parent / "proto/src/descriptor.bin"
    files = descriptor_pb2.FileDescriptorSet.FromString(path.read_bytes())
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    names = ("Join", "Setup", "Ready", "Finish", "MeasuredSteps", "FdiReports")
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"rotortwin.v1.{name}")) for name in names}


def refusal(setup):
    """One sentence if this detector cannot judge the run, else an empty one."""
    if setup.protocol_version != PROTOCOL_VERSION:
        return f"expected version {PROTOCOL_VERSION} of the protocol, got {setup.protocol_version}"
    test = setup.fdi.t_test
    windows = (test.calibration_end_s - test.calibration_start_s) / (setup.fdi.window_len * setup.fdi.period_s)
    if windows < FEWEST_WINDOWS:
        return f"expected a calibration of at least {FEWEST_WINDOWS} windows, got {windows:.0f}"
    return ""


def reported(reports, detector, step):
    """Adds the report of a step."""
    stamp = step.sensors.stamp
    is_end = detector.step(stamp.sim_time_ns * 1e-9, step.command.duty)
    kind, rotor = detector.verdict
    report = reports.reports.add(
        residual_nms=[0.0] * (3 * detector.rotor_count),  # three for each rotor and four: it has none
        wrench_residual=[0.0] * 4,
        window_end=is_end,
        sequential_probability=0.0 if kind == NOT_READY else 1.0,  # it does not know how sure it is
        suspect_rotors=1 << (rotor - 1) if rotor else 0,
    )
    report.stamp.CopyFrom(stamp)
    report.t_test.kind = report.network.kind = NOT_READY
    report.sequential.kind, report.sequential.rotor = kind, rotor


def main(endpoint, run_id):
    messages = load_messages()
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    prefix = f"rotortwin/v1/{run_id:016x}"
    inbox = queue.Queue()
    with zenoh.open(config) as session:
        # zenoh calls these from a thread of its own; all work is done in this one.
        def listen(key, name):
            return session.declare_subscriber(f"{prefix}/{key}", lambda sample: inbox.put((name, bytes(sample.payload))))

        subscribers = [listen("setup/fdi", "Setup"), listen("steps", "MeasuredSteps"), listen("finish", "Finish")]
        # The plant learns from the end of this token that we are gone.
        token = session.liveliness().declare_token(f"{prefix}/alive/fdi")
        publisher = session.declare_publisher(f"{prefix}/reports", express=True,
                                              congestion_control=zenoh.CongestionControl.BLOCK)
        join = messages["Join"](run_id=run_id, role=FDI, protocol_version=PROTOCOL_VERSION,
                                program="python_detector", host=socket.gethostname(), pid=os.getpid())
        setup, steps = None, 0
        for _ in range(round(JOIN_LIMIT_S / JOIN_PERIOD_S)):
            session.put(f"{prefix}/join/fdi", join.SerializeToString())
            try:
                name, payload = inbox.get(timeout=JOIN_PERIOD_S)
            except queue.Empty:
                continue
            if name == "Finish":
                sys.exit(f"the plant ended the run: {messages['Finish'].FromString(payload).failure}")
            if name == "Setup":
                setup = messages["Setup"].FromString(payload)
                break
        if setup is None:
            sys.exit(f"no plant of run {run_id:016x} answered at {endpoint} within {JOIN_LIMIT_S:.0f} s")
        reason = refusal(setup)
        session.put(f"{prefix}/ready/fdi", messages["Ready"](run_id=run_id, role=FDI, refusal=reason).SerializeToString())
        if reason:
            sys.exit(f"refused to judge: {reason}")

        test = setup.fdi.t_test
        detector = DutyDetector(len(setup.fdi.rotors), setup.fdi.window_len, (test.calibration_start_s, test.calibration_end_s))
        while True:
            try:
                name, payload = inbox.get(timeout=JOIN_LIMIT_S if steps == 0 else SILENCE_LIMIT_S)
            except queue.Empty:
                sys.exit(f"the plant has been silent since step {steps - 1}")
            if name == "Finish":
                finish = messages["Finish"].FromString(payload)
                if finish.failure:
                    sys.exit(f"the run failed after {finish.steps} steps: {finish.failure}")
                kind, rotor = detector.verdict
                print(f"{steps} steps judged, at the end: {f'rotor {rotor}' if rotor else 'healthy' if kind == HEALTHY else 'not ready'}")
                return
            if name != "MeasuredSteps":
                continue  # a Setup that was sent twice
            reports = messages["FdiReports"]()
            for step in messages["MeasuredSteps"].FromString(payload).steps:
                stamp = step.sensors.stamp
                if stamp.run_id != run_id or stamp.step != steps:
                    continue
                reported(reports, detector, step)
                steps += 1
            if reports.reports:
                publisher.put(reports.SerializeToString())


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python_detector.py ENDPOINT RUN_ID, as printed by 'rotortwin fly --link zenoh --external fdi'")
    main(sys.argv[1], int(sys.argv[2], 16))
