"""camera_info, camera_pose, image and mask of one instant, decoded together."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.geometry.refusal import Refusal

from .camera_info import decode_camera
from .contours import check_precision
from .image import decode_compressed, decode_image, decode_mask
from .pose import decode_pose


class PairedFrame(Protocol):
    """The messages of one stamp, as ``streams.pairing.Frame`` brings them together.

    Attributes:
        stamp_ns: nanoseconds.
        parts: messages: image (Image or CompressedImage), camera_info and perhaps mask.
        poses: the PoseStamped (or CameraPose) of this stamp once, or the ones before and after it.
        fraction: where between those two the stamp lies, 0 to 1.
    """

    @property
    def stamp_ns(self) -> int: ...

    @property
    def parts(self) -> Mapping[str, Any]: ...

    @property
    def poses(self) -> Sequence[Any]: ...

    @property
    def fraction(self) -> float: ...


@dataclass(frozen=True, eq=False)
class View:
    """One decoded frame.

    Attributes:
        stamp_ns: nanoseconds.
        camera: as calibrated, in the object frame.
        image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
        mask: (h, w) uint8, 0 = background, or None.
    """

    stamp_ns: int
    camera: Camera
    image: NDArray[Any]
    mask: NDArray[np.uint8] | None


class BadPart(Refusal):
    """A message of a frame that cannot be used: "bad_" and the part, which is camera_pose,
    camera_info, image or mask."""


def decode_frame(frame: PairedFrame) -> View:
    """All of a frame.

    Raises:
        BadPart: one of its messages cannot be used.
    """
    camera, image = frame_camera(frame), frame_image(frame)
    mask = None
    if "mask" in frame.parts:
        with _of("mask"):
            mask = decode_mask(frame.parts["mask"])
    return View(frame.stamp_ns, camera, image, mask)


def frame_camera(frame: PairedFrame) -> Camera:
    """The calibrated camera of a frame, its pose interpolated where it is between two.

    Raises:
        BadPart: camera_info or camera_pose cannot be used.
    """
    with _of("camera_pose"):
        pose = _pose(frame.poses[0])
        if len(frame.poses) == 2:
            pose = pose.towards(_pose(frame.poses[1]), frame.fraction)
    with _of("camera_info"):
        camera = decode_camera(frame.parts["camera_info"], pose)
    with _of("camera_pose"):
        check_precision(camera)
    return camera


def frame_image(frame: PairedFrame) -> NDArray[Any]:
    """The pixels of a frame, (h, w) or (h, w, 3) BGR.

    Raises:
        BadPart: the image cannot be used.
    """
    with _of("image"):
        return decode_picture(frame.parts["image"])


def decode_picture(message: Any) -> NDArray[Any]:
    """The pixels of an Image or a CompressedImage, (h, w) or (h, w, 3) BGR.

    Raises:
        ValueError: it cannot be used.
    """
    return decode_compressed(message) if hasattr(message, "format") else decode_image(message)


def _pose(pose: Any) -> CameraPose:
    """Of a PoseStamped, or what a tree of transforms gave."""
    return pose if isinstance(pose, CameraPose) else decode_pose(pose)


@contextmanager
def _of(part: str) -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise BadPart(f"bad_{part}", f"{part}: {error}") from error
