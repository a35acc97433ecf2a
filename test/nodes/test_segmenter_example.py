"""The example of an outside segmenter works as it stands."""

import importlib.util
from pathlib import Path

import numpy as np
from rig import SECOND, views

from msg_adapters import decode_contours

EXAMPLE = Path(__file__).parents[2] / "examples" / "segmenter.py"


def test_masks_of_an_outside_segmenter_make_the_contours(ros, graph):
    spec = importlib.util.spec_from_file_location("segmenter_example", EXAMPLE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    graph.rig.send(views()[0], SECOND)
    ros.spin_until(lambda: len(graph.rig.got["contours"]) == 1)
    ros.start(example.Segmenter)
    ros.spin_until(lambda: graph.tracker.publishers_of("mask/compressed"))
    graph.rig.send(views()[0], 2 * SECOND)
    ros.spin_until(lambda: len(graph.rig.got["contours"]) == 2)
    assert graph.tracker.drops == {}
    alone, by_mask = (decode_contours(msg) for msg in graph.rig.got["contours"])
    near = np.linalg.norm(alone.uv[:, None] - by_mask.uv, axis=2).min(axis=1)
    assert np.median(near) < 0.3
    assert near.max() < 3
