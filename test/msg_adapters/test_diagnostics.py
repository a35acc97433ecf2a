"""DiagnosticArray in the standard form."""

from rclpy.serialization import deserialize_message, serialize_message

from msg_adapters import Level, StatusReport, decode_diagnostics, encode_diagnostics


def test_a_report_comes_back_with_its_level_words_and_figures():
    sent = StatusReport("/rig/mesher", Level.WARN, "no rims on /rig/rim", {"drops": 3, "x": 0.5})
    msg = encode_diagnostics(sent, 2_000_000_001)
    msg = deserialize_message(serialize_message(msg), type(msg))
    assert msg.status[0].level == b"\x01"
    assert msg.header.stamp.nanosec == 1
    (got,) = decode_diagnostics(msg)
    assert (got.name, got.level, got.message) == (sent.name, Level.WARN, sent.message)
    assert got.values == {"drops": "3", "x": "0.5"}


def test_an_unknown_level_is_an_error():
    msg = encode_diagnostics(StatusReport("a", Level.OK, ""), 0)
    msg.status[0].level = b"\x09"
    assert decode_diagnostics(msg)[0].level == Level.ERROR
