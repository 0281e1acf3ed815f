"""Substep limits of free bodies and spheres: displacements in a step stay small relative to their size."""

from collections.abc import Sequence
from math import ceil

import numpy as np
from numpy.typing import NDArray

from balloon_warp.model.bodies import BodyShape
from balloon_warp.model.parameters import Parameters
from balloon_warp.scene import Scene

TOUCHING_STEP = 1.0 / 480.0
"""Longest step where anything may be touched [s]"""
PART_OF_REACH = 0.25
"""Largest displacement in a substep, over the extent of a body from its center of mass"""
MOST_TURN = 0.1
"""Largest rotation in a substep by the initial spin [rad]"""
SHORTEST_STEP = 1.0e-4
"""Shortest step that speed and spin may require [s]: faster contacts are found by time of impact, without more steps"""


def substeps_of_solids(scene: Scene, bodies: Sequence[BodyShape], parameters: Parameters) -> int:
    """Return the substeps in a frame that free bodies and spheres ask for, in whichever world is the fastest."""
    step = np.inf
    if scene.body or (scene.sphere and scene.solver != "projective"):  # which has a step of its own for spheres
        step = TOUCHING_STEP
    if scene.body:
        reaches = np.array([shape.solid.reach for shape in bodies])
        spins = np.linalg.norm(parameters["initial_body_spins"], axis=2)
        rates = np.maximum(_speeds(scene, parameters) / (PART_OF_REACH * reaches), spins / MOST_TURN)
        step = min(step, max(1.0 / max(float(rates.max()), 1.0e-6), SHORTEST_STEP))
    return max(ceil(1.0 / (scene.frames_per_second * step) - 1.0e-6), 1)


def _speeds(scene: Scene, parameters: Parameters) -> NDArray[np.float64]:
    """Return bounds on the speeds of bodies [m/s], shape (W, body_count).

    They fall to the ground, or down to the lowest of all things, for no longer than the scene lasts.
    """
    up, gravity = np.array(scene.up), np.abs(parameters["gravity"])
    speeds = np.linalg.norm(parameters["initial_body_velocities"], axis=2)
    heights = parameters["initial_body_positions"] @ up
    if scene.ground is not None:
        lowest = parameters["ground_height"]
    else:
        names = ("initial_body_positions", "initial_sphere_positions", "obstacle_position")
        placed = [parameters[name] for name in names] + [np.array([balloon.position for balloon in scene.balloon])]
        lowest = min(float((places @ up).min()) for places in placed if places.size)
    falls = np.maximum(heights - lowest, 0.0)
    seconds = scene.frames / scene.frames_per_second
    return np.minimum(np.sqrt(speeds**2 + 2.0 * gravity * falls), speeds + gravity * seconds)
