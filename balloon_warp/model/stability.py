"""The largest step at which symplectic Euler stays stable on a spring network."""

from collections.abc import Sequence
from math import ceil, sqrt

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene

AUTO_MARGIN = 0.8
"""the part of the stable step that `substeps = "auto"` takes"""


def stable_step(scene: Scene, shapes: Sequence[BalloonShape], held: Sequence[int]) -> float:
    """A step [s] that is stable for every balloon of the scene.

    An undamped network is stable for h < 2 / omega_max, and by Gershgorin's theorem omega_max^2 is at most twice the
    largest sum of spring constants at a particle over its mass. Damping at the rate g [1/s], taken explicitly as the
    listing does, shrinks the bound to the root of omega^2 h^2 + 2 g h = 4.

    Args:
        held: the particle that each string of the scene holds, numbered within its balloon.
    """
    steps = []
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        by_kind = np.array([balloon.stiffness.structural, balloon.stiffness.shear, balloon.stiffness.flexion])
        constants = by_kind[shape.springs.kind] * shape.stiffness_scale
        sums = np.bincount(shape.springs.pairs[:, 0], constants, shape.mesh.vertex_count)
        sums += np.bincount(shape.springs.pairs[:, 1], constants, shape.mesh.vertex_count)
        for string, particle in zip(scene.string, held, strict=True):
            if string.balloon == number:
                sums[particle] += 0.5 * string.stiffness  # its other end is fixed
        moves = shape.mass_share > 0.0
        masses = balloon.mass * shape.mass_share[moves]
        squared_frequency = float(np.max(2.0 * sums[moves] / masses, initial=1.0e-12))
        rate = balloon.damping / balloon.mass
        steps.append((sqrt(rate * rate + 4.0 * squared_frequency) - rate) / squared_frequency)
    return min(steps)


def choose_substeps(scene: Scene, stable: float) -> int:
    """Substeps in a frame: as the scene says, or as many as the stable step [s] asks.

    Raises:
        InputError: the scene asks for fewer than are stable.
    """
    frame_seconds = 1.0 / scene.frames_per_second
    if scene.substeps == "auto":
        return ceil(frame_seconds / (AUTO_MARGIN * stable))
    if frame_seconds / scene.substeps > stable:
        raise InputError(
            f"substeps: {scene.substeps} are too few for these springs and masses, which are stable up to a step of "
            f'{stable:.2e} s: at least {ceil(frame_seconds / stable)} are needed, or "auto"'
        )
    return scene.substeps
