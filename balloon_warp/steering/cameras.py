"""Cameras: depth and color of their pictures of each world, as device arrays that every frame refreshes as it ends."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.pictures.cameras import (
    Sight,
    Things,
    aim,
    see_things,
    see_triangles,
    show_colors,
    tell_depths,
)
from balloon_warp.launching import launch
from balloon_warp.mesh.geometry import triangulate
from balloon_warp.mesh.topology import face_starts
from balloon_warp.model import Model, State
from balloon_warp.model.state import frames_of
from balloon_warp.scene.around import (
    BODY_COLORS,
    GROUND_COLOR,
    OBSTACLE_COLOR,
    SPHERE_COLORS,
    balloon_color,
    looks_of_file,
    mean_color,
)
from balloon_warp.schedules.tables import solid_array
from balloon_warp.shown import Shown

MOST_PIXELS = 4096
"""Largest width and height"""


class Seen(Protocol):
    """A simulator, as cameras know it."""

    model: Model
    state: State


class WorldCamera(Shown):
    """A camera in each world: `camera = simulator.observations.camera(eye=(0, 1, 4), target=(0, 1, 0))`.

    `camera.depth` is an array of shape (world_count, height, width), float32: distance along the camera's axis of the
    surface that a pixel shows [m], infinite where there is nothing. `camera.color` is one of shape (world_count,
    height, width, 3), uint8, sRGB. Each is refreshed by every frame once it has been asked for. `eyes` and `targets`
    are arrays, too, shape (world_count,), vec3, which may be written on the device.

    Balloons, spheres, obstacles, bodies and the ground are seen, and nothing is translucent. Strings and water are not.
    """

    _internal = ("refresh",)

    def __init__(
        self,
        simulator: Seen,
        begin: Callable[[], None],
        places: tuple[ArrayLike, ArrayLike],
        size: tuple[int, int],
        angle: float,
    ):
        self._simulator, self._begin = simulator, begin
        model = simulator.model
        self._size = _checked_size(size)
        self._half_height = _checked_slope(angle)
        eye, target = (_places(name, given, model) for name, given in zip(("eye", "target"), places, strict=True))
        if (same := (eye == target).all(axis=1)).any():
            raise InputError(f"camera: target: must not be where the eye is, in world {int(np.argmax(same))}")
        self.eyes = wp.array(eye, dtype=wp.vec3, device=model.device)
        """Places of the cameras [m], shape (world_count,), vec3"""
        self.targets = wp.array(target, dtype=wp.vec3, device=model.device)
        """Places that the cameras look at [m], shape (world_count,), vec3"""
        sight: Any = Sight  # whose type Warp does not declare
        self._sights = wp.zeros(model.world_count, dtype=sight, device=model.device)
        self._obstacles = solid_array(model.obstacles, model.obstacle_meshes, model.device)
        self._bodies = solid_array([body.solid for body in model.bodies], model.body_meshes, model.device)
        self._first = 1 + model.sphere_count + len(model.obstacles) + model.body_count
        triangles, faces, colors = _triangles_of(model)
        self._corners = wp.array(triangles, dtype=wp.vec3i, device=model.device)
        self._faces = wp.array(faces, dtype=wp.int32, device=model.device)
        self._colors = wp.array([*_colors_of_things(model), *colors], dtype=wp.vec3, device=model.device)
        self._keys = wp.zeros(self._shape, dtype=wp.int64, device=model.device)
        self._normals = wp.zeros((0, 0, 0), dtype=wp.vec3, device=model.device)
        self._depth: wp.array | None = None
        self._color: wp.array | None = None

    def __repr__(self) -> str:
        width, height = self._size
        return f"WorldCamera({width} x {height} pixels, {self._shape[0]} worlds)"

    @property
    def _shape(self) -> tuple[int, int, int]:
        width, height = self._size
        return self._simulator.model.world_count, height, width

    @property
    def depth(self) -> wp.array:
        """Depths [m], infinite where nothing is seen, shape (world_count, height, width), float32."""
        if self._depth is None:
            self._depth = wp.zeros(self._shape, dtype=wp.float32, device=self._simulator.model.device)
            self._begin()
        return self._depth

    @property
    def color(self) -> wp.array:
        """Colors in sRGB, lit without shadows, shape (world_count, height, width, 3), uint8."""
        if self._color is None:
            device = self._simulator.model.device
            self._normals = wp.zeros(self._shape, dtype=wp.vec3, device=device)
            self._color = wp.zeros((*self._shape, 3), dtype=wp.uint8, device=device)
            self._begin()
        return self._color

    def refresh(self, mask: wp.array | None = None) -> None:
        """Refresh the requested arrays, in the worlds of a mask or in all."""
        if self._depth is None and self._color is None:
            return
        model, state = self._simulator.model, self._simulator.state
        width, height = self._size
        half = [self._half_height * width / height, self._half_height]
        aimed = [self.eyes, self.targets, model.up, *half]
        launch(aim, model.world_count, aimed, [self._sights], device=model.device)
        things = [mask, self._sights, self._things(model, state)]
        launch(see_things, self._shape, things, [self._keys, self._normals], device=model.device)
        of_balloons = [mask, self._sights, self._corners, self._faces, state.torn, state.points, self._first]
        triangles = (model.world_count, self._corners.shape[0])
        launch(see_triangles, triangles, of_balloons, [self._keys], device=model.device)
        if self._depth is not None:
            launch(tell_depths, self._shape, [mask, self._keys], [self._depth], device=model.device)
        if self._color is not None:
            lit = [self._sights, model.up, self._corners, state.points, self._colors, self._first]
            inputs = [mask, *lit, self._keys, self._normals]
            launch(show_colors, self._shape, inputs, [self._color], device=model.device)

    def _things(self, model: Model, state: State) -> Any:
        """Return all that is no balloon, as it is now."""
        things = Things()
        things.up, things.frame = model.up, frames_of(model, state)
        things.has_ground = int(model.scene.ground is not None)
        things.ground_heights = model.parameters["ground_height"]
        things.sphere_positions, things.sphere_radii = state.sphere_positions, model.parameters["sphere_radius"]
        things.obstacles, things.obstacle_motion = self._obstacles, model.obstacle_motion
        things.obstacle_positions = model.parameters["obstacle_position"]
        things.bodies, things.body_positions, things.body_turns = self._bodies, state.body_positions, state.body_turns
        return things


def _checked_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return width and height, if they are ones."""
    for name, pixels in zip(("width", "height"), size, strict=True):
        whole = isinstance(pixels, int | np.integer) and not isinstance(pixels, bool)
        if not whole or not 1 <= pixels <= MOST_PIXELS:
            raise InputError(f"camera: {name}: must be a whole number from 1 to {MOST_PIXELS} (got {str(pixels)[:60]})")
    return int(size[0]), int(size[1])


