"""Edges of balloons that meet, backwards: the state before a substep's contacts is kept."""

from collections.abc import Mapping
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.crossings import KINDS, EdgeBars
from balloon_warp.kernels.adjoints.crossings_back import crossings_back_kernel
from balloon_warp.kernels.adjoints.particle_sums import SUMS
from balloon_warp.kernels.contact.catch import EdgeCatch
from balloon_warp.kernels.contact.edges import MOST_SWEEPS
from balloon_warp.kernels.features import Features
from balloon_warp.launching import launch_tiled
from balloon_warp.model import Model
from balloon_warp.model.memory import Room
from balloon_warp.schedules.backward_touch import TouchBackward
from balloon_warp.schedules.contact_lists import list_lengths
from balloon_warp.schedules.launches import Moving, team_threads


class EdgesBackward:
    """Run edges that meet backwards, a substep at a time.

    Args:
        columns: of the numbers that are derived by.
        touch: the contacts of particles, which keeps the results of searches.
        arrays: bars of the substep that runs backwards, by name.
    """

    def __init__(
        self, model: Model, features: Features, columns: tuple[int, ...], touch: TouchBackward,
        arrays: Mapping[str, wp.array], room: Room,
    ):  # fmt: skip
        self._model, self._touch = model, touch
        self._back = crossings_back_kernel(features, columns)
        self._came, self._again, self._bars = kept_of_edges(model, features, room)
        self._bars.points, self._bars.velocities = arrays["all_point_bar"], arrays["all_velocity_bar"]
        self._bars.gas_masses, self._bars.numbers = arrays["all_gas_mass_bar"], arrays["number_bars"]
        self._bars.totals = touch.bars.totals
        self._stops = room.array((model.world_count, model.particle_count if features.ground else 0), wp.vec2)

    def note(self, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Keep where particles are before edges meet."""
        for kept, array in zip(self._came[substep], (points, velocities), strict=True):
            wp.copy(kept, array)

    def turn_back(self, substep: int) -> None:
        """Turn the bars of after the contacts into those of before."""
        for again, kept in zip(self._again, self._came[substep], strict=True):
            wp.copy(again, kept)
        model, working = self._model, self._touch.as_it_was(substep)
        working.edge_stops = self._stops
        launch_tiled(
            self._back, dim=[model.world_count],
            inputs=[
                self._touch.tables, working, self._came[substep][0], *self._again, self._bars,
            ],
            block_dim=team_threads(model), device=model.device,
        )  # fmt: skip


def kept_of_edges(model: Model, features: Features, room: Room) -> tuple[list[Moving], Moving, Any]:
    """Allocate the state before each substep's contacts, room to move that again, and bars."""
    worlds, particles, pairs = model.world_count, model.particle_count, model.balloon_count**2
    came = [
        (room.array((worlds, particles), wp.vec3), room.array((worlds, particles), wp.vec3))
        for _ in range(model.substeps + 1)
    ]
    bars = EdgeBars()
    catches = list_lengths(model, features)["edge_catches"]
    bars.eases = room.array((worlds, particles), wp.float32)
    bars.catches = room.array((worlds, catches), EdgeCatch)
    bars.frictions = room.array((worlds, catches), wp.float32)
    bars.courses = room.array((int(MOST_SWEEPS), worlds, particles), wp.vec3)
    stopped = (int(MOST_SWEEPS) + 1, worlds, particles if features.ground else 0)
    bars.rises, bars.falls = room.array(stopped, wp.float32), room.array(stopped, wp.float32)
    bars.sums = room.array((worlds, particles, SUMS), wp.int64)
    bars.pairs = room.array((worlds, pairs, 2), wp.int64)
    bars.largest = room.array((worlds, KINDS), wp.float32)
    return came[:-1], came[-1], bars
