"""Stage at one point in time, seen with Y up."""

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom

Z_TO_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Rotation of row vectors with Z up into ones with Y up"""


class Moment:
    """Moment of a stage: places of prims at a time code, Y up, in the stage's unit."""

    def __init__(self, stage: Usd.Stage, time: float):
        self.time = Usd.TimeCode(time)
        self._xforms = UsdGeom.XformCache(self.time)
        self._turn = Z_TO_Y_UP if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z else np.eye(3)

    def place(self, prim: Usd.Prim, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return a prim's points in the world, shape (n, 3)."""
        matrix = self._matrix(prim)
        return (points.astype(np.float64) @ matrix[:3, :3] + matrix[3, :3]) @ self._turn

    def scale(self, prim: Usd.Prim) -> float:
        """Return the factor on lengths from the prim to the world: the cube root of the change in volume."""
        return float(np.cbrt(abs(np.linalg.det(self._matrix(prim)[:3, :3]))))

    def is_frame(self, matrix: Gf.Matrix4d) -> bool:
        """Return whether a matrix is finite and its x, y and z axes span space."""
        rows = np.array(matrix)
        lengths = np.linalg.norm(rows[:3, :3], axis=1)
        if not (np.isfinite(rows).all() and lengths.all()):
            return False
        return bool(abs(np.linalg.det(rows[:3, :3] / lengths[:, None])) > 1e-6)

    def axes(self, matrix: Gf.Matrix4d) -> NDArray[np.float64]:
        """Return the unit vectors along the x, y and z axes of a frame, a row each, shape (3, 3)."""
        rows = np.array(matrix)[:3, :3]
        return rows / np.linalg.norm(rows, axis=1, keepdims=True) @ self._turn

    def origin(self, matrix: Gf.Matrix4d) -> NDArray[np.float64]:
        """Return the position of a frame's origin, shape (3,)."""
        return np.array(matrix)[3, :3] @ self._turn

    def _matrix(self, prim: Usd.Prim) -> NDArray[np.float64]:
        return np.array(self._xforms.GetLocalToWorldTransform(prim))
