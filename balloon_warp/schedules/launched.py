"""Schedules that launch a kernel for each piece of a substep, their memory, and balloons that touch in them."""

from abc import ABC
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from copy import copy
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import warp as wp

from balloon_warp.kernels.contact.boxes import (
    ARE_NEAR,
    box_balloons,
    box_leaves,
    line_up_boxes,
    meet_kernel,
    row_count,
)
from balloon_warp.kernels.contact.edges import (
    QUERY_THREADS,
    box_edges,
    query_kernel,
)
from balloon_warp.kernels.contact.response import response_kernel, take_counts
from balloon_warp.kernels.contact.search import find_kernel, searching_kernel
from balloon_warp.kernels.contact.spheres import mark_count
from balloon_warp.kernels.contact.triangles import MOST_LEAVES, near_leaves_kernel
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import STATE, Access, Item, Phase
from balloon_warp.kernels.schedules.launched import (
    ITEMS_OF_LIST,
    ITEMS_OF_PART,
    Part,
    acts_on_few,
    arguments_of,
    kernel_of,
    tested_ahead,
)
from balloon_warp.kernels.schedules.writer import Piece, Step, cut, values_of
from balloon_warp.kernels.substep import NOTHING, Instead, phases_of
from balloon_warp.kernels.working import LENGTHS, EightBoxes, EightPlaces, Working
from balloon_warp.model import Model, State
from balloon_warp.model.state import Allocating, Counting, Room, contact_shape
from balloon_warp.schedules.frames import FramePiece, Rounds, make_clock
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.membranes import left_array, tear_arrays
from balloon_warp.schedules.tables import (
    Worlds,
    choosing_parameters,
    clearance_arrays,
    kept_arguments,
    make_tables,
    model_features,
)
from balloon_warp.schedules.touch_table import (
    ENOUGH_THREADS,
    FEW_THREADS,
    ContactLists,
    counting_arrays,
    edge_count,
    has_lists,
    leaf_count,
    list_arrays,
    ridge_arrays,
    solid_arrays,
    start_of_frame,
    substeps_of_search,
    sweep_arrays,
    threads_of_list,
)
from balloon_warp.system.warp_threads import begin_loading, launch, launch_tiled

TEAM_THREADS = 256
"""Threads of a block for phases of a world and for sums, on a GPU; more would have too few registers"""
TEAM_THREADS_OF_SMALL, SMALL = 64, 1024
"""Threads where no balloon has more particles: more blocks then run at once, while one thread of each ends its sum"""
EDGE_THREADS = 256
"""Threads of a block for edges that touch: where a thread has fewer pairs, its block waits less"""
EDGE_REGISTERS, SOLID_REGISTERS = 64, 128
"""Registers of a thread of a whole world's block in sweeps over contacts, at most, where these are of edges alone, and
where solids meet, too: so that a multiprocessor has more of them at once"""
MOST_REGISTERS = 128
"""Registers of a thread with a particle, so that a multiprocessor has two blocks of 256 where particles touch
obstacles, too"""
FEW_REGISTERS = 64
"""Registers where obstacles are left in another launch, and of faces: a multiprocessor has four blocks"""
ROUGH = {"pull", "push_face", "leave"}
"""Phases for which a GPU's own division and root will do"""
SWEEPS = {"meet", "meet_ridges"}
"""Phases of sweeps over contacts"""
LISTING_THREADS = 32
"""Threads of a block that lists particles, of which few have anything to do"""
LARGE = 2048
"""Number of particles of a balloon above which it is summed in parts"""
Moving = tuple[wp.array, wp.array]
"""Points and velocities, shape (world_count, particle_count), vec3"""
Own = Callable[[State, int, Moving], None]
"""Function of (state, substep, points and velocities) for a phase that the host runs itself"""


class _PieceLaunch(NamedTuple):
    """Kernel of a piece, and the arguments of each launch."""

    kernel: Any
    names: tuple[str, ...]
    """Names of the kernel's arguments"""


