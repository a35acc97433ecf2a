"""A folder of images and what it says of their cameras, checked."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from filecmp import cmp
from pathlib import Path

import numpy as np

from occ_recon_ros.errors import UserError
from occ_recon_ros.imaging.joint.space import fixation, usual_distance
from occ_recon_ros.poses.convention import OTHER_CONVENTIONS, ROUNDED, other_convention

from .around import around_the_object
from .cameras_json import read_cameras_json
from .colmap import find_model, read_colmap, refuse_half
from .frames import Frame, Listing
from .image_sizes import size_doubt
from .lenses import split_lenses
from .llff import POSES, read_poses_bounds
from .nerf import find_transforms, read_transforms
from .projections import find_projections, read_projections
from .splatting import read_splats, splats_of
from .unread import refuse_unread

_FEWEST = 3  # frames: one window
_NEAR_M, _FAR_M = 2e-3, 50.0  # between which cameras of turntables are, by far
_BEYOND_M = 1e15  # that no bag keeps, which is said of each frame
_SAME_POSE = 1e-6  # of the distance, or radians, by which the same poses differ
_DIGITS = 4  # of the distance to what the cameras look at, to which its place is said


@np.errstate(over="ignore", invalid="ignore")  # what is out of all measure is said in words
def load_dataset(folder: Path, masks: bool = True) -> tuple[list[Frame], list[str], list[str]]:
    """The frames of a folder in order of time, and why others are left out.

    They are those of cameras.json; where there is none, of a sparse model of COLMAP in the folder,
    else of transforms.json, else of cameras.npz or *_par.txt, else of a cameras.json of Gaussian
    splatting or of poses_bounds.npy. Without stamps they are in the order
    of cameras.json, or by name; where views that follow each other in that are hopelessly far
    apart, in the order of their places around the object.

    Args:
        folder: has such a file, and the images.
        masks: leave the masks out if False.

    Returns:
        Frames, at least one; poses in metres, which of all but cameras.json nobody knows: there the
        cameras are 1 m away from what they look at, the origin; stamps evenly spaced where none are
        given. A sentence for each frame of which something is missing, misshapen or not finite, by
        its place in the file. And remarks on all of them. Of images no more than the size is read;
        of masks that no file lists some are looked at, whether they are inverted.

    Raises:
        UserError: the folder as a whole is wrong, or too many frames of it.
    """
    listing = _listing(folder, masks)
    source, left_out = listing.source, list(listing.left_out)
    frames, bent, of_lenses = split_lenses(listing.frames, source)
    left_out += bent
    refuse_too_few(len(frames), left_out)
    doubt = _convention_doubt(frames, listing)
    _refuse_one_pose(frames, source)
    frames, again = _each_once(frames)
    again += _in_many_poses(frames, source)
    if listing.metric:
        remarks = listing.remarks + of_lenses + again + _unit_doubt(frames)
    else:
        frames, remark = _one_metre_away(frames, source)
        remarks = [*listing.remarks, *of_lenses, *again, remark]
    remarks += doubt + size_doubt(frames, source)
    if listing.stamped:
        return sorted(frames, key=lambda frame: frame.stamp_ns), left_out, remarks
    frames, moved = _around_the_object(frames)
    return frames, left_out, remarks + moved


def _each_once(frames: Sequence[Frame]) -> tuple[list[Frame], list[str]]:
    """Frames without those that show a photograph again, in the same pose, and what is to be said
    of these: whole sets are copied as what learns from them wants them, train, val and test."""
    kept: list[Frame] = []
    again: list[Frame] = []
    by_camera: dict[bytes, list[Path]] = {}
    for frame in frames:
        c = frame.camera
        key = np.concatenate([c.K.ravel(), c.R_camera_object.ravel(), c.t_camera_object, c.D])
        there = by_camera.setdefault(key.tobytes(), [])
        if any(one == frame.image or cmp(one, frame.image, shallow=False) for one in there):
            again.append(frame)
        else:
            there.append(frame.image)
            kept.append(frame)
    if not again:
        return kept, []
    return kept, [
        f"{len(again)} frames show a photograph that an earlier one shows, in the same pose "
        f"({again[0].image}): each is taken once"
    ]


def _in_many_poses(frames: Sequence[Frame], source: Path) -> list[str]:
    """What is to be said of a file that is named in more poses than one."""
    file, count = Counter(frame.image for frame in frames).most_common(1)[0]
    if count == 1:
        return []
    named = f"{source}: {count} of {len(frames)} frames name {file}"
    return [f"{named}, in poses that differ: a photograph has one, check the names"]


def _convention_doubt(frames: Sequence[Frame], listing: Listing) -> list[str]:
    """What is to be said of poses that look at one place better if they are read another way.

    Raises:
        UserError: as they are given, they look at none.
    """
    ways = listing.ways or OTHER_CONVENTIONS
    found = other_convention([frame.camera for frame in frames], ways)
    if found is None:
        return []
    meant, apart = found
    said = f"{listing.source}: {listing.poses}, but these poses "
    if apart:
        seem = f"; they seem to be {meant}" if listing.ways else ""
        raise UserError(f"{said}look past each other{seem}")
    how = f"if they are {meant}" if listing.ways else "if they are read another way"
    return [f"{said}look at one place much better {how}: check them"]


def _listing(folder: Path, masks: bool) -> Listing:
    """What the first description says that is there."""
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        raise UserError(f"folder {folder} {what}: give one that holds images and cameras")
    ours = folder / "cameras.json"
    splats = bool(splats_of(ours))
    if ours.exists() and not splats:
        return read_cameras_json(ours, masks)
    model, transforms = find_model(folder), find_transforms(folder)
    if model is None and not transforms:
        if (projections := find_projections(folder)) is not None:
            return read_projections(folder, projections, masks)
        refuse_half(folder, below=True)
        if splats:
            return read_splats(ours, masks)
        if (folder / POSES).exists():
            return read_poses_bounds(folder, masks)
        refuse_unread(folder)
        refuse_half(folder, below=False)
        raise UserError(
            f"{folder} does not say where its cameras were: it needs cameras.json, a sparse model "
            "of COLMAP (cameras and images, .bin or .txt, as in sparse/0), transforms.json, "
            "cameras.npz (IDR, NeuS), *_par.txt (Middlebury), poses_bounds.npy (LLFF) or the "
            "cameras.json of Gaussian splatting"
        )
    if model is None:
        return read_transforms(folder, transforms, masks)
    listing = read_colmap(folder, model, masks)
    if transforms:
        listing.remarks.append(f"the cameras are those of {model}, not of {transforms[0]}")
    return listing


def _one_metre_away(frames: Sequence[Frame], source: Path) -> tuple[list[Frame], str]:
    """Frames of any unit and origin so that the cameras are 1 m away from what they look at, the
    origin, and a remark. That of a georeferenced model is thousands of kilometres away."""
    cameras = [frame.camera for frame in frames]
    far = max(np.abs(camera.centre).max() for camera in cameras)
    away = usual_distance(cameras) if far < _BEYOND_M else np.inf
    if not ROUNDED * far < away < np.inf:
        raise UserError(f"{source}: the cameras look at no common place, or are all at one")
    origin = fixation(cameras)
    t = [c.R_camera_object @ (origin - c.centre) / away for c in cameras]
    moved = [
        replace(frame, camera=replace(frame.camera, t_camera_object=t_i))
        for frame, t_i in zip(frames, t, strict=True)
    ]
    digits = max(0, _DIGITS - int(np.floor(np.log10(away))))
    place = ", ".join(f"{x:.{digits}f}" for x in origin)
    return moved, (
        f"unit and origin of {source} are arbitrary: the cameras are taken to be 1 m away from "
        f"what they look at, so that one unit is {1 / away:.4g} m; the origin is moved there, "
        f"to ({place}) of the model"
    )


def _unit_doubt(frames: Sequence[Frame]) -> list[str]:
    """What is to be said of cameras that are out of all measure far from what they look at."""
    cameras = [frame.camera for frame in frames]
    if max(np.abs(camera.centre).max() for camera in cameras) > _BEYOND_M:
        return []
    away = usual_distance(cameras)
    if _NEAR_M < away < _FAR_M:
        return []
    return [
        f"the cameras are {away:.3g} m away from what they look at: the poses may be in another "
        "unit (unit_in_metres)"
    ]


def _around_the_object(frames: list[Frame]) -> tuple[list[Frame], list[str]]:
    """Frames whose stamps were made up, in the order of their places around the object where they
    do not follow each other there as they are, and what is to be said of that."""
    centres = [frame.camera.centre for frame in frames]
    found = around_the_object(centres, "frames", "as listed, without stamps")
    if found is None:
        return frames, []
    order, words = found
    moved = [
        replace(frames[k], stamp_ns=frame.stamp_ns) for k, frame in zip(order, frames, strict=True)
    ]
    return moved, [words]


def _refuse_one_pose(frames: Sequence[Frame], path: Path) -> None:
    """Keep out the pose of a camera that stands still beside a table that turns.

    Raises:
        UserError: all frames of a window or more have the same pose.
    """
    R = [frame.camera.R_camera_object for frame in frames]
    t = [frame.camera.t_camera_object for frame in frames]
    far = np.abs(t).max()
    same = np.ptp(R, axis=0).max() < _SAME_POSE and np.ptp(t, axis=0).max() <= _SAME_POSE * far
    if len(frames) >= _FEWEST and same:
        raise UserError(
            f"{path}: all {len(frames)} frames have the same pose; R and t lead from the frame "
            "that turns with the object to the camera: where that stands still and the table "
            "turns, they differ from frame to frame"
        )


def refuse_too_few(kept: int, left_out: Sequence[str]) -> None:
    """A picture that was lost ends no scan, a folder that is wrong throughout does.

    Args:
        kept: number of those that can be used.
        left_out: of each of the others, why.

    Raises:
        UserError: the first reason, where fewer than a window or than half are left.
    """
    if left_out and kept < max(_FEWEST, len(left_out)):
        raise UserError(left_out[0])
