"""Bags of ROS 1 and ROS 2 as tables: fields of messages, joints by their name, quaternions by their yaw."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from .errors import BadInput, library, suggestion
from .tables import NANOSECONDS, Column, Table, column_name, listed, read_table

OFFSET = 0.05  # s: what differs more between topics, of the times of headers and of the bag, is said
MARKS = (b"#ROSBAG", b"SQLite format 3")
PROFILE = b"\x04\0\0\0ros2"  # behind the first 17 bytes of an MCAP of ROS 2
JOINT_STATE, QUATERNION, TIME = "sensor_msgs/msg/JointState", "geometry_msgs/msg/Quaternion", "builtin_interfaces/msg/Time"
OF_JOINTS = ("position", "velocity", "effort")
FORM = "--map theta_r=/joint_states:JOINT.position, or --map phi=/odom:pose.pose.orientation for the yaw"
DAMAGED = "is no bag that can be read, it is damaged or was not closed; `rosbag reindex` or `ros2 bag reindex` may mend it"

Messages = dict[str, list[tuple[int, Any]]]  # by topic: the time of the bag, ns since 1970, and the message


def is_bag(file: str | Path) -> bool:
    """Return whether a file or folder is a bag by its name or its first bytes. Raises OSError."""
    if Path(file).is_dir():
        return True
    with open(file, "rb") as stream:
        head = stream.read(25)
    is_of_ros2 = head.startswith(b"\x89MCAP") and head[17:] == PROFILE
    return is_of_ros2 or head.startswith(MARKS) or Path(file).suffix.lower() in (".bag", ".db3")


def table_of_log(file: str | Path, columns: Sequence[str], mapped: Mapping[str, str]) -> Table:
    """Return the columns of a log: of a bag those fields that are `mapped`, quantity -> "TOPIC:FIELD", else as `read_table`.

    The times of a topic are those of its headers, if its messages have them, else those of the bag; from the first message on,
    in s. Messages that lack a field, of joints that are published separately, are not among its rows, so it has times of its
    own then. Raises BadInput for a file that is damaged or no bag, for a topic, field or joint that it does not have, and if
    the library is missing; and OSError.
    """
    if not is_bag(file):
        return read_table(file, columns)
    if columns:
        raise BadInput(f"--columns: the fields of {file} have names; say {FORM}")
    names = {column_name(text): column_name(text).partition(":")[::2] for text in mapped.values()}
    topics, bag = _read(Path(file), {topic for topic, _ in names.values()})
    known = f"{file} has the topics {listed(topics.values())}" if topics else f"{file} has no topics"
    if not mapped:
        raise BadInput(f"{known}; say which field each quantity is, {FORM}")
    for topic, field in names.values():
        if topic not in topics:
            raise BadInput(f"{file}: no topic {topic!r}{suggestion(topic, topics).partition('; known')[0]}; {known}")
        if topic not in bag:
            raise BadInput(f"{file}: topic {topic} has no messages; {known}")
        if not field:
            raise BadInput(f"{file}: no field of {topic} is named; write {topic}:FIELD, {_known_fields(bag[topic])}")
    stamps, remarks = _stamps({topic: bag[topic] for topic, _ in names.values()})
    start = min(int(each[0]) for each in stamps.values())
    table = Table(file, remarks=remarks)
    own: dict[tuple[str, bytes], str] = {}  # names of the clocks: one for fields that are in the same messages
    for name, (topic, field) in names.items():
        where = f"{file} {name}"
        values = np.array([_value(message, field, start, where, bag[topic]) for _, message in bag[topic]])
        there = np.flatnonzero(np.isfinite(values))
        if not there.size:
            raise BadInput(f"{where} is in none of {len(values)} messages; {_known_fields(bag[topic])}")
        if there.size < len(values):
            table.remarks.append(f"{name} is in {there.size} of {len(values)} messages")
        clock = own.setdefault((topic, there.tobytes()), f"{topic} ({field})" if topic in own.values() else topic)
        times = (stamps[topic] - start) / NANOSECONDS
        if _is_nearly_sorted(times[there]):
            there = there[np.argsort(times[there], kind="stable")]
        rows = (there + 1).tolist()
        is_yaw = _is(_field(bag[topic][0][1], field), QUATERNION)
        table[name] = Column(values[there].tolist(), "rad" if is_yaw else None, where, rows, clock)
        table.clocks[clock] = Column(times[there].tolist(), "s", f"{file} {clock} time", rows, clock)
    if len(table.clocks) == 1 and "t" not in mapped:
        (table["t"],) = table.clocks.values()
    return table


def _is_nearly_sorted(times: np.ndarray) -> bool:
    """Return whether times go back by little only, as those of several publishers do, not those of a clock that was set back."""
    return bool((np.maximum.accumulate(times) - times).max() <= OFFSET)


def _stamps(bag: Messages) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the times of the messages of each topic, ns since 1970, and remarks on how they differ from those of the bag."""
    stamps, late, remarks = {}, {}, []
    for topic, messages in bag.items():
        times = np.array([time for time, _ in messages])
        headers = [_field(message, "header.stamp") for _, message in messages]
        stamps[topic] = np.array([_nanoseconds(each) for each in headers]) if _is(headers[0], TIME) else np.zeros_like(times)
        if not stamps[topic].any():
            stamps[topic] = times
            remarks.append(f"messages of {topic} have no stamps in a header: their times are those of the bag")
        late[topic] = float(np.median(times - stamps[topic])) / NANOSECONDS
    if max(late.values()) - min(late.values()) > OFFSET:
        offsets = ", ".join(f"{offset:.3g} s for {topic}" for topic, offset in late.items())
        remarks.append(
            f"the times of the bag are later than those of the headers, by {offsets}; that differs by more than {OFFSET:g} s: "
            "messages were recorded late, or their clocks differ, and their topics do not fit together in time"
        )
    return stamps, remarks


