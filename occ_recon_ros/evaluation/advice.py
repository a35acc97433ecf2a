"""What to do about the findings of a verdict."""

import re
from collections.abc import Mapping

IN_ORDER = "give the images in the order of the turn: by their stamps, photographs by their names"
MASKS = "give masks, a picture of the empty rig (background_image), or a plain backdrop"
EMPTY = "mend those masks, or leave out the images that do not show the object"
FILLED_SO = (
    "other views show a surface there, or are too far apart to tell: add views that see through "
    "them too, or mend the masks where there is no hole"
)
BARE = "if it is what the object lies on, look at it from lower, or leave it out"
ROUND = "turn the object all the way round"
IN_GAP = "take images from there, or mend those that are there, or their masks"
# (By then the views have been looked at together.)
DOUBTED = "look at contours.png: where lines leave the object, {}; else check {}"
OUTLINES = "look at contours.png: try {}masks of your own; check {{}}"
GIVEN = (
    "the masks of the bag do not agree with each other in these cameras: check {}, in contours.png "
    "that each mask is of its image and shows all of the object; thin parts that sway or bend "
    "between two images agree in no cameras: keep them still, or take all images at once"
)
SHARPER = "more contrast to the backdrop, sharper images"
SMOOTH = "masks as fine as their images, with smooth outlines that end where the object does"
WHOLE = "take the images so that the whole object is in them"
_RENUMBER = (
    "give each image its own mask: they are numbered otherwise, or the first is missing "
    "(occ-recon import, of images and masks as files, mostly mends that)"
)
FROM_ALL = "masks from all views together"  # of remarks on masks of the images that came without
_MORE = "give masks for more of the images"
TIGHT = (
    "look at contours.png: masks must end where the object does, with no shadow, and not before; "
    "or leave them out (--no-masks)"
)
PART = (
    "look at contours.png: where that is of the object, add it to the masks that leave it out; "
    "where it is not, as a stand, cut it from those that hold it"
)
_DARK = (
    "look at contours.png: masks must end where the object does, with no shadow, and not before; "
    "where that looks as what is behind it, they may be right: a backdrop of another colour tells"
)
_POSES = (
    "check K, D and poses first, as whether the camera was touched between two images: masks of "
    "your own do not depend on them"
)
_SHEET = (
    "cut the sheet from the masks, or leave these out (occ-recon import --no-masks): it is then "
    "found in the images and taken as the backdrop"
)
HIDDEN = "leave those images out, or take them again"
_OF_REMARKS = {
    "something is before or beside the object in": HIDDEN,
    "masks that came hold the printed sheet": _SHEET,
    "poses or calibration as given are off by": _POSES,
    "touches the border of the picture": WHOLE,
    "masks hold what the others leave out": PART,
    "masks leave out what the others hold": PART,
    "masks that came fit the": _RENUMBER,
    "masks that came show": _MORE,
    "; images alone ": _DARK,
    "where their images show no edge": TIGHT,
    "of the edges of their images": TIGHT,
}


_MEANT = re.compile(r"^(the poses|the rotations|t|K|the images) seems? to be ")  # of ``misread``


def of_remark(remark: str, usual: str) -> str:
    """What to do about a doubt of those who made the masks or poses.

    Args:
        remark: the doubt.
        usual: what to do about most.
    """
    if _MEANT.search(remark):
        return remark.partition(": ")[2] or usual
    return next((do for part, do in _OF_REMARKS.items() if part in remark), usual)


def explains_all(remark: str) -> bool:
    """Whether what else is found is most likely a consequence of a doubt."""
    return _MEANT.search(remark) is not None or of_remark(remark, "") in (_RENUMBER, _SHEET)


_LOST = {
    "no_camera_pose": (
        "had no camera_pose",
        "see that each image has a pose: one of its stamp, or some shortly before and after it, "
        "all in one frame",
    ),
    "pose_gap": (
        "had no poses near enough",
        "poses more often, or --set contour_tracker.max_pose_gap=SECONDS, more than between two",
    ),
    "pose_frame": (
        "had a pose in another frame",
        "see that all poses are in one frame, which --set contour_tracker.object_frame=NAME names",
    ),
    "no_camera_info": ("had no camera_info", "see that camera_info comes too"),
    "no_mask": ("had no mask", "give each image a mask, black where it shows no object"),
    "bad_camera_pose": ("had a camera_pose that cannot be used", "mend the poses"),
    "bad_camera_info": ("had a camera_info that cannot be used", "mend K, D and sizes"),
    "bad_image": ("cannot be read", "leave those images out, or copy them again"),
    "left_out": (
        "were left out",
        "see what is said of each view: take its image again, or mend its mask or pose",
    ),
    "bad_mask": ("had a mask that cannot be used", "mend those masks: mono8, 0 is background"),
}
"""Why no outline is looked for in an image, and what to do."""


def of_drops(drops: Mapping[str, int], without: int) -> tuple[str, str] | None:
    """Why images gave no outline that were dropped before one was sought: in words, and what to do;
    None where that befell less than half of them.

    Args:
        drops: by the tracker or the steps before it, by reason.
        without: images that gave no outline.
    """
    lost = {reason: n for reason, n in drops.items() if n and reason in _LOST}
    if not lost or sum(lost.values()) < 0.5 * without:
        return None
    by_count = sorted(lost, key=lambda reason: -lost[reason])
    words = ", ".join(f"{lost[reason]} {_LOST[reason][0]}" for reason in by_count)
    return words, _LOST[by_count[0]][1]
