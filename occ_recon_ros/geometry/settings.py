"""How rims are computed: the settings, with what a user must know of each."""

from dataclasses import dataclass, field

from .estimators import ESTIMATORS


@dataclass(frozen=True)
class RimSettings:
    """How rims are computed."""

    estimator: str = field(
        default="osculating_quadric",
        metadata={
            "doc": "What computes depth and curvature: osculating_quadric, the paper's, from "
            "three frames; circle_epipolar and circle_radial, which it is compared with; "
            "linear_smoother and multi_frame use all frames within the baseline, up to frames.",
            "choices": tuple(ESTIMATORS),
        },
    )
    frames: int = field(
        default=10,
        metadata={
            "doc": "Most partners on each side for linear_smoother and multi_frame, spread "
            "over the frames within the baseline.",
            "low": 1,
            "high": 100,
        },
    )
    baseline: float = field(
        default=0.14,
        metadata={
            "doc": "Least angle between a frame and its two partners, rad; the nearest "
            "frames that are at least this far are used. About 10 degrees is best for "
            "contours of 0.1 px; the default keeps next neighbours partners on a table that "
            "turns by 10 degrees a frame, which seen from 35 degrees above is 8.",
            "low": 0.001,
            "high": 1.0,
        },
    )
    amplification: float = field(
        default=12.0,
        metadata={
            "doc": "How much worse than two crossing rays the three contours may fix a depth "
            "before it is ill-conditioned (status 2): near frontier points, where the "
            "contour runs along the epipolar plane, and where a_-1 is near a_1. Seen square "
            "on, a point has about 0.7.",
            "low": 1.0,
            "high": 1e6,
        },
    )
    silhouette_tolerance: float = field(
        default=0.6,
        metadata={
            "doc": "Pixels that a rim point may project outside another silhouette before "
            "it is given up (status 4); more where poses or calibration are seen to be off.",
            "low": 0.0,
            "high": 100.0,
        },
    )
    silhouette_checks: int = field(
        default=9,
        metadata={
            "doc": "Most silhouettes of other frames that each rim point is held against at "
            "once, spread over all frames so far; four times as many when the turn is "
            "finished.",
            "low": 0,
            "high": 1000,
        },
    )
    frames_kept: int = field(
        default=720,
        metadata={
            "doc": "Frames kept between the first and the last few, to hold rim points against "
            "their silhouettes and to revise their rims when the turn is finished; of more, "
            "every second is forgotten. A frame of 1,000 samples takes 0.15 MB.",
            "low": 20,
            "high": 100000,
        },
    )
