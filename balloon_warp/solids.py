"""Balloons as solids: mass and inertia of each, if it were filled with one material."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.measure.worlds import SolidSums, measure_solids, sum_solids
from balloon_warp.launching import launch
from balloon_warp.model import Model
from balloon_warp.shown import Shown, described

LANES = 32
"""Number of threads that sum a balloon; constant, so that a world's sums do not depend on its batch"""


@described
@dataclass(frozen=True)
class MassProperties(Shown):
    """Volume, center of mass and inertia of every balloon, as a solid of density 1 kg/m^3.

    Multiply by a density to get those of a material.

    They are exact for the polyhedron whose faces are fans of triangles about their centers (Kim et al. 2006). For open
    balloons they are meaningless.
    """

    closed: NDArray[np.bool_]
    """Whether the balloon has an inside, shape (balloon_count,)"""
    volume: NDArray[np.float64]
    """Volume [m^3], shape (world_count, balloon_count)"""
    center: NDArray[np.float64]
    """Center of mass [m], shape (world_count, balloon_count, 3)"""
    inertia: NDArray[np.float64]
    """Inertia tensor at unit density about the center of mass, along the axes of the world [m^5], shape (world_count,
    balloon_count, 3, 3)"""


def mass_properties(model: Model, points: wp.array) -> MassProperties:
    """Measure balloons on the device, bit-identically every time.

    Args:
        model: of the balloons.
        points: [m], shape (world_count, particle_count), vec3.
    """
    shape = (model.world_count, model.balloon_count)
    offsets = np.cumsum([0, *(balloon.mesh.face_count for balloon in model.shapes)])

    def zeros(shape: tuple[int, ...], dtype: Any) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=model.device)

    sums = zeros((*shape, LANES), SolidSums)
    measures = [zeros(shape, wp.float64), zeros(shape, wp.vec3d), zeros(shape, wp.mat33d)]
    topology = [wp.array(offsets, dtype=wp.int32, device=model.device), model.face_offsets, model.face_particles]
    launch(sum_solids, sums.shape, inputs=[*topology, points], outputs=[sums], device=model.device)
    launch(measure_solids, shape, inputs=[*topology, points, sums], outputs=measures, device=model.device)
    # copies: on the CPU numpy() alone is a view
    volume, center, inertia = (np.array(array.numpy(), dtype=np.float64) for array in measures)
    return MassProperties(np.array([balloon.closed for balloon in model.shapes]), volume, center, inertia)
