"""Recording of a batch after each frame: measures of each world, tracks of its parts, and shapes of exported ones."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, count
from pathlib import Path
from typing import Any, NamedTuple, Self, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from balloon_warp.batch.table import AXES, EXTREMES, Field
from balloon_warp.errors import InputError
from balloon_warp.frame import HostBuffer, things_of
from balloon_warp.kernels.laws import LAWS, Law
from balloon_warp.kernels.measure.observed import note_contacts
from balloon_warp.kernels.measure.worlds import (
    BalloonSums,
    measure_gas,
    measure_worlds,
    pick_healthy_worlds,
    pick_torn_faces,
    sum_balloons,
)
from balloon_warp.kernels.tables import HEALTHY
from balloon_warp.laws import require_laws
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import Model, ModelPlan, plan_model
from balloon_warp.model.parameters import (
    ALTITUDE,
    KEYFRAME_VALUES,
    SHAPING,
    VaryError,
    check_vary,
    places_of,
    rows_of,
    with_law_tables,
)
from balloon_warp.run.report import mesh_label
from balloon_warp.scene import Box, Scene
from balloon_warp.scene.fields import meaning_of, table_in
from balloon_warp.scene.load import override_scene
from balloon_warp.simulator import Simulator
from balloon_warp.steering.controls import rows_of_words
from balloon_warp.system.warp_threads import launch, lock_of, recording, replay


@dataclass(frozen=True)
class Track:
    """An array of the state, or an observation, as it goes into files."""

    name: str
    source: str
    dimensions: tuple[str, ...]
    """Names of the track's dimensions, after the world's"""
    unit: str
    meaning: str
    dtype: str = "<f4"


TRACKS = (
    Track("mesh_pos", "points", ("particle", "axis"), "m", "positions of particles"),
    Track("velocity", "velocities", ("particle", "axis"), "m/s", "velocities of particles"),
    Track("pressure", "pressures", ("balloon",), "Pa", "gauge pressures, 0 without pressure or gas"),
    Track("volume", "volumes", ("balloon",), "m^3", "enclosed volumes"),
    Track("gas_amount", "gas_amounts", ("balloon",), "mol", "amounts of gas, 0 without gas", "<f8"),
    Track(
        *("contact_force", "contact_forces", ("balloon", "thing", "axis"), "N"),
        "net force of each of `things` on each balloon, averaged over the frame before; where the scene has contacts",
    ),
    Track(
        *("particle_contact_force", "particle_contact_forces", ("particle", "axis"), "N"),
        "force of all things on each particle in contact, averaged over the frame before; where the scene has contacts",
    ),
    Track("sphere_pos", "sphere_positions", ("sphere", "axis"), "m", "positions of spheres"),
    Track("sphere_velocity", "sphere_velocities", ("sphere", "axis"), "m/s", "velocities of spheres"),
    Track("body_pos", "body_positions", ("body", "axis"), "m", "positions of free bodies"),
    Track("body_turn", "body_turns", ("body", "quaternion"), "1", "turns of free bodies: x, y, z, w"),
)
"""Tracks in the order of the files"""
OF_CONTACTS = ("contact_forces", "particle_contact_forces")
"""Sources that only scenes with contacts have"""
OBSERVED = ("volumes", "particle_contact_forces")
"""Sources that are observations"""
HEALTH = (
    "health",
    ("time",),
    "<i4",
    "1",
    "1; 0 from the frame in which the world blew up; 2 if restarted with shorter steps",
)


def tracks_of(plan: ModelPlan | Model) -> dict[Track, tuple[int, ...]]:
    """Find the tracks that a world has of `TRACKS`, and their shapes."""
    scene = plan.scene
    counts = AXES | {
        "particle": sum(shape.mesh.vertex_count for shape in plan.shapes),
        "balloon": len(plan.shapes),
        "thing": len(things_of(plan)),
        "sphere": len(scene.sphere),
        "body": len(scene.body),
    }
    told = [track for track in TRACKS if scene.contacts or track.source not in OF_CONTACTS]
    shapes = {track: tuple(counts[name] for name in track.dimensions) for track in told}
    return {track: shape for track, shape in shapes.items() if all(shape)}


def fields_of(plan: ModelPlan, frames: int) -> list[Field]:
    """Describe the moving arrays of a world's file."""
    moving = [
        Field(track.name, ("time", *track.dimensions), (frames, *shape), track.dtype, track.unit, track.meaning)
        for track, shape in tracks_of(plan).items()
    ]
    name, dimensions, dtype, unit, meaning = HEALTH
    return [*moving, Field(name, dimensions, (frames,), dtype, unit, meaning)]