def _checked_slope(angle: float) -> float:
    """Return half of a picture's height at depth one, from its vertical angle of view [degrees]."""
    if not isinstance(angle, int | float | np.number) or not 1.0 <= angle <= 170.0:
        raise InputError(f"camera: angle: must be from 1 to 170 degrees (got {str(angle)[:60]})")
    return float(np.tan(np.radians(angle) / 2.0))


def _places(name: str, given: ArrayLike, model: Model) -> NDArray[np.float32]:
    """Return a place in each world, shape (world_count, 3)."""
    shape = (model.world_count, 3)
    try:
        values = np.asarray(given, dtype=np.float32)
    except (TypeError, ValueError):
        values = np.full(3, np.nan, dtype=np.float32)
    if values.shape not in ((3,), shape) or not np.isfinite(values).all():
        raise InputError(
            f"camera: {name}: must be a place, three numbers, or one for each world, of shape {shape} "
            f"(got {str(given)[:60]})"
        )
    return np.broadcast_to(values, shape)


def _triangles_of(model: Model) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """Return the triangles of all balloons: their corners, the faces that they are of, and their colors."""
    corners, of_faces, colors, faces = [], [], [], 0
    for number, (shape, particles) in enumerate(zip(model.shapes, model.particle_offsets, strict=False)):
        triangles, face = triangulate(shape.mesh)
        own = np.tile(np.array(balloon_color(model.scene, number)), (shape.mesh.face_count, 1))
        if looks := looks_of_file(shape.mesh, model.scene.balloon[number]):
            at_corners = looks.color_at_corners(balloon_color(model.scene, number))
            own = np.add.reduceat(at_corners, face_starts(shape.mesh)) / shape.mesh.face_vertex_counts[:, None]
        corners.append(triangles.astype(np.int64) + particles)
        of_faces.append(face.astype(np.int64) + faces)
        colors.append(own[face].astype(np.float32))
        faces += shape.mesh.face_count
    return np.concatenate(corners), np.concatenate(of_faces), np.concatenate(colors)


def _colors_of_things(model: Model) -> list[tuple[float, float, float]]:
    """Return the colors of the ground, spheres, obstacles and bodies, in that order."""
    scene = model.scene
    spheres = [ball.color or SPHERE_COLORS[n % len(SPHERE_COLORS)] for n, ball in enumerate(scene.sphere)]
    obstacles = [
        said.color or mean_color(shape.mesh, said, OBSTACLE_COLOR)
        for said, shape in zip(scene.obstacle, model.obstacles, strict=True)
    ]
    bodies = [
        said.color or mean_color(shape.solid.mesh, said, BODY_COLORS[n % len(BODY_COLORS)])
        for n, (said, shape) in enumerate(zip(scene.body, model.bodies, strict=True))
    ]
    return [GROUND_COLOR, *spheres, *obstacles, *bodies]
