"""Messages as bytes, as bags hold them, and message types by name."""

import importlib
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
