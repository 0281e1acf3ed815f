"""Colors and materials of prims: the bound UsdPreviewSurface first, then the display color."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdShade

from balloon_warp.mesh.usd_surfaces import at_corners, bound_surface, constant_of, display_colors

PLAIN_COLOR = (0.55, 0.53, 0.50)
"""Linear RGB of prims without a color"""


@dataclass(frozen=True)
class Finish:
    """Finish of a surface, in UsdPreviewSurface's terms and with its fallback values."""

    roughness: float = 0.5
    opacity: float = 1.0
    clearcoat: float = 0.0
    metallic: float = 0.0

    def as_row(self) -> tuple[float, float, float, float]:
        return self.roughness, self.opacity, self.clearcoat, self.metallic


def read_finish(prim: Usd.Prim) -> Finish:
    """Return the finish of a prim's bound UsdPreviewSurface, or the fallback where it has none."""
    surface = bound_surface(prim)
    if surface is None:
        return Finish()
    values = {name: constant_of(surface, name) for name in ("roughness", "opacity", "clearcoat", "metallic")}
    return Finish(**{name: float(value) for name, value in values.items() if value is not None})


def read_colors(gprim: UsdGeom.Gprim, element_counts: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the linear RGB of each element, shape (len(element_counts), 3).

    Args:
        gprim: a sphere or curves.
        element_counts: points of each curve, over which colors of points are averaged; one for a sphere.
    """
    count = len(element_counts)
    colors, _ = _authored_colors(gprim, bound_surface(gprim.GetPrim()))
    if len(colors) == count:
        return colors
    if len(colors) == element_counts.sum() and count:
        sums = np.add.reduceat(colors, np.cumsum(element_counts) - element_counts)
        return (sums / element_counts[:, None]).astype(np.float32)
    return np.tile(_one_color(colors), (count, 1))


def read_corner_colors(
    mesh: UsdGeom.Mesh,
    surface: UsdShade.Shader | None,
    counts: NDArray[np.int32],
    indices: NDArray[np.int32],
    point_count: int,
) -> NDArray[np.float32]:
    """Return the linear RGB at each corner of a mesh's faces where it has a surface, shape (len(indices), 3)."""
    colors, interpolation = _authored_colors(mesh, surface)
    found = at_corners(colors, interpolation, counts, indices, point_count)
    return np.tile(_one_color(colors), (len(indices), 1)) if found is None else found


def _authored_colors(gprim: UsdGeom.Gprim, surface: UsdShade.Shader | None) -> tuple[NDArray[np.float32], str]:
    """Return the surface's color or else the display colors, shape (n, 3), and how they are laid out."""
    diffuse = constant_of(surface, "diffuseColor") if surface is not None else None
    if diffuse is not None:
        return np.asarray([diffuse], np.float32), UsdGeom.Tokens.constant
    return display_colors(gprim)


def _one_color(colors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the mean of colors, or the plain color where there are none."""
    return (colors.mean(axis=0) if len(colors) else np.array(PLAIN_COLOR)).astype(np.float32)
