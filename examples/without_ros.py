"""Images and their cameras to a surface, without ROS.

    python examples/without_ros.py FOLDER OUT.ply

FOLDER has a cameras.json as `occ-recon import` takes it: each image with K, D, R and t.
"""

import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera, RimReconstructor
from occ_recon_ros.imaging import ContourTracker
from occ_recon_ros.surface import Surface
from occ_recon_ros.surface.closing import close_surface

View = tuple[NDArray[np.uint8], Camera]


def rebuild(views: Iterable[View]) -> tuple[trimesh.Trimesh, trimesh.Trimesh]:
    """The strips between the rims, and the closed body, in metres in the object frame."""
    tracker, reconstructor, surface = ContourTracker(), RimReconstructor(), Surface()
    contours, rims = [], {}
    for k, (image, camera) in enumerate(views):
        contours.append(tracker.process(image, camera, stamp_ns=k, frame_id="object"))
        rims |= {rim.stamp_ns: rim for rim in reconstructor.add(contours[-1])}
    rims |= {rim.stamp_ns: rim for rim in reconstructor.finish()}  # closes the turn
    for stamp_ns in sorted(rims):
        surface.add(rims[stamp_ns])
    return surface.mesh(), close_surface(contours, [rims[stamp_ns] for stamp_ns in sorted(rims)])


def read(folder: Path) -> Iterator[View]:
    """The views of a folder, in the order of cameras.json."""
    described = json.loads((folder / "cameras.json").read_text())
    for frame in described["frames"]:
        K, R, t, D = (np.array(frame.get(name) or [], float) for name in ("K", "R", "t", "D"))
        image = np.asarray(cv2.imread(str(folder / frame["file"])), np.uint8)
        height, width = image.shape[:2]
        lens = "plumb_bob" if len(D) else "none"
        yield image, Camera(K, width, height, R, t * described["unit_in_metres"], D, lens)


if __name__ == "__main__":
    strips, body = rebuild(read(Path(sys.argv[1])))
    body.export(sys.argv[2])
    print(f"{sys.argv[2]}: {len(body.faces)} triangles, {1e6 * body.volume:.1f} ml")
