"""Bags of ROS 1 and ROS 2 as tables: fields of messages, joints by their name, quaternions by their yaw."""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .errors import BadInput, library, suggestion
from .tables import NANOSECONDS, Column, Table, column_name, read_table, yaw_of

OFFSET = 0.05  # s: what differs more between topics, of the times of headers and of the bag, is said
MARKS = (b"#ROSBAG", b"SQLite format 3")
PROFILE = b"\x04\0\0\0ros2"  # behind the first 17 bytes of an MCAP of ROS 2
JOINT_STATE, QUATERNION, TIME = (
    "sensor_msgs/msg/JointState",
    "geometry_msgs/msg/Quaternion",
    "builtin_interfaces/msg/Time",
)
OF_JOINTS = ("position", "velocity", "effort")
FORM = "--map theta_r=/joint_states:JOINT.position, or --map phi=/odom:pose.pose.orientation for the yaw"
MENDING = "; one that was not closed is mended by `rosbag reindex`, `ros2 bag reindex` or `mcap recover`"


@dataclass
class Topic:
    """What was read of a topic: its first message, the names of all joints; and of each message the time of
    the bag and the stamp of its header (0: none), ns since 1970, and the values of fields.
    """

    first: Any
    joints: dict[str, None] = field(default_factory=dict)
    times: list[int] = field(default_factory=list)
    stamps: list[int] = field(default_factory=list)
    values: list[list[float]] = field(default_factory=list)


def is_bag(file: str | Path) -> bool:
    """Return whether a file or folder is a bag by its name or its first bytes. Raises OSError."""
    head = _head(file)
    is_of_ros2 = head.startswith(b"\x89MCAP") and head[17:] == PROFILE
    return (
        Path(file).is_dir()
        or is_of_ros2
        or head.startswith(MARKS)
        or Path(file).suffix.lower() in (".bag", ".db3")
    )


def _head(file: str | Path) -> bytes:
    """Return the first bytes of a file, none of a folder."""
    if Path(file).is_dir():
        return b""
    with open(file, "rb") as stream:
        return stream.read(25)


def table_of_log(file: str | Path, columns: Sequence[str], mapped: Mapping[str, str]) -> Table:
    """Return the columns of a log: of a bag those fields that are `mapped`, quantity -> "TOPIC:FIELD", else
    as `read_table`.

    The times of a topic are those of its headers, if its messages have them, else those of the bag; from the
    first message on, in s. Messages that lack a field, of joints that are published separately, are not among
    its rows, so it has times of its own then. Raises BadInput for a file that is damaged or no bag, for a
    topic, field or joint that it does not have, and if the library is missing; and OSError.
    """
    if not is_bag(file):
        return read_table(file, columns)
    if columns:
        raise BadInput(f"--columns: the fields of {file} have names; say {FORM}")
    fields: dict[str, dict[str, str]] = {}
    for name in map(column_name, mapped.values()):
        topic, _, field = name.partition(":")
        fields.setdefault(topic, {})[name] = field
    topics = _read(Path(file), fields)
    table = Table(file, remarks=_remarks(topics))
    start = min(topic.stamps[0] for topic in topics.values())
    for topic, read in topics.items():
        clocks: dict[bytes, str] = {}  # one for all fields that are in the same messages
        for (name, field), values in zip(fields[topic].items(), np.array(read.values).T, strict=True):
            there, where = np.flatnonzero(np.isfinite(values)), f"{file} {name}"
            if not there.size:
                raise BadInput(
                    f"{where} is in none of {len(values)} messages; {_known_fields(read.first, read.joints)}"
                )
            if there.size < len(values):
                table.remarks.append(f"{name} is in {there.size} of {len(values)} messages")
            clock = clocks.setdefault(there.tobytes(), f"{topic} ({field})" if clocks else topic)
            times = np.array([stamp - start for stamp in read.stamps]) / NANOSECONDS
            if _is_nearly_sorted(times[there]):
                there = there[np.argsort(times[there], kind="stable")]
            rows, first = (there + 1).tolist(), _field(read.first, field)
            values = values - start / NANOSECONDS if _is(first, TIME) else values
            is_yaw = _is(first, QUATERNION)
            unit = "rad" if is_yaw else None
            table[name] = Column(values[there].tolist(), unit, where, rows, clock, is_yaw=is_yaw)
            table.clocks[clock] = Column(times[there].tolist(), "s", f"{file} {clock} time", rows, clock)
    if len(table.clocks) == 1 and "t" not in mapped:
        (table["t"],) = table.clocks.values()
    return table


