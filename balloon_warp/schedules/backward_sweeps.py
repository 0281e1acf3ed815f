"""Sweeps over contacts, backwards: the states before a substep's contacts, and of those before others, are kept."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.spheres import BALL_SUMS, LoggedSpheres
from balloon_warp.kernels.adjoints.sums import SUMS
from balloon_warp.kernels.adjoints.sweeps import (
    EDGES_BACK,
    KINDS,
    RIDGES_BACK,
    SweepBack,
    SweepBars,
    sweeps_back_kernel,
)
from balloon_warp.kernels.contact.contact import Contact
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.working import Working
from balloon_warp.model import Model, State
from balloon_warp.model.state import Room
from balloon_warp.schedules.backward_contact import STATE_OF_SPHERES, SpheresBackward, TouchBackward
from balloon_warp.schedules.contact_lists import list_lengths
from balloon_warp.schedules.launched import Moving, team_threads
from balloon_warp.schedules.tables import world_state
from balloon_warp.system.warp_threads import launch_tiled


class SweepsBackward:
    """Run sweeps over a kind of contacts backwards, a substep at a time.

    Args:
        columns: of the numbers that are derived by.
        arrays: bars of the substep that runs backwards, by name.
    """

    def __init__(
        self, back: SweepBack, model: Model, features: Features, columns: tuple[int, ...], tables: Any,
        arrays: Mapping[str, wp.array], room: Room,
    ):  # fmt: skip
        self._model, self._tables = model, tables
        self._back = sweeps_back_kernel(back, features, columns)
        self._came, self._again, self._bars = kept_of_sweeps(back, model, features, room)
        self._bars.points, self._bars.velocities = arrays["all_point_bar"], arrays["all_velocity_bar"]
        self._bars.gas_masses, self._bars.numbers = arrays["all_gas_mass_bar"], arrays["number_bars"]

    def note(self, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Keep where particles are before contacts."""
        _copy(self._came[substep], (points, velocities))

    def _turn_back(self, state: State, working: Any, substep: int) -> None:
        """Backward pass of the contacts; `state` has the solids before them."""
        _copy(self._again, self._came[substep])
        model = self._model
        launch_tiled(
            self._back, dim=[model.world_count],
            inputs=[
                self._tables, world_state(state), working, substep * model.step_seconds, self._came[substep][0],
                *self._again, self._bars,
            ],
            block_dim=team_threads(model), device=model.device,
        )  # fmt: skip


class EdgesBackward(SweepsBackward):
    """Run edges that meet backwards.

    Args:
        touch: the contacts of particles, which keeps the results of searches.
    """

    def __init__(
        self, model: Model, features: Features, columns: tuple[int, ...], touch: TouchBackward,
        arrays: Mapping[str, wp.array], room: Room,
    ):  # fmt: skip
        super().__init__(EDGES_BACK, model, features, columns, touch.tables, arrays, room)
        self._touch, self._bars.totals = touch, touch.bars.totals
        self._stops = room.array((model.world_count, model.particle_count if features.ground else 0), wp.vec2)

    def turn_back(self, state: State, substep: int) -> None:
        """Backward pass of the contacts."""
        working = self._touch.as_it_was(substep)
        working.contact_stops = self._stops
        self._turn_back(state, working, substep)


class RidgesBackward(SweepsBackward):
    """Run faces that meet ridges backwards.

    Args:
        working: of the launches that compute frames again.
        spheres: which may meet faces as ridges do.
    """

    def __init__(
        self, model: Model, features: Features, columns: tuple[int, ...], tables: Any, working: Any,
        arrays: Mapping[str, wp.array], spheres: SpheresBackward | None, room: Room,
    ):  # fmt: skip
        super().__init__(RIDGES_BACK, model, features, columns, tables, arrays, room)
        self._working, self._spheres = working, spheres if features.round_ridges else None
        self.left, self._left_spheres, self._again_spheres = kept_of_ridges(model, features, room)
        if spheres:
            self._bars.spheres = spheres.bars

    def note_left(self, state: State, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Keep where particles are after the contacts, and how spheres move."""
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
        """Backward pass of the contacts.

        Args:
            state: with where spheres came to them.
        """
        working = self._working
        if self._spheres:
            for name, array in self._again_spheres.items():
                wp.copy(array, getattr(state, name))
            working = Working()
            for name in vars(Working.cls)["__annotations__"]:
                setattr(working, name, getattr(self._working, name))
            working.sphere_starts = self._spheres.log.sphere_starts
        if substep == self._model.substeps - 1:
            self._working.ridge_budgets.zero_()  # faces near as the frame began are so no longer
        self._turn_back(replace(state, **self._again_spheres), working, substep)


def _copy(to: Moving, what: Moving) -> None:
    for target, array in zip(to, what, strict=True):
        wp.copy(target, array)


def _moving(model: Model, room: Room) -> Moving:
    shape = (model.world_count, model.particle_count)
    return room.array(shape, wp.vec3), room.array(shape, wp.vec3)


def kept_of_sweeps(back: SweepBack, model: Model, features: Features, room: Room) -> tuple[list[Moving], Moving, Any]:
    """Allocate the state before each substep's contacts, room to move that again, and bars."""
    worlds, particles, sweeps = model.world_count, model.particle_count, back.of.most(features)
    seen = back.of.seen(features)
    came = [_moving(model, room) for _ in range(model.substeps)]
    bars = SweepBars()
    bars.inverse_masses = room.array((worlds, particles), wp.float32)
    bars.listed_contacts = room.array((worlds, list_lengths(model, features)["listed_contacts"]), Contact)
    bars.sweep_velocities = room.array((sweeps, worlds, particles), wp.vec3)
    stopped = (sweeps + 1, worlds, particles if seen.ground else 0)
    bars.rises, bars.falls = room.array(stopped, wp.float32), room.array(stopped, wp.float32)
    bars.sums = room.array((worlds, particles, SUMS), wp.int64)
    bars.pairs = room.array((worlds, 0 if seen.ridges else model.balloon_count**2, 2), wp.int64)
    bars.largest = room.array((worlds, KINDS), wp.float32)
    spheres = (worlds, model.sphere_count if seen.round_ridges else 0)
    bars.ball_sums = room.array((*spheres, BALL_SUMS), wp.int64)
    bars.ball_velocities, bars.ball_spins = (room.array((sweeps, *spheres), wp.vec3) for _ in range(2))
    return came, _moving(model, room), bars


def kept_of_ridges(
    model: Model, features: Features, room: Room
) -> tuple[list[Moving], list[dict[str, wp.array]], dict[str, wp.array]]:
    """Allocate the state after each substep's contacts, how spheres move then, and room to move these again.

    Spheres have arrays by names in the state; none where they meet no faces.
    """
    left = [_moving(model, room) for _ in range(model.substeps)]
    shape = (model.world_count, model.sphere_count)
    names = STATE_OF_SPHERES if features.round_ridges else ()
    spheres = [{name: room.array(shape, wp.vec3) for name in names} for _ in range(model.substeps)]
    return left, spheres, {name: room.array(shape, wp.vec3) for name in (*names, "sphere_forces")[: 4 * bool(names)]}
