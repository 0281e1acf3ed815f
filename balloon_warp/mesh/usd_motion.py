"""How the mesh of a USD stage moves as a whole: the time samples of its transforms, and of those around it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from balloon_warp.errors import InputError
from balloon_warp.mesh.usd_stage import choose_prim, open_stage, world_matrix

MOST_SCALED = 1e-3
"""by how much a rigid thing may grow, of its size"""


@dataclass(frozen=True)
class StageMotion:
    """Of a mesh that moves."""

    path: Path
    stage: Usd.Stage
    """which a prim does not keep"""
    prim: Usd.Prim
    begin: float
    """time code at which the stage begins"""
    codes_per_second: float
    seconds: float
    """from there to the last sample"""

    def matrices(self, times: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
        """At times since the stage's beginning [s]: what takes the mesh's points, as they are read, to where they are
        then, in the stage's unit and axes, shape (n, 4, 4), of column vectors.

        Raises:
            InputError: the mesh does not keep its size.
        """
        still, prim = np.linalg.inv(world_matrix(self.prim)), UsdGeom.Xformable(self.prim)
        codes = self.begin + np.asarray(times) * self.codes_per_second
        moved = [still @ np.array(prim.ComputeLocalToWorldTransform(Usd.TimeCode(code))) for code in codes.tolist()]
        columns = np.swapaxes(np.array(moved).reshape(-1, 4, 4), 1, 2)
        turned = columns[:, :3, :3]
        if np.abs(turned @ np.swapaxes(turned, 1, 2) - np.eye(3)).max(initial=0.0) > MOST_SCALED:
            raise InputError(
                f"{self.path}: {self.prim.GetPath()} changes its size as it moves; expected an obstacle that is rigid"
            )
        return np.asarray(columns, dtype=np.float64)


def read_motion(path: Path) -> StageMotion | None:
    """The motion of a stage's first mesh; None where it stays.

    Raises:
        InputError: as `read_usd`.
    """
    stage = open_stage(path)
    prim, _ = choose_prim(stage, path, None)
    samples: set[float] = set()
    ancestor = prim
    while ancestor:
        for operation in UsdGeom.Xformable(ancestor).GetOrderedXformOps():
            samples.update(operation.GetTimeSamples())
        ancestor = ancestor.GetParent()
    if len(samples) < 2:
        return None
    begin = stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else min(samples)
    rate = stage.GetTimeCodesPerSecond()
    return StageMotion(path, stage, prim, begin, rate, max((max(samples) - begin) / rate, 0.0))
