"""Bags of ROS 1 and 2, written by the library rosbags: what they say of a vehicle whose numbers are known, or the cause is said."""

import csv
import json
import math
import shutil
from functools import cache

import numpy as np
import pytest
from noslip.analysis.identification.log import read_poses, read_rows
from noslip.cli.main import main
from noslip.readers import bags
from noslip.readers.bags import table_of_log
from noslip.tests.analysis import test_calibration as geometry
from scipy.spatial.transform import Rotation

pytest.importorskip("rosbags")
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START = 1_764_230_000_250_000_000  # ns since 1970
KINDS = ("one.bag", "two_db3", "two_mcap", "two_db3/two_db3.db3", "two_mcap/two_mcap.mcap")
WHEELS = {"theta_r": "/joint_states:right_wheel.position", "theta_l": "/joint_states:left_wheel.position"}
PLACE = {"x_c": "/odom:pose.pose.position.x", "y_c": "/odom:pose.pose.position.y", "phi": "/odom:pose.pose.orientation"}
PART = 0.4  # of a row, after which poses are measured: within a row the angles are linear, and the vehicle drives an arc


def options(mapped) -> list[str]:
    return [word for name, field in mapped.items() for word in ("--map", f"{name}={field}")]


class Store:
    """Messages of ROS 1 or 2 by short constructors."""

    def __init__(self, is_first: bool, store=None):
        self.is_first = is_first
        self.store = store or get_typestore(Stores.ROS1_NOETIC if is_first else Stores.ROS2_HUMBLE)

    def new(self, kind, *values, **named):
        package, name = kind.split("/")
        return self.store.types[f"{package}/msg/{name}"](*values, **named)

    def header(self, t):
        ns = START + round(t * 1e9)
        stamp = self.new("builtin_interfaces/Time", ns // 10**9, ns % 10**9) if t is not None else None
        return self.new("std_msgs/Header", **({"seq": 0} if self.is_first else {}), stamp=stamp, frame_id="odom")

    def joints(self, t, position, velocity=()):
        position = dict(position)
        values = np.array(list(position.values()), float)
        kinds = {"position": values, "velocity": np.array(velocity, float), "effort": np.zeros(0)}
        return self.new("sensor_msgs/JointState", header=self.header(t), name=list(position), **kinds)

    def vector(self, *values):
        return self.new("geometry_msgs/Vector3", *map(float, values))

    def twist(self, v, omega):
        return self.new("geometry_msgs/Twist", linear=self.vector(v, 0, 0), angular=self.vector(0, 0, omega))

    def odometry(self, t, x, y, rotation: Rotation):
        pose = self.new(
            "geometry_msgs/Pose",
            position=self.new("geometry_msgs/Point", float(x), float(y), 0.0),
            orientation=self.new("geometry_msgs/Quaternion", *map(float, rotation.as_quat())),
        )
        return self.new(
            "nav_msgs/Odometry",
            header=self.header(t),
            child_frame_id="base_link",
            pose=self.new("geometry_msgs/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=self.new("geometry_msgs/TwistWithCovariance", twist=self.twist(0, 0), covariance=np.zeros(36)),
        )


def driven(rows: int = 300):
    """Times, angles and poses of a drive whose heading passes pi; poses between rows, exactly on the arcs."""
    right, left = geometry.winding(rows)
    start = (1.0, -2.0, 2.7)
    axle = geometry.reckoned(right, left, start)
    angles = np.column_stack([np.concatenate([[0.0], np.cumsum(each)]) / geometry.TRUE["r"] for each in (right, left)])
    measured = range(0, rows, 3)
    poses = [geometry.reckoned([PART * right[k]], [PART * left[k]], axle[k])[1] for k in measured]
    return np.arange(rows + 1) * geometry.PERIOD, angles, (np.array(measured) + PART) * geometry.PERIOD, geometry.of_center(np.array(poses))


def drive(made: Store, late=(0.002, 0.005)):
    """(topic, time of the bag, message) of a drive: the order of joints changes, the floor is not level."""
    t, angles, times, poses = driven()
    for k, (right, left) in enumerate(angles):
        joints = {"right_wheel": right, "left_wheel": left, "turret.pan": 0.3}
        yield "/joint_states", t[k] + late[0], made.joints(t[k], reversed(joints.items()) if k % 7 == 3 else joints)
    for time, (x, y, heading) in zip(times, poses, strict=True):
        yield "/odom", time + late[1], made.odometry(time, x, y, Rotation.from_euler("ZYX", [heading, 0.05, -0.03]))


def write(path, messages, made: Store, writer):
    """Write messages, each with the definition of its type unless the format has none."""
    with writer as bag:
        pack = made.store.serialize_ros1 if made.is_first else made.store.serialize_cdr
        connections = {}
        for topic, time, message in sorted(messages, key=lambda each: each[1]):
            kind = message.__msgtype__
            if (topic, kind) not in connections:
                connections[topic, kind] = bag.add_connection(topic, kind, typestore=made.store)
            bag.write(connections[topic, kind], START + round(time * 1e9), pack(message, kind))
    return str(path)


def first(path, messages, **settings):
    made = Store(True)
    return write(path, messages(made), made, Writer1(path, **settings))


def second(path, messages, plugin="MCAP", store=None):
    made = Store(False, store)
    return write(path, messages(made), made, Writer2(path, version=9, storage_plugin=StoragePlugin[plugin]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A drive in each format."""
    place = tmp_path_factory.mktemp("bags")
    first(place / "one.bag", drive)
    for plugin, name in (("SQLITE3", "two_db3"), ("MCAP", "two_mcap")):
        second(place / name, drive, plugin)
    return place


def of(*messages):
    """A drive with other messages."""
    return lambda made: [*drive(made), *(each for more in messages for each in more(made))]


def only(topics=(), change=lambda made, topic, t, message: message):
    """A drive without these topics, with changed messages; None leaves one out."""

    def messages(made):
        for topic, t, message in drive(made):
            if topic not in topics and (changed := change(made, topic, t, message)) is not None:
                yield topic, t, changed

    return messages


# -- what a bag tells ------------------------------------------------------------------------------------------------------


def calibrated(file, capsys, mapped=None, *more):
    assert main(["calibrate", str(file), "--robot", "labmate", "--fit", "r", "b", "--json", *options(mapped or WHEELS | PLACE), *more]) == 0
    said = json.loads(capsys.readouterr().out)
    return {name: each["value"] for name, each in said["parameters"].items()}, said["remarks"]


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_of_the_vehicle(kind, folder, capsys):
    """Angles are linear within a row, so that nothing is lost in joining; the order of joints changes."""
    values, remarks = calibrated(folder / kind, capsys)
    assert values == {name: pytest.approx(geometry.TRUE[name], rel=1e-6) for name in ("r", "b")}
    assert "theta_r of /joint_states is interpolated linearly at the times of other topics" in remarks
    assert not any("late" in each or "bag" in each for each in remarks)


def test_joints_by_index_would_be_found(folder, capsys, monkeypatch):
    """A planted defect: the joint is where it is in the first message."""
    good, _ = calibrated(folder / "one.bag", capsys)
    monkeypatch.setattr(bags, "_value", by_index(bags._value))
    arguments = ["calibrate", str(folder / "one.bag"), "--robot", "labmate", "--fit", "r", "b", *options(WHEELS | PLACE)]
    assert main([*arguments, "--json"]) == 2 or json.loads(capsys.readouterr().out)["parameters"]["b"]["value"] != pytest.approx(good["b"], rel=1e-3)


def by_index(right):
    def value(message, field, start, where, messages):
        if field.endswith(".position"):
            return float(message.position[messages[0][1].name.index(field.removesuffix(".position"))])
        return right(message, field, start, where, messages)

    return value
