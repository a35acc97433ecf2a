"""How rims are computed: the settings, with what a user must know of each."""

from dataclasses import dataclass, field
from typing import Any

from .estimators import ESTIMATORS


def setting(default: Any, doc: str, **limits: Any) -> Any:
    """A field of settings, from which a ROS parameter with its description and checks is made.

    Args:
        default: of the type of the field.
        doc: what it means, with its unit.
        limits: ``within``, the least and the largest number; ``choices``; ``read_only``, whether
            it can be given at the start alone.
    """
    return field(default=default, metadata={"doc": doc, **limits})


@dataclass(frozen=True)
class RimSettings:
    """How rims are computed."""

    estimator: str = setting(
        "osculating_quadric",
        "What computes depth and curvature: osculating_quadric, the paper's, from "
        "three frames; circle_epipolar and circle_radial, which it is compared with; "
        "linear_smoother and multi_frame use all frames within the baseline, up to frames.",
        choices=tuple(ESTIMATORS),
    )
    frames: int = setting(
        10,
        "Most partners on each side for linear_smoother and multi_frame, spread "
        "over the frames within the baseline.",
        within=(1, 100),
    )
    baseline: float = setting(
        0.14,
        "Least angle between a frame and its two partners, rad; the nearest "
        "frames that are at least this far are used. About 10 degrees is best for "
        "contours of 0.1 px; the default keeps next neighbours partners on a table that "
        "turns by 10 degrees a frame, which seen from 35 degrees above is 8.",
        within=(0.001, 1.0),
    )
    amplification: float = setting(
        12.0,
        "How much worse than two crossing rays the three contours may fix a depth "
        "before it is ill-conditioned (status 2): near frontier points, where the "
        "contour runs along the epipolar plane, and where a_-1 is near a_1. Seen square "
        "on, a point has about 0.7.",
        within=(1.0, 1e6),
    )
    silhouette_tolerance: float = setting(
        0.6,
        "Pixels that a rim point may project outside another silhouette before "
        "it is given up (status 4); more where poses or calibration are seen to be off.",
        within=(0.0, 100.0),
    )
    silhouette_checks: int = setting(
        9,
        "Most silhouettes of other frames that each rim point is held against at "
        "once, spread over all frames so far; four times as many when the turn is "
        "finished.",
        within=(0, 1000),
    )
    frames_kept: int = setting(
        720,
        "Frames kept between the first and the last few, to hold rim points against "
        "their silhouettes and to revise their rims when the turn is finished; of more, "
        "every second is forgotten. A frame of 1,000 samples takes 0.15 MB.",
        within=(20, 100000),
    )
