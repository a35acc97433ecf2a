"""A camera, a printed board and an object on it: images -> poses -> surface."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.photographs import CameraPictures, Pictures, open_pictures
from occ_recon_ros.bags.places import refuse_full, work_beside, write_file
from occ_recon_ros.bags.scan_bag import made_small_lines, write_scan_bag
from occ_recon_ros.bags.scanning import ScanPoses, by_place, find_poses, read_rig, with_masks
from occ_recon_ros.bags.turn_scanning import TurnPoses
from occ_recon_ros.bags.views import BagViews, Progress
from occ_recon_ros.errors import UserError
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.evaluation.image_quality import ImageQuality
from occ_recon_ros.evaluation.misplaced import Misplaced
from occ_recon_ros.evaluation.refinement import Refine
from occ_recon_ros.evaluation.second_look import SecondLook
from occ_recon_ros.evaluation.segmentation import Segmentation
from occ_recon_ros.poses.board_backdrop import BoardBackdrop
from occ_recon_ros.poses.camera_yaml import camera_to_yaml

from .progress import progress_bar
from .replay import BagSource, Step
from .scan import ScanOptions, run_scan

BAG = "scan.mcap"
CAMERA = "camera.yaml"
ON_BOARD = ("contour_tracker.volume_kind=plane",)  # that of the board's frame, z to the object
_STEPS_DEG = {"folder": 0.5, "video": 3.0}


def scan_on_board(
    source: str | None,
    camera_index: int | None,
    board_file: Path,
    camera_file: Path | None,
    masks: Path | None,
    step_deg: float | None,
    long_side: int,
    options: ScanOptions,
    quiet: bool,
) -> Report:
    """``scan --board``: images of an object on a board -> results as of ``replay``, with scan.mcap
    beside them; the arguments are those of the command.

    Raises:
        UserError: bad arguments or images; says what is wrong and what to do.
    """
    board, camera = read_rig(board_file, camera_file)
    if (source is None) == (camera_index is None):
        raise UserError("give a folder of photographs, a video file, or --camera N")
    refuse_full(options.out, options.overwrite)
    if camera_index is not None:
        pictures: Pictures = CameraPictures(camera_index)
        print("turn the object once; Ctrl-C when the turn is complete", file=sys.stderr)
        kind = "video"
    else:
        assert source is not None
        pictures = open_pictures(source)
        kind = "folder" if Path(source).is_dir() else "video"
    step = np.deg2rad(_STEPS_DEG[kind] if step_deg is None else step_deg)
    with progress_bar("looking for the board", quiet) as progress:
        found = find_poses(pictures, board, camera, float(step), progress)
    found, pictures = by_place(found, pictures)
    if masks is not None:
        found = with_masks(found, masks, pictures)
    # The print is as rigid as the object: no disagreement of outlines tells of it.
    bare = len(found.masks) < len(found.names)
    backdrop = BoardBackdrop(found.poses.board) if bare else None
    segmentation = Segmentation("auto" if found.masks else "joint", backdrop=backdrop)
    poses = Refine("auto")
    steps: list[Step] = [segmentation, poses, SecondLook(segmentation, poses)]
    steps += [Misplaced(segmentation, poses), Posed(found), ImageQuality()]
    options = replace(options, assignments=[*ON_BOARD, *options.assignments])
    return reconstructed(found, pictures, steps, long_side, options, quiet)


class Posed:
    """What was found of the board, for the report of the scan."""

    name = "board"

    def __init__(self, found: ScanPoses) -> None:
        self.report = found.report | {"names": found.names}

    def __call__(self, views: BagViews, progress: Progress) -> Changes:
        """Nothing to be changed."""
        return Changes()


def reconstructed(
    found: ScanPoses | TurnPoses,
    pictures: Pictures,
    steps: Sequence[Step],
    long_side: int,
    options: ScanOptions,
    quiet: bool,
) -> Report:
    """Images with poses -> results as of ``replay``, with the bag and the camera beside them.

    Args:
        found: the poses.
        pictures: that they are of.
        steps: what is looked for in the views before they are played.
        long_side, options, quiet: as of ``scan_on_board``.

    Raises:
        UserError: no surface came of it; the bag is kept then.
    """
    out, camera = options.out, found.camera
    for line in () if quiet else [*found.lines, *made_small_lines(camera, long_side)]:
        print(line, flush=True)
    with work_beside(out, ".scan") as work:
        try:
            with progress_bar("writing", quiet) as progress:
                posed = found.posed(pictures)
                write_scan_bag(posed, len(found.names), work / BAG, progress, long_side)
                progress.stage("reconstructing")
                source_bag = BagSource(work / BAG, steps=steps)
                report = run_scan(source_bag, replace(options, progress=progress))
        except BaseException:
            # The images and their poses are not lost: replay can be tried with other parameters.
            keep = out.with_name(f"{out.name}.mcap")
            if (work / BAG).exists() and not keep.exists():
                (work / BAG).replace(keep)
                print(f"images and poses are kept in {keep}", file=sys.stderr)
            raise
        # As it was reconstructed, so that evaluate, render and replay go on from there.
        source_bag.write(out / BAG, options.overwrite)
        write_file(out / CAMERA, camera_to_yaml(camera).encode())
    return report
