"""The mesher's closed bodies: of the scan that goes on, and of those that ended before theirs was
made."""

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rclpy.task import Future

from msg_adapters import encode_strip
from occ_recon_ros.geometry import Contours, Rim
from occ_recon_ros.streams.body_process import Body, BodyProcess
from occ_recon_ros.streams.scan_files import Result

from .base import PipelineNode
from .settings import MesherSettings
from .waits import Waits

_BODY_S = 120.0
_LOOK_S = 0.05
_SAY_S = 10.0


@dataclass(frozen=True, eq=False)
class _Asked:
    """A body that is being made.

    Attributes:
        result: that it belongs to; None for a preview.
        scan: number of the scan that it is of.
        rims: that had come until then.
        wanted: who waits for it; cancelled when nobody does any more.
    """

    result: Result | None
    scan: int
    rims: int
    wanted: Future = field(default_factory=Future)


class ClosedBody:
    """What a body is made of goes to its process, and comes back as one.

    Args:
        node: the mesher.
        ready: called from another thread when ``came`` has something.
        place: where the file of a body belongs.

    Attributes:
        data: the file of the body of all rims, b"" where there is none.
        outdated: whether rims have come since a whole one was made.
    """

    def __init__(
        self,
        node: PipelineNode[MesherSettings],
        ready: Callable[[], None],
        place: Callable[[str], Path],
    ) -> None:
        self._node, self._process, self._place = node, BodyProcess(ready), place
        self._asked: deque[_Asked] = deque()
        self._preview_at = 0.0
        self._scan = 0
        self._forget()

    def _forget(self) -> None:
        self.data, self.outdated, self._rims = b"", False, 0

    @property
    def pid(self) -> int | None:
        """Of the process, None where there is none."""
        return self._process.pid

    def add_rim(self, rim: Rim) -> None:
        """A rim of the scan, for the first time or again."""
        self._rims += 1
        self.outdated |= bool(self.data)
        self.data = b""
        self._process.add_rim(rim)

    def add_contours(self, contours: Contours) -> None:
        """Contours of the scan."""
        self._process.add_contours(contours)

    def add_view(self, image: Any, camera: Any) -> None:
        """An image that colours it."""
        self._process.add_view(image, camera)

    def clear(self) -> None:
        """A new scan begins; the whole bodies of the last one are made all the same."""
        for asked in self._asked:
            asked.wanted.cancel()
        self._scan += 1
        self._forget()
        self._process.clear()

    def preview(self) -> None:
        """Have a coarse one made, if it is time for it."""
        now, every = time.monotonic(), self._node.settings.closed_preview
        if every and now >= self._preview_at and not self._process.busy:
            self._preview_at = now + every
            self.ask(None)

    def ask(self, result: Result | None) -> Future:
        """Have the whole body made, or a preview for None; the future is cancelled where a new scan
        begins before."""
        self._asked.append(_Asked(result, self._scan, self._rims))
        path = self._place(result.scan_id if result else "")
        self._process.ask(result is not None, self._node.settings.body_cells, path)
        return self._asked[-1].wanted

    async def made(self, waits: Waits, result: Result) -> Body:
        """The whole body, or why nobody waits for it any longer."""
        body = await waits.within(_BODY_S, self.ask(result))
        return body or Body(f"it takes longer than {_BODY_S:.0f} s, and is saved then")

    def _owed(self) -> list[Path]:
        """Where the whole bodies belong that are being made."""
        return [self._place(asked.result.scan_id) for asked in self._asked if asked.result]

    def made_of_all(self, result: Result | None) -> bool:
        """Whether the whole body of all rims so far is there, or is being made."""
        asked = ((one.result, one.scan, one.rims) for one in self._asked)
        return bool(self.data) or (result, self._scan, self._rims) in asked

    def came(self) -> Iterator[tuple[Result, Body]]:
        """Take in the bodies that are made; those whole ones that nobody waits for."""
        while (body := self._process.take()) is not None:
            asked = self._asked.popleft()
            if asked.scan == self._scan:
                self._take(asked, body)
            if asked.result is not None and asked.wanted.cancelled():
                yield asked.result, body

    def last(self) -> Iterator[tuple[Result, Body] | str]:
        """Wait for the whole ones that are owed, as nothing else does any more; between them, what
        is to be said of it."""
        if not self._owed():
            return
        yield "the body is being closed: waiting for it"
        self._process.hurry()
        begun = said = time.monotonic()
        told = False
        while owed := self._owed():
            time.sleep(_LOOK_S)
            if self._process.on_its_own and not told:
                told = True
                paths = " and ".join(map(str, owed))
                yield f"Ctrl-C again leaves it to process {self.pid}, which still writes {paths}"
            if time.monotonic() - said > _SAY_S:
                said = time.monotonic()
                yield f"the body is being closed, for {said - begun:.0f} s"
            yield from self.came()

    def _take(self, asked: _Asked, body: Body) -> None:
        """A body of the scan that goes on."""
        if asked.result is not None:
            current = asked.rims == self._rims
            self.data, self.outdated = (body.data, False) if current else (b"", bool(body.data))
            if not asked.wanted.cancelled():
                asked.wanted.set_result(body)
        if body.strip is not None:
            with self._node.stages.timed("closed"):
                self._node.send("closed", encode_strip(body.strip))
            self._node.stages["closing"].append(body.seconds)

    def stop(self) -> None:
        """End the process."""
        self._process.stop()
