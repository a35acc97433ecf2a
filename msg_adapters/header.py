"""Stamps and headers."""

from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

SECOND_NS = 1_000_000_000
_LAST_NS = (2**31) * SECOND_NS - 1


def decode_stamp(stamp: Time) -> int:
    """Nanoseconds of a stamp.

    Raises:
        ValueError: a negative time, or a nanosecond part of a second or more.
    """
    if stamp.sec < 0 or stamp.nanosec >= SECOND_NS:
        raise ValueError(f"stamp {stamp.sec} s + {stamp.nanosec} ns is not a time")
    return int(stamp.sec) * SECOND_NS + int(stamp.nanosec)


def encode_stamp(stamp_ns: int) -> Time:
    """A stamp from nanoseconds.

    Raises:
        ValueError: outside what a stamp can hold (0 to 2^31 seconds).
    """
    if not 0 <= stamp_ns <= _LAST_NS:
        raise ValueError(f"{stamp_ns} ns does not fit a stamp")
    return Time(sec=int(stamp_ns // SECOND_NS), nanosec=int(stamp_ns % SECOND_NS))


def encode_clock(stamp_ns: int) -> Clock:
    """What /clock carries, from nanoseconds.

    Raises:
        ValueError: as ``encode_stamp``.
    """
    return Clock(clock=encode_stamp(stamp_ns))


def encode_header(stamp_ns: int, frame_id: str) -> Header:
    """A header from nanoseconds and a frame name."""
    return Header(stamp=encode_stamp(stamp_ns), frame_id=str(frame_id))