def bytes_of_frame(plan: ModelPlan) -> int:
    """Return the memory of a world's frame."""
    return sum(field.bytes_of_frame for field in fields_of(plan, 1))


class Tracker:
    """Reads the tracks that go into files from a simulator.

    Args:
        simulator: of the worlds.
        every: which frames are read: 2 for every second.
    """

    def __init__(self, simulator: Simulator, every: int):
        self._every, self._simulator = every, simulator
        self._tracks = tracks_of(simulator.model)
        with lock_of(simulator.model.device):
            self._sources = {
                track.name: simulator.observations[track.source] for track in self._tracks if track.source in OBSERVED
            }

    def read(self) -> dict[str, NDArray] | None:
        """Read the frame that the simulator is at, if it is one of those, shape (world_count, ...) each."""
        if self._simulator.frame_number % self._every:
            return None
        return {track.name: self._copy(track, shape) for track, shape in self._tracks.items()}

    def _copy(self, track: Track, shape: tuple[int, ...]) -> NDArray:
        source: Any = self._sources.get(track.name)
        values = (getattr(self._simulator.state, track.source) if source is None else source).numpy()
        return np.array(values, dtype=track.dtype).reshape(len(values), *shape)  # a copy: on a CPU they go on changing


BatchVary = TypeAliasType("BatchVary", Mapping[str, Any])
"""Dotted paths of the scene, with a number for each world; for the path of a mesh, a mesh or its file for each"""
SHA256 = ".sha256"
"""End of the name of a value: the hash of the file that the value before it names"""
MOST_WORLDS = 100_000_000
"""Largest number of worlds, whose numbers alone take a gigabyte"""


@dataclass(frozen=True)
class Group:
    """Worlds of one model."""

    plan: ModelPlan
    worlds: NDArray[np.int64]
    """Numbers of the worlds in the batch, ascending"""

    def part(self, rows: NDArray[np.integer]) -> Self:
        """Return some of its worlds, by their numbers in its plan, ascending."""
        return replace(self, plan=self.plan.of_worlds(rows), worlds=self.worlds[rows])

    def those_of(self, chosen: NDArray[np.integer]) -> NDArray[np.integer]:
        """Find the chosen worlds of this group, by their numbers in the batch."""
        return self.worlds[self.rows_of(chosen)]

    def rows_of(self, chosen: NDArray[np.integer]) -> NDArray[np.integer]:
        """Find the chosen worlds of this group, by their numbers in its plan."""
        return np.flatnonzero(np.isin(self.worlds, chosen))


