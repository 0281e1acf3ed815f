"""Frames: a world at one point in time on the host, its contact forces, and the way of worlds there from a device.

Worlds come as frames, forces and saved states; and as the answer whether they have come to rest.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Protocol, Self

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.law import FAR
from balloon_warp.kernels.measure.observed import law_measure, pull_kernel, spring_measure, string_measure
from balloon_warp.kernels.schedules.launched import GATHERED
from balloon_warp.kernels.schedules.writer import cut
from balloon_warp.kernels.substep import READING, phases_of
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import corners_beside, total_area, volume_and_area
from balloon_warp.model import Model, ModelPlan, State, copy_of, overwrite
from balloon_warp.model.obstacles import obstacle_poses
from balloon_warp.model.state import Allocating
from balloon_warp.schedules.launched import Launches
from balloon_warp.schedules.tables import make_tables, model_features, place_anchors, refresh_ramp, tables_of_world
from balloon_warp.system.api import Shown, described
from balloon_warp.system.warp_threads import launch, lock_of, recording, replay

PAIR_ARRAYS = ("forces", "torques", "areas", "pressures", "places")
"""Arrays of `State` for each pair, named after `contact_`"""


@described
@dataclass(frozen=True, repr=False)
class Contact(Shown):
    """Contact of a balloon with another thing, averaged over a frame."""

    balloon: str
    """Name of the balloon"""
    other: str
    """Name of the other thing: an obstacle, a body or a balloon; "ground", or "sphere 0" """
    force: NDArray[np.float64]
    """Force on the balloon [N], shape (3,); the other thing has the opposite"""
    torque: NDArray[np.float64]
    """Torque on the balloon about the mean of its points [N m], shape (3,)"""
    area: float
    """Contact area of the balloon [m^2]"""
    pressure: float
    """Largest pressure at a particle, its force over its share of the area; between two balloons, summed over both
    [Pa]"""
    place: NDArray[np.float64]
    """Center of pressure, the mean of the pressed places weighted by force [m], shape (3,)"""
    number: int
    """Index of the balloon in the scene"""
    thing: int
    """Index of the other thing among `things_of` the model"""

    def __repr__(self) -> str:
        force = ", ".join(f"{number:.3g}" for number in self.force)
        return f"Contact({self.other} on {self.balloon}: ({force}) N on {self.area:.3g} m^2)"


def things_of(model: Model | ModelPlan) -> list[str]:
    """Name all that balloons may touch, in the order in which kernels number it: see `kernels.loops.fixtures`."""
    scene = model.scene
    kinds = (("obstacle", scene.obstacle), ("body", scene.body))
    named = {kind: [each.name or f"{kind} {number}" for number, each in enumerate(things)] for kind, things in kinds}
    spheres = [f"sphere {number}" for number in range(len(scene.sphere))]
    return ["ground", *named["obstacle"], *spheres, *named["body"], *(shape.name for shape in model.shapes)]


def contacts_of(model: Model, told: Mapping[str, NDArray[np.float64]]) -> list[Contact]:
    """List the pairs that touched in a frame.

    Args:
        told: a world's `PAIR_ARRAYS`, by name.
    """
    things = things_of(model)
    return [
        Contact(
            balloon=model.shapes[number].name,
            other=things[thing],
            force=told["forces"][number, thing],
            torque=told["torques"][number, thing],
            area=float(told["areas"][number, thing]),
            pressure=float(told["pressures"][number, thing]),
            place=told["places"][number, thing],
            number=number,
            thing=thing,
        )
        for number, thing in np.argwhere(told["areas"] > 0.0).tolist()
    ]


@described
@dataclass(frozen=True, repr=False)
class Frame(Shown):
    """Frame of a world, on the host, as it is displayed or written."""

    number: int
    """Number of frames before it"""
    time: float
    """Time since the start [s]"""
    points: list[NDArray[np.float32]]
    """Positions of each balloon's particles [m], shape (particle_count, 3)"""
    velocities: list[NDArray[np.float32]]
    """Velocities of each balloon's particles [m/s], shape (particle_count, 3)"""
    net_forces: list[NDArray[np.float32]]
    """Net forces on each balloon's particles [N], shape (particle_count, 3); empty unless the scene asks for them"""
    inflation_forces: list[NDArray[np.float32]]
    """Inflation's part of `net_forces`; also without asking, where a balloon has the paper's inflation"""
    pressures: NDArray[np.float32]
    """Gauge pressures of balloons with pressure or gas [Pa], 0 for others, shape (balloon_count,)"""
    gas_amounts: NDArray[np.float64]
    """Amount of gas in each balloon [mol], shape (balloon_count,)"""
    thrusts: NDArray[np.float32]
    """Thrust of the jet of each balloon's neck [N], shape (balloon_count,)"""
    sphere_positions: NDArray[np.float32]
    """Positions of spheres [m], shape (sphere_count, 3)"""
    sphere_velocities: NDArray[np.float32]
    """Velocities of spheres [m/s], shape (sphere_count, 3)"""
    string_anchors: NDArray[np.float32]
    """Anchors of strings [m], shape (string_count, 3)"""
    string_lengths: NDArray[np.float32]
    """Lengths of strings [m], shape (string_count,)"""
    obstacle_poses: NDArray[np.float64]
    """Origins [m] and orientations of obstacles as quaternions (x, y, z, w), shape (obstacle_count, 7)"""
    body_poses: NDArray[np.float32]
    """Centers of mass [m] and orientations of bodies as quaternions (x, y, z, w), shape (body_count, 7)"""
    ground_height: float
    """Height of the ground [m], minus infinity where there is no ground"""
    water_level: float
    """Level of the water [m], minus infinity where there is no water"""
    meshes: list[PolygonMesh]
    """Meshes of the balloons at the start"""
    torn: list[NDArray[np.bool_]]
    """Mask of the torn faces of each balloon, shape (face_count,); empty where no balloon may burst"""
    contacts: list[Contact]
    """Contacts of balloons, averaged over the frame; empty unless the scene has `contacts`"""

    @property
    def volumes(self) -> NDArray[np.float64]:
        """Volume of each balloon [m^3], shape (balloon_count,).

        It is the enclosed volume of a closed one; 0 of one that burst, once it is open.
        """
        return self._volumes_and_areas[:, 0]

    @property
    def areas(self) -> NDArray[np.float64]:
        """Area of each balloon [m^2], shape (balloon_count,)."""
        return self._volumes_and_areas[:, 1]

    @property
    def stretches(self) -> NDArray[np.float64]:
        """Mean stretch of each balloon, shape (balloon_count,): the root of the area over that at the start."""
        areas = np.array([total_area(mesh) for mesh in self.meshes])
        return np.sqrt(self.areas / np.maximum(areas, np.finfo(float).tiny))

    @cached_property
    def _volumes_and_areas(self) -> NDArray[np.float64]:
        pairs = zip(self.meshes, self.points, strict=True)
        closed = [replace(mesh, points=points.astype(np.float64)) for mesh, points in pairs]
        measures = np.array([volume_and_area(mesh) for mesh in closed]).reshape(-1, 2)
        for number, torn in enumerate(self.torn):
            if torn.any():
                left = replace(closed[number], face_vertex_indices=self.corners(number))
                measures[number] = measures[number, 0] * (self.gas_amounts[number] > 0.0), volume_and_area(left)[1]
        return measures

    def corners(self, number: int) -> NDArray[np.int32]:
        """Find the vertices at the corners of a balloon's faces, one face after the other.

        A torn face has all of its corners at one vertex, and so no area.

        Returns:
            shape (corner_count,)
        """
        mesh = self.meshes[number]
        if not self.torn or not self.torn[number].any():
            return mesh.face_vertex_indices
        return corners_beside(mesh, self.torn[number])

    def __repr__(self) -> str:
        balloons = ", ".join(
            f"{mesh.name} of {mesh.vertex_count} particles and {volume:.3g} m^3"
            for mesh, volume in zip(self.meshes, self.volumes, strict=True)
        )
        return f"Frame({self.number}, {self.time:.3f} s: {balloons})"

    @property
    def is_finite(self) -> bool:
        """Return whether all numbers that are written of it are finite."""
        lists = (self.points, self.velocities, self.net_forces, self.inflation_forces)
        arrays = (self.pressures, self.gas_amounts, self.thrusts)
        arrays += (self.sphere_positions, self.sphere_velocities, self.body_poses)
        return all(np.isfinite(array).all() for array in (*(array for each in lists for array in each), *arrays))


