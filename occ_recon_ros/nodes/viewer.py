"""viewer: a page on which a running scan is seen to grow."""

import os
import secrets
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import SetBool, Trigger

from msg_adapters import (
    decode_camera,
    decode_contours,
    decode_diagnostics,
    decode_picture,
    decode_rim,
    decode_stamp,
    decode_status,
    decode_strip,
    message_type,
)
from occ_recon_ros.errors import SettingsError
from occ_recon_ros.streams.statistics import give_back_memory
from occ_recon_ros.streams.topics import topic
from occ_recon_ros.viewer.guard import is_loopback
from occ_recon_ros.viewer.scan_view import ScanView, StateWords

from .base import PipelineNode
from .main import run_node
from .qos import compressed_topic, promised, sensor
from .settings import ViewerSettings

ENDS_WITH = "OCC_RECON_ENDS_WITH"
"""Variable of the environment: number of the process that started this one and ends it."""
_IMAGES_KEPT = 12
_WAITING = 100  # messages that may wait while the page is drawn
_PICTURE_S = 0.5
_RESET = ("contour_tracker/reset", "reconstructor/reset", "mesher/reset")
_PAUSE = ("contour_tracker/pause", "mesher/pause")
_FINISH = ("mesher/finish", "reconstructor/finish")  # the first that is there


