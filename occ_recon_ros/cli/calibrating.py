"""The camera's intrinsics, and the axis of a turntable, from views of a printed board."""

from pathlib import Path

import cv2
import numpy as np

from occ_recon_ros.bags.photographs import Pictures, open_pictures
from occ_recon_ros.bags.places import refuse_existing, write_file
from occ_recon_ros.bags.scanning import look_at_all, read_rig
from occ_recon_ros.bags.turning import BagPictures, TurningBag
from occ_recon_ros.bags.views import Progress
from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.poses.axis import AxisFit, calibrate_axis, turntable_to_yaml
from occ_recon_ros.poses.camera_yaml import camera_to_yaml
from occ_recon_ros.poses.coverage import coverage_picture
from occ_recon_ros.poses.sequence import BoardSequence, board_views, distinct
from occ_recon_ros.poses.sheet_zoom import some_of

_AXIS_STEP_DEG = 2.0  # images nearer than this say nothing new of the axis
_GOOD_DIRECTION_DEG, _GOOD_POINT_MM = 0.02, 0.05
_MOST_VIEWS = 60  # of a video: more say nothing new


def calibrate_camera(
    source: str,
    board_file: Path,
    out: Path,
    picture: Path | None,
    overwrite: bool,
    progress: Progress,
) -> list[str]:
    """``calibrate intrinsics``: write camera_info YAML and a picture of where the corners were.

    ``progress`` is told the images so far, and all of them. Returns the result in words.

    Raises:
        UserError: bad input, or views that do not determine the camera.
    """
    picture = picture or out.with_suffix(".png")
    refuse_existing((out, picture), overwrite)
    pictures: Pictures = BagPictures(Path(source)) if _is_bag(source) else open_pictures(source)
    board, _ = read_rig(board_file, for_poses=False)
    sequence = BoardSequence(board, pictures.size)
    count = look_at_all(pictures, sequence, progress)
    shots = sequence.shots[:: max(1, len(sequence.shots) // _MOST_VIEWS)]
    if not shots:
        raise UserError(f"{source}: {sequence.diagnosis()}")
    different = distinct(shots, sequence.size)
    alone = {shot.name for shot in different}
    copies = [shot.name for shot in shots if shot.name not in alone]
    counted = _copies_words(copies)
    corners = sequence.board.corners
    with wrong_in("; ".join([source, *counted])):
        sequence.refuse_other_layout()
        found = sequence.calibrated(different, corners, pictures.focal_px())
        sequence.refuse_other_markers(found.camera, different)
    views = board_views(different, corners)
    write_file(out, camera_to_yaml(found.camera).encode())
    write_file(picture, cv2.imencode(".png", coverage_picture(found, views))[1].tobytes())
    word, numbers = found.verdict
    worst = np.argsort(found.view_rms_px)[::-1][:3]
    names = ", ".join(f"{found.views[k]} {found.view_rms_px[k]:.2f} px" for k in worst)
    return [
        f"{word}: {numbers}",
        f"{len(found.views)} of {count} images; farthest off: {names}; {found.rejected} wrong "
        "corners left out",
        *counted,
        f"{out}, {picture}",
    ]


def _copies_words(names: list[str]) -> list[str]:
    """Images that show what others do, in words; nothing where there are none."""
    if not names:
        return []
    count = "1 image is a copy" if len(names) == 1 else f"{len(names)} images are copies"
    return [f"{count} of what another shows, and left out ({some_of(names)})"]


def calibrate_turntable(
    source: str,
    board_file: Path,
    camera_file: Path | None,
    joint: str,
    out: Path,
    overwrite: bool,
    progress: Progress,
) -> list[str]:
    """``calibrate axis``: write the YAML of turntable_pose from images of a board on the table.

    ``progress`` is told the images so far, and all of them. Returns the result in words.

    Raises:
        UserError: bad input, or images that do not determine the axis.
    """
    refuse_existing((out,), overwrite)
    board, camera = read_rig(board_file, camera_file)
    bag = TurningBag(Path(source)) if _is_bag(source) else None
    pictures = bag if bag is not None else open_pictures(source)
    sequence = BoardSequence(board, pictures.size)
    count = look_at_all(pictures, sequence, progress)
    camera = camera or (bag.camera if bag is not None else None)
    encoder = bag.joint_angles(joint) if bag is not None else None
    with wrong_in(source):
        posed = sequence.solve(camera, None, float(np.deg2rad(_AXIS_STEP_DEG))).kept
        stamps = [p.shot.stamp_ns for p in posed]
        angles = encoder.at(stamps) if encoder is not None else np.zeros(len(posed))
        known = np.isfinite(angles)
        posed = [p for p, there in zip(posed, known, strict=True) if there]
        found = calibrate_axis(
            [p.pose.pose for p in posed],
            [p.pose.covariance for p in posed],
            angles[known] if encoder is not None else None,
            encoder.joint if encoder is not None else joint,
        )
    lines = _axis_words(found, [p.shot.name for p in posed], count, encoder is not None)
    write_file(out, turntable_to_yaml(found.table, "\n".join(lines)).encode())
    return [*lines, str(out)]


def _axis_words(found: AxisFit, names: list[str], images: int, encoder: bool) -> list[str]:
    good = (
        found.sigma_direction_deg <= _GOOD_DIRECTION_DEG
        and found.sigma_point_mm <= _GOOD_POINT_MM
        and not found.slips
    )
    poor = found.sigma_direction_deg > 10 * _GOOD_DIRECTION_DEG
    word = "good" if good else "poor" if poor else "fair"
    d, p = found.table.direction, 1e3 * found.table.point
    turned = np.rad2deg(np.ptp(np.unwrap(found.angles)))
    lines = [
        f"{word}: axis along ({d[0]:.5f} {d[1]:.5f} {d[2]:.5f}) +- "
        f"{found.sigma_direction_deg:.3f} deg, through ({p[0]:.3f} {p[1]:.3f} {p[2]:.3f}) +- "
        f"{found.sigma_point_mm:.3f} mm of the board",
        f"{len(names)} of {images} images over {turned:.0f} degrees; off the circle by "
        f"{np.median(found.residual_mm):.3f} mm and {np.median(found.residual_deg):.4f} deg in "
        f"the median, farthest {names[int(found.residual_mm.argmax())]} by "
        f"{found.residual_mm.max():.3f} mm",
    ]
    if not good and not found.slips:
        lines.append("to do: turn further, in more steps, with the board nearer or larger")
    if not encoder:
        lines.append(
            "no joint_states: the joint's zero is taken to be the first image, its sense that of "
            "the axis; record joint_states to have them found"
        )
        return lines
    sense = "with" if found.table.ratio > 0 else "against"
    lines.append(
        f"the joint counts {sense} the axis; off by "
        f"{np.median(np.abs(found.encoder_residual_deg)):.3f} deg in the median"
    )
    for k in found.slips:
        lines.append(
            f"the encoder slipped before {names[k]} (angle {np.rad2deg(found.angles[k]):.1f} deg) "
            f"by {found.encoder_residual_deg[k] - found.encoder_residual_deg[k - 1]:.2f} deg"
        )
    return lines


def _is_bag(source: str) -> bool:
    return source.endswith((".mcap", ".db3")) or (Path(source) / "metadata.yaml").is_file()
