"""Virtual turntable: analytic objects with exact rims, rendered to images."""

from .catalogue import OBJECTS, make_object
from .coverage import coverage
from .edge_on import seen_edge_on
from .mesh_part import mesh_object
from .objects import SceneObject
from .paper import noisy, paper_sphere
from .paths import hand_held_cameras, looking_at
from .render import RenderSettings, render, silhouette_loops
from .silhouette import Silhouette
from .stress import BAD_LENS, StressFrame, StressSettings, stress_sequence
from .turntable import TurntableSettings, turntable_cameras

__all__ = [
    "BAD_LENS",
    "OBJECTS",
    "RenderSettings",
    "SceneObject",
    "Silhouette",
    "StressFrame",
    "StressSettings",
    "TurntableSettings",
    "coverage",
    "hand_held_cameras",
    "looking_at",
    "make_object",
    "mesh_object",
    "noisy",
    "paper_sphere",
    "render",
    "seen_edge_on",
    "silhouette_loops",
    "stress_sequence",
    "turntable_cameras",
]
