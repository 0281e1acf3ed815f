"""Schedules `gather`, a thread a particle or a block of threads a patch, and `scatter`, a thread a spring or face.

`gather` sums the forces of a particle's own springs. Bit-reproducible.

For one large balloon: two buffers of points, one kernel a substep, one more for the spheres where there are any and
another where they exchange momentum, and three or four with gas. On a GPU one launch for all substeps of a frame, where
particles need of each other no more than where they are: the world is cut into patches.

`scatter` has a thread a spring, string, hinge or face, with atomic adds, and then a thread a particle: the readable
reference that every other schedule is tested against.

On a CPU, for busy worlds and for models of which no world is ever free, `gather` finds the forces of eight particles
side by side.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.contact import Solids
from balloon_warp.kernels.loops.springs import SlotTable
from balloon_warp.kernels.phase import STATE, Phase
from balloon_warp.kernels.schedules.block_names import Layout, access_of
from balloon_warp.kernels.schedules.lanes import ACCESS, pulling_arguments, pulling_kernel, pulling_source
from balloon_warp.kernels.schedules.lanes_layouts import OCTETS
from balloon_warp.kernels.schedules.launched import GATHERED, SUMMED, source_of
from balloon_warp.kernels.schedules.patches import PatchMemory, PatchTable, arguments_of_patches, kernel_of_patches
from balloon_warp.kernels.schedules.writer import Step, cut
from balloon_warp.kernels.substep import FACING, NOTHING, PULLED, SCATTERED, SHARED_PULL, phases_of
from balloon_warp.kernels.tables import SLICE, FaceTable, FanTable, MembraneTable, Tables
from balloon_warp.model import Model, State
from balloon_warp.model.state import Room
from balloon_warp.schedules.launched import LaunchedSchedule, Moving, Own
from balloon_warp.schedules.layouts import (
    MOST_REGISTERS,
    MOST_THREADS,
    REGISTERS,
    WARP_THREADS,
    allocate_lanes,
    make_lane_tables,
    thread_a_particle,
)
from balloon_warp.schedules.slices import Ring, SpringEnds, kind_slots, neighbors_in_slots, quad_rings, spring_ends
from balloon_warp.schedules.tables import Worlds, kept_arguments, model_features, volume_origins, world_state
from balloon_warp.schedules.touch_table import has_many
from balloon_warp.system.warp_threads import begin_loading, launch, launch_tiled

LEAST_THREADS = 256
"""Least number of threads of a block: with fewer particles a patch is mostly halo"""


@dataclass(frozen=True)
class Patches:
    """The patches of a world."""

    threads: int
    """Number of places of a patch for its own particles"""
    patch: NDArray[np.int64]
    """Patch of each particle, shape (particle_count,)"""
    place: NDArray[np.int64]
    """Place of each particle in its patch, shape (particle_count,)"""
    balloons: NDArray[np.int64]
    """Balloon of each patch"""
    volumes: bool
    """Whether each patch knows the particle about which its balloon's volume is summed"""
    halo_keys: NDArray[np.int64]
    """Keys of all halo particles, patch by patch: patch times the number of particles, plus the particle"""

    @property
    def count(self) -> int:
        """Number of patches of a world."""
        return len(self.balloons)

    @property
    def halo_offsets(self) -> NDArray[np.int64]:
        """Begin of each patch's halo, and the end of the last."""
        return np.searchsorted(self.halo_keys, np.arange(self.count + 1) * len(self.patch))

    @property
    def largest_halo(self) -> int:
        """Largest number of halo particles of a patch."""
        return int(np.diff(self.halo_offsets).max(initial=0))

    def places_of(self, owners: NDArray[np.int64], particles: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the places of particles in the patches of their owners."""
        patch = self.patch[owners]
        rank = np.searchsorted(self.halo_keys, patch * len(self.patch) + particles)
        in_halo = self.threads + rank - self.halo_offsets[patch]
        return np.where(self.patch[particles] == patch, self.place[particles], in_halo)


_CUT: WeakKeyDictionary[Model, Patches | None] = WeakKeyDictionary()


def patches_of(model: Model, volumes: bool) -> Patches | None:
    """Return the patches of a model, cut once, or None.

    They have as few threads a block as the multiprocessors of its device allow; there are none if the multiprocessors
    are too few.
    """
    if model not in _CUT:
        sizes = np.diff(model.particle_offsets)
        fitting = (
            threads
            for threads in range(LEAST_THREADS, MOST_THREADS + 1, WARP_THREADS)
            if sum(-(-sizes // threads)) <= model.device.sm_count
        )
        threads = next(fitting, None)
        _CUT[model] = cut_patches(model, threads, volumes) if threads else None
    return _CUT[model]


def cut_patches(model: Model, threads: int, volumes: bool) -> Patches:
    """Return the patches of at most so many particles, which lie close together at rest.

    Args:
        volumes: whether all of a balloon need the particle that its volume is measured from.
    """
    count = model.particle_count
    patch, place, balloons = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64), []
    for balloon, (shape, first) in enumerate(zip(model.shapes, model.particle_offsets, strict=False)):
        points = np.asarray(shape.mesh.points)
        for part in _halved(points, np.arange(len(points)), -(-len(points) // threads)):
            patch[first + part], place[first + part] = len(balloons), np.arange(len(part))
            balloons.append(balloon)
    owners, others = (np.concatenate(parts) for parts in zip(*_led_to(model, volumes), strict=True))
    outside = patch[owners] != patch[others]
    keys = np.unique(patch[owners[outside]] * count + others[outside])
    return Patches(threads, patch, place, np.array(balloons), volumes, keys)


def _halved(points: NDArray[np.floating], particles: NDArray[np.int64], parts: int) -> list[NDArray[np.int64]]:
    """Return a number of equal parts, each in order of number, by recursive bisection along the longest extent."""
    if parts == 1:
        return [np.sort(particles)]
    fewer = parts // 2
    places = points[particles]
    axis = int(np.argmax(np.ptp(places, axis=0)))
    order = particles[np.argsort(places[:, axis], kind="stable")]
    middle = len(particles) * fewer // parts
    return _halved(points, order[:middle], fewer) + _halved(points, order[middle:], parts - fewer)


def _led_to(model: Model, volumes: bool) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Return the particles, and others that their springs and faces lead to, and the volume of their balloon."""
    springs = model.spring_particles.numpy().astype(np.int64).reshape(-1, 2)
    corners = np.asarray(model.face_particles.numpy(), dtype=np.int64)
    offsets = np.asarray(model.face_offsets.numpy(), dtype=np.int64)
    sizes = np.diff(offsets)
    pairs = [(springs[:, 0], springs[:, 1]), (springs[:, 1], springs[:, 0])]
    for turn in range(1, int(sizes.max(initial=0))):  # each corner, and the one so many further
        face = np.repeat(np.arange(len(sizes)), sizes)
        within = np.arange(len(corners)) - offsets[face]
        wide = turn < sizes[face]
        pairs.append((corners[wide], corners[offsets[face] + (within + turn) % np.maximum(sizes[face], 1)][wide]))
    if volumes:
        balloon = np.asarray(model.particle_balloon.numpy(), dtype=np.int64)
        pairs.append((np.arange(model.particle_count), volume_origins(model)[balloon]))
    return pairs


def patch_table(model: Model, patches: Patches, measures_faces: bool) -> Any:
    """Return the table of patches for kernels.

    Args:
        measures_faces: Whether they measure faces, which are quads.
    """
    count = model.particle_count
    numbers = np.full((patches.count, patches.threads), count)
    numbers[patches.patch, patches.place] = np.arange(count)
    patch, particle = np.divmod(patches.halo_keys, count)
    halos = np.full((patches.count, patches.threads), -1)
    halos[patch, np.arange(len(patch)) - patches.halo_offsets[patch]] = particle
    in_halos = np.zeros(count)
    in_halos[particle] = 1
    origins = volume_origins(model)[patches.balloons] if patches.volumes else numbers[:, 0]

    def array(values: NDArray) -> wp.array:
        return wp.array(values, dtype=wp.int32, device=model.device)

    table = PatchTable()
    table.numbers, table.halos, table.in_halos = array(numbers), array(halos), array(in_halos)
    table.origins = array(patches.places_of(numbers[:, 0], origins))
    table.balloons = array(patches.balloons)
    table.firsts = array(np.searchsorted(patches.balloons, np.arange(model.balloon_count + 1)))
    if measures_faces:
        first = patches.patch[_corners_by_patch(model, patches)[:, 0]]
        table.face_offsets = array(np.searchsorted(first, np.arange(patches.count + 1)))
    return table


def _corners_by_patch(model: Model, patches: Patches) -> NDArray[np.int64]:
    """Return the corners of all quads, patch by patch: each in that of its first corner."""
    corners = model.face_particles.numpy().astype(np.int64).reshape(-1, 4)
    return corners[np.argsort(patches.patch[corners[:, 0]], kind="stable")]


def faces_in_patches(model: Model, patches: Patches) -> Any:
    """Return the faces, which are quads, patch by patch: their corners lead to places there."""
    corners = _corners_by_patch(model, patches)
    places = patches.places_of(np.broadcast_to(corners[:, :1], corners.shape), corners)
    table = FaceTable()
    table.offsets = wp.array(4 * np.arange(len(corners) + 1), dtype=wp.int32, device=model.device)
    table.particles = wp.array(places.ravel(), dtype=wp.int32, device=model.device)
    return table


def slots_in_patches(model: Model, patches: Patches, ring: Ring | None) -> Any:
    """Return the springs of each particle, which lead to places in its patch.

    Args:
        ring: in which structural and shear springs go around each particle, where that matters.
    """
    ends: SpringEnds = spring_ends(model)
    count = model.particle_count
    owners = np.arange(count)
    keys = count * (3 * ends.particle + ends.kind) + ends.neighbor
    neighbors, scales, lengths = [], [], []
    for kind in range(3):
        around = ring[kind] if ring and kind < 2 else neighbors_in_slots(ends, kind)
        there = around >= 0
        spring = np.searchsorted(keys, count * (3 * owners + kind) + around)
        spring[~there] = 0
        particles = np.where(there, around, owners)
        neighbors.append(patches.places_of(np.broadcast_to(owners, particles.shape), particles))
        scales.append(np.where(there, ends.scale[spring], 0.0) if len(keys) else np.zeros(around.shape))
        lengths.append(np.where(there, ends.rest_length[spring], 0.0) if len(keys) else np.zeros(around.shape))
    table = SlotTable()
    table.neighbors = wp.array(np.concatenate(neighbors), dtype=wp.int32, device=model.device)
    table.scales = wp.array(np.concatenate(scales), dtype=float, device=model.device)
    table.rest_lengths = wp.array(np.concatenate(lengths), dtype=float, device=model.device)
    table.valences = wp.array(ends.by_kind[:, 0], dtype=wp.int32, device=model.device)
    return table


def tables_in_patches(model: Model, patches: Patches, tables: Any, measures_faces: bool = False) -> Any:
    """Return the tables, but faces and membranes around a particle lead to places in its patch.

    Args:
        measures_faces: whether faces do, too, which are quads then.
    """
    t, fans, membranes = Tables(), FanTable(), MembraneTable()
    for kind, copy, original in (
        (Tables, t, tables),
        (FanTable, fans, tables.fans),
        (MembraneTable, membranes, tables.membranes),
    ):
        for name in kind.vars:
            setattr(copy, name, getattr(original, name))
    if tables.fans.quads is not None:
        fans.quads = _led(
            model, patches, _owners(model, tables.fans.slice_offsets, tables.fans.quads), tables.fans.quads
        )
    elif tables.fans.particles is not None:
        of_corners = np.repeat(np.arange(model.particle_count), np.diff(tables.fans.offsets.numpy()))
        owners = np.repeat(of_corners, np.diff(tables.fans.begins.numpy()))
        fans.particles = _led(model, patches, owners, tables.fans.particles)
    if tables.membranes.others is not None:
        owners = _owners(model, tables.membranes.slice_offsets, tables.membranes.others)
        membranes.others = _led(model, patches, owners, tables.membranes.others)
    t.fans, t.membranes = fans, membranes
    if measures_faces:
        t.faces = faces_in_patches(model, patches)
    return t


def _owners(model: Model, slice_offsets: wp.array, entries: wp.array) -> NDArray[np.int64]:
    """Return the particle that each entry of slices belongs to."""
    entry = np.arange(entries.shape[0])
    of_slice = np.searchsorted(slice_offsets.numpy()[1:-1], entry, side="right")
    return np.minimum(SLICE * of_slice + entry % SLICE, model.particle_count - 1)


def _led(model: Model, patches: Patches, owners: NDArray[np.int64], entries: wp.array) -> wp.array:
    particles = entries.numpy().astype(np.int64)
    of_each = owners if particles.ndim == 1 else np.broadcast_to(owners[:, None], particles.shape)
    return wp.array(patches.places_of(of_each, particles), dtype=entries.dtype, device=model.device)


BYTES_OF_PLACE = 12
"""Bytes of a point in shared memory"""
SUM_BYTES = 8192
"""Shared memory besides points [bytes]"""
PARAMS_REGISTERS, SUM_REGISTERS, MEMBRANE_REGISTERS = 56, 24, 32
"""Registers of a thread, besides those of its springs: always, where something is summed over balloons, and with
membranes"""
FEWER_REGISTERS = 32
"""Registers that may be spilled to local memory"""


def cut_into_patches(model: Model, features: Features) -> Patches | None:
    """Return the patches that worlds are moved in, or None.

    Worlds that fit a block's threads need none, and models whose particles need more of others than positions go launch
    by launch.
    """
    needs_others = (
        features.reads_neighbor_velocities
        or bool(features.active)
        or features.has("hinge")
        or features.has("face")
        or features.in_water
    )
    fixtures = features.may_touch_obstacles
    meets_others = features.spheres > 0 or fixtures or features.touches or features.meets_solids
    in_rounds = (
        features.corrected or features.gas_changes or (features.fresh_normals and (features.gas or not features.rings))
    )
    if model.device.is_cpu or thread_a_particle(model) or model.substeps < 2:
        return None
    if needs_others or meets_others or in_rounds or features.guarded or features.active:
        return None
    patches = patches_of(model, features.gas)
    if patches is None or patches.largest_halo > patches.threads:
        return None
    fits = bytes_of_block(patches) <= model.device.max_shared_memory_per_block
    return patches if fits and _registers(model, features, patches) else None


def _registers(model: Model, features: Features, patches: Patches) -> int:
    """Return the registers of a thread; 0 if there are too few for it."""
    springs = sum(kind_slots(spring_ends(model))) * (3 if features.springs_vary else 2)
    sums = features.gas or features.fresh_normals
    own = PARAMS_REGISTERS + (SUM_REGISTERS if sums else 0) + (MEMBRANE_REGISTERS if features.membranes else 0)
    wanted, most = -(-(springs + own) // 8) * 8, REGISTERS // patches.threads // 8 * 8
    return min(wanted, most) if wanted - most <= FEWER_REGISTERS and wanted <= MOST_REGISTERS else 0


def worlds_at_once(model: Model, features: Features, patches: Patches) -> int:
    """Return the number of worlds for which all blocks of patches are co-resident.

    Each multiprocessor runs at least as many threads as a block may have, whatever the GPU.
    """
    blocks = min(
        REGISTERS // (patches.threads * _registers(model, features, patches)),
        MOST_THREADS // patches.threads,
        model.device.max_shared_memory_per_block // bytes_of_block(patches),
    )
    return min(model.world_count, blocks * model.device.sm_count // patches.count)


def bytes_of_block(patches: Patches) -> int:
    """Return the shared memory of a block [bytes]."""
    return BYTES_OF_PLACE * (patches.threads + patches.largest_halo) + SUM_BYTES


def step_of_patches(features: Features, layout: Layout) -> Step:
    """Return the step that patches execute, in pieces, without phases that happen only as a frame begins."""
    instead = FACING if features.directions_on_the_way else NOTHING
    phases = [phase for phase in phases_of(features, instead=instead) if phase.light or not phase.once(features)]
    return cut(phases, features, access_of(layout, features.spheres), doubles=False, sums_along=True)


def first_phases(features: Features) -> tuple[Phase, ...]:
    """Return the phases that happen only as a frame begins."""
    return tuple(phase for phase in phases_of(features) if phase.once(features) and not phase.light)


class PatchLaunch:
    """Launch that advances all worlds by a frame, as many at a time as multiprocessors allow.

    Blocks wait for each other, and so must all be co-resident.

    Args:
        working: Working memory of launches beside the state.
    """

    def __init__(
        self, model: Model, features: Features, tables: Any, patches: Patches, arrays: dict[str, Any], working: Any
    ):
        self.model, self._patches = model, patches
        rings = quad_rings(model) if features.measures_areas or features.directions_on_the_way else None
        self._layout = layout_of_patches(model, features, patches, rings is not None)
        self._step = step_of_patches(features, self._layout)
        self._at_once = worlds_at_once(model, features, patches)
        self.memory = PatchMemory()
        for name, array in arrays.items():
            setattr(self.memory, name, array)
        self._named_inputs = {
            "t": tables_in_patches(model, patches, tables, features.directions_on_the_way),
            "slots": slots_in_patches(model, patches, rings),
            "patches": patch_table(model, patches, features.directions_on_the_way),
            "memory": self.memory,
            "working": working,
        }

    @staticmethod
    def arrays(model: Model, features: Features, patches: Patches, room: Room) -> dict[str, Any]:
        """Return the memory of `PatchMemory`."""
        worlds = worlds_at_once(model, features, patches)
        return {
            "points": room.array((2 * worlds * model.particle_count,), wp.vec4),
            "sums": room.array(
                (2 * 2 * worlds * patches.count if features.gas or features.fresh_normals else 0,), wp.vec4
            ),
        }

    def advance(self, state: State, inflation_directions: wp.array | None) -> None:
        """Run the substeps of a frame."""
        kernel = kernel_of_patches(self._step, self._layout)
        for first in range(0, self.model.world_count, self._at_once):
            worlds = min(self._at_once, self.model.world_count - first)
            self.memory.points.zero_()
            self.memory.sums.zero_()
            named_inputs = {
                **self._named_inputs, **kept_arguments(state), "state": world_state(state), "first_world": first,
                "worlds_at_work": worlds, "inflation_directions": inflation_directions,
            }  # fmt: skip
            launch_tiled(
                kernel,
                dim=[worlds, self._patches.count],
                inputs=[named_inputs[name] for name in arguments_of_patches(self._step, self._layout)],
                block_dim=self._patches.threads,
                device=self.model.device,
            )


def layout_of_patches(model: Model, features: Features, patches: Patches, rings: bool) -> Layout:
    """Return a particle a thread, with a tile for those of the rim, too."""
    return Layout(
        threads=patches.threads,
        capacity=patches.threads + max(patches.largest_halo, 1),
        held=1,
        slots=kind_slots(spring_ends(model)),
        rings=int(rings),
        registers=_registers(model, features, patches),
    )


class GatherSchedule(LaunchedSchedule):
    """Advances a state by whole frames, in place."""

    name = "gather"
    watchable = False
    fast_math = True
    access = GATHERED

    def __init__(self, model: Model, features: Features | None = None, working: Any | None = None):
        """Advance all worlds, or those that the features are for.

        Args:
            working: the memory beside the state, where others judge worlds there; they may have more features.
        """
        super().__init__(model, features)
        self.launches.working = working = working or self.launches.working
        patches = cut_into_patches(model, self.features)
        self._patches = None
        if patches:
            self._patches = PatchLaunch(model, self.features, self.tables, patches, self.vectors[0], working)

    @classmethod
    def step_of(cls, model: Model, features: Features) -> Step:
        """Return the phases of the model, in pieces.

        Resting contact has a launch of its own: of many particles on a GPU those without contact neither wait for
        others, nor take as many registers.
        """
        apart = ("leave",) if features.may_touch_obstacles and has_many(model) else ()
        if cut_into_patches(model, features):
            return cut(first_phases(features), features, cls.access, shown=("inflation_direction",))
        return cut(phases_of(features), features, cls.access, apart=apart)

    @classmethod
    def allocate(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
        """Allocate the memory of patches."""
        patches = cut_into_patches(model, features)
        return (PatchLaunch.arrays(model, features, patches, room),) if patches else ()

    def begin_loading(self) -> None:
        """Compile the kernels of a substep ahead."""
        self.launches.begin_loading()

    def advance_frame(self, state: State) -> None:
        """Advance all worlds by a frame."""
        if self._patches is None:
            super().advance_frame(state)
            return
        self.framing.begin(state)
        self.advance_patches(state)
        self.framing.end(state)

    def advance_patches(self, state: State) -> None:
        """Run the substeps of a frame in patches."""
        assert self._patches
        if self.launches.step.pieces:
            self.launches.substep(state, 0, (state.points, state.velocities))
        self._patches.advance(state, self.launches.values.get("inflation_direction"))


class ScatterSchedule(LaunchedSchedule):
    """Advances a state by whole frames, in place."""

    name = "scatter"
    access = SUMMED
    instead = SCATTERED

    def __init__(self, model: Model):
        super().__init__(model)
        self.forces, area_vectors = self.vectors
        """Forces of springs, strings, hinges and faces on each particle [N], shape (world_count, particle_count),
        vec3"""
        self.launches.working.forces, self.launches.working.area_vectors = self.forces, area_vectors

    @classmethod
    def allocate(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
        """Return the forces, and area vectors where they are needed."""
        worlds, particles = model.world_count, model.particle_count
        areas = (worlds, particles if features.measures_areas else 0)
        return room.array((worlds, particles), wp.vec3), room.array(areas, wp.vec3)

    def sum_forces(self, state: State) -> None:
        """Add up `forces` of a state, once."""
        self.launches.execute(state, 0, (state.points, state.velocities), ["add_forces"])


PULL = "pull"
"""Phase that a kernel of octets executes"""


class PullingOctets(GatherSchedule):
    """Advances a state by whole frames, in place; the phase `pull` is a launch of its own, of octets."""

    name = "octets"

    def __init__(self, model: Model, features: Features | None = None):
        super().__init__(model, features)
        self._states = Worlds()
        self._pulling = _pulling_step(self.launches.step)
        self._kernel = pulling_kernel(self._pulling)
        (memory,) = self.vectors
        t = make_lane_tables(model, self.features, OCTETS, self.tables)
        for struct, arrays in ((t, memory.of_tables), (solids := Solids(), memory.solids)):
            for name, array in arrays.items():
                setattr(struct, name, array)
        self._has: dict[str, Any] = {"t": t, "tables": self.tables, "solids": solids, **memory.of_kernel}

    @classmethod
    def step_of(cls, model: Model, features: Features) -> Step:
        """Return the phases of the model, in pieces: `pull` by itself."""
        phases = phases_of(features, instead=PULLED)
        names = [phase.name for phase in phases if not phase.light]
        after = names[names.index(PULL) + 1]
        return cut(phases, features, cls.access, apart=(PULL, after))

    @classmethod
    def allocate(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
        """Allocate the memory of octets."""
        return (allocate_lanes(model, _pulling_step(cls.step_of(model, features)), OCTETS, room),)

    @classmethod
    def source_of(cls, model: Model) -> str:
        """Return the source of the kernels that a model gets."""
        step = cls.step_of(model, model_features(model))
        return source_of(step, {PULL: pulling_source(_pulling_step(step))})

    def own(self) -> Mapping[str, Own]:
        """Return the phases that the schedule executes itself, by name."""
        return {**super().own(), PULL: self._pull}

    def begin_loading(self) -> None:
        """Compile the kernels of a substep ahead."""
        begin_loading(self._kernel, self.model.device)
        self.launches.begin_loading()

    def _pull(self, state: State, substep: int, now: Moving) -> None:
        """Find the forces on all particles."""
        places = {f"from_{view}": array for view, array in zip(STATE.values(), now, strict=True)}
        found = {f"to_{value}": self.launches.values[value] for value in self._pulling.pieces[-1].leaves}
        has = {
            **self._has, **places, **found, **kept_arguments(state), "clock": self.launches.clock, "substep": substep,
            "state": self._states.of(state), "working": self.launches.working,
        }  # fmt: skip
        inputs = [has[name] for name in pulling_arguments(self._pulling)]
        launch(self._kernel, self.model.world_count, inputs, device=self.model.device)


def _pulling_step(step: Step) -> Step:
    """Return the phases of an octet, in pieces, that compute the outputs of a step's `pull`."""
    (leaves,) = (piece.leaves for piece in step.pieces if piece.phases[0].name == PULL)
    features = step.features
    phases = [phase for phase in SHARED_PULL if phase.is_active(features)]
    return cut(phases, features, ACCESS[OCTETS], sums_along=True, apart=(PULL,), shown=leaves)
