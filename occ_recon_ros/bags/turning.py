"""Images of a board on a turntable, and what its encoder said, from a bag or from pictures."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msg_adapters import decode_camera, decode_picture, decode_stamp, deserialise
from msg_adapters.joint import decode_joint
from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.geometry import Camera
from occ_recon_ros.streams.pairing import Pairing
from occ_recon_ros.streams.topics import IMAGES, TYPE_NAMES

from .photographs import Picture, Pictures
from .reader import open_bag

_JOINTS = "/joint_states"
_WAITING = 64


@dataclass(frozen=True)
class JointAngles:
    """What an encoder said.

    Attributes:
        joint: its name; empty: the only one there was.
        stamps_ns: (n,) increasing.
        angles: (n,) float64, radians.
    """

    joint: str
    stamps_ns: NDArray[np.int64]
    angles: NDArray[np.float64]

    def at(self, stamps_ns: list[int]) -> NDArray[np.float64]:
        """Angles in between, (m,) radians; NaN before the first and after the last."""
        start = self.stamps_ns[0]
        return np.interp(
            (np.asarray(stamps_ns) - start).astype(float),
            (self.stamps_ns - start).astype(float),
            self.angles,
            left=np.nan,
            right=np.nan,
        )


class BagPictures(Pictures):
    """The images of a recording, whatever else is in it.

    Args:
        path: of the bag.

    Raises:
        UserError: not a bag, or one without images.
    """

    def __init__(self, path: Path) -> None:
        self.name = path.name
        self._bag = open_bag(path)
        self._image = next((topic for topic in IMAGES if self._bag.counts[topic]), "")
        if not self._image:
            raise UserError(f"{path} has no {IMAGES[0]}: record it")

    def __len__(self) -> int:
        return int(self._bag.counts[self._image])

    def __iter__(self) -> Iterator[Picture]:
        for recorded in self._bag.messages([self._image]):
            with wrong_in(f"{self._bag.path}: {recorded.topic}"):
                message = deserialise(recorded.cdr, TYPE_NAMES[recorded.topic])
                stamp, image = decode_stamp(message.header.stamp), decode_picture(message)
            yield f"{stamp * 1e-9:.3f} s", stamp, image


class TurningBag(BagPictures):
    """A recording of a turntable: images and camera_info, and perhaps joint_states.

    Args:
        path: of the bag.

    Raises:
        UserError: not a bag, or one without images or camera_info.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        if not self._bag.counts["/camera_info"]:
            raise UserError(f"{path} has no /camera_info: record it")
        self.camera: Camera | None = None

    def __iter__(self) -> Iterator[Picture]:
        pairing = Pairing(depth=_WAITING, with_pose=False)
        for recorded in self._bag.messages([self._image, "/camera_info"]):
            part = "camera_info" if recorded.topic == "/camera_info" else "image"
            with wrong_in(f"{self._bag.path}: {recorded.topic}"):
                message = deserialise(recorded.cdr, TYPE_NAMES[recorded.topic])
                for frame in pairing.add(part, decode_stamp(message.header.stamp), message):
                    self.camera = decode_camera(frame.parts["camera_info"])
                    image = decode_picture(frame.parts["image"])
                    yield f"{frame.stamp_ns * 1e-9:.3f} s", frame.stamp_ns, image

    def joint_angles(self, joint: str) -> JointAngles | None:
        """What the encoder said; None where nothing is recorded.

        Raises:
            UserError: the joint is not there.
        """
        if not self._bag.counts[_JOINTS]:
            return None
        found: dict[int, float] = {}
        why = ""
        for recorded in self._bag.messages([_JOINTS]):
            message = deserialise(recorded.cdr, TYPE_NAMES[_JOINTS])
            try:
                found[decode_stamp(message.header.stamp)] = decode_joint(message, joint)
                joint = joint or str(message.name[0])
            except ValueError as error:
                why = str(error)
        if not found:
            raise UserError(f"{self._bag.path}: {_JOINTS}: {why}")
        stamps = sorted(found)
        angles = np.array([found[stamp] for stamp in stamps])
        return JointAngles(joint, np.array(stamps, np.int64), angles)
