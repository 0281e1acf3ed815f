"""Latex under gravity: its weight and that of the air in it, and the vertices that hold it."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.air import DRY_AIR_MOLAR_MASS, GAS_CONSTANT
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.statics.balance import Loading
from balloon_warp.statics.film import FilmSkin
from balloon_warp.statics.volume import SealedGas, Volume

Values = NDArray[np.float64]
DOWN = np.array([0.0, -1.0, 0.0])
MOST_GRAVITY = 1000.0
"""Largest gravity [m/s^2]"""
SWING_DAMPING = 4.0
"""Damping rate over the rate at which it would swing; with more damping it creeps to rest"""
SLOW_SWING = 2.0e-4
"""Speed that counts as rest over that of a swing by a size"""


@dataclass(frozen=True)
class Hanging:
    """Gravity on a design of latex, and the vertices that hold it."""

    held: NDArray[np.bool_]
    """Mask of the fixed vertices, shape (n,)"""
    down: Values
    """Gravity as a vector [m/s^2]"""
    density: float
    """Density of the rubber [kg/m^3]"""

    def loading(self, film: FilmSkin, of_gas: Values) -> Loading:
        """Return the loads on a film.

        Args:
            of_gas: those of the gas, see `weight_of_air`.
        """
        masses = self.density * film.volumes(len(self.held))
        return Loading(masses[:, None] * self.down + of_gas, self.held)

    def forces_by(self, volumes_by: Any) -> Any:
        """Return the derivatives of the weights by m unknowns, shape (3 n, m), from the volumes', shape (n, m)."""
        return self.density * sparse.kron(volumes_by, self.down[:, None], format="csc")

    def weight_of_air(self, gas: SealedGas, volume: Volume) -> Values:
        """Return the forces of pressed air's own weight, less its buoyancy, in a shape that it fills [N], shape (n, 3).

        It is denser than the air around, so that its pressure grows downward. In the shape that is wanted this is as
        exact as the simulation; in those on the way there nearly so.
        """
        points = volume.mesh.points
        denser = gas.pressure(volume.of(points)) * DRY_AIR_MOLAR_MASS / (GAS_CONSTANT * gas.temperature)
        below = (points - points.mean(axis=0)) @ self.down
        return (denser * below)[:, None] * volume.slopes(points)

    def start(self, mould: PolygonMesh, target: Values) -> PolygonMesh:
        """Return the mould hung up: held vertices at their places in the target, the rest carried along evenly.

        Args:
            target: points of the target shape [m], shape (n, 3).
        """
        ends, count, free = mesh_edges(mould).ends, mould.vertex_count, ~self.held
        both = np.concatenate([ends, ends[:, ::-1]])
        beside = sparse.coo_matrix((np.ones(len(both)), both.T), shape=(count, count)).tocsr()
        spread: Any = (sparse.diags(np.asarray(beside.sum(axis=1)).ravel()) - beside).tocsc()
        moves = np.where(self.held[:, None], target - mould.points, 0.0)
        moves[free] = spsolve(spread[free][:, free], -(spread[free][:, self.held] @ moves[self.held]))
        return replace(mould, points=mould.points + moves)


def swing_rate(gravity: float, size: float) -> float:
    """Return about the angular frequency at which a hanging balloon swings [1/s]."""
    return float(np.sqrt(gravity / size))


def require_gravity(gravity: float, fixed: object, of: str) -> None:
    """Make sure that a design can hang.

    Raises:
        InputError: it cannot.
    """
    if not (isinstance(gravity, int | float) and 0.0 <= gravity <= MOST_GRAVITY):
        raise InputError(f"gravity: must be from 0 to {MOST_GRAVITY:g} m/s^2 (got {gravity})")
    if gravity and of != "latex":
        raise InputError(f"gravity: only latex hangs; expected none for {of} (got {gravity:g})")
    if fixed is not None and not gravity:
        raise InputError("fixed: needs a gravity to hang under, such as gravity = 9.81")
