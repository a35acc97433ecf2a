"""The strips of whole scans, from images: what the mesh of the strips may be relied on for."""

import cv2
import numpy as np
import pytest
from scipy.ndimage import median_filter

from occ_recon_ros.bags.dataset import load_dataset
from occ_recon_ros.geometry import RimReconstructor
from occ_recon_ros.imaging import ContourTracker
from occ_recon_ros.scene import TurntableSettings, make_object, render, turntable_cameras
from occ_recon_ros.surface import SurfaceSettings, zip_rims


def rims_of(frames):
    """Final rims by stamp of (image, camera, mask) in a full turn."""
    tracker, reconstructor = ContourTracker(), RimReconstructor()
    rims = []
    for k, (image, camera, mask) in enumerate(frames):
        rims += reconstructor.add(tracker.process(image, camera, k + 1, "object", mask))
    return {rim.stamp_ns: rim for rim in rims + reconstructor.finish()}


def scene(name):
    thing = make_object(name)
    settings = TurntableSettings(
        frames=24, step=np.radians(15), width=320, height=240, focal_px=400.0
    )
    return [(render(thing, camera), camera, None) for camera in turntable_cameras(settings)]


def dinosaur(shared_data):
    frames, _, _ = load_dataset(shared_data / "oxford_dino")
    return [
        (cv2.imread(str(f.image)), f.camera, cv2.imread(str(f.mask), cv2.IMREAD_GRAYSCALE))
        for f in frames
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["vase", "mug", "torus", "dinosaur"])
def test_strips_are_sheets_that_face_outward_and_span_nothing_wide(name, request):
    frames = dinosaur(request.getfixturevalue("shared_data")) if name == "dinosaur" else scene(name)
    rims, triangles, wide, links = rims_of(frames), 0, 0, 0
    for rim in rims.values():
        previous = rims[rim.prev_stamp_ns]
        strip = zip_rims(rim, previous, SurfaceSettings().longest_step)
        triangles += len(strip)
        points = np.concatenate([rim.points, previous.points])
        normals = np.concatenate([rim.normals, previous.normals])

        sides = np.sort(strip[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, count = np.unique(sides, axis=0, return_counts=True)
        assert count.max() <= 2

        a, b, c = (points[strip[:, k]] for k in range(3))
        facing = np.cross(b - a, c - a)
        assert (np.einsum("tk,tck->tc", facing, normals[strip]) > 0).all()

        # Edges in the order of the rim; the spacing along it, and between the two rims about
        # an edge.
        length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        across = (edges[:, 0] < len(rim)) & (edges[:, 1] >= len(rim))
        along = np.median(length[~across])
        spacing = np.maximum(along, median_filter(length[across], 15, mode="mirror"))
        wide += int((length[across] > 5 * spacing).sum())
        links += int(across.sum())
        # The limit goes by the median of each rim, which is near that of both.
        assert (length[~across] <= 1.05 * SurfaceSettings().longest_step * along).all()
        # Not by leaving out what is not easy.
        good = (rim.status == 0) & np.isfinite(rim.prev)
        assert len(strip) > 1.2 * np.count_nonzero(good)
    assert triangles > 4_000
    # Spikes and teeth of the recorded figure now and then give one; smooth bodies none.
    assert wide <= (1e-3 * links if name == "dinosaur" else 0), (wide, links)