PULL, INFLATE = "pull", "inflate"
"""Phases that begin a launch of their own"""
SHOWN = ("force", "area_vector", "inflation_direction", "inflation", "net_force")
"""Values that are kept of the phases"""


class ForceReader:
    """Finds the forces of a state, which a schedule need not keep.

    Args:
        batch: of which the model is one world.
    """

    def __init__(self, model: Model, batch: Model | None = None):
        self.model = model
        self._features = model_features(batch or model)
        self._tables = make_tables(batch or model, self._features)
        self._tables.step_seconds = 0.0  # forces as they are now, not on average over a step
        if batch:
            self._tables = tables_of_world(model, self._tables)
        step = cut(phases_of(self._features, READING), self._features, GATHERED, apart=(PULL, INFLATE), shown=SHOWN)
        self._launches = Launches(model, step, self._tables, Allocating(model.device))

    def beside(self, model: Model) -> Self:
        """Return a reader of another world of the same batch, which shares its memory with this one."""
        other = copy(self)
        other.model, other._tables = model, tables_of_world(model, self._tables)
        other._launches = self._launches.beside(model, other._tables)
        return other

    def refresh(self, state: State) -> None:
        """Update values at the begin of a frame: the ramp of k_normal, inflation directions and area vectors."""
        refresh_ramp(self.model, state)
        place_anchors(self.model, self._tables, state)
        self._execute(state, *self._first)
        if self._features.measures_areas:
            self._execute(state, PULL)

    def inflation_forces(self, state: State, substep: int = 0) -> wp.array:
        """Return the inflation's force on each particle [N], shape (world_count, particle_count), vec3.

        `refresh` must be called before.
        """
        self._execute(state, INFLATE, substep=substep)
        return self._launches.values["inflation"]

    def net_forces(self, state: State) -> wp.array:
        """Return the net force on each particle at the start of a frame [N], shape (world_count, particle_count), vec3.

        `refresh` must be called before.
        """
        self._execute(state, PULL, INFLATE)
        return self._launches.values["net_force"]

    def spring_pulls(self, state: State, time: float) -> wp.array:
        """Return the tension of each spring, negative if it pushes [N], shape (world_count, spring_count)."""
        return self._measure(spring_measure(self._features), state, time, 1, self.model.spring_count)[:, 0]

    def string_pulls(self, state: State, time: float) -> wp.array:
        """Return the tension of each string [N], shape (world_count, string_count)."""
        return self._measure(string_measure(self._features), state, time, 1, self.model.string_count)[:, 0]

    def pulls_by_law(self, state: State, time: float) -> dict[str, wp.array]:
        """Return the force of each law on each particle [N], shape (world_count, particle_count).

        Laws on particles, hinges or faces, and those of membranes.
        """
        features, laws = self._features, [law for law in self._features.laws if law.kind not in ("spring", "string")]
        alone = {law.name: features._replace(laws=(law,), membranes=()) for law in laws}
        alone |= {"membrane": features._replace(laws=())} if features.membranes else {}
        if not alone:
            return {}
        measure = law_measure(tuple(alone.values()))
        pulls = self._measure(measure, state, time, len(alone), self.model.particle_count)
        return {name: pulls[:, number] for number, name in enumerate(alone)}

    def _measure(self, measure: Any, state: State, time: float, measured: int, count: int) -> Any:
        worlds, device = self.model.world_count, self.model.device
        pulls = wp.zeros((worlds, measured, count), dtype=float, device=device)
        inputs = [self._tables, time, state.points, state.velocities]
        launch(pull_kernel(measure), (worlds, count), inputs, [pulls], device=device)
        return pulls

    @property
    def _first(self) -> list[str]:
        """Phases with which pieces begin before any force is found."""
        return [
            piece.phases[0].name for piece in self._launches.step.pieces if piece.phases[0].name not in (PULL, INFLATE)
        ]

    def _execute(self, state: State, *phases: str, substep: int = 0) -> None:
        """Execute the pieces that begin with given phases."""
        self._launches.execute(state, substep, (state.points, state.velocities), phases)


