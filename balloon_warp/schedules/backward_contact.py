"""Contact backwards: spheres, balloons that touch, and sweeps over contacts.

Spheres: their bars from particles in a substep are added up, and carried on. The events that change their courses in a
substep are computed again from its start.

Balloons that touch: results of searches are kept, and each substep's contacts are gone through again. Frozen is who
touches whom. Counts of contacts, by which crowded ones share, and the state of friction are carried on.

Sweeps over contacts: the states before a substep's contacts, and of those before others, are kept.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.adjoints.pressing import (
    KINDS as KINDS_OF_PRESSING,
)
from balloon_warp.kernels.adjoints.pressing import (
    SUMS as SUMS_OF_PRESSING,
)
from balloon_warp.kernels.adjoints.pressing import (
    TouchBars,
    keep_holds,
    keep_search,
    list_contacts_kernel,
    press_back_kernel,
    sum_pairs,
    take_back_kernel,
)
from balloon_warp.kernels.adjoints.rolling import roll_back_kernel
from balloon_warp.kernels.adjoints.spheres import (
    BALL_SUMS,
    COLUMNS,
    EVENTS_OF_A_SPHERE,
    BarsOfSpheres,
    Event,
    LoggedSpheres,
    roll_again_kernel,
    sum_sphere_bars,
)
from balloon_warp.kernels.adjoints.sums import SUMS
from balloon_warp.kernels.adjoints.sweeps import (
    EDGES_BACK,
    RIDGES_BACK,
    SweepBack,
    SweepBars,
    sweeps_back_kernel,
)
from balloon_warp.kernels.adjoints.sweeps import (
    KINDS as KINDS_OF_SWEEPS,
)
from balloon_warp.kernels.contact.contact import Contact
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.working import LENGTHS, SphereBars, Working
from balloon_warp.model import Model, State
from balloon_warp.model.obstacles import FRICTION
from balloon_warp.model.state import Room
from balloon_warp.model.touch import STIFFNESSES
from balloon_warp.schedules.launched import Moving, team_threads
from balloon_warp.schedules.tables import world_state
from balloon_warp.schedules.touch_table import (
    FEW_THREADS,
    MOST_AT_ONCE,
    list_arrays,
    list_lengths,
    substeps_of_search,
    threads_of_list,
)
from balloon_warp.system.warp_threads import launch, launch_tiled

STATE_OF_SPHERES = ("sphere_positions", "sphere_velocities", "sphere_spins")
"""Arrays of the state that a substep takes from the one before"""
OF_OBSTACLES = "obstacle_restitution"
"""Name of the restitution of obstacles in the parameters"""


@dataclass(frozen=True)
class BackwardModel:
    """Model whose frames run backwards, with the memory that its adjoints share."""

    model: Model
    features: Features
    columns: tuple[int, ...]
    """Columns of the numbers that are derived by"""
    tables: Any
    working: Any
    """Working memory of the launches that compute frames again"""
    arrays: Mapping[str, wp.array]
    """Bars of the substep that runs backwards, by name"""
    bars: Any
    """Bars of the frame"""


class SpheresBackward:
    """Run the spheres of all worlds backwards, a substep at a time."""

    def __init__(self, of: BackwardModel, room: Room):
        self._model, self._tables, self._working, self._of_frame = of.model, of.tables, of.working, of.bars
        model, features, working = of.model, of.features, of.working
        self._roll_again, self._roll_back = roll_again_kernel(features), roll_back_kernel(features, of.columns)
        worlds, spheres = model.world_count, model.sphere_count
        working.sphere_bars = room.array((worlds, model.particle_count, spheres), SphereBars)
        working.sphere_push_bars = room.array((worlds, spheres), wp.vec3)
        self.bars = BarsOfSpheres()
        for name in ("positions", "velocities", "spins", "starts"):
            setattr(self.bars, name, room.array((worlds, spheres), wp.vec3))
        self.bars.totals = room.array((worlds, spheres), SphereBars)
        self.bars.numbers = room.array((worlds, spheres, len(COLUMNS)), wp.float64)
        things = model.parameters[FRICTION].shape[1]
        self.bars.frictions = room.array((worlds, things, things), wp.float64)
        of_exchange = model.particle_count if features.impulses and features.spheres_rub else 0
        self.bars.rubs = room.array((worlds, of_exchange, spheres), wp.float32)
        self.bars.fixture_restitutions = room.array((worlds, len(model.obstacles)), wp.float64)
        self.bars.crowded = room.array(worlds, wp.int32)
        self.log = log_of_spheres(model, room)
        """Courses of spheres in the substep that runs backwards"""
        of_penalties = spheres if features.penalties else 0
        self._quanta = [room.array((worlds, of_penalties, 3), wp.int64) for _ in range(model.substeps)]
        """Forces on spheres as each substep begins, by the paper's rule"""

    @property
    def carried_bars(self) -> dict[str, wp.array]:
        """Bars of the values that go on into the next frame, by their names in the state."""
        bars = self.bars.positions, self.bars.velocities, self.bars.spins
        return {**dict(zip(STATE_OF_SPHERES, bars, strict=True)), "sphere_forces": self._working.sphere_push_bars}

    def note(self, substep: int) -> None:
        """Keep the forces with which a substep begins."""
        wp.copy(self._quanta[substep], self._working.sphere_quanta)

    def found_again(self, state: State, carried: Mapping[str, wp.array], substep: int) -> dict[str, wp.array]:
        """Move spheres again, and return where they were as particles moved, by its names in the state.

        Args:
            carried: the arrays that the substep began with, by their names in the state.
        """
        model, time = self._model, substep * self._model.step_seconds
        inputs = [self._tables, world_state(replace(state, **carried)), self._quanta[substep], time, self.log]
        launch(self._roll_again, model.world_count, inputs, device=model.device)
        return {name: getattr(self.log, name) for name in STATE_OF_SPHERES}

    def turn_back(self, substep: int) -> None:
        """Run the motion of spheres in a substep, which has been computed again, backwards."""
        device, model, time = self._model.device, self._model, substep * self._model.step_seconds
        inputs = [self._working, self.bars]
        places = (model.world_count, model.sphere_count)
        launch_tiled(sum_sphere_bars, dim=places, inputs=inputs, block_dim=team_threads(model), device=device)
        quanta = self._quanta[substep]
        inputs = [self._tables, self.log, quanta, self._working, time, self.bars, self._of_frame]
        launch(self._roll_back, model.world_count, inputs, device=device)

    def add(self, positions: NDArray[np.float64], velocities: NDArray[np.float64]) -> None:
        """Add to the bars of where a frame ends, as they are now: arrays of all worlds."""
        for array, more in ((self.bars.positions, positions), (self.bars.velocities, velocities)):
            if more.any():
                array.assign((array.numpy() + more).astype(np.float32))

    def by_start(self) -> dict[str, NDArray[np.float64]]:
        """Return the bars of where spheres start, by the names of parameters."""
        return {
            f"initial_sphere_{name}": getattr(self.bars, name).numpy().astype(np.float64)
            for name in ("positions", "velocities", "spins")
        }

    def taken_numbers(self) -> dict[str, NDArray[np.float64]]:
        """Return the bars of spheres' numbers since they were last taken, by the names of parameters."""
        arrays = (self.bars.numbers, self.bars.frictions, self.bars.fixture_restitutions)
        numbers, frictions, restitutions = (np.asarray(array.numpy(), dtype=np.float64).copy() for array in arrays)
        for array in arrays:
            array.zero_()
        rubs, first = np.asarray(self.bars.rubs.numpy(), dtype=np.float64), 1 + len(self._model.obstacles)
        self.bars.rubs.zero_()
        balloons = frictions[:, -self._model.balloon_count :, first : first + self._model.sphere_count]
        for number, (begin, end) in enumerate(pairwise(self._model.particle_offsets)):
            balloons[:, number] += rubs[:, begin:end].sum(axis=1)
        of_columns = {name: numbers[..., column] for column, name in enumerate(COLUMNS)}
        return of_columns | {FRICTION: frictions, OF_OBSTACLES: restitutions}

    def crowded_worlds(self) -> NDArray[np.intp]:
        """Return the worlds in which spheres have met more in a substep than there is room for."""
        return np.flatnonzero(self.bars.crowded.numpy())


