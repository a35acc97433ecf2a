"""The page: a scene, a panel and buttons, served with viser."""

import queue
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from ..surface import exported
from .glb import encode_glb
from .guard import Guard
from .panel import panel_html
from .patch import SHADINGS, Patch, patch_colours, sigma_range
from .placing import Placing, place
from .scan_view import RIMS_SHOWN, ScanView, ShownFrame
from .server import start_server

_FORMATS = ("PLY", "GLB", "STL")
_SURFACES = ("auto", "strips", "closed body")
_FRUSTUM = 0.08  # of the distance to the object
_RIM_POINT = 0.012  # of the object's radius
_NEW_RIM, _OLD_RIM = np.array([255, 60, 30]), np.array([120, 110, 105])
_PATH_COLOUR = (90, 90, 90)
_SKY, _GROUND, _INTENSITY = (255, 255, 255), (110, 115, 125), 2.5


class Page:
    """Shows a ``ScanView`` to whoever has the page open.

    All methods are called from one thread; what people do on the page is read, or fetched
    with ``commands``, in ``update``'s own time.

    Attributes:
        url: where the page is.
    """

    def __init__(self, view: ScanView, host: str, port: int, token: str) -> None:
        self._view = view
        self._server = start_server(host, port, Guard(token))
        address = "127.0.0.1" if host in ("0.0.0.0", "") else host
        self.url = f"http://{address}:{self._server.get_port()}/"
        if token:
            self.url += f"?token={token}"
        self._commands: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._handles: dict[str, Any] = {}
        self._placing: Placing | None = None
        self._sigmas = (0.0, 0.0)
        self._applied: dict[str, Any] = {}
        self._build()

    def _build(self) -> None:
        # A picture of surroundings that lights the scene is dear where no graphics card draws it.
        scene = self._server.scene
        scene.configure_environment_map(None)
        scene.configure_default_lights(cast_shadow=False)
        scene.add_light_hemisphere(
            "/light", sky_color=_SKY, ground_color=_GROUND, intensity=_INTENSITY
        )
        gui = self._server.gui
        gui.main_panel.dock_right()
        gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
        self._status = gui.add_html("")
        self._note = gui.add_markdown("")
        self._button("Pause", lambda: "resume" if self._view.paused else "pause")
        self._reset_button()
        self._button("Finish", lambda: "finish")
        self._button("Save", lambda: "save")
        download = gui.add_button_group("Download", _FORMATS)
        download.on_click(lambda event: self._download(str(download.value), event.client))
        self._turn = gui.add_slider(
            "Back in time", min=0, max=1, step=1, initial_value=1, hint="at the right end: now"
        )
        self._shading = gui.add_dropdown("Shading", SHADINGS, initial_value="plain")
        self._surface = gui.add_dropdown("Surface", _SURFACES, initial_value="auto")
        self._rims = gui.add_checkbox("Newest rims", True)
        self._camera = gui.add_checkbox("Camera", True)
        self._path = gui.add_checkbox("Path of the camera", True)
        self._picture = gui.add_image(np.full((3, 4, 3), 230, np.uint8), format="jpeg")

    def _button(self, label: str, command: Callable[[], str]) -> None:
        button = self._server.gui.add_button(label)
        button.on_click(lambda _: self._commands.put(command()))
        self._handles[label] = button

    def _reset_button(self) -> None:
        button = self._server.gui.add_button("Reset")

        def ask(event: Any) -> None:
            gui = event.client.gui if event.client is not None else self._server.gui
            modal = gui.add_modal("Forget this scan?")
            with modal:
                forget = gui.add_button("Forget it")
                keep = gui.add_button("Keep it")

            def close(command: str) -> None:
                if command:
                    self._commands.put(command)
                with suppress(Exception):  # the other button, or the page, was quicker
                    modal.close()

            forget.on_click(lambda _: close("reset"))
            keep.on_click(lambda _: close(""))

        button.on_click(ask)

    # What people want.

    @property
    def viewers(self) -> int:
        """How many have the page open."""
        return len(self._server.get_clients())

    def commands(self) -> list[str]:
        """What was clicked since the last call: pause, resume, reset, finish, save."""
        out = []
        with suppress(queue.Empty):
            while True:
                out.append(self._commands.get_nowait())
        return out

    def tell(self, sentence: str) -> None:
        """Say what came of a click."""
        self._note.content = _plain(sentence)

    def _download(self, kind: str, client: Any) -> None:
        """Runs in a thread of the server: the arrays of a patch never change."""
        name, patch = "mesh", self._view.surface.latest()
        if self._shows_closed():
            name, patch = "closed", self._view.closed
        if client is None or patch is None or not len(patch) or kind not in _FORMATS:
            self.tell("there is no surface yet")
            return
        suffix = kind.lower()
        client.send_file_download(f"{name}.{suffix}", export(patch, suffix), save_immediately=True)

    # What is shown.

    def update(self, now_s: float) -> None:
        """Bring the page up to date."""
        view = self._view
        self._set("scan", view.scans, lambda _: self._clear())
        if self._placing is None:
            self._place()
        self._set("panel", panel_html(view, now_s), partial(setattr, self._status, "content"))
        self._set("paused", view.paused, self._show_paused)
        if self._placing is None:
            return
        self._move_slider()
        self._update_surfaces(now_s)
        count = int(self._turn.value) if self._is_past() else len(view.frames)
        self._set("past", count if self._is_past() else None, self._show_past)
        frame = view.frame_at(count)
        if frame is not None:
            self._show_frame(frame)
        if view.rims_are_new or self._applied.get("rims") != bool(self._rims.value):
            self._show_rims()
        if bool(self._path.value):
            self._set("path", len(view.path()), lambda _: self._show_path())
        for name, shown in (("/camera", self._camera), ("/path", self._path)):
            self._set(f"{name} visible", bool(shown.value), partial(self._show_if, name))

    def _clear(self) -> None:
        """A new scan, which may lie elsewhere."""
        self._placing = None
        for name in [name for name in self._handles if name.startswith("/")]:
            self._handles.pop(name).remove()
        self._turn.value = int(self._turn.max)
        self._applied = {"scan": self._view.scans}

    def _place(self) -> None:
        self._placing = placing = place(self._view)
        if placing is None:
            return
        self._server.scene.set_up_direction(placing.up)
        camera = self._server.initial_camera
        camera.position, camera.look_at = placing.position, placing.target
        for client in self._server.get_clients().values():
            client.camera.up_direction = placing.up
            client.camera.position = placing.position
            client.camera.look_at = placing.target

    def _set(self, key: str, value: Any, apply: Callable[[Any], None]) -> None:
        """Apply a value if it is another than the last time."""
        if key not in self._applied or self._applied[key] != value:
            self._applied[key] = value
            apply(value)

    def _show_paused(self, paused: bool) -> None:
        self._handles["Pause"].label = "Go on" if paused else "Pause"

    def _show_if(self, name: str, visible: bool) -> None:
        if name in self._handles:
            self._handles[name].visible = visible

    def _is_past(self) -> bool:
        return int(self._turn.value) < int(self._turn.max)

    def _move_slider(self) -> None:
        count = max(len(self._view.frames), 1)
        if count != int(self._turn.max):
            now = not self._is_past()
            self._turn.max = count
            if now or self._turn.value > count:
                self._turn.value = count

    def _shows_closed(self) -> bool:
        chosen, view = self._surface.value, self._view
        if view.closed is None or chosen == "strips":
            return False
        told = view.told.word if view.told else ""
        whole = view.finished or told in ("turn_closed", "saved")
        return chosen == "closed body" or whole

    def _update_surfaces(self, now_s: float) -> None:
        view, shading = self._view, str(self._shading.value)
        changes = list(view.surface.changes(now_s))
        names = {change.name for change in changes}
        if any(name.startswith("whole") for name in names) and view.surface.whole:
            self._sigmas = sigma_range(view.surface.whole)
        if self._applied.get("shading", shading) != shading:
            changes += [c for c in view.surface.again() if c.name not in names]
            view.closed_is_new = True
            self._applied["past"] = None
        self._applied["shading"] = shading
        closed, past = self._shows_closed(), self._is_past()
        for change in changes:
            self._draw(f"/strips/{change.name}", change.patch, not (closed or past))
        if view.closed_is_new:
            self._draw("/closed", view.closed, closed and not past)
            view.closed_is_new = False
        self._set("what", (closed, past), self._show_what)

    def _show_what(self, what: tuple[bool, bool]) -> None:
        closed, past = what
        for name, handle in self._handles.items():
            if name.startswith("/strips/"):
                handle.visible = not (closed or past)
        self._show_if("/closed", closed and not past)

    def _show_past(self, count: int | None) -> None:
        patch = None if count is None else self._view.past(count)
        self._draw("/past", patch, True)

    def _draw(self, name: str, patch: Patch | None, visible: bool) -> None:
        old = self._handles.pop(name, None)
        if patch is None or not len(patch):
            if old is not None:
                old.remove()
            return
        assert self._placing is not None
        colours = patch_colours(patch, str(self._shading.value), self._sigmas)
        data = encode_glb(patch, colours, self._placing.scale)
        self._handles[name] = self._server.scene.add_glb(name, data, visible=visible)

    def _show_frame(self, frame: ShownFrame) -> None:
        picture = self._picture_of(frame)
        key = (frame.stamp_ns, picture.stamp_ns if picture else None)
        if self._applied.get("frame") == key:
            return
        self._applied["frame"] = key
        pixels = None
        if picture is not None and picture.jpeg is not None:
            pixels = _pixels(picture.jpeg)
        if pixels is not None:
            show = partial(setattr, self._picture, "image")
            self._set("picture", picture and picture.stamp_ns, lambda _: show(pixels))
        self._show_camera(picture or frame, pixels)

    def _picture_of(self, frame: ShownFrame) -> ShownFrame | None:
        """The frame if it has a picture, or the last before it that has."""
        for candidate in reversed(self._view.frames.values()):
            if candidate.stamp_ns <= frame.stamp_ns and candidate.jpeg is not None:
                return candidate
        return None

    def _show_camera(self, frame: ShownFrame, pixels: NDArray[np.uint8] | None) -> None:
        placing = self._placing
        if placing is None or frame.R_object_camera is None or pixels is None:
            return
        x, y, z, w = frame.quaternion()
        centre = placing.scale * frame.centre
        handle = self._handles.get("/camera")
        if handle is None:
            self._handles["/camera"] = self._server.scene.add_camera_frustum(
                "/camera",
                fov=frame.field_of_view,
                aspect=pixels.shape[1] / pixels.shape[0],
                scale=_FRUSTUM * float(np.linalg.norm(centre - placing.target)),
                thickness=2.0,
                thickness_units="screen",
                image=pixels,
                format="jpeg",
                wxyz=(w, x, y, z),
                position=centre,
                cast_shadow=False,
            )
        else:
            handle.image = pixels
            handle.wxyz, handle.position = (w, x, y, z), centre

    def _show_rims(self) -> None:
        view, placing = self._view, self._placing
        view.rims_are_new = False
        self._applied["rims"] = bool(self._rims.value)
        if placing is None:
            return
        rims = list(view.rims)
        ages = [np.full(len(points), age) for age, points in enumerate(reversed(rims))][::-1]
        points = np.concatenate([np.zeros((0, 3), np.float32), *rims])
        old = (np.concatenate([np.zeros(0), *ages]) / RIMS_SHOWN)[:, None]
        self._handles["/rims"] = self._server.scene.add_point_cloud(
            "/rims",
            points * np.float32(placing.scale),
            ((1 - old) * _NEW_RIM + old * _OLD_RIM).astype(np.uint8),
            point_size=_RIM_POINT * placing.radius,
            point_shape="circle",
            precision="float32",
            visible=bool(self._rims.value) and len(points) > 0,
        )

    def _show_path(self) -> None:
        path = self._view.path()
        assert self._placing is not None
        if len(path) < 2:
            return
        self._handles["/path"] = self._server.scene.add_line_segments(
            "/path",
            self._placing.scale * np.stack([path[:-1], path[1:]], axis=1),
            _PATH_COLOUR,
            thickness=2.0,
            thickness_units="screen",
            visible=bool(self._path.value),
        )

    def stop(self) -> None:
        """Close the page."""
        self._server.stop()


def export(patch: Patch, suffix: str) -> bytes:
    """A patch as the content of a file.

    Args:
        patch: the surface, metres.
        suffix: ply, glb or stl.
    """
    mesh = trimesh.Trimesh(
        vertices=patch.vertices,
        faces=patch.faces,
        vertex_normals=patch.normals,
        vertex_colors=patch.rgb,
        process=False,
    )
    return exported(mesh, suffix)


def _pixels(jpeg: bytes) -> NDArray[np.uint8]:
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    return np.ascontiguousarray(np.asarray(image, np.uint8)[..., ::-1])


def _plain(sentence: str) -> str:
    """A sentence that Markdown leaves as it is."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]()#+-.!<>|&" else c for c in sentence)