class Recorded:
    """Launches and copies that are done over and over.

    On a GPU they are recorded when they are first done again, since each of so many small ones would cost more than
    what it does.

    Args:
        do: all of them.
        stream: of a GPU, that they are queued in; None on a CPU.
    """

    def __init__(self, do: Callable[[], None], stream: wp.Stream | None):
        self._do, self._stream = do, stream
        self._times, self._graph = 0, None

    def __call__(self) -> None:
        """Run the recorded launches; on a GPU they go on in the background."""
        if not self._stream:
            self._do()
            return
        self._times += 1
        with wp.ScopedStream(self._stream, sync_enter=False):
            if self._times == 2:
                with recording(self._stream.device, self._stream) as capture:
                    self._do()
                self._graph = capture.graph
            if self._graph is None:
                self._do()
            else:
                replay(self._graph, stream=self._stream)


class HostBuffer:
    """Arrays on the host that are filled from a device, once or over and over.

    Args:
        sources: arrays of the shapes and types that these are to have.
        copy: copies into these.
        stream: of a GPU, that this is queued in; None on a CPU.
    """

    def __init__(
        self,
        sources: Mapping[str, wp.array],
        copy: Callable[[Mapping[str, wp.array]], None],
        stream: wp.Stream | None,
    ):
        self._stream = stream
        self.arrays = {
            name: wp.empty(source.shape, dtype=source.dtype, device="cpu", pinned=stream is not None)
            for name, source in sources.items()
        }
        self._fill = Recorded(partial(copy, self.arrays), stream)
        self.filled = wp.Event(stream.device) if stream else None

    def fill(self) -> None:
        """Copy all arrays; on a GPU it goes on in the background."""
        self._fill()
        if self._stream:
            self._stream.record_event(self.filled)

    def wait(self) -> None:
        """Wait until the buffer is filled."""
        if self.filled:
            with lock_of(self.filled.device):  # Warp refuses to wait while any thread records
                wp.synchronize_event(self.filled)

    def copy(self, name: str) -> NDArray:
        """Return a copy of an array, once the buffer is filled: the next filling does not change it."""
        return np.array(self.arrays[name].numpy())


