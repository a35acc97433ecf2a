"""Messages as bytes, as bags hold them, what their headers say, and message types by name."""

import importlib
import struct
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message


def message_type(name: str) -> type:
    """The class of a message type such as ``sensor_msgs/msg/Image``."""
    package, kind, message = name.split("/")
    found: type = getattr(importlib.import_module(f"{package}.{kind}"), message)
    return found


def deserialise(cdr: bytes, msgtype: str) -> Any:
    """The message of a type, by its name, that was serialised."""
    return deserialize_message(cdr, message_type(msgtype))


def serialise(message: Any) -> bytes:
    """A message as CDR bytes."""
    return bytes(serialize_message(message))


def header_stamp_ns(cdr: bytes) -> int:
    """Stamp of a serialised message that begins with a std_msgs/Header, nanoseconds.

    Raises:
        ValueError: too short to have one.
    """
    if len(cdr) < 12:
        raise ValueError("the message is too short for a header")
    order = "<" if cdr[1] & 1 else ">"
    sec, nanosec = struct.unpack_from(f"{order}iI", cdr, 4)
    return int(sec) * 1_000_000_000 + int(nanosec)


def with_stamp(cdr: bytes, stamp_ns: int) -> bytes:
    """A serialised message that begins with a std_msgs/Header, with another stamp (nanoseconds).

    Raises:
        ValueError: too short to have one.
    """
    if len(cdr) < 12:
        raise ValueError("the message is too short for a header")
    order = "<" if cdr[1] & 1 else ">"
    stamp = struct.pack(f"{order}iI", *divmod(stamp_ns, 1_000_000_000))
    return bytes(cdr[:4]) + stamp + bytes(cdr[12:])


def header_frame(cdr: bytes) -> str:
    """frame_id of a serialised message that begins with a std_msgs/Header.

    Raises:
        ValueError: too short to have one.
    """
    order = "<" if cdr[1:2] == b"\x01" else ">"
    length = struct.unpack_from(f"{order}I", cdr, 12)[0] if len(cdr) >= 16 else len(cdr)
    if 16 + length > len(cdr):
        raise ValueError("the message is too short for a header")
    return bytes(cdr[16 : 16 + length]).rstrip(b"\0").decode(errors="replace")