def plan_groups(scene: Scene, world_count: int, vary: BatchVary, laws: Sequence[Law] = ()) -> list[Group]:
    """Plan a model for each set of meshes, and of other values that need a model of their own.

    All take the same step, which suits the stiffest world.

    Args:
        laws: User-defined laws beside the built-in ones.

    Raises:
        InputError: as `plan_model`.
    """
    if world_count < 1:
        raise InputError(f"world_count {world_count}: expected at least 1")
    if world_count > MOST_WORLDS:
        raise InputError(f"world_count {world_count}: expected at most {MOST_WORLDS:,}")
    shaping = {path: _column(path, vary[path], world_count) for path in vary if SHAPING.fullmatch(path)}
    require_laws(laws)
    rows = rows_of((*LAWS, *laws))
    scene = with_law_tables(scene, rows)
    scalars = check_vary(scene, rows, world_count, {path: vary[path] for path in vary if path not in shaping})
    members: dict[tuple[Any, ...], Any] = {} if shaping else {(): np.arange(world_count)}
    for world in range(world_count if shaping else 0):
        members.setdefault(tuple(_identity(column[world]) for column in shaping.values()), []).append(world)
    groups = []
    for worlds in members.values():
        own_scene = _own_scene(scene, {path: column[worlds[0]] for path, column in shaping.items()}, worlds[0])
        own_values = {path: values[worlds] for path, values in scalars.items()}
        groups.append(Group(plan_model(own_scene, len(worlds), own_values, laws=laws), np.array(worlds)))
    substeps = max(group.plan.substeps for group in groups)
    return [replace(group, plan=replace(group.plan, substeps=substeps)) for group in groups]


def vary_columns(vary: BatchVary) -> dict[str, NDArray]:
    """Write varied values as columns of a table: numbers, and the meshes' names, shape (world_count,).

    Files are named without their folders: `BatchTask.varied` has their hashes.
    """
    return {
        path: np.array([_label(value) for value in values]) if is_mesh(path) else np.asarray(values, dtype=np.float64)
        for path, values in vary.items()
    }


def is_mesh(path: str) -> bool:
    """Return whether the values at a path are meshes."""
    return path.startswith("balloon.") and path.endswith(".mesh")


def _column(path: str, values: Any, world_count: int) -> list[Any]:
    """Write a value for each world: a mesh or a file, or a number, whole where it may be."""
    what = "mesh" if is_mesh(path) else "number"
    try:
        column = list(values)
    except TypeError:
        raise InputError(f"{path}: expected a {what} for each of {world_count} worlds (got {values})") from None
    if len(column) != world_count:
        raise InputError(f"{path}: expected a {what} for each of {world_count} worlds (got {len(column)})")
    if not is_mesh(path):
        return [value.item() if isinstance(value, np.generic) else value for value in column]
    return [Path(value) if isinstance(value, str) else value for value in column]


def _own_scene(scene: Scene, values: Mapping[str, Any], world: int) -> Scene:
    """Make the scene of a group, whose first world is given.

    Raises:
        VaryError: names that world, where a number is wrong.
    """
    for path, value in values.items():
        try:
            scene = override_scene(scene, [(path, value)])
        except InputError as mistake:
            raise VaryError(mistake if is_mesh(path) else f"{mistake}, in world {world}", path) from None
    return scene


def _identity(value: Any) -> Any:
    """Return a value that identifies a mesh without a file, and other values themselves."""
    return value if isinstance(value, Path | float | int | str) else id(value)


def _label(mesh: str | Path | PolygonMesh) -> str:
    return Path(mesh_label(mesh)).name


COLUMNS = {
    "force_mean": ("N", "net force of {pair}: mean magnitude over all frames"),
    "torque_mean": ("N m", "torque of {pair} about the mean of the latter's points: mean magnitude over all frames"),
    "area_mean": ("m^2", "contact area of {pair}: mean over all frames"),
    "pressure_mean": ("Pa", "largest pressure of {pair} on a particle: mean over all frames"),
    "force_max": ("N", "net force of {pair}: maximum over all frames"),
    "torque_max": ("N m", "torque of {pair} about the mean of the latter's points: maximum over all frames"),
    "area_max": ("m^2", "contact area of {pair}: maximum over all frames"),
    "pressure_max": ("Pa", "largest pressure of {pair} on a particle: maximum over all frames"),
}
"""Suffixes of a pair's columns, in the order in which a `Recorder` keeps them, with units and meanings"""


