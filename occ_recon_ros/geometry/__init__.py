"""The paper's geometry in NumPy: viewing directions, epipolar correspondence, depth, checks."""

from .camera import DISTORTION_MODELS, Camera
from .contours import Contours
from .reconstruct import RimReconstructor
from .rim import Rim, Status
from .settings import RimSettings
from .silhouette import Silhouette
from .viewing import contours_from_loops

__all__ = [
    "DISTORTION_MODELS",
    "Camera",
    "Contours",
    "Rim",
    "RimReconstructor",
    "RimSettings",
    "Silhouette",
    "Status",
    "contours_from_loops",
]
