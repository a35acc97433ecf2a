"""Scenes that tests and benchmarks alone need."""

from .edge_on import seen_edge_on
from .mesh_part import mesh_object
from .paper import noisy, paper_sphere
from .paths import hand_held_cameras, looking_at
from .printed import printed_sheet
from .stress import BAD_LENS, StressFrame, StressSettings, stress_sequence

__all__ = [
    "BAD_LENS",
    "StressFrame",
    "StressSettings",
    "hand_held_cameras",
    "looking_at",
    "mesh_object",
    "noisy",
    "paper_sphere",
    "printed_sheet",
    "seen_edge_on",
    "stress_sequence",
]