class Pair(NamedTuple):
    """A thing and a balloon that it pressed; of two balloons the first is the one that is pressed."""

    balloon: int
    thing: int
    label: str
    """Prefix of the pair's columns: "floor_on_ball" """
    sentence: str
    """Phrase for the pair: "floor on ball" """


def contacts_shape(plan: ModelPlan) -> tuple[int, int]:
    """Return how many balloons and things a world has, of which it is noted how they press; none unasked."""
    return len(plan.shapes), len(things_of(plan)) if plan.scene.contacts else 0


def pressing_pairs(plan: ModelPlan, contacts: NDArray[np.float32]) -> list[Pair]:
    """List the pairs that touched in any world, in the scene's order.

    Args:
        plan: of a world.
        contacts: of all worlds, shape (world_count, *contacts_shape(plan), len(COLUMNS)).
    """
    things = things_of(plan)
    first = len(things) - len(plan.shapes)
    names = _different(name.replace(" ", "_") for name in things)
    touched = (contacts > 0.0).any(axis=(0, 3))
    return [
        Pair(number, thing, f"{names[thing]}_on_{names[own]}", f"{things[thing]} on {things[own]}")
        for number, thing in np.argwhere(touched).tolist()
        for own in [first + number]
        if thing >= own or thing < first
    ]


def pair_columns(pairs: Sequence[Pair], contacts: NDArray[np.float32]) -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Yield names and values of the columns of pairs, shape (world_count,)."""
    for pair in pairs:
        for column, name in enumerate(COLUMNS):
            yield f"{pair.label}_{name}", contacts[:, pair.balloon, pair.thing, column]


def describe_pairs(pairs: Sequence[Pair]) -> dict[str, tuple[str, str]]:
    """Describe unit and meaning of the columns of pairs, by name."""
    return {
        f"{pair.label}_{name}": (unit, meaning.format(pair=pair.sentence))
        for pair in pairs
        for name, (unit, meaning) in COLUMNS.items()
    }


def _different(names: Iterable[str]) -> list[str]:
    """Make all names different: those that are the same as one before get numbers."""
    chosen: list[str] = []
    for name in names:
        numbered = (f"{name}_{number}" for number in count(1))
        chosen.append(next(free for free in chain([name], numbered) if free not in chosen))
    return chosen


LANES, MANY_LANES, LARGE = 32, 128, 1024
"""Numbers of threads that sum a balloon, and number of particles above which the largest one takes many: that follows
from the scene alone, so that a world's sums do not depend on its batch"""
MEASURES = ("volume", "area", "pressure", "center_height", "largest_stretch", "kinetic_energy")
"""Names of the measures: [m^3], [m^2], [Pa], [m], length over rest length, [J]"""
OF_GAS = ("moles", "mean_stretch", "thrust")
"""Names of the measures of scenes with gas: [mol], root of the area over that at the start, [N]"""


def columns_of(scene: Scene) -> list[str]:
    """List the measures of each world.

    It is `MEASURES`, the heights of spheres and of free bodies [m], how many balloons are in the box, how many have
    burst, and `OF_GAS`.
    """
    heights = [f"sphere_{number}_height" for number in range(len(scene.sphere))]
    heights += [f"body_{number}_height" for number in range(len(scene.body))]
    may_burst = any(balloon.material.strength is not None for balloon in scene.balloon)
    gas = any(balloon.inflation.kind == "gas" for balloon in scene.balloon)
    now_and_then = [*(["in_box"] if scene.box else []), *(["burst"] if may_burst else []), *(OF_GAS if gas else ())]
    return [*MEASURES, *heights, *now_and_then]