def _is_nearly_sorted(times: np.ndarray) -> bool:
    """Return whether times go back by little only, as those of several publishers do,
    not those of a clock that was set back."""
    return bool((np.maximum.accumulate(times) - times).max() <= OFFSET)


def _remarks(topics: Mapping[str, "Topic"]) -> list[str]:
    """Return remarks on how the times of headers differ from those of the bag,
    which replace them where none is set."""
    remarks, late = [], {}
    for name, topic in topics.items():
        if not any(topic.stamps):
            topic.stamps = topic.times
            remarks.append(f"messages of {name} have no stamps in a header: their times are those of the bag")
        late[name] = (
            float(np.median([time - stamp for time, stamp in zip(topic.times, topic.stamps, strict=True)]))
            / NANOSECONDS
        )
    if max(late.values()) - min(late.values()) > OFFSET:
        offsets = ", ".join(f"{offset:.3g} s for {name}" for name, offset in late.items())
        remarks.append(
            f"the times of the bag are later than those of the headers, by {offsets}; that differs by more "
            f"than {OFFSET:g} s: messages were recorded late, or their clocks differ, and their topics do "
            "not fit together in time"
        )
    return remarks


# -- fields --------------------------------------------------------------------------------------------------


def _is(value: Any, kind: str) -> bool:
    return getattr(value, "__msgtype__", None) == kind


def _joints(message: Any) -> Sequence[str]:
    return message.name if _is(message, JOINT_STATE) else ()


def _nanoseconds(stamp: Any) -> int:
    return stamp.sec * 10**9 + stamp.nanosec


def _field(message: Any, field: str) -> Any:
    """Return the value of a nested field, "pose.pose.position.x", or of an entry of an array, "data[0]" or
    "data.0"; None if the message does not have it. Entries of lists of messages have no fixed place, and so
    no name.
    """
    for part in re.split(r"[.[]", field.replace("]", "")):
        if isinstance(message, np.ndarray) and part.isdecimal():
            message = message[int(part)] if int(part) < len(message) else math.nan
        else:
            message = (
                getattr(message, part, None) if part in getattr(message, "__dataclass_fields__", ()) else None
            )
    return message


def _value(message: Any, name: str, where: str) -> float:
    """Return a field of a message as a number, NaN where it is not in this message: of a joint, looked up by
    its name; of a quaternion its yaw, rad; of a time s since 1970. Raises BadInput if messages of this type
    have no such field.
    """
    joint, _, kind = name.rpartition(".")
    if _is(message, JOINT_STATE) and joint and kind in OF_JOINTS:
        values = getattr(message, kind)
        return (
            float(values[k])
            if joint in message.name and (k := message.name.index(joint)) < len(values)
            else math.nan
        )
    value: Any = None if _is(message, JOINT_STATE) and name.startswith(OF_JOINTS) else _field(message, name)
    if _is(value, QUATERNION):
        return yaw_of(value.x, value.y, value.z, value.w)
    if _is(value, TIME):
        return _nanoseconds(value) / NANOSECONDS
    if not isinstance(value, int | float | np.number | np.bool_):
        problem = "no such field" if value is None else "not a number"
        raise BadInput(f"{where}: {problem}; {_known_fields(message, _joints(message))}")
    return float(value)


def _known_fields(message: Any, joints: Iterable[str]) -> str:
    """Return what the fields of a message are, or the joints of a topic."""
    if _is(message, JOINT_STATE):
        return f"its joints are {', '.join(sorted(joints)) or 'none'}, each with .{', .'.join(OF_JOINTS)}"
    return f"its fields are {', '.join(_numeric(message)) or 'none'}"


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


# -- files ---------------------------------------------------------------------------------------------------


