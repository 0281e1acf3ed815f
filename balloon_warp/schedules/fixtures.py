"""From obstacles to the table that kernels read."""

from typing import Any

import numpy as np
import warp as wp

from balloon_warp.kernels.laws.fixture import SHAPES
from balloon_warp.kernels.tables import FixtureTable
from balloon_warp.model import Model

NOWHERE = 1.0e18
"""reach of what has no end [m], whose square is a float32"""


def fixture_table(model: Model) -> Any:
    """The obstacles of a model; Warp's meshes live as long as the model does."""

    def array(values: Any, dtype: Any) -> wp.array:
        return wp.array(np.asarray(values), dtype=dtype, device=model.device)

    shapes = model.obstacles
    table = FixtureTable()
    table.kinds = array([SHAPES.index(shape.kind) for shape in shapes], wp.int32)
    table.sizes = array(np.array([shape.size for shape in shapes]).reshape(-1, 3), wp.vec3)
    table.meshes = array([mesh.id if mesh else 0 for mesh in model.obstacle_meshes], wp.uint64)
    table.closed = array([shape.closed for shape in shapes], wp.int32)
    table.thicknesses = array([shape.thickness for shape in shapes], float)
    table.reaches = array([min(shape.reach, NOWHERE) for shape in shapes], float)
    table.motion = model.obstacle_motion
    table.positions = model.parameters["obstacle_position"]
    table.frictions = model.parameters["obstacle_friction"]
    table.restitutions = model.parameters["obstacle_restitution"]
    return table
