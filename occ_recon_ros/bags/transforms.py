"""Poses of the images of a bag from its /tf and /tf_static."""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator

from rosbags.typesys import Stores, get_typestore

from msg_adapters import serialise
from msg_adapters.pose import encode_camera_pose
from msg_adapters.serialised import header_frame, header_stamp_ns
from msg_adapters.transforms import decode_transforms
from occ_recon_ros.errors import UserError
from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.poses.transforms import NoTransform, TransformTree
from occ_recon_ros.streams.topics import IMAGES, TF, TYPE_NAMES

from .poses import PoseReading
from .reader import Bag, BagMessage


class BagTransforms:
    """All transforms of a bag, known before its first image is played.

    Args:
        bag: that has no poses.
        sources: {topic of the bag: "/tf" or "/tf_static"}.
        reading: the frame that poses are wanted in, and the widest gap between two transforms.
    """

    def __init__(self, bag: Bag, sources: dict[str, str], reading: PoseReading) -> None:
        self._wanted, self._gap = reading.object_frame, reading.tf_gap_ns
        self.tree = TransformTree()
        store = get_typestore(Stores.ROS2_JAZZY)
        for message in bag.messages(list(sources)):
            try:
                decoded = store.deserialize_cdr(message.cdr, TYPE_NAMES["/tf"])
                for transform in decode_transforms(decoded):
                    self.tree.add(transform, static=sources[message.topic] == TF[1])
            except Exception:  # of many kinds: whatever the parser stumbles over
                continue

    def placed(self, messages: Iterable[BagMessage]) -> Iterator[BagMessage]:
        """The messages (under the names of our topics), and before each image that has one its
        camera_pose."""
        for message in messages:
            if message.topic in IMAGES:
                try:
                    stamp, pose = self._pose(message)
                except ValueError:
                    pass  # the tracker counts it as no_camera_pose
                else:
                    cdr = serialise(encode_camera_pose(pose, stamp, self._wanted))
                    yield message._replace(
                        topic="/camera_pose", msgtype=TYPE_NAMES["/camera_pose"], cdr=cdr
                    )
            yield message

    def _pose(self, image: BagMessage) -> tuple[int, CameraPose]:
        """Stamp of an image, and where the camera was then."""
        stamp, frame = header_stamp_ns(image.cdr), header_frame(image.cdr)
        return stamp, self.tree.lookup(self._wanted, frame, stamp, self._gap)

    def check(self, bag: Bag, images: Collection[str]) -> None:
        """
        Raises:
            UserError: not one image has a pose; says why.
        """
        why: Counter[str] = Counter()
        for message in bag.messages(images):
            try:
                self._pose(message)
                return
            except NoTransform as error:
                why[str(error)] += 1
            except ValueError:
                continue
        if why:
            reason = why.most_common(1)[0][0]
            helps = "; the object's frame is named by --set contour_tracker.object_frame=NAME"
            if "max_pose_gap" in reason:
                helps = ": --set contour_tracker.max_pose_gap=SECONDS"
            raise UserError(
                f"{bag.path} holds no camera_pose, and none of its images has a pose by /tf: "
                f"{reason}{helps}"
            )
