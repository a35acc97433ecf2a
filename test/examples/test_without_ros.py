"""The example for people without ROS, run as a program that cannot import any of ROS."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import trimesh

from occ_recon_ros.scene import TurntableSettings, make_object, render, turntable_cameras

ROOT = Path(__file__).resolve().parents[2]
WITHOUT_ROS = """
import runpy, sys

class NoRos:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "rclpy" or name.split(".")[0].endswith("_msgs"):
            raise ModuleNotFoundError(f"No module named {name!r} here")

sys.meta_path.insert(0, NoRos())
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""
SETTINGS = TurntableSettings(frames=12, step=2 * np.pi / 12, width=320, height=240, focal_px=400.0)


def test_a_folder_of_images_becomes_a_body(tmp_path):
    vase, frames = make_object("vase"), []
    for k, camera in enumerate(turntable_cameras(SETTINGS)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), render(vase, camera))
        frames.append(
            {
                "file": f"{k}.png",
                "K": camera.K.tolist(),
                "R": camera.R_camera_object.tolist(),
                "t": (1e3 * camera.t_camera_object).tolist(),
            }
        )
    described = {"unit_in_metres": 1e-3, "frames": frames}
    (tmp_path / "cameras.json").write_text(json.dumps(described))
    example = str(ROOT / "examples" / "without_ros.py")
    command = [sys.executable, "-c", WITHOUT_ROS, example, str(tmp_path), str(tmp_path / "v.ply")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=300)
    assert done.returncode == 0, done.stderr
    body = trimesh.load_mesh(tmp_path / "v.ply", process=False)
    assert body.is_watertight
    # A pixel is 2.5 mm at the object. The caps, which no view sees edge-on, are less good.
    off_mm = 1e3 * np.abs(vase.distance(np.asarray(body.vertices)))
    assert np.median(off_mm) < 0.25
    assert np.percentile(off_mm, 90) < 2.5
