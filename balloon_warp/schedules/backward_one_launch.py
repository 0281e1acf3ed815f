"""Frames backwards in one launch: a block of threads has a world of one balloon, or eight are side by side on a CPU.

A block computes a frame again in one launch, and runs it backwards in another. On a CPU eight worlds, or eight
particles of a world, are side by side in vector registers, and one launch does both.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3
from balloon_warp.kernels.loops.contact import Solids
from balloon_warp.kernels.phase import NoAdjointError
from balloon_warp.kernels.schedules import lanes_backward
from balloon_warp.kernels.schedules.block_backward import (
    Backwards,
    arguments_again,
    arguments_backwards,
    kernel_again,
    kernel_backwards,
    widths_of_rows,
)
from balloon_warp.kernels.schedules.block_names import Layout, access_of
from balloon_warp.kernels.schedules.lanes import ACCESS, PARTS, Sums, kinds_of
from balloon_warp.kernels.schedules.lanes_backward import bars_backwards
from balloon_warp.kernels.schedules.lanes_layouts import OCTETS, WORLDS_AS_OCTETS
from balloon_warp.kernels.schedules.lanes_layouts import Layout as LanesLayout
from balloon_warp.kernels.schedules.writer import Step, cut, traces_of, values_of
from balloon_warp.kernels.substep import FILMED, SHARED, phases_of
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working
from balloon_warp.model import Model, State
from balloon_warp.model.state import Room
from balloon_warp.schedules.backward import BackwardFrames
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.launched import working_arrays
from balloon_warp.schedules.layouts import (
    CAPACITY_STEP,
    allocate_lanes,
    held_layout_of,
    items_of,
    make_lane_tables,
    max_particles,
    rows_of,
    shares_of,
)
from balloon_warp.schedules.membranes import (
    membrane_face_entries,
    membrane_face_layout,
    membrane_face_table,
)
from balloon_warp.schedules.slices import kind_slots, min_valence, quad_rings, slot_pairs, slot_table, spring_ends
from balloon_warp.schedules.tables import make_tables, model_features, world_state
from balloon_warp.system.process import Threads
from balloon_warp.system.warp_threads import launch, launch_tiled

THREADS, REGISTERS = 512, 128
"""Threads of a block, and registers of each: with a particle each, if there are no more, or else in a loop"""
FEW_THREADS = 256
"""Threads of a block that loop over so few particles that a multiprocessor has room for two blocks"""
REGISTERS_OF_TWO = 64
"""Registers of threads that loop, where two blocks on a multiprocessor are faster, though numbers then wait in memory:
without a gas, over faces of membranes, and as a frame is computed again"""
MOST_SLOTS = 14
"""Largest number of springs of a particle, with padding, for which there are registers"""
WARP_THREADS = 32
BYTES_PER_PARTICLE = 48
"""Shared memory for two buffers of points, and for the bars of forces and area vectors"""


def fits_in_block_backwards(model: Model) -> bool:
    """Return whether a block can run a world backwards: one balloon, which fits in shared memory.

    Left to launches are gas that comes and goes, water, spheres, normal forces, balloons that touch themselves, and
    faces that meet ridges.
    """
    features = model_features(model)
    fits = model.balloon_count == 1 and model.particle_count <= max_particles(model, BYTES_PER_PARTICLE)
    left = features.gas_changes or features.in_water or features.spheres or features.inflation_directions
    left = left or features.touches or features.meets_solids
    return fits and not left


def layout_backwards(model: Model) -> Layout:
    """Return the layout of a world on a block: with a thread for each particle, or threads that loop."""
    features = model_features(model)
    capacity = -(-model.particle_count // CAPACITY_STEP) * CAPACITY_STEP
    face = None if features.wears else membrane_face_layout(model, features)
    looped = face and face._replace(areas=False)
    if model.device.is_cpu:
        return Layout(1, capacity, registers=REGISTERS, membrane_face=looped)
    threads = -(-model.particle_count // WARP_THREADS) * WARP_THREADS
    slots = kind_slots(spring_ends(model))
    few = sum(slots) <= MOST_SLOTS
    held = few and threads <= THREADS
    held = held and not (features.reads_neighbor_velocities or features.needs("face", "velocity"))
    if not held:
        threads = min(threads, THREADS if model.particle_count > THREADS else FEW_THREADS)
    layout = Layout(threads, capacity, int(held), slots if few else (0, 0, 0), registers=REGISTERS)
    if face and held:
        face = face._replace(capacity=capacity)
        return layout._replace(membrane_face=face._replace(tile=membrane_face_entries(model, face)))
    if looped:
        return layout._replace(slots=(0, 0, 0), membrane_face=looped, registers=REGISTERS_OF_TWO)
    if few and threads == THREADS and not (held or features.gas):
        layout = layout._replace(registers=REGISTERS_OF_TWO)
    ring = quad_rings(model) if few and features.measures_areas else None
    return layout._replace(rings=min_valence(ring) if ring else 0)


def layout_again(model: Model) -> Layout:
    """Return the layout of a frame that is computed again: that of frames forward, where threads keep particles."""
    features, layout = model_features(model), layout_backwards(model)
    if model.device.is_cpu:
        return layout
    sees_velocities = features.reads_neighbor_velocities or features.needs("face", "velocity")
    held = None if sees_velocities else held_layout_of(model, features)
    return held or layout._replace(registers=REGISTERS_OF_TWO)


def plan_backwards(model: Model) -> Backwards:
    """Return the phases of a model in pieces, as they run backwards, and as they are computed again before.

    Values that particles see of each other, and sums, are kept.
    """
    features, layout, forth = model_features(model), layout_backwards(model), layout_again(model)
    phases, access = phases_of(features), access_of(layout, features.spheres)
    looking = (
        phase for phase in phases if not phase.light and (phase.views(features, access) or phase.item == "balloon")
    )
    sums = (phase for phase in phases if phase.sums)
    shown = [name for phase in (*looking, *sums) for name in phase.writes]

    def pieces(layout: Layout, films: bool) -> Step:
        of = phases_of(features, instead=FILMED) if films else phases
        access = access_of(layout, features.spheres)
        return cut(of, features, access, doubles=not layout.held, sums_along=True, shown=shown)

    turned, kept = pieces(layout, films=False), pieces(layout, films=layout.membrane_face is not None)
    return Backwards(turned, kept, layout, pieces(forth, films=forth.membrane_face is not None), forth)


class BlockBackward(BackwardFrames):
    """Run frames backwards in blocks."""

    def __init__(self, model: Model, state: State, columns: Sequence[int]):
        features, of = model_features(model), plan_backwards(model)
        self._of, (tables, tables_again) = of, _tables(model, features, of)
        super().__init__(model, state, columns, of.turned, tables, one_by_one=False)
        working = Working()
        for name, array in working_arrays(model, features, self.room).items():
            setattr(working, name, array)
        self._framing = Framing(model, features, tables, working)
        named_inputs = {"working": working, **rows(model, of, self.room), **self.arrays}
        self._named_inputs = {"t": tables, **named_inputs, **_slots(model, of.layout)}
        self._named_inputs_again = {"t": tables_again, **named_inputs, **_slots(model, of.layout_again)}
        self.carries_loads = features.gas and features.obstacles
        self._kernel, self._kernel_again = kernel_backwards(of, self.columns), kernel_again(of)

    @staticmethod
    def room_of_frame(model: Model, room: Room) -> None:
        """Allocate the memory of the values that a frame's substeps record."""
        rows(model, plan_backwards(model), room)

    def frame(self) -> None:
        """Launch a frame: forward, and then its substeps backwards."""
        self._framing.begin(self.state)
        self._launch(self._kernel_again, arguments_again(self._of), self._named_inputs_again, self._of.layout_again)
        self._launch(self._kernel, arguments_backwards(self._of, self.columns), self._named_inputs, self._of.layout)

    def _launch(self, kernel: Any, names: Sequence[str], named_inputs: Mapping[str, Any], layout: Layout) -> None:
        named_inputs = {**named_inputs, "state": world_state(self.state)}
        launch_tiled(
            kernel,
            dim=[self.model.world_count],
            inputs=[named_inputs[name] for name in names],
            block_dim=layout.threads,
            device=self.model.device,
        )