@dataclass(frozen=True)
class Record:
    """Frame of a batch, on the host; a world that blew up has its last good frame."""

    number: int
    measures: NDArray[np.float32]
    """Measures in the order of `columns_of`, shape (world_count, columns)"""
    healthy: NDArray[np.int32]
    """1, or 0 from the frame on in which the world blew up, shape (world_count,)"""
    points: NDArray[np.float32]
    """Points of the exported worlds [m], shape (chosen, particle_count, 3)"""
    sphere_positions: NDArray[np.float32]
    """Positions of spheres in the exported worlds [m], shape (chosen, sphere_count, 3)"""
    body_poses: NDArray[np.float32]
    """Poses of bodies in the exported worlds, as `Frame.body_poses`, shape (chosen, body_count, 7)"""
    torn: NDArray[np.int8]
    """Mask of torn faces in the exported worlds, shape (chosen, face_count), or (chosen, 0) where none may tear"""
    contacts: NDArray[np.float32] | None = None
    """Contact measures of each pair over all frames, in the last frame alone, shape (world_count,
    *contacts_shape(plan), len(COLUMNS))"""
    tracks: dict[str, NDArray] | None = None
    """Arrays for the files of worlds, by the names of `TRACKS`, shape (world_count, ...); of worlds that blew up,
    whatever there is"""

    @property
    def shapes(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.int8]]:
        """Shapes of the chosen worlds, in the order of `SHAPES`."""
        return self.points, self.sphere_positions, self.body_poses, self.torn


SHAPES = ("points", "sphere_positions", "body_poses", "torn")
"""Fields of a record that only exported worlds have"""
READ = ("measures", "healthy", "points", "sphere_positions", "body_positions", "body_turns", "torn")
"""Arrays on the device from which a frame's record is made"""


