"""Design of the springs of a balloon under gravity, and the step towards a shape, through the balance.

At rest the forces vanish for every design: K dx = B dq, where K is the stiffness of skin and gas, and B the derivative
of the forces by the design. So no gradient through time is needed: one sparse system gives the step of the design that
brings the balance nearest to the wanted shape, and changes the design least (Levenberg and Marquardt):

    least |W (e - dx)|^2 + damping |y|^2   with   K dx = B dq,  dq = S y

A step counts only if its equilibrium is at rest, and nearer to the target.

A smooth step is Gauss and Newton's, too, by conjugate gradients:

    least |W (e - K^-1 B S y)|^2 + damping |y|^2 + |P (gap - least)|^2 where gaps would be too narrow

S smooths, so that changes of single vertices cost more than those of whole regions. Each product takes two solutions
with the factorized stiffness K, and the more damping, the fewer products are needed.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, cg, splu, spsolve

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.air import DRY_AIR_MOLAR_MASS, GAS_CONSTANT
from balloon_warp.lab.design.measure import Ruler
from balloon_warp.lab.design.target import Gaps
from balloon_warp.lab.statics import (
    Balance,
    FilmSkin,
    Loading,
    SealedGas,
    Solve,
    SpringSkin,
    Stiffness,
    Volume,
    shifted,
    solver_of,
    toppling_mode,
)
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.springs import Springs, build_springs

Values = NDArray[np.float64]
HOLD = 1.0e-7
"""Regularization against rigid motion, over the mean stiffness"""


@dataclass(frozen=True)
class Aim:
    """Aim of a step."""

    error: Values
    """Vectors from the particles to where they should be [m], shape (n, 3)"""
    weights: Any
    """W'W, shape (3 n, 3 n)"""
    easily: Any
    """S: directions in which the design changes easily, as columns, scaled by how much, shape (m, k)"""
    damping: float
    """Damping, in a unit in which 1 is much"""


def step_towards(balance: Balance, points: Values, by_design: sparse.csc_matrix, aim: Aim) -> Values:
    """Return the change of the design, shape (m,).

    Args:
        points: at rest, shape (n, 3).
        by_design: B, the derivatives of the forces by the design, shape (3 n, m).
    """
    stiff, slopes, squeeze = balance.stiffness(points)
    if balance.loading:
        by_design = sparse.csc_matrix(sparse.diags(balance.loading.free) @ by_design)
    count, unit = len(slopes), float(np.abs(stiff.diagonal()).mean())
    stiff = (stiff + HOLD * unit * sparse.identity(count)) / unit
    gives = by_design @ aim.easily / unit  # B S
    reached = gives @ gives.T
    share = aim.damping * float(reached.diagonal().mean())
    reached = reached / share + HOLD**2 * sparse.identity(count)
    matrix = sparse.bmat([[aim.weights, stiff], [stiff, -reached]], format="csc")
    wanted = np.concatenate([aim.weights @ aim.error.ravel(), np.zeros(count)])
    solved = _with_gas(solver_of(matrix), wanted, slopes, squeeze / unit)
    return aim.easily @ (gives.T @ solved[count:]) / share


def _with_gas(solve: Callable[[Values], Values], wanted: Values, slopes: Values, squeeze: float) -> Values:
    """Solve where the gas adds s (a b' + b a') to the matrix, for it adds s g g' to K (Woodbury)."""
    none = np.zeros_like(slopes)
    columns = np.stack([np.append(slopes, none), np.append(none, slopes)], axis=1)
    plain, through = solve(wanted), solve(columns)
    rows = squeeze * columns[:, ::-1].T
    return plain - through @ np.linalg.solve(np.eye(2) + rows @ through, rows @ plain)


@dataclass(frozen=True)
class Response:
    """Linear response dx = K^-1 B dq: the stiffness is factorized once, for any number of changes."""

    by_design: Any
    """B, over the mean stiffness, shape (3 n, m)"""
    solve: Solve
    """Solver of systems with K, over the mean stiffness"""

    @classmethod
    def of(cls, balance: Balance, points: Values, by_design: sparse.csc_matrix) -> "Response":
        """Factorize the stiffness of a balloon at rest.

        Args:
            points: at rest [m], shape (n, 3).
            by_design: B, the derivatives of the forces by the design, shape (3 n, m).
        """
        stiff, slopes, squeeze = balance.stiffness(points)
        if balance.loading:
            by_design = sparse.csc_matrix(sparse.diags(balance.loading.free) @ by_design)
        unit = float(np.abs(stiff.diagonal()).mean())
        return cls(by_design / unit, Stiffness(shifted(stiff / unit, HOLD), slopes, squeeze / unit).solver())

    def moves(self, change: Values) -> Values:
        """Return how the particles move where the design changes, shape (3 n,)."""
        return self.solve(self.by_design @ change)

    def transposed(self, moves: Values) -> Values:
        """Return the transposed operator's product with moves, shape (m,)."""
        return np.asarray(self.by_design.T @ self.solve(moves))


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
        from balloon_warp.system.files import whole_file

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


