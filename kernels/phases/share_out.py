"""Forces of membranes, hinges and faces on their particles, where one thread has a whole world.

Each triangle, hinge and face is evaluated once, and its forces wait at the particles.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.lanes import entry_at
from balloon_warp.kernels.loops.eight_quads import quad_pull
from balloon_warp.kernels.loops.faces import face_push
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.phases.add import hinge_function
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


@phase("hinge", when=lambda traits: traits.has("hinge"))
def bend(traits: Traits, look: Look) -> Any:
    """Add a hinge's forces to its ends and to the corners of its wings [N]."""
    add_hinge = hinge_function(traits, look.at, look.add)

    @wp.func
    def bend(t: Tables, points: Any, forces: Any, world: wp.int32, hinge: wp.int32):
        add_hinge(t, world, hinge, points, forces)

    return bend


@phase("face", when=lambda traits: traits.has("face"))
def blow(traits: Traits, look: Look) -> Any:
    """Add the force on a face to its corners, in equal shares [N]."""
    push_at_corner, add = face_push(traits, look.at, look.velocity_at), look.add

    @wp.func
    def blow(t: Tables, points: Any, velocities: Any, forces: Any, world: wp.int32, face: wp.int32, time: float):
        share = push_at_corner(t, points, velocities, world, face, time)
        for corner in range(t.faces.offsets[face], t.faces.offsets[face + 1]):
            add(forces, t.faces.particles[corner], share)

    return blow


@phase("quad", when=lambda traits: bool(traits.membranes))
def share_out(traits: Traits, look: Look) -> Any:
    """Add what a quad or triangle of a membrane does to its corners, or eight of them [N].

    Where rubber softens, what is left of its tension is found on the way."""
    pull_of_quad, add = quad_pull(traits, look.at, look.world), look.add

    @wp.func
    def add_pulls(t: Any, points: Any, velocities: Any, forces: Any, own: Any, peaks: Any):
        on_a, on_b, on_c, on_d = pull_of_quad(t, points, velocities, own, peaks)
        corners = 4 * own.number
        add(forces, entry_at(t.quads, corners), on_a)
        add(forces, entry_at(t.quads, corners + 1), on_b)
        add(forces, entry_at(t.quads, corners + 2), on_c)
        add(forces, entry_at(t.quads, corners + 3), on_d)

    @wp.func
    def share_out(t: Any, points: Any, forces: Any, own: Any):
        add_pulls(t, points, points, forces, own, points)

    @wp.func
    def share_out_viscous(t: Any, points: Any, velocities: Any, forces: Any, own: Any):
        add_pulls(t, points, velocities, forces, own, points)

    @wp.func
    def wear_out(t: Any, points: Any, forces: Any, own: Any, peaks: Any):
        add_pulls(t, points, points, forces, own, peaks)

    @wp.func
    def wear_out_viscous(t: Any, points: Any, velocities: Any, forces: Any, own: Any, peaks: Any):
        add_pulls(t, points, velocities, forces, own, peaks)

    if traits.softens:
        return wear_out_viscous if traits.viscous else wear_out
    return share_out_viscous if traits.viscous else share_out
