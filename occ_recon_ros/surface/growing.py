"""An array that grows at its end at constant cost a row."""

import numpy as np
from numpy.typing import NDArray


class GrowingArray:
    """Rows of one shape and type, appended in blocks; capacity doubles when it is full.

    Args:
        columns: length of a row, or 0 for scalars.
        dtype: the rows' type.
    """

    def __init__(self, columns: int, dtype: type) -> None:
        self._data: NDArray = np.empty((1024, columns) if columns else 1024, dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, rows: NDArray) -> None:
        """Copy rows to the end."""
        end = self._count + len(rows)
        if end > len(self._data):
            grown = np.empty(
                (max(end, 2 * len(self._data)), *self._data.shape[1:]), self._data.dtype
            )
            grown[: self._count] = self._data[: self._count]
            self._data = grown
        self._data[self._count : end] = rows
        self._count = end

    def keep(self, which: NDArray[np.bool_]) -> None:
        """Keep only some of the rows, in their order."""
        kept = self._data[: self._count][which]
        self._data[: len(kept)] = kept
        self._count = len(kept)

    @property
    def nbytes(self) -> int:
        """Bytes of what is there."""
        return int(self.rows.nbytes)

    @property
    def rows(self) -> NDArray:
        """A view of what is there; not to be kept over an ``append``."""
        return self._data[: self._count]
