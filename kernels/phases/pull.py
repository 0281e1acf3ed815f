"""Net force on a particle but for the inflation's.

They are of springs, strings, hinges, faces, membranes and laws on particles; the thrust of jets, and what contacts push
with.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.added import add_backwards
from balloon_warp.kernels.adjoints.jets import jet_backwards
from balloon_warp.kernels.adjoints.pull import pull_backwards
from balloon_warp.kernels.contact.forces import take_contact_forces
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import any_positive
from balloon_warp.kernels.loops.jets import hole_jet_loop, jet_loop
from balloon_warp.kernels.loops.net_force import net_force_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working


@phase("particle", {"force": wp.vec3, "area_vector": wp.vec3}, adjoint=pull_backwards)
def pull(features: Features, look: Look) -> Any:
    """Sum the forces on a particle [N], and where it is needed find its area vector [m^2]."""
    net_force = net_force_function(features, look.loops(features))

    @wp.func
    def pull(t: Any, points: Any, params: Any, springs: Any, point: Any, velocity: Any, time: float):
        force, area_vector, _facing = net_force(t, points, points, params, springs, point, velocity, time)
        return force, area_vector

    @wp.func
    def pull_by_velocities(
        t: Any, points: Any, velocities: Any, params: Any, springs: Any, point: Any, velocity: Any, time: float
    ):
        force, area_vector, _facing = net_force(t, points, velocities, params, springs, point, velocity, time)
        return force, area_vector

    @wp.func
    def pull_alone(t: Any, params: Any, springs: Any, point: Any, velocity: Any, time: float):
        force, area_vector, _facing = net_force(
            t, point, velocity, params, springs, point, velocity, time
        )  # looks nowhere
        return force, area_vector

    if look.alone(features):
        return pull_alone
    return pull_by_velocities if features.looks_at_velocities else pull


@phase("particle", {"force": wp.vec3, "area_vector": wp.vec3, "vertex_normal": wp.vec3})
def pull_and_face(features: Features, look: Look) -> Any:
    """Sum the forces on a particle [N], and on the way find its area vector, and A_p n [m^2]."""
    net_force = net_force_function(features, look.loops(features))

    @wp.func
    def pull_and_face(
        t: Tables,
        points: Any,
        params: Any,
        springs: Any,
        point: wp.vec3,
        velocity: wp.vec3,
        time: float,
    ):
        force, area_vector, vertex_normal = net_force(t, points, points, params, springs, point, velocity, time)
        return force, area_vector, vertex_normal

    @wp.func
    def pull_by_velocities(
        t: Tables,
        points: Any,
        velocities: Any,
        params: Any,
        springs: Any,
        point: wp.vec3,
        velocity: wp.vec3,
        time: float,
    ):
        force, area_vector, vertex_normal = net_force(t, points, velocities, params, springs, point, velocity, time)
        return force, area_vector, vertex_normal

    return pull_by_velocities if features.looks_at_velocities else pull_and_face


@phase("particle", {"force": wp.vec3}, when=lambda features: features.touches, adjoint=add_backwards)
def take(features: Features, look: Look) -> Any:
    """Add contact forces to a particle."""

    @wp.func
    def take(working: Working, params: Any, force: wp.vec3):
        return force + take_contact_forces(working, params.world, params.number)

    return take


def _at_neck(features: Features, look: Look) -> Any:
    @wp.func
    def is_at_neck(t: Any, params: Any):
        """Return whether any particle of eight is at a neck."""
        return any_positive(t.necks.weights[params.number])

    return is_at_neck


@phase("particle", {"force": wp.vec3}, when=lambda features: features.jets, rare=_at_neck, adjoint=jet_backwards)
def jet(features: Features, look: Look) -> Any:
    """Add the thrust at the balloon's neck."""
    thrust_at = jet_loop(features, look.at)

    @wp.func
    def jet(t: Tables, points: Any, params: Any, point: wp.vec3, load: wp.vec2, time: float, force: wp.vec3):
        weight = t.necks.weights[params.number]
        return force + thrust_at(t.necks, points, weight, params.balloon, load, wp.dot(point, t.up), time, params.n)

    return jet


@phase("particle", {"force": wp.vec3}, when=lambda features: features.bursts)
def jet_of_holes(features: Features, look: Look) -> Any:
    """Add the thrust of holes where the balloon is torn."""
    thrust_at = hole_jet_loop(features, look.at)

    @wp.func
    def jet_of_holes(
        t: Tables, state: WorldState, points: Any, params: Any, point: wp.vec3, load: wp.vec2, force: wp.vec3
    ):
        if state.bursts[params.world, params.balloon][1] > 0.0:
            return force + thrust_at(t, points, params, load, point)
        return force

    return jet_of_holes