REACH, ALONE = 3.0, 0.05
"""Distance over which changes are smooth, in edges, and the unsmoothed fraction"""
EXACT, MOST_PRODUCTS = 0.01, 80
"""Relative residual of the normal equations, and the most products with their matrix"""
POWERS = 3
"""Number of products by which their largest eigenvalue is found, roughly"""
MOST_SOLVED, MISSED = 4, 0.9
"""Number of times that a step is solved with ever more gaps, and the part of the least width below which they count"""


class Smoothing:
    """Smoothing of values at the vertices of a mesh, (1 + r^2 L)^-1 plus a part that is not smooth."""

    def __init__(self, ends: NDArray[Any], count: int):
        ones = np.ones(len(ends))
        beside = sparse.coo_matrix((ones, (ends[:, 0], ends[:, 1])), shape=(count, count))
        beside = beside + beside.T
        valences = np.asarray(beside.sum(axis=1)).ravel()
        laplacian = (sparse.diags(valences) - beside) / valences.mean()
        self._solve = splu((sparse.identity(count) + REACH**2 * laplacian).tocsc()).solve
        self._count = count

    def __call__(self, values: Values) -> Values:
        """Smooth vectors of all vertices, which may be followed by a number of each, shape (3 n,) or (4 n,)."""
        moves, more = values[: 3 * self._count].reshape(-1, 3), values[3 * self._count :].reshape(self._count, -1)
        together = np.hstack([moves, more])
        smooth = self._solve(together) + ALONE * together
        return np.concatenate([smooth[:, :3].ravel(), smooth[:, 3:].ravel()])


@dataclass(frozen=True)
class SmoothAim:
    """Aim of a smooth step."""

    error: Values
    """Vectors from the particles to where they should be [m], shape (n, 3)"""
    weights: Any
    """W'W, shape (3 n, 3 n)"""
    smoothing: Smoothing
    scales: Values
    """Magnitudes of easy changes of each number of the design, shape (m,)"""
    gaps: Gaps
    damping: float
    """Damping, in a unit in which 1 is much"""


def smooth_step(response: Response, aim: SmoothAim) -> Values:
    """Return the change of the design, shape (m,)."""
    step = _Step(response, aim, aim.gaps.widths < aim.gaps.least)
    for _ in range(MOST_SOLVED):
        step = step.solved()
        more = step.missed() & ~step.active
        if not more.any():
            break
        step = replace(step, active=step.active | more)
    return step.change


@dataclass(frozen=True)
class _Step:
    """Normal equations of a step, and their solution with some of the gaps."""

    response: Response
    aim: SmoothAim
    active: NDArray[np.bool_]
    """Mask of the gaps that are kept open, shape (k,)"""
    unit: float = 0.0
    """Largest eigenvalue without damping, roughly"""
    found: Values | None = None

    @property
    def change(self) -> Values:
        """Change of the design, shape (m,)."""
        assert self.found is not None
        return self._easily(self.found)

    def missed(self) -> NDArray[np.bool_]:
        """Return the gaps that would be too narrow, shape (k,)."""
        gaps, moved = self.aim.gaps, self.change[: self.aim.error.size]
        return np.asarray(gaps.widths + gaps.widening @ moved < MISSED * gaps.least)

    def solved(self) -> "_Step":
        """Return the step with its solution."""
        aim, gaps = self.aim, self.aim.gaps
        wanted = self._back(self.response.transposed(aim.weights @ aim.error.ravel()))
        unit = self.unit or self._largest(wanted)
        wanted = wanted + self._of_gaps(gaps.least - gaps.widths)

        def times(vector: Values) -> Values:
            damped = self._squared(vector) + aim.damping * unit * vector
            return damped + self._of_gaps(gaps.widening @ self._easily(vector)[: aim.error.size])

        size = len(wanted)
        matrix = LinearOperator((size, size), matvec=times, dtype=np.float64)  # pyright: ignore
        found, _ = cg(matrix, wanted, x0=self.found, rtol=EXACT, maxiter=MOST_PRODUCTS)
        return replace(self, unit=unit, found=found)

    def _largest(self, vector: Values) -> float:
        """Return the largest eigenvalue of the equations without damping and gaps, roughly."""
        largest = 0.0
        for _ in range(POWERS):
            vector = vector / max(float(np.linalg.norm(vector)), 1.0e-300)
            product = self._squared(vector)
            largest, vector = float(np.linalg.norm(product)), product
        return max(largest, 1.0e-300)

    def _squared(self, vector: Values) -> Values:
        moves = self.response.moves(self._easily(vector))
        return self._back(self.response.transposed(self.aim.weights @ moves))

    def _of_gaps(self, widths: Values) -> Values:
        """Return the transposed derivatives of the gaps that are kept open, weighted, times widths, shape (m,)."""
        gaps = self.aim.gaps
        moves = gaps.widening.T @ (gaps.weights * self.active * widths)
        return self._back(np.append(moves, np.zeros(len(self.aim.scales) - len(moves))))

    def _easily(self, vector: Values) -> Values:
        """Return S y."""
        return self.aim.scales * self.aim.smoothing(vector)

    def _back(self, vector: Values) -> Values:
        """Return S' v."""
        return self.aim.smoothing(self.aim.scales * vector)


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
STUCK, MOST_BALANCED = 0.01, 4
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
        for _ in range(MOST_BALANCED):
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
