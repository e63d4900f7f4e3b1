"""Inputs to begin with, from files of the project: python3 seeds.py TARGET FOLDER"""

import random
import re
import struct
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: Longer logs are cut to this: an input of a fuzzer should be small.
CUT = 24_000


def wire() -> dict[str, bytes]:
    """The golden messages, for every decoder that may take them."""
    seeds = {}
    kinds = {"SensorFrame": 0, "MotorCommand": 1, "FdiReports": 9, "FdiReport": 2, "Setup": 5, "Join": 6, "Ready": 7, "Finish": 8, "MeasuredSteps": 10}
    for file in (ROOT / "tests/golden/v1").glob("*.bin"):
        name = file.stem.split("-")[0]
        seeds[file.stem] = bytes([kinds[name] | 6 << 4]) + file.read_bytes()
    return seeds


def scenario() -> dict[str, bytes]:
    """Every shipped scenario: its text, all its documents, and some settings."""
    seeds = {"set": b"\x03initial.state_of_charge=0.4\nduration_s=3.0\nseed=7"}
    program = ROOT / "target/release/rotortwin"
    for number in range(32):
        # Instructions: which documents, then place, deed and value.
        seeds[f"changes-{number}"] = bytes([1]) + random.Random(number).randbytes(1 + 5 * (1 + number % 4))
    for file in (ROOT / "config/scenarios").glob("*.toml"):
        seeds[file.stem] = b"\x02" + file.read_bytes()
        if program.exists():
            documents = subprocess.run([program, "check", file], capture_output=True, check=True).stdout
            seeds[f"{file.stem}-documents"] = b"\x00" + documents
    return seeds


def log() -> dict[str, bytes]:
    """Logs of every format, cut where they are long, and text logs with a side file."""
    seeds = {}
    data = ROOT / "crates/twin/tests/data"
    for file in [*data.glob("*"), *data.glob("strawson/*.csv")]:
        if file.suffix in (".usdlog", ".bin", ".ulg", ".csv", ".mcap"):
            # Of a recording in chunks, half of one tells nothing.
            seeds[file.stem] = file.read_bytes()[: None if file.suffix == ".mcap" else CUT]
    canonical = "time_s,position_north_m,duty_1\n" + "".join(f"{i / 100},{i},0.5\n" for i in range(50))
    seeds["canonical"] = canonical.encode()
    seeds["canonical-side"] = (canonical + "#SIDE#vehicle = 'f550'\n").encode()
    fields = "loopIteration,time,gyroADC[0],gyroADC[1],gyroADC[2],motor[0],motor[1],motor[2],motor[3]"
    seeds["blackbox"] = (
        "H Product:Blackbox flight data recorder\nH Data version:2\n"
        f"H Field I name:{fields}\nH Field I signed:0,0,1,1,1,0,0,0,0\n"
        "H Field I predictor:0,0,0,0,0,11,5,5,5\nH Field I encoding:1,1,0,0,0,1,0,0,0\n"
        "H Field P predictor:6,2,1,1,1,3,3,3,3\nH Field P encoding:9,0,7,7,7,8,8,8,8\nH I interval:4\nH P interval:1/1\n"
    ).encode() + b"I\x04\xe8\x07\x02\x01\x04\x2a\x0a\x02\x01" + b"P\xf4\x03\x19\x55\xff\x11\x22" * 20
    seeds["blackbox-csv"] = (
        "loopIteration, time (us), gyroADC[0], gyroADC[1], gyroADC[2], accSmooth[0], accSmooth[1], accSmooth[2], motor[0], motor[1], motor[2], "
        "motor[3], vbatLatest (V)\n" + "".join(f"{i}, {1000 * i}, {i % 7}, 0, 0, 10, -5, 2040, 300, 1500, 700, 2047, 15.3\n" for i in range(40))
    ).encode()
    # Heartbeat and an attitude of MAVLink 1, which has the smaller frame; checksums are for the fuzzer to find.
    stamp = (1_700_000_000_000_000).to_bytes(8, "big")
    seeds["tlog"] = b"".join(
        stamp + bytes([0xFE, len(body), 0, 1, 1, kind]) + body + b"\0\0" for kind, body in ((0, b"\0" * 9), (30, b"\1" * 28), (36, b"\2" * 21))
    )
    # A recording of ROS 2 without chunks: a schema, its channel, two messages.
    def record(opcode: int, content: bytes) -> bytes:
        return bytes([opcode]) + len(content).to_bytes(8, "little") + content

    def text(content: str) -> bytes:
        return len(content).to_bytes(4, "little") + content.encode()

    definition = "uint64 timestamp\nfloat32[3] xyz\nuint8[] more\nstring name\nB b\n" + "=" * 80 + "\nMSG: px4_msgs/B\nfloat64 x\n"
    schema = struct.pack("<H", 1) + text("px4_msgs/msg/VehicleAngularVelocity") + text("ros2msg") + text(definition)
    channel = struct.pack("<HH", 1, 1) + text("/a") + text("cdr") + bytes(4)
    bodies = [struct.pack("<HIQQ", 1, k, k * 10**7, k * 10**7) + b"\0\1\0\0" + struct.pack("<QfffIBxxxI3sxxxxxd", k * 10**4, 1, 2, 3, 1, 7, 3, b"ab\0", 4) for k in (1, 2, 3)]
    seeds["mcap"] = b"\x89MCAP0\r\n" + record(3, schema) + record(4, channel) + b"".join(record(5, body) for body in bodies) + record(15, bytes(4))
    for run in sorted((ROOT / "runs").glob("*/telemetry.parquet"))[:1]:
        seeds["parquet"] = run.read_bytes()
    return seeds


