"""Forces of membranes, hinges and faces on their particles, where one thread has a whole world.

Each triangle, hinge and face is evaluated once, and its forces wait at the particles.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.quads import quads_backwards
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import entry_at
from balloon_warp.kernels.loops.eight_quads import quad_pull, quad_wear
from balloon_warp.kernels.loops.faces import face_push
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.phases.add import hinge_function
from balloon_warp.kernels.tables import Tables


@phase("hinge", when=lambda features: features.has("hinge"))
def bend(features: Features, look: Look) -> Any:
    """Add a hinge's forces to its ends and to the corners of its wings [N]."""
    add_hinge = hinge_function(features, look.at, look.add)

    @wp.func
    def bend(t: Tables, points: Any, forces: Any, world: wp.int32, hinge: wp.int32):
        add_hinge(t, world, hinge, points, forces)

    return bend


@phase("face", when=lambda features: features.has("face"))
def blow(features: Features, look: Look) -> Any:
    """Add the force on a face to its corners, in equal shares [N]."""
    push_at_corner, add = face_push(features, look.at, look.velocity_at), look.add

    @wp.func
    def blow(t: Tables, points: Any, velocities: Any, forces: Any, world: wp.int32, face: wp.int32, time: float):
        share = push_at_corner(t, points, velocities, world, face, time)
        for corner in range(t.faces.offsets[face], t.faces.offsets[face + 1]):
            add(forces, t.faces.particles[corner], share)

    return blow


@phase("quad", when=lambda features: features.softens)
def wear_out(features: Features, look: Look) -> Any:
    """Find the factor on the tension of rubber, and keep its peak stretch, as `wear` does."""
    wear_of_quad = quad_wear(features, look.at, look.world)

    @wp.func
    def wear_out(t: Any, points: Any, params: Any, peaks: Any):
        wear_of_quad(t, points, params, peaks)

    return wear_out


@phase("quad", when=lambda features: bool(features.membranes), adjoint=quads_backwards)
def share_out(features: Features, look: Look) -> Any:
    """Add the forces of a quad or triangle of a membrane, or of eight of them, to its corners [N]."""
    pull_of_quad, add_to_corners = quad_pull(features, look.at, look.world), look.add_to_corners

    @wp.func
    def share_out_viscous(t: Any, points: Any, velocities: Any, forces: Any, params: Any):
        on_a, on_b, on_c, on_d = pull_of_quad(t, points, velocities, params)
        corners = 4 * params.number
        add_to_corners(
            forces, entry_at(t.quads, corners), entry_at(t.quads, corners + 1), entry_at(t.quads, corners + 2),
            entry_at(t.quads, corners + 3), on_a, on_b, on_c, on_d,
        )  # fmt: skip

    @wp.func
    def share_out(t: Any, points: Any, forces: Any, params: Any):
        share_out_viscous(t, points, points, forces, params)

    return share_out_viscous if features.viscous else share_out
