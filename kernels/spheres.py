"""Spheres of all worlds, wherever a schedule keeps them."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.tables import Tables, WorldState, sphere_radius
from balloon_warp.kernels.warps import put_word, set_quanta, shared_words, total_newtons, word_at
from balloon_warp.kernels.working import Working

VECTOR_BYTES, QUANTA_BYTES = wp.constant(12), wp.constant(24)
"""Bytes of a vector, and of a force in whole numbers"""


@wp.struct
class Spheres:
    """Arrays of the shape (world_count, sphere_count); those that a scene does not need are empty."""

    sphere_positions: wp.array2d[wp.vec3]
    sphere_velocities: wp.array2d[wp.vec3]
    sphere_spins: wp.array2d[wp.vec3]
    sphere_starts: wp.array2d[wp.vec3]
    """Positions before this substep [m]"""
    sphere_forces: wp.array2d[wp.vec3]
    """Forces of the momentum that is exchanged [N]"""
    sphere_quanta: wp.array3d[wp.int64]
    """Forces by the paper's rule, or of phases, since the spheres last moved, see `fixed_point`"""


@wp.func
def spheres_in_state(t: Tables, state: WorldState, working: Working):
    """Return the spheres in the state."""
    spheres = Spheres()
    spheres.sphere_positions = state.sphere_positions
    spheres.sphere_velocities = state.sphere_velocities
    spheres.sphere_spins = state.sphere_spins
    spheres.sphere_starts = working.sphere_starts
    spheres.sphere_forces = state.sphere_forces
    spheres.sphere_quanta = working.sphere_quanta
    return spheres


@wp.func
def sphere_at(t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32):
    """Return center, velocity and radius of a sphere, which may stand in the state."""
    return (
        spheres.sphere_positions[world, sphere],
        spheres.sphere_velocities[world, sphere],
        sphere_radius(t.spheres, world, sphere),
    )


@cache
def shared_spheres(count: int) -> tuple[Any, Any, Any]:
    """Return functions that load a world's spheres into shared memory, store them, and read one sphere there.

    The last returns the center, velocity and radius of a sphere.
    """
    words = shared_words("spheres", count * 22)
    places, motions, radii = (count * words_before for words_before in (6, 9, 21))

    @wp.func
    def vectors(world: wp.int32, row: wp.int32):
        """Return a row of shared vectors, behind all quanta, as if it were that of a world."""
        first = words() + wp.uint64(count * (QUANTA_BYTES + row * VECTOR_BYTES))
        return wp.array(ptr=first - wp.uint64(world * count * VECTOR_BYTES), shape=(world + 1, count), dtype=wp.vec3)

    @wp.func
    def share_spheres(t: Tables, state: WorldState, world: wp.int32, thread: wp.int32, penalties: bool):
        """Return the spheres of a world; a barrier must follow.

        Args:
            penalties: Whether forces are those that have been summed and are still to act.
        """
        spheres = Spheres()
        spheres.sphere_positions = vectors(world, 0)
        spheres.sphere_velocities = vectors(world, 1)
        spheres.sphere_spins = vectors(world, 2)
        spheres.sphere_starts = vectors(world, 3)
        spheres.sphere_forces = vectors(world, 4)
        spheres.sphere_quanta = wp.array(
            ptr=words() - wp.uint64(world * count * QUANTA_BYTES), shape=(world + 1, count, 3), dtype=wp.int64
        )
        for sphere in range(thread, count, wp.block_dim()):
            put_word(words(), radii + sphere, sphere_radius(t.spheres, world, sphere))
            spheres.sphere_positions[world, sphere] = state.sphere_positions[world, sphere]
            spheres.sphere_velocities[world, sphere] = state.sphere_velocities[world, sphere]
            spheres.sphere_spins[world, sphere] = state.sphere_spins[world, sphere]
            spheres.sphere_forces[world, sphere] = state.sphere_forces[world, sphere]
            set_quanta(
                spheres.sphere_quanta, world, sphere, wp.where(penalties, state.sphere_forces[world, sphere], wp.vec3())
            )
        return spheres

    @wp.func
    def put_spheres(state: WorldState, world: wp.int32, thread: wp.int32, spheres: Spheres, penalties: bool):
        """Store the spheres of a world, after a barrier.

        Args:
            penalties: Whether forces are those that have been summed.
        """
        for sphere in range(thread, count, wp.block_dim()):
            state.sphere_positions[world, sphere] = spheres.sphere_positions[world, sphere]
            state.sphere_velocities[world, sphere] = spheres.sphere_velocities[world, sphere]
            state.sphere_spins[world, sphere] = spheres.sphere_spins[world, sphere]
            force = spheres.sphere_forces[world, sphere]
            if penalties:
                force = total_newtons(spheres.sphere_quanta, world, sphere)
            state.sphere_forces[world, sphere] = force

    @wp.func
    def shared_vector(first: wp.int32, sphere: wp.int32):
        """Return a vector of a row that begins with a given word of shared memory."""
        word = first + 3 * sphere
        return wp.vec3(word_at(words(), word), word_at(words(), word + 1), word_at(words(), word + 2))

    @wp.func
    def shared_sphere_at(t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32):
        return shared_vector(places, sphere), shared_vector(motions, sphere), word_at(words(), radii + sphere)

    return share_spheres, put_spheres, shared_sphere_at