def table() -> dict[str, bytes]:
    """Tables with columns of their own, one with a mapping."""
    rows = "".join(f"12:00:{i / 100:06.3f};{i % 5};0;1;1500;1490;1510\n" for i in range(60))
    text = "Time;Gyro X (deg/s);Gyro Y (deg/s);Gyro Z (deg/s);Motor1;Motor2;Motor3\n" + rows
    mapping = 'source = "csv"\n[csv]\nseparator = ";"\nclock = "Time"\nclock_format = "hh:mm:ss"\n'
    mapping += '[[column]]\nto = "duty"\nfrom = "csv:Motor1,Motor2,Motor3"\nlow = 1000.0\nhigh = 2000.0\n'
    spaces = "t gx gy gz ax ay az q0 q1 q2 q3\n" + "".join(f"{i} 0 1 2 0 0 -9.8 1 0 0 0\n" for i in range(60))
    return {
        "semicolons": text.encode(),
        "decimal-commas": text.replace(".", ",").encode(),
        "mapped": (text + "#MAP#" + mapping).encode(),
        "spaces": spaces.encode(),
    }


def bridge() -> dict[str, bytes]:
    """What boards and autopilots send; the first byte chooses the decoder."""
    frames = {
        # HEARTBEAT, STATUSTEXT and HIL_ACTUATOR_CONTROLS as pymavlink packs them.
        "heartbeat": bytes.fromhex("fd09000007010100000000000000020351030300") + b"\0\0",
    }
    seeds = {
        "servo-16": b"\0" + struct.pack("<HHI16H", 18458, 1000, 7, *[1500] * 16),
        "servo-32": b"\0" + struct.pack("<HHI32H", 29569, 1000, 7, *[1500] * 32),
        "motors": b"\2" + struct.pack("<Hxx16f", 6, *[1500.0] * 16),
        "px4": b'\4{"board_id": 56, "image": "eJwDAAAAAAE=", "image_size": 0, "git_identity": "v1"}',
    }
    seeds |= {f"mavlink-{name}": b"\1" + content for name, content in frames.items()}
    for text in ("ardupilot:127.0.0.1:9002", "betaflight:9103@0.5", "serial:/dev/ttyACM0@921600", "virtual:loss=0.01,seed=3", "tcp:127.0.0.1:5760"):
        seeds[f"address-{text}"] = b"\5" + text.encode()
    # Lines of a plant for ArduPilot, and one with a quaternion and no attitude.
    line = '\n{"timestamp":0.001,"imu":{"gyro":[0,0.1,0],"accel_body":[0,0,-9.80665]},"position":[1,2,-3],"attitude":[0,0,0.5],"velocity":[0,0,0]}\n'
    seeds["plant-line"] = b"\6" + line.encode()
    seeds["plant-quaternion"] = b"\6" + line.replace('"attitude":[0,0,0.5]', '"quaternion":[1,0,0,0]').encode()
    # Recorded commands of a quadrotor (the first byte behind the selector), every 0.5 ms and every 4 ms.
    for parts in (1, 8):
        seeds[f"commands-{parts}"] = b"\7\4RTCMD 1\n" + struct.pack("<II12d", parts, 4, *[0.25, 0.5, 0.75, 1.0] * 3)
    # A board's line: COBS pieces between zeros.
    seeds["board"] = b"\3" + b"\1\2\3\4\5\0" * 4
    return seeds


target, folder = sys.argv[1], Path(sys.argv[2])
for name, content in {"wire": wire, "scenario": scenario, "log": log, "map": table, "bridge": bridge}[target]().items():
    (folder / f"seed-{re.sub('[^A-Za-z0-9-]', '_', name)}").write_bytes(content)
