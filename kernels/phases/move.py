"""A particle moves: a = F / m; v += h a; x += h v, in the order of the paper's listing.

But of a balloon's damping c a force -c v is in F, and v' = v + h F / (m + h c): the damping is that of the speed at the
end, so that the speed goes to F / c and never beyond, however short the time m / c is for the step.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import by_grad
from balloon_warp.kernels.algebra import scaled, times
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import Lanes
from balloon_warp.kernels.phase import Look, phase


@wp.func
def response(mass: float, step_seconds: float):
    """Return the velocity gained in a step per newton [m/s/N]; a particle without mass is fixed.

    Its derivative by the mass is 0 then: both branches are derived, and one divides.
    """
    return wp.where(mass > 0.0, step_seconds / wp.where(mass > 0.0, mass, 1.0), 0.0)


@wp.func_native(
    """
    wp::vec_t<8, wp::float32> gains;
    for (int lane = 0; lane < 8; ++lane)
        gains.c[lane] = mass.c[lane] > 0.0f ? step_seconds / mass.c[lane] : 0.0f;
    return gains;
    """,
    adj_snippet="""
    for (int lane = 0; lane < 8; ++lane) {
        const float inverse = mass.c[lane] > 0.0f ? 1.0f / mass.c[lane] : 0.0f;
        adj_mass.c[lane] -= adj_ret.c[lane] * step_seconds * inverse * inverse;
        adj_step_seconds += adj_ret.c[lane] * inverse;
    }
    """,
)
def response(mass: Lanes, step_seconds: float) -> Lanes:  # noqa: F811 - an overload
    """Return the gains h / m of eight particles."""
    ...


@wp.func
def damped_response(inertia: Any, share: Any, damping: Any, step_seconds: float):
    """Return the velocity gained in a step per newton, where a balloon's damping [N s/m] is that of the step's end."""
    return response(inertia + step_seconds * times(share, damping), step_seconds)


@wp.func
def kick(velocity: Any, force: Any, gain: Any):
    """Return the new velocity v + g F, see `damped_response`."""
    return velocity + scaled(force, gain)


@phase(
    "particle", {"gain": float}, when=lambda features: not features.resists, light=True,
    once=lambda features: not features.gas_changes, adjoint=by_grad,
)  # fmt: skip
def respond(features: Features, look: Look) -> Any:
    """Find the velocity that a force gives a particle."""

    @wp.func
    def respond(t: Any, inertia: Any):
        return response(inertia, t.step_seconds)

    @wp.func
    def respond_damped(t: Any, params: Any, inertia: Any, damping: Any):
        return damped_response(inertia, params.share, damping, t.step_seconds)

    return respond_damped if features.damped else respond


@phase(
    "particle", {"free_velocity": wp.vec3}, when=lambda features: features.gas and not features.resists,
    adjoint=by_grad,
)  # fmt: skip
def free(features: Features, look: Look) -> Any:
    """Accelerate a particle by all forces except inflation, from which the gas's pressure follows."""

    @wp.func
    def free(velocity: Any, force: Any, gain: Any):
        return kick(velocity, force, gain)

    return free


@phase("particle", {"velocity": wp.vec3}, adjoint=by_grad)
def push(features: Features, look: Look) -> Any:
    """Accelerate a particle by all forces."""

    @wp.func
    def push(velocity: Any, force: Any, inflation: Any, gain: Any):
        return kick(velocity, force + inflation, gain)

    @wp.func
    def push_on(free_velocity: Any, inflation: Any, gain: Any):
        return kick(free_velocity, inflation, gain)

    return push_on if features.gas or features.resists else push


def _move(features: Features, look: Look) -> Any:
    @wp.func
    def move(t: Any, point: Any, velocity: Any):
        """Move a point: x + h v [m]."""
        return point + scaled(velocity, t.step_seconds)

    return move


@phase("particle", {"point": wp.vec3}, when=lambda features: features.forward_euler, adjoint=by_grad)
def move_first(features: Features, look: Look) -> Any:
    """Move a particle by the old velocity: forward Euler."""
    return _move(features, look)


@phase("particle", {"point": wp.vec3}, when=lambda features: not features.forward_euler, adjoint=by_grad)
def move(features: Features, look: Look) -> Any:
    """Move a particle by the new velocity: symplectic Euler."""
    return _move(features, look)
