"""Descent to a design: a step counts only if its equilibrium is at rest, and nearer to the target."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.designing.measure import Ruler
from balloon_warp.designing.newton import Aim, step_towards
from balloon_warp.statics.balance import Balance

Values = NDArray[np.float64]
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1.0, 1.0e-6, 1.0e4
EASED, STIFFENED = 3.0, 8.0
"""Factors on the damping: division after a step that helped, multiplication after one that did not"""
STRAYS = 1.5
"""Cost over the previous one beyond which an equilibrium is not sought any longer"""
GAINED = 0.03
"""Least relative gain in cost over two steps for more to be worth it: of animals it is a hundredth of the error"""
ALONG = 0.1
"""Weight of tangential errors over normal ones: only the shape matters"""


class Problem(Protocol):
    """Design problem: a target shape and the unknowns."""

    @property
    def ruler(self) -> Ruler:
        """Ruler of the target shape."""
        ...

    def balance(self, design: Values) -> Balance:
        """Return the balloon of a design."""
        ...

    def by_design(self, balance: Balance, points: Values) -> sparse.csc_matrix:
        """Return the derivatives of its forces by the design, shape (3 n, m)."""
        ...

    def easily(self, design: Values, stuck: NDArray[np.bool_]) -> sparse.spmatrix:
        """Return the easy directions of change, with their magnitudes and couplings, shape (m, k).

        Unknowns that are stuck do not change.
        """
        ...

    def allowed(self, design: Values) -> bool:
        """Return whether a design can be made."""
        ...

    def changed(self, design: Values, change: Values) -> Values:
        """Return the design with a change, as far as it may be changed."""
        ...


@dataclass(frozen=True)
class Reached:
    """Progress of a design."""

    design: Values
    points: Values
    """Points at rest [m], shape (n, 3)"""
    cost: float
    """Weighted mean squared error over the squared size"""
    damping: float = FIRST_DAMPING
    steps: int = 0
    """Number of steps tried so far"""
    done: bool = False
    """Whether more steps would not help"""

    def save(self, path: Path) -> None:
        """Write the progress to a file for `load`."""
        from balloon_warp.files import whole_file

        with whole_file(path) as temporary:
            np.savez(temporary, **vars(self))

    @classmethod
    def load(cls, path: Path) -> "Reached":
        """Read what `save` wrote."""
        with np.load(path, allow_pickle=False) as file:
            numbers = {name: file[name].item() for name in ("cost", "damping", "steps", "done")}
            return cls(design=file["design"], points=file["points"], **numbers)


def begin(problem: Problem, design: Values) -> Reached | None:
    """Return the balance of a first design; None where it finds none."""
    balance = problem.balance(design)
    points = balance.settle(problem.ruler.mesh.points)
    return None if points is None else Reached(design, *_weighed(problem, points))


def descend(
    problem: Problem,
    reached: Reached,
    steps: int,
    goal: float = 0.0,
    on_step: Callable[[Reached], None] = lambda _: None,
) -> Reached:
    """Approach the target, step by step.

    Args:
        steps: at most, with those that were tried before.
        goal: cost below which it is near enough.
    """
    costs = [reached.cost]
    while reached.steps < steps and not reached.done:
        reached = _stepped(problem, reached)
        if reached.cost < costs[-1]:
            costs.append(reached.cost)
        idle = len(costs) > 3 and costs[-1] > (1.0 - GAINED) * costs[-3]
        over = reached.cost < goal or idle or reached.damping > MOST_DAMPING
        reached = replace(reached, done=over)
        on_step(reached)
    return reached


def _stepped(problem: Problem, reached: Reached) -> Reached:
    """Return the progress after one more step, taken or not."""
    balance, ruler = problem.balance(reached.design), problem.ruler
    by_design = problem.by_design(balance, reached.points)
    error, weights = ruler.mesh.points - reached.points, weights_of(ruler)
    stuck = np.zeros(len(reached.design), dtype=bool)
    design = reached.design
    for _ in range(4):
        easily = problem.easily(reached.design, stuck)
        change = step_towards(balance, reached.points, by_design, Aim(error, weights, easily, reached.damping))
        design = problem.changed(reached.design, change)
        got = design - reached.design
        held = (np.abs(got) < 0.01 * np.abs(change)) & ~stuck
        if not held.any():
            break
        stuck |= held
    found = _settled(problem, design, reached)
    if found is None or found[1] >= reached.cost:
        return replace(reached, damping=STIFFENED * reached.damping, steps=reached.steps + 1)
    eased = max(reached.damping / EASED, LEAST_DAMPING)
    return Reached(design, *found, damping=eased, steps=reached.steps + 1)


def _settled(problem: Problem, design: Values, reached: Reached) -> tuple[Values, float] | None:
    """Return the equilibrium of a design, from that of the last one, and its cost."""
    most = STRAYS * reached.cost + 1.0e-10

    def strays(points: Values) -> bool:
        return _cost(problem.ruler, points) > most

    if not problem.allowed(design):
        return None
    points = problem.balance(design).settle(reached.points, strays=strays)
    return None if points is None else _weighed(problem, points)


def _weighed(problem: Problem, points: Values) -> tuple[Values, float]:
    points = problem.ruler.aligned(points)
    return points, _cost(problem.ruler, points)


def _cost(ruler: Ruler, points: Values) -> float:
    error = ruler.mesh.points - points
    normal = (error * ruler.normals).sum(axis=1) ** 2
    squared = (1.0 - ALONG) * normal + ALONG * (error**2).sum(axis=1)
    return float((ruler.weights * squared).mean()) / ruler.size**2


def weights_of(ruler: Ruler) -> Any:
    """Return the weights of errors by area, with less for tangential ones, shape (3 n, 3 n)."""
    normals = ruler.normals
    blocks = (1.0 - ALONG) * normals[:, :, None] * normals[:, None, :] + ALONG * np.eye(3)
    blocks *= np.maximum(ruler.weights, 0.05)[:, None, None]
    count = len(normals)
    return sparse.bsr_matrix((blocks, np.arange(count), np.arange(count + 1))).tocsc()
