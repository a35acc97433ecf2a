"""mesher: rims in, surface out."""

import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker

from msg_adapters import Level, decode_rim, encode_marker, encode_strip, is_contours
from occ_recon_ros.geometry import Rim
from occ_recon_ros.streams.scan import OVER
from occ_recon_ros.streams.statistics import give_back_memory
from occ_recon_ros.surface import Strip, Surface, ViewColours

from .base import NEXT_SCAN, Dropped, PipelineNode, named
from .checkpoint import Arrays, Checkpoint
from .colouring import Colouring, ColourView
from .main import run_node
from .qos import latched, reliable
from .scan_keeper import ScanKeeper
from .settings import MesherSettings

_RIMS_THAT_MAY_WAIT = 100  # ~/finish brings many at once
_MESH_SHARE = 0.04  # of the time, at most, goes into publishing the whole mesh


class MesherNode(PipelineNode[MesherSettings]):
    """Joins rims to strips and keeps the whole surface."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("mesher", MesherSettings, **kwargs)
        self._colouring: Colouring | None = None
        if self.settings.color:
            self._colouring = Colouring(self, self.settings.object_frame)
        self._surface = self._shown = Surface(self.settings, self.colours)
        self._rims = 0
        self._published_at, self._mesh_took = float("-inf"), 0.0
        self.advertise(PointCloud2, "strip", reliable(100))
        self.advertise(PointCloud2, "mesh", latched())
        self.advertise(PointCloud2, "closed", latched())  # by whoever closes the body
        self._marker = self.advertise(Marker, "mesh_marker", latched(), self._on_marker_viewer)
        self._checkpoint = Checkpoint(self, self.settings, PointCloud2)
        self.keeper = ScanKeeper(
            self, self._checkpoint, lambda: self._surface, self._on_reset, self._keep
        )
        if self._colouring:
            self._colouring.on_view = self._on_view
        self.subscribe(PointCloud2, "rim", self._on_rim, reliable(_RIMS_THAT_MAY_WAIT))
        self.offer("~/reset", self._on_reset)
        self.offer("~/save", self._on_save)
        self.offer_pause("rims")
        self._flush = self.steady_timer(1.0, self._publish_mesh)
        self._flush.cancel()
        self._recall()
        self.warn_of_unknown_parameters()

    @property
    def colours(self) -> ViewColours | None:
        """The views that colour the surface, None without colour."""
        return self._colouring.views if self._colouring else None

    def _on_rim(self, msg: PointCloud2) -> None:
        try:
            self._take_rim(self._decode(msg), msg)
        finally:
            self.keeper.rim_came()

    def _take_rim(self, rim: Rim, msg: PointCloud2) -> None:
        if not len(rim):
            self._on_no_rim(rim)
        elif self.paused:
            raise Dropped("paused", "a rim came while paused")
        elif rim.stamp_ns in self._surface:
            self._on_rim_again(rim, msg)
        else:
            strip = self._add(rim)
            self._keep(msg)
            self._publish_strip(strip)

    def _on_rim_again(self, rim: Rim, msg: PointCloud2) -> None:
        if self._revise(rim):
            self._keep(msg)
            self._publish_soon()
        elif not (self._checkpoint.recalled or self._surface.replaced(rim.stamp_ns)):
            # (A reconstructor that goes on with a scan sends its last rims again.)
            raise Dropped("duplicate", f"the rim of {rim.stamp_ns * 1e-9:.3f} s has come before")

    def _decode(self, msg: PointCloud2) -> Rim:
        with self.stages.timed("decode"), named("rim"):
            rim = decode_rim(msg)
        self.refuse_other_frame("rim_frame", "rims are in frame", rim.frame_id)
        return rim

    def _on_no_rim(self, rim: Rim) -> None:
        """A rim without samples, earlier than the last, says that a new scan begins."""
        last = self._surface.last_stamp_ns
        if last is None or rim.stamp_ns > last:
            raise Dropped("empty_rim", "a rim has no samples")
        self.get_logger().info("time went back: a new scan begins")
        self._new_surface(time_went_back=True)

    def _new_surface(self, time_went_back: bool) -> None:
        """The old surface is saved, and shown until the new one has something."""
        self.keeper.begin_anew(time_went_back)
        if self._colouring:
            if not time_went_back:
                self._colouring.clear()
            for view in self._colouring.kept():
                self._on_view(view)  # of the new scan: images come before rims
        self._surface = Surface(self.settings, self.colours)
        self._rims = 0
        self.loss.forgive()

    def _on_view(self, view: ColourView) -> None:
        self.keeper.add_view(view.image, view.camera)
        if self._checkpoint.kept:
            self._checkpoint.keep_state(view.name, view.state())

    def _keep(self, msg: PointCloud2) -> None:
        """Put a message that the scan is made of into the checkpoint."""
        surface = self._surface
        self._checkpoint.keep_name(self.keeper.scan.named())
        self._checkpoint.keep(msg)
        self._checkpoint.compact(lambda stamp: not surface.replaced(stamp), self._wants)

    def _wants(self, name: str) -> bool:
        """Whether a view still colours."""
        kept = self._colouring.kept() if self._colouring else []
        return any(view.name == name for view in kept)

    def _recall(self) -> None:
        """Go on with the scan of the checkpoint."""

        def take_again(message: PointCloud2) -> None:
            if is_contours(message):
                self.keeper.recall_contours(message)
                return
            rim = self._decode(message)
            if rim.stamp_ns in self._surface:
                self._revise(rim)
            else:
                self._add(rim)

        def see_again(what: str, state: Arrays) -> None:
            if self._colouring:
                view = self._colouring.recall(state)
                self.keeper.add_view(view.image, view.camera)

        for message in self._checkpoint.recall(see_again):
            if self._checkpoint.name:
                self.keeper.scan.resume(self._checkpoint.name)
            self.guard("rim", take_again, message)
        if self._rims:
            self.get_logger().info(f"going on with a scan of {self._rims} rims")
            self._publish_soon()

    def _add(self, rim: Rim) -> Strip:
        with self.stages.timed("strip"):
            strip = self._surface.add(rim)
        self._rims += 1
        self.keeper.add_rim(rim, new=True)
        if len(self._surface):
            self._shown = self._surface
        return strip

    def _publish_strip(self, strip: Strip) -> None:
        with self.stages.timed("encode"):
            self.send("strip", encode_strip(strip))
        self.measure_latency(strip.stamp_ns)
        self._publish_soon()

    def _revise(self, rim: Rim) -> int:
        """A rim that comes again takes back points that later views show to be wrong, and
        brings those that need them."""
        with self.stages.timed("strip"), named("rim"):
            changed = self._surface.revise(rim)
        if changed:
            self.keeper.add_rim(rim, new=False)
        return changed

    # The whole mesh.

    def _publish_soon(self) -> None:
        """Arm the timer that publishes the mesh, as early as mesh_rate and the work allow."""
        if not self._flush.is_canceled():
            return
        pause = max(1 / self.settings.mesh_rate, self._mesh_took / _MESH_SHARE)
        wait = self._published_at + pause - time.monotonic()
        self._flush.timer_period_ns = max(1_000_000, int(wait * 1e9)) if wait > 0 else 1_000_000
        self._flush.reset()

    def _publish_mesh(self) -> None:
        self._flush.cancel()
        self._published_at = time.monotonic()
        with self.stages.timed("mesh"):
            whole = self._whole()
            self.send("mesh", encode_strip(whole))
        self._mesh_took = time.monotonic() - self._published_at
        if self._marker.get_subscription_count():
            with self.stages.timed("marker"):
                marker = encode_marker(whole, self.settings.marker_triangles)
                self.send("mesh_marker", marker)
        give_back_memory()

    def _on_marker_viewer(self, viewers: int) -> None:
        if viewers and len(self._shown):
            self._publish_soon()

    def _whole(self) -> Strip:
        whole = self._shown.whole()
        return whole if whole.frame_id else replace(whole, frame_id=self.settings.object_frame)

    # Services.

    def _on_reset(self) -> str:
        self._new_surface(time_went_back=False)
        self._shown = self._surface
        self._publish_mesh()
        return "ready for a new scan"

    def _on_save(self) -> str:
        words = self.keeper.save()
        self._checkpoint.sync()
        self._publish_mesh()
        return words

    # Life.

    def counts_later(self, old: MesherSettings, new: MesherSettings) -> str:
        """How rims are joined belongs to a whole scan; the rest counts at once."""
        return NEXT_SCAN if new.longest_step != old.longest_step else ""

    def destroy_node(self) -> None:
        """Save if asked to, then end."""
        for words in self.keeper.shut_down():
            self.lost |= words.startswith("error: ")
            # On stderr: what is logged on the way out may reach nobody.
            with suppress(OSError):  # of a terminal that is closed
                print(f"{self.get_name()}: {words}", file=sys.stderr, flush=True)
        self._checkpoint.close()
        super().destroy_node()

    def problems(self, counts: Counter[str]) -> Iterator[tuple[Level, str]]:
        """Whether anything comes, and whether it is kept."""
        if self._checkpoint.trouble:
            yield Level.WARN, self._checkpoint.trouble
        if self.loss.missed["rim"] and not self._checkpoint.recalled:
            yield (
                Level.WARN,
                f"{self.loss.missed['rim']} rims were sent before this node began: "
                "what they showed is not in the mesh; checkpoint_every and resume keep a scan",
            )
        saves = self.settings.finish_when_closed or self.settings.save_on_shutdown
        if saves and (why := self.keeper.files.unwritable()):
            yield Level.WARN, why
        if trouble := self.keeper.scan.trouble():
            yield Level.WARN, trouble
        if self._colouring and self._colouring.grey and not self._colouring.views:
            yield Level.WARN, "color is true, but the images are grey: there is no colour"
        if self.paused:
            yield Level.WARN, "paused: call ~/pause with data: false to go on"
        elif self.silent("rim", counts) and self.keeper.scan.state not in OVER:
            yield Level.WARN, f"no rims on {self.publishers_text('rim')}"

    def figures(self) -> dict[str, Any]:
        """The surface so far."""
        return {
            "rims": self._rims,
            "triangles": len(self._shown),
            "surface MB": round(self._surface.nbytes / 2**20, 1),
            **self.keeper.figures(),
            **self._checkpoint.figures(),
        }


def main() -> int:
    """Run the node until it is told to end."""
    return run_node(MesherNode)


if __name__ == "__main__":
    sys.exit(main())
