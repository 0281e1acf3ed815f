"""Net force on a particle but for the inflation's.

They are of springs, strings, hinges, faces, membranes and laws on particles; the thrust of jets, and the forces of
contacts.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.added import add_backwards
from balloon_warp.kernels.adjoints.jets import jet_backwards
from balloon_warp.kernels.adjoints.pull import pull_backwards
from balloon_warp.kernels.codegen import function_from
from balloon_warp.kernels.contact.forces import take_contact_forces
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import any_positive
from balloon_warp.kernels.loops.jets import hole_jet_loop, jet_loop
from balloon_warp.kernels.loops.net_force import net_force_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working


def _pulling(features: Features, look: Look, name: str, results: str) -> Any:
    """Return the function of a phase that names the values of others, and of a liquid, that its forces depend on."""
    alone, by_velocities = look.alone(features), features.looks_at_velocities
    views = [] if alone else ["points", "velocities"] if by_velocities else ["points"]
    load = ["water_load"] if features.in_water else []
    reads = ["t", *views, "params", "springs", "point", "velocity", *load, "time"]
    of_others = ", ".join([views[0], views[-1]] if views else ["point", "velocity"])  # which looks nowhere
    source = "\n".join(
        [
            f"def {name}({', '.join(f'{each}: Any' for each in reads)}):",
            "    force, area_vector, vertex_normal = net_force(",
            f"        t, {of_others}, params, springs, point, velocity, {load[0] if load else 'wp.vec4()'}, time",
            "    )",
            f"    return {results}\n",
        ]
    )
    return function_from(name, source, {"net_force": net_force_function(features, look.loops(features))})


@phase("particle", {"force": wp.vec3, "area_vector": wp.vec3}, adjoint=pull_backwards)
def pull(features: Features, look: Look) -> Any:
    """Sum the forces on a particle [N], and where it is needed find its area vector [m^2]."""
    return _pulling(features, look, "pull", "force, area_vector")


@phase("particle", {"force": wp.vec3, "area_vector": wp.vec3, "vertex_normal": wp.vec3})
def pull_and_face(features: Features, look: Look) -> Any:
    """Sum the forces on a particle [N], and on the way find its area vector, and A_p n [m^2]."""
    return _pulling(features, look, "pull_and_face", "force, area_vector, vertex_normal")


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
