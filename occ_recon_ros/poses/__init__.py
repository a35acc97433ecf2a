"""Poses of a camera from a printed board, an encoder or a tree of transforms. No ROS.

OpenCV finds the board; the rest is NumPy. The board frame: origin in the middle of the pattern,
x right and y up as the sheet is read, z out of the paper.
"""

from .board import BoardSpec, board_from_mapping, board_to_yaml, read_board
from .board_pose import BoardPose, candidate_poses
from .detect import BoardDetector, Detection, is_mirrored, other_dictionary
from .sheet import PAPER_MM, sheet_pdf

__all__ = [
    "PAPER_MM",
    "BoardDetector",
    "BoardPose",
    "BoardSpec",
    "Detection",
    "board_from_mapping",
    "board_to_yaml",
    "candidate_poses",
    "is_mirrored",
    "other_dictionary",
    "read_board",
    "sheet_pdf",
]
