"""Blender's cloth with pressure on the same balloon: its own implicit solver, at its default quality."""

import numpy as np

from balloon_warp.errors import MissingExtraError
from balloon_warp.model import Model, State

PRESSURE = 5.0
"""Blender's `uniform_pressure_force`"""


class BlenderPeer:
    """Advances one world's balloon by frames, like a schedule, without collisions. Spheres and ground are left out.

    Mesh, mass, gravity and frame rate are the model's. Its springs are Blender's: stiffness 15, as it comes.

    Raises:
        MissingExtraError: bpy, Blender as a Python module, is not installed.
    """

    name = "blender"
    capturable = False

    def __init__(self, model: Model):
        try:
            import bpy
        except ImportError:
            raise MissingExtraError("the peer needs bpy, Blender as a Python module: pip install bpy") from None
        self.model = model
        bpy.ops.wm.read_factory_settings(use_empty=True)
        mesh = model.shapes[0].mesh
        data = bpy.data.meshes.new(mesh.name)
        faces = np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1])
        data.from_pydata(mesh.points.tolist(), [], [face.tolist() for face in faces])
        self._balloon = bpy.data.objects.new(mesh.name, data)
        self._graph = bpy.context.evaluated_depsgraph_get
        self._scene = bpy.context.scene
        self._scene.collection.objects.link(self._balloon)
        self._scene.render.fps = round(1.0 / model.frame_seconds)
        self._scene.gravity = [-model.scene.gravity * component for component in model.scene.up]
        cloth = self._balloon.modifiers.new("cloth", "CLOTH")
        cloth.settings.mass = model.scene.balloon[0].mass / mesh.vertex_count
        cloth.settings.use_pressure = True
        cloth.settings.uniform_pressure_force = PRESSURE
        cloth.collision_settings.use_collision = False
        cloth.point_cache.frame_end = 100_000
        self._scene.frame_set(1)

    def advance_frame(self, state: State) -> None:
        """One frame, of Blender's own state."""
        self._scene.frame_set(self._scene.frame_current + 1)

    @property
    def points(self) -> np.ndarray:
        """[m], shape (particle_count, 3)"""
        data = self._balloon.evaluated_get(self._graph()).data
        return np.array([vertex.co[:] for vertex in data.vertices])
