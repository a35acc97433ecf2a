"""Views whose stamps are made up, in the order of their places around the object."""

from collections.abc import Sequence

import numpy as np

from occ_recon_ros.geometry.arrays import Array, Index
from occ_recon_ros.geometry.coverage import (
    follow_each_other,
    order_of_neighbours,
    steps_between,
)


def around_the_object(centres: Sequence[Array], what: str, listed: str) -> tuple[Index, str] | None:
    """The order of the views around the object, and what is to be said of it; None where they
    follow each other as they are.

    Args:
        centres: (3,) of the camera of each view.
        what: the views, in words.
        listed: by what they are in this order, in words.
    """
    if follow_each_other(centres):
        return None
    order = order_of_neighbours(centres)
    before, after = np.rad2deg(
        [steps_between(centres)[0], steps_between([centres[k] for k in order])[0]]
    )
    return order, (
        f"the {what} were put in the order of their places around the object: {listed}, "
        f"successive ones are {before:.0f} degrees apart, in this order {after:.0f}"
    )
