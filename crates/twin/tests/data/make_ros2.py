#!/usr/bin/env python3
"""Makes ros2.mcap, and the numbers that stand in it (section [ros2] of expected.toml).

usage: make_ros2.py   (needs numpy and mcap-ros2-support, with whose writer the file is made; nothing of this project)

A drone that flies a curve, as ROS 2 records it: world east-north-up, body forward-left-up, the twist of the odometry in the body's axes. The
expected numbers are made from the curve in north-east-down and forward-right-down, not from the messages. Beside it: another drone, a camera.
"""
from pathlib import Path
import numpy as np
from mcap_ros2.writer import Writer

HEADER = "std_msgs/Header header\n"
TYPES = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
    "geometry_msgs/Pose": "Point position\nQuaternion orientation\n",
    "geometry_msgs/Twist": "Vector3 linear\nVector3 angular\n",
    "geometry_msgs/PoseWithCovariance": "Pose pose\nfloat64[36] covariance\n",
    "geometry_msgs/TwistWithCovariance": "Twist twist\nfloat64[36] covariance\n",
}
TEXTS = {
    "nav_msgs/msg/Odometry": HEADER + "string child_frame_id\ngeometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n",
    "sensor_msgs/msg/Imu": HEADER + "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance # [0] = -1: unknown\n"
    "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\ngeometry_msgs/Vector3 linear_acceleration\n"
    "float64[9] linear_acceleration_covariance\n",
    "sensor_msgs/msg/BatteryState": "uint8 POWER_SUPPLY_STATUS_UNKNOWN = 0\n" + HEADER + "float32 voltage\nfloat32 temperature\nfloat32 current\n"
    "float32[] cell_voltage\nstring location\n",
    "actuator_msgs/msg/Actuators": HEADER + "float64[] position\nfloat64[] velocity\nfloat64[] normalized\n",
    "sensor_msgs/msg/Image": HEADER + "uint32 height\nuint32 width\nuint8[] data\n",
}


def definition(name):
    """With all that it is made of."""
    text, done = TEXTS[name], []
    while True:
        missing = [kind for kind in TYPES if kind not in done and any(part in text for part in (kind, kind.split("/")[1] + " "))]
        if not missing:
            return text
        for kind in missing:
            done.append(kind)
            text += "=" * 80 + f"\nMSG: {kind}\n" + TYPES[kind]


# The curve, in north-east-down and forward-right-down.
START_NS, STEP_NS, COUNT = 1_750_000_000_123_000_000, 10_000_000, 200
t = np.arange(COUNT) * STEP_NS * 1e-9
position = np.stack([2 * np.sin(0.8 * t), 1.5 * np.cos(0.5 * t), -1.0 - 0.3 * t], 1)
velocity = np.stack([1.6 * np.cos(0.8 * t), -0.75 * np.sin(0.5 * t), np.full(COUNT, -0.3)], 1)
roll, pitch, yaw = 0.3 * np.sin(1.1 * t), 0.2 * np.cos(0.9 * t), 0.5 + 0.4 * t
rates = np.stack([
    0.33 * np.cos(1.1 * t) - 0.4 * np.sin(pitch),
    -0.18 * np.sin(0.9 * t) * np.cos(roll) + 0.4 * np.sin(roll) * np.cos(pitch),
    0.18 * np.sin(0.9 * t) * np.sin(roll) + 0.4 * np.cos(roll) * np.cos(pitch),
], 1)


