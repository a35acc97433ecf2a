"""A thing of two parts on a turntable, in image files with exact masks beside them."""

from pathlib import Path

import cv2

from occ_recon_ros.bags.frames import Frame
from occ_recon_ros.scene import TurntableSettings, render, turntable_cameras
from occ_recon_ros.scene.objects import SceneObject
from occ_recon_ros.scene.shapes import ball, limb
from occ_recon_ros.streams.alone import filled


def frames_of_two_parts(
    folder: Path, size: tuple[int, int], focal_px: float, radius: float
) -> list[Frame]:
    """Six frames of a leaning limb of a radius (metres) and a ball; size: (width, height) px."""
    leaning = limb((0.05, 0.0, -0.06), (-0.03, 0.03, 0.07), radius)
    thing = SceneObject("two parts", (leaning, ball((0.03, 0.02, 0.02), (-0.06, -0.02, -0.04))))
    turn = TurntableSettings(frames=6, step=1.0, width=size[0], height=size[1], focal_px=focal_px)
    found = []
    for k, camera in enumerate(turntable_cameras(turn)):
        loops = thing.exact_contours(camera)
        cv2.imwrite(str(folder / f"{k}.png"), render(thing, camera))
        cv2.imwrite(str(folder / f"m{k}.png"), filled(loops.by_loop(loops.uv), size[::-1]))
        found.append(Frame(folder / f"{k}.png", folder / f"m{k}.png", k + 1, camera))
    return found
