"""Bags written, and recordings read, by libraries that are not ours: mcap, mcap-ros2-support and rosbags.

    bags.py write FOLDER        walk.bag, mcap/ and db3/ with the same messages, as rosbags writes them
    bags.py read FILE.mcap      what all three libraries find in a recording, as JSON
    bags.py stream FILE.mcap    messages of a whole recording, which may have no index
    bags.py salvage FILE.mcap   messages of a recording that was cut off, up to where it ends
    bags.py octomap FILE DEF    what a serialised octomap_msgs/msg/Octomap says, given its definition
"""

import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from mcap.reader import NonSeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

CUSTOM_MSG = """
std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
{package}/CustomPoint[] points
"""
CUSTOM_POINT = """
uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line
"""

START = 1_700_000_000_000_000_000
SCANS, POINTS, STEP = 12, 1000, 100_000


def messages(store, package, ros1):
    """(topic, type, time, message) of a second: scans in both forms, and the IMU in g."""
    kind = store.types
    stamp = lambda ns: kind["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)

    def header(ns):
        fields = {"stamp": stamp(ns), "frame_id": "livox_frame"}
        return kind["std_msgs/msg/Header"](**({"seq": 0} if ros1 else {}), **fields)

    point = kind[f"{package}/msg/CustomPoint"]
    field = kind["sensor_msgs/msg/PointField"]
    layout = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7), ("t", 16, 6)]
    for scan in range(SCANS):
        start = START + scan * 100_000_000
        x = np.arange(POINTS, dtype=np.float32) * 0.01 + scan
        points = [point(i * STEP, float(x[i]), 1.5, -0.25, i % 256, 0, 0) for i in range(POINTS)]
        custom = kind[f"{package}/msg/CustomMsg"]
        rsvd = np.zeros(3, np.uint8)
        yield "/livox/lidar", f"{package}/msg/CustomMsg", start, custom(header(start), start, POINTS, 1, rsvd, points)
        rows = np.zeros(POINTS, dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("i", "<f4"), ("t", "<u4")])
        rows["x"], rows["y"], rows["z"] = x, 1.5, -0.25
        rows["i"], rows["t"] = np.arange(POINTS) % 256, np.arange(POINTS) * STEP
        fields = [field(name, offset, datatype, 1) for name, offset, datatype in layout]
        data = np.frombuffer(rows.tobytes(), np.uint8)
        cloud = kind["sensor_msgs/msg/PointCloud2"]
        yield (
            "/livox/points",
            "sensor_msgs/msg/PointCloud2",
            start,
            cloud(header(start), 1, POINTS, fields, False, 20, 20 * POINTS, data, True),
        )
        for sample in range(20):
            ns = start + sample * 5_000_000
            vector, quaternion = kind["geometry_msgs/msg/Vector3"], kind["geometry_msgs/msg/Quaternion"]
            imu = kind["sensor_msgs/msg/Imu"](
                header(ns),
                quaternion(0.0, 0.0, 0.0, 1.0),
                np.zeros(9),
                vector(0.01, -0.02, 0.03),
                np.zeros(9),
                vector(0.0, 0.01, 1.0),
                np.zeros(9),
            )
            yield "/livox/imu", "sensor_msgs/msg/Imu", ns, imu


def fill(writer, store, package, serialize, ros1=False):
    connections = {}
    for topic, name, ns, message in messages(store, package, ros1):
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, name, typestore=store)
        writer.write(connections[topic], ns, serialize(message, name))


def store_of(which, package):
    store = get_typestore(which)
    types = get_types_from_msg(CUSTOM_POINT, f"{package}/msg/CustomPoint")
    types |= get_types_from_msg(CUSTOM_MSG.format(package=package), f"{package}/msg/CustomMsg")
    store.register(types)
    return store


def write(folder):
    store = store_of(Stores.ROS1_NOETIC, "livox_ros_driver")
    with Writer1(folder / "walk.bag") as writer:
        fill(writer, store, "livox_ros_driver", store.serialize_ros1, ros1=True)
    store = store_of(Stores.ROS2_HUMBLE, "livox_ros_driver2")
    for name, plugin in [("mcap", StoragePlugin.MCAP), ("db3", StoragePlugin.SQLITE3)]:
        with Writer2(folder / name, version=9, storage_plugin=plugin) as writer:
            fill(writer, store, "livox_ros_driver2", store.serialize_cdr)


def read(path):
    found = {"mcap": Counter(), "rosbags": Counter(), "attachments": {}}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found["profile"] = reader.get_header().profile
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            found["mcap"][f"{channel.topic} {schema.name}"] += 1
            if channel.topic == "/lidar/scan":
                found["scan"] = [decoded.width, decoded.point_step, [field.name for field in decoded.fields]]
            elif channel.topic == "/odometry/pose":
                found["pose"] = [decoded.header.frame_id, decoded.child_frame_id, list(decoded.pose.covariance)]
                found["position"] = [getattr(decoded.pose.pose.position, axis) for axis in "xyz"]
            elif channel.topic == "/imu/sample":
                found["accel"] = [getattr(decoded.linear_acceleration, axis) for axis in "xyz"]
            elif channel.topic == "/grid/plan":
                found["grid"] = [decoded.info.width, decoded.info.height, len(decoded.data)]
        for attachment in reader.iter_attachments():
            found["attachments"][attachment.name] = attachment.data.decode()
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            found["rosbags"][f"{connection.topic} {connection.msgtype}"] += 1
    print(json.dumps(found))


def salvage(path):
    count = 0
    with open(path, "rb") as file:
        try:
            for _ in NonSeekingReader(file).iter_messages(log_time_order=False):
                count += 1
        except Exception as cause:  # the end of a file that was cut off
            print(type(cause).__name__, file=sys.stderr)
    print(count)


def stream(path):
    with open(path, "rb") as file:
        print(sum(1 for _ in make_reader(file).iter_messages()))


def octomap(path, definition):
    store = get_typestore(Stores.ROS2_HUMBLE)
    name = "octomap_msgs/msg/Octomap"
    own = definition.read_text().split("=" * 80)[0]
    store.register(get_types_from_msg(own, name))
    map = store.deserialize_cdr(path.read_bytes(), name)
    stamp = map.header.stamp
    binary = str(map.binary).lower()
    print(map.header.frame_id, f"{stamp.sec}.{stamp.nanosec}", binary, map.id, map.resolution, map.data.tobytes().hex())


if __name__ == "__main__":
    command, *paths = sys.argv[1:]
    commands = {"write": write, "read": read, "stream": stream, "salvage": salvage, "octomap": octomap}
    commands[command](*map(Path, paths))
