"""The camera's intrinsics from views of a printed board."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from occ_recon_ros.bags.photographs import open_pictures
from occ_recon_ros.bags.views import Progress
from occ_recon_ros.errors import UserError
from occ_recon_ros.poses.board import read_board
from occ_recon_ros.poses.camera_yaml import camera_to_yaml
from occ_recon_ros.poses.intrinsics import BoardView, calibrate_intrinsics, coverage_picture
from occ_recon_ros.poses.sequence import BoardSequence

_MOST_VIEWS = 60  # of a video: more say nothing new


def calibrate_camera(
    source: str,
    board_file: Path,
    out: Path,
    picture: Path | None,
    overwrite: bool,
    progress: Progress,
) -> list[str]:
    """Write camera_info YAML and a picture of where the corners were.

    Args:
        source: folder of photographs, or video file.
        board_file: board.yaml.
        out: file to write.
        picture: PNG to write; None: beside ``out``.
        overwrite: replace what is there.
        progress: told the images so far, and all of them.

    Returns:
        The result in words.

    Raises:
        UserError: bad input, or views that do not determine the camera.
    """
    picture = picture or out.with_suffix(".png")
    for path in (out, picture):
        if path.exists() and not overwrite:
            raise UserError(f"{path} is there: choose another --out or add --overwrite")
    try:
        sequence = BoardSequence(read_board(board_file))
    except ValueError as error:
        raise UserError(str(error)) from None
    pictures = open_pictures(source)
    size, count = (0, 0), 0
    for name, stamp, image in pictures:
        size = (image.shape[1], image.shape[0])
        sequence.add(name, stamp, image)
        count += 1
        progress(count, max(len(pictures), count))
    shots = sequence.shots[:: max(1, len(sequence.shots) // _MOST_VIEWS)]
    corners = sequence.board.corners
    views = [BoardView(s.name, corners[s.found.index], s.found.uv) for s in shots]
    if not views:
        raise UserError(f"{source}: {sequence.diagnosis()}")
    try:
        found = calibrate_intrinsics(views, size, pictures.focal_px())
    except ValueError as error:
        raise UserError(f"{source}: {error}") from None
    try:
        out.write_text(camera_to_yaml(found.camera), encoding="utf-8")
        cv2.imwrite(str(picture), coverage_picture(found, views))
    except OSError as error:
        raise UserError(f"cannot write {out}: {error.strerror}") from None
    word, numbers = found.verdict
    worst = np.argsort(found.view_rms_px)[::-1][:3]
    names = ", ".join(f"{found.views[k]} {found.view_rms_px[k]:.2f} px" for k in worst)
    return [
        f"{word}: {numbers}",
        f"{len(found.views)} of {count} images; farthest off: {names}; {found.rejected} wrong "
        "corners left out",
        f"{out}, {picture}",
    ]
