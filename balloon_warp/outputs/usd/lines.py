"""Linear curves of one width."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt


def define_lines(stage: Usd.Stage, path: Sdf.Path, point_counts: Sequence[int], width: float) -> UsdGeom.BasisCurves:
    """Return the curves of `point_counts` points each; `width` in meters."""
    curves = UsdGeom.BasisCurves.Define(stage, path)
    curves.CreateTypeAttr(UsdGeom.Tokens.linear)
    curves.CreateCurveVertexCountsAttr(list(point_counts))
    curves.CreateWidthsAttr([width])
    curves.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    return curves


def write_lines(curves: UsdGeom.BasisCurves, points: NDArray[np.float32], time: float) -> None:
    """Write the points of all curves in order, shape (sum of the curves' point counts, 3), and their extent."""
    curves.GetPointsAttr().Set(points, time)
    widths = curves.GetWidthsAttr().Get()
    curves.GetExtentAttr().Set(UsdGeom.Curves.ComputeExtent(Vt.Vec3fArray.FromNumpy(points), widths), time)
