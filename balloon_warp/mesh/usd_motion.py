"""Rigid motion of meshes of a USD stage.

By time samples of their transforms and of those around them, or by samples of their points, skins and blend shapes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom, UsdSkel

from balloon_warp.errors import InputError
from balloon_warp.mesh.usd_open import open_meshes
from balloon_warp.mesh.usd_stage import choose_prims, points_of, world_matrix

MOST_SCALED = 1e-3
"""Largest growth or bending of a rigid thing, over its size"""


@dataclass(frozen=True)
class StageMotion:
    """Meshes of a stage that move as one."""

    path: Path
    stage: Usd.Stage
    """Stage, which a prim does not keep alive"""
    prims: list[Usd.Prim]
    """Prims of the meshes"""
    begin: float
    """Time code at which the stage begins"""
    codes_per_second: float
    seconds: float
    """Duration to the last sample [s]; 0 if nothing moves"""

    def matrices(self, times: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the transforms of the meshes' points at times since the stage's beginning [s], shape (n, 4, 4).

        They take points as they are read to their places then, in the stage's unit and axes, for column vectors.

        Raises:
            InputError: they do not keep their size or shape.
        """
        prim = self.prims[0]
        still = np.linalg.inv(world_matrix(prim))
        codes = [Usd.TimeCode(code) for code in (self.begin + np.asarray(times) * self.codes_per_second).tolist()]
        moved = [still @ np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(code)) for code in codes]
        if samples_of_points(prim):
            local = [_rigid(self.path, prim, code) for code in codes]
            placed = world_matrix(prim)
            moved = [np.linalg.inv(placed) @ own @ placed @ move for own, move in zip(local, moved, strict=True)]
        columns = np.swapaxes(np.array(moved).reshape(-1, 4, 4), 1, 2)
        turned = columns[:, :3, :3]
        if np.abs(turned @ np.swapaxes(turned, 1, 2) - np.eye(3)).max(initial=0.0) > MOST_SCALED:
            raise InputError(f"{self.path}: {prim.GetPath()} changes its size while moving; expected a rigid obstacle")
        return np.asarray(columns, dtype=np.float64)


def read_motions(path: Path, prim: str | Sequence[str] | None) -> list[StageMotion]:
    """Return the meshes that are taken of a stage, grouped by those that move together; those that stay come first.

    Raises:
        InputError: as `read_usd`, or the stage's time does not run.
    """
    stage = open_meshes(path).stage
    rate = stage.GetTimeCodesPerSecond()
    if not 0.0 < rate < np.inf:
        raise InputError(f"{path}: its timeCodesPerSecond is {rate:g}; expected a rate above 0")
    prims = choose_prims(stage, path, prim).prims
    _bake_skins(stage, prims)
    groups: dict[tuple[str, ...], list[Usd.Prim]] = {}
    for each in prims:
        groups.setdefault(tuple(_movers(each)), []).append(each)
    motions = []
    for movers in sorted(groups, key=lambda each: each != ()):
        samples = [time for each in groups[movers][:1] for time in _samples(each)]
        begin, end = min(samples, default=0.0), max(samples, default=0.0)
        if stage.HasAuthoredTimeCodeRange() and stage.GetStartTimeCode() <= end:
            begin, end = stage.GetStartTimeCode(), max(min(end, stage.GetEndTimeCode()), stage.GetStartTimeCode())
        seconds = (end - begin) / rate if movers else 0.0
        motions.append(StageMotion(path, stage, groups[movers], begin, rate, seconds))
    return motions


def samples_of_points(prim: Usd.Prim) -> list[float]:
    """Return the time codes at which a mesh has points, where it has several."""
    times = UsdGeom.Mesh(prim).GetPointsAttr().GetTimeSamples()
    return times if len(times) > 1 else []


def _around(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Return a prim and the prims that it stands in."""
    while prim:
        yield prim
        prim = prim.GetParent()


def _movers(prim: Usd.Prim) -> Iterator[str]:
    """Return the prims by whose samples a mesh moves: of itself and of the prims that it stands in."""
    for each in _around(prim):
        if len(_samples_of_transforms(each)) > 1 or (each == prim and samples_of_points(prim)):
            yield str(each.GetPath())


def _samples(prim: Usd.Prim) -> set[float]:
    return set(samples_of_points(prim)).union(*(_samples_of_transforms(each) for each in _around(prim)))


def _samples_of_transforms(prim: Usd.Prim) -> set[float]:
    operations = UsdGeom.Xformable(prim).GetOrderedXformOps()
    return {time for operation in operations for time in operation.GetTimeSamples()}


def _bake_skins(stage: Usd.Stage, prims: Sequence[Usd.Prim]) -> None:
    """Turn skins and blend shapes into samples of points, in memory, where a mesh has any."""
    if any("SkelBindingAPI" in each.GetAppliedSchemas() for prim in prims for each in _around(prim)):
        with Usd.EditContext(stage, stage.GetSessionLayer()):
            UsdSkel.BakeSkinning(stage.Traverse(), Gf.Interval.GetFullInterval())


def _rigid(path: Path, prim: Usd.Prim, code: Usd.TimeCode) -> NDArray[np.float64]:
    """Return the rigid transform of a mesh's own points to their places at a time (Kabsch 1976).

    Shape (4, 4), for row vectors.

    Raises:
        InputError: they do more than turn and shift.
    """
    before = points_of(UsdGeom.Mesh(prim), str(path))
    after = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(code), dtype=np.float64).reshape(-1, 3)
    size = float(np.ptp(before, axis=0).max())
    if len(after) == len(before):
        centers = before.mean(axis=0), after.mean(axis=0)
        left, _, right = np.linalg.svd((before - centers[0]).T @ (after - centers[1]))
        turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
        if np.abs((before - centers[0]) @ turn + centers[1] - after).max() <= MOST_SCALED * size:
            matrix = np.eye(4)
            matrix[:3, :3], matrix[3, :3] = turn, centers[1] - centers[0] @ turn
            return matrix
    raise InputError(f"{path}: {prim.GetPath()} deforms by its points, skin or blend shapes; expected a rigid obstacle")
