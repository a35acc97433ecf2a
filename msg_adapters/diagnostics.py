"""DiagnosticArray: a node's health."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from .header import encode_header


class Level(IntEnum):
    """How well a node is."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class StatusReport:
    """What a node says of itself: a level, a sentence a person can act on, and figures."""

    name: str
    level: Level
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


def encode_diagnostics(report: StatusReport, stamp_ns: int) -> DiagnosticArray:
    """One report in the standard form."""
    return DiagnosticArray(header=encode_header(stamp_ns, ""), status=[encode_status(report)])


def encode_status(report: StatusReport) -> DiagnosticStatus:
    """One report on its own."""
    return DiagnosticStatus(
        level=bytes([report.level]),
        name=report.name,
        message=report.message,
        hardware_id="",
        values=[KeyValue(key=str(k), value=str(v)) for k, v in report.values.items()],
    )


def decode_diagnostics(msg: DiagnosticArray) -> list[StatusReport]:
    """The reports of a message."""
    return [decode_status(status) for status in msg.status]


def decode_status(msg: DiagnosticStatus) -> StatusReport:
    """One report; an unknown level counts as an error."""
    known = {bytes([level]): level for level in Level}
    return StatusReport(
        msg.name,
        known.get(bytes(msg.level), Level.ERROR),
        msg.message,
        {item.key: item.value for item in msg.values},
    )
