"""Exchange of momentum once all particles have moved.

Spheres and particles exchange it, as do small spheres and faces, and then all that is on a list of contacts. Each by
all threads of a block, for a world.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.exchange import exchange_backwards
from balloon_warp.kernels.adjoints.finds import swept_backwards
from balloon_warp.kernels.adjoints.small_spheres import small_spheres_backwards
from balloon_warp.kernels.contact.faces import faces_function
from balloon_warp.kernels.contact.kinds import AT_LAST, BESIDE_RIDGES
from balloon_warp.kernels.contact.near import are_noted
from balloon_warp.kernels.contact.spheres import spheres_function
from balloon_warp.kernels.contact.sweeps import meeting_function
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.working import Working


@phase("particle", when=lambda features: features.small_spheres, adjoint=small_spheres_backwards)
def keep_start(features: Features, look: Look) -> Any:
    """Store the position of a particle before it moves, for spheres that touch faces."""

    @wp.func
    def keep_start(working: Working, world: wp.int32, particle: wp.int32, point: wp.vec3):
        working.point_starts[world, particle] = point

    return keep_start


@phase("team", when=lambda features: features.ridges_first, adjoint=swept_backwards)
def meet_ridges(features: Features, look: Look) -> Any:
    """Resolve contacts of balloon faces with ridges of obstacles and bodies."""
    return meeting_function(BESIDE_RIDGES, features)


@phase(
    "team", when=lambda features: features.impulses, due=lambda features: are_noted, adjoint=exchange_backwards
)  # fmt: skip
def meet_spheres(features: Features, look: Look) -> Any:
    """Exchange momentum between spheres and particles."""
    return spheres_function(features, *look.in_team)


@phase("team", when=lambda features: features.small_spheres, adjoint=small_spheres_backwards)
def meet_faces(features: Features, look: Look) -> Any:
    """Resolve contacts of small spheres with faces."""
    return faces_function(features)


@phase("team", when=lambda features: features.edges_meet or features.bodies > 0, adjoint=swept_backwards)
def meet(features: Features, look: Look) -> Any:
    """Resolve contacts of balloons with free bodies, and of sharp edges, beside the ground."""
    return meeting_function(AT_LAST, features)
