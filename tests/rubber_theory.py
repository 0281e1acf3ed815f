"""Rubber and film as textbooks have them, in float64 and by principal stretches: the energies of the reference."""

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp import Material, PolygonMesh
from balloon_warp.lab.reference import laws
from balloon_warp.mesh.topology import signed_volume, total_area

Energy = Callable[[NDArray, NDArray], NDArray]
"""by two principal stretches [J/m^3]"""

MU, RATIO, LIMIT = 4.0e5, 0.1, 97.2
OGDEN = (6.3e5, 1.2e3, -1.0e4), (1.3, 5.0, -2.0)
MATERIALS = {
    "neo_hookean": Material(kind="neo_hookean", shear_modulus=MU),
    "mooney_rivlin": Material(kind="mooney_rivlin", shear_modulus=MU, mooney_ratio=RATIO),
    "ogden": Material(kind="ogden", ogden_moduli=OGDEN[0], ogden_exponents=OGDEN[1]),
    "gent": Material(kind="gent", shear_modulus=MU, gent_limit=LIMIT),
}


NUMBERS = SimpleNamespace(
    shear_modulus=MU, mooney_ratio=RATIO, ogden_moduli=OGDEN[0], ogden_exponents=OGDEN[1], gent_limit=LIMIT,
    most_stretch=1e3, wrinkling=True,
)  # fmt: skip
ENERGIES: dict[str, Any] = {name: partial(energy, p=NUMBERS) for name, energy in laws.MEMBRANES.items()}
"""Of the reference, each an `Energy`"""


def relaxed(energy: Energy, a: NDArray, b: NDArray) -> NDArray:
    """Return the energy with wrinkles: the minimum over larger second stretches, or larger both."""
    return laws.relaxed(lambda a, b, p: energy(a, b), a, b, NUMBERS)


def slope(energy: Energy, stretch: NDArray) -> NDArray:
    """Return the derivative of the energy of equibiaxial stretching by that stretch [Pa], to some 1e-9."""
    h = 1e-3
    both = [energy(stretch + k * h, stretch + k * h) for k in (-2, -1, 1, 2)]
    return (both[0] - 8.0 * both[1] + 8.0 * both[2] - both[3]) / (12.0 * h)


def sphere_pressure(energy: Energy, mesh: PolygonMesh, thickness: float, stretch: NDArray) -> NDArray:
    """Return the pressure of an evenly stretched balloon [Pa], by the mesh's area and volume: A h W' / (3 V l^2)."""
    stretch = np.asarray(stretch, dtype=np.float64)
    return total_area(mesh) * thickness * slope(energy, stretch) / (3.0 * signed_volume(mesh) * stretch**2)


def principal_stretches(rest: NDArray, now: NDArray) -> tuple[NDArray, NDArray]:
    """Return principal stretches of triangles, from two edges at rest and now, shape (T, 2, 3): the larger first."""
    first = rest[:, 0] / np.linalg.norm(rest[:, 0], axis=1, keepdims=True)
    normal = np.cross(rest[:, 0], rest[:, 1])
    second = np.cross(normal, first)
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    frame = np.stack([first, second], axis=1)
    flat = np.einsum("tei,tfi->tfe", rest, frame)
    gradient = np.einsum("tei,tef->tif", now, np.linalg.inv(flat))
    a, b = np.linalg.svd(gradient, compute_uv=False).T
    return a, b


def quad_energy(energy: Energy, rest: NDArray, now: NDArray, faces: NDArray) -> float:
    """Return the energy of a membrane of quads, each its corner triangles by half, or of triangles, over h [J/m]."""
    total = 0.0
    size = faces.shape[1]
    for corner in range(size if size == 4 else 1):
        triangles = faces[:, [corner, (corner + 1) % size, (corner - 1) % size]]
        edges = [points[triangles[:, 1:]] - points[triangles[:, :1]] for points in (rest, now)]
        areas = 0.5 * np.linalg.norm(np.cross(edges[0][:, 0], edges[0][:, 1]), axis=1)
        total += float((areas * energy(*principal_stretches(*edges))).sum()) * (0.5 if size == 4 else 1.0)
    return total
