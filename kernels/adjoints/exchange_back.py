"""Kernel that runs all that particles near spheres do backwards: they exchange momentum, and then leave solids."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.exchange import sphere_adjoint
from balloon_warp.kernels.adjoints.exchange_tables import ExchangeBars, Exchanges
from balloon_warp.kernels.adjoints.solids import ground_columns, standing_functions
from balloon_warp.kernels.adjoints.spheres import LoggedSpheres
from balloon_warp.kernels.contact.near import PARTICLES_A_MARK
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.frames.backwards import Bars, numbers_adder
from balloon_warp.kernels.loops.obstacles import around_function
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import numbers_type, params_functions
from balloon_warp.kernels.tables import Tables, row_of_world
from balloon_warp.kernels.working import Working


@cache
def particle_functions(features: Features, columns: tuple[int, ...]) -> tuple[Any, Any]:
    """Return the adjoints of a particle's way out of solids, and of its mass."""
    _, read_params = params_functions(features.columns, features.balloons)
    around_particle, stand_backwards = around_function(features), standing_functions(features)[0]
    asked = [*ground_columns(features), features.columns.places["mass"]]
    height, friction, mass = (columns.index(column) if column in columns else -1 for column in asked)

    @wp.func
    def add(numbers: wp.array3d[float], world: wp.int32, particle: wp.int32, place: wp.int32, more: float):
        numbers[world, particle, place] = numbers[world, particle, place] + more

    @wp.func
    def stand_back(
        t: Tables, working: Working, exchanges: Exchanges, bars: ExchangeBars, world: wp.int32, particle: wp.int32,
        end: float,
    ):  # fmt: skip
        params = read_params(t, world, particle)
        last = exchanges.points.shape[0] - 1
        if params.share > 0.0:
            stood = stand_backwards(
                t, working, around_particle(params, end), exchanges.points[last, world, particle],
                exchanges.velocities[last, world, particle], bars.points[world, particle],
                bars.velocities[world, particle],
            )  # fmt: skip
            bars.points[world, particle] = stood.point
            bars.velocities[world, particle] = stood.velocity
            if wp.static(height >= 0):
                add(bars.numbers, world, particle, height, stood.height)
            if wp.static(friction >= 0):
                add(bars.numbers, world, particle, friction, stood.friction)

    @wp.func
    def weigh_back(t: Tables, bars: ExchangeBars, world: wp.int32, particle: wp.int32):
        by_share = t.particles.mass_share[particle] * bars.masses[world, particle]
        bars.masses[world, particle] = 0.0
        bars.gas_masses[world, particle] = bars.gas_masses[world, particle] + by_share
        if wp.static(mass >= 0):
            add(bars.numbers, world, particle, mass, by_share)

    return stand_back, weigh_back


@cache
def exchange_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the kernel that runs the exchange of momentum backwards.

    Args:
        columns: of the numbers that are derived by.
    """
    exchange_back = sphere_adjoint(features)
    stand_back, weigh_back = particle_functions(features, columns)
    place, split = features.columns.places["ground_height"], features.columns.balloon_width
    Numbers, add_numbers = numbers_type(features.columns.width), numbers_adder(columns)  # noqa: N806 - a type

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def turn_exchange_back(
        t: Tables, working: Working, spheres: LoggedSpheres, exchanges: Exchanges, time_in_frame: float,
        bars: ExchangeBars, of_frame: Bars,
    ):  # fmt: skip
        """Turn the bars of after the exchange into those of before; a block a world."""
        world, thread = wp.tid()
        marks = working.near.shape[1] - 1
        count = t.particles.balloon.shape[0]
        height = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), place - split]
        if working.near[world, marks] > 0:
            for mark in range(thread, marks, wp.block_dim()):
                if working.near[world, mark] > 0:
                    for particle in range(mark * PARTICLES_A_MARK, wp.min((mark + 1) * PARTICLES_A_MARK, count)):
                        stand_back(t, working, exchanges, bars, world, particle, time_in_frame + t.step_seconds)
            by_height = float(0.0)
            sphere = t.spheres.numbers.shape[1]
            while sphere > 0:
                sphere -= 1
                by_height += exchange_back(
                    t, working, spheres, exchanges, bars, world, sphere, thread, height
                )  # fmt: skip
            for mark in range(thread, marks, wp.block_dim()):
                if working.near[world, mark] > 0:
                    for particle in range(mark * PARTICLES_A_MARK, wp.min((mark + 1) * PARTICLES_A_MARK, count)):
                        weigh_back(t, bars, world, particle)
            if thread == 0:
                by_n = Numbers()
                by_n[place] = by_height
                add_numbers(of_frame.numbers_of_balloons, world, 0, by_n)

    return turn_exchange_back
