"""A turntable, lamps and a camera in Blender, for ``path_traced.py``.

The table turns about z before a fixed camera and lamps, or camera (and lamps) go around.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

Vector = Sequence[float]

_WIDER = 1.12  # of what a lens shows, that it bends into its picture
_FSTOP = 5.6  # of the camera in a hand


@dataclass(frozen=True)
class Shot:
    """The camera: size and focal length, px; distance and what it looks at, units; elevation,
    degrees; whether the table turns before it, the camera turns with lamps and backdrop, or it
    wanders over a hemisphere, or is held in a hand; noise, grey levels; quality of the JPEG; bars
    left and right, px; distortion of the lens, as OpenCV's; board.yaml of a sheet under the
    figure; by how much the exposure varies; the share of a turn that is seen; by how much the
    cameras that are told are off, px; the f-number (0: all is sharp), of units for metres."""

    width: int = 640
    height: int = 480
    focal: float = 1350.0
    distance: float = 6.0
    elevation: float = 16.0
    look: Vector = (0.0, 0.0, 0.5)
    views: int = 20
    moves: str = "table"
    noise: float = 2.0
    jpeg: int = 0
    bars: int = 0
    lens: Vector = ()
    board: str = ""
    exposure: float = 0.0
    share: float = 1.0
    off: float = 0.0
    fstop: float = 0.0

    @property
    def K(self) -> np.ndarray:
        """(3, 3), without bars."""
        return self._camera(self.width, self.height)

    @property
    def drawn(self) -> tuple[int, int]:
        """Width and height of what is drawn, px: more than the lens shows."""
        wide = _WIDER if self.lens else 1.0
        return 2 * round(wide * self.width / 2), 2 * round(wide * self.height / 2)

    def through_lens(self, image: np.ndarray) -> np.ndarray:
        """What is drawn, as the lens shows it."""
        if not self.lens:
            return image
        pixels = np.stack(np.meshgrid(np.arange(self.width), np.arange(self.height)), axis=-1)
        flat = pixels.astype(np.float64).reshape(-1, 1, 2)
        at = cv2.undistortPoints(flat, self.K, np.array(self.lens), P=self._camera(*self.drawn))
        at = at.reshape(self.height, self.width, 2).astype(np.float32)
        return np.asarray(cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR))

    def _camera(self, width: int, height: int) -> np.ndarray:
        cx, cy = (width - 1) / 2, (height - 1) / 2
        return np.array([[self.focal, 0, cx], [0, self.focal, cy], [0, 0, 1.0]])


class Studio:
    """A Blender scene. What is made belongs to ``figure`` unless another list is given."""

    def __init__(self, samples: int) -> None:
        import bpy

        self.bpy, self.samples = bpy, samples
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene = bpy.context.scene
        self.scene.render.engine = "CYCLES"
        self.scene.cycles.device = "CPU"
        self.scene.cycles.max_bounces = 2
        self.scene.cycles.use_adaptive_sampling = False
        self.scene.cycles.caustics_reflective = False
        self.scene.cycles.use_light_tree = False
        self.scene.cycles.denoising_prefilter = self.scene.cycles.denoising_quality = "FAST"
        self.scene.render.use_persistent_data = True
        self.scene.view_settings.view_transform = "Standard"
        self.scene.world = bpy.data.worlds.new("sky")
        self.scene.world.use_nodes = True
        self.figure: list[Any] = []
        self.turning: list[Any] = []  # turns with the figure but is none of it
        self.room: list[Any] = []
        self.cutters: list[Any] = []
        self.lamps: list[Any] = []

    # ---- what is photographed

    def sky(self, colour: Vector, strength: float) -> None:
        """Light from everywhere."""
        node = self.scene.world.node_tree.nodes["Background"]
        node.inputs[0].default_value, node.inputs[1].default_value = (*colour, 1), strength

    def lamp(self, at: Vector, size: float, power: float) -> None:
        """A square lamp that shines on the middle of the table."""
        from mathutils import Vector as V

        data = self.bpy.data.lights.new("lamp", "AREA")
        data.energy, data.size = power, size
        lamp = self.bpy.data.objects.new("lamp", data)
        self.bpy.context.collection.objects.link(lamp)
        lamp.location = at
        lamp.rotation_euler = (-V(at)).to_track_quat("-Z", "Y").to_euler()
        self.lamps.append(lamp)

    def material(
        self,
        colour: Vector,
        rough: float = 0.6,
        metal: float = 0.0,
        other: Vector | None = None,
        scale: float = 5.0,
        bump: float = 0.0,
        image: Path | None = None,
    ) -> Any:
        """A surface of one colour, clouded by another, or with a picture on it."""
        made = self.bpy.data.materials.new("material")
        made.use_nodes = True
        nodes, links = made.node_tree.nodes, made.node_tree.links
        shader = nodes["Principled BSDF"]
        shader.inputs["Base Color"].default_value = (*colour, 1)
        shader.inputs["Roughness"].default_value = rough
        shader.inputs["Metallic"].default_value = metal
        place = nodes.new("ShaderNodeTexCoord")
        if other is not None:
            cloud, ramp = nodes.new("ShaderNodeTexNoise"), nodes.new("ShaderNodeValToRGB")
            cloud.inputs["Scale"].default_value = scale
            cloud.inputs["Detail"].default_value = 6
            for end, (position, tone) in enumerate(((0.35, colour), (0.65, other))):
                ramp.color_ramp.elements[end].position = position
                ramp.color_ramp.elements[end].color = (*tone, 1)
            links.new(place.outputs["Object"], cloud.inputs["Vector"])
            links.new(cloud.outputs["Fac"], ramp.inputs["Fac"])
            links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
            if bump:
                relief = nodes.new("ShaderNodeBump")
                relief.inputs["Strength"].default_value = bump
                links.new(cloud.outputs["Fac"], relief.inputs["Height"])
                links.new(relief.outputs["Normal"], shader.inputs["Normal"])
        if image is not None:
            picture = nodes.new("ShaderNodeTexImage")
            picture.image, picture.extension = self.bpy.data.images.load(str(image)), "CLIP"
            links.new(place.outputs["UV"], picture.inputs["Vector"])
            links.new(picture.outputs["Color"], shader.inputs["Base Color"])
        return made

    def add(
        self,
        kind: str,
        material: Any,
        at: Vector,
        sides: Vector = (1, 1, 1),
        turned: Vector = (0, 0, 0),
        of: list[Any] | None = None,
        smooth: bool = True,
        **more: float,
    ) -> Any:
        """A primitive of Blender's (cube, uv_sphere, cylinder, cone, torus, monkey, plane)."""
        getattr(self.bpy.ops.mesh, f"primitive_{kind}_add")(location=at, rotation=turned, **more)
        made = self.bpy.context.active_object
        made.scale = sides
        made.data.materials.clear()
        made.data.materials.append(material)
        if smooth and kind in ("uv_sphere", "torus", "monkey"):
            for polygon in made.data.polygons:
                polygon.use_smooth = True
        if kind == "monkey":
            finer = made.modifiers.new("finer", "SUBSURF")
            finer.levels = finer.render_levels = 2
        (self.figure if of is None else of).append(made)
        return made

    def ball(self, m: Any, at: Vector, r: float, size: Vector = (1, 1, 1), tilt: float = 0) -> Any:
        """An ellipsoid."""
        more = {"segments": 48, "ring_count": 24, "radius": r}
        return self.add("uv_sphere", m, at, size, (0, tilt, 0), **more)

    def rod(self, m: Any, at: Vector, r: float, height: float, **more: Any) -> Any:
        """A cylinder, upright unless turned."""
        return self.add("cylinder", m, at, radius=r, depth=height, vertices=48, **more)

    def box(self, m: Any, at: Vector, size: Vector, **more: Any) -> Any:
        """A block of these sides."""
        return self.add("cube", m, at, [0.5 * side for side in size], **more)

    def hollow(self, solid: Any, at: Vector, r: float) -> None:
        """Cut a ball out of a solid."""
        cutter = self.ball(solid.data.materials[0], at, r)
        self.figure.remove(cutter)
        cutter.hide_render = True
        cut = solid.modifiers.new("cut", "BOOLEAN")
        cut.object, cut.operation = cutter, "DIFFERENCE"
        self.cutters.append(cutter)

    def floor(self, material: Any, z: float = -0.05, wall: Any = None, away: float = 5.0) -> None:
        """A table, and a wall behind it."""
        self.box(material, (0, 0, z), (12, 12, 0.1), of=self.room)
        if wall is not None:
            self.box(wall, (0, away, 2), (16, 0.1, 8), of=self.room)

    def cloth(self, material: Any, away: float = 7.0) -> None:
        """A backdrop alone."""
        self.box(material, (0, away, 0), (30, 0.1, 30), of=self.room)

    # ---- the camera

    def begin(self, shot: Shot) -> None:
        """Camera, turntable, rig."""
        bpy, render = self.bpy, self.scene.render
        render.resolution_x, render.resolution_y = shot.drawn
        render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGBA"
        data = bpy.data.cameras.new("camera")
        data.sensor_fit, data.sensor_width, data.clip_end = "HORIZONTAL", 36, 100
        data.lens = shot.focal * 36 / shot.drawn[0]
        if shot.board or shot.fstop:
            data.dof.use_dof, data.dof.aperture_fstop = True, shot.fstop or _FSTOP
            data.dof.focus_distance = shot.distance
        self.camera, self.table, self.rig = (
            bpy.data.objects.new(name, content)
            for name, content in (("camera", data), ("table", None), ("rig", None))
        )
        for made in (self.camera, self.table, self.rig):
            bpy.context.collection.objects.link(made)
        self.scene.camera = self.camera
        for made in (*self.figure, *self.turning, *self.cutters):
            made.parent = self.table
        if shot.moves == "rig":
            for made in (*self.lamps, *self.room):
                made.parent = self.rig
        cover = bpy.data.materials.new("cover")
        cover.use_nodes = True
        nodes = cover.node_tree.nodes
        nodes.clear()
        light, out = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
        cover.node_tree.links.new(light.outputs[0], out.inputs[0])
        self.cover = cover

    def pose(self, shot: Shot, turn: float) -> np.ndarray:
        """(4, 4) from the turntable to the optical frame, after a turn, radians."""
        from mathutils import Matrix, Vector

        hand = np.random.default_rng(round(1e6 * turn) + 10**8).normal(size=6)
        hand *= shot.moves == "hand"
        high = (
            25 * np.sin(3 * turn) * (shot.moves == "hemisphere")
            + 4 * hand[0]
            + 9 * np.sign(hand[1])
        )
        elevation = np.radians(shot.elevation + high)
        around = 0.0 if shot.moves == "table" else turn
        away = (
            np.sin(around) * np.cos(elevation),
            -np.cos(around) * np.cos(elevation),
            np.sin(elevation),
        )
        look = Vector(shot.look) + Vector((0.07 * hand[2:5]).tolist())
        centre = look + float(shot.distance * (1 + 0.06 * hand[1])) * Vector(away)
        looks = (look - centre).to_track_quat("-Z", "Y").to_matrix().to_4x4()
        looks = looks @ Matrix.Rotation(0.05 * hand[5], 4, "Z")
        self.camera.matrix_world = Matrix.Translation(centre) @ looks
        self.table.rotation_euler = (0, 0, turn if shot.moves == "table" else 0.0)
        self.rig.rotation_euler = (0, 0, turn if shot.moves == "rig" else 0.0)
        self.bpy.context.view_layer.update()
        to_camera = np.diag([1, -1, -1, 1.0]) @ np.linalg.inv(np.array(self.camera.matrix_world))
        return to_camera @ np.array(self.table.matrix_world)

    def photograph(self, folder: Path) -> np.ndarray:
        """(h, w, 3) uint8 BGR."""
        self.scene.render.film_transparent = False
        self.scene.cycles.samples, self.scene.cycles.use_denoising = self.samples, True
        return self._shot(folder)[..., :3]

    def mask(self, folder: Path, samples: int) -> np.ndarray:
        """(h, w) uint8, the share of each pixel that the figure covers, through the same filter."""
        layer = self.bpy.context.view_layer
        for made in (*self.room, *self.turning):
            made.hide_render = True
        self.scene.render.film_transparent, layer.material_override = True, self.cover
        self.scene.cycles.samples, self.scene.cycles.use_denoising = samples, False
        found = self._shot(folder)[..., 3]
        layer.material_override = None
        for made in (*self.room, *self.turning):
            made.hide_render = False
        return found

    def _shot(self, folder: Path) -> np.ndarray:
        self.scene.render.filepath = str(folder / "shot.png")
        self.bpy.ops.render.render(write_still=True)
        return np.asarray(cv2.imread(str(folder / "shot.png"), cv2.IMREAD_UNCHANGED))