def _tables(model: Model, features: Features, of: Backwards) -> tuple[Any, Any]:
    """Return the tables of a frame backwards, and as it is computed again.

    They differ by the faces of membranes, and share all that a frame places as it begins, such as obstacles.
    """
    both = tables, again = make_tables(model, features, in_block=True), Tables()
    for name in Tables.vars:
        setattr(again, name, getattr(tables, name))
    for each, layout in zip(both, (of.layout, of.layout_again), strict=True):
        each.membranes.membrane_faces = membrane_face_table(model, layout.membrane_face)
    return both


def _slots(model: Model, layout: Layout) -> dict[str, Any]:
    """Return the springs of particles in slots, and in pairs of them, where a layout has such."""
    if not (layout.held or any(layout.slots)):
        return {}
    slots = slot_table(model, spring_ends(model), quad_rings(model) if layout.rings else None)
    return {"slots": slots, "slot_pairs": slot_pairs(slots)}


def rows(model: Model, of: Backwards, room: Room) -> dict[str, Any]:
    """Allocate the notes of each substep of a frame, a row each, and one more for the frame's end."""
    count = model.world_count * (model.substeps + 1)
    named = {*arguments_again(of), *arguments_backwards(of, ())}
    shapes = {
        "particle": (count, model.particle_count), "balloon": (count, model.balloon_count),
        "face": (model.world_count, model.face_count),  # which is found again
    }  # fmt: skip
    rows_of = {"notes": count, "bars_of_particles": model.world_count}
    arrays = {name: room.array((rows_of[name], width), wp.float32) for name, width in widths_of_rows(of).items()}
    if "all_velocities" in named:
        arrays["all_velocities"] = room.array(shapes["particle"], wp.vec3)
    faces = [layout.membrane_face for layout in (of.layout, of.layout_again) if layout.membrane_face]
    if "membrane_face_pulls" in named and faces:
        entries = max(membrane_face_entries(model, face) for face in faces)
        arrays["membrane_face_pulls"] = room.array((model.world_count, entries), wp.vec3)
    values = {value: (step, dtype) for step in (of.kept, of.again) for value, dtype in values_of(step).items()}
    return arrays | {
        f"all_{value}": room.array(shapes[step.owner(value)], wp.float32 if dtype is float else dtype)
        for value, (step, dtype) in values.items()
        if f"all_{value}" in named
    }


