"""The obstacles of one world of a batch: prims that refer to the prototypes, with places and turns of their own."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf

from balloon_warp.model import ModelPlan
from balloon_warp.model.obstacle_motion import moves, obstacle_poses
from balloon_warp.outputs.usd.obstacle import as_gf

PLACE, TURN = "xformOp:translate", "xformOp:orient"


class GridObstacles:
    """Obstacles of a world.

    Args:
        prims: Prims of the world, each with an order of ops from its prototype.
        motion: Motion, as from `obstacle_motion`.
        positions: Positions in the world, each from a frame on [m], shape (obstacle_count, 3); see `values_over_time`.
    """

    def __init__(
        self,
        prims: Sequence[Sdf.PrimSpec],
        plan: ModelPlan,
        motion: NDArray[np.float64],
        positions: Sequence[tuple[int, NDArray[np.float64]]],
    ):
        self._motion, self._positions = motion, positions
        self._moving: dict[int, tuple[Sdf.Path, Sdf.Path]] = {}
        """Paths of position and rotation of those that move"""
        poses = self.poses(0)
        for number, prim in enumerate(prims):
            place = Sdf.AttributeSpec(prim, PLACE, Sdf.ValueTypeNames.Double3)
            turn = Sdf.AttributeSpec(prim, TURN, Sdf.ValueTypeNames.Quatf)
            if moves(plan.scene, number, (change.values for change in plan.due_changes)):
                self._moving[number] = place.path, turn.path
            else:
                place.default, turn.default = as_gf(poses[number])

    @property
    def paths(self) -> list[Sdf.Path]:
        """Paths with time samples."""
        return [path for paths in self._moving.values() for path in paths]

    def samples(self, frame: int) -> list[Gf.Vec3d | Gf.Quatf]:
        """Return their values at a frame, in the order of `paths`."""
        poses = self.poses(frame)
        return [value for number in self._moving for value in as_gf(poses[number])]

    def poses(self, frame: int) -> NDArray[np.float64]:
        """Return their poses at a frame, as `Frame.obstacle_poses`, shape (obstacle_count, 7)."""
        positions = next(positions for begin, positions in reversed(self._positions) if begin <= frame)
        return obstacle_poses(positions, self._motion, frame)


def values_over_time(plan: ModelPlan, name: str, row: int) -> list[tuple[int, NDArray[np.float64]]]:
    """Return a parameter of a world of a plan, as it is from each frame on at which it is another."""
    rows = plan.parameters[name]
    values = [(0, rows[row % len(rows)])]
    for change in plan.due_changes:
        if name in change.values:
            moved = values[-1][1][None].copy()
            change.apply(name, moved)
            values.append((change.frame + 1, moved[0]))
    return values
