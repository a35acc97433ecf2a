"""Poses of the images of a bag from its /tf and /tf_static."""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator

from rosbags.typesys import Stores, get_typestore

from msg_adapters import serialise
from msg_adapters.pose import encode_camera_pose
from msg_adapters.serialised import header_frame, header_stamp_ns
from msg_adapters.transforms import decode_transforms
from occ_recon_ros.errors import UserError
from occ_recon_ros.poses.transforms import NoTransform, TransformTree
from occ_recon_ros.streams.pairing import MAX_POSE_GAP_NS
from occ_recon_ros.streams.topics import IMAGES, TF, TYPE_NAMES

from .reader import Bag, BagMessage


class BagTransforms:
    """All transforms of a bag, known before its first image is played.

    Args:
        bag: that has no poses.
        sources: {topic of the bag: "/tf" or "/tf_static"}.

    Attributes:
        bad: how many messages cannot be used.
    """

    def __init__(self, bag: Bag, sources: dict[str, str]) -> None:
        self.tree, self.bad = TransformTree(), 0
        store = get_typestore(Stores.ROS2_JAZZY)
        for message in bag.messages(list(sources)):
            try:
                # Of many kinds: whatever the parser stumbles over.
                decoded = store.deserialize_cdr(message.cdr, TYPE_NAMES["/tf"])
                for transform in decode_transforms(decoded):
                    self.tree.add(transform, static=sources[message.topic] == TF[1])
            except Exception:
                self.bad += 1

    def poses(self, messages: Iterable[BagMessage], object_frame: str) -> Iterator[BagMessage]:
        """The messages, and before each image that has one its camera_pose.

        Args:
            messages: under the names of our topics.
            object_frame: that the poses are wanted in.
        """
        for message in messages:
            if message.topic in IMAGES:
                try:
                    stamp, frame = header_stamp_ns(message.cdr), header_frame(message.cdr)
                    pose = self.tree.lookup(object_frame, frame, stamp, MAX_POSE_GAP_NS)
                except ValueError:
                    pass  # the tracker counts it as no_camera_pose
                else:
                    cdr = serialise(encode_camera_pose(pose, stamp, object_frame))
                    yield message._replace(
                        topic="/camera_pose", msgtype=TYPE_NAMES["/camera_pose"], cdr=cdr
                    )
            yield message

    def check(self, bag: Bag, images: Collection[str], object_frame: str) -> None:
        """
        Raises:
            UserError: not one image has a pose; says why.
        """
        why: Counter[str] = Counter()
        for message in bag.messages(images):
            try:
                stamp, frame = header_stamp_ns(message.cdr), header_frame(message.cdr)
                self.tree.lookup(object_frame, frame, stamp, MAX_POSE_GAP_NS)
                return
            except NoTransform as error:
                why[str(error)] += 1
            except ValueError:
                continue
        if why:
            raise UserError(
                f"{bag.path} holds no camera_pose, and none of its images has a pose by /tf: "
                f"{why.most_common(1)[0][0]}; the object's frame is named by "
                "--set contour_tracker.object_frame=NAME"
            )
