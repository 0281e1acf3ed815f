"""Layout of a batch's worlds in the stage: cells of one size, in rows and columns around the origin."""

from collections.abc import Sequence
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.size import box_corners
from balloon_warp.model import ModelPlan
from balloon_warp.model.bodies import initial_centers
from balloon_warp.model.obstacle_motion import obstacle_motion
from balloon_warp.model.starts import start_of
from balloon_warp.model.strings import anchors_of

ROOM = 2.0
"""Side of a cell, as a multiple of the largest world's width at the start"""


def horizontal_axes(up_axis: str) -> tuple[int, int]:
    """Return the axes of a row and of a column of worlds."""
    return (0, 2) if up_axis == "Y" else (0, 1)


def world_bounds(plans: Sequence[ModelPlan]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest corner of the box around every world [m].

    It holds balloons, spheres, free bodies and anchors at the start, anchors at the end, too, and obstacles wherever
    they get.
    """
    clouds = []
    for plan in plans:
        for number, shape in enumerate(plan.shapes):
            clouds += [start_of(plan.scene, plan.parameters, number, box_corners(shape.mesh)).reshape(-1, 3)]
        told = plan.scene, plan.bodies, plan.parameters
        clouds += [anchors_of(*told, frame).reshape(-1, 3) for frame in (0, plan.scene.frames)]
        centers, radii = plan.parameters["initial_sphere_positions"], plan.parameters["sphere_radius"][..., None]
        clouds += [(centers - radii).reshape(-1, 3), (centers + radii).reshape(-1, 3), *_obstacle_bounds(plan)]
        places = initial_centers(plan.scene, plan.bodies, plan.parameters["initial_body_positions"])
        reaches = np.array([shape.solid.reach for shape in plan.bodies]).reshape(-1, 1)
        clouds += [(places - reaches).reshape(-1, 3), (places + reaches).reshape(-1, 3)]
    points = np.concatenate(clouds)
    return points.min(axis=0), points.max(axis=0)


def _obstacle_bounds(plan: ModelPlan) -> list[NDArray[np.float64]]:
    """Return corners around each bounded obstacle, over its motion in all worlds [m], shape (n, 3) each."""
    positions, shifts = plan.parameters["obstacle_position"], obstacle_motion(plan.scene)[:, :, :3]
    reaches = np.array([[shape.reach] for shape in plan.obstacles]).reshape(-1, 1)
    lowest = positions.min(axis=0) + shifts.min(axis=0) - reaches
    highest = positions.max(axis=0) + shifts.max(axis=0) + reaches
    ended = np.isfinite(reaches[:, 0])
    return [lowest[ended], highest[ended]]


def grid_shifts(world_count: int, side: float, up_axis: str) -> NDArray[np.float64]:
    """Return the shift of each world [m]: row by row, the whole grid centered, shape (world_count, 3)."""
    columns = ceil(sqrt(world_count))
    rows = ceil(world_count / columns)
    column, row = np.arange(world_count) % columns, np.arange(world_count) // columns
    across, along = horizontal_axes(up_axis)
    shifts = np.zeros((world_count, 3))
    shifts[:, across] = side * (column - 0.5 * (columns - 1))
    shifts[:, along] = side * (row - 0.5 * (rows - 1))
    return shifts
