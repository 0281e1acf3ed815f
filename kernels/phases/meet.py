"""Exchange of momentum once all particles have moved.

Spheres and particles exchange it, as do bodies and particles, small spheres and faces, and sharp edges. Each by all
threads of a block, for a world.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.contact.bodies import bodies_function
from balloon_warp.kernels.contact.edges import edges_function
from balloon_warp.kernels.contact.faces import faces_function
from balloon_warp.kernels.contact.near import are_noted
from balloon_warp.kernels.contact.ridges import ridges_function
from balloon_warp.kernels.contact.spheres import spheres_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working


@phase("particle", when=lambda traits: traits.small_spheres)
def keep_start(traits: Traits, look: Look) -> Any:
    """Store the position of a particle before it moves, for spheres that touch faces."""

    @wp.func
    def keep_start(working: Working, world: wp.int32, particle: wp.int32, point: wp.vec3):
        working.point_starts[world, particle] = point

    return keep_start


@phase("team", when=lambda traits: traits.ridges)
def meet_ridges(traits: Traits, look: Look) -> Any:
    """Resolve contacts of balloon faces with ridges of obstacles and bodies."""
    return ridges_function(traits)


@phase("team", when=lambda traits: traits.impulses, due=lambda traits: are_noted)
def meet_spheres(traits: Traits, look: Look) -> Any:
    """Exchange momentum between spheres and particles."""
    return spheres_function(traits, *look.in_team)


@phase("team", when=lambda traits: traits.bodies > 0)
def meet_bodies(traits: Traits, look: Look) -> Any:
    """Exchange momentum between free bodies and particles."""
    return bodies_function(traits)


@phase("team", when=lambda traits: traits.small_spheres)
def meet_faces(traits: Traits, look: Look) -> Any:
    """Resolve contacts of small spheres with faces."""
    return faces_function(traits)


@phase("team", when=lambda traits: traits.edges_meet)
def meet_edges(traits: Traits, look: Look) -> Any:
    """Resolve contacts of sharp edges."""
    return edges_function(traits)