LANES = int(LANE_COUNT)


def fits_in_lanes_backwards(model: Model) -> bool:
    """Return whether eight side by side can run a world backwards: one balloon, all of whose phases take eight.

    It is of Hooke's springs or of a membrane, and nothing but its particles and its gas moves.
    """
    if not model.device.is_cpu or model.balloon_count != 1:
        return False
    features = model_features(model)
    left = features.gas_changes or features.in_water or features.inflation_directions or features.spheres
    left = left or features.may_touch_obstacles or features.touches or features.meets_solids
    return not (left or features.breathes_on) and _goes_side_by_side(step_backwards(features, OCTETS))


def _goes_side_by_side(step: Step) -> bool:
    """Return whether all phases of a particle take eight, or are rare and look at no other; each moves once at most."""
    try:
        entries = [entry for trace in traces_of(step) for entry in trace.entries if trace.item == "particle"]
    except NoAdjointError:
        return False
    phases, asked = [entry.phase for entry in entries], (step.features, step.access)
    moved = [name for piece in step.pieces for name in piece.moves]
    return len(moved) == len(set(moved)) and all(
        phase.takes_eight(*asked) or (phase.rare and not phase.views(*asked)) for phase in phases
    )


def step_backwards(features: Features, layout: LanesLayout) -> Step:
    """Return the phases of a model in pieces, as they run backwards, and as they are computed again before.

    Values that particles see of each other, and sums, are kept.
    """
    phases, access = phases_of(features, instead=SHARED), ACCESS[layout]
    looking = (
        phase for phase in phases if not phase.light and (phase.views(features, access) or phase.item == "balloon")
    )
    sums = (phase for phase in phases if phase.sums)
    shown = [name for phase in (*looking, *sums) for name in phase.writes]
    return cut(phases, features, access, sums_along=True, apart=("pull",), shown=shown)


def layout_of(model: Model) -> LanesLayout:
    """Return the layout of lanes: of worlds, or of particles of a world that is alone."""
    return WORLDS_AS_OCTETS if model.world_count > 1 else OCTETS


