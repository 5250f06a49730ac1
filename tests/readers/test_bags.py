"""Bags of ROS 1 and 2, written by the library rosbags: they give the numbers that are in them,
or the cause is said."""

import csv
import json
import math
import random
import sqlite3
import sys
from functools import cache

import numpy as np
import pytest
from matplotlib.figure import Figure
from noslip.analysis.identification.log import read_log, read_rows
from noslip.cli.main import main
from noslip.readers import bags
from noslip.readers.bags import table_of_log
from noslip.readers.errors import BadInput
from noslip.tests.analysis import test_calibration as geometry
from noslip.tests.analysis import test_identification as dynamics
from scipy.spatial.transform import Rotation

pytest.importorskip("rosbags")
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START = 1_764_230_000_250_000_000  # ns since 1970
KINDS = ("one.bag", "two_db3", "two_mcap", "two_db3/two_db3.db3", "two_mcap/two_mcap.mcap")
WHEELS = {"theta_r": "/joint_states:right_wheel.position", "theta_l": "/joint_states:left_wheel.position"}
PLACE = {
    "x_c": "/odom:pose.pose.position.x",
    "y_c": "/odom:pose.pose.position.y",
    "phi": "/odom:pose.pose.orientation",
}
# Of a row, after which poses are measured: within a row the angles are linear, and the vehicle drives an arc
PART = 0.4


def options(mapped) -> list[str]:
    return [word for name, field in mapped.items() for word in ("--map", f"{name}={field}")]


stored = cache(get_typestore)


class Store:
    """Messages of ROS 1 or 2 by short constructors."""

    def __init__(self, is_first: bool, store=None):
        self.is_first = is_first
        self.store = store or stored(Stores.ROS1_NOETIC if is_first else Stores.ROS2_HUMBLE)

    def new(self, kind, *values, **named):
        package, name = kind.split("/")
        return self.store.types[f"{package}/msg/{name}"](*values, **named)

    def header(self, t):
        ns = 0 if t is None else START + round(t * 1e9)
        stamp = self.new("builtin_interfaces/Time", ns // 10**9, ns % 10**9)
        return self.new(
            "std_msgs/Header", **({"seq": 0} if self.is_first else {}), stamp=stamp, frame_id="odom"
        )

    def joints(self, t, position, velocity=(), effort=()):
        """Without numbers, the topic does not say velocity or effort."""
        position = dict(position)
        lists = {"position": list(position.values()), "velocity": velocity, "effort": effort}
        kinds = {kind: np.array(values, float) for kind, values in lists.items()}
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
            twist=self.new(
                "geometry_msgs/TwistWithCovariance", twist=self.twist(0, 0), covariance=np.zeros(36)
            ),
        )


@cache
def driven(rows: int = 240):
    """Times and angles of a drive whose heading passes pi; times and poses between rows,
    exactly on the arcs."""
    right, left = geometry.winding(rows)
    start = (1.0, -2.0, 3.4)
    axle = geometry.reckoned(right, left, start)
    angles = np.column_stack(
        [np.concatenate([[0.0], np.cumsum(each)]) / geometry.TRUE["r"] for each in (right, left)]
    )
    measured = range(0, rows, 3)
    poses = [geometry.reckoned([PART * right[k]], [PART * left[k]], axle[k])[1] for k in measured]
    times = (np.array(measured) + PART) * geometry.PERIOD
    return np.arange(rows + 1) * geometry.PERIOD, angles, times, geometry.of_center(np.array(poses))


def drive(made: Store, late=(0.002, 0.005)):
    """(topic, time of the bag, message) of a drive: the order of joints is another one each time,
    the floor is not level."""
    t, angles, times, poses = driven()
    for k, (right, left) in enumerate(angles):
        joints = {"right_wheel": right, "left_wheel": left, "turret.pan": 0.3}
        yield (
            "/joint_states",
            t[k] + late[0],
            made.joints(t[k], random.Random(k).sample(sorted(joints.items()), 3)),
        )
    for time, (x, y, heading) in zip(times, poses, strict=True):
        yield (
            "/odom",
            time + late[1],
            made.odometry(time, x, y, Rotation.from_euler("ZYX", [heading, 0.05, -0.03])),
        )


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


