"""Look ahead of a frame: whether a world's particles may touch obstacles or each other at all.

Worlds in which they cannot are advanced by kernels that know of neither. See `kernels.contact.free_frames`.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.contact.free_frames import (
    FreeFrames,
    box_groups,
    busy_kernel,
    judge_kernel,
    judge_parts_kernel,
    keep_sphere_forces,
    place_parts,
    put_worlds_back,
    see_straying,
    surround_kernel,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.tables import WorldState
from balloon_warp.launching import begin_loading, launch, launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.kept import kept_arrays
from balloon_warp.model.memory import Allocating, Room
from balloon_warp.schedules.own_parts import looks_at_parts, own_parts, own_parts_arrays
from balloon_warp.schedules.tables import world_state

THREADS = 128
"""Threads of a block that surveys a balloon on a GPU"""


def has_free_frames(features: Features) -> bool:
    """Return whether a block leaves worlds to launches in some frames: not where it does all itself."""
    return features.touches or features.meets_solids or (features.fixtures and not features.always_busy)


def free_features(features: Features) -> Features:
    """Return the features of kernels for free frames."""
    return features._replace(
        frames="apart" if features.fixtures and features.touches_alone else "free",
        touches=False,
        touches_itself=False,
        edges_meet=False,
        bodies=0,
        ties=False,
        small_spheres=False,
        ridges=False,
        round_ridges=False,
    )


def busy_features(features: Features) -> Features:
    """Return the features of kernels for other frames."""
    return features._replace(frames="busy")


class Outlook:
    """Launches the kernels that judge all worlds as a frame begins, and that restore those wrongly judged free."""

    def __init__(self, model: Model, features: Features, tables: Any, working: Any):
        self.model, self._features, self._tables, self._working = model, features, tables, working
        self.table, self._before = FreeFrames(), WorldState()
        arrays, before, own, self._kept = outlook_arrays(model, features, Allocating(model.device))
        for name, array in arrays.items():
            setattr(self.table, name, array)
        for name in ("verdicts", "ways", "any_busy"):
            setattr(self.table, name, getattr(working, name))
        for name, array in before.items():
            setattr(self._before, name, array)
        self._own = own_parts(model) if own else None
        for name, array in own.items():
            setattr(self._own, name, array)
        self._judging = judge_kernel(features, looks_at_parts=self._own is not None)

    def begin_loading(self) -> None:
        """Compile ahead the kernels of a look."""
        of_kept = (busy_kernel(array.dtype) for array in self._kept.values())
        for kernel in (surround_kernel(self._features), self._judging, *of_kept):
            begin_loading(kernel, self.model.device)

    def look(self, state: State) -> None:
        """Judge the worlds before the frame."""
        m, threads = self.model, THREADS if self.model.device.is_cuda else 1
        for name, array in self._kept.items():
            wp.copy(array, state.kept[name])
        launch_tiled(
            surround_kernel(self._features),
            dim=(m.world_count, m.balloon_count),
            inputs=[self._tables, world_state(state), self.table, self._before],
            block_dim=threads,
            device=m.device,
        )
        launch(self._judging, m.world_count, [self._tables, self.table], device=m.device)
        self._judge_parts(state, is_over=False)

    def look_back(self, state: State) -> None:
        """Judge the worlds that were free after the frame, where balloons touch themselves: by how they moved in it."""
        self._judge_parts(state, is_over=True)

    def _judge_parts(self, state: State, is_over: bool) -> None:
        if not self._own:
            return
        m, now, groups = self.model, world_state(state), self._own.group_boxes.shape[:2]
        places = now, self._before if is_over else now
        inputs = [self._tables, self._working.verdicts, *places, state.seen_points, state.rooms, self._own]
        threads = THREADS if m.device.is_cuda else 1
        launch_tiled(see_straying, (m.world_count, m.balloon_count), inputs, block_dim=threads, device=m.device)
        launch(place_parts, self._own.means.shape, [*places, self._own], device=m.device)
        launch(box_groups, groups, [self._own], device=m.device)
        inputs = [self._tables, self._own, int(is_over), state.rooms, self.table]
        launch(judge_parts_kernel(self._features), groups, inputs, device=m.device)

    def put_back(self, state: State) -> None:
        """Restore worlds whose frame was not free, once the free frames are over."""
        threads = THREADS if self.model.device.is_cuda else 1
        inputs = [self.table, self._before, threads, world_state(state), self._working.sphere_quanta]
        launch(put_worlds_back, (self.model.world_count, threads), inputs=inputs, device=self.model.device)
        for name, array in self._kept.items():
            inputs = [self._working.verdicts, array, state.kept[name]]
            launch(busy_kernel(array.dtype), array.shape, inputs=inputs, device=self.model.device)

    def keep_forces(self, state: State) -> None:
        """Keep the forces on spheres of worlds whose frame was not free."""
        if self._features.penalties:
            inputs = [self.table, self._working.sphere_quanta, state.sphere_forces]
            launch(keep_sphere_forces, state.sphere_forces.shape, inputs=inputs, device=self.model.device)


def outlook_arrays(model: Model, features: Features, room: Room) -> tuple[dict[str, Any], ...]:
    """Return the memory of `FreeFrames`, of a world's earlier state, of parts of balloons, and of items kept."""
    worlds, balloons, spheres = model.world_count, model.balloon_count, model.sphere_count
    gas = (worlds, balloons if features.gas else 0)
    free = {
        "boxes": room.array((worlds, balloons, 2), wp.vec3),
        "alone": room.array((worlds, balloons, 2), wp.float32),
    }
    particles = (worlds, model.particle_count)
    before = {
        "points": room.array(particles, wp.vec3),
        "velocities": room.array(particles, wp.vec3),
        "inflation_loads": room.array(gas, wp.vec2),
        "pressures": room.array(gas, wp.float32),
        "pressure_slopes": room.array(gas, wp.float32),
        "gas_amounts": room.array(gas, wp.float64),
        "free_volumes": room.array(gas, wp.float64),
        "tube_flows": room.array((worlds, model.tube_count), wp.float32),
        "sphere_positions": room.array((worlds, spheres), wp.vec3),
        "sphere_velocities": room.array((worlds, spheres), wp.vec3),
        "sphere_spins": room.array((worlds, spheres), wp.vec3),
        "sphere_forces": room.array((worlds, spheres), wp.vec3),
    }
    return free, before, own_parts_arrays(model, room) if looks_at_parts(model) else {}, kept_arrays(model, room)
