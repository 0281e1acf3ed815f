"""Groups of particles that a scene's outer forces drive, and how they share these forces."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.model.fixed import particles_named
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene


class Driven(NamedTuple):
    """Particles that outer forces drive, force by force."""

    particles: NDArray[np.int64]
    """Numbers of the particles among those of all balloons, shape (n,)"""
    forces: NDArray[np.int64]
    """Index of the force in the scene, shape (n,)"""
    shares: NDArray[np.float64]
    """Share of the particle in the force, by its mass; the shares of a force add up to 1, shape (n,)"""


def driven_particles(scene: Scene, shapes: Sequence[BalloonShape]) -> Driven:
    """Return the particles that a scene's forces drive.

    Raises:
        InputError: a balloon has no such particle or group, or all particles of a force are fixed.
    """
    firsts = np.cumsum([0, *(shape.mesh.vertex_count for shape in shapes)])
    parts = [_driven_by(scene, number, shapes) for number in range(len(scene.force))]
    counts = [len(particles) for particles, _ in parts]
    balloons = [force.balloon for force in scene.force]
    return Driven(
        np.concatenate(
            [np.zeros(0, dtype=np.int64), *(p + firsts[b] for (p, _), b in zip(parts, balloons, strict=True))]
        ),
        np.repeat(np.arange(len(parts)), counts),
        np.concatenate([np.zeros(0), *(shares for _, shares in parts)]),
    )


def _driven_by(
    scene: Scene, number: int, shapes: Sequence[BalloonShape]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the particles of a force, numbered within its balloon, and their shares."""
    force = scene.force[number]
    shape = shapes[force.balloon]
    field = f"force.{number}.particles"
    particles = np.arange(shape.mesh.vertex_count)
    if force.particles is not None:
        named = particles_named(force.particles, shape.mesh, field)
        particles = np.unique([shape.mesh.stand_in(particle) for particle in named]).astype(np.int64)
    particles = particles[shape.mass_share[particles] > 0.0]
    if not len(particles):
        raise InputError(f"{field}: all its particles are fixed in {shape.name}; expected some that move")
    shares = shape.mass_share[particles]
    return particles, shares / shares.sum()
