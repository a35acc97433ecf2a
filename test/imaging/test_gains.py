"""Light and white balance that change from image to image are told by the backdrop."""

import numpy as np
import pytest
from discs import camera_for

from occ_recon_ros.imaging.joint import JointSegmenter
from occ_recon_ros.imaging.joint.gains import gains_between

FACTORS = 1 + 0.2 * np.random.default_rng(4).uniform(-1, 1, (12, 3))


def images(factors, still=True, backdrop=90.0):
    """A room with an object in the middle that turns, or one that is carried past as well."""
    rng = np.random.default_rng(3)
    room, found = rng.uniform(0.5, 1.5, (60, 80, 3)) * backdrop, []
    for k, factor in enumerate(factors):
        image = room if still else np.roll(room, 5 * k, axis=1)
        image = image.copy()
        image[20:40, 30:50] = rng.uniform(60, 200, (20, 20, 3))
        found.append(np.clip(np.rint(factor * image), 0, 255).astype(np.uint8))
    return found


def test_by_how_much_each_image_is_lighter_is_known():
    gains = gains_between(images(FACTORS))
    assert np.ptp(gains / FACTORS, axis=0).max() < 0.01
    grey = [image[..., :1] for image in images(FACTORS)]
    np.testing.assert_allclose(gains_between(grey), gains[:, :1])


def test_two_exposures_of_which_one_is_clipped_are_told():
    # The object turns before a part of the room: there the usual image is of one exposure.
    factors = np.repeat([1.0, 1.6], 6)[:, None]
    rng = np.random.default_rng(5)
    room, found = rng.uniform(60, 165, (60, 80, 3)), []
    for k, factor in enumerate(factors):
        image = room.copy()
        covered = ((np.arange(80) // 4 + k) % 5 < 2) & (np.arange(80) < 48)
        image[:, covered] = rng.uniform(10, 60, (60, covered.sum(), 3))
        noise = rng.normal(0, 2, image.shape)
        found.append(np.clip(np.rint(factor * image + noise), 0, 255).astype(np.uint8))
    gains = gains_between(found)
    assert np.ptp(gains / factors, axis=0).max() < 0.03


@pytest.mark.parametrize(
    ("factors", "changes"),
    [(np.ones((12, 1)), {}), (FACTORS, {"still": False}), (FACTORS, {"backdrop": 6.0})],
)
def test_nothing_is_taken_back_where_nothing_changes_or_the_backdrop_does_not_tell(
    factors, changes
):
    assert (gains_between(images(factors, **changes)) == 1).all()


def test_views_are_looked_at_together_in_one_light():
    segmenter = JointSegmenter()
    for image in images(FACTORS):
        segmenter.add(image, camera_for(image))
    segmenter._even_out()
    shown = [segmenter.view(k, (0, 0, 80, 60)).image for k in range(12)]
    assert np.ptp([image[:15].mean(axis=(0, 1)) for image in shown], axis=0).max() < 3
