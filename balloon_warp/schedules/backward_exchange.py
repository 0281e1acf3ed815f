"""Exchange of momentum between spheres and particles, backwards: the state before it in a substep is kept."""

from collections.abc import Mapping
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.exchange import exchange_again_kernel
from balloon_warp.kernels.adjoints.exchange_back import exchange_back_kernel
from balloon_warp.kernels.adjoints.exchange_tables import ExchangeBars, Exchanges, Met
from balloon_warp.kernels.contact.near import mark_count
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.working import Working
from balloon_warp.launching import launch_tiled
from balloon_warp.model import Model
from balloon_warp.model.memory import Room
from balloon_warp.schedules.backward_spheres import SpheresBackward
from balloon_warp.schedules.launches import team_threads


class ExchangeBackward:
    """Run the exchange of momentum backwards, a substep at a time.

    Args:
        columns: of the numbers that are derived by.
        working: of the launches that compute frames again.
        spheres: whose bars it turns into those of before the exchange.
        arrays: bars of the substep that runs backwards, by name.
        of_frame: bars of the frame.
    """

    def __init__(
        self, model: Model, features: Features, columns: tuple[int, ...], tables: Any, working: Any,
        spheres: SpheresBackward, arrays: Mapping[str, wp.array], of_frame: Any, room: Room,
    ):  # fmt: skip
        self._model, self._tables, self._working, self._of_frame = model, tables, working, of_frame
        self._again, self._back = exchange_again_kernel(features), exchange_back_kernel(features, columns)
        self._came, self._exchanges = kept_of_exchange(model, room)
        self._bars = ExchangeBars()
        self._bars.spheres = spheres.bars
        self._bars.points, self._bars.velocities = arrays["all_point_bar"], arrays["all_velocity_bar"]
        self._bars.masses = room.array((model.world_count, model.particle_count), wp.float32)
        self._bars.gas_masses, self._bars.numbers = arrays["all_gas_mass_bar"], arrays["number_bars"]

    def note(self, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Keep where particles are before the exchange, and which are near spheres."""
        for kept, array in zip(self._came[substep], (points, velocities, self._working.near), strict=True):
            wp.copy(kept, array)

    def turn_back(self, substep: int, log: Any) -> None:
        """Turn the bars of after the exchange into those of before.

        Args:
            log: courses of spheres in the substep, as they come to the exchange.
        """
        points, velocities, near = self._came[substep]
        wp.copy(self._exchanges.points[0], points)
        wp.copy(self._exchanges.velocities[0], velocities)
        working = Working()
        for name in vars(Working.cls)["__annotations__"]:
            setattr(working, name, getattr(self._working, name))
        working.near = near
        model, device = self._model, self._model.device
        worlds, threads = [model.world_count], team_threads(model)
        inputs = [self._tables, working, log, self._exchanges]
        launch_tiled(self._again, dim=worlds, inputs=inputs, block_dim=threads, device=device)
        inputs += [substep * model.step_seconds, self._bars, self._of_frame]
        launch_tiled(self._back, dim=worlds, inputs=inputs, block_dim=threads, device=device)


def kept_of_exchange(model: Model, room: Room) -> tuple[list[tuple[wp.array, wp.array, wp.array]], Any]:
    """Allocate the state before each substep's exchange, and the values of one that are computed again."""
    worlds, particles, spheres = model.world_count, model.particle_count, model.sphere_count
    exchanges = Exchanges()
    for name in ("points", "velocities"):
        setattr(exchanges, name, room.array((spheres + 1, worlds, particles), wp.vec3))
    exchanges.met = room.array((worlds, spheres), Met)
    came = [
        (
            room.array((worlds, particles), wp.vec3),
            room.array((worlds, particles), wp.vec3),
            room.array((worlds, mark_count(particles)), wp.int32),
        )
        for _ in range(model.substeps)
    ]
    return came, exchanges
