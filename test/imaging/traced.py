"""Ellipsoids that a camera sees, traced ray by ray; and a solution of the joint pass to ask of."""

import numpy as np

from occ_recon_ros.imaging.joint.colours import COUNT
from occ_recon_ros.imaging.joint.models import Models
from occ_recon_ros.imaging.joint.solve import Solution


def rays_of(camera):
    """(h w, 3) unit, viewing directions of all pixels, row by row."""
    Y, X = np.mgrid[: camera.height, : camera.width]
    return camera.viewing_directions(np.column_stack([X.ravel(), Y.ravel()]).astype(float))


def met(camera, rays, sizes, middle=(0.0, 0.0, 0.0)):
    """(n,) metres along rays to an ellipsoid of half axes (3,), infinite where they pass it."""
    a, b = rays / sizes, (camera.centre - middle) / sizes
    half, square = (a * b).sum(axis=1), (a * a).sum(axis=1)
    root = half**2 - square * (b @ b - 1)
    near = (-half - np.sqrt(np.maximum(root, 0))) / square
    return np.where(root > 0, near, np.inf)


def solution(grid, body, total, solid, said, **known):
    """A solution of which nothing is known but what is given."""
    parts = {
        "models": Models(np.zeros(COUNT), np.zeros(COUNT), [[] for _ in said]),
        "outlines": [],
        "outside": [],
        "footprint": 2.0,
        "ground": None,
        "refuted": [False] * len(said),
        "blur": 1.0,
    }
    parts |= {"saying": said, "outlining": said} | known
    return Solution(grid, body, total, solid, **parts)