class Reading:
    """A world on its way to the host.

    Args:
        number: of the frame.
        obstacle_motion: the model's, on the host.
        since: number of frames since the world began.
    """

    def __init__(
        self, model: Model, buffer: HostBuffer, number: int, *, obstacle_motion: NDArray[np.float32], since: int
    ):
        self.model, self.number = model, number
        self._buffer, self._obstacle_motion, self._since = buffer, obstacle_motion, since

    def frame(self) -> Frame:
        """Return the frame that was read, once it is there."""
        self._buffer.wait()
        return Frame(
            number=self.number,
            time=self.number * self.model.frame_seconds,
            points=self._moving_along("points"),
            velocities=self._moving_along("velocities"),
            net_forces=self._of_balloons("net_forces"),
            inflation_forces=self._of_balloons("inflation_forces"),
            pressures=self._row("pressures", np.float32),
            gas_amounts=self._row("gas_amounts", np.float64),
            thrusts=self._row("thrusts", np.float32),
            sphere_positions=self._rows("sphere_positions"),
            sphere_velocities=self._rows("sphere_velocities"),
            string_anchors=self._anchors(),
            string_lengths=self._row("string_length", np.float32),
            obstacle_poses=obstacle_poses(self._rows("obstacle_position"), self._obstacle_motion, self._since),
            body_poses=self._body_poses(),
            ground_height=self._height("ground_height"),
            water_level=self._height("water_level"),
            meshes=[shape.mesh for shape in self.model.shapes],
            torn=self._torn(),
            contacts=self._contacts(),
        )

    def first_bad(self) -> NDArray[np.int32]:
        """Return the first bad particle or sphere of every world, as `State.first_bad`, shape (world_count,)."""
        self._buffer.wait()
        return np.asarray(self._buffer.arrays["first_bad"].numpy(), dtype=np.int32)

    def _anchors(self) -> NDArray[np.float32]:
        """Return the anchors of strings, where they have moved to."""
        places = self._rows("string_anchor"), self._rows("obstacle_position"), self._body_poses()
        return self.model.carriers.anchors_at(*places, self._since).astype(np.float32)

    def _body_poses(self) -> NDArray[np.float32]:
        return np.concatenate([self._rows("body_positions"), self._rows("body_turns", 4)], axis=1)

    def _contacts(self) -> list[Contact]:
        """Return the contacts of pairs of things; none where nobody asks."""
        if "contact_forces" not in self._buffer.arrays:
            return []
        told = {name: self._row(f"contact_{name}", np.float64) for name in PAIR_ARRAYS}
        return contacts_of(self.model, told)

    def _torn(self) -> list[NDArray[np.bool_]]:
        """Return masks of the torn faces of each balloon, or none if none may tear."""
        if "torn" not in self._buffer.arrays:
            return []
        ends = np.cumsum([shape.mesh.face_count for shape in self.model.shapes])
        return np.split(self._row("torn", np.float32) >= 0.0, ends[:-1])

    def _row(self, name: str, dtype: Any) -> NDArray[Any]:
        """Copy the world's row of an array on the host, for whoever is to keep it."""
        return np.array(
            self._buffer.arrays[name].numpy()[0] if name in self._buffer.arrays else np.zeros(0), dtype=dtype
        )

    def _rows(self, name: str, size: int = 3) -> NDArray[np.float32]:
        """Copy the world's row of vectors."""
        return self._row(name, np.float32).reshape(-1, size)

    def _of_balloons(self, name: str) -> list[NDArray[np.float32]]:
        """Split the rows of particles by balloon; none if they are not read."""
        return np.split(self._rows(name), self.model.particle_offsets[1:-1]) if name in self._buffer.arrays else []

    def _moving_along(self, name: str) -> list[NDArray[np.float32]]:
        """Split rows by balloon, welded vertices with the rows of those that stand in for them."""
        stand_ins = (shape.mesh.stand_ins for shape in self.model.shapes)
        rows = self._of_balloons(name)
        return [own if others is None else own[others] for own, others in zip(rows, stand_ins, strict=True)]

    def _height(self, name: str) -> float:
        """Return the height of a surface [m], minus infinity where there is none."""
        height = float(self._row(name, np.float32)[()])
        return height if height > -FAR else -np.inf


