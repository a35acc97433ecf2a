"""What COLMAP and the makers of transforms.json have in common: lenses, files, order, masks."""

import re
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.poses.convention import FIRST_PIXEL, Ways

from .foreign_files import find_masks_beside
from .frames import MODEL_BY_COEFFICIENTS, Frame, Listing, even_stamp
from .image_sizes import same_shape
from .images import TURNED_BACK, orientation
from .mask_files import masks_may_go
from .photographs import by_number, image_size, images_in, is_mask_name

UNDISTORT = "undistort the images first, as with colmap image_undistorter, and take its new model"
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # OpenCV's order
_FISHEYE = ("k1", "k2", "k3", "k4")  # that of cv2.fisheye
_WINDOW = 3  # images, the fewest that are worth anything
_NAMED = 5  # files of those that are not used
_MAP_ENDING = re.compile(r"[._ -](depth|normals?)([._ -]?\d+)?$", re.IGNORECASE)
# By which two texts of one camera may differ:
_SAME_AXES = 1e-4  # each entry of R
_SAME_PLACE = 1e-4  # its place, as a share of how far from their middle the cameras usually are
_SAME_LENS = 1e-4  # each number of K and D, as a share of it
_SIXTH = 1e-6  # or of the same by the last of six decimals


@dataclass(frozen=True)
class Lens:
    """Intrinsics as others write them.

    Attributes:
        size: width and height of the images that they are of, pixels.
        values: fx, fy, cx, cy in pixels, (0, 0) being the corner of the first one; and of
            k1, k2, p1, p2, k3 to k6, as OpenCV has them, those that are not 0.
        fisheye: k1 to k4 are those of cv2.fisheye, our "equidistant".
    """

    size: tuple[int, int]
    values: Mapping[str, float]
    fisheye: bool = False


@dataclass(frozen=True)
class View:
    """One image as it is listed.

    Attributes:
        image: its file.
        lens: of the image, or of a larger or smaller copy.
        pose: R (3, 3) and t (3,), object -> camera, any unit.
        where: it is listed, in words.
        mask: its file, if it is listed too.
    """

    image: Path
    lens: Lens
    pose: tuple[Array, Array]
    where: str
    mask: Path | None = None

    def camera(self) -> Camera:
        """As our convention has it, for the image as large as it is.

        Raises:
            UserError: the image is of another shape than the calibration.
            ValueError: no camera.
        """
        listed, values = self.lens.size, self.lens.values
        there = image_size(self.image) or listed
        if not same_shape(listed, there):
            if not (same_shape(listed, there[::-1]) and orientation(self.image) in TURNED_BACK):
                raise UserError(
                    f"{self.image} is {there[0]}x{there[1]}, its calibration is of "
                    f"{listed[0]}x{listed[1]}: take the images that it was made with"
                )
            there = there[::-1]  # as the import turns it
        sx, sy = np.array(there) / listed
        cx, cy = sx * values["cx"] - FIRST_PIXEL, sy * values["cy"] - FIRST_PIXEL
        names = _FISHEYE if self.lens.fisheye else COEFFICIENTS
        D = np.array([values.get(name, 0.0) for name in names])
        D = D if D[5:].any() else D[:5] if D.any() else D[:0]
        model = MODEL_BY_COEFFICIENTS.get(len(D), "none")
        return Camera(
            K=np.array([[sx * values["fx"], 0, cx], [0, sy * values["fy"], cy], [0, 0, 1]]),
            width=there[0],
            height=there[1],
            R_camera_object=self.pose[0],
            t_camera_object=self.pose[1],
            D=D,
            distortion="equidistant" if self.lens.fisheye else model,
        )


def listed(
    source: Path,
    poses: str,
    views: Sequence[tuple[str, Callable[[], View]]],
    masks: Path | None,
    files: Container[str] | None = None,
    ways: Ways | None = None,
) -> Listing:
    """The frames of what others list, by name, numbers in names by value.

    Each image is taken once: of those that list it the first, in that order, whose camera can be
    used, and the first mask that any of them names.

    Args:
        source: the file or files, or the folder of the model.
        poses: which way its poses must lead, in words.
        views: name of each image, and what reads it or raises UserError.
        masks: the folder in which masks are looked for where none are listed; None: use none.
        files: names of the images that are there; None: each view says whether its image is.
        ways: what the poses may be instead, in words of the file; None: it has none for that.

    Raises:
        UserError: the masks that are there cannot be those of the images, or more views than
            there are images list one with another pose or lens than its first.
    """
    frames: list[Frame] = []
    left_out: list[str] = []
    scaled: list[str] = []
    firsts: dict[Path, Camera] = {}
    again: list[tuple[View, Camera]] = []
    drawn: dict[Path, Path] = {}
    views, lacking = _there(views, files, source)
    for _, view in sorted(views, key=lambda named: by_number(named[0])):
        try:
            found = view()
            with wrong_in(found.where):
                camera = found.camera()
        except UserError as error:
            left_out.append(str(error))
            continue
        if masks is not None and found.mask is not None:
            drawn.setdefault(found.image, found.mask)
        if firsts.setdefault(found.image, camera) is not camera:
            again.append((found, camera))
            continue
        frames.append(Frame(found.image, None, even_stamp(len(frames) + len(left_out)), camera))
        if (size := (camera.width, camera.height)) != found.lens.size:
            scaled.append("{}x{}, not {}x{}".format(*size, *found.lens.size))
    repeated = _repeated(firsts, again) if again else []
    if masks is not None and not drawn:
        with masks_may_go():
            drawn = find_masks_beside([frame.image for frame in frames], masks)
    frames = [replace(frame, mask=drawn.get(frame.image)) for frame in frames]
    remarks = lacking + _without_camera(source, frames) + repeated
    if scaled:
        remarks.append(
            f"{len(scaled)} images are of another size than their calibration ({scaled[0]}): "
            "K is scaled to theirs"
        )
    return Listing(source, poses, frames, left_out, remarks, ways=ways)