class Launches:
    """Launch each piece of a step.

    Args:
        own: functions of the host's phases, by the names of phases.
        fast_math: whether a GPU's own division and root will do, see `ROUGH`.
    """

    def __init__(
        self, model: Model, step: Step, tables: Any, room: Room, own: Mapping[str, Own] | None = None, *,
        fast_math: bool = False,
    ):  # fmt: skip
        self.model, self.step, self.tables = model, step, tables
        self._own, self._fast_math, self._worlds = own or {}, fast_math, Worlds()
        self._pieces: dict[tuple[int, Part], _PieceLaunch] = {}
        self.clock = make_clock(model)
        self.working = Working()
        for name, array in working_arrays(model, step.features, room).items():
            setattr(self.working, name, array)
        self.values, self._parts, self._second = step_arrays(model, step, room)
        """Values that live from one piece to another, by name"""
        offsets = np.asarray(tables.correction.color_offsets.numpy())
        self._colors = list(zip(offsets[:-1].tolist(), np.diff(offsets).tolist(), strict=True))
        """First and count of the springs of each color, for correction"""

    @staticmethod
    def allocate(model: Model, step: Step, room: Room) -> None:
        """Allocate the arrays that frames need."""
        working_arrays(model, step.features, room)
        step_arrays(model, step, room)

    def beside(self, model: Model, tables: Any) -> Self:
        """Return the same for another world of the same batch, with the same memory."""
        other = copy(self)
        other.model, other.tables, other._pieces = model, tables, {}
        return other

    def begin_loading(self) -> None:
        """Compile the kernels of a substep, all beside each other."""
        for piece in self.step.pieces:
            if piece.item != "launches" and piece.phases[0].name not in self._own:
                for part in ("part", "parts") if piece.name in self._parts else ("all",):
                    begin_loading(self.kernel(piece, part), self.model.device)

    def substep(self, state: State, substep: int, now: Moving) -> Moving:
        """Execute a substep, and return where particles are then."""
        if substep == 0 and self.step.features.ridges:
            self.working.ridge_budgets.zero_()  # others may have moved all since the last frame
        return self.execute(state, substep, now, begins=substep == 0)

    def execute(
        self, state: State, substep: int, now: Moving, only: Collection[str] = (), begins: bool = True
    ) -> Moving:
        """Execute pieces, and return where particles are then.

        Args:
            only: the first phases of those, where not all are to be executed.
            begins: whether pieces are executed that find what lasts for a frame, or a round.
        """
        for piece in self.step.pieces:
            if (piece.once and not begins) or (only and piece.phases[0].name not in only):
                continue
            if own := self._own.get(piece.phases[0].name):
                own(state, substep, now)
            else:
                now = self._launch(piece, state, substep, now)
        return now

    def _launch(self, piece: Piece, state: State, substep: int, now: Moving) -> Moving:
        new, m = self._targets(piece, state, now), self.model
        has = {
            "t": self.tables, "clock": self.clock, "substep": substep, "state": self._worlds.of(state),
            "working": self.working,
            **{f"all_{view}": array for view, array in zip(STATE.values(), now, strict=True)},
            **{f"new_{view}": array for view, array in zip(STATE.values(), new, strict=True)},
            **{f"all_{value}": array for value, array in self.values.items()}, **kept_arguments(state),
        }  # fmt: skip
        if piece.sums:
            self._sum(piece, has)
        elif acts_on_few(self.step, piece):
            self._over(piece, (m.world_count, -(-m.particle_count // int(ITEMS_OF_LIST))), has)
        elif piece.item == "team":
            self._over(piece, (m.world_count,), has)
        elif piece.item == "spring":
            for _ in range(m.scene.correction_sweeps):
                for first, count in self._colors:
                    inputs = self._inputs(piece, {**has, "first_spring": first})
                    launch(self.kernel(piece), (m.world_count, count), inputs, device=m.device)
        else:
            launch(self.kernel(piece), self._shape(piece.item), self._inputs(piece, has), device=m.device)
        return new

    def _inputs(self, piece: Piece, has: Mapping[str, Any], part: Part = "all") -> list[Any]:
        """Return the arguments of a piece's kernel, in order."""
        return [has[name] for name in self._asked(piece, part).names]

    def _targets(self, piece: Piece, state: State, now: Moving) -> Moving:
        """Return where the piece leaves points and velocities."""
        kept = {"point": state.points, "velocity": state.velocities}

        def target(name: str, old: wp.array) -> wp.array:
            if name not in piece.doubles:
                return old
            return self._second[name] if old is kept[name] else kept[name]

        points, velocities = now
        return target("point", points), target("velocity", velocities)

    def _sum(self, piece: Piece, has: Mapping[str, Any]) -> None:
        m, parts = self.model, self._parts.get(piece.name)
        whole = (m.world_count, m.balloon_count)
        if parts is None:
            self._over(piece, whole, has)
        else:
            self._over(piece, parts.shape, {**has, "all_parts": parts}, "part")
            self._over(piece, whole, {**has, "all_parts": parts}, "parts")

    def _over(self, piece: Piece, blocks: tuple[int, ...], has: Mapping[str, Any], part: Part = "all") -> None:
        """Launch so many blocks."""
        device = self.model.device
        inputs, threads = self._inputs(piece, has, part), self._team_threads(piece)
        launch_tiled(self.kernel(piece, part), dim=blocks, inputs=inputs, block_dim=threads, device=device)

    def _team_threads(self, piece: Piece) -> int:
        """Return the threads of a block."""
        device = self.model.device
        if piece.phases[0].name == "meet" and self.step.features.edges_meet and device.is_cuda:
            return EDGE_THREADS
        if acts_on_few(self.step, piece):
            return LISTING_THREADS if device.is_cuda else 1
        return team_threads(self.model)

    @property
    def _elements(self) -> int:
        """Count springs, strings, hinges, triangles, and faces, if a law acts on these."""
        m, hinges = self.model, self.tables.hinges.ends.shape[0]
        faces = m.face_count if self.step.features.has("face") else 0
        return m.spring_count + m.string_count + hinges + self.tables.membranes.corners.shape[0] + faces

    def kernel(self, piece: Piece, part: Part = "all") -> Any:
        """Return the kernel of a piece."""
        return self._asked(piece, part).kernel

    def _asked(self, piece: Piece, part: Part) -> _PieceLaunch:
        """Return the kernel of a piece, and the names of its arguments."""
        key = id(piece), part  # a hash of all that a piece consists of takes longer than a launch
        if key not in self._pieces:
            self._pieces[key] = _PieceLaunch(self._make_kernel(piece, part), arguments_of(self.step, piece, part))
        return self._pieces[key]

    def _make_kernel(self, piece: Piece, part: Part) -> Any:
        names = {phase.name for phase in piece.phases}
        alone = "pull" in names and "leave" not in names and not self.step.features.membranes
        most = {"particle": FEW_REGISTERS if alone else MOST_REGISTERS, "face": FEW_REGISTERS}
        registers = 0 if piece.sums else most.get(piece.item, 0)
        device = self.model.device
        if device.is_cuda and self.model.world_count > device.sm_count:
            edges_alone = "meet" in names and not self.step.features.bodies
            registers = EDGE_REGISTERS if edges_alone else SOLID_REGISTERS if names & SWEEPS else registers
        return kernel_of(self.step, piece, part, self._fast_math and not names.isdisjoint(ROUGH), registers)

    def _shape(self, item: Item) -> tuple[int, ...]:
        """Return the threads of a launch over all items."""
        m = self.model
        counts = {
            "particle": m.particle_count,
            "element": self._elements,
            "face": m.face_count,
            "triangle": m.triangle_count,
            "sphere": m.sphere_count,
        }
        return (m.world_count, counts[item]) if item in counts else (m.world_count,)


def team_threads(model: Model) -> int:
    """Return how many threads add up a balloon, or a part of it; on a CPU one.

    It does not depend on the number of worlds, which would change the order of a world's sums.
    """
    if not model.device.is_cuda:
        return 1
    return TEAM_THREADS_OF_SMALL if _largest_balloon(model) <= SMALL else TEAM_THREADS


def _largest_balloon(model: Model) -> int:
    """Return the number of particles of the largest balloon."""
    return max((len(shape.mesh.points) for shape in model.shapes), default=0)


def step_arrays(model: Model, step: Step, room: Room) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Allocate values that live from one piece to another, parts of sums, and second places of particles' state."""
    worlds = model.world_count
    counts = {"particle": model.particle_count, "face": model.face_count, "balloon": model.balloon_count}
    values = {
        value: room.array((worlds, counts[step.owner(value)]), wp.float32 if dtype is float else dtype)
        for value, dtype in values_of(step).items()
    }
    if any(tested_ahead(step, piece) for piece in step.pieces):
        values["active"] = room.array((worlds, -(-model.particle_count // 4) * 4), wp.int8)
    parts = {}
    for piece in step.pieces:
        if piece.sums and (count := _part_count(model, piece.item)):
            (dtype,) = piece.phases[0].writes.values()
            shape = (worlds, model.balloon_count, count)
            parts[piece.name] = room.array(shape, wp.float32 if dtype is float else dtype)
    second = {name: room.array((worlds, model.particle_count), wp.vec3) for name in step.doubled}
    return values, parts, second


def _part_count(model: Model, item: Item) -> int:
    """Count the parts in which the items of a balloon are added up; 0 where it is done in one go."""
    counts = [mesh.face_count if item == "face" else len(mesh.points) for mesh in (s.mesh for s in model.shapes)]
    largest = max(counts)
    return -(-largest // int(ITEMS_OF_PART)) if largest > LARGE else 0


def working_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Allocate the memory of contact beside the state; empty where a scene does not need it."""
    worlds = model.world_count
    return {
        "gas_masses": room.array((worlds, model.balloon_count if features.gas else 0), wp.float32),
        "sphere_quanta": room.array((worlds, model.sphere_count if features.spheres_pushed else 0, 3), wp.int64),
        **solid_arrays(model, features, room),
        **ridge_arrays(model, features, room),
        **sweep_arrays(model, features, room),
        "contact_impulses": room.array(contact_shape(model), wp.vec4),
        **touch_arrays(model, features, room),
        **list_arrays(model, features, room),
        **counting_arrays(model, features, room),
        **verdict_arrays(model, features, room),
        "near": room.array((worlds, mark_count(model.particle_count) if features.impulses else 0), wp.int32),
    }


def verdict_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Allocate the verdicts on each world's frame as it begins, and their bounds; empty where there are none."""
    asked = features.frames != "all"
    return {
        "travel_limits": room.array(model.world_count if asked else 0, wp.float32),
        "verdicts": room.array(model.world_count if asked else 0, wp.int32),
        "any_busy": room.array(1 if asked else 0, wp.int32),
    }


class LaunchedSchedule(ABC):
    """Advances a state by whole frames, in place, piece by piece."""

    name: ClassVar[str]
    capturable = True
    watchable: ClassVar[bool] = True
    """Whether each substep ends in the state"""
    fast_math: ClassVar[bool] = False
    """Whether divisions and roots are a GPU's own, with errors in the last two bits"""
    phases: ClassVar[Sequence[Phase]] = ()
    """List of phases that the schedule executes; the step, when empty"""
    instead: ClassVar[Instead] = NOTHING
    access: ClassVar[Access]

    def __init__(self, model: Model, features: Features | None = None):
        self.model, self.features = model, features or model_features(model)
        self.tables = make_tables(model, self.features)
        self.vectors = self.allocate(model, self.features, room := Allocating(model.device))
        """Memory of the schedule's own"""
        step = self.step_of(model, self.features)
        self.launches = Launches(model, step, self.tables, room, self.own(), fast_math=self.fast_math)
        self._touch = None
        if self.features.touches:
            self._touch = TouchLaunches(model, self.features, self.tables, self.launches.working, self.fast_math)
        self.contact_lists = None
        """Lists of contacts that may have to grow, if there are any"""
        if has_lists(self.features):
            self.contact_lists = ContactLists(model, self.features, self.launches.working)
        self.framing = Framing(model, self.features, self.tables, self.launches.working)
        self.rounds = Rounds(model, substeps_of_search(model) if self._touch else 0, self.launches.clock)

    @classmethod
    def step_of(cls, model: Model, features: Features) -> Step:
        """Return the phases of the model, in pieces."""
        return cut(phases_of(features, cls.phases, cls.instead), features, cls.access, doubles=not cls.watchable)

    def own(self) -> Mapping[str, Own]:
        """Return the phases that the schedule executes itself, by name."""
        return {"touch_balloons": self._press}

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the kernels are chosen by."""
        return choosing_parameters(self.features)

    @property
    def overflow(self) -> int:
        """Number of contacts in all worlds that were ignored, since lists had no place for them and could not grow."""
        return self.contact_lists.ignored if self.contact_lists else 0

    @property
    def pieces(self) -> list[FramePiece]:
        """Pieces of a frame that are recorded: one."""
        return [FramePiece(self.advance_frame, is_short=self.rounds.are_short)]

    @classmethod
    def allocate(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
        """Ask for its own memory, beside that of all launches."""
        return ()

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Return the device memory that it keeps for each world, beside the state."""
        room, features = Counting(), model_features(model)
        Launches.allocate(model, cls.step_of(model, features), room)
        if has_lists(features):
            start_of_frame(model, room)
        left_array(model, room)
        tear_arrays(model, room)
        cls.allocate(model, features, room)
        clearance_arrays(model, room)
        return room.bytes // model.world_count

    def advance_frame(self, state: State) -> None:
        """Advance all worlds by a frame."""
        self.launches.begin_loading()
        self.framing.begin(state)
        self.go_through(state, wp.copy)
        self.framing.end(state)

    def go_through(self, state: State, copy: Callable[[wp.array, wp.array], None]) -> None:
        """Launch the substeps of a frame.

        Args:
            copy: function of (target, source) that leaves points or velocities in the state.
        """

        def launch_substeps(numbers: range) -> None:
            now = kept = (state.points, state.velocities)
            for substep in numbers:
                now = self.launches.substep(state, substep, now)
            for target, source in zip(kept, now, strict=True):
                if source is not target:
                    copy(target, source)

        self.rounds.go_through(launch_substeps)

    def substeps(self, state: State) -> Iterator[int]:
        """Return the one frame that pauses after each substep, with its number from 0."""
        now = kept = (state.points, state.velocities)
        self.launches.begin_loading()
        self.framing.begin(state)
        for substep in range(self.model.substeps):
            now = self.launches.substep(state, substep, now)
            yield substep
        for source, target in zip(now, kept, strict=True):
            if source is not target:
                wp.copy(target, source)
        self.framing.end(state)

    def _press(self, state: State, substep: int, now: Moving) -> None:
        """Apply contact forces between balloons, and search for contacts now and then."""
        assert self._touch is not None
        self._touch.search(state, substep, *now)
        self._touch.press(state, *now)


BOX_THREADS = 128
"""Threads that loop over the particles of a balloon on a GPU"""
MEET_THREADS = 32
"""Threads that loop over the balloons of a world on a GPU"""
WARP_THREADS = 32
"""Threads of a warp of a GPU"""
MOST_SHARE = 4
"""Edges that each thread of a warp tests at most, until as many look at balloons as there are threads"""


class TouchLaunches:
    """Launches the kernels that find and press balloons that touch."""

    def __init__(self, model: Model, features: Features, tables: Any, working: Any, fast_math: bool = False):
        self.model, self._features, self._tables, self._working = model, features, tables, working
        self._interval, self._fast_math, self._worlds = substeps_of_search(model), fast_math, Worlds()
        self._eight = compares_eight(model.device)
        working.near_balloons.fill_(int(ARE_NEAR))  # before the first search they may have been, in another schedule
        # a thread for each item on a GPU; on a CPU one goes through them, and is soon done where nothing is near
        self._particle_threads = model.particle_count if model.device.is_cuda else 1
        leaves = working.leaf_boxes.shape[1] // 2
        self._leaf_threads = -(-leaves // WARP_THREADS) * WARP_THREADS if model.device.is_cuda else 1
        self._list_threads = threads_of_list(model)

    def search(self, state: State, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Search for contacts, at a frame's first substep, and now and then after it where particles have strayed."""
        if substep % self._interval:
            return
        m, t, working = self.model, self._tables, self._working
        launch_tiled(
            box_balloons,
            dim=(m.world_count, m.balloon_count),
            inputs=[t, points, velocities, int(substep == 0), working],
            block_dim=BOX_THREADS if m.device.is_cuda else 1,
            device=m.device,
        )
        launch_tiled(
            meet_kernel(self._features),
            dim=[m.world_count],
            inputs=[t, working],
            block_dim=MEET_THREADS if m.device.is_cuda else 1,
            device=m.device,
        )
        particles = self._particle_threads
        threads = self._leaf_threads
        moving: tuple[Any, ...] = points, velocities, working
        launch(box_leaves, (m.world_count, threads), [t, threads, *moving], block_dim=FEW_THREADS, device=m.device)
        if self._eight:
            launch(line_up_boxes, m.world_count, [t, working], device=m.device)
            if self._features.touches_itself:
                launch(near_leaves_kernel(self._features), m.world_count, [t, working], device=m.device)
        if self._features.edges_meet:  # before particles note where they are
            self._query_edges(points, velocities)
        place: dict[str, Any] = {"dim": (m.world_count, particles), "device": m.device, "block_dim": FEW_THREADS}
        moving = self._worlds.of(state), *moving
        launch(searching_kernel(self._features, self._eight), inputs=[t, particles, *moving], **place)
        place["dim"] = m.world_count, self._list_threads
        kernel = find_kernel(self._features, self._fast_math, self._eight)
        launch(kernel, inputs=[t, self._list_threads, *moving], **place)
        if substep == 0:  # history is unknown where a run begins with a saved state
            wp.copy(working.forces_taken, working.force_quanta)
            for counted in (working.contacts, working.touched):
                counted.zero_()
            self._press(state, points, velocities, only_counts=True)
            launch(take_counts, (m.world_count, particles), [particles, working], device=m.device)

    def _query_edges(self, points: wp.array, velocities: wp.array) -> None:
        m, edges = self.model, self._tables.touch.edges.shape[0]
        warps = -(-edges // WARP_THREADS)
        most = max(m.world_count * warps * WARP_THREADS // ENOUGH_THREADS, 1)
        share = min(most, MOST_SHARE) * WARP_THREADS if m.device.is_cuda else edges
        boxing, asking = (edges, -(-edges // share) * WARP_THREADS) if m.device.is_cuda else (1, 1)
        kernel = query_kernel(self._features, self._eight)
        for each, threads, told in ((box_edges, boxing, boxing), (kernel, asking, share)):
            inputs = [self._tables, told, points, velocities, self._working]
            launch(each, (m.world_count, threads), inputs, block_dim=QUERY_THREADS, device=m.device)

    def press(self, state: State, points: wp.array, velocities: wp.array) -> None:
        """Add the contact forces of particles and triangles."""
        self._press(state, points, velocities, only_counts=False)

    def _press(self, state: State, points: wp.array, velocities: wp.array, only_counts: bool) -> None:
        m, threads = self.model, self._list_threads
        inputs = [self._tables, threads, int(only_counts), points, velocities, self._worlds.of(state), self._working]
        shape = (m.world_count, threads)
        kernel = response_kernel(self._features, self._fast_math, self._eight)
        launch(kernel, shape, inputs, block_dim=FEW_THREADS, device=m.device)


def compares_eight(device: wp.Device) -> bool:
    """Return whether a thread compares boxes, and measures triangles, eight at a time: in a CPU's vector registers."""
    return device.is_cpu


def touch_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Return the arrays of `Working` for balloons that touch, but for lists that grow."""
    worlds = model.world_count
    balloons, particles = (model.balloon_count, model.particle_count) if features.touches else (0, 0)
    eight = compares_eight(model.device)
    leaves = sum(leaf_count(shape.mesh) for shape in model.shapes) if features.touches else 0
    rows = row_count(leaves, balloons) if leaves and eight else 0
    own_leaves = leaves if eight and features.touches_itself else 0
    edges = edge_count(model, features)
    return {
        "balloon_boxes": room.array((worlds, balloons, 3), wp.vec3),
        "sought": room.array((worlds, particles), wp.vec3),
        "clearances": room.array((worlds, particles if features.touches_itself else 0), wp.float32),
        "leaf_boxes": room.array((worlds, 2 * leaves), wp.vec4),
        "row_boxes": room.array((worlds, 0 if eight else 2 * -(-leaves // WARP_THREADS)), wp.vec4),
        "eight_boxes": room.array((worlds, rows), EightBoxes),
        "eight_places": room.array((worlds, 1 if rows else 0), EightPlaces),
        "near_leaves": room.array((worlds, own_leaves, int(MOST_LEAVES)), wp.int32),
        "near_leaf_counts": room.array((worlds, own_leaves), wp.int32),
        "neighbors": room.array((worlds, balloons, balloons), wp.int32),
        "neighbor_counts": room.array((worlds, balloons), wp.int32),
        "near_balloons": room.array((worlds, balloons + 1 if features.touches else 0), wp.int32),
        "candidate_counts": room.array((worlds, particles), wp.int32),
        "particle_lists": room.array((worlds, 2, particles), wp.int32),
        "list_lengths": room.array((worlds, LENGTHS if features.touches else 0), wp.int32),
        "force_quanta": room.array((worlds, particles, 4), wp.int64),
        "forces_taken": room.array((worlds, particles, 4), wp.int64),
        "contacts": room.array((worlds, particles), wp.float32),
        "touched": room.array((worlds, particles), wp.int8),
        "edge_boxes": room.array((worlds, 2 * edges), wp.vec4),
        "edge_clearances": room.array((worlds, edges if features.touches_itself else 0), wp.float32),
    }
