"""Stiffness of a balloon's skin at rest, for programs that model it as a sheet."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws import Law
from balloon_warp.model.materials import STEP, numbers_of, slopes_by_stretches
from balloon_warp.model.shape import BalloonShape
from balloon_warp.springs import SpringKind

INCOMPRESSIBLE = 0.5
"""Poisson's ratio of rubber and film here"""


class SheetStiffness(NamedTuple):
    """Stiffness of a sheet."""

    stretch: float
    """Uniaxial stiffness at constant width [N/m]: E h / (1 - nu^2)"""
    shear: float
    """Shear stiffness [N/m]: G h"""
    bend: float
    """Bending stiffness of a plate [N m]: E h^3 / (12 (1 - nu^2))"""


def youngs_modulus(law: Law, parameters: Mapping[str, NDArray[Any]], number: int) -> float:
    """Return Young's modulus of a balloon's rubber or film in the first world, at rest [Pa].

    At a small equibiaxial strain, an incompressible material has a stress of E / (1 - 1/2) times the strain.
    """
    told = numbers_of(parameters, number)
    up, down = (slopes_by_stretches(law, told, *2 * (np.array([1.0 + step]),))[0] for step in (STEP, -STEP))
    return (1.0 - INCOMPRESSIBLE) * float((up - down).flat[0]) / (2.0 * STEP)


def sheet_of_springs(shape: BalloonShape, parameters: Mapping[str, NDArray[Any]], number: int) -> SheetStiffness | None:
    """Return the sheet that a balloon's springs make in the first world, or None where they have no surface.

    All of it is taken to follow the mean strain (Cauchy and Born). Springs then have an energy of 1/2 k (L e)^2 each, e
    the strain along them. Where they lie alike in all directions, S the sum of k L^2 over the area, the stiffness is
    3/8 S one way and 1/8 S in shear, and Poisson's ratio of the sheet a third (Ostoja-Starzewski 2002, Lattice models
    in micromechanics). In any arrangement the equibiaxial stiffness is their sum S/2, which a balloon swells against.
    Hinges make a plate the same way, with the width L of the two faces that a hinge bends by L for each unit of
    curvature. Springs across thin parts are left out.
    """
    if not shape.area > 0.0:
        return None
    constants = np.array([parameters[kind.name.lower()][0, number] for kind in SpringKind])
    of_each = constants[shape.springs.kind] * shape.stiffness_scale
    if shape.across is not None:
        of_each = np.where(shape.across, 0.0, of_each)
    pulled = float(of_each @ shape.springs.rest_lengths**2) / shape.area
    bent = float(parameters["torsion"][0, number]) * float((_hinge_widths(shape) ** 2).sum()) / shape.area
    return SheetStiffness(stretch=0.375 * pulled, shear=0.125 * pulled, bend=0.375 * bent)


def _hinge_widths(shape: BalloonShape) -> NDArray[np.float64]:
    """Return half of how far its wings are from each edge, together [m]; shape (hinge_count,)."""
    edge, *wings = shape.hinges.arms(shape.mesh.points)
    lengths = np.maximum(np.linalg.norm(edge, axis=1), np.finfo(float).tiny)
    first, second = (np.linalg.norm(np.cross(edge, wing), axis=1) for wing in wings)
    return 0.5 * (first + second) / lengths
