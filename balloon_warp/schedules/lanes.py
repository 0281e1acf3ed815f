"""The schedules `lanes` and `octets`: eight worlds, or eight particles of a world, side by side in a CPU core's vector
registers; worlds are shared out to threads. Bit-reproducible, whatever the number of threads."""

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar

import numpy as np
import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.algebra import LANE_COUNT, Lanes, Lanes3
from balloon_warp.kernels.schedules.lanes.kernel import lanes_kernel
from balloon_warp.kernels.schedules.lanes.layouts import OCTETS, WORLDS, Layout
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.traits import Traits
from balloon_warp.launching import begin_loading, launch
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Counting, Room
from balloon_warp.schedules.fixtures import forget_looks, look_arrays
from balloon_warp.schedules.health import HealthCheck
from balloon_warp.schedules.lane_tables import face_octets, items_of, make_lane_tables, quad_count
from balloon_warp.schedules.outlook import free_traits
from balloon_warp.schedules.ramp import note_pressures, refresh_ramp, weigh_air
from balloon_warp.schedules.tables import make_tables, world_state
from balloon_warp.schedules.traits import CHOOSE_TRAITS, model_traits

FAR_AWAY = 1e16
"""a coordinate [m] at which a face is nearest to no particle, and whose square is a finite float"""


class LanesSchedule:
    """Advances a state by whole frames, in place; eight worlds side by side.

    A launch on the CPU runs on the thread that calls it and leaves the interpreter free meanwhile, so that each Python
    thread advances its own groups of worlds.

    Raises:
        InputError: the device is not the CPU.
    """

    name: ClassVar[str] = "lanes"
    layout: ClassVar[Layout] = WORLDS
    depends_on: ClassVar[frozenset[str]] = CHOOSE_TRAITS

    def __init__(self, model: Model, thread_count: int | None = None):
        if not model.device.is_cpu:
            raise InputError(
                f"--schedule {self.name}: runs on the CPU (got {model.device}); block is its like for a GPU"
            )
        self.model, self._traits = model, model_traits(model)
        self.busy = busy_worlds(model, self._traits) if self._traits.in_blocks else None
        if self.busy:
            self._traits = free_traits(self._traits)
        self._kernel = lanes_kernel(self._traits, self.layout)
        self._tables = make_tables(model, self._traits)
        self._lane_tables = make_lane_tables(model, self._traits, self.layout, self._tables)
        self._lanes = lane_structs(self.layout)[1]()
        arrays = _working_arrays(model, self._traits, self.layout, Allocating(model.device))
        for name in ("hinge_forces", "membrane_forces"):
            setattr(self._lane_tables, name, arrays.pop(name))
        for name, array in arrays.items():
            setattr(self._lanes, name, array)
        if self.busy:
            self._lanes.free = self.busy.outlook.table
        if self.layout == OCTETS and self._traits.aims:
            far_away = self._lanes.face_centers.numpy()
            far_away[:, -1] = FAR_AWAY
            self._lanes.face_centers.assign(far_away)
        self._health = HealthCheck(model, self._tables)
        self._share_out(thread_count)

    def _share_out(self, thread_count: int | None) -> None:
        groups = _group_count(self.model, self.layout)
        thread_count = min(thread_count or os.cpu_count() or 1, groups)
        self.capturable = thread_count == 1
        self._shares = np.array_split(np.arange(groups), thread_count)
        if thread_count > 1:
            self._threads = ThreadPoolExecutor(thread_count)

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        room, traits = Counting(), model_traits(model)
        if traits.in_blocks:
            from balloon_warp.schedules.busy_worlds import BusyWorlds

            BusyWorlds.allot(model, traits, room)
            traits = free_traits(traits)
        _working_arrays(model, traits, cls.layout, room)
        look_arrays(model, room)
        return room.bytes // model.world_count

    @property
    def crowded(self) -> int:
        """How often a triangle that a particle may touch had no place in its list since it was made, in all worlds."""
        return self.busy.crowded if self.busy else 0

    def advance_frame(self, state: State) -> None:
        """One frame: the groups of worlds on as many threads as there are cores."""
        begin_loading(self._kernel, self.model.device)
        if self.busy:
            self.busy.begin_loading(self.capturable)
        refresh_ramp(self.model, state)
        weigh_air(self.model, self._traits, self._tables, state)
        forget_looks(self._tables)
        worlds = world_state(state)
        if self.busy:
            self.busy.find(state)
        if len(self._shares) == 1:
            self._advance_groups(worlds, self._shares[0])
        else:
            for done in [self._threads.submit(self._advance_groups, worlds, share) for share in self._shares]:
                done.result()
        if self.busy:
            self.busy.advance(state)
        note_pressures(self.model, self._traits, state)
        self._health.end_frame(state)

    def _advance_groups(self, worlds: Any, groups: np.ndarray) -> None:
        launch(
            self._kernel,
            len(groups),
            inputs=[self._lane_tables, int(groups[0]), worlds, self._lanes],
            device=self.model.device,
        )


