"""A node's checkpoint: off or on, and never a reason to stop a scan."""

import io
import re
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message, serialize_message

from msg_adapters.serialised import header_stamp_ns
from occ_recon_ros.streams.checkpoint_file import CheckpointFile

from .base import PipelineNode
from .settings import CheckpointSettings

_NAME = b"name "  # records that are no message: those begin with a zero
_STATE = b"state "  # what it is of and a line feed, then arrays as numpy.savez writes them
_SAVED = b"saved"
_FEW = 1000  # messages that are not worth compacting
_SAY_S = 1.0

Arrays = dict[str, NDArray[Any]]


class Checkpoint:
    """The messages of the scan that a node is in, kept on disk if the settings say so.

    Args:
        node: that keeps them.
        settings: whether, where, how often.
        kind: of the messages.
        few: messages that are not worth compacting.

    Attributes:
        recalled: how many messages and states of a scan to go on with there were.
        name: of that scan, "" if it is not known.
        trouble: why it is not written, or what of it could not be read; "" if all is well.

    Raises:
        SettingsError: its file is none of this node, is in use, or cannot be written.
    """

    def __init__(
        self,
        node: PipelineNode[Any],
        settings: CheckpointSettings,
        kind: type,
        few: int = _FEW,
    ) -> None:
        self._node, self._stages, self._log = node, node.stages, node.get_logger()
        self._kind = kind
        self._resume = settings.resume
        self._file: CheckpointFile | None = None
        self.recalled = 0
        self.name = ""
        self._few = self._compact_at = few
        self._states: Counter[str] = Counter()  # that are in the file, by what they are of
        self.trouble = ""
        if settings.checkpoint_every or settings.resume:
            path = checkpoint_path(settings.checkpoint_path, node.get_fully_qualified_name())
            every = settings.checkpoint_every or 1
            self._file = CheckpointFile(path, node.get_name(), every, settings.resume)

    @property
    def kept(self) -> bool:
        """Whether anything is written."""
        return self._file is not None

    def recall(self, on_state: Callable[[str, Arrays], None] | None = None) -> Iterator[Any]:
        """The messages of the scan to go on with, none for a new one.

        Args:
            on_state: told of each state that was kept, and of what, in their order.
        """
        if self._file is None or not self._resume:
            return
        if self._file.ends_with(_SAVED):
            self._try(CheckpointFile.rotate)  # that scan is over
            return
        size, said = self._file.size, time.monotonic()
        for message in self._file.read():
            if message == _SAVED:
                continue
            if message.startswith(_NAME):
                self.name = message[len(_NAME) :].decode()
                continue
            self.recalled += 1
            if message.startswith(_STATE):
                self._states[_of_what(message)] += 1
                if on_state:
                    self._node.guard("checkpoint", on_state, *_read_state(message))
                continue
            if time.monotonic() - said > _SAY_S:
                said = time.monotonic()
                self._log.info(f"going on with a scan: {self._file.read_share(size):.0%} read")
            yield deserialize_message(message, self._kind)
        self.trouble = self._file.lost

    def keep_name(self, name: str) -> None:
        """Let the scan that goes on later be the one of this name."""
        if self._file is not None and name != self.name:
            self.name = name
            self._try(lambda file: file.append(_NAME + name.encode()))

    def keep_saved(self) -> None:
        """The scan is on disk: unless more of it comes, it is not to be gone on with."""
        if self._file is not None:
            self._try(lambda file: file.append(_SAVED))
            self.sync()

    def compact(
        self,
        needed: Callable[[int], bool] = lambda stamp: True,
        needed_state: Callable[[str], bool] = lambda what: True,
    ) -> None:
        """Leave out the messages of frames that a resumed node would only forget again, and all
        but the last state of each thing, once they are as many as the others.

        Args:
            needed: whether the frame of a stamp is still of use.
            needed_state: whether the state of a thing is.
        """
        if self._file is None or self._file.messages < self._compact_at:
            return
        later = Counter(self._states)

        def keeps(message: bytes) -> bool:
            if message.startswith(_STATE):
                what = _of_what(message)
                later[what] -= 1
                return not later[what] and needed_state(what)
            return message.startswith((_NAME, _SAVED)) or needed(header_stamp_ns(message))

        with self._stages.timed("checkpoint compaction"):
            self._try(lambda file: file.compact(keeps))
        self._states = Counter({what: 1 for what in self._states if needed_state(what)})
        if self._file is not None:
            self._compact_at = max(self._few, 2 * self._file.messages)

    def keep(self, message: Any) -> None:
        """Add a message that has been used."""
        if self._file is not None:
            with self._stages.timed("checkpoint write"):
                self._try(lambda file: file.append(serialize_message(message)))

    def keep_state(self, what: str, state: Arrays) -> None:
        """Add what is no message, as it is now.

        Args:
            what: it is of; the last state of each thing counts.
            state: arrays by name.
        """
        if self._file is None:
            return
        with self._stages.timed("checkpoint write"):
            data = io.BytesIO()
            np.savez(data, **state)  # type: ignore[arg-type]
            record = _STATE + what.encode() + b"\n" + data.getvalue()
            self._try(lambda file: file.append(record))
            self._states[what] += 1

    def clear(self) -> None:
        """A new scan begins."""
        self.name, self._compact_at = "", self._few
        self._states.clear()
        if self._file is not None:
            self._try(CheckpointFile.clear)

    def sync(self) -> None:
        """Let what is kept outlast a power cut."""
        if self._file is not None:
            self._try(CheckpointFile.sync)

    def close(self) -> None:
        """Let go of the file."""
        if self._file is not None:
            self._file.close()

    def _try(self, act: Any) -> None:
        assert self._file is not None
        try:
            act(self._file)
        except OSError as error:
            # One gap makes the rest useless: another scan would come of it.
            self.trouble = (
                f"checkpoint {self._file.path} is written no more ({error.strerror or error}): "
                "the scan goes on without"
            )
            self._file.close()
            self._file = None

    def figures(self) -> dict[str, Any]:
        """What diagnostics tell of it."""
        if self._file is None:
            return {}
        return {"checkpoint messages": self._file.messages, "checkpoint": str(self._file.path)}


def _of_what(record: bytes) -> str:
    return record[len(_STATE) : record.index(b"\n")].decode()


def _read_state(record: bytes) -> tuple[str, Arrays]:
    data = io.BytesIO(record[record.index(b"\n") + 1 :])
    with np.load(data, allow_pickle=False) as arrays:
        return _of_what(record), dict(arrays)


def checkpoint_path(folder: str, node: str) -> Path:
    """The file of a node (by its fully qualified name) in the folder of the checkpoints."""
    return Path(folder).expanduser() / f"{re.sub('/+', '.', node.strip('/'))}.checkpoint"
