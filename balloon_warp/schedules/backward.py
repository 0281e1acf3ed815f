"""Frames backwards: from the derivatives by where a frame ends to those by where it begins.

A frame is computed again from its beginning, and what each substep finds is kept. Then its substeps run backwards.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.adjoint import NoAdjointError
from balloon_warp.kernels.frames.backwards import Bars, sum_kernel
from balloon_warp.kernels.helpers_of_grad import derive_helpers
from balloon_warp.kernels.phase import STATE
from balloon_warp.kernels.schedules.launched.backward import BackwardKernel, backward_kernels, made_kernels
from balloon_warp.kernels.schedules.launched.looks import GATHERED
from balloon_warp.kernels.schedules.pieces import Piece, Step, cut, values_of
from balloon_warp.kernels.substep import phases_of
from balloon_warp.kernels.traits import Traits
from balloon_warp.launching import launch, launch_tiled
from balloon_warp.model import Model, State, copy_of
from balloon_warp.model.memory import Allocating, Counting, Room
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.launches import Launches, Moving, step_arrays, team_threads
from balloon_warp.schedules.tables import make_tables, world_state
from balloon_warp.schedules.traits import model_traits
from balloon_warp.warp_lock import recording

KEPT = ("frame", "points", "velocities", "inflation_loads", "pressures", "gas_amounts", "free_volumes", "air_along")
"""Arrays of the state that a frame begins with"""


class _Remembering(Launches):
    """Launch a step's pieces, and keep what each substep finds.

    Args:
        remembered: where the values of each substep are kept.
    """

    def __init__(self, model: Model, step: Step, tables: Any, room: Room, remembered: "_Remembered"):
        super().__init__(model, step, tables, room)
        self._remembered, self._substep = remembered, 0

    def substep(self, state: State, substep: int, now: Moving) -> Moving:
        """Execute a substep, and return where particles are then."""
        self._substep, self.values = substep, self._remembered.values[substep]
        return super().substep(state, substep, now)

    def _targets(self, piece: Piece, state: State, now: Moving) -> Moving:
        after = dict(zip(STATE, self._remembered.moving[self._substep + 1], strict=True))
        points, velocities = (after[name] if name in piece.moves else old for name, old in zip(STATE, now, strict=True))
        return points, velocities


class _Remembered:
    """Hold all values that the substeps of a frame find."""

    def __init__(self, model: Model, step: Step, state: State, room: Room):
        of_particles = (model.world_count, model.particle_count)
        self.values = [step_arrays(model, step, room)[0] for _ in range(model.substeps)]
        self.moving: list[Moving] = [(state.points, state.velocities)] + [
            (room.array(of_particles, wp.vec3), room.array(of_particles, wp.vec3)) for _ in range(model.substeps)
        ]
        """Points and velocities before each substep, and after the last"""
        balloons = (model.world_count, model.balloon_count)
        self.loads = [room.array(balloons, wp.vec2) for _ in range(model.substeps + 1)]
        """Pressures before each substep, and after the last"""


def gradient_step(model: Model, traits: Traits) -> Step:
    """Return the phases of a model, in pieces, with all that they write kept.

    Raises:
        InputError: a phase has no adjoint.
    """
    phases = phases_of(traits)
    shown = [name for phase in phases if not phase.light for name in phase.writes]
    return cut(phases, traits, GATHERED, shown=shown)


def kernels_of(step: Step, columns: tuple[int, ...]) -> tuple[BackwardKernel, ...]:
    """Return the kernels of a step backwards.

    Raises:
        InputError: a phase has no adjoint.
    """
    try:
        return backward_kernels(step, columns)
    except NoAdjointError as missing:
        raise InputError(
            f"gradients: {missing} has no adjoint yet; expected a scene without, see docs/GRADIENTS.md"
        ) from None


def bytes_of_world(model: Model, columns: Sequence[int], frames: int) -> int:
    """Return the memory that gradients take of each world: checkpoints of all frames, and a frame's substeps."""
    traits, room = model_traits(model), Counting()
    step = gradient_step(model, traits)
    for _ in range(model.substeps):
        step_arrays(model, step, room)
    of_particles = model.world_count * model.particle_count
    moving, checkpoints = 24 * of_particles * model.substeps, 24 * of_particles * frames
    bars = 4 * of_particles * (len(columns) + 24)
    return (room.bytes + moving + checkpoints + bars) // model.world_count