def busy_worlds(model: Model, traits: Traits) -> Any:
    """Those in which balloons may touch, bodies move or small spheres meet faces; kernels load only where they do."""
    from balloon_warp.schedules.busy_worlds import BusyWorlds

    return BusyWorlds(model, traits)


class OctetsSchedule(LanesSchedule):
    """Advances a state by whole frames, in place; eight particles of a world side by side."""

    name: ClassVar[str] = "octets"
    layout: ClassVar[Layout] = OCTETS


def _group_count(model: Model, layout: Layout) -> int:
    return -(-model.world_count // LANE_COUNT) if layout.worlds else model.world_count


def _working_arrays(model: Model, traits: Traits, layout: Layout, room: Room) -> dict[str, Any]:
    """The memory of `LaneState`; arrays that a scene does not need are empty."""
    groups, items = _group_count(model, layout), items_of(model, layout).count
    worlds = groups * (LANE_COUNT if layout.worlds else 1)
    a_vector = 1 if layout.worlds else LANE_COUNT
    faces = model.face_count if layout.worlds else LANE_COUNT * len(face_octets(model)) + 1

    hinges = sum(shape.hinges.count for shape in model.shapes) if traits.has("hinge") else 0

    def lanes(count: int, dtype: Any = Lanes3, needed: bool = True) -> Any:
        return room.array((groups, count if needed else 0), dtype)

    def shown(count: int, needed: bool = True) -> Any:
        return lanes(count, layout.vector, needed)

    return {
        "points": shown(a_vector * items),
        "other_points": shown(a_vector * items),
        "velocities": lanes(items),
        "free_velocities": lanes(items, needed=traits.gas),
        "shown_velocities": shown(a_vector * items, traits.looks_at_velocities),
        "aims": lanes(items, needed=traits.aims),
        "area_vectors": lanes(items, needed=traits.gas),
        "inflations": lanes(items, needed=traits.keeps_inflations),
        "face_centers": shown(faces, traits.aims),
        "face_area_vectors": shown(faces, traits.aims),
        "hinge_forces": shown(4 * hinges),
        "membrane_forces": shown(a_vector * items, bool(traits.membranes)),
        "balloon_areas": lanes(model.balloon_count, Lanes),
        "numbers": room.array((groups, model.balloon_count, traits.columns.width), Lanes),
        "peaks": lanes(4 * quad_count(model, layout) if traits.softens else 0, Lanes),
        "ramp_begins": lanes(model.balloon_count, Lanes),
        "ramp_slopes": lanes(model.balloon_count, Lanes),
        "loads": lanes(model.balloon_count, Lanes),
        "rises": lanes(model.balloon_count, Lanes),
        "masses": lanes(model.balloon_count, Lanes),
        "sphere_centers": lanes(model.sphere_count),
        "sphere_motions": lanes(model.sphere_count, needed=traits.impulses),
        "sphere_starts": room.array((worlds, model.sphere_count if traits.keeps_starts else 0), wp.vec3),
        "near_items": lanes(items, wp.int32, needed=traits.impulses),
        "sphere_squared_radii": lanes(model.sphere_count, Lanes),
        "fastest": room.array(groups if traits.frames == "free" else 0, Lanes),
    }