MOST_RECORDED = 16
"""Largest number of worlds whose reading is recorded on a GPU; more are read launch by launch"""
STATE = (
    *("points", "velocities", "pressures", "gas_amounts", "thrusts"),
    *("sphere_positions", "sphere_velocities", "torn"),
    *("contact_forces", "contact_torques", "contact_areas", "contact_pressures", "contact_places"),
)
BODIES = ("body_positions", "body_turns")
PARAMETERS = ("string_anchor", "string_length", "obstacle_position", "ground_height", "water_level")


class FrameReader:
    """Copies worlds of a model to the host, one at a time."""

    def __init__(self, model: Model):
        self.model = model
        self._readers: dict[tuple[int, bool], WorldReader] = {}

    @cached_property
    def _stream(self) -> wp.Stream | None:
        return wp.Stream(self.model.device) if self.model.device.is_cuda else None

    @cached_property
    def _forces(self) -> Any:
        """Force arrays of the first world that is read; the others share its memory."""

        return ForceReader(self.model.of_world(0, copied=False), self.model)

    def begin(self, state: State, number: int, world: int, net_forces: bool, buffer: int = 0) -> Reading:
        """Begin to read one world of a state at the frame of that number; on a GPU it is under way then.

        Forces are read if they are wanted.

        Args:
            buffer: of the host, 0 or 1: two readings may be under way.
        """
        reader = self._readers.get((world, net_forces))
        if reader is None or reader.state is not state:
            model = self.model.of_world(world, copied=False)
            by_normals = any(balloon.inflation.kind == "normal_force" for balloon in model.scene.balloon)
            forces = self._forces.beside(model) if net_forces or by_normals else None
            reader = WorldReader(model, state, world, forces, net_forces, self._stream)
            if len(self._readers) < MOST_RECORDED:
                self._readers[world, net_forces] = reader
        return reader.begin(number, buffer)