def log_of_spheres(model: Model, room: Room) -> Any:
    """Allocate the courses of spheres in a substep, and the events that change them."""
    worlds, spheres = model.world_count, model.sphere_count
    log = LoggedSpheres()
    for name in ("positions", "velocities", "spins", "starts"):
        setattr(log, f"sphere_{name}", room.array((worlds, spheres), wp.vec3))
    log.events = room.array((worlds, EVENTS_OF_A_SPHERE * spheres), Event)
    log.counts = room.array(worlds, wp.int32)
    return log


Values = NDArray[np.float64]
STATE_OF_TOUCH = ("holds", "deep")
"""Arrays of the state that a frame begins with"""


class TouchBackward:
    """Run the contacts of balloons backwards, a substep at a time.

    Args:
        fast_math: whether a GPU's own division and root will do, as forwards.
    """

    def __init__(self, of: BackwardModel, room: Room, fast_math: bool):
        self._model, self.tables, self._working, self._arrays = of.model, of.tables, of.working, of.arrays
        model, features, arrays = of.model, of.features, of.arrays
        self._list_contacts = list_contacts_kernel(features, fast_math)
        self._press_back = press_back_kernel(features, fast_math)
        self._take_back = take_back_kernel(features, of.columns)
        self._interval, self._threads = substeps_of_search(model), threads_of_list(model)
        worlds, particles, balloons = model.world_count, model.particle_count, model.balloon_count
        self.bars = TouchBars()
        self.bars.forces = arrays["all_force_bar"]
        self.bars.holds = room.array((worlds, particles), wp.vec4)
        self.bars.counts = room.array((worlds, particles), wp.float32)
        self.bars.sums = room.array((worlds, particles, SUMS_OF_PRESSING), wp.int64)
        self.bars.marks = room.array((worlds, -(-particles // 4) * 4), wp.int8)
        self.bars.largest = room.array((worlds, KINDS_OF_PRESSING), wp.float32)
        self.bars.contacts = room.array(worlds * particles * balloons, wp.vec3i)
        self.bars.contact_counts = room.array((1, 1), wp.int32)
        self.bars.pairs = room.array((worlds, particles, balloons), wp.vec3)
        self.bars.totals = room.array((worlds, balloons, balloons), wp.vec3d)
        self._searches, self._contacts = kept_of_touch(model, features, room)

    @property
    def carried_bars(self) -> dict[str, wp.array]:
        """Bars of the values that go on into the next frame, by their names in the state; `deep` has none."""
        return {"holds": self.bars.holds}

    def note(self, substep: int, holds: wp.array) -> None:
        """Keep the contacts of a substep before they press."""
        m, device = self._model, self._model.device
        if substep % self._interval == 0:
            kept = self._searches[substep // self._interval]
            arrays = [kept[name] for name in ("candidate_counts", "candidates", "particle_lists", "list_lengths")]
            launch(keep_search, (m.world_count, m.particle_count), [self._working, *arrays], device=device)
            wp.copy(kept["edge_pairs"], self._working.edge_pairs)
        kept_contacts, kept_holds = self._contacts[substep]
        wp.copy(kept_contacts, self._working.contacts)
        inputs = [self._threads, self._working, holds, kept_holds]
        launch(keep_holds, (m.world_count, self._threads), inputs, block_dim=FEW_THREADS, device=device)

    def turn_back(self, points: wp.array, velocities: wp.array, substep: int) -> None:
        """Run the contact forces of a substep backwards, into the bars of its inputs, such as places."""
        self._press(points, velocities, substep, only_counts=False)
        if substep == 0:  # as a frame begins, contacts are counted without forces
            self._press(points, velocities, substep, only_counts=True)
            self._add_up()

    def _press(self, points: wp.array, velocities: wp.array, substep: int, only_counts: bool) -> None:
        m, bars, device = self._model, self.bars, self._model.device
        bars.contact_counts.zero_()
        bars.largest.zero_()
        moving = points, velocities, self._contacts[substep][1], self.as_it_was(substep), bars
        inputs = [self.tables, self._threads, int(only_counts), *moving]
        launch(self._list_contacts, (m.world_count, self._threads), inputs, block_dim=FEW_THREADS, device=device)
        threads = min(MOST_AT_ONCE, bars.contacts.size) if device.is_cuda else 1
        for adds in (0, 1):
            inputs = [self.tables, threads, adds, *moving]
            launch(self._press_back, threads, inputs, block_dim=FEW_THREADS, device=device)
        arrays = [self._arrays[name] for name in ("all_point_bar", "all_velocity_bar", "number_bars")]
        fours = bars.marks.shape[1] // 4
        launch(self._take_back, (m.world_count, fours), [self.tables, bars, *arrays], device=device)

    def as_it_was(self, substep: int) -> Any:
        """Return the working memory with the contacts of a substep."""
        before = Working()
        for name in vars(Working.cls)["__annotations__"]:
            setattr(before, name, getattr(self._working, name))
        for name, array in self._searches[substep // self._interval].items():
            setattr(before, name, array)
        before.contacts = self._contacts[substep][0]
        return before

    def _add_up(self) -> None:
        m = self._model
        shape, inputs = (m.world_count, m.balloon_count, m.balloon_count), [self.tables, self.bars]
        launch_tiled(sum_pairs, dim=shape, inputs=inputs, block_dim=team_threads(m), device=m.device)

    def taken_numbers(self) -> dict[str, Values]:
        """Return the bars of pairs' numbers, since they were last taken, by the names of parameters."""
        model = self._model
        totals = self.bars.totals.numpy().copy()
        self.bars.totals.zero_()
        own = np.asarray(model.parameters[STIFFNESSES].numpy(), dtype=np.float64)
        said = np.asarray(model.parameters["touch_stiffness"].numpy(), dtype=np.float64).reshape(-1) >= 0.0
        between = np.where(said[:, None, None], 0.0, totals[..., 0])
        both = np.maximum(own[:, :, None] + own[:, None, :], 1e-30)
        by_own = ((between + between.transpose(0, 2, 1)) * 2.0 * (own[:, None, :] / both) ** 2).sum(axis=2)
        of_pairs = np.zeros((model.world_count, *model.parameters[FRICTION].shape[1:]))
        of_pairs[:, -model.balloon_count :, -model.balloon_count :] = totals[..., 1]
        return {
            STIFFNESSES: by_own, FRICTION: of_pairs,
            "touch_stiffness": totals[..., 0].sum(axis=(1, 2)), "touch_thickness": totals[..., 2].sum(axis=(1, 2)),
        }  # fmt: skip


def kept_of_touch(
    model: Model, features: Features, room: Room
) -> tuple[list[dict[str, wp.array]], list[tuple[wp.array, wp.array]]]:
    """Allocate each search's results, by their names in the working memory, and each substep's counts and holds."""
    worlds, particles = model.world_count, model.particle_count
    searches = -(-model.substeps // substeps_of_search(model))
    found = [
        {
            "candidate_counts": room.array((worlds, particles), wp.int32),
            "particle_lists": room.array((worlds, 2, particles), wp.int32),
            "list_lengths": room.array((worlds, LENGTHS), wp.int32),
            **list_arrays(model, features, room, ("candidates", "edge_pairs")),
        }
        for _ in range(searches)
    ]
    before = [
        (room.array((worlds, particles), wp.float32), room.array((worlds, particles), wp.vec4))
        for _ in range(model.substeps)
    ]
    return found, before


class SweepsBackward:
    """Run sweeps over a kind of contacts backwards, a substep at a time."""

    def __init__(self, back: SweepBack, of: BackwardModel, room: Room):
        self._model, self._tables = of.model, of.tables
        self._back = sweeps_back_kernel(back, of.features, of.columns)
        self._came, self._again, self._bars = kept_of_sweeps(back, of.model, of.features, room)
        self._bars.points, self._bars.velocities = of.arrays["all_point_bar"], of.arrays["all_velocity_bar"]
        self._bars.gas_masses, self._bars.numbers = of.arrays["all_gas_mass_bar"], of.arrays["number_bars"]

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

    def __init__(self, of: BackwardModel, touch: TouchBackward, room: Room):
        super().__init__(EDGES_BACK, of, room)
        self._touch, self._bars.totals = touch, touch.bars.totals
        standing = of.model.particle_count if of.features.ground else 0
        self._stops = room.array((of.model.world_count, standing), wp.vec2)

    def turn_back(self, state: State, substep: int) -> None:
        """Backward pass of the contacts."""
        working = self._touch.as_it_was(substep)
        working.contact_stops = self._stops
        self._turn_back(state, working, substep)


class RidgesBackward(SweepsBackward):
    """Run faces that meet ridges backwards.

    Args:
        spheres: which may meet faces as ridges do.
    """

    def __init__(self, of: BackwardModel, spheres: SpheresBackward | None, room: Room):
        super().__init__(RIDGES_BACK, of, room)
        self._working, self._spheres = of.working, spheres if of.features.round_ridges else None
        self.left, self._left_spheres, self._again_spheres = kept_of_ridges(of.model, of.features, room)
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
    bars.largest = room.array((worlds, KINDS_OF_SWEEPS), wp.float32)
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
