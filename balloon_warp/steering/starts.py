"""Starts: some worlds begin anew, by a mask on the device, with values drawn for each."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.steering import begin_episodes, draw_values, shift_balloon
from balloon_warp.model import Model, State, initial_state
from balloon_warp.model.parameters import START, places_of, rows_of
from balloon_warp.model.state import place_particles
from balloon_warp.steering.controls import (
    Begun,
    Controls,
    Timetable,
    begun_of,
    columns_of,
    copy_given,
    has_times,
    require_timeless,
)
from balloon_warp.steering.observations import Observations, RowCopies
from balloon_warp.system.api import Shown
from balloon_warp.system.warp_threads import launch, recording, replay

IN_PARAMETERS = {"initial_velocities": "initial_velocities", "initial_spins": "initial_spins"}
"""Arrays of parameters that particles are placed by, by the names of their rows"""
IN_STATE = {
    "initial_sphere_positions": "sphere_positions",
    "initial_sphere_velocities": "sphere_velocities",
    "initial_sphere_spins": "sphere_spins",
}
"""Arrays of the state, by the names of their rows"""
SHIFTED = "initial_balloon_positions"


@dataclass(frozen=True)
class StartValue:
    """A vector that counts at the start, of one thing or several, or one number of it."""

    path: str
    name: str
    things: tuple[int, ...]
    axes: tuple[int, ...]

    def columns(self, model: Model, state: State, axis: int) -> list[wp.array]:
        """Return the arrays of shape (world_count,) that have an axis of it; none of a position of balloons."""
        if self.name == SHIFTED:
            return []
        arrays = model.parameters[self.name] if self.name in IN_PARAMETERS else getattr(state, IN_STATE[self.name])
        return [column for thing in self.things for column in columns_of(arrays, (thing, axis))]


def start_value(model: Model, path: str) -> StartValue | None:
    """Return the value that a path leads to, if it counts at the start alone.

    Raises:
        InputError: it cannot be drawn.
    """
    places = places_of(model.scene, rows_of(model.laws))
    found = places.get(path) or [place for axis in range(3) for place in places.get(f"{path}.{axis}", ())]
    if not found or not found[0][0].startswith(START):
        return None
    name = found[0][0]
    if name not in (*IN_PARAMETERS, *IN_STATE, SHIFTED):
        raise InputError(f"{path}: cannot be drawn on the device; expected a position, a velocity, or what may change")
    indices = [tuple(part for part in index if isinstance(part, int)) for _, index in found]
    value = StartValue(path, name, *(tuple(sorted({index[part] for index in indices})) for part in (0, 1)))
    if name == SHIFTED and any(model.scene.balloon[number].inflation.kind == "gas" for number in value.things):
        raise InputError(f"{path}: cannot be drawn for a balloon of gas, whose start depends on the air around it")
    if name in IN_STATE and any(model.scene.sphere[number].start > 0.0 for number in value.things):
        raise InputError(f"{path}: cannot be drawn for a sphere that appears later")
    return value


class Shifts:
    """Positions of balloons that are drawn, and where that shifts them."""

    def __init__(self, model: Model):
        self._positions = wp.zeros((3, model.world_count), dtype=wp.float32, device=model.device)
        self._centers = wp.clone(model.parameters["initial_centers"])

    def column(self, axis: int) -> Any:
        """Return the positions along an axis, shape (world_count,)."""
        return self._positions[axis]

    def shift(self, model: Model, value: StartValue, axis: int, mask: wp.array) -> None:
        """Shift the balloons of worlds that begin anew."""
        for thing in value.things:
            placed = float(np.float64(model.scene.balloon[thing].position[axis]))
            centers, shifts, moved = (
                columns_of(array, (thing, axis))[0]
                for array in (self._centers, *(model.parameters[f"initial_{name}"] for name in ("shifts", "centers")))
            )
            inputs = [mask, self._positions[axis], placed, centers]
            launch(shift_balloon, model.world_count, inputs, [shifts, moved], device=model.device)


Kind = Literal["uniform", "log_uniform", "normal"]
KINDS: tuple[Kind, ...] = ("uniform", "log_uniform", "normal")


@dataclass(frozen=True)
class Draw:
    """A number that is drawn for each episode."""

    path: str
    axis: int
    kind: int
    first: float
    second: float
    start: StartValue | None
    """Value that counts at the start alone; None where a control has it"""

    @property
    def number(self) -> int:
        """Number that tells its generator from others."""
        return zlib.crc32(f"{self.path}.{self.axis}".encode()) & 0x7FFFFFFF


def require_numbers(path: str, first: float, second: float, kind: str) -> None:
    """Make sure that a distribution can be drawn from.

    Raises:
        InputError: the kind is unknown, or its numbers cannot be.
    """
    if kind not in KINDS:
        raise InputError(f"{path}: kind must be one of {', '.join(KINDS)} (got {kind!r})")
    numbers = [first, second]
    if not all(isinstance(each, int | float | np.number) and np.isfinite(each) for each in numbers):
        raise InputError(f"{path}: must be drawn by finite numbers (got {first!r} and {second!r})")
    if (second < 0.0) if kind == "normal" else second < first:
        raise InputError(f"{path}: must be drawn from the least to the largest (got {first:g} and {second:g})")
    if kind == "log_uniform" and first <= 0.0:
        raise InputError(f"{path}: must be above 0 where its logarithm is uniform (got {first:g})")


SAVED, AGES = "starts", "starts_ages"
"""Prefix of the names of saved arrays, and name of the saved time of each world"""
PLACED = ("frame", "points", "velocities")
"""Arrays of the state that are not copied: the clock is all worlds', and particles are placed"""
DRAWN = ("initial_velocities", "initial_spins", "initial_shifts", "initial_centers")
"""Parameters that count for the places and velocities of particles alone"""