def first(path, messages, compression=None):
    made, writer = Store(True), Writer1(path)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression])
    return write(path, messages(made), made, writer)


def second(path, messages, plugin="MCAP", mode="NONE", store=None):
    made = Store(False, store)
    writer = Writer2(path, version=9, storage_plugin=StoragePlugin[plugin])
    if mode != "NONE":
        writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    return write(path, messages(made), made, writer)


def without_definitions(path, messages, store=None):
    """A database as ROS 2 wrote it up to Humble: the definitions of types are not in it."""
    made = Store(False, store)
    with sqlite3.connect(path) as base:
        base.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,"
            "offered_qos_profiles TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
        )
        topics = {}
        for topic, time, message in sorted(messages(made), key=lambda each: each[1]):
            kind, row = message.__msgtype__, topics.setdefault(topic, len(topics) + 1)
            base.execute("INSERT OR IGNORE INTO topics VALUES(?, ?, ?, 'cdr', '')", (row, topic, kind))
            data = bytes(made.store.serialize_cdr(message, kind))
            base.execute("INSERT INTO messages VALUES(NULL, ?, ?, ?)", (row, START + round(time * 1e9), data))
    base.close()
    return str(path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A drive in each format."""
    place = tmp_path_factory.mktemp("bags")
    first(place / "one.bag", drive)
    for plugin, name in (("SQLITE3", "two_db3"), ("MCAP", "two_mcap")):
        second(place / name, drive, plugin)
    return place


def changed(change):
    """A drive with messages in another form, or without some:
    `change` returns the messages instead of each."""
    return lambda made: (each for message in drive(made) for each in change(made, *message))


def calibrate(file, mapped=None) -> list[str]:
    return [
        "calibrate",
        str(file),
        "--robot",
        "labmate",
        "--fit",
        "r",
        "b",
        *options(WHEELS | PLACE if mapped is None else mapped),
    ]


def fitted(file, capsys):
    """What is fitted, and the remarks."""
    assert main([*calibrate(file), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    return {name: each["value"] for name, each in said["parameters"].items()}, said["remarks"]


TRUE = {name: pytest.approx(geometry.TRUE[name], rel=1e-7) for name in ("r", "b")}


# -- what a bag tells ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_has_every_number(kind, folder):
    """Joints by their names in each message, times of the headers, the yaw on a floor that is not level."""
    table = table_of_log(folder / kind, (), WHEELS | PLACE)
    t, angles, times, poses = driven()
    columns = {name: table[field].numbers(None) for name, field in (WHEELS | PLACE).items()}
    assert np.array_equal(np.column_stack([columns[name] for name in WHEELS]), angles)
    assert np.array_equal(np.column_stack([columns["x_c"], columns["y_c"]]), poses[:, :2])
    off = (columns["phi"] - poses[:, 2] + math.pi) % (2 * math.pi) - math.pi
    assert (
        np.abs(off).max() < 1e-12 < math.pi < np.abs(poses[:, 2]).max()
        and np.abs(columns["phi"]).max() <= math.pi
    )
    assert table.clocks["/joint_states"].numbers("s") == pytest.approx(t, abs=1e-9)
    assert table.clocks["/odom"].numbers("s") == pytest.approx(times, abs=1e-9) and not table.remarks


@pytest.mark.parametrize("kind", ["one.bag", "two_mcap"])
def test_numbers_of_the_vehicle(kind, folder, capsys):
    """Angles are linear within a row, and poses are compared when they were measured:
    nothing is lost in joining."""
    values, remarks = fitted(folder / kind, capsys)
    assert values == TRUE and remarks == [
        f"{name} of /joint_states is interpolated linearly at the times of other topics" for name in WHEELS
    ]


def test_joints_by_their_place_would_be_found(folder, monkeypatch):
    """A planted defect: a joint is taken where the first message has it."""
    right, places = bags._value, {}

    def by_place(message, field, where):
        joint, _, kind = field.rpartition(".")
        if kind in bags.OF_JOINTS:
            return float(getattr(message, kind)[places.setdefault(joint, message.name.index(joint))])
        return right(message, field, where)

    monkeypatch.setattr(bags, "_value", by_place)
    with pytest.raises(AssertionError):
        test_every_kind_has_every_number("one.bag", folder)
    assert main(calibrate(folder / "one.bag")) == 2


def by_two_drivers(made, topic, t, message):
    """Each wheel by a driver of its own, the left one 13 ms later, when it has turned on;
    messages of the right one come late."""
    if topic != "/joint_states":
        return [(topic, t, message)]
    angles = dict(zip(message.name, message.position, strict=True))
    time = t - 0.002
    late = min(time + 0.013, driven()[0][-1])
    left = np.interp(late, driven()[0], driven()[1][:, 1])
    ahead = made.joints(time, {"right_wheel": angles["right_wheel"]})
    return [(topic, t + 0.03, ahead), (topic, t + 0.011, made.joints(late, {"left_wheel": left}))]


def test_wheels_with_a_driver_each(tmp_path, capsys):
    """Messages of a topic that each lack a joint, and not in the order of their stamps."""
    values, remarks = fitted(first(tmp_path / "log.bag", changed(by_two_drivers)), capsys)
    # Its corners are cut
    assert values == {name: pytest.approx(geometry.TRUE[name], rel=5e-4) for name in TRUE}
    assert "/joint_states:right_wheel.position is in 241 of 482 messages" in remarks


def test_a_message_without_a_joint(tmp_path, capsys):
    def change(made, topic, t, message):
        if topic == "/joint_states" and round(t / geometry.PERIOD) % 7 == 3:
            angles = dict(zip(message.name, message.position, strict=True))
            del angles["right_wheel"]
            message = made.joints(t - 0.002, angles)
        return [(topic, t, message)]

    values, remarks = fitted(second(tmp_path / "log", changed(change)), capsys)
    assert (
        f"/joint_states:right_wheel.position is in {241 - len(range(3, 241, 7))} of 241 messages" in remarks
    )
    # Its speed changes over two rows
    assert values == {name: pytest.approx(geometry.TRUE[name], rel=1e-3) for name in TRUE}


def at(offset, unstamped=()):
    """Messages that are recorded `offset` s later than they are stamped; some topics without stamps."""

    def change(made, topic, t, message):
        if topic in unstamped:
            message.header.stamp.sec = message.header.stamp.nanosec = 0
        return [(topic, t + offset[topic], message)]

    return changed(change)


def test_clocks_that_differ_are_told(tmp_path, capsys):
    """The times are those of the headers; that a topic comes later than the other is said from 0.05 s on."""
    values, remarks = fitted(first(tmp_path / "log.bag", at({"/odom": 0.3, "/joint_states": 0.0})), capsys)
    assert values == TRUE
    (said,) = (each for each in remarks if "later" in each)
    assert "by 0.002 s for /joint_states, 0.305 s for /odom; that differs by more than 0.05 s" in said
    table = table_of_log(
        first(tmp_path / "b.bag", at({"/odom": 0.13, "/joint_states": 0.09})), (), WHEELS | PLACE
    )
    assert not table.remarks


def test_times_of_the_bag_where_headers_have_none(tmp_path):
    file = second(
        tmp_path / "log", at({"/odom": -0.005, "/joint_states": -0.002}, ["/odom", "/joint_states"])
    )
    table = table_of_log(file, (), WHEELS | PLACE)
    assert table.clocks["/odom"].numbers("s") == pytest.approx(driven()[2], abs=1e-9)
    assert "messages of /odom have no stamps in a header: their times are those of the bag" in table.remarks
    one = table_of_log(
        first(tmp_path / "log.bag", at({"/odom": 0.0, "/joint_states": 0.1}, ["/odom"])), (), WHEELS | PLACE
    )
    assert "0.102 s for /joint_states, 0 s for /odom" in one.remarks[-1]


def recorded(made):
    """The run of test_identification with rates and torques of the joints,
    the rate of a gyro and speeds that were commanded."""
    names, rows = dynamics.columns(), dynamics.table()
    for row in rows:
        of, rates = dict(zip(names, map(float, row), strict=True)), [1.5, -2.5, 3.5]
        wheels = [[of[f"{kind}_{side}"] for side in "rl"] for kind in ("theta", "thetadot", "tau")]
        joints = [[each[1], rate, each[0]] for each, rate in zip(wheels, rates, strict=True)]
        named = dict(zip(("left", "pan", "right"), joints[0], strict=True))
        yield "/joint_states", of["t"] + 0.001, made.joints(of["t"], named, *joints[1:])
        yield "/cmd_vel", of["t"] + 0.004, made.twist(of["x_c"], of["phi"])
        covariance = {
            f"{each}_covariance": np.zeros(9)
            for each in ("orientation", "angular_velocity", "linear_acceleration")
        }
        imu = made.new(
            "sensor_msgs/Imu",
            header=made.header(of["t"]),
            orientation=made.new("geometry_msgs/Quaternion", 0.0, 0.0, 0.0, 0.0),
            angular_velocity=made.vector(0, 0, 0.5 * of["thetadot_r"]),
            linear_acceleration=made.vector(0, 0, 9.81),
            **covariance,
        )
        yield "/imu", of["t"] + 0.002, imu


DYNAMIC = {
    f"{name}_{side}": f"/joint_states:{joint}.{kind}"
    for side, joint in (("r", "right"), ("l", "left"))
    for name, kind in (("thetadot", "velocity"), ("tau", "effort"))
}


def test_masses_from_rates_and_torques_of_joints(tmp_path):
    """Every number as in the run; units and signs as of other logs; a gyro by its topic."""
    file = first(tmp_path / "log.bag", recorded)
    log = read_log(table_of_log(file, (), DYNAMIC), dynamics.DYNAMICS, DYNAMIC)
    run = dynamics.run()
    assert log.t == pytest.approx(run.t, abs=1e-8) and np.array_equal(log.inputs, run.tau)
    assert np.array_equal(log.x[:, -2:], run.nu) and not log.remarks
    other = {"a": "-/imu:angular_velocity.z [deg/s]", "b": "cmd_vel:linear.x"}
    with pytest.raises(BadInput, match="no topic 'cmd_vel'; did you mean '/cmd_vel'"):
        table_of_log(file, (), other)
    other["b"] = "/cmd_vel:linear.x"
    rows, remarks = read_rows(table_of_log(file, (), other), dict.fromkeys(other), other)
    assert rows["a"] == pytest.approx(-math.pi / 360 * run.nu[1:, 0], abs=1e-12)  # /cmd_vel begins 4 ms later
    between = np.interp(run.t[1:], run.t + 0.004, run.q[:, 0])
    assert rows["b"] == pytest.approx(between, abs=1e-6) and any("no stamps" in each for each in remarks)


@pytest.mark.nightly
def test_masses_at_the_command_line(tmp_path, capsys):
    file = second(tmp_path / "log", recorded, "SQLITE3")
    assert (
        main(["identify", file, "--robot", "labmate", "--fit", "m_c", "I_c", "--json", *options(DYNAMIC)])
        == 0
    )
    values = json.loads(capsys.readouterr().out)["parameters"]
    assert {name: values[name]["value"] for name in dynamics.PLANT} == pytest.approx(dynamics.PLANT, rel=1e-4)


@pytest.mark.parametrize("mapped", [WHEELS | PLACE, PLACE | WHEELS], ids=["wheels first", "poses first"])
def test_a_table_has_the_rows_of_the_first_topic(mapped, folder, tmp_path, capsys):
    """The others are interpolated linearly, the heading over pi too,
    and nothing is beyond the messages of a topic."""
    output = tmp_path / "run.csv"
    assert main(["log", str(folder / "two_mcap"), "-o", str(output), *options(mapped)]) == 0
    said = capsys.readouterr().out
    with output.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ["t", *mapped]
    t, angles, times, poses = driven()
    is_first = list(mapped) == [*WHEELS, *PLACE]
    expected = t[(t >= times[0]) & (t <= times[-1])] if is_first else times
    made = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    made["phi"] += 2 * math.pi  # the first yaw is below pi
    assert made["t"] == pytest.approx(expected, abs=1e-9)
    for name, own, values in (
        *zip(WHEELS, (t, t), angles.T, strict=True),
        *zip(PLACE, (times,) * 3, poses.T, strict=True),
    ):
        assert made[name] == pytest.approx(np.interp(expected, own, values), abs=1e-8), name
    others = "x_c, y_c, phi of /odom" if is_first else "theta_r, theta_l of /joint_states"
    assert f"interpolated linearly in time: {others}" in said
    assert ("4 of 241 rows are left out" in said) == is_first


def test_a_run_is_drawn(tmp_path, capsys, monkeypatch, bad_input):
    """With the SPEC that it belongs to: what is drawn is what was driven."""
    run, drawn = dynamics.run(), []

    def messages(made):
        for t, (x, y, heading, right, left), (fast, slow) in zip(run.t, run.q, run.nu, strict=True):
            yield "/joint_states", t, made.joints(t, {"left": left, "right": right}, [slow, fast])
            yield "/odom", t, made.odometry(t, x, y, Rotation.from_euler("Z", heading))

    file = first(tmp_path / "log.bag", messages)
    monkeypatch.setattr("noslip.simulation.plot.draw", lambda run: drawn.append(run) or Figure())
    rates = {
        f"thetadot_{s}": f"/joint_states:{joint}.velocity" for s, joint in (("r", "right"), ("l", "left"))
    }
    view = ["view", file, "--spec", "circle", "-o", str(tmp_path / "run.png")]
    assert main([*view, *options(PLACE | rates)]) == 0
    said = capsys.readouterr().out
    assert "labmate: 601 rows, 6 s" in said and "thetadot_r, thetadot_l of /joint_states" in said
    assert drawn[0].t == pytest.approx(run.t) and drawn[0].q[:, :3] == pytest.approx(run.q[:, :3], abs=1e-12)
    assert np.array_equal(drawn[0].nu, run.nu)
    assert "no column thetadot_r; type_iv_circle of the SPEC needs it" in bad_input([*view, *options(PLACE)])


# -- other forms of bags -------------------------------------------------------------------------------------


def brief(made):
    """Two seconds of it, and topics of other types."""
    yield from (each for each in drive(made) if each[1] < 2.0)
    layout = made.new("std_msgs/MultiArrayLayout", [], 0)
    for k in range(20):
        yield (
            "/ticks",
            0.1 * k,
            made.new("std_msgs/Int32MultiArray", layout=layout, data=np.array([k, 7], np.int32)),
        )


MODES = (("SQLITE3", "FILE"), ("SQLITE3", "MESSAGE"), ("MCAP", "STORAGE"))


@pytest.mark.parametrize(
    "made",
    [
        *(lambda path, c=c: first(path.with_suffix(".bag"), brief, c) for c in ("BZ2", "LZ4")),
        *(lambda path, p=p, m=m: second(path, brief, p, m) for p, m in MODES),
        lambda path: without_definitions(path.with_suffix(".db3"), brief),
    ],
    ids=["bz2", "lz4", "file", "message", "storage", "without definitions"],
)
def test_compressed_and_older_bags(made, tmp_path):
    mapped = WHEELS | PLACE | {"a": "/ticks:data[0]", "b": "/ticks:data.1"}
    table = table_of_log(made(tmp_path / "log"), (), mapped)
    assert table[WHEELS["theta_r"]].numbers() == pytest.approx(driven()[1][:40, 0])
    assert table[PLACE["x_c"]].numbers() == pytest.approx(driven()[3][:14, 0])
    assert table["/ticks:data[0]"].numbers().tolist() == [*range(20)] and set(
        table["/ticks:data.1"].entries
    ) == {7.0}


def test_types_of_ones_own(tmp_path, bad_input):
    """Are read by their definition in the bag; without it they cannot be, but other topics can."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("float64 right\nfloat64 left", "mine/msg/Wheels"))

    def messages(made):
        yield from (each for each in drive(made) if each[0] == "/odom")
        wheels = (made.new("mine/Wheels", right=right, left=left) for right, left in driven()[1])
        yield from (("/wheels", t, each) for t, each in zip(driven()[0], wheels, strict=True))

    mapped = {"theta_r": "/wheels:right", "theta_l": "/wheels:left", **PLACE}
    table = table_of_log(second(tmp_path / "log", messages, store=store), (), mapped)
    assert np.array_equal(table["/wheels:left"].numbers(), driven()[1][:, 1])
    file = without_definitions(tmp_path / "log.db3", messages, store)
    said = bad_input(calibrate(file, mapped))
    assert (
        "/wheels (mine/Wheels, 241 messages) cannot be decoded: the bag has no definition of its type; "
        "record it" in said
    )
    assert len(table_of_log(file, (), PLACE)[PLACE["phi"]].entries) == 80


# -- what cannot be read -------------------------------------------------------------------------------------

TOPICS = (
    "its topics are /joint_states (sensor_msgs/JointState, 241 messages), /odom (nav_msgs/Odometry, 80 "
    "messages)"
)
FIELDS = (
    "its fields are header.stamp, pose.pose.position.x, pose.pose.position.y, pose.pose.position.z, "
    "pose.pose.orientation, "
)
JOINTS = "its joints are left_wheel, right_wheel, turret.pan, each with .position, .velocity, .effort"
ERRORS = {
    "no topic": (
        "/joints:right_wheel.position",
        f"no topic '/joints'; did you mean '/joint_states'?; {TOPICS}",
    ),
    "no field": ("/odom:pose.position.x", f"/odom:pose.position.x: no such field; {FIELDS}"),
    "a text": ("/odom:child_frame_id", f"not a number; {FIELDS}"),
    "part of a message": ("/odom:pose.pose", f"not a number; {FIELDS}"),
    "topic only": ("/odom", f"no field of /odom is named; write /odom:FIELD, {FIELDS}"),
    "no joint": (
        "/joint_states:wheel.position",
        f"/joint_states:wheel.position is in none of 241 messages; {JOINTS}",
    ),
    "empty velocity": ("/joint_states:right_wheel.velocity", f"is in none of 241 messages; {JOINTS}"),
    "joint by place": ("/joint_states:position[0]", f"no such field; {JOINTS}"),
    "beyond an array": ("/odom:pose.covariance[36]", f"is in none of 80 messages; {FIELDS}"),
    "unit": ("/odom:pose.pose.orientation", "[rad] is not a unit of a quantity in m"),
    "unit of a yaw": ("/odom:pose.pose.orientation [m]", "the yaw of a quaternion is in rad; leave out [m]"),
}


@pytest.mark.parametrize("case", ERRORS)
def test_what_a_bag_does_not_have(case, folder, bad_input):
    field, message = ERRORS[case]
    said = bad_input(calibrate(folder / "two_db3", WHEELS | PLACE | {"x_c": field}))
    assert message in said and "two_db3" in said


def test_nothing_is_mapped(folder, bad_input):
    said = bad_input(calibrate(folder / "two_db3", {}))
    assert f"is a bag of ROS: say which field each quantity is, {bags.FORM}; {TOPICS}" in said


def test_what_is_no_bag(folder, tmp_path, bad_input, monkeypatch):
    assert "without metadata.yaml" in bad_input(calibrate(tmp_path))
    assert "No such file or directory" in bad_input(calibrate(tmp_path / "none.bag"))
    for name in ("a.bag", "a.db3"):
        for content in (b"", b"t,theta_r\n"):
            (tmp_path / name).write_bytes(content)
            assert f"{name} cannot be read as a bag: " in bad_input(calibrate(tmp_path / name))
    sqlite3.connect(tmp_path / "b.db3").execute("CREATE TABLE any(id)").connection.close()
    assert "missing tables" in bad_input(calibrate(tmp_path / "b.db3"))
    (tmp_path / "b.db3-wal").write_bytes(b"more")
    assert "was not closed, it has messages in" in bad_input(calibrate(tmp_path / "b.db3"))
    assert "--columns: the fields of" in bad_input([*calibrate(folder / "one.bag"), "--columns", "t,x"])
    log = ["log", str(folder / "one.bag"), "-o", str(tmp_path / "a.csv"), "--robot", "labmate"]
    assert "--map: quantity 'theta'" in bad_input([*log, *options({"theta": WHEELS["theta_r"]})])
    assert "--start is for dumps" in bad_input([*log, "--start", "1"])
    for number, name in (("1", "one.bag"), ("2", "two_mcap")):
        monkeypatch.setitem(sys.modules, f"rosbags.rosbag{number}", None)
        assert "bags of ROS need the library rosbags; `" in bad_input(calibrate(folder / name))


def test_a_topic_without_messages(tmp_path, bad_input):
    made = Store(True)
    with Writer1(tmp_path / "a.bag") as bag:
        bag.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=made.store)
        joints = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=made.store)
        message = made.joints(0.0, {"left_wheel": 0.0})
        bag.write(joints, START, made.store.serialize_ros1(message, message.__msgtype__))
    said = bad_input(calibrate(tmp_path / "a.bag", PLACE))
    assert (
        "topic /odom has no messages; its topics are /joint_states (sensor_msgs/JointState, 1 messages), "
        "/odom (" in said
    )


