"""Photographs of an object on a printed board -> rosbag2 with poses."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import evenly
from occ_recon_ros.poses.board import BoardSpec, read_board
from occ_recon_ros.poses.camera_yaml import read_camera
from occ_recon_ros.poses.sequence import BoardPoses, BoardSequence
from occ_recon_ros.poses.sheet_blank import MissingMarkers, in_words, missing_markers
from occ_recon_ros.poses.sheet_shape import SheetShape

from .around import around_the_object
from .mask_files import read_mask
from .photographs import FolderPictures, Pictures, find_masks
from .scan_bag import PosedPicture
from .views import Progress

_FEWEST = 3
_LOOKED_AT = 40  # images, for markers that none shows
_MANY_UNREAD = 0.2  # share of the markers: an object on a small sheet hides a few
_NAMED = 4  # images that are named of those left out for one reason


@dataclass(frozen=True)
class ScanPoses:
    """What a look at all images gave.

    Attributes:
        poses: cameras and their poses; which images were left out and why.
        images: how many there were.
        masks: file of each that is used, by name; empty: they are to be found in the images.
        masks_unread: images whose mask is damaged or of another size.
        other_layout: the sheet has the other one of the two layouts of ChArUco boards.
        missing: markers of the board that no image shows.
        ordered: what is to be said of their order, where it is not that of their names.
    """

    poses: BoardPoses
    images: int
    masks: Mapping[str, Path] = field(default_factory=dict)
    masks_unread: Sequence[str] = ()
    other_layout: bool = False
    missing: MissingMarkers = field(default_factory=MissingMarkers)
    ordered: str = ""

    @property
    def names(self) -> list[str]:
        """Of the images that are used."""
        return [posed.shot.name for posed in self.poses.kept]

    @property
    def camera(self) -> Camera:
        """The lens."""
        return self.poses.camera

    @property
    def report(self) -> dict[str, Any]:
        """As report.json holds it."""
        left_out = {name: _WORDS.get(why, why) for name, why in self.poses.left_out.items()}
        blank = {"not_printed": list(self.missing.blank)} if self.missing.blank else {}
        masks = {"used": len(self.masks), "not_used": list(self.masks_unread)}
        found = {"images": self.images, "used": len(self.poses.kept), "left_out": left_out}
        return found | blank | ({"masks": masks} if self.masks else {})

    @property
    def lines(self) -> list[str]:
        """The result in words."""
        p = self.poses
        rms = float(np.median([k.pose.rms_px for k in p.kept]))
        sigma = np.median([np.sqrt(np.diag(k.pose.covariance)[:3].sum()) for k in p.kept])
        lines = [
            f"{len(p.kept)} of {self.images} images are used; the board's corners are {rms:.2f} px "
            f"off in the median, the cameras known to {1e3 * sigma:.2f} mm"
        ]
        if p.reasons:
            whose = {r: [name for name, why in p.left_out.items() if why == r] for r in p.reasons}
            lines.append("left out: " + ", ".join(_left_out(r, whose[r]) for r in whose))
        if self.masks_unread:
            lines.append(
                f"masks not used: {_some(self.masks_unread)}: damaged, or of another size than "
                "their images"
            )
        if bare := len(p.kept) - len(self.masks) if self.masks else 0:
            lines.append(f"{bare} images without a mask get theirs from all views together")
        if self.other_layout:
            age = "older" if p.board.legacy else "newer"
            lines.append(
                f"the sheet has the {age} ChArUco layout: write legacy: "
                f"{str(p.board.legacy).lower()} into board.yaml"
            )
        if p.intrinsics is not None:
            word, numbers = p.intrinsics.verdict
            lines.append(f"the camera was calibrated from the same images ({word}): {numbers}")
        if p.shape is not None:
            lines.append(_shape(p.shape))
        if words := _missing(self.missing, p.board):
            lines.append(words)
        return lines + [self.ordered] * bool(self.ordered)

    def posed(self, pictures: Pictures) -> Iterator[PosedPicture]:
        """The images that are used, with their cameras and masks."""
        kept = {posed.shot.name: posed.pose for posed in self.poses.kept}
        for name, stamp, image in pictures:
            if name in kept:
                camera = self.camera.at(kept[name].pose)
                mask = self.masks.get(name)
                known, file = kept[name].covariance, pictures.file(name)
                yield PosedPicture(image, camera, stamp, mask, known, name, file)


def read_rig(
    board_file: Path, camera_file: Path | None = None, for_poses: bool = True
) -> tuple[BoardSpec, Camera | None]:
    """The board and, if its file is given, the camera.

    Args:
        board_file: board.yaml.
        camera_file: camera_info YAML, or None.
        for_poses: the board must tell the pose of a camera, not its intrinsics alone.

    Raises:
        UserError: a file that is not there, or of another form.
    """
    try:
        board = read_board(board_file, for_poses)
        return board, None if camera_file is None else read_camera(camera_file)
    except ValueError as error:
        raise UserError(str(error)) from None


def find_poses(
    pictures: Pictures,
    board: BoardSpec,
    camera: Camera | None,
    step: float,
    progress: Progress,
) -> ScanPoses:
    """Look at all images and find their poses.

    Args:
        pictures: the images.
        board: that the object stands on.
        camera: intrinsics, or None to find them from the same images.
        step: least angle between two images to be used, radians.
        progress: told the images so far, and all of them.

    Raises:
        UserError: no poses can be had, in words.
    """
    sequence = BoardSequence(board, pictures.size)
    count = look_at_all(pictures, sequence, progress)
    with wrong_in(pictures.name):
        found = sequence.solve(camera, pictures.focal_px(), step)
    if len(found.kept) < _FEWEST:
        raise UserError(
            f"{pictures.name}: {len(found.kept)} images can be used, a scan needs at least "
            f"{_FEWEST} and is good with 24 or more: {sequence.diagnosis()}"
        )
    read = {int(number) for posed in found.kept for number in posed.shot.found.marker_ids}
    missing = missing_markers(found.board, read, _posed_images(pictures, found))
    not_printed = (*found.board.not_printed, *missing.blank)
    known = replace(found, board=replace(found.board, not_printed=not_printed))
    other_layout = found.board.legacy != board.legacy
    return ScanPoses(known, count, other_layout=other_layout, missing=missing)


def with_masks(found: ScanPoses, folder: Path, pictures: Pictures) -> ScanPoses:
    """The masks of the images that can be used; those without one are kept too.

    Raises:
        UserError: no such folder, or no mask in it that can be used.
    """
    size = found.camera.width, found.camera.height
    files = find_masks(folder, found.names)
    usable, unread = {}, []
    for name, file in files.items():
        try:
            read_mask(file, size, pictures.file(name))
        except UserError:
            unread.append(name)
        else:
            usable[name] = file
    if not usable:
        raise UserError(
            f"--masks {folder}: no mask there can be used; a mask has the name and the size of "
            "its photograph"
        )
    return replace(found, masks=usable, masks_unread=tuple(unread))


def by_place(found: ScanPoses, pictures: Pictures) -> tuple[ScanPoses, Pictures]:
    """Photographs in the order of their places around the object, where they do not follow each
    other there by their names; frames of a video are in the order of time.

    Args:
        found: their poses.
        pictures: that these are of.
    """
    kept = found.poses.kept
    if not isinstance(pictures, FolderPictures):
        return found, pictures
    centres = [posed.pose.pose.centre for posed in kept]
    if (sorted_so := around_the_object(centres, "photographs", "by their names")) is None:
        return found, pictures
    order, words = sorted_so
    poses = replace(found.poses, kept=[kept[k] for k in order])
    found = replace(found, poses=poses, ordered=words)
    return found, pictures.ordered(found.names)


def look_at_all(pictures: Pictures, sequence: BoardSequence, progress: Progress) -> int:
    """Look for the board in all images; how many there were.

    Args:
        pictures: the images.
        sequence: takes them in.
        progress: told the images so far, and all of them.
    """
    count = 0
    for count, (name, stamp, image) in enumerate(pictures, 1):
        sequence.add(name, stamp, image)
        progress(count, max(len(pictures), count))
    return count


def _posed_images(
    pictures: Pictures, found: BoardPoses
) -> Iterator[tuple[NDArray, Camera, NDArray]]:
    """Some of the images that are used, their cameras, and the numbers of their markers."""
    kept = {found.kept[k].shot.name: found.kept[k] for k in evenly(len(found.kept), _LOOKED_AT)}
    for name, _, image in pictures:
        if name in kept:
            posed = kept[name]
            yield image, found.camera.at(posed.pose.pose), posed.shot.found.marker_ids


def _shape(shape: SheetShape) -> str:
    """What is to be said of a sheet whose corners are not where they are printed."""
    gain = f"which takes the corners from {shape.flat_px:.2f} to {shape.bent_px:.2f} px in views"
    if shape.curled:
        return (
            f"the sheet is not quite flat; its shape was found too, {gain} left out: glue it onto "
            "something flat next time"
        )
    return (
        f"the corners of the sheet are seen {1e3 * shape.beside:.2g} mm beside their places, as a "
        f"printer or blur moves them; where they are was found too, {gain} left out"
    )


def _missing(missing: MissingMarkers, board: BoardSpec) -> str:
    """What is to be said of markers that no image shows; "" where nothing is."""
    if missing.blank:
        return (
            f"markers {in_words(missing.blank)} are seen in no image, but bare paper in their "
            f"places: taken as not printed (board.yaml says so by not_printed: "
            f"{sorted(board.not_printed)})"
        )
    if len(missing.unread) < _MANY_UNREAD * len(board.marker_ids):
        return ""
    return (
        f"markers {in_words(missing.unread)} are seen in no image: if they are not printed, masks "
        f"are wrong, for what hides print is the object: write not_printed: "
        f"{sorted(missing.unread)} into board.yaml, or give --masks"
    )


def _left_out(reason: str, names: list[str]) -> str:
    return f"{len(names)} {_WORDS.get(reason, reason)} ({_some(names)})"


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")


_WORDS = {
    "no_board": "without the board",
    "few_corners": "with too little of the board",
    "two_boards": "with two boards",
    "wrong_board": "with another board",
    "bad_fit": "whose corners do not fit",
    "blurred": "blurred",
    "still": "that have not moved",
    "other_size": "of another size",
    "damaged": "truncated or damaged",
}
