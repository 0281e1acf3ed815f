"""Observations and cameras: device arrays of each world that every frame refreshes as it ends."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.measure.observed import (
    MotionPart,
    choose_particles,
    clear_stretches,
    find_obstacles,
    join_motion,
    join_turning,
    join_volumes,
    stretch_membranes,
    stretch_springs,
    sum_motion,
    sum_particle_contacts,
    sum_turning,
    sum_volumes,
)
from balloon_warp.kernels.pictures.cameras import (
    PinholeCamera,
    Things,
    aim,
    cast_things,
    decode_depths,
    rasterize_triangles,
    show_colors,
)
from balloon_warp.kernels.steering import ByteRows, WordRows, copy_bytes, copy_words
from balloon_warp.mesh.topology import face_starts, triangulate
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
from balloon_warp.steering.controls import rows_of_words
from balloon_warp.system.api import Shown
from balloon_warp.system.warp_threads import launch

ROW_THREADS = 128
"""Number of threads that copy a world's rows on a GPU"""


class RowCopies:
    """Copies of rows between arrays, for the worlds of a mask.

    It has to live as long as a recorded graph that copies: the addresses of the arrays lie in memory of its own.

    Args:
        arrays: sources and targets, contiguous, with a row a world; a source may have one row for all.
        device: where they are.
    """

    def __init__(self, arrays: Iterable[tuple[wp.array, wp.array]], device: wp.Device):
        self._device = device
        self._arrays = [(rows_of_words(source), rows_of_words(target)) for source, target in arrays if target.size]
        self._tables = [self._table_of(rows) for rows in (WordRows, ByteRows)]

    def _table_of(self, rows: Any) -> wp.array:
        """Return the copies of words, or of bytes where rows do not fill words."""
        copies = []
        word = rows.vars["target"].type.dtype
        for source, target in self._arrays:
            if target.dtype == word:
                copy = rows()
                copy.source, copy.target = source, target
                copies.append(copy)
        return wp.array(copies, dtype=rows, device=self._device)

    def copy(self, mask: wp.array) -> None:
        """Copy the rows of worlds for which a mask is not 0."""
        threads = 1 if self._device.is_cpu else ROW_THREADS
        for kernel, table in zip((copy_words, copy_bytes), self._tables, strict=True):
            if table.size:
                shape = (mask.shape[0], threads)
                launch(kernel, shape, [mask, table, threads], device=self._device)


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
        sight: Any = PinholeCamera  # whose type Warp does not declare
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
        launch(cast_things, self._shape, things, [self._keys, self._normals], device=model.device)
        of_balloons = [mask, self._sights, self._corners, self._faces, state.torn, state.points, self._first]
        triangles = (model.world_count, self._corners.shape[0])
        launch(rasterize_triangles, triangles, of_balloons, [self._keys], device=model.device)
        if self._depth is not None:
            launch(decode_depths, self._shape, [mask, self._keys], [self._depth], device=model.device)
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


OF_MOTION = ("centers", "velocities")
OF_PARTICLES = "particle_contact_forces"
OF_STATE = (
    *("pressures", "gas_amounts", "sphere_positions", "sphere_velocities", "contact_forces"),
    *("body_positions", "body_velocities", "body_turns", "points", "first_bad"),
)
THREADS = 32
"""Number of threads that share a balloon on a GPU"""


class Observed(Protocol):
    """A simulator, as observations know it."""

    model: Model
    state: State

    def record_again(self) -> None: ...


