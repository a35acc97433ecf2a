"""A printed sheet under the object, of which nobody told."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from msg_adapters import View
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import evenly
from occ_recon_ros.poses.board_backdrop import BoardBackdrop
from occ_recon_ros.poses.found_board import FoundBoard, find_board, marker_corners

_ASKED = 5  # masks, whether they hold it
_HELD = 0.6  # of the corners of its markers, that are in a mask; of the apple's own .1 to .2
_STANDS = {"aruco_grid": "{} x {} markers", "charuco": "{} x {} squares with markers"}


class Sheet:
    """The sheet as the backdrop of all views, its frame that of their cameras.

    Args:
        found: with a print that can be drawn.

    Attributes:
        backdrop: draws it.
    """

    def __init__(self, found: FoundBoard) -> None:
        assert found.board is not None
        self._found, self._board = found, found.board
        self.backdrop = BoardBackdrop(found.board)
        self._cameras: dict[int, Camera] = {}

    def camera(self, view: View, camera: Camera) -> Camera:
        """The camera of a view, in the frame of the sheet."""
        if view.stamp_ns not in self._cameras:
            self._cameras[view.stamp_ns] = self._found.seen_by(view.image, camera)
        return self._cameras[view.stamp_ns]

    @property
    def words(self) -> str:
        """What was found, and what does better."""
        return (
            f"a printed sheet of {self._print} lies under the object: it was found in the images "
            "and taken as the backdrop; where the poses are from this sheet, occ-recon scan "
            "--board does better"
        )

    def held_words(self, views: BagViews) -> str:
        """That masks which came hold the sheet with the object, "" where they do not."""
        corners = marker_corners(self._board).reshape(-1, 3)
        shares = list[float]()
        for view in views.some(evenly(len(views), _ASKED)):
            if view.mask is None:
                continue
            uv = np.rint(self.camera(view, view.camera).project(corners)).astype(np.intp)
            u, v = uv[np.all((uv >= 0) & (uv < view.mask.shape[::-1]), axis=1)].T
            shares.append(float(np.mean(view.mask[v, u] > 127)) if len(u) else 0.0)
        if not shares or np.median(shares) < _HELD:
            return ""
        return f"the masks that came hold the printed sheet of {self._print} under the object"

    @property
    def _print(self) -> str:
        board = self._board
        stands = _STANDS[board.kind].format(board.columns, board.rows)
        return f"{stands} ({board.dictionary})"


def sheet_in(views: BagViews) -> FoundBoard | None:
    """The sheet under the object, None where there is none."""
    whole = len(views.cameras())

    def some(numbers: Sequence[int]) -> Iterator[tuple[NDArray, Camera]]:
        return ((view.image, view.camera) for view in views.some(numbers))

    return find_board(whole, some)


def held_sheet(views: BagViews) -> str:
    """That masks which came hold a printed sheet with the object, "" where they hold none."""
    found = sheet_in(views) if views.masked() else None
    return "" if found is None or found.board is None else Sheet(found).held_words(views)


def not_drawn(found: FoundBoard) -> str:
    """What to do where markers stand as in no sheet that can be drawn."""
    return (
        f"a printed sheet ({found.markers} markers, {found.dictionary}) lies under the object, its "
        "markers in another order than sheets of rows have: use occ-recon scan --board with its "
        "board.yaml, masks, or a scan volume above it (volume_*)"
    )
