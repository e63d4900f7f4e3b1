#!/usr/bin/env python3
"""Makes ros2.db3, the messages of ros2.mcap byte by byte, and ros2-humble.db3, the first 40 of each topic as ROS 2 recorded before Iron.

usage: make_db3.py   (needs mcap, numpy, rosbags and the module sqlite3; nothing of this project)

The second holds no definitions; its battery is the whole message of Humble, serialised by rosbags, where ros2.mcap has one of a few fields.
"""
import shutil, sqlite3, tempfile
from pathlib import Path
import numpy as np
from mcap.reader import make_reader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

HERE = Path(__file__).parent
HUMBLE, COUNT = get_typestore(Stores.ROS2_HUMBLE), 40


def battery(schema, data):
    """The message of Humble with what the short one says."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema.data.decode(), schema.name))
    short, types = store.deserialize_cdr(data, schema.name), HUMBLE.types
    stamp = types["builtin_interfaces/msg/Time"](sec=short.header.stamp.sec, nanosec=short.header.stamp.nanosec)
    whole = types["sensor_msgs/msg/BatteryState"](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=short.header.frame_id), voltage=short.voltage, temperature=20.0,
        current=short.current, charge=1.0, capacity=2.0, design_capacity=3.0, percentage=0.5, power_supply_status=2, power_supply_health=1,
        power_supply_technology=3, present=True, cell_voltage=np.full(4, 4.0, np.float32), cell_temperature=np.zeros(0, np.float32),
        location="belly", serial_number="1",
    )
    return bytes(HUMBLE.serialize_cdr(whole, "sensor_msgs/msg/BatteryState"))


def write(name, most, humble):
    with tempfile.TemporaryDirectory() as folder, open(HERE / "ros2.mcap", "rb") as file:
        bag = Path(folder) / "bag"
        with Writer(bag, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
            connections, counts = {}, {}
            for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
                if channel.id not in connections:
                    connections[channel.id] = writer.add_connection(channel.topic, schema.name, msgdef=schema.data.decode(), rihs01="RIHS01_" + "0" * 64)
                counts[channel.id] = counts.get(channel.id, 0) + 1
                if counts[channel.id] <= most:
                    short = humble and schema.name == "sensor_msgs/msg/BatteryState"
                    writer.write(connections[channel.id], message.log_time, battery(schema, message.data) if short else message.data)
        shutil.copy(next(bag.glob("*.db3")), HERE / name)


write("ros2.db3", 10**9, False)
write("ros2-humble.db3", COUNT, True)
database = sqlite3.connect(HERE / "ros2-humble.db3", isolation_level=None)
# The tables of Humble.
database.execute("DROP TABLE message_definitions")
database.execute("ALTER TABLE topics DROP COLUMN type_description_hash")
database.execute("VACUUM")
