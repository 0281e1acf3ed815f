"""The force of the inflation on a particle: the paper's normal force, or a pressure times its area vector."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import by_grad
from balloon_warp.kernels.adjoints.directions import inflate_backwards
from balloon_warp.kernels.algebra import reach_along, scaled, times
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import pair
from balloon_warp.kernels.laws.inflation import NORMAL_FORCE, normal_push
from balloon_warp.kernels.phase import Look, phase


@wp.func
def pressure_at(load: Any, rise: Any, point: Any, up: wp.vec3):
    """Return the gauge pressure at a place [Pa], see `inflation_of`."""
    return load + times(rise, reach_along(point, up))


@cache
def inflation_of(features: Features) -> Any:
    """Make the function that gives the force of the inflation on a particle, or on eight of a balloon."""

    @wp.func
    def inflation(
        kind: wp.int32,
        k_normal: Any,
        load: Any,
        rise: Any,
        up: wp.vec3,
        point: Any,
        inflation_direction: Any,
        area: Any,
    ):
        """Find the force of the inflation [N].

        Args:
            load: pressure at height 0 [Pa].
            rise: of the pressure with height [Pa/m].
        """
        if wp.static(not features.pressures):
            return scaled(inflation_direction, normal_push(k_normal))
        elif wp.static(not features.inflation_directions):
            return scaled(area, pressure_at(load, rise, point, up))
        else:
            push = pressure_at(load, rise, point, up)
            along = area
            if kind == NORMAL_FORCE:
                push = normal_push(k_normal)
                along = inflation_direction
            return scaled(along, push)

    return inflation


@phase(
    "particle", {"load": wp.vec2}, when=lambda features: features.pressures and not features.gas, light=True,
    adjoint=by_grad,
)  # fmt: skip
def given_load(features: Features, look: Look) -> Any:
    """Take a given pressure, the same at all heights."""

    @wp.func
    def given_load(keyed: Any):
        """Return the gauge pressure at height 0 [Pa], and its gradient with height [Pa/m]."""
        return pair(keyed, 0.0)

    return given_load


@phase("particle", {"inflation": wp.vec3}, adjoint=inflate_backwards)
def inflate(features: Features, look: Look) -> Any:
    """Find the force of the inflation [N]."""
    inflation = inflation_of(features)

    @wp.func
    def push_along_direction(t: Any, keyed: Any, inflation_direction: Any):
        return inflation(
            NORMAL_FORCE, keyed, 0.0, 0.0, t.up, inflation_direction, inflation_direction, inflation_direction
        )

    @wp.func
    def push_by_pressure(t: Any, load: Any, point: Any, area_vector: Any):
        return inflation(0, 0.0, load[0], load[1], t.up, point, area_vector, area_vector)

    @wp.func
    def push_either_way(
        t: Any, params: Any, keyed: Any, load: Any, point: Any, inflation_direction: Any, area_vector: Any
    ):
        return inflation(params.kind, keyed, load[0], load[1], t.up, point, inflation_direction, area_vector)

    if not features.pressures:
        return push_along_direction
    return push_either_way if features.inflation_directions else push_by_pressure


@phase("particle", {"net_force": wp.vec3})
def add_up(features: Features, look: Look) -> Any:
    """Sum all forces [N], for output."""

    @wp.func
    def add_up(force: Any, inflation: Any):
        return force + inflation

    return add_up
