"""Balloons of springs: a rest length for each spring, one constant for each kind."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.designing.measure import Ruler
from balloon_warp.designing.newton import Aim, step_towards
from balloon_warp.mesh import PolygonMesh
from balloon_warp.springs import Springs, build_springs
from balloon_warp.statics.balance import Balance
from balloon_warp.statics.springs import SpringSkin
from balloon_warp.statics.volume import SealedGas, Volume

Values = NDArray[np.float64]
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
