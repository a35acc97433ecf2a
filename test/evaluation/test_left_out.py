"""What is said of views that the others leave out, by what their images show."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from msg_adapters import View
from occ_recon_ros.evaluation.left_out import SHOWS_NOTHING, look_at
from occ_recon_ros.imaging.joint.edges import in_small, small_contrast
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.streams.alone import filled

VIEWS = 12
THING = make_object("ellipsoid")


class Views(list):
    """Stands for the views of a bag."""

    def some(self, numbers):
        return (view for k, view in enumerate(self) if k in numbers)


def drawn(camera):
    loops = THING.exact_contours(camera)
    return filled(loops.by_loop(loops.uv), (camera.height, camera.width))


@pytest.fixture
def views():
    """An ellipsoid before a room of stripes, which the camera sees from where it stands."""
    size = {"width": 240, "height": 180, "focal_px": 300}
    settings = TurntableSettings(frames=VIEWS, step=2 * np.pi / VIEWS, elevation=0.5, **size)
    found = Views()
    for k, camera in enumerate(turntable_cameras(settings), 1):
        mask = drawn(camera)
        image = np.where(mask > 127, 200, room()).astype(np.uint8)
        found.append(View(k, camera, image, mask))
    return found


def room():
    noise = np.random.default_rng(0).normal(0, 2, (180, 240))
    return 60 + 10 * (np.arange(240) // 12 % 2) + noise


def looked_at(views, out):
    """Of the views of these numbers, which the others contradict."""
    by_others = SimpleNamespace(by_others=lambda image, camera: drawn(camera))
    rest = [view for k, view in enumerate(views) if k not in out]
    contrasts = [small_contrast(*in_small(view.image, view.mask)) for view in rest]
    why = dict.fromkeys(out, "it agrees with the others by 30% only")
    bare = Views(replace(view, mask=None) for view in views)
    return look_at(bare, by_others, contrasts, out, why, lambda view: view.camera)


def test_views_whose_poses_are_exchanged_show_what_the_other_should(views):
    first, other = views[3], views[7]
    views[3], views[7] = (
        replace(first, camera=other.camera),
        replace(other, camera=first.camera),
    )
    told = looked_at(views, (3, 7))
    assert told.words == {
        3: "it seems to show what view 7 should: its pose may be wrong; left out",
        7: "it seems to show what view 3 should: its pose may be wrong; left out",
    }
    assert not told.masks
    np.testing.assert_array_equal(told.elsewhere[first.stamp_ns], first.mask)
    np.testing.assert_array_equal(told.elsewhere[other.stamp_ns], other.mask)


def test_all_images_that_show_the_empty_room_are_named_so(views):
    for k in (9, 10, 11):
        image = room()
        if k == 11:  # an edge of the room, where the object's is asked for
            views[k] = replace(views[k], image=image.astype(np.uint8))
            shown = (views[k].mask > 127) & (np.arange(240) < 120)
            image = np.where(shown, 95, image)
        views[k] = replace(views[k], image=np.clip(image, 0, 255).astype(np.uint8))
    told = looked_at(views, (9, 10, 11))
    assert [*told.words] == [9, 10, 11]
    assert all(words.startswith(SHOWS_NOTHING) for words in told.words.values())
    assert not told.elsewhere
    assert not told.masks


def test_what_is_lit_otherwise_is_drawn_where_it_stands(views):
    views[5] = replace(views[5], image=255 - views[5].image)
    told = looked_at(views, (5,))
    assert "drawn there" in told.words[5]
    np.testing.assert_array_equal(told.masks[views[5].stamp_ns], views[5].mask)
