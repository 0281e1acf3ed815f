"""Descent to a design: a step counts only if its equilibrium is at rest, and nearer to the target."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.measure import Ruler
from balloon_warp.statics.balance import Balance, toppling_mode

Values = NDArray[np.float64]
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1.0, 1.0e-6, 1.0e4
EASED, STIFFENED = 3.0, 8.0
"""Factors on the damping: division after a step that helped, multiplication after one that did not"""
STRAYS = 1.5
"""Cost over the previous one beyond which an equilibrium is not sought any longer"""
NUDGED = 0.003
"""Largest move along a mode in which an equilibrium is unstable, over the size"""


class Problem(Protocol):
    """Design problem: a target shape and the unknowns."""

    @property
    def topples(self) -> bool:
        """Possibility of unstable equilibria, as of rubber that grows much."""
        ...

    @property
    def ruler(self) -> Ruler:
        """Ruler of the target shape."""
        ...

    def balance(self, design: Values) -> Balance:
        """Return the balloon of a design."""
        ...

    def allowed(self, design: Values) -> bool:
        """Return whether a design can be made."""
        ...

    def next_design(self, balance: Balance, design: Values, points: Values, damping: float) -> tuple[Values, float]:
        """Return a design whose equilibrium should be nearer to the target, and the damping that it took.

        Args:
            balance: Balloon of the last design.
            points: Points at rest [m], shape (n, 3).
            damping: of the step, at least.
        """
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
    refused: bool = False
    """Whether the last step tried did not count"""
    done: bool = False
    """Whether more steps would not help"""
    anew: int = 0
    """Number of times that it has begun anew, with another first design"""

    def save(self, path: Path) -> None:
        """Write the progress to a file for `load`."""
        from balloon_warp.files import whole_file

        with whole_file(path) as temporary:
            np.savez(temporary, **vars(self))

    @classmethod
    def load(cls, path: Path) -> "Reached":
        """Read a file that `save` wrote."""
        with np.load(path, allow_pickle=False) as file:
            numbers = {name: file[name].item() for name in ("cost", "damping", "steps", "refused", "done", "anew")}
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
    goal: float,
    gained: float,
    on_step: Callable[[Reached], None] = lambda _: None,
) -> Reached:
    """Approach the target, step by step.

    Args:
        steps: at most, with those that were tried before.
        goal: cost below which it is near enough.
        gained: least relative gain in cost over two steps for more to be worth it.
    """
    costs = [reached.cost]
    while reached.steps < steps and not reached.done:
        reached = _stepped(problem, reached)
        if reached.cost < costs[-1]:
            costs.append(reached.cost)
        idle = len(costs) > 3 and costs[-1] > (1.0 - gained) * costs[-3]
        over = reached.cost < goal or idle or reached.damping > MOST_DAMPING
        reached = replace(reached, done=over)
        on_step(reached)
    return reached


def _stepped(problem: Problem, reached: Reached) -> Reached:
    """Return the progress after one more step, taken or not."""
    balance = problem.balance(reached.design)
    design, damping = problem.next_design(balance, reached.design, reached.points, reached.damping)
    found = _settled(problem, design, reached)
    if found is None or found[1] >= reached.cost:
        return replace(reached, damping=STIFFENED * damping, steps=reached.steps + 1, refused=True)
    eased = damping if reached.refused else max(damping / EASED, LEAST_DAMPING)  # a refused damping waits a step
    points, cost = found
    steps = reached.steps + 1
    return replace(reached, design=design, points=points, cost=cost, damping=eased, steps=steps, refused=False)


def _settled(problem: Problem, design: Values, reached: Reached) -> tuple[Values, float] | None:
    """Return the equilibrium of a design, from that of the last one, and its cost."""
    most = STRAYS * reached.cost + 1.0e-10

    def strays(points: Values) -> bool:
        return problem.ruler.cost(points) > most

    if not problem.allowed(design):
        return None
    balance = problem.balance(design)
    points = balance.settle(reached.points, strays=strays)
    if points is not None and problem.topples and (mode := toppling_mode(balance, points)) is not None:
        nudge = NUDGED * problem.ruler.size * mode / np.abs(mode).max()
        points = balance.settle(points + nudge, strays=strays)
    return None if points is None else _weighed(problem, points)


def _weighed(problem: Problem, points: Values) -> tuple[Values, float]:
    points = problem.ruler.aligned(points)
    return points, problem.ruler.cost(points)
