"""A camera, a turntable and an object on it, no board: images -> axis -> surface."""

from pathlib import Path

import numpy as np

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.photographs import open_pictures
from occ_recon_ros.bags.places import refuse_full
from occ_recon_ros.bags.turn_scanning import TurnPoses, find_turn
from occ_recon_ros.bags.views import BagViews, Progress
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.evaluation.image_quality import ImageQuality
from occ_recon_ros.evaluation.misplaced import Misplaced
from occ_recon_ros.evaluation.refinement import Refine
from occ_recon_ros.evaluation.segmentation import Segmentation

from .board_scan import reconstructed
from .progress import progress_bar
from .replay import Step
from .scan import ScanOptions

_UNEVEN_DEG = 1.5  # of the angles, that steps by hand are off


def scan_turn(
    source: str,
    turn_deg: float,
    distance: float,
    camera_file: Path | None,
    masks: Path | None,
    long_side: int,
    options: ScanOptions,
    quiet: bool,
) -> Report:
    """``scan --turn``: images of a turn in equal steps -> results as of ``replay``, with scan.mcap
    beside them; the arguments are those of the command.

    Raises:
        UserError: bad arguments or images; says what is wrong and what to do.
    """
    refuse_full(options.out, options.overwrite)
    pictures = open_pictures(source)
    with progress_bar("looking for outlines", quiet) as progress:
        found = find_turn(pictures, camera_file, masks, turn_deg, distance, progress)
    segmentation, refinement = Segmentation("auto"), Refine("on")
    steps: list[Step] = [segmentation, refinement]
    steps += [Misplaced(segmentation, refinement), Told(found, refinement), ImageQuality()]
    return reconstructed(found, pictures, steps, long_side, options, quiet)


class Told:
    """What was found of the axis, for the report of the scan, with a doubt where its steps turn out
    to be others than were told; none of what the correction of the poses mends."""

    name = "turn"

    def __init__(self, found: TurnPoses, refinement: Refine) -> None:
        self.report = found.report | {"names": list(found.names)}
        self._axis, self._refinement = found.axis, refinement

    def __call__(self, views: BagViews, progress: Progress) -> Changes:
        """Nothing to be changed."""
        warnings, report = list(self.report["warnings"]), self._refinement.report
        if self._axis.uneven and report["corrected"]:
            # It was corrected as views that were left out asked for.
            at = warnings.index(self._axis.uneven)
            left = report["after_px"]
            mended = left <= self._axis.fits_px
            also = f"{self._axis.uneven}, and with corrected poses to {left:.1f} px"
            warnings[at : at + 1] = [] if mended else [also]
        uneven = float(np.std(report.get("steps_deg", [0.0])))
        if uneven > _UNEVEN_DEG:
            warnings.append(
                f"the outlines ask for angles {uneven:.1f} degrees (1 sigma) off the equal steps "
                f"of --turn {self.report['turn_deg']:g}"
            )
        self.report["warnings"] = warnings
        return Changes()
