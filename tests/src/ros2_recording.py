"""A flight as a recording of ROS 2, written by rosbags, against the same flight imported directly.

ros2_recording.py PROGRAM RUN FOLDER; RUN is the folder of a simulated run. Fails where a column of the recording differs from the run's by more
than its messages resolve.
"""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

PROGRAM, RUN, FOLDER = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
#: As PX4 sends them through its bridge, a release that no table of ours knows.
PX4 = {
    "px4_msgs/msg/ActuatorMotors": "uint64 timestamp\nuint64 timestamp_sample\nuint16 reversible_flags\nuint8 ACTUATOR_FUNCTION_MOTOR1 = 101\n"
    "float32[12] control\nfloat32[3] from_a_release_to_come\n",
    "px4_msgs/msg/BatteryStatus": "uint64 timestamp\nbool connected\nfloat32 voltage_v\nfloat32 current_a\nfloat32[14] voltage_cell_v\n",
}
START_NS = 1_760_000_000_000_000_000
COLUMNS = pq.read_table(RUN / "telemetry.parquet").to_pydict()
COUNT = len(COLUMNS["time_s"])


def column(name: str) -> np.ndarray:
    return np.array(COLUMNS[name], dtype=float)


def matrix(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Forward-right-down to north-east-down."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
    return np.array([
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ])


ENU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
FLU = np.diag([1, -1, -1.0])


def quaternion(m: np.ndarray) -> tuple[float, float, float, float]:
    """w, x, y, z by the largest of the four (Shepperd)."""
    squares = [1 + m[0, 0] + m[1, 1] + m[2, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2], 1 - m[0, 0] + m[1, 1] - m[2, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2]]
    k = int(np.argmax(squares))
    r = math.sqrt(squares[k])
    a, b, c = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    d, e, f = m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2]
    parts = [[r * r, a, b, c], [a, r * r, d, e], [b, d, r * r, f], [c, e, f, r * r]][k]
    return tuple(part / (2 * r) for part in parts)


def record(folder: Path, compressed: bool) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in PX4.items():
        store.register(get_types_from_msg(text, name))
    types = store.types
    header = lambda ns: types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](int(ns // 10**9), int(ns % 10**9)), "odom")
    vector = lambda v: types["geometry_msgs/msg/Vector3"](*map(float, v))
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    if compressed:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    rotors = sum(name.startswith("duty_") for name in COLUMNS)
    with writer:
        topics = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in (("/odometry/filtered", "nav_msgs/msg/Odometry"), ("/imu/data", "sensor_msgs/msg/Imu"), ("/fmu/out/actuator_motors", "px4_msgs/msg/ActuatorMotors"), ("/fmu/out/battery_status", "px4_msgs/msg/BatteryStatus"))
        }
        send = lambda topic, ns, message: writer.write(topics[topic], int(ns), store.serialize_cdr(message, topics[topic].msgtype))
        position = np.stack([column(f"position_{axis}_m") for axis in ("north", "east", "down")], 1)
        velocity = np.stack([column(f"velocity_{axis}_m_s") for axis in ("north", "east", "down")], 1)
        angles = np.stack([column(f"{axis}_rad") for axis in ("roll", "pitch", "yaw")], 1)
        rates = np.stack([column(f"{axis}_rate_rad_s") for axis in ("roll", "pitch", "yaw")], 1)
        duty = np.stack([column(f"duty_{rotor + 1}") for rotor in range(rotors)], 1)
        volts, amperes = column("battery_voltage_v"), column("battery_current_a")
        nothing = np.zeros(36)
        for k in range(COUNT):
            ns = START_NS + round(COLUMNS["time_s"][k] * 1e9)
            # The autopilot's clock starts at its boot, and the message arrives later.
            micros = round(COLUMNS["time_s"][k] * 1e6) + 12_000_000
            turn = matrix(*angles[k])
            w, x, y, z = quaternion(ENU @ turn @ FLU)
            pose = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](*map(float, ENU @ position[k])), types["geometry_msgs/msg/Quaternion"](x, y, z, w))
            twist = types["geometry_msgs/msg/Twist"](vector(FLU @ turn.T @ velocity[k]), vector(FLU @ rates[k]))
            odometry = types["nav_msgs/msg/Odometry"](header(ns), "base_link", types["geometry_msgs/msg/PoseWithCovariance"](pose, nothing), types["geometry_msgs/msg/TwistWithCovariance"](twist, nothing))
            send("/odometry/filtered", ns + 400_000, odometry)
            unknown = np.array([-1.0] + [0.0] * 8)
            imu = types["sensor_msgs/msg/Imu"](header(ns), types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 0.0), unknown, vector(FLU @ rates[k]), np.zeros(9), vector([0, 0, 0]), np.zeros(9))
            send("/imu/data", ns + 300_000, imu)
            control = np.full(12, np.nan, dtype=np.float32)
            control[:rotors] = duty[k]
            send("/fmu/out/actuator_motors", ns, types["px4_msgs/msg/ActuatorMotors"](micros, micros, 0, control, np.zeros(3, dtype=np.float32)))
            if k % 4 == 0:
                cells = np.full(14, 4.0, dtype=np.float32)
                send("/fmu/out/battery_status", ns, types["px4_msgs/msg/BatteryStatus"](micros, True, float(volts[k]), float(amperes[k]), cells))


def imported(file: Path, name: str) -> tuple[dict[str, np.ndarray], dict]:
    out = FOLDER / name
    done = subprocess.run([PROGRAM, "log", "import", file, "--out", out, "--quiet"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (parquet,) = out.glob("*.parquet")
    account = json.loads(next(out.glob("*.import.json")).read_text())
    return {key: np.array(values, dtype=float) for key, values in pq.read_table(parquet).to_pydict().items()}, account


direct, _ = imported(RUN, "direct")
for way in ("plain", "zstd"):
    record(FOLDER / way, way == "zstd")
    read, account = imported(FOLDER / way, f"{way}-read")
    assert account["source"]["kind"] == "ros2_bag", account["source"]
    assert len(read["time_s"]) == COUNT, len(read["time_s"])
    assert np.abs(read["time_s"] - direct["time_s"]).max() < 2e-6
    checked = 0
    for name, values in direct.items():
        if name == "time_s" or name not in read:
            continue
        error = np.abs(read[name] - values)
        if name.endswith("_rad"):
            error = np.minimum(error, 2 * math.pi - error)
        # px4_msgs is single precision; the battery comes with every fourth row and is interpolated linearly.
        limit = {"battery_voltage_v": 0.05, "battery_current_a": 2.0}.get(name, 1e-6 if name.startswith("duty_") else 1e-9)
        worst = np.nanmax(error)
        assert worst < limit, f"{way} {name}: {worst}"
        # Only rows after the last battery message have no value.
        assert np.isnan(read[name]).sum() <= 4, name
        checked += 1
    assert checked >= 20, checked
    assert "accel_z_m_s2" not in read, "an accelerometer of zeros is none"
    print(f"{way}: {checked} columns of {COUNT} rows agree")