def rotation(k):
    """Body to world, forward-right-down to north-east-down."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a[k]), np.sin(a[k])) for a in (roll, pitch, yaw))
    x, y, z = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]]), np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]), np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return z @ y @ x


TO_ENU, TO_FLU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]), np.diag([1, -1, -1.0])


def quaternion(matrix):
    w = np.sqrt(max(0, 1 + np.trace(matrix))) / 2
    if w > 0.1:
        x, y, z = (matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]) / (4 * w)
    else:
        raise SystemExit("this curve does not turn so far")
    return {"w": w, "x": x, "y": y, "z": z}


def vector(values):
    return dict(zip("xyz", map(float, values)))


acceleration = np.stack([-1.28 * np.sin(0.8 * t), -0.375 * np.cos(0.5 * t), np.zeros(COUNT)], 1)
force = np.stack([rotation(k).T @ (acceleration[k] - [0, 0, 9.80665]) for k in range(COUNT)])
duty = np.stack([0.5 + 0.05 * np.sin(3 * t + rotor) for rotor in range(4)], 1)
voltage, current = np.float32(16.0 - 0.1 * t), np.float32(12.0 + t)

with open(Path(__file__).parent / "ros2.mcap", "wb") as file:
    writer = Writer(file)
    schema = {name: writer.register_msgdef(name, definition(name)) for name in TEXTS}

    def send(topic, name, k, message, late_ns=2_000_000):
        stamp = START_NS + k * STEP_NS
        message["header"] = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "odom"}
        writer.write_message(topic, schema[name], message, log_time=stamp + late_ns, publish_time=stamp + late_ns)

    for k in range(COUNT):
        turn = rotation(k)
        pose = {"position": vector(TO_ENU @ position[k]), "orientation": quaternion(TO_ENU @ turn @ TO_FLU)}
        twist = {"linear": vector(TO_FLU @ turn.T @ velocity[k]), "angular": vector(TO_FLU @ rates[k])}
        odometry = {"child_frame_id": "base_link", "pose": {"pose": pose, "covariance": [0.01] * 36}, "twist": {"twist": twist, "covariance": [0.0] * 36}}
        # How late a message is recorded does not matter.
        send("/drone1/odom", "nav_msgs/msg/Odometry", k, odometry, late_ns=1_000_000 * (1 + k % 7))
        imu = {
            "orientation": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}, "orientation_covariance": [-1.0] + [0.0] * 8,
            "angular_velocity": vector(TO_FLU @ rates[k]), "angular_velocity_covariance": [0.0] * 9,
            "linear_acceleration": vector(TO_FLU @ force[k]), "linear_acceleration_covariance": [0.0] * 9,
        }
        send("/drone1/imu/data", "sensor_msgs/msg/Imu", k, imu)
        send("/drone1/motors", "actuator_msgs/msg/Actuators", k, {"position": [], "velocity": [], "normalized": [float(d) for d in duty[k]]})
        battery = {"voltage": float(voltage[k]), "temperature": float("nan"), "current": -float(current[k]), "cell_voltage": [4.0] * 4, "location": "belly"}
        send("/drone1/battery", "sensor_msgs/msg/BatteryState", k, battery)
        if k % 10 == 0:
            elsewhere = {"child_frame_id": "", "pose": {"pose": {**pose, "position": vector([9, 9, 9])}, "covariance": [0.0] * 36}, "twist": {"twist": twist, "covariance": [0.0] * 36}}
            send("/drone2/odom", "nav_msgs/msg/Odometry", k, elsewhere)
            send("/camera/image", "sensor_msgs/msg/Image", k, {"height": 1, "width": 40, "data": bytes(40)})
    writer.finish()

columns = {"time_s": t}
for names, values in (
    (("position_north_m", "position_east_m", "position_down_m"), position), (("velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"), velocity),
    (("roll_rad", "pitch_rad", "yaw_rad"), np.stack([roll, pitch, yaw], 1)), (("roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"), rates),
    (("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"), force), (("duty_1", "duty_2", "duty_3", "duty_4"), duty),
):
    columns.update(zip(names, values.T))
columns |= {"battery_voltage_v": voltage.astype(float), "battery_current_a": current.astype(float)}
print("[ros2]")
for name, values in columns.items():
    print(f"{name} = {{ count = {len(values)}, mean = {float(values.mean())!r}, first = {float(values[0])!r}, last = {float(values[-1])!r} }}")
print()