class WorldReader:
    """Copies one world to the host.

    On a GPU it takes a copy there first; a stream of its own goes on with that, while the next frame is simulated.

    Args:
        model: of the world alone.
        state: of all worlds.
        forces: finder of the inflation's forces, or None if they are not read.
        net_forces: whether it finds those of all, too.
        stream: of a GPU; None on a CPU.
    """

    def __init__(self, model: Model, state: State, world: int, forces: Any, net_forces: bool, stream: wp.Stream | None):
        self.model, self.state = model, state
        self._forces, self._stream = forces, stream
        self._here, self._own, self._first_bad = state.of_world(world), state.of_world(world), state.first_bad
        if stream:
            self._own, self._first_bad = copy_of(self._here), wp.clone(state.first_bad)
        self._take_copy = Recorded(self._take, model.device.stream if stream else None)
        sources = {name: getattr(self._own, name) for name in (*STATE, *BODIES)}
        sources |= {name: model.parameters[name] for name in PARAMETERS}
        sources["first_bad"] = self._first_bad  # for all worlds, as a reader of one reads them all
        self._sources = {name: source for name, source in sources.items() if source.size}
        self._shown = {"inflation_forces": self._own.points} if forces else {}
        if net_forces:
            self._shown["net_forces"] = self._own.points
        self._obstacle_motion = np.asarray(model.obstacle_motion.numpy(), dtype=np.float32)
        self._buffers: dict[int, HostBuffer] = {}
        self._last: HostBuffer | None = None

    def begin(self, number: int, buffer: int) -> Reading:
        """Begin to read the frame of that number into that buffer."""
        if buffer not in self._buffers:
            self._buffers[buffer] = HostBuffer({**self._sources, **self._shown}, self._copy, self._stream)
        if self._stream:
            self._hand_over(self._stream)
        self._last = self._buffers[buffer]
        self._last.fill()
        ages = self.model.ages
        since = number if ages is None else int(np.asarray(ages.numpy())[0])
        return Reading(self.model, self._last, number, obstacle_motion=self._obstacle_motion, since=since)

    def _hand_over(self, reading: wp.Stream) -> None:
        """Hand the current state of the simulation to the reading stream, once the last copy is read."""
        simulating = self.model.device.stream
        if self._last and self._last.filled:
            simulating.wait_event(self._last.filled)
        self._take_copy()
        reading.wait_event(simulating.record_event())

    def _take(self) -> None:
        overwrite(self._own, self._here)
        wp.copy(self._first_bad, self.state.first_bad)

    def _copy(self, host: Mapping[str, wp.array]) -> None:
        """Copy all arrays to the host."""
        if self._forces:
            self._forces.refresh(self._own)
            if "net_forces" in host:
                wp.copy(host["net_forces"], self._forces.net_forces(self._own))
            wp.copy(host["inflation_forces"], self._forces.inflation_forces(self._own))
        for name, source in self._sources.items():
            wp.copy(host[name], source)


CHANGES = "set"
"""Name of the saved settings: JSON, pairs of a frame and the values by their paths"""


def packed(state: State, changes: Sequence[tuple[int, Mapping[str, Any]]]) -> dict[str, NDArray]:
    """Copy a state to the host, with the values set until then.

    Args:
        changes: pairs of a frame and the values by their paths.
    """
    arrays = {name: np.array(array.numpy()) for name, array in state.arrays.items()}
    if changes:
        arrays[CHANGES] = np.array(json.dumps(changes))
    return arrays


