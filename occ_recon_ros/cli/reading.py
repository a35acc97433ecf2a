"""A bag as every command reads it: its topics, its poses, and what is to be said of it."""

import sys
from collections.abc import Iterable
from pathlib import Path

from occ_recon_ros.bags.poses import AS_USUAL, PoseReading
from occ_recon_ros.bags.views import BagViews

from .arguments import Values, parse_remaps, parse_settings, values_in_file


def open_views(
    path: Path, remaps: Iterable[str] = (), values: Values | None = None, params: Path | None = None
) -> BagViews:
    """The views of a bag; what of it is lost, or not used as it was recorded, goes to stderr.

    Args:
        path: of the bag.
        remaps: FROM:=TO, topics of the bag to be renamed.
        values: parameters; of contour_tracker object_frame, pose_sync and max_pose_gap count.
        params: YAML file of parameters, for those that are not among the values.

    Raises:
        UserError: no bag, topics that are missing, or frames that can never be whole.
    """
    tracker = {
        **values_in_file(params, "contour_tracker"),
        **(values or {}).get("contour_tracker", {}),
    }
    reading = PoseReading(
        str(tracker.get("object_frame", AS_USUAL.object_frame)),
        str(tracker.get("pose_sync", AS_USUAL.pose_sync)),
        int(tracker["max_pose_gap"] * 1e9) if "max_pose_gap" in tracker else None,
    )
    views = BagViews(path, parse_remaps(remaps), reading=reading)
    for words in filter(None, (views.bag.lost, *views.remarks())):
        print(f"warning: {path}: {words}", file=sys.stderr)
    return views


def told_views(
    path: Path, remaps: Iterable[str] | None, settings: Iterable[str] | None
) -> BagViews:
    """The same, of options as they were given: --remap, and --set."""
    return open_views(path, remaps or (), parse_settings(settings or ()))
