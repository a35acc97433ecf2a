"""Poses of images from a tree of transforms, in place of those of a topic."""

from occ_recon_ros.poses.transforms import NoTransform, TransformTree

from .pairing import Frame, Poses


class TransformPoses(Poses):
    """The pose of a frame is that of its image's frame_id in the object frame, at its stamp.

    Args:
        tree: of transforms, filled by whoever hears them.
        object_frame: that poses are wanted in.
        most_gap_ns: between two stamps that a pose is taken from.
    """

    def __init__(self, tree: TransformTree, object_frame: str, most_gap_ns: int) -> None:
        super().__init__()
        self._tree, self._object, self._gap = tree, object_frame, most_gap_ns

    def clear(self) -> None:
        """Forget what moves."""
        super().clear()
        self._tree.clear()

    def exact(self, frame: Frame) -> bool:
        """Fill in the pose of the frame."""
        return self.around(frame) is not None

    def around(self, frame: Frame) -> int | None:
        """Fill in the pose of the frame; 0 if there is one, else None."""
        try:
            frame.poses = (self._lookup(frame),)
        except NoTransform:
            return None
        frame.fraction = 0.0
        return 0

    def missing(self, frame: Frame, interpolate: bool) -> str:
        """Why the frame has none, as ``NoTransform`` names it."""
        self.words = ""
        try:
            self._lookup(frame)
        except NoTransform as error:
            self.words = str(error)
            return error.reason
        return "no_camera_pose"

    def _lookup(self, frame: Frame) -> object:
        optical = frame.parts["image"].header.frame_id
        return self._tree.lookup(self._object, optical, frame.stamp_ns, self._gap)
