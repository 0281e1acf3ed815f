"""Contact: particles leave solids, balloons push each other, and momentum is exchanged.

Impulses of contacts on particles are summed over a frame. Each follows from the change of a velocity that all other
forces would have left as it was, with the part of it that damping and drag take in the step.

Momentum is exchanged once all particles have moved: by spheres and particles, as do small spheres and faces, and then
by all that is on a list of contacts. Each is by all threads of a block, for a world.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.exchange import exchange_backwards
from balloon_warp.kernels.adjoints.small_spheres import small_spheres_backwards
from balloon_warp.kernels.adjoints.solids import leave_backwards
from balloon_warp.kernels.adjoints.sweeps import swept_backwards
from balloon_warp.kernels.contact.ends import take_impulse
from balloon_warp.kernels.contact.spheres import are_noted, faces_function, noting_function, spheres_function
from balloon_warp.kernels.contact.sweeps import AT_LAST, BESIDE_RIDGES, obstacle_contact_function
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.contact import around_function, near_solids, obstacle_loop, solid_contact_function
from balloon_warp.kernels.loops.fixtures import nearest_thing_function
from balloon_warp.kernels.loops.net_force import inverse_mass_function
from balloon_warp.kernels.phase import Access, nothing, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working


@phase("launches", when=lambda features: features.touches, adjoint=nothing)
def touch_balloons(features: Features, access: Access) -> Any:
    """Search for contacts now and then, and apply their forces: own launches, see `schedules.launched`.

    Backwards it has launches of its own, too, once particles have gone back, see `schedules.backward_contact`.
    """
    return None


ROUNDING = wp.constant(1.0e-5)
"""Part of a velocity that is rounding where balloons push each other in many sweeps"""


@phase("particle", {"unhindered": wp.vec3}, when=lambda features: features.tells_contacts)
@wp.func
def note_unhindered(velocity: wp.vec3):
    """Store a particle's velocity without contacts."""
    return velocity


@phase("particle", when=lambda features: features.tells_contacts)
def record_impulses(features: Features, access: Access) -> Any:
    """Sum the impulse of the thing nearest to a particle."""
    nearest_thing, inverse_mass_of = nearest_thing_function(features), inverse_mass_function(features)

    @wp.func
    def record_impulses(
        t: Tables,
        state: WorldState,
        working: Working,
        params: Any,
        end: float,
        point: wp.vec3,
        velocity: wp.vec3,
        unhindered: wp.vec3,
        gain: float,
    ):
        change = velocity - unhindered
        least = float(0.0)
        if wp.static(features.edges_meet):
            of_layers = take_impulse(working.layer_quanta, params.world, params.number)
            if wp.length_sq(of_layers) > 0.0:
                change -= inverse_mass_of(t, working, params.world, params.number) * of_layers
                least = ROUNDING * (wp.length(velocity) + wp.length(unhindered))
        if wp.length(change) > least and gain > 0.0:
            impulse = (t.step_seconds / gain) * change
            thing = nearest_thing(t, state, params.world, end, point)
            if thing >= 0:
                before = working.contact_impulses[params.world, thing, params.number]
                working.contact_impulses[params.world, thing, params.number] = before + wp.vec4(
                    impulse[0], impulse[1], impulse[2], t.step_seconds
                )

    return record_impulses


@phase(
    "particle", {"point": wp.vec3, "velocity": wp.vec3}, when=lambda features: features.obstacles, rare=near_solids,
    adjoint=leave_backwards,
)  # fmt: skip
def leave(features: Features, access: Access) -> Any:
    """Leave spheres, obstacles and the ground; one that may exchange momentum with a sphere waits for the others."""
    leave_obstacles = obstacle_loop(features, access.sphere_at)
    is_noted, around_particle = noting_function(features, access.sphere_at), around_function(features)
    stand = solid_contact_function(features)

    @wp.func
    def leave_all(
        t: Tables,
        spheres: Any,
        params: Any,
        end: float,
        point: wp.vec3,
        velocity: wp.vec3,
        inflation: wp.vec3,
    ):
        if params.mass > 0.0:
            out, after = leave_obstacles(t, spheres, around_particle(params, end), point, velocity, inflation)
            return out, after
        return point, velocity

    @wp.func
    def leave_or_wait(
        t: Tables, spheres: Any, working: Working, params: Any, end: float, point: wp.vec3, velocity: wp.vec3
    ):
        if params.mass <= 0.0 or is_noted(t, spheres, working.near, params.world, params.number, point, velocity):
            return point, velocity
        out, after = leave_obstacles(t, spheres, around_particle(params, end), point, velocity, wp.vec3())
        return out, after

    @wp.func
    def leave_solids(t: Tables, params: Any, end: float, point: wp.vec3, velocity: wp.vec3):
        if params.mass <= 0.0:
            return point, velocity
        out, after = stand(t, around_particle(params, end), point, velocity)
        return out, after

    if features.penalties:
        return leave_all
    return leave_or_wait if features.impulses else leave_solids


@phase("particle", when=lambda features: features.small_spheres, adjoint=small_spheres_backwards)
@wp.func
def keep_start(working: Working, world: wp.int32, particle: wp.int32, point: wp.vec3):
    """Store the position of a particle before it moves, for spheres that touch faces."""
    working.point_starts[world, particle] = point


@phase("team", when=lambda features: features.ridges_first, adjoint=swept_backwards)
def meet_ridges(features: Features, access: Access) -> Any:
    """Resolve contacts of balloon faces with ridges of obstacles and bodies."""
    return obstacle_contact_function(BESIDE_RIDGES, features)


@phase(
    "team", when=lambda features: features.impulses, due=lambda features: are_noted, adjoint=exchange_backwards
)  # fmt: skip
def meet_spheres(features: Features, access: Access) -> Any:
    """Exchange momentum between spheres and particles."""
    return spheres_function(features, *access.in_team)


@phase("team", when=lambda features: features.small_spheres, adjoint=small_spheres_backwards)
def meet_faces(features: Features, access: Access) -> Any:
    """Resolve contacts of small spheres with faces."""
    return faces_function(features)


@phase("team", when=lambda features: features.edges_meet or features.bodies > 0, adjoint=swept_backwards)
def meet(features: Features, access: Access) -> Any:
    """Resolve contacts of balloons with free bodies, and of sharp edges, beside the ground."""
    return obstacle_contact_function(AT_LAST, features)
