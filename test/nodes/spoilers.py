"""Messages made wrong: a value, a size, a name, a stamp or some bytes, by the dice of ``rng``."""

import numpy as np

NASTY = [0.0, -0.0, 1.0, -1.0, 1e-30, 1e30, -1e300, float("nan"), float("inf"), -float("inf")]
NASTY_32 = [value for value in NASTY if value != -1e300]
SIZES = [0, 1, 2, 3, 7, 240, 320, 65536, 2**31, 2**32 - 1]


def spoil_header(msg, rng):
    if rng.random() < 0.5:
        msg.header.frame_id = ["", "world", "turntable/", "x" * 500][rng.integers(4)]
    else:
        msg.header.stamp.sec = int(rng.integers(-(2**31), 2**31))
        msg.header.stamp.nanosec = int(rng.integers(0, 2**32))


def spoil_bytes(msg, rng):
    """Cut, lengthen or overwrite the data."""
    data, way = msg.data, rng.integers(3)
    if way == 0:
        del data[int(rng.integers(0, len(data) + 1)) :]
    elif way == 1:
        data.extend(bytes(int(rng.integers(1, 100))))
    elif data:
        for at in rng.integers(0, len(data), 20):
            data[int(at)] = int(rng.integers(0, 256))


def spoil_image(msg, rng):
    way = rng.integers(5)
    if way == 0:
        name = ["height", "width", "step"][rng.integers(3)]
        setattr(msg, name, SIZES[rng.integers(len(SIZES))])
    elif way == 1:
        encodings = ["bgr8", "mono16", "bayer_rggb8", "rgba8", "yuv422", "", "32FC1", "8UC1"]
        msg.encoding = encodings[rng.integers(len(encodings))]
    elif way == 2:
        level = int(rng.integers(0, 256))
        msg.data = type(msg.data)("B", bytes([level]) * len(msg.data))
    elif way == 3:
        spoil_header(msg, rng)
    else:
        spoil_bytes(msg, rng)


def spoil_compressed(msg, rng):
    way = rng.integers(4)
    if way == 0:
        msg.format = ["", "png", "bgr8; jpeg compressed bgr8", "tiff", "x" * 500][rng.integers(5)]
    elif way == 1:
        spoil_header(msg, rng)
    else:
        spoil_bytes(msg, rng)


def spoil_info(msg, rng):
    way = rng.integers(5)
    if way == 0:
        k = np.array(msg.k)
        k[rng.integers(9)] = NASTY[rng.integers(len(NASTY))]
        msg.k = k
    elif way == 1:
        msg.d = [NASTY[i] for i in rng.integers(0, len(NASTY), rng.integers(0, 15))]
        models = ["plumb_bob", "equidistant", "rational_polynomial", "", "magic"]
        msg.distortion_model = models[rng.integers(5)]
    elif way == 2:
        name = ["height", "width", "binning_x", "binning_y"][rng.integers(4)]
        setattr(msg, name, SIZES[rng.integers(len(SIZES))])
    elif way == 3:
        name = ["height", "width", "x_offset", "y_offset"][rng.integers(4)]
        setattr(msg.roi, name, SIZES[rng.integers(len(SIZES))])
    else:
        spoil_header(msg, rng)


def spoil_pose(msg, rng):
    way = rng.integers(3)
    value = NASTY[rng.integers(len(NASTY))]
    if way == 0:
        setattr(msg.pose.position, "xyz"[rng.integers(3)], value)
    elif way == 1:
        setattr(msg.pose.orientation, "xyzw"[rng.integers(4)], value)
    else:
        spoil_header(msg, rng)


def spoil_cloud(msg, rng):
    way = rng.integers(8)
    if way == 0:
        del msg.fields[int(rng.integers(len(msg.fields)))]
    elif way == 1:
        field = msg.fields[int(rng.integers(len(msg.fields)))]
        name = ["offset", "datatype", "count"][rng.integers(3)]
        setattr(field, name, int(rng.integers(0, 60)))
    elif way == 2:
        name = ["height", "width", "point_step", "row_step"][rng.integers(4)]
        setattr(msg, name, SIZES[rng.integers(len(SIZES))])
    elif way == 3:
        spoil_bytes(msg, rng)
    elif way == 4:
        msg.width, msg.row_step, msg.data = 0, 0, []
    elif way == 5:
        msg.is_bigendian = True
        spoil_header(msg, rng)
    elif way == 6:
        fields = msg.fields
        one, other = fields[rng.integers(len(fields))], fields[rng.integers(len(fields))]
        one.name = ["", "x", "rgb", "\u00e9" * 300][rng.integers(4)]
        other.offset, one.offset = one.offset, other.offset
    else:
        rows = np.frombuffer(msg.data, np.uint8).reshape(msg.width, msg.point_step)
        field = msg.fields[int(rng.integers(len(msg.fields)))]
        value = np.array([NASTY_32[rng.integers(len(NASTY_32))]], "<f4").view(np.uint8)
        width = min(4, msg.point_step - field.offset)
        some = rng.random(msg.width) < rng.choice([0.01, 0.5, 1.0])
        rows[some, field.offset : field.offset + width] = value[:width]


SPOILERS = {
    "image": spoil_image,
    "info": spoil_info,
    "mask": spoil_image,
    "compressed": spoil_compressed,
    "pose": spoil_pose,
    "contours": spoil_cloud,
    "rim": spoil_cloud,
}