class ViewerNode(PipelineNode[ViewerSettings]):
    """Listens to the topics of a scan, and shows it to whoever opens the page."""

    loss_matters = False  # a picture that is not shown is none

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("viewer", ViewerSettings, **kwargs)
        self.view = ScanView()
        self._parent = int(os.environ.get(ENDS_WITH, "0"))
        self.page = self._open_page()
        self._images: dict[int, Image | CompressedImage] = {}
        self._infos: dict[int, CameraInfo] = {}
        self._image_topics: list[Subscription] = []
        self._next_picture = 0.0
        view, now = self.view, time.monotonic
        self._hear("contours", lambda msg: view.add_contours(decode_contours(msg), now()))
        self._hear("rim", lambda msg: view.add_rim(decode_rim(msg)))
        self._hear("strip", lambda msg: view.add_strip(decode_strip(msg), now()))
        self._hear("mesh", lambda msg: view.set_mesh(decode_strip(msg)))
        self._hear("closed", lambda msg: view.set_closed(decode_strip(msg)))
        self._hear("mesher/scan", self._on_state)
        self._hear("/diagnostics", self._on_diagnostics)
        names = {*_RESET, *_FINISH, "mesher/save"}
        self._triggers = {name: self.create_client(Trigger, name) for name in names}
        self._pauses = {name: self.create_client(SetBool, name) for name in _PAUSE}
        self.steady_timer(1 / self.settings.page_rate, self._refresh)
        self.warn_of_unknown_parameters()
        # For people, also where nothing is logged.
        print(f"viewer: {self.page.url}", flush=True)

    def _open_page(self) -> Any:
        try:
            from occ_recon_ros.viewer.page import Page
        except ModuleNotFoundError as error:
            raise SettingsError(
                f"the page needs {error.name}: pip install 'occ_recon_ros[cli]'"
            ) from None
        host, token = self.settings.host, self.settings.token
        if not token and not is_loopback(host):
            token = secrets.token_urlsafe(16)
        try:
            return Page(self.view, host, self.settings.port, token)
        except ValueError as error:
            raise SettingsError(str(error)) from None

    # What comes.

    def _hear(self, name: str, handle: Callable[[Any], None]) -> Subscription:
        row = topic(name)
        return self.subscribe(
            message_type(row.type_name),
            name,
            handle,
            promised(row, _WAITING * row.reliable),
        )

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for report in decode_diagnostics(msg):
            if report.name != self.get_fully_qualified_name():
                self.view.add_report(
                    report.name, report.level, report.message, report.values, time.monotonic()
                )

    def _on_state(self, msg: DiagnosticStatus) -> None:
        report = decode_status(msg)
        state, reason = (report.values.get(key, report.message) for key in ("state", "reason"))
        self.view.told = StateWords(state, reason)

    # The page.

    def _refresh(self) -> None:
        if self._parent and os.getppid() != self._parent:
            os.kill(os.getpid(), signal.SIGTERM)
        self.guard("page", self._take_commands)
        self.guard("page", self._hear_images)
        self.guard("image", self._draw_image)
        with self.stages.timed("page"):
            self.guard("page", self.page.update, time.monotonic())

    def _hear_images(self) -> None:
        """Images are large: they are heard only while somebody looks."""
        if self.page.viewers and not self._image_topics:
            print("somebody looks at the page", flush=True)
            compressed = compressed_topic(self, "image")
            keep_image = partial(_keep_newest, self._images)
            self._image_topics = [
                self._hear("image", keep_image),
                self.subscribe(CompressedImage, compressed, keep_image, sensor()),
                self._hear("camera_info", partial(_keep_newest, self._infos)),
            ]
        elif not self.page.viewers and self._image_topics:
            for subscription in self._image_topics:
                self.destroy_subscription(subscription)
            self._image_topics = []
            self._images.clear()
            self._infos.clear()
            give_back_memory()

    def _draw_image(self) -> None:
        stamp = self.view.drawable(self._images)
        if stamp is None or time.monotonic() < self._next_picture:
            return
        self._next_picture = time.monotonic() + _PICTURE_S
        message, info = self._images[stamp], self._infos.get(stamp)
        with self.stages.timed("draw"):
            image = decode_picture(message)
            camera = decode_camera(info) if info is not None else None
            self.view.add_image(stamp, image, camera)

    def _take_commands(self) -> None:
        acts: dict[str, Callable[[], None]] = {
            "pause": partial(self._set_paused, True),
            "resume": partial(self._set_paused, False),
            "reset": self._reset,
            "finish": self._finish,
            "save": self._save,
        }
        for command in self.page.commands():
            acts[command]()

    def _set_paused(self, paused: bool) -> None:
        ready = [client for client in self._pauses.values() if client.service_is_ready()]
        if not ready:
            self.page.tell("the scan cannot be paused: no node is there")
            return
        self.view.paused = paused
        for client in ready:
            self._call(client, SetBool.Request(data=paused), lambda words: None)

    def _reset(self) -> None:
        for name in _RESET:
            self._trigger([name], self._after_reset if name == _RESET[-1] else None)

    def _after_reset(self, words: str) -> None:
        self.view.new_scan()

    def _finish(self) -> None:
        def after(words: str) -> None:
            self.view.finished = True

        self._trigger(_FINISH, after)

    def _save(self) -> None:
        def after(words: str) -> None:
            self.view.saved = words

        self._trigger(["mesher/save"], after)

    def _trigger(self, names: Any, after: Callable[[str], None] | None) -> None:
        """Call the first of some services that is there."""
        for name in names:
            if self._triggers[name].service_is_ready():
                self._call(self._triggers[name], Trigger.Request(), after)
                return
        self.page.tell(f"{names[-1]}: no such service, the scan is not running")

    def _call(self, client: Any, request: Any, after: Callable[[str], None] | None) -> None:
        """Call a service; say what it answers."""

        def answered(answer: Any) -> None:
            if answer is None:
                return
            self.page.tell(answer.message)
            if answer.success and after is not None:
                after(answer.message)

        self.ask(client, request, answered)

    # Life.

    def figures(self) -> dict[str, Any]:
        """Where the page is, and who looks."""
        return {"pages open": self.page.viewers}

    def destroy_node(self) -> None:
        """Close the page, then end."""
        self.page.stop()
        super().destroy_node()


def _keep_newest(messages: dict[int, Any], msg: Any) -> None:
    messages[decode_stamp(msg.header.stamp)] = msg
    while len(messages) > _IMAGES_KEPT:
        del messages[next(iter(messages))]


def main() -> int:
    """Run the node until it is told to end."""
    return run_node(ViewerNode)


if __name__ == "__main__":
    sys.exit(main())
