"""The closed body, made beside the scan in a process of its own so that no rim waits for it.

The parent hands on each contour and rim as it comes, through a thread, because a pipe is full
while the child computes. The child keeps what a body needs and answers each request with one.
Where the parent has ended meanwhile, it writes the file itself.
"""

import pickle
import queue
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry import Camera, Contours, Rim
from ..surface import Strip, ViewColours, exported, write_whole
from .child import END_S, GONE, Parent, answer, answers, begin, end, let_go_first_no_more

_MOST_KEPT = 480  # views; of more, every second goes


@dataclass(frozen=True)
class Body:
    """A closed body, or why there is none.

    Attributes:
        reason: why there is none, "" if there is.
        strip: its triangles.
        data: the file of it, for a full one.
        triangles: how many.
        seconds: that it took.
        doubt: what its own outlines say against it, for a full one; "" for nothing.
    """

    reason: str = ""
    strip: Strip | None = None
    data: bytes = b""
    triangles: int = 0
    seconds: float = 0.0
    doubt: str = ""


class BodyProcess(Parent[Body]):
    """The parent's end. Each request gets one answer, in their order, whatever becomes of the
    child."""

    def __init__(self, ready: Callable[[], None]) -> None:
        super().__init__(ready)
        self._out: queue.SimpleQueue[tuple[Any, ...] | None] = queue.SimpleQueue()
        self._threads: list[threading.Thread] = []
        self._fed = False
        self._ended = ""
        self._asked = 0  # requests without an answer

    @property
    def busy(self) -> bool:
        """Whether an answer is to come."""
        return self._asked > 0

    def add_contours(self, contours: Contours) -> None:
        """Hand on the contours of a view."""
        self._feed("contours", contours)

    def add_rim(self, rim: Rim) -> None:
        """Hand on a rim; the last of a stamp counts."""
        self._feed("rim", rim)

    def add_view(self, image: NDArray[np.uint8], camera: Camera) -> None:
        """Hand on an image that colours, (h, w, 3) uint8, red green blue."""
        self._feed("view", image, camera)

    def clear(self) -> None:
        """A new scan begins; what has been asked for of the last one is made all the same."""
        if self._ended:
            for _ in range(self._asked - self._answers.qsize()):
                self._give(Body(self._ended))
            self._end()
        elif self._fed:
            self._feed("clear")
        self._fed = False

    @property
    def on_its_own(self) -> bool:
        """Whether the child has got all that it needs to go on without its parent."""
        return self._child is not None and not self._ended and self._out.empty()

    def hurry(self) -> None:
        """Nothing else is to be done any more: the child need not let others go first."""
        if self.pid is not None:
            let_go_first_no_more(self.pid)

    def ask(self, full: bool, cells: int, path: Path) -> None:
        """Ask for a body of what has come, so fine; ``ready`` is called when it is there.

        Args:
            full: of all views, not a preview.
            cells: that the longest side is divided into.
            path: where the file of a full one belongs, whose suffix is its format; the child
                writes it there if the parent has ended before.
        """
        self._asked += 1
        self._feed("close", full, cells, path)
        if self._ended:
            self._ready()

    def take(self) -> Body | None:
        """A body that is there, None if there is none."""
        ended = self._ended  # before the look: what was answered until then is there
        body = super().take()
        if body is None and ended and self._asked:
            body = Body(ended)
        self._asked -= body is not None
        return body

    def _feed(self, *message: Any) -> None:
        if self._child is None:
            self._start()
        self._fed = True
        self._out.put(message)

    def _start(self) -> None:
        self._child = begin(__name__)
        for work in (self._write, self._read):
            thread = threading.Thread(target=work, args=(self._child,), daemon=True)
            thread.start()
            self._threads.append(thread)

    def _write(self, child: Any) -> None:
        with suppress(OSError), child.stdin as pipe:  # the reader says that it has ended
            while (message := self._out.get()) is not None:
                pickle.dump(message, pipe, protocol=5)
                pipe.flush()

    def _read(self, child: Any) -> None:
        while True:
            try:
                body = pickle.load(child.stdout)
            except Exception:  # whatever half an answer gives
                break
            self._give(body)
        self._ended = f"the process that closes the body has ended ({child.wait()})"
        self._ready()

    def stop(self) -> None:
        """End the child, whatever it has been asked for."""
        self._asked = 0
        self._end()

    def _end(self) -> None:
        if self._child is None:
            return
        self._out.put(None)
        end(self._child)
        for thread in self._threads:
            thread.join(END_S)
        if self._child.stdout:
            self._child.stdout.close()
        self._child, self._ended = None, ""
        self._out, self._threads = queue.SimpleQueue(), []