class LanesBackward(BackwardFrames):
    """Run frames backwards, eight worlds or eight particles side by side; threads of Python have some groups each."""

    def __init__(self, model: Model, state: State, columns: Sequence[int]):
        features, self._layout = model_features(model), layout_of(model)
        step = step_backwards(features, self._layout)
        tables = make_tables(model, features)
        super().__init__(model, state, columns, step, tables, one_by_one=False)
        self.carries_loads = features.gas and features.obstacles
        self._framing = Framing(model, features, tables)
        self._shares = shares_of(model, self._layout)
        threads = len(self._shares)
        self._threads = Threads(threads) if threads > 1 else None
        self.recorded = threads == 1
        self._named_inputs = {**self._tables(self.room, threads), **self.arrays}
        self._kernel = lanes_backward.kernel_backwards(step, self._layout, self.columns)

    def _tables(self, room: Room, threads: int) -> dict[str, Any]:
        """Return the kernel's arguments, by name."""
        t, solids, working = (
            make_lane_tables(self.model, self.step.features, self._layout, self.tables),
            Solids(),
            Working(),
        )
        memory = allocate_lanes(self.model, self.step, self._layout, room)
        for struct, arrays in ((t, memory.of_tables), (solids, memory.solids), (working, memory.working)):
            for name, array in arrays.items():
                setattr(struct, name, array)
        t.rows = rows_of(memory.of_tables["numbers"])
        scratch = rows_backwards(self.model, self.step, self._layout, self.columns, room, threads)
        return {"t": t, "tables": self.tables, "working": working, "solids": solids, **scratch}

    @staticmethod
    def room_of_frame(model: Model, room: Room) -> None:
        """Allocate the memory of the values that a frame's substeps record."""
        layout = layout_of(model)
        threads = len(shares_of(model, layout))
        rows_backwards(model, step_backwards(model_features(model), layout), layout, (), room, threads)

    def frame(self) -> None:
        """Launch a frame: forward, and then its substeps backwards."""
        self._framing.begin(self.state)
        named_inputs = {**self._named_inputs, "state": world_state(self.state)}
        if not self._threads:
            self._turn_groups(named_inputs, 0)
            return
        begun = [self._threads.submit(self._turn_groups, named_inputs, slot) for slot in range(len(self._shares))]
        for each in begun:
            each.result()

    def _turn_groups(self, named_inputs: Mapping[str, Any], slot: int) -> None:
        groups = self._shares[slot]
        named_inputs = {**named_inputs, "slot": slot, "first_group": int(groups[0])}
        inputs = [
            named_inputs[name] for name in lanes_backward.arguments_backwards(self.step, self._layout, self.columns)
        ]
        launch(self._kernel, len(groups), inputs, device=self.model.device)


def rows_backwards(
    model: Model, step: Step, layout: LanesLayout, columns: tuple[int, ...], room: Room, threads: int
) -> dict[str, Any]:
    """Allocate the memory of each thread for the group at hand: a row each for the substeps, and bars."""
    items, rows = items_of(model, layout).count, threads * (model.substeps + 1)
    takes = lanes_backward.arguments_backwards(step, layout, columns)

    def shape(item: str, dtype: Any) -> int:
        """Return the number of entries: of each particle, where an octet's others see it."""
        count = items if item == "particle" else model.balloon_count
        return LANES * count if dtype is OCTETS.vector else count

    kinds = kinds_of(step, layout)
    seen = {
        "all_points": layout.vector,
        "all_velocities": layout.vector if "Seen" in takes["all_velocities"] else Lanes3,
    }
    noted = {name: ("particle", dtype) for name, dtype in seen.items()}
    noted |= {f"all_{name}": kind for name, kind in kinds.items() if f"all_{name}" in takes}
    arrays = {name: room.array((rows, shape(*kind)), kind[1]) for name, kind in noted.items()}
    parts = {f"all_{name}_parts": dtype for name, (_, dtype) in kinds.items() if f"all_{name}_parts" in takes}
    arrays |= {name: room.array((threads, LANES), dtype) for name, dtype in parts.items()}
    bars = bars_backwards(step, layout)
    arrays |= {
        f"all_{name}_bars": room.array((threads, shape("particle", dtype)), dtype) for name, dtype in bars.items()
    }
    return arrays | {"sums": room.array((threads, Sums(len(columns)).total, PARTS), Lanes)}
