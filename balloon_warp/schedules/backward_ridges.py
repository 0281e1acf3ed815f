"""Faces that meet ridges, backwards: the states before and after a substep's contacts are kept."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.particle_sums import SUMS
from balloon_warp.kernels.adjoints.ridge_balls import BALL_SUMS
from balloon_warp.kernels.adjoints.ridges import KINDS, RidgeBars
from balloon_warp.kernels.adjoints.ridges_back import ridges_back_kernel
from balloon_warp.kernels.adjoints.sphere_log import LoggedSpheres
from balloon_warp.kernels.contact.catch import Catch
from balloon_warp.kernels.contact.ridges import MOST_SWEEPS
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.working import Working
from balloon_warp.launching import launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.backward_spheres import STATE_OF_SPHERES, SpheresBackward
from balloon_warp.schedules.contact_lists import list_lengths
from balloon_warp.schedules.launches import Moving, team_threads
from balloon_warp.schedules.tables import world_state


class RidgesBackward:
    """Run faces that meet ridges backwards, a substep at a time.

    Args:
        columns: of the numbers that are derived by.
        working: of the launches that compute frames again.
        arrays: bars of the substep that runs backwards, by name.
        spheres: which may meet faces as ridges do.
    """

    def __init__(
        self, model: Model, features: Features, columns: tuple[int, ...], tables: Any, working: Any,
        arrays: Mapping[str, wp.array], spheres: SpheresBackward | None, room: Room,
    ):  # fmt: skip
        self._model, self._tables, self._working = model, tables, working
        self._back = ridges_back_kernel(features, columns)
        self._came, self.left, self._again, self._bars = kept_of_ridges(model, features, room)
        self._spheres = spheres if features.round_ridges else None
        self._left_spheres, self._again_spheres = kept_of_balls(model, features, self._bars, room)
        if spheres:
            self._bars.spheres = spheres.bars
        self._bars.points, self._bars.velocities = arrays["all_point_bar"], arrays["all_velocity_bar"]
        self._bars.gas_masses, self._bars.numbers = arrays["all_gas_mass_bar"], arrays["number_bars"]

    def note(self, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Keep where particles are before faces meet ridges."""
        _copy(self._came[substep], (points, velocities))

    def note_left(self, state: State, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Keep where particles are after that, and how spheres move."""
        _copy(self.left[substep], (points, velocities))
        for name, array in self._left_spheres[substep].items():
            wp.copy(array, getattr(state, name))

    def spheres_left(self, substep: int) -> dict[str, wp.array]:
        """Return how spheres moved after a substep's contacts, by names in the state; nothing where they met none."""
        return self._left_spheres[substep]

    def log_left(self, log: Any, substep: int) -> Any:
        """Return the courses of spheres in a substep as they were after its contacts."""
        left = LoggedSpheres()
        for name in vars(LoggedSpheres.cls)["__annotations__"]:
            setattr(left, name, self._left_spheres[substep].get(name, getattr(log, name)))
        return left

    def turn_back(self, state: State, substep: int) -> None:
        """Turn the bars of after the contacts into those of before.

        Args:
            state: with where spheres came to them.
        """
        model, working = self._model, self._working
        if self._spheres:
            for name, array in self._again_spheres.items():
                wp.copy(array, getattr(state, name))
            working = Working()
            for name in vars(Working.cls)["__annotations__"]:
                setattr(working, name, getattr(self._working, name))
            working.sphere_starts = self._spheres.log.sphere_starts
        _copy(self._again, self._came[substep])
        if substep == model.substeps - 1:
            self._working.ridge_budgets.zero_()  # faces near as the frame began are so no longer
        launch_tiled(
            self._back, dim=[model.world_count],
            inputs=[
                self._tables, world_state(replace(state, **self._again_spheres)), working,
                substep * model.step_seconds, self._came[substep][0], *self._again, self._bars,
            ],
            block_dim=team_threads(model), device=model.device,
        )  # fmt: skip


def _copy(to: Moving, what: Moving) -> None:
    for target, array in zip(to, what, strict=True):
        wp.copy(target, array)


def kept_of_ridges(model: Model, features: Features, room: Room) -> tuple[list[Moving], list[Moving], Moving, Any]:
    """Allocate the states before and after each substep's contacts, room to move them, and bars."""
    worlds, particles = model.world_count, model.particle_count
    pairs = list_lengths(model, features)["ridge_pairs"]

    def moving() -> Moving:
        return room.array((worlds, particles), wp.vec3), room.array((worlds, particles), wp.vec3)

    came, left = ([moving() for _ in range(model.substeps)] for _ in range(2))
    bars = RidgeBars()
    bars.eases = room.array((worlds, particles), wp.float32)
    bars.catches = room.array((worlds, pairs), Catch)
    bars.courses = room.array((int(MOST_SWEEPS), worlds, particles), wp.vec3)
    bars.sums = room.array((worlds, particles, SUMS), wp.int64)
    bars.largest = room.array((worlds, KINDS), wp.float32)
    return came, left, moving(), bars


def kept_of_balls(
    model: Model, features: Features, bars: Any, room: Room
) -> tuple[list[dict[str, wp.array]], dict[str, wp.array]]:
    """Allocate how spheres move after each substep's contacts, and room to move them again, by names in the state.

    Both are empty where they meet no faces. Bars get the kept values of their sweeps.
    """
    shape = (model.world_count, model.sphere_count if features.round_ridges else 0)
    bars.ball_sums = room.array((*shape, BALL_SUMS), wp.int64)
    bars.ball_velocities, bars.ball_spins = (room.array((int(MOST_SWEEPS), *shape), wp.vec3) for _ in range(2))
    names = STATE_OF_SPHERES if features.round_ridges else ()
    left = [{name: room.array(shape, wp.vec3) for name in names} for _ in range(model.substeps)]
    return left, {name: room.array(shape, wp.vec3) for name in (*names, "sphere_forces")[: 4 * bool(names)]}
