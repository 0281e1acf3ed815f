"""All forces on a particle but the inflation's.

They are of springs, strings, hinges, faces, membranes and laws on particles; the thrust of jets, and what contacts push
with.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.pull import pull_backwards
from balloon_warp.kernels.contact.forces import take_pushes
from balloon_warp.kernels.lanes import any_positive
from balloon_warp.kernels.loops.jets import hole_jet_loop, jet_loop
from balloon_warp.kernels.loops.net_force import net_force_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working


@phase("particle", {"force": wp.vec3, "area_vector": wp.vec3}, adjoint=pull_backwards)
def pull(traits: Traits, look: Look) -> Any:
    """Sum the forces on a particle [N], and where it is needed find its area vector [m^2]."""
    net_force = net_force_function(traits, look.loops(traits))

    @wp.func
    def pull(t: Any, points: Any, own: Any, springs: Any, point: Any, velocity: Any, time: float):
        force, area_vector, _facing = net_force(t, points, points, own, springs, point, velocity, time)
        return force, area_vector

    @wp.func
    def pull_by_velocities(
        t: Any, points: Any, velocities: Any, own: Any, springs: Any, point: Any, velocity: Any, time: float
    ):
        force, area_vector, _facing = net_force(t, points, velocities, own, springs, point, velocity, time)
        return force, area_vector

    @wp.func
    def pull_alone(t: Any, own: Any, springs: Any, point: Any, velocity: Any, time: float):
        force, area_vector, _facing = net_force(
            t, point, velocity, own, springs, point, velocity, time
        )  # looks nowhere
        return force, area_vector

    if look.alone(traits):
        return pull_alone
    return pull_by_velocities if traits.looks_at_velocities else pull


@phase("particle", {"force": wp.vec3, "area_vector": wp.vec3, "facing": wp.vec3})
def pull_and_face(traits: Traits, look: Look) -> Any:
    """Sum the forces on a particle [N], and on the way find its area vector, and A_p n [m^2]."""
    net_force = net_force_function(traits, look.loops(traits))

    @wp.func
    def pull_and_face(
        t: Tables,
        points: Any,
        own: Any,
        springs: Any,
        point: wp.vec3,
        velocity: wp.vec3,
        time: float,
    ):
        force, area_vector, facing = net_force(t, points, points, own, springs, point, velocity, time)
        return force, area_vector, facing

    @wp.func
    def pull_by_velocities(
        t: Tables,
        points: Any,
        velocities: Any,
        own: Any,
        springs: Any,
        point: wp.vec3,
        velocity: wp.vec3,
        time: float,
    ):
        force, area_vector, facing = net_force(t, points, velocities, own, springs, point, velocity, time)
        return force, area_vector, facing

    return pull_by_velocities if traits.looks_at_velocities else pull_and_face


@phase("particle", {"force": wp.vec3}, when=lambda traits: traits.touches)
def take(traits: Traits, look: Look) -> Any:
    """Add contact forces to a particle."""

    @wp.func
    def take(working: Working, own: Any, force: wp.vec3):
        return force + take_pushes(working, own.world, own.number)

    return take


def _at_neck(traits: Traits, look: Look) -> Any:
    @wp.func
    def is_at_neck(t: Any, own: Any):
        """Return whether any particle of eight is at a neck."""
        return any_positive(t.necks.weights[own.number])

    return is_at_neck


@phase("particle", {"force": wp.vec3}, when=lambda traits: traits.jets, rare=_at_neck)
def jet(traits: Traits, look: Look) -> Any:
    """Add the thrust at the balloon's neck."""
    thrust_at = jet_loop(traits, look.at)

    @wp.func
    def jet(t: Tables, points: Any, own: Any, point: wp.vec3, load: wp.vec2, time: float, force: wp.vec3):
        weight = t.necks.weights[own.number]
        return force + thrust_at(t.necks, points, weight, own.balloon, load, wp.dot(point, t.up), time, own.n)

    return jet


@phase("particle", {"force": wp.vec3}, when=lambda traits: traits.bursts)
def jet_of_holes(traits: Traits, look: Look) -> Any:
    """Add the thrust of holes where the balloon is torn."""
    thrust_at = hole_jet_loop(look.at)

    @wp.func
    def jet_of_holes(
        t: Tables, state: WorldState, points: Any, own: Any, point: wp.vec3, load: wp.vec2, force: wp.vec3
    ):
        if state.bursts[own.world, own.balloon][1] > 0.0:
            return force + thrust_at(t, points, own, load, point)
        return force

    return jet_of_holes