# -- fields ----------------------------------------------------------------------------------------------------------------


def _is(value: Any, kind: str) -> bool:
    return getattr(value, "__msgtype__", None) == kind


def _nanoseconds(stamp: Any) -> int:
    return stamp.sec * 10**9 + stamp.nanosec


def _field(message: Any, field: str) -> Any:
    """Return the value of a nested field, "pose.pose.position.x", or of an entry of an array, "data[0]" or "data.0"; None if
    the message does not have it. Entries of lists of messages have no fixed place, and so no name.
    """
    for part in re.split(r"[.[]", field.replace("]", "")):
        if isinstance(message, np.ndarray) and part.isdecimal():
            message = message[int(part)] if int(part) < len(message) else math.nan
        else:
            message = getattr(message, part, None) if part in getattr(message, "__dataclass_fields__", ()) else None
    return message


def _value(message: Any, field: str, start: int, where: str, messages: list[tuple[int, Any]]) -> float:
    """Return a field of a message as a number, NaN where it is not in this message: of a joint, looked up by its name; of a
    quaternion its yaw, rad; of a time s from `start`, ns. Raises BadInput if these messages have no such field.
    """
    joint, _, kind = field.rpartition(".")
    if _is(message, JOINT_STATE) and joint and kind in OF_JOINTS:
        values = getattr(message, kind)
        return float(values[k]) if joint in message.name and (k := message.name.index(joint)) < len(values) else math.nan
    value = None if _is(message, JOINT_STATE) and field.startswith(OF_JOINTS) else _field(message, field)
    if _is(value, QUATERNION):
        x, y, z, w = value.x, value.y, value.z, value.w
        return math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z) if x or y or z or w else math.nan
    if _is(value, TIME):
        return (_nanoseconds(value) - start) / NANOSECONDS
    if not isinstance(value, int | float | np.number | np.bool_):
        raise BadInput(f"{where}: no field with a number; {_known_fields(messages)}")
    return float(value)