class Recorder:
    """Reads a simulator's frames.

    Args:
        simulator: of the worlds.
        chosen: the worlds whose shape is wanted.
        every: step between frames that go into files of worlds; 0 for none.
    """

    def __init__(self, simulator: Simulator, chosen: NDArray[np.integer], every: int = 0):
        self.simulator = simulator
        self._tracker = Tracker(simulator, every) if every else None
        with lock_of(simulator.model.device):
            self._allocate(chosen)

    def _allocate(self, chosen: NDArray[np.integer]) -> None:
        model, worlds, state = self.simulator.model, self.simulator.model.world_count, self.simulator.state

        def zeros(shape: Any, dtype: Any) -> wp.array:
            return wp.zeros(shape, dtype=dtype, device=model.device)

        def offsets(counts: list[int]) -> wp.array:
            return wp.array(np.cumsum([0, *counts]), dtype=wp.int32, device=model.device)

        self._balloon_particles = offsets([shape.mesh.vertex_count for shape in model.shapes])
        self._balloon_faces = offsets([shape.mesh.face_count for shape in model.shapes])
        self._balloon_springs = offsets([shape.springs.count for shape in model.shapes])
        self._triangle_faces = wp.array(model.triangle_faces, dtype=wp.int32, device=model.device)
        self._balloon_triangles = offsets([shape.membrane.count for shape in model.shapes])
        lanes = _lanes_of(shape.mesh.vertex_count for shape in model.shapes)
        self._sums = zeros((worlds, model.balloon_count, lanes), BalloonSums)
        columns = columns_of(model.scene)
        self._measures = zeros((worlds, len(columns)), float)
        self._box_column, self._burst_column, self._gas_column = (
            columns.index(name) if name in columns else -1 for name in ("in_box", "burst", OF_GAS[0])
        )
        self._first_area = sum(shape.area for shape in model.shapes)
        self._box = model.scene.box or Box(lower=(-1.0, -1.0, -1.0), upper=(1.0, 1.0, 1.0))
        self._healthy = wp.full(worlds, 1, dtype=wp.int32, device=model.device)
        self._chosen = wp.array(chosen, dtype=wp.int32, device=model.device)
        self._points = zeros((len(chosen), model.particle_count), wp.vec3)
        self._sphere_positions = zeros((len(chosen), model.sphere_count), wp.vec3)
        self._body_positions = zeros((len(chosen), model.body_count), wp.vec3)
        self._body_turns = zeros((len(chosen), model.body_count), wp.quat)
        self._torn = zeros((len(chosen), state.torn.shape[1]), wp.int8)
        self._contact_means = zeros(state.contact_forces.shape, wp.vec4)
        self._contact_peaks = zeros(state.contact_forces.shape, wp.vec4)
        stream = wp.get_stream(model.device) if model.device.is_cuda else None
        read = {name: array for name in READ if (array := getattr(self, f"_{name}")).size}
        self._buffers = [HostBuffer(read, partial(_copy_all, read), stream) for _ in range(2)]

    def read(self) -> Record:
        """Read the frame that the simulator is at."""
        return self._begin()()

    def run(self) -> Iterator[Record]:
        """Simulate from the start to the last frame; yield the record of each, while a GPU simulates the next."""
        end = self._begin()
        for _ in range(self.simulator.model.scene.frames):
            self.simulator.advance()
            before, end = end, self._begin()
            yield before()
        yield end()

    def _begin(self) -> Callable[[], Record]:
        """Start to copy the simulator's frame to the host; return a function that awaits it. Two may be under way."""
        number = self.simulator.frame_number
        with lock_of(self.simulator.model.device):
            replay(self._graph)
            buffer = self._buffers[number % len(self._buffers)]
            buffer.fill()
            tracks = self._tracker.read() if self._tracker else None
            contacts = self._contacts() if number == self.simulator.model.scene.frames else None
        return partial(self._end, number, buffer, tracks, contacts)

    def _end(
        self, number: int, buffer: HostBuffer, tracks: dict[str, NDArray] | None, contacts: NDArray[np.float32] | None
    ) -> Record:
        buffer.wait()

        def copy(name: str) -> NDArray:
            return buffer.copy(name) if name in buffer.arrays else _no(getattr(self, f"_{name}"))

        return Record(
            number=number,
            measures=copy("measures"),
            healthy=copy("healthy"),
            points=copy("points"),
            sphere_positions=copy("sphere_positions"),
            body_poses=np.concatenate([copy("body_positions"), copy("body_turns")], axis=2),
            torn=copy("torn"),
            tracks=tracks,
            contacts=contacts,
        )

    def _contacts(self) -> NDArray[np.float32]:
        both = self._contact_means, self._contact_peaks
        return np.concatenate([each.numpy() if each.size else _no(each) for each in both], axis=3)

    def save(self) -> Iterator[tuple[str, NDArray]]:
        """Iterate over all that a frame depends on of those before it, by name; one array at a time is on the host."""
        for name, array in {**self.simulator.state.arrays, **self._last_good}.items():
            with lock_of(array.device):
                values = array.numpy()
            yield name, values

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go on, with the simulator, from where another recorder of the same worlds was saved."""
        self.simulator.restore(saved)
        with lock_of(self.simulator.model.device):
            for name, array in self._last_good.items():
                array.assign(saved[name])

    @property
    def _last_good(self) -> dict[str, wp.array]:
        """Arrays of the last good frame, by names that the simulator does not use."""
        kept = (*READ, "contact_means", "contact_peaks")
        return {f"recorded_{name}": getattr(self, f"_{name}") for name in kept}

    @cached_property
    def _graph(self) -> Any:
        with recording(self.simulator.model.device) as capture:
            self._measure()
            self._pick()
        return capture.graph

    def _measure(self) -> None:
        model, state = self.simulator.model, self.simulator.state
        launch(
            sum_balloons,
            self._sums.shape,
            inputs=[
                *(self._balloon_particles, self._balloon_faces, self._balloon_springs, self._balloon_triangles),
                *(model.particle_mass_share, model.parameters["mass"], model.face_offsets, model.face_particles),
                *(model.spring_particles, model.spring_rest_length, model.membrane_corners, model.membrane_rests),
                *(self._triangle_faces, state.points, state.velocities, state.torn),
            ],
            outputs=[self._sums],
            device=model.device,
        )
        launch(
            measure_worlds,
            model.world_count,
            inputs=[
                *(self._balloon_faces, model.face_offsets, model.face_particles, model.parameters["mass"]),
                *(model.inflation_kind, model.keyframe_times, model.parameters["keyframe_values"]),
                *(model.frame_seconds, model.up, wp.vec3(*self._box.lower), wp.vec3(*self._box.upper)),
                *(state.frame, state.pressures, state.points, state.sphere_positions),
                *(state.body_positions, self._sums),
                *(state.first_bad, HEALTHY, self._box_column, self._burst_column, state.bursts),
            ],
            outputs=[self._measures, self._healthy],
            device=model.device,
        )
        if self._gas_column >= 0:
            given = [self._first_area, self._gas_column, state.gas_amounts, state.thrusts, self._healthy]
            launch(measure_gas, model.world_count, inputs=given, outputs=[self._measures], device=model.device)
        if self._contact_means.size:
            told = [state.contact_forces, state.contact_torques, state.contact_areas, state.contact_pressures]
            launch(
                note_contacts,
                self._contact_means.shape,
                inputs=[state.frame, self._healthy, *told],
                outputs=[self._contact_means, self._contact_peaks],
                device=model.device,
            )

    def _pick(self) -> None:
        model, state = self.simulator.model, self.simulator.state
        for every, picked in (
            (state.points, self._points),
            (state.sphere_positions, self._sphere_positions),
            (state.body_positions, self._body_positions),
            (state.body_turns, self._body_turns),
        ):
            if picked.size:
                words, target = rows_of_words(every), rows_of_words(picked)
                given = [words, self._healthy, self._chosen]
                launch(pick_healthy_worlds, target.shape, inputs=given, outputs=[target], device=model.device)
        if self._torn.size:
            given = [state.torn, self._healthy, self._chosen]
            launch(pick_torn_faces, self._torn.shape, inputs=given, outputs=[self._torn], device=model.device)


def record_bytes(plan: ModelPlan) -> int:
    """Return the device memory that a world takes for its measures."""
    lanes = _lanes_of(shape.mesh.vertex_count for shape in plan.shapes)
    return 40 * lanes * len(plan.shapes) + 4 * len(columns_of(plan.scene)) + contact_bytes(plan)


def _lanes_of(particle_counts: Iterable[int]) -> int:
    """Return the number of threads that sum each balloon of a scene."""
    return MANY_LANES if max(particle_counts) > LARGE else LANES


def contact_bytes(plan: ModelPlan) -> int:
    """Return the memory of a world's contact measures, on the device and on the host."""
    balloons, things = contacts_shape(plan)
    return 4 * len(COLUMNS) * balloons * things


