"""Virtual turntable: analytic objects with exact rims, rendered to images."""

from .catalogue import OBJECTS, make_object
from .coverage import coverage
from .objects import SceneObject
from .render import RenderSettings, render, silhouette_loops
from .silhouette import Silhouette
from .turntable import TurntableSettings, turntable_cameras

__all__ = [
    "OBJECTS",
    "RenderSettings",
    "SceneObject",
    "Silhouette",
    "TurntableSettings",
    "coverage",
    "make_object",
    "render",
    "silhouette_loops",
    "turntable_cameras",
]
