"""A controller in Python: joins a run over zenoh and flies position and attitude PD around the hover duty.

    python3 -m venv /tmp/venv && /tmp/venv/bin/pip install eclipse-zenoh protobuf
    rotortwin fly config/scenarios/short-hover.toml --link zenoh --external controller
    /tmp/venv/bin/python examples/python_controller.py tcp/127.0.0.1:PORT RUN_ID

Endpoint and run id are those that `rotortwin fly` prints. The same law as services/controller/examples/pd_controller.rs; here the
messages are sent by hand, to show the whole protocol. docs/own-controller.md explains it.
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
CONTROLLER = 2  # Role.ROLE_CONTROLLER
JOIN_PERIOD_S = 0.1  # a join is said again until it is answered
JOIN_LIMIT_S = 10.0
SILENCE_LIMIT_S = 8.0  # longer than the plant waits for one step, so that the plant speaks first

POSITION, TILT, YAW = (4.0, 3.0), (150.0, 22.0), (5.0, 4.0)  # (Kp 1/s², Kd 1/s)
MOST_TILT = 0.4  # rad


def load_messages():
    """Message classes from the descriptor in the repository: no protoc, no generated code."""
    path = pathlib.Path(__file__).parent.parent / "proto/src/descriptor.bin"
    files = descriptor_pb2.FileDescriptorSet.FromString(path.read_bytes())
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    names = ("Join", "Setup", "Ready", "Finish", "SensorFrame", "MotorCommand")
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"rotortwin.v1.{name}")) for name in names}


def refusal(setup):
    """One sentence if this controller cannot fly the run, else an empty one."""
    if setup.protocol_version != PROTOCOL_VERSION:
        return f"expected version {PROTOCOL_VERSION} of the protocol, got {setup.protocol_version}"
    if setup.controller.trim_duty == 0.0:
        return 'expected a trimmed start (start = "trimmed"): this controller has no integrator'
    if setup.controller.WhichOneof("thrust_to_duty") != "full_thrust_n":
        return 'expected thrust_to_duty = "linear", got the inverse map'
    return ""


def pd(gains, error, error_rate):
    return gains[0] * error + gains[1] * error_rate


def limited(value, low, high):
    return min(max(value, low), high)


def control(setup, sensors):
    """Attitude setpoint, rad, and duty of each rotor, fraction."""
    nav, want, body = sensors.nav, sensors.reference, setup.body
    north, east, down = (
        pd(POSITION, getattr(want.position_ned_m, axis) - getattr(nav.position_ned_m, axis),
           getattr(want.velocity_ned_m_s, axis) - getattr(nav.velocity_ned_m_s, axis))
        for axis in ("north", "east", "down")
    )
    att, rates = nav.attitude, nav.body_rates_rad_s
    sin, cos = math.sin(att.yaw_rad), math.cos(att.yaw_rad)
    roll = limited((east * cos - north * sin) / body.gravity_m_s2, -MOST_TILT, MOST_TILT)
    pitch = limited(-(north * cos + east * sin) / body.gravity_m_s2, -MOST_TILT, MOST_TILT)
    jx, jy, jz = body.inertia_body_kg_m2
    mx = jx * pd(TILT, roll - att.roll_rad, -rates.forward)
    my = jy * pd(TILT, pitch - att.pitch_rad, -rates.right)
    mz = jz * pd(YAW, math.remainder(want.yaw_rad - att.yaw_rad, math.tau), -rates.down)
    arms = [(r.position_m.forward, r.position_m.right, r.spin * r.moment_ratio_m) for r in setup.rotors]
    sum_x, sum_y, sum_z = (sum(arm[i] ** 2 for arm in arms) for i in range(3))
    # More than hover, N: what lifts, plus each torque shared out by lever. Right for regular polygons.
    extra = [-body.mass_kg * down / len(arms) - mx * y / sum_y + my * x / sum_x + mz * z / sum_z for x, y, z in arms]
    duty = [limited(setup.trim_duty + force / setup.full_thrust_n, 0.0, 1.0) for force in extra]
    return {"roll_rad": roll, "pitch_rad": pitch, "yaw_rad": want.yaw_rad}, duty


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

        subscribers = [listen("setup/controller", "Setup"), listen("sensors", "SensorFrame"), listen("finish", "Finish")]
        # The plant learns from the end of this token that we are gone.
        token = session.liveliness().declare_token(f"{prefix}/alive/controller")
        publisher = session.declare_publisher(f"{prefix}/command", express=True,
                                              congestion_control=zenoh.CongestionControl.BLOCK)
        join = messages["Join"](run_id=run_id, role=CONTROLLER, protocol_version=PROTOCOL_VERSION,
                                program="python_controller", host=socket.gethostname(), pid=os.getpid())
        setup, steps = None, 0
        for _ in range(round(JOIN_LIMIT_S / JOIN_PERIOD_S)):
            session.put(f"{prefix}/join/controller", join.SerializeToString())
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
        ready = messages["Ready"](run_id=run_id, role=CONTROLLER, refusal=reason)
        session.put(f"{prefix}/ready/controller", ready.SerializeToString())
        if reason:
            sys.exit(f"refused to fly: {reason}")

        while True:
            try:
                name, payload = inbox.get(timeout=JOIN_LIMIT_S if steps == 0 else SILENCE_LIMIT_S)
            except queue.Empty:
                sys.exit(f"the plant has been silent since step {steps - 1}")
            if name == "Finish":
                finish = messages["Finish"].FromString(payload)
                if finish.failure:
                    sys.exit(f"the run failed after {finish.steps} steps: {finish.failure}")
                print(f"{steps} steps answered, the run is done")
                return
            if name != "SensorFrame":
                continue  # a Setup that was sent twice
            sensors = messages["SensorFrame"].FromString(payload)
            if sensors.stamp.run_id != run_id or sensors.stamp.step != steps:
                continue
            setpoint, duty = control(setup.controller, sensors)
            # The setpoint is only for plots, but it must be there.
            command = messages["MotorCommand"](stamp=sensors.stamp, duty=duty, attitude_setpoint=setpoint)
            publisher.put(command.SerializeToString())
            steps += 1


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python_controller.py ENDPOINT RUN_ID, as printed by 'rotortwin fly --link zenoh --external controller'")
    main(sys.argv[1], int(sys.argv[2], 16))