class BackwardFrames:
    """Run frames of a model backwards.

    Args:
        state: of the simulation, whose arrays tell what a frame begins with; it stays as it is.
        columns: of the numbers of laws, those that are derived by.

    Raises:
        InputError: a phase has no adjoint.
    """

    def __init__(self, model: Model, state: State, columns: Sequence[int]):
        self.model, self.columns, traits = model, tuple(columns), model_traits(model)
        derive_helpers()
        room = Allocating(model.device)
        step = gradient_step(model, traits)
        kernels = kernels_of(step, self.columns)
        self._tables = make_tables(model, traits)
        self._state = copy_of(state)
        self._remembered = _Remembered(model, step, self._state, room)
        self._launches = _Remembering(model, step, self._tables, room, self._remembered)
        self._framing = Framing(model, traits, self._tables, self._launches.working)
        self._kernels = list(zip(kernels, made_kernels(step, self.columns), strict=True))
        self._carries_loads = any(
            kernel.item == "particle" and not kernel.after_note and "all_load_bar" in kernel.arguments
            for kernel in kernels
        )
        """Whether the pressure of one substep is read in the next"""
        self._sum_bars = sum_kernel(traits, self.columns)
        self._first_pressures = wp.clone(state.pressures)
        self.bars, self._arrays = _bars(model, step, len(self.columns), room)
        self._graph: Any = None

    def checkpoint(self, state: State) -> dict[str, wp.array]:
        """Return what a frame begins with, copied."""
        return {name: wp.clone(getattr(state, name)) for name in KEPT}

    def turn_back(self, checkpoint: Mapping[str, wp.array]) -> None:
        """Turn the bars of where a frame ends into those of where it begins."""
        for name, array in checkpoint.items():
            wp.copy(getattr(self._state, name), array)
        wp.copy(self._first_pressures, checkpoint["pressures"])
        if self._graph is None:
            with recording(self.model.device) as capture:
                self._frame()
            self._graph = capture.graph
        wp.capture_launch(self._graph)

    def add(self, points: NDArray[np.float64], velocities: NDArray[np.float64], pressures: NDArray[np.float64]) -> None:
        """Add to the bars of where a frame ends, as they are now: arrays of all worlds."""
        for array, more in ((self.bars.points, points), (self._arrays["all_velocity_bar"], velocities)):
            array.assign((array.numpy() + more).astype(np.float32))
        self.bars.pressures.assign((self.bars.pressures.numpy() + pressures).astype(np.float32))

    def by_state(self) -> dict[str, NDArray[np.float64]]:
        """Return the bars of where a frame begins."""
        names = {"points": "all_point_bar", "velocities": "all_velocity_bar", "pressures": "all_pressure_bar"}
        found = {name: self._arrays[array].numpy().astype(np.float64) for name, array in names.items()}
        loads, offsets = self._arrays["all_load_bar"].numpy().astype(np.float64), self.model.particle_offsets
        loads *= self._carries_loads
        found["loads"] = np.stack([loads[:, a:b].sum(axis=1) for a, b in pairwise(offsets)], axis=1)
        return found

    def _frame(self) -> None:
        """Launch a frame forward, and then its substeps backwards."""
        state, kept = self._state, self._remembered
        gas = self._launches.step.traits.gas
        self._framing.begin(state)
        now = kept.moving[0]
        wp.copy(kept.loads[0], state.inflation_loads)
        for substep in range(self.model.substeps):
            if gas:
                wp.copy(kept.loads[substep + 1], kept.loads[substep])
            now = self._launches.substep(replace(state, inflation_loads=kept.loads[substep + 1]), substep, now)
        for substep in reversed(range(self.model.substeps)):
            self._substep_back(substep)
        inputs = [self._tables, world_state(state), self._first_pressures, self.bars]
        launch(self._sum_bars, (self.model.world_count, self.model.balloon_count), inputs, device=self.model.device)

    def _substep_back(self, substep: int) -> None:
        m, kept = self.model, self._remembered
        points, velocities = kept.moving[substep]
        for kernel, made in self._kernels:
            state = replace(self._state, inflation_loads=kept.loads[substep + kernel.after_note])
            has = {
                "t": self._tables, "time_in_frame": substep * m.step_seconds, "state": world_state(state),
                "working": self._launches.working, "all_points": points, "all_velocities": velocities,
                **{f"all_{name}": array for name, array in kept.values[substep].items()}, **self._arrays,
            }  # fmt: skip
            inputs = [has[name] for name in kernel.arguments]
            if kernel.item == "balloon":
                places = (m.world_count, m.balloon_count)
                launch_tiled(made, dim=places, inputs=inputs, block_dim=team_threads(m.device, places), device=m.device)
            else:
                launch(made, (m.world_count, m.particle_count), inputs, device=m.device)
        if substep == m.substeps - 1:
            self.bars.pressures.zero_()  # of the frame's end alone


def _bars(model: Model, step: Step, count: int, room: Room) -> tuple[Any, dict[str, wp.array]]:
    """Allocate all bars, and return them as kernels once a frame take them, and as those of a substep do, by name."""
    particles, balloons = (model.world_count, model.particle_count), (model.world_count, model.balloon_count)
    bars = Bars()
    bars.points, bars.pressures = room.array(particles, wp.vec3), room.array(balloons, wp.float32)
    bars.gas_masses, bars.keyed = room.array(particles, wp.float32), room.array(particles, wp.vec2)
    bars.keyed_of_balloons, bars.gas = room.array(balloons, wp.vec2), room.array(balloons, wp.vec2)
    bars.numbers = room.array((*particles, count), wp.float32)
    bars.numbers_of_balloons = room.array((*balloons, count), wp.float32)
    bars.number_totals = room.array((*balloons, count), wp.float64)
    bars.gas_totals, bars.keyed_totals = room.array(balloons, wp.vec2d), room.array(balloons, wp.vec2d)
    values = {
        f"all_{value}_bar": room.array(
            balloons if step.owner(value) == "balloon" else particles, wp.float32 if dtype is float else dtype
        )
        for value, dtype in values_of(step).items()
    }
    arrays = values | {
        "all_point_bar": bars.points, "all_velocity_bar": room.array(particles, wp.vec3),
        "all_pressure_bar": bars.pressures, "all_load_bar": room.array(particles, wp.vec2),
        "all_gas_mass_bar": bars.gas_masses, "all_keyed_bar": bars.keyed,
        "all_keyed_bar_of_balloons": bars.keyed_of_balloons, "all_gas_bar": bars.gas,
        "number_bars": bars.numbers, "number_bars_of_balloons": bars.numbers_of_balloons,
    }  # fmt: skip
    return bars, arrays