def picked_bytes(plan: ModelPlan) -> int:
    """Return the device memory that a chosen world takes."""
    may_tear = any(balloon.material.strength is not None for balloon in plan.scene.balloon)
    faces = sum(shape.mesh.face_count for shape in plan.shapes) if may_tear else 0
    particles = sum(shape.mesh.vertex_count for shape in plan.shapes)
    return 12 * (particles + len(plan.scene.sphere)) + 28 * len(plan.bodies) + faces


def _copy_all(sources: Mapping[str, wp.array], targets: Mapping[str, wp.array]) -> None:
    for name, target in targets.items():
        wp.copy(target, sources[name])


def _no(array: wp.array) -> NDArray[np.float32]:
    """Return an array without elements as NumPy's."""
    width = {wp.vec3: (3,), wp.vec4: (4,), wp.quat: (4,)}.get(array.dtype, ())
    return np.zeros((*array.shape, *width), dtype=np.float32)


OF_ROWS = {
    "world": ("1", "number of the world, from 0"),
    "frame": ("1", "number of the frame; 0 is the start"),
    "time": ("s", "simulated time since the start"),
    "health": (
        "1",
        "1 for a good frame; 0 from the frame in which the world blew up, whose rows repeat the last good one; 2 for a "
        "world restarted with shorter steps",
    ),
    "ending": (
        "",
        "finished or blew up; for a world of the stage also the fate of a balloon that ended badly, such as falling or "
        "collapsed",
    ),
    "last_frame": ("1", "number of the last good frame"),
}
"""Unit and meaning of the columns that every table has"""
MEASURED = {
    "volume": ("m^3", "volume enclosed by all balloons"),
    "area": ("m^2", "area of all balloons"),
    "pressure": (
        "Pa",
        "gauge pressure, the mean of all balloons weighted by area; of normal forces, their sum over the area",
    ),
    "center_height": ("m", "height of the balloons' center along the up axis"),
    "largest_stretch": (
        "1",
        "largest length of a spring over its rest length; of rubber or film, the larger principal stretch",
    ),
    "kinetic_energy": ("J", "kinetic energy of all balloons"),
    "in_box": ("1", "number of balloons whose center is in the box"),
    "burst": ("1", "number of balloons that have burst"),
    "moles": ("mol", "amount of gas in all balloons"),
    "mean_stretch": ("1", "square root of the area over that at the start"),
    "thrust": ("N", "thrust of the jets of all necks"),
}
"""Unit and meaning of measured columns"""
KEYFRAMED_UNITS = {"k_normal": "100 N", "pressure": "Pa", "pump": "mol/s"}


