"""ROS messages to NumPy and back: the only code that touches message fields."""

from .camera_info import decode_camera, encode_camera_info
from .contours import check_precision, decode_contours, encode_contours, is_contours
from .diagnostics import (
    Level,
    StatusReport,
    decode_diagnostics,
    decode_status,
    encode_diagnostics,
    encode_status,
)
from .frame import BadPart, View, decode_frame, decode_picture, frame_camera, frame_image
from .header import decode_stamp, encode_clock, encode_header
from .image import decode_compressed, decode_image, decode_mask, encode_image, encode_jpeg
from .marker import encode_marker
from .pose import decode_pose, encode_pose
from .rim import decode_rim, decode_shape, encode_rim
from .serialised import deserialise, message_type, serialise
from .strip import decode_strip, encode_strip

__all__ = [
    "BadPart",
    "Level",
    "StatusReport",
    "View",
    "check_precision",
    "decode_camera",
    "decode_compressed",
    "decode_contours",
    "decode_diagnostics",
    "decode_frame",
    "decode_image",
    "decode_mask",
    "decode_picture",
    "decode_pose",
    "decode_rim",
    "decode_shape",
    "decode_stamp",
    "decode_status",
    "decode_strip",
    "deserialise",
    "encode_camera_info",
    "encode_clock",
    "encode_contours",
    "encode_diagnostics",
    "encode_header",
    "encode_image",
    "encode_jpeg",
    "encode_marker",
    "encode_pose",
    "encode_rim",
    "encode_status",
    "encode_strip",
    "frame_camera",
    "frame_image",
    "is_contours",
    "message_type",
    "serialise",
]
