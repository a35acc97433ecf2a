"""A printed sheet under the object, of which nobody told."""

from collections.abc import Iterator, Sequence

from numpy.typing import NDArray

from msg_adapters import View
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.geometry import Camera
from occ_recon_ros.poses.board_backdrop import BoardBackdrop
from occ_recon_ros.poses.found_board import FoundBoard, find_board

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
        self._found = found
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
        board = self._found.board
        assert board is not None
        stands = _STANDS[board.kind].format(board.columns, board.rows)
        return (
            f"a printed sheet of {stands} ({board.dictionary}) lies under the object: it was found "
            "in the images and taken as the backdrop; where the poses are from this sheet, "
            "occ-recon scan --board does better"
        )


def sheet_in(views: BagViews) -> FoundBoard | None:
    """The sheet under the object, None where there is none."""
    whole = len(views.cameras())

    def some(numbers: Sequence[int]) -> Iterator[tuple[NDArray, Camera]]:
        return ((view.image, view.camera) for view in views.some(numbers))

    return find_board(whole, some)


def not_drawn(found: FoundBoard) -> str:
    """What to do where markers stand as in no sheet that can be drawn."""
    return (
        f"a printed sheet ({found.markers} markers, {found.dictionary}) lies under the object, its "
        "markers in another order than sheets of rows have: use occ-recon scan --board with its "
        "board.yaml, masks, or a scan volume above it (volume_*)"
    )