def saved_changes(saved: Mapping[str, NDArray]) -> list[tuple[int, dict[str, Any]]]:
    """Find the values set before a simulator was saved, in order."""
    return json.loads(str(saved[CHANGES])) if CHANGES in saved else []


class Restored(Protocol):
    """A simulator at its start, into which a saved one is restored."""

    frame_number: int
    state: State
    controls: Any
    starts: Any

    def set(self, changes: Mapping[str, Any]) -> None: ...

    def make_due_changes(self) -> None: ...


def go_back_to(simulator: Restored, saved: Mapping[str, NDArray]) -> None:
    """Restore a simulator at its start to a saved one, with all values set until then."""
    simulator.starts.open_saved(saved)
    simulator.controls.open_saved(saved)
    for frame, changes in saved_changes(saved):
        simulator.frame_number = frame
        simulator.set(changes)
    simulator.frame_number = int(saved["frame"][0]) - 1
    simulator.make_due_changes()
    simulator.frame_number += 1
    fill_state(simulator.state, saved)
    simulator.controls.restore(saved)
    simulator.starts.restore(saved)


def fill_state(state: State, saved: Mapping[str, NDArray]) -> None:
    """Fill a state with the arrays that were saved of one like it."""
    for name, array in state.arrays.items():
        if array.size:  # state that the scene does not have may be missing from the checkpoint
            array.assign(saved[name])


def plain_values(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Copy values that are set by their paths, NumPy's as those that JSON has."""
    return {
        path: value.tolist() if isinstance(value, np.ndarray | np.generic) else value for path, value in changes.items()
    }


CALM_SECONDS = 0.1
"""Duration without fast motion that counts as rest, so that a turning point of an oscillation does not [s]"""
ROUNDED = 32.0
"""Largest speed that rounding causes, in units in the last place of the coordinates a substep: some 10 were measured.
With thousands of substeps a frame that is more than a balloon that is all but at rest has"""


class Stepping(Protocol):
    """Part of a simulator's interface that waiting for rest needs."""

    model: Any
    state: Any

    def step_unread(self) -> None:
        """Advance every world by one frame."""
        ...


def relax(simulator: Stepping, speed: float, most_seconds: float) -> None:
    """Step until no particle has been faster for a while.

    Args:
        speed: of a particle, from one frame to the next; within a frame it may tremble as much as rounding makes it.

    Raises:
        InputError: something still moves after so much simulated time.
    """
    if not speed > 0.0:
        raise InputError(f"speed: must be above 0 (got {speed})")
    rate = simulator.model.scene.frames_per_second
    calm, fastest, before = 0, np.inf, _points(simulator)
    for _ in range(int(np.ceil(most_seconds * rate))):
        simulator.step_unread()
        points = _points(simulator)
        trembles = _largest(np.asarray(simulator.state.velocities.numpy(), dtype=np.float64))
        fastest = rate * _largest(points - before)
        if trembles > _of_rounding(simulator, points):
            fastest = max(fastest, trembles)
        before = points
        calm = calm + 1 if fastest <= speed else 0
        if calm > CALM_SECONDS * rate:
            return
    raise InputError(
        f"relax: the fastest particle still moves at {fastest:.3g} m/s after {most_seconds:g} s; expected at most "
        f"{speed:g}; more damping or time may help"
    )


def _points(simulator: Stepping) -> NDArray[np.float64]:
    return np.asarray(simulator.state.points.numpy(), dtype=np.float64)


def _largest(vectors: NDArray[np.float64]) -> float:
    return float(np.sqrt((vectors**2).sum(axis=-1).max(initial=0.0)))


def _of_rounding(simulator: Stepping, points: NDArray[np.float64]) -> float:
    """Return the speed up to which particles may tremble by rounding [m/s]."""
    model = simulator.model
    place = float(np.spacing(np.float32(np.abs(points).max(initial=0.0))))
    return ROUNDED * place * model.substeps * model.scene.frames_per_second