class Observations(Shown):
    """Device arrays by name: `simulator.observations["centers"]`.

    They stay the same arrays until the simulator ends, and are refreshed within the recorded graph of every frame:

    - `centers`, `velocities`: means over each balloon's particles [m], [m/s], shape (world_count, balloon_count), vec3
    - `turns`: rotations of balloons by best fit, from their meshes as the scene places them, of that shape, quat
    - `volumes`: [m^3], shape (world_count, balloon_count), 0 or little for balloons that enclose nothing
    - `stretches`: the largest of each balloon's springs, or of its rubber or film, whether torn or not, of that shape
    - `particle_contact_forces`: on each particle in contact, averaged over the frame, where the scene asks for
      `contacts` [N], shape (world_count, particle_count), vec3
    - `obstacle_positions` [m], shape (world_count, obstacle_count), vec3
    - `pressures` [Pa], `gas_amounts` [mol], `sphere_positions`, `sphere_velocities`, `body_positions`,
      `body_velocities`, `body_turns`, `contact_forces` [N] where the scene asks for `contacts`, `points`, and
      `first_bad`: as the state has them

    `particles([...])` and `camera(...)` open arrays of chosen particles, and of a camera's view.
    """

    _internal = ("copies", "refresh", "refresh_chosen")

    def __init__(self, simulator: Observed):
        self._simulator = simulator
        model = simulator.model
        self._values: dict[str, wp.array] = {}
        self._chosen: list[tuple[wp.array, wp.array]] = []
        self._cameras: list[WorldCamera] = []
        self._particles = wp.array(model.particle_offsets, dtype=wp.int32, device=model.device)
        faces = np.cumsum([0, *(shape.mesh.face_count for shape in model.shapes)])
        self._faces = wp.array(faces, dtype=wp.int32, device=model.device)
        threads = 1 if model.device.is_cpu else THREADS
        self._shape = (model.world_count, model.balloon_count, threads)
        self._parts: dict[Any, wp.array] = {}

    def __repr__(self) -> str:
        return f"Observations({', '.join(self._values) or 'none is open'})"

    def __getitem__(self, name: str) -> wp.array:
        if name not in self._values:
            self._open(name)
        return self._values[name]

    def particles(self, numbers: Sequence[int]) -> wp.array:
        """Open an array of the places of chosen particles [m], shape (world_count, len(numbers)), vec3.

        Raises:
            InputError: there is no such particle.
        """
        model = self._simulator.model
        chosen = np.asarray(numbers)
        fits = chosen.ndim == 1 and chosen.size and chosen.dtype.kind in "iu"
        if not fits or chosen.min() < 0 or chosen.max() >= model.particle_count:
            raise InputError(
                f"particles: must be numbers from 0 to {model.particle_count - 1} (got {str(numbers)[:60]})"
            )
        which = wp.array(chosen, dtype=wp.int32, device=model.device)
        places = wp.zeros((model.world_count, len(chosen)), dtype=wp.vec3, device=model.device)
        self._chosen.append((which, places))
        self._begin()
        return places

    def camera(
        self, eye: ArrayLike, target: ArrayLike, width: int = 64, height: int = 64, angle: float = 60.0
    ) -> WorldCamera:
        """Open a camera in each world, whose `depth` and `color` are device arrays.

        Args:
            eye: place of the camera [m], shape (3,), or one for each world, shape (world_count, 3).
            target: place that it looks at [m], likewise.
            width: of the picture [pixels].
            height: of the picture [pixels].
            angle: of view from the picture's bottom to its top [degrees].

        Raises:
            InputError: a place, the size or the angle makes no sense.
        """
        camera = WorldCamera(self._simulator, self._begin, (eye, target), (width, height), angle)
        self._cameras.append(camera)
        return camera

    def _open(self, name: str) -> None:
        model, state = self._simulator.model, self._simulator.state
        shape = self._shape[:2]
        if name in OF_MOTION:
            self._values |= {each: wp.zeros(shape, dtype=wp.vec3, device=model.device) for each in OF_MOTION}
        elif name in ("volumes", "stretches"):
            self._values[name] = wp.zeros(shape, dtype=wp.float32, device=model.device)
        elif name == "turns":
            self._values[name] = wp.zeros(shape, dtype=wp.quat, device=model.device)
        elif name == "obstacle_positions":
            self._values[name] = wp.zeros((shape[0], len(model.obstacles)), dtype=wp.vec3, device=model.device)
        elif name in ("contact_forces", OF_PARTICLES) and not model.scene.contacts:
            raise InputError(f"{name}: needs contacts = true in the scene")
        elif name == OF_PARTICLES:
            self._values[name] = wp.zeros(state.points.shape, dtype=wp.vec3, device=model.device)
        elif name in OF_STATE:
            self._values[name] = wp.clone(getattr(state, name))
        else:
            others = ("turns", "volumes", "stretches", "obstacle_positions", OF_PARTICLES)
            known = ", ".join((*OF_MOTION, *others, *OF_STATE))
            raise InputError(f"{name}: no such observation; known are {known}, and particles([...])")
        self._begin()

    def _begin(self) -> None:
        self._simulator.record_again()
        self.refresh()

    def _parts_of(self, dtype: Any) -> wp.array:
        """Return the memory for parts of sums, which threads share."""
        if dtype not in self._parts:
            self._parts[dtype] = wp.zeros(self._shape, dtype=dtype, device=self._simulator.model.device)
        return self._parts[dtype]

    def _find_motion(self, model: Model, state: State, mask: wp.array | None) -> None:
        parts, moving = self._parts_of(MotionPart), [mask, self._particles, state.points]
        launch(sum_motion, self._shape, [*moving, state.velocities], [parts], device=model.device)
        found = [self._values[name] for name in OF_MOTION]
        launch(join_motion, self._shape[:2], [*moving, parts], found, device=model.device)

    @cached_property
    def _rest_arms(self) -> wp.array:
        """Particles of the meshes as the scene places them, from the centers of their balloons."""
        meshes = [shape.mesh.points for shape in self._simulator.model.shapes]
        arms = np.concatenate([points - points.mean(axis=0) for points in meshes])
        return wp.array(arms, dtype=wp.vec3, device=self._simulator.model.device)

    def _find_turns(self, model: Model, state: State, mask: wp.array | None) -> None:
        parts, inputs = self._parts_of(wp.mat33), [mask, self._particles, self._rest_arms, state.points]
        launch(sum_turning, self._shape, inputs, [parts], device=model.device)
        launch(join_turning, self._shape[:2], [mask, parts], [self._values["turns"]], device=model.device)

    def _find_volumes(self, model: Model, state: State, mask: wp.array | None) -> None:
        parts = self._parts_of(wp.float32)
        mesh = [self._particles, self._faces, model.face_offsets, model.face_particles]
        launch(sum_volumes, self._shape, [mask, *mesh, state.points], [parts], device=model.device)
        launch(join_volumes, self._shape[:2], [mask, parts], [self._values["volumes"]], device=model.device)

    def _find_obstacles(self, model: Model, state: State, mask: wp.array | None) -> None:
        values = self._values["obstacle_positions"]
        inputs = [mask, model.parameters["obstacle_position"], model.obstacle_motion, frames_of(model, state)]
        launch(find_obstacles, values.shape, inputs, [values], device=model.device)

    def _find_stretches(self, model: Model, state: State, mask: wp.array | None) -> None:
        stretches, threads = self._values["stretches"], self._shape[2]
        launch(clear_stretches, stretches.shape, [mask], [stretches], device=model.device)
        for kernel, tables in (
            (stretch_springs, [model.spring_particles, model.spring_rest_length]),
            (stretch_membranes, [model.membrane_corners, model.membrane_rests]),
        ):
            if tables[0].size:
                inputs = [mask, model.particle_balloon, *tables, threads, state.points]
                launch(kernel, (model.world_count, threads), inputs, [stretches], device=model.device)

    def refresh(self) -> None:
        """Refresh all arrays that are open."""
        self._find(None)
        for source, target in self._of_state():
            wp.copy(target, source)

    def refresh_chosen(self, mask: wp.array, copies: RowCopies) -> None:
        """Refresh the rows of worlds for which a mask is not 0, with the copies of `copies()`."""
        self._find(mask)
        copies.copy(mask)

    def copies(self) -> RowCopies:
        """Return the copies of rows of the state that are observed."""
        return RowCopies(self._of_state(), self._simulator.model.device)

    def _of_state(self) -> Iterator[tuple[wp.array, wp.array]]:
        """Yield arrays of the state that are observed, and their copies."""
        for name in OF_STATE:
            if name in self._values and self._values[name].size:
                yield getattr(self._simulator.state, name), self._values[name]

    def _find(self, mask: wp.array | None) -> None:
        """Compute the observations that the state does not have, for the worlds of a mask or for all."""
        model, state = self._simulator.model, self._simulator.state
        for name, find in (
            ("centers", self._find_motion),
            ("turns", self._find_turns),
            ("volumes", self._find_volumes),
            ("stretches", self._find_stretches),
            ("obstacle_positions", self._find_obstacles),
        ):
            if name in self._values:
                find(model, state, mask)
        if OF_PARTICLES in self._values:
            forces, inputs = self._values[OF_PARTICLES], [mask, state.contact_impulses, model.frame_seconds]
            launch(sum_particle_contacts, forces.shape, inputs, [forces], device=model.device)
        for which, places in self._chosen:
            launch(choose_particles, places.shape, [mask, which, state.points], [places], device=model.device)
        for camera in self._cameras:
            camera.refresh(mask)
