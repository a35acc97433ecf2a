"""Serialised messages, read no further than is needed."""

import struct


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