@contextmanager
def _saying(what: str, advice: str = "") -> Iterator[None]:
    """Raise BadInput with `what` before any error of the library,
    whose parsers raise many kinds for damaged bytes."""
    try:
        yield
    except (BadInput, PermissionError):
        raise
    except Exception as error:
        raise BadInput(f"{what}: {str(error)[:200] or type(error).__name__}{advice}") from error


def _read(file: Path, fields: Mapping[str, Mapping[str, str]]) -> dict[str, Topic]:
    """Return what a bag has of these topics and their `fields`, which are given with the name under which
    they were asked for. Raises BadInput.
    """
    if file.is_dir() and not (file / "metadata.yaml").exists():
        raise BadInput(
            f"{file} is a folder without metadata.yaml, so no bag; give the .db3 or .mcap in it, or reindex "
            "it"
        )
    for log in file.glob("*-wal") if file.is_dir() else [file.with_name(f"{file.name}-wal")]:
        if log.exists() and log.stat().st_size:
            raise BadInput(
                f"{file} was not closed, it has messages in {log}; `sqlite3 DB3 'PRAGMA wal_checkpoint'` "
                "moves them"
            )
    is_first = file.suffix.lower() == ".bag" or _head(file).startswith(MARKS[0])
    rosbags = library(f"rosbags.rosbag{1 if is_first else 2}", "bags of ROS need the library rosbags", "logs")
    topics: dict[str, Topic] = {}
    with _saying(f"{file} cannot be read as a bag", MENDING), rosbags.Reader(file) as reader:
        infos = reader.topics
        about = {
            name: f"{name} ({_shown(info.msgtype)}, {info.msgcount} messages)" for name, info in infos.items()
        }
        known = f"its topics are {', '.join(about.values()) or 'none'}"
        if not fields:
            raise BadInput(f"{file} is a bag of ROS: say which field each quantity is, {FORM}; {known}")
        for name in fields:
            if name not in infos:
                raise BadInput(
                    f"{file}: no topic {name!r}{suggestion(name, infos).partition('; known')[0]}; {known}"
                )
            if not infos[name].msgcount:
                raise BadInput(f"{file}: topic {name} has no messages; {known}")
        connections = [each for each in reader.connections if each.topic in fields]
        decoders = {each.id: _decoder(each, is_first, f"{file}: {about[each.topic]}") for each in connections}
        for connection, time, data in reader.messages(connections):
            name = connection.topic
            with _saying(f"{file}: a message of {about[name]} cannot be decoded"):
                message = decoders[connection.id](data, connection.msgtype)
            topic = topics.setdefault(name, Topic(message))
            if "" in fields[name].values():
                raise BadInput(
                    f"{file}: no field of {name} is named; write {name}:FIELD, "
                    f"{_known_fields(message, _joints(message))}"
                )
            stamp = _field(message, "header.stamp")
            topic.joints |= dict.fromkeys(_joints(message))
            topic.times.append(time)
            topic.stamps.append(_nanoseconds(stamp) if _is(stamp, TIME) else 0)
            topic.values.append(
                [_value(message, part, f"{file} {column}") for column, part in fields[name].items()]
            )
        for name in fields:
            if (count := len(topics[name].times) if name in topics else 0) != infos[name].msgcount:
                raise ValueError(f"only {count} messages are there of {about[name]}")
    return {name: topics[name] for name in fields}


def _shown(kind: str | None) -> str:
    return "several types" if kind is None else kind.replace("/msg/", "/")


def _decoder(connection: Any, is_first: bool, where: str) -> Callable[[bytes, str], Any]:
    """Return what decodes the messages of a connection, by the definition in the bag, or by that of ROS
    itself: older bags of ROS 2 have none. Raises BadInput for types that cannot be decoded.
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
                store.register(
                    get_types_from_idl(part)
                    if form.name == "IDL"
                    else get_types_from_msg(part, connection.msgtype)
                )
    if connection.msgtype not in store.fielddefs:
        raise BadInput(
            f"{where} cannot be decoded: the bag has no definition of its type; record it as MCAP, which "
            "stores them"
        )
    return store.deserialize_ros1 if is_first else store.deserialize_cdr