class Starting(Protocol):
    """A simulator, as starts know it."""

    model: Model
    state: State
    controls: Controls
    observations: Observations
    frame_number: int

    def drop_planned_changes(self) -> None: ...

    def record_again(self) -> None: ...

    def go_on_in(self, model: Model) -> None: ...


class Starts(Shown):
    """Distributions of initial values: `simulator.starts.draw("balloon.mass", 0.1, 0.2)`, then `simulator.reset(mask)`.

    Draws follow from the seed, the number of the world, its episode and the path: they repeat, whatever the number of
    worlds.
    """

    _internal = ("begin", "begin_again", "forget", "open_saved", "restore", "saved", "write")

    def __init__(self, simulator: Starting):
        self._simulator = simulator
        model = simulator.model
        self.episodes = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)
        """Number of times that each world has begun anew"""
        self.mask = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)
        """Worlds that begin anew with `reset(simulator.starts.mask)`, not 0"""
        self._seed = wp.zeros(1, dtype=wp.int32, device=model.device)
        self._first_world = 0
        self._draws: list[Draw] = []
        self._own: dict[str, wp.array] = {}
        self._shifts: Shifts | None = None
        self._copies: tuple[RowCopies, ...] = ()
        self._graph: Any = None
        self._begun: Begun = {}
        self._timetable: Timetable | None = None

    def __repr__(self) -> str:
        return f"Starts({', '.join(dict.fromkeys(draw.path for draw in self._draws)) or 'nothing is drawn'})"

    @property
    def seed(self) -> int:
        """Seed of the draws."""
        return int(self._seed.numpy()[0])

    @seed.setter
    def seed(self, seed: int) -> None:
        self._seed.fill_(int(seed) % 2**31)

    @property
    def first_world(self) -> int:
        """Number of the first world, by which values are drawn: other simulators may have those before it."""
        return self._first_world

    @first_world.setter
    def first_world(self, number: int) -> None:
        self._first_world = int(number)
        self.forget()

    def draw(self, path: str, first: float, second: float, kind: Kind = "uniform") -> None:
        """Draw a value anew whenever a world begins anew.

        A value that may change opens a control, which has it. Positions, velocities and spins of balloons and spheres,
        which count at the start alone, can be drawn, too.

        Args:
            path: to a number, or to all three of a vector, which are drawn one by one.
            first: least value; the mean, if "normal".
            second: largest value, or the deviation.
            kind: "uniform", "log_uniform" or "normal".

        Raises:
            InputError: there is no such path or kind, or the numbers cannot be.
        """
        require_numbers(path, first, second, kind)
        controls, model = self._simulator.controls, self._simulator.model
        start = start_value(model, path)
        if start:
            self._simulator.go_on_in(model.with_rows_of_worlds())
            self._shifts = self._shifts or Shifts(self._simulator.model)
        elif path not in controls:
            controls.open(path, *((None, None) if kind == "normal" else (first, second)))
        axes = start.axes if start else range(controls.size(path))
        self._draws += [Draw(path, axis, KINDS.index(kind), float(first), float(second), start) for axis in axes]
        self.forget()

    def value(self, name: str, first: float, second: float, kind: Kind = "uniform") -> wp.array:
        """Draw a value of your own for each episode, such as a goal; return its array, shape (world_count,), float32.

        Raises:
            InputError: the name is taken, or the numbers cannot be.
        """
        require_numbers(name, first, second, kind)
        if name in self._own:
            raise InputError(f"{name}: is drawn already")
        model = self._simulator.model
        self._own[name] = wp.zeros(model.world_count, dtype=wp.float32, device=model.device)
        self._draws.append(Draw(name, 0, KINDS.index(kind), float(first), float(second), None))
        self.forget()
        return self._own[name]

    def begin_again(self) -> None:
        """Begin all worlds again, as the scene says: nothing is drawn yet."""
        self.episodes.zero_()
        self._begun, self._timetable = begun_of(self._simulator.model), None
        self._simulator.controls.begin_again()
        self._simulator.observations.refresh()

    def forget(self) -> None:
        """Forget the recorded graph: the model or the state is another."""
        self._graph, self._copies = None, ()

    def begin(self, mask: Any) -> None:
        """Reset the worlds for which a mask is not 0.

        Raises:
            InputError: the mask has another length, or a part of the scene follows one clock for all worlds.
        """
        if mask is not self.mask:
            copy_given(self.mask, mask, "reset")
        if self._graph is None:
            require_timeless(self._simulator.model)
            self._follow_worlds()
            model = self._simulator.model
            self._copies = self._copies_at_start(), self._simulator.observations.copies()
            with recording(model.device) as capture:
                self._launch(*self._copies)
            self._graph = capture.graph
        replay(self._graph)

    def _follow_worlds(self) -> None:
        """Let planned changes follow the time of each world from here on, if there are any.

        Raises:
            InputError: a change cannot.
        """
        simulator = self._simulator
        if self._timetable is None and has_times(simulator.model):
            frame = simulator.frame_number
            self._timetable = Timetable(simulator.model, simulator.controls, self._begun, frame)
            simulator.drop_planned_changes()
            simulator.go_on_in(replace(simulator.model.with_rows_of_worlds(), ages=self._timetable.ages))

    def write(self) -> None:
        """Write the values planned for the next frame of each world, and all controls."""
        if self._timetable:
            self._timetable.write(self._simulator.model)
        self._simulator.controls.write()

    def saved(self) -> dict[str, NDArray]:
        """Copy the time of each world to the host, where they differ, and the state that draws depend on."""
        ages = {AGES: self._timetable.ages} if self._timetable else {}
        return {name: np.array(array.numpy()) for name, array in (ages | self._drawing).items()}

    @property
    def _drawing(self) -> dict[str, wp.array]:
        """Arrays that draws follow from, and own values that were drawn, by the names that they are saved by."""
        if not self._draws:
            return {}
        own = {f"{SAVED}.{name}": array for name, array in self._own.items()}
        return {f"{SAVED}_seed": self._seed, f"{SAVED}_episodes": self.episodes, **own}

    def open_saved(self, saved: Mapping[str, NDArray]) -> None:
        """Let planned changes follow the time of each world, if they did in the saved simulator."""
        if AGES in saved:
            self._follow_worlds()

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to the saved time of each world, and to the saved state that draws depend on."""
        if self._timetable and AGES in saved:
            self._timetable.ages.assign(saved[AGES])
            self._timetable.settle(self._simulator.model)
        for name, array in self._drawing.items():
            if name in saved:
                array.assign(saved[name])

    def _copies_at_start(self) -> RowCopies:
        """Return the copies of worlds' arrays at the start, but for the places of particles."""
        simulator = self._simulator
        begins = _start_of(simulator.model).arrays
        state = ((begins[name], array) for name, array in simulator.state.arrays.items() if name not in PLACED)
        return RowCopies([*state, *simulator.controls.firsts()], simulator.model.device)

    def _launch(self, at_start: RowCopies, observed: RowCopies) -> None:
        model, state, mask = self._simulator.model, self._simulator.state, self.mask
        counted = [self._simulator.controls.faults, self.episodes]
        launch(begin_episodes, model.world_count, [mask], counted, device=model.device)
        at_start.copy(mask)
        if self._timetable:
            self._timetable.restart(mask, model)
        for draw in self._draws:
            self._draw(draw)
        place_particles(model, state.points, state.velocities, mask)
        self._simulator.observations.refresh_chosen(mask, observed)

    def _draw(self, draw: Draw) -> None:
        model, start = self._simulator.model, draw.start
        drawn = [draw.number, draw.kind, draw.first, draw.second]
        generated = [self.mask, self._seed, self.episodes, self._first_world, *drawn]
        if draw.path in self._own:
            columns = [self._own[draw.path]]
        elif start is None:
            columns = [self._simulator.controls.column(draw.path, draw.axis)]
        else:
            columns = start.columns(model, self._simulator.state, draw.axis)
        shifts = self._shifts if start and not columns else None
        for column in [shifts.column(draw.axis)] if shifts else columns:
            launch(draw_values, model.world_count, generated, [column], device=model.device)
        if shifts and start:
            shifts.shift(model, start, draw.axis, self.mask)


def _start_of(model: Model) -> State:
    """Return the state at the start, with a single row where all worlds begin alike."""
    rows = [
        array.numpy()
        for name, array in model.parameters.items()
        if name.startswith("initial_") and name not in DRAWN and array.size
    ]
    alike = all((values == values[:1]).all() for values in rows)
    return initial_state(model.of_world(0) if alike else model)