def _known_fields(messages: list[tuple[int, Any]]) -> str:
    """Return what the fields and joints of a topic's messages are."""
    first = messages[0][1]
    if _is(first, JOINT_STATE):
        joints = listed(dict.fromkeys(name for _, message in messages for name in message.name))
        return f"its joints are {joints or 'none'}, each with .{', .'.join(OF_JOINTS)}"
    return f"its fields are {listed(_numeric(first))}"


def _numeric(message: Any, path: str = "") -> Iterator[str]:
    """Yield the names of all fields of a message that have a number, arrays last."""
    arrays = []
    for name in message.__dataclass_fields__:
        value, name = getattr(message, name), f"{path}.{name}".lstrip(".")
        if isinstance(value, np.ndarray):
            arrays.append(f"{name}[0]")
        elif isinstance(value, int | float) or _is(value, QUATERNION) or _is(value, TIME):
            yield name
        elif hasattr(value, "__dataclass_fields__"):
            yield from _numeric(value, name)
    yield from arrays


# -- files -----------------------------------------------------------------------------------------------------------------


@contextmanager
def _saying(what: str) -> Iterator[None]:
    """Raise BadInput with `what` before any error of the library, whose parsers raise many kinds for damaged bytes."""
    try:
        yield
    except (BadInput, PermissionError):
        raise
    except Exception as error:
        raise BadInput(f"{what} ({str(error)[:200] or type(error).__name__})") from error


def _read(file: Path, wanted: set[str]) -> tuple[dict[str, str], Messages]:
    """Return the topics of a bag with their type and number of messages, as text, and all messages of those that are `wanted`."""
    if file.is_dir() and not (file / "metadata.yaml").exists():
        raise BadInput(f"{file} is a folder without metadata.yaml, so no bag; give the .db3 or .mcap in it, or `ros2 bag reindex` it")
    is_first = file.is_file() and (file.suffix.lower() == ".bag" or file.open("rb").read(7) == MARKS[0])
    rosbags = library(f"rosbags.rosbag{1 if is_first else 2}", "bags of ROS need the library rosbags", "logs")
    messages: Messages = {}
    with _saying(f"{file} {DAMAGED}"), rosbags.Reader(file) as reader:
        topics = {name: f"{name} ({each.msgtype}, {each.msgcount} messages)" for name, each in reader.topics.items()}
        connections = [each for each in reader.connections if each.topic in wanted]
        decoders = {each.id: _decoder(each, is_first, f"{file}: {topics[each.topic]}") for each in connections}
        for connection, time, data in reader.messages(connections) if connections else ():
            with _saying(f"{file}: a message of {topics[connection.topic]} cannot be decoded"):
                messages.setdefault(connection.topic, []).append((time, decoders[connection.id](data, connection.msgtype)))
    return topics, messages


def _decoder(connection: Any, is_first: bool, where: str) -> Callable[[bytes, str], Any]:
    """Return what decodes the messages of a connection, by the definition in the bag, or by that of ROS itself: older bags of
    ROS 2 have none. Raises BadInput for types that cannot be decoded.
    """
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    form, text = connection.msgdef
    with _saying(f"{where} cannot be decoded by the definition of its type in the bag"):
        if form.name == "NONE":
            store = get_typestore(Stores.ROS1_NOETIC if is_first else Stores.ROS2_HUMBLE)
        else:
            store = get_typestore(Stores.EMPTY)
            parts = [part.partition("\n")[2] for part in text.split("=" * 80 + "\nIDL: ")[1:]] or [text]
            for part in parts if form.name == "IDL" else [text]:
                store.register(get_types_from_idl(part) if form.name == "IDL" else get_types_from_msg(part, connection.msgtype))
    if connection.msgtype not in store.fielddefs:
        raise BadInput(f"{where} cannot be decoded: the bag has no definition of its type; record it as MCAP, which stores them")
    return store.deserialize_ros1 if is_first else store.deserialize_cdr
