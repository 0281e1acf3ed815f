"""Design of the springs of a balloon under gravity: a rest length for each, one constant for each kind."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.air import DRY_AIR_MOLAR_MASS, GAS_CONSTANT
from balloon_warp.lab.design.descent import Aim, step_towards
from balloon_warp.lab.design.measure import Ruler
from balloon_warp.lab.statics import Balance, FilmSkin, Loading, SealedGas, SpringSkin, Volume
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.springs import Springs, build_springs

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


Hold = Literal["tension", "any"]
PRESSURE = 200.0
"""Pressure that the plain springs would bear in the target shape [Pa]"""
OF_KINDS = np.array([1.0, 0.5, 0.25])
"""Ratios of the constants of structural, shear and flexion springs"""
LEAST, MOST = 0.3, 1.3
"""Range of rest lengths over the lengths in the target shape: springs that may push are no longer"""
FURTHEST = 0.15
"""Largest relative change of a rest length in a step"""
STUCK, MOST_SOLVED = 0.01, 4
"""Part of a change below which a rest length is stuck at a bound; and how often a step is solved without those"""


@dataclass(frozen=True)
class SpringProblem:
    """The rest lengths of a mesh's springs."""

    ruler: Ruler
    stretch: float
    """Stretch of the plain springs that it begins with"""
    hold: Hold
    """Forces that springs may bear: tension alone, or also compression"""

    @property
    def topples(self) -> bool:
        """Possibility of unstable equilibria: springs stiffen as they stretch, so it is not tested."""
        return False

    @property
    def mesh(self) -> PolygonMesh:
        """The wanted shape."""
        return self.ruler.mesh

    @cached_property
    def springs(self) -> Springs:
        """Springs of the mesh."""
        return build_springs(self.mesh)

    @cached_property
    def volume(self) -> Volume:
        """Volume of the mesh."""
        return Volume(self.mesh)

    @cached_property
    def gas(self) -> SealedGas:
        """Gas that fills the target shape."""
        return SealedGas.of(PRESSURE, self.volume.of(self.mesh.points))

    @property
    def plain(self) -> Values:
        """The rest lengths of plain springs: all stretched alike in the wanted shape."""
        return self.springs.rest_lengths / self.stretch

    @cached_property
    def constants(self) -> Values:
        """Constant of each spring [N/m]: plain ones bear the pressure as well as they can."""
        of_kinds = OF_KINDS[self.springs.kind]
        forces = SpringSkin(self._pairs, self.plain, of_kinds).forces(self.mesh.points)
        slopes = self.volume.slopes(self.mesh.points)
        return of_kinds * (-PRESSURE * (slopes * slopes).sum() / (forces * slopes).sum())

    def balance(self, design: Values) -> Balance:
        """Return the balloon of springs of these rest lengths."""
        return Balance(SpringSkin(self._pairs, design, self.constants), self.volume, self.gas)

    def allowed(self, design: Values) -> bool:
        """Return True: springs of any length can be made."""
        return True

    def next_design(self, balance: Balance, design: Values, points: Values, damping: float) -> tuple[Values, float]:
        """Return the rest lengths after a step, and its damping; those at their bounds stay there."""
        by_design = balance.skin.forces_by_lengths(points)
        stuck, changed = np.zeros(len(design), dtype=bool), design
        for _ in range(MOST_SOLVED):
            easily = sparse.diags(np.where(stuck, 0.0, design))  # each changes in proportion to itself
            aim = Aim(self.mesh.points - points, self.ruler.squares, easily, damping)
            change = step_towards(balance, points, by_design, aim)
            changed = self._within(design, change)
            held = (np.abs(changed - design) < STUCK * np.abs(change)) & ~stuck
            if not held.any():
                break
            stuck |= held
        return changed, damping

    def _within(self, design: Values, change: Values) -> Values:
        """Return the rest lengths with a change, within their bounds."""
        most = (1.0 if self.hold == "tension" else MOST) * self.springs.rest_lengths
        low = np.maximum(LEAST * self.springs.rest_lengths, (1.0 - FURTHEST) * design)
        return np.clip(design + change, low, np.minimum(most, (1.0 + FURTHEST) * design))

    def mean_stretch(self, design: Values) -> float:
        """Return the mean stretch of all springs, weighted by their constants."""
        return float((self.constants * self.springs.rest_lengths).sum() / (self.constants * design).sum())

    @cached_property
    def _pairs(self) -> NDArray[np.int64]:
        return self.springs.pairs.astype(np.int64)
