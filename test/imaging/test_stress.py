"""The snake where a threshold fails: all that makes contours hard to find, at once."""

import numpy as np
from contour_cases import stress_distances, stress_frames


def test_the_snake_keeps_to_the_outline_where_it_is_seen_and_near_it_elsewhere():
    frames = stress_frames("all at once", 12)
    seen, unseen, drops = stress_distances(frames, "snake")
    _, unseen_plainly, _ = stress_distances(frames, "none")
    print(f"{seen.mean():.3f} px where seen, {unseen.mean():.2f} elsewhere")
    assert drops == 0
    assert len(unseen) > 0.1 * len(seen)
    assert seen.mean() < 0.35
    assert unseen.mean() < unseen_plainly.mean() / 3
    assert np.percentile(seen, 99) < 2