def describe_columns(
    scene: Scene, varied: Iterable[str], laws: Sequence[Law] = (), pairs: Sequence[Pair] = ()
) -> dict[str, dict[str, str]]:
    """Describe unit and meaning of each column of `table` and of `worlds`, by name.

    The unit of numbers without one is "1", and that of words is empty.

    Args:
        varied: the paths of values that differ.
        laws: your own.
        pairs: that pressed each other.
    """
    told = dict(OF_ROWS) | {path: (unit, _meaning(path)) for path, unit in units_of(scene, varied, laws).items()}
    for name in columns_of(scene):
        unit, meaning = MEASURED.get(name, ("m", "height of its center along the up axis"))
        told[name] = unit, meaning
        told |= {f"{name}_{end}": (unit, f"{meaning}; {when}") for end, when in EXTREMES.items()}
    told |= describe_pairs(pairs)
    return {name: {"unit": unit, "meaning": meaning} for name, (unit, meaning) in told.items()}


def units_of(scene: Scene, paths: Iterable[str], laws: Sequence[Law]) -> dict[str, str]:
    """Return the units of varied values, by path: "1" of those without one, and nothing of words."""
    rows = rows_of((*LAWS, *laws))
    places, units = places_of(with_law_tables(scene, rows), rows), {row.name: row.unit for row in rows}
    found = {}
    for path in paths:
        name = places[path][0][0] if path in places else ""
        if path == ALTITUDE:
            found[path] = "m"
        elif name == KEYFRAME_VALUES.name:
            found[path] = next(unit for field, unit in KEYFRAMED_UNITS.items() if f".{field}" in path)
        else:
            found[path] = "" if path.endswith((".mesh", SHA256)) else units.get(name, "1")
    return found


def _meaning(path: str) -> str:
    """Return the schema's meaning of a field, or of the end of its path."""
    if path.endswith(SHA256):
        return f"SHA-256 of the file that {path.removesuffix(SHA256)} names, or of a mesh's arrays; in worlds"
    said, table = "", cast("Any", Scene)
    for name in (name for name in path.split(".") if not name.isdecimal()):
        if table is None or name not in table.model_fields:
            return ""  # of a law of one's own
        said, table = meaning_of(table, name), table_in(table.model_fields[name].annotation)
    return said
