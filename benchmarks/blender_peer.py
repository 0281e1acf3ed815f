"""Blender's cloth with pressure on the same balloons: its own implicit solver, at its default quality."""

import numpy as np

from balloon_warp.errors import MissingExtraError
from balloon_warp.model import Model, State

PRESSURE = 5.0
"""Blender's `uniform_pressure_force`"""


class BlenderPeer:
    """Advances one world's balloons by frames, like a schedule, as one cloth of Blender's.

    The cloth collides with nothing but itself, and with itself only where balloons touch; spheres and ground are left
    out.

    Meshes, masses, fixed particles, gravity and frame rate are the model's. Its springs are Blender's: stiffness 15, as
    it comes.

    Raises:
        MissingExtraError: bpy, Blender as a Python module, is not installed.
    """

    name = "blender"
    capturable = False

    def __init__(self, model: Model, pressure: float = PRESSURE):
        try:
            import bpy
        except ImportError:
            raise MissingExtraError("the peer needs bpy, Blender as a Python module: pip install bpy") from None
        self.model = model
        bpy.ops.wm.read_factory_settings(use_empty=True)
        data = bpy.data.meshes.new("balloons")
        data.from_pydata(model.initial_points.numpy().tolist(), [], _faces(model))
        self._balloon = bpy.data.objects.new("balloons", data)
        self._graph = bpy.context.evaluated_depsgraph_get
        self._scene = bpy.context.scene
        self._scene.collection.objects.link(self._balloon)
        self._scene.render.fps = round(1.0 / model.frame_seconds)
        self._scene.gravity = [-model.scene.gravity * component for component in model.scene.up]
        cloth = self._balloon.modifiers.new("cloth", "CLOTH")
        cloth.settings.mass = sum(balloon.mass for balloon in model.scene.balloon) / model.particle_count
        cloth.settings.use_pressure = True
        cloth.settings.uniform_pressure_force = pressure
        fixed = np.flatnonzero(model.particle_mass_share.numpy() == 0.0).tolist()
        if fixed:
            self._balloon.vertex_groups.new(name="fixed").add(fixed, 1.0, "REPLACE")
            cloth.settings.vertex_group_mass = "fixed"
        cloth.collision_settings.use_collision = False
        cloth.collision_settings.use_self_collision = model.scene.touches
        cloth.point_cache.frame_end = 100_000
        self._scene.frame_set(1)

    def advance_frame(self, state: State) -> None:
        """Advance Blender's own state by a frame."""
        self._scene.frame_set(self._scene.frame_current + 1)

    @property
    def points(self) -> np.ndarray:
        """Points of the cloth [m], shape (particle_count, 3)."""
        data = self._balloon.evaluated_get(self._graph()).data
        return np.array([vertex.co[:] for vertex in data.vertices])


def _faces(model: Model) -> list[list[int]]:
    """Return the faces of all balloons, by the particles of the world."""
    faces = []
    for shape, first in zip(model.shapes, model.particle_offsets[:-1], strict=True):
        corners = np.asarray(shape.mesh.face_vertex_indices) + first
        faces += [face.tolist() for face in np.split(corners, np.cumsum(shape.mesh.face_vertex_counts)[:-1])]
    return faces