def _there(
    views: Sequence[tuple[str, Callable[[], View]]], files: Container[str] | None, source: Path
) -> tuple[Sequence[tuple[str, Callable[[], View]]], list[str]]:
    """The views whose images are there, and what is to be said of many others: who takes every
    fourth photograph of a model leaves the model as it is."""
    there = [view for view in views if files is None or not view[0] or view[0] in files]
    lacking = [*dict.fromkeys(name for name, _ in views if name and name not in (files or ()))]
    if len(there) < _WINDOW or len(there) == len(views) or len(lacking) <= _NAMED:
        return views, []
    return there, [
        f"{len(lacking)} images of {source} are not there ({', '.join(lacking[:_NAMED])}, ...): "
        "the others are taken"
    ]


def _repeated(firsts: Mapping[Path, Camera], again: Sequence[tuple[View, Camera]]) -> list[str]:
    """What is to be said of views of images that were taken already.

    Raises:
        UserError: more of them than there are images are not as the first.
    """
    centres = np.array([c.centre for c in (*firsts.values(), *(camera for _, camera in again))])
    spread = np.median(np.linalg.norm(centres - np.median(centres, axis=0), axis=1))
    views: dict[bool, list[View]] = {True: [], False: []}
    for view, camera in again:
        views[_same(firsts[view.image], camera, float(spread))].append(view)
    remarks = []
    if same := views[True]:
        said = _listed_again(same, "the same pose and lens")
        remarks.append(f"{said}: each image is taken once")
    if contrary := views[False]:
        said = _listed_again(contrary, "another pose or lens")
        if len(contrary) > len(firsts):
            raise UserError(said)
        remarks.append(f"{said}: the first counts")
    return remarks


def _same(one: Camera, other: Camera, spread: float) -> bool:
    """Whether two cameras are one but for what digits that were left out make.

    Args:
        one: as it is listed first.
        other: as it is listed again.
        spread: of the centres of all, in their unit.
    """
    turned = np.abs(one.R_camera_object - other.R_camera_object).max()
    moved = np.linalg.norm(one.centre - other.centre)
    return bool(
        turned <= _SAME_AXES
        and moved <= _SAME_PLACE * spread
        and one.distortion == other.distortion
        and one.D.shape == other.D.shape
        and np.allclose(one.K, other.K, rtol=_SAME_LENS, atol=_SIXTH)
        and np.allclose(one.D, other.D, rtol=_SAME_LENS, atol=_SIXTH)
    )


def _listed_again(views: Sequence[View], what: str) -> str:
    count = f"{len(views)} frames list" if len(views) > 1 else "1 frame lists"
    first = f"{views[0].where}: {views[0].image}"
    return f"{count} an image that an earlier frame lists, with {what} ({first})"


def _is_map(stem: str, stems: Container[str]) -> bool:
    """Whether a file is called a map of depths or normals of another one there."""
    ending = _MAP_ENDING.search(stem)
    return ending is not None and stem[: ending.start()] in stems


def _without_camera(source: Path, frames: Sequence[Frame]) -> list[str]:
    """A sentence on the images beside these; masks of images and maps of their depths or normals
    (r_0_depth_0001.png) are none."""
    known = {path for frame in frames for path in (frame.image, frame.mask)}
    others: list[str] = []
    for folder in dict.fromkeys(frame.image.parent for frame in frames):
        there = images_in(folder)
        stems = {path.stem for path in there}
        unknown = [p for p in there if p not in known and not is_mask_name(p.name)]
        others += [p.name for p in unknown if not _is_map(p.stem, stems)]
    others.sort(key=by_number)
    if not others:
        return []
    more = ", ..." if len(others) > _NAMED else ""
    return [
        f"{len(others)} images have no camera in {source} that can be used: "
        f"{', '.join(others[:_NAMED])}{more}"
    ]