def test_clocks_without_a_time_in_common(tmp_path, bad_input):
    """Headers in the time of a simulation, and the clock of the bag."""
    file = first(tmp_path / "log.bag", at({"/odom": 1e6, "/joint_states": 0.0}, ["/odom"]))
    assert "their clocks differ, or they are of different runs" in bad_input(calibrate(file))

    def back(made, topic, t, message):
        stamp = message.header.stamp
        stamp.sec -= 5 * (t > 7)
        return [(topic, t, message)]

    assert "the clock was set back; cut the log there" in bad_input(
        calibrate(first(tmp_path / "b.bag", changed(back)))
    )


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.nightly) for k in range(1, 8))])
@pytest.mark.parametrize("kind", [KINDS[0], *KINDS[3:]])
def test_damaged_bags(kind, seed, folder, tmp_path):
    """Cut, or with wrong bytes: refused in words, or, where they are not in what is read, the same;
    never with fewer messages."""
    draw, whole = random.Random(seed), (folder / kind).read_bytes()
    file = tmp_path / f"log.{kind.rpartition('.')[2]}"
    lengths = {name: len(column.entries) for name, column in table_of_log(folder / kind, (), PLACE).items()}
    refused = 0
    for k in range(12):
        data = bytearray(whole[: draw.randrange(len(whole) // 2)] if k % 2 else whole)
        for _ in range(draw.choice((1, 20)) * (1 - k % 2)):
            data[draw.randrange(len(data))] = draw.randrange(256)
        file.write_bytes(data)
        try:
            table = table_of_log(file, (), PLACE)
        except BadInput as error:
            refused += 1
            assert len(str(error)) < 1500
            continue
        assert k % 2 == 0 and {name: len(column.entries) for name, column in table.items()} == lengths
    assert refused >= 6
