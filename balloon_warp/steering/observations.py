"""Observations: device arrays of each world that every frame refreshes as it ends."""

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

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
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.model.state import frames_of
from balloon_warp.shown import Shown
from balloon_warp.steering.cameras import WorldCamera
from balloon_warp.steering.row_copies import RowCopies

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
