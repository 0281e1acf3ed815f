"""Frames backwards on a CPU with eight worlds, or eight particles of a world, side by side in vector registers."""

from collections.abc import Mapping, Sequence
from typing import Any

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3
from balloon_warp.kernels.loops.contact import Solids
from balloon_warp.kernels.phase import NoAdjointError
from balloon_warp.kernels.schedules.lanes import ACCESS, PARTS, Sums, kinds_of
from balloon_warp.kernels.schedules.lanes_backward import arguments_backwards, bars_backwards, kernel_backwards
from balloon_warp.kernels.schedules.lanes_layouts import OCTETS, WORLDS_AS_OCTETS, Layout
from balloon_warp.kernels.schedules.writer import Step, cut, traces_of
from balloon_warp.kernels.substep import SHARED, phases_of
from balloon_warp.kernels.working import Working
from balloon_warp.model import Model, State
from balloon_warp.model.state import Room
from balloon_warp.schedules.backward import BackwardFrames
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.layouts import allocate_lanes, items_of, make_lane_tables, rows_of, shares_of
from balloon_warp.schedules.tables import make_tables, model_features, world_state
from balloon_warp.system.process import Threads
from balloon_warp.system.warp_threads import launch

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


def step_backwards(features: Features, layout: Layout) -> Step:
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


def layout_of(model: Model) -> Layout:
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
        self._kernel = kernel_backwards(step, self._layout, self.columns)

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
        inputs = [named_inputs[name] for name in arguments_backwards(self.step, self._layout, self.columns)]
        launch(self._kernel, len(groups), inputs, device=self.model.device)


def rows_backwards(
    model: Model, step: Step, layout: Layout, columns: tuple[int, ...], room: Room, threads: int
) -> dict[str, Any]:
    """Allocate the memory of each thread for the group at hand: a row each for the substeps, and bars."""
    items, rows = items_of(model, layout).count, threads * (model.substeps + 1)
    takes = arguments_backwards(step, layout, columns)

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