class Views:
    """The child's end: what a body is made of."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget the scan."""
        self.contours: dict[int, Contours] = {}
        self.rims: dict[int, Rim] = {}
        self.colours = ViewColours()

    def add(self, kind: str, *what: Any) -> None:
        """Take in what the parent hands on."""
        if kind == "clear":
            self.clear()
        elif kind == "view":
            self.colours.add(*what)
        else:
            kept: dict[int, Any] = self.contours if kind == "contours" else self.rims
            kept[what[0].stamp_ns] = what[0]
            self._thin_out()

    def _thin_out(self) -> None:
        """Of very many views every second stays, of those that have both."""
        both = sorted(set(self.contours) & set(self.rims)) if len(self.rims) > _MOST_KEPT else []
        if len(both) > _MOST_KEPT:
            for stamp in both[1::2]:
                del self.contours[stamp], self.rims[stamp]
        while len(self.contours) > 4 * _MOST_KEPT:  # of a camera that has not moved
            del self.contours[next(iter(self.contours))]

    def body(self, full: bool, cells: int, suffix: str) -> Body:
        """Close the body; a preview is no finer than it needs to be."""
        started = time.monotonic()
        try:
            # It needs scikit-image, which a node can do without.
            from ..surface import body

            most = None if full else body.PREVIEW_VIEWS
            contours, rims = body.body_views(self.contours, self.rims, most)
            if not contours:
                return Body("no view has a rim yet")
            colours = self.colours if len(self.colours) else None
            settings = body.closing_settings(cells, preview=not full)
            closed = body.closed_views(contours, rims, colours, settings)
        except ModuleNotFoundError as error:
            return Body(f"the closed body needs {error.name}: pip install 'occ_recon_ros[cli]'")
        except ValueError as error:
            return Body(str(error))
        except Exception as error:
            return Body(f"the body could not be closed: {error!r}")
        mesh = closed.mesh
        faces = np.asarray(mesh.faces)
        rgb = None
        if colours:
            visual: Any = mesh.visual
            rgb = np.asarray(visual.vertex_colors)[:, :3].astype(np.uint8)[faces]
        strip = Strip(
            stamp_ns=contours[-1].stamp_ns,
            frame_id=contours[-1].frame_id,
            corners=np.asarray(mesh.vertices, np.float32)[faces],
            normals=np.asarray(mesh.vertex_normals, np.float32)[faces],
            depth_sigma=np.full((len(faces), 3), np.nan, np.float32),
            rgb=rgb,
        )
        data = exported(mesh, suffix) if full else b""
        seconds = time.monotonic() - started
        return Body("", strip, data, len(faces), seconds, closed.doubt())


def main() -> None:
    """Serve the parent until it is gone."""
    pipe = answers()
    views = Views()
    while True:
        try:
            kind, *what = pickle.load(sys.stdin.buffer)
        except GONE:
            return
        if kind != "close":
            views.add(kind, *what)
            continue
        full, cells, path = what
        body = views.body(full, cells, path.suffix)
        answer(pipe, body, partial(_write_alone, body, path))


def _write_alone(body: Body, path: Path) -> None:
    if body.data:  # of a whole one
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, body.data, overwrite=True)
