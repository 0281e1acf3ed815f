"""Runs of a random scene, as it is and as its twins, each simulated once."""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np

from balloon_warp.benchmarks.physics_twins import Array, Tables, Twin, nudged
from balloon_warp.blow_ups import BlowUp
from balloon_warp.errors import BlowUpError
from balloon_warp.model import Model, Vary
from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator

STATES = ("points", "velocities", "pressures", "gas_amounts", "sphere_positions", "sphere_velocities", "sphere_spins")
STATES += ("body_positions", "body_turns", "body_velocities", "body_momenta", "contact_forces", "torn")
NUDGE = 1.0e-6
"""Displacement of a nudged twin's particles, over the scene's size"""
MOST_SUBSTEPS = 2000
"""Substeps of a run: longer ones are left out"""


@dataclass(frozen=True)
class Run:
    """A simulated scene: its state after each frame, the start first, until it blew up."""

    model: Model
    states: dict[str, Array]
    """States of the first world by name, shape (frames + 1, ...), float64"""
    blow_up: BlowUp | None

    @property
    def points(self) -> Array:
        """Places of all things [m], shape (frames + 1, n, 3): particles, spheres and bodies."""
        return np.concatenate([self.states[name] for name in ("points", "sphere_positions", "body_positions")], axis=1)


class Case:
    """A scene to be held to the properties; each of its runs is simulated once."""

    def __init__(self, tables: Tables, device: str = "cpu", simulate: Callable[..., Run] | None = None):
        self.tables, self.device, self.simulate = tables, device, simulate or simulated
        self.scene = Scene.model_validate(tables)
        self._runs: dict[str, Run] = {}
        self._twins: dict[str, Twin] = {}

    @cached_property
    def run(self) -> Run:
        """The scene as it is, in the schedule that `auto` takes.

        Raises:
            InputError: the scene is refused.
        """
        return self.simulate(self.scene, self.device)

    def again(self) -> Run:
        """Simulate the scene once more."""
        return self.simulate(self.scene, self.device)

    @property
    def substeps(self) -> int:
        """Substeps of a frame that `auto` chose."""
        return self.run.model.substeps

    @cached_property
    def size(self) -> float:
        """Largest extent of a balloon at the start [m]."""
        return max(float(np.ptp(shape.mesh.points, axis=0).max()) for shape in self.run.model.shapes)

    def in_schedule(self, schedule: str) -> Run:
        """Return the scene in another schedule."""
        if schedule not in self._runs:
            self._runs[schedule] = self.simulate(self.with_substeps(1), self.device, schedule)
        return self._runs[schedule]

    def finer(self, times: int) -> Run:
        """Return the scene with a multiple of its substeps."""
        name = f"{times} times the substeps"
        if name not in self._runs:
            self._runs[name] = self.simulate(self.with_substeps(times), self.device)
        return self._runs[name]

    def as_twin(self, name: str, make: Callable[[Tables], Twin]) -> tuple[Run, Array]:
        """Return a twin's run, and its places as the scene has them, shape (frames + 1, n, 3)."""
        if name not in self._runs:
            self._twins[name] = make(copy.deepcopy(self.tables))
            self._runs[name] = self.simulate(self.with_substeps(1, self._twins[name].tables), self.device)
        return self._runs[name], self._twins[name].back(self._runs[name].points)

    @cached_property
    def spread(self) -> Array:
        """Largest distance that starts 1e-6 of the size apart have come to, by frame [m], shape (frames + 1,)."""
        return self.spread_by(NUDGE, 2)

    def spread_by(self, nudge: float, count: int) -> Array:
        """Return the largest distance that some starts have come to, by frame [m], shape (frames + 1,).

        Args:
            nudge: displacement of their particles, over the size.
            count: how many.
        """
        apart = [np.zeros(len(self.run.points))]
        for number in range(count):
            _, places = self.as_twin(
                f"{nudge} {number}", lambda tables, seed=number: nudged(tables, nudge * self.size, seed)
            )
            apart.append(farthest(places, self.run.points))
        shortest = min(map(len, apart))
        return np.maximum.accumulate(np.max([each[:shortest] for each in apart], axis=0))

    @property
    def is_calm(self) -> bool:
        """Return whether starts that are 1e-6 of the size apart stay within a thousandth of it."""
        return bool(self.spread[-1] < 1.0e-3 * self.size)

    def with_substeps(self, times: int, tables: Tables | None = None) -> Scene:
        """Return the scene, or a twin of it, with a multiple of the substeps that `auto` chose."""
        return Scene.model_validate((tables or self.tables) | {"substeps": times * self.substeps})


def simulated(scene: Scene, device: str, schedule: str = "auto", vary: Vary | None = None) -> Run:
    """Simulate all frames of a scene.

    Raises:
        InputError: it is refused.
    """
    worlds = np.size(next(iter(vary.values()))) if vary else 1
    simulator = Simulator(scene, device, worlds, vary, schedule)
    states: dict[str, list[Array]] = {name: [] for name in STATES}
    blow_up = None

    def note() -> None:
        for name, kept in states.items():
            kept.append(np.array(getattr(simulator.state, name).numpy()[0], dtype=np.float64))

    note()
    try:
        for _ in range(scene.frames):
            simulator.step_unread()
            note()
    except BlowUpError as error:
        blow_up = cast(BlowUp, error.report)
    return Run(simulator.model, {name: np.array(kept) for name, kept in states.items()}, blow_up)


def farthest(places: Array, others: Array) -> Array:
    """Return the largest distance in each frame that both have [m]."""
    frames = min(len(places), len(others))
    return np.linalg.norm(places[:frames] - others[:frames], axis=2).max(axis=1)
