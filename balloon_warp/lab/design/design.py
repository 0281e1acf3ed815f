"""The balloon that becomes a given shape: of springs, by their rest lengths; of latex, by its mould; or of panels."""

import atexit
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import isfinite
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.air import DRY_AIR_MOLAR_MASS
from balloon_warp.lab.design.job import (
    DAMPING_RATE,
    MORE_FRAMES,
    Design,
    DesignStep,
    Equilibrium,
    Job,
    common_fields,
    filled,
    own_folder,
    scene_of,
    write_springs,
    write_stl,
)
from balloon_warp.lab.design.measure import Ruler
from balloon_warp.lab.design.panels import design_of_panels, panels_of
from balloon_warp.lab.design.springs import (
    DOWN,
    OF_KINDS,
    SWING_DAMPING,
    Hanging,
    Hold,
    Reached,
    Response,
    SmoothAim,
    Smoothing,
    SpringProblem,
    begin,
    descend,
    require_gravity,
    smooth_step,
    swing_rate,
)
from balloon_warp.lab.design.target import Flattening, Gaps, held_target_of, require_size, target_of
from balloon_warp.lab.statics import Balance, FilmSkin, SealedGas, Volume, film_of
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.crossings import find_crossings, means_over_neighbors, uncrossed
from balloon_warp.mesh.load import LOADERS, MeshLike
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.topology import mesh_edges, total_area
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.plan import plan_model
from balloon_warp.scene import Balloon, Inflation, Material, Scene, Stiffness
from balloon_warp.system.api import checked

MASS_OVER_SIZE = 0.05
"""Mass over size [kg/m]"""
GOAL = 1.0e-10
"""Cost from which on it is near enough: an error of a hundred-thousandth"""
GAINED = 0.25
"""Least relative gain in cost over two steps for more to be worth it: an eighth of the error"""
LEAST_STRETCH, MOST_STRETCH = 1.02, 2.0


def design_of_springs(job: Job) -> Design:
    """Design the rest length of each spring.

    Raises:
        InputError: the stretch cannot be, or plain springs find no rest.
    """
    if not LEAST_STRETCH <= job.stretch <= MOST_STRETCH:
        raise InputError(
            f"stretch: must be from {LEAST_STRETCH:g} to {MOST_STRETCH:g} for springs, which run away beyond "
            f"(got {job.stretch:g})"
        )
    problem = SpringProblem(job.ruler, job.stretch, job.hold)
    job.say("inflating plain springs")
    plain = begin(problem, problem.plain)
    if plain is None:
        raise InputError(f"stretch: plain springs have no equilibrium at {job.stretch:g}; expected less")

    def on_step(reached: Reached) -> None:
        job.on_step(reached, problem.mean_stretch(reached.design))

    job.watch(DesignStep(job.ruler, 0, plain.points, job.stretch))
    reached = descend(problem, job.saved(Reached.load) or plain, job.steps, GOAL, GAINED, on_step)
    scene = write_design(problem, reached, job.folder)
    same = replace(problem, stretch=max(problem.mean_stretch(reached.design), LEAST_STRETCH))
    plain = begin(same, same.plain) or plain
    help_ = "; --hold any, which allows compression, may reduce the error" if job.hold == "tension" else ""
    equilibrium = Equilibrium(reached.points, plain.points, problem.mean_stretch(reached.design))
    return job.proven(scene, equilibrium, help_)


def write_design(problem: SpringProblem, reached: Reached, folder: Path, frames: int = 240) -> Scene:
    """Write the balloon as it begins, as small as it is stretched, and its springs; return its scene."""
    mesh, size = problem.mesh, problem.ruler.size
    start = replace(mesh, points=mesh.points / problem.mean_stretch(reached.design))
    write_obj(folder / "balloon.obj", start)
    write_springs(folder / "springs.npz", problem.springs.pairs, reached.design, problem.constants)
    kinds = (problem.constants / OF_KINDS[problem.springs.kind]).mean() * OF_KINDS
    mass = MASS_OVER_SIZE * size
    inflation = filled(problem.gas, problem.volume.of(start.points))
    balloon = Balloon(
        **common_fields(folder / "balloon.obj", inflation),
        springs=folder / "springs.npz",
        mass=mass,
        damping=DAMPING_RATE * mass,
        stiffness=Stiffness(**dict(zip(("structural", "shear", "flexion"), map(float, kinds), strict=True))),
    )
    return scene_of(balloon, f"A balloon of springs that becomes {mesh.name}", frames + MORE_FRAMES)


Of = Literal["springs", "latex", "foil"]
SIZE, THICKNESS, STRETCH, STEPS = 0.3, 2.0e-4, 1.2, 30


@checked
def design(
    target: str | Path | MeshLike,
    *,
    of: Of = "springs",
    stretch: float | None = None,
    hold: Hold = "tension",
    size: float | None = None,
    thickness: float | tuple[float, float] = THICKNESS,
    panels: int | str | Path | None = None,
    gravity: float = 0.0,
    fixed: Sequence[int | str] | None = None,
    folder: str | Path | None = None,
    steps: int = STEPS,
    resume: bool = False,
    device: str | None = None,
    on_stage: Callable[[str], None] = lambda stage: None,
    on_step: Callable[[DesignStep], None] = lambda step: None,
) -> Design:
    """Find the balloon that becomes a shape when it is inflated, and simulate it from rest.

    Args:
        target: Target shape: a mesh file, or a mesh; closed, of one part, not crossing itself. For foil, letters or the
            path of a drawing, .svg: the outline of the inflated balloon; or, with `panels`, a mesh.
        of: Material: springs, with a rest length for each; latex, whose mould is found; or foil.
        stretch: Stretch of the skin in the target shape, not of foil; 1.2 for springs, 2 for latex, if not given.
        hold: Forces of springs: "tension" alone, or "any".
        size: Largest extent of the target shape [m]; its own if not given, and 0.3 for letters and drawings.
        thickness: of latex and foil [m]; of latex also the least and the greatest, between which it varies by place
            where the mould alone does not reach the shape.
        panels: of foil, of which the shape is sewn: so many gores around its vertical axis; or it is cut between
            "materials" or "groups" of its mesh, or along the lines of vertices in a file.
        gravity: of latex, under which it becomes the shape [m/s^2]: it hangs from `fixed`, or stands on it, Y up.
        fixed: vertices of the target, counted from 0, and groups of it, that hold it against gravity where they are;
            its group "neck" when missing.
        folder: where it is written: balloon.toml, which runs as it is, and its files, error.png and report.json. A
            temporary one when missing, which goes when Python ends.
        steps: Largest number of steps.
        resume: go on where the same design in that folder was stopped; of letters and drawings it begins anew.
        device: a Warp device for the simulation; if missing, the GPU or else the CPU.
        on_stage: Called with a few words at each stage.
        on_step: Called with the balloon after each step, and as simulated in the end; not for outlines of foil.

    Raises:
        InputError: the shape cannot be designed, a number cannot be, or the designed balloon finds no rest.
    """
    for name, given, known in (("of", of, get_args(Of)), ("hold", hold, get_args(Hold))):
        if given not in known:
            raise InputError(f"{name}: must be {' or '.join(known)} (got {given!r})")
    if of == "foil" and stretch is not None:
        raise InputError(f"stretch: foil hardly stretches; expected none for foil (got {stretch:g})")
    if of != "springs" and hold != "tension":
        raise InputError(f"hold: is of springs; expected none for {of} (got {hold})")
    stretch = stretch if stretch is not None else {"springs": STRETCH, "latex": 2.0, "foil": 1.0}[of]
    least, thickest = thickness if isinstance(thickness, tuple) else (thickness, thickness)
    _require_numbers(of, {"stretch": stretch, "thickness": least}, thickest, steps)
    require_gravity(gravity, fixed, of)
    if of != "foil" and panels is not None:
        raise InputError(f"panels: need foil; expected none for {of} (got {panels})")
    with ExitStack() as end:
        opened = partial(_opened, folder, [each for each in (target, panels) if isinstance(each, str | Path)], end)

        def job(mesh: PolygonMesh, options: Mapping[str, Any], held: NDArray[np.bool_] | None = None) -> Job:
            of_job = mesh, of, float(stretch), hold, float(least), opened()
            return Job(*of_job, steps, device, resume, on_stage, on_step, options, held)

        if of == "foil" and panels is None:
            return _of_foil(target, size, least, opened, steps, device, on_stage)
        if panels is not None:
            cut = panels_of(target, panels, size)
            return design_of_panels(job(cut.mesh, {"panels": str(panels)}), cut)
        options: dict[str, Any] = {"thickest": thickest} if thickest > least else {}
        if gravity:
            mesh, held = held_target_of(target, size, fixed)
            options |= {"gravity": float(gravity), "fixed": np.flatnonzero(held).tolist()}
            return design_of_latex(job(mesh, options, held))
        mesh = target_of(target, size)
        return {"springs": design_of_springs, "latex": design_of_latex}[of](job(mesh, options))


def _opened(folder: str | Path | None, inputs: Sequence[str | Path], end: ExitStack) -> Path:
    """Return the folder, or a temporary one, which is this design's until the end."""
    place = Path(folder) if folder is not None else _temporary()
    end.enter_context(own_folder(place, dict.fromkeys(map(Path, inputs), "an input of the design")))
    return place


def _require_numbers(of: Of, numbers: Mapping[str, float], thickest: float, steps: int) -> None:
    """Make sure that a design can be tried.

    Raises:
        InputError: a number cannot be.
    """
    for name, number in (*numbers.items(), ("thickness", thickest)):
        if not (isinstance(number, int | float) and isfinite(number) and number > 0.0):
            raise InputError(f"{name}: must be a number greater than 0 (got {number})")
    least = numbers["thickness"]
    if thickest < least:
        raise InputError(f"thickness: the range must go from low to high (got {least:g} to {thickest:g})")
    if thickest > least and of != "latex":
        raise InputError(f"thickness: only latex varies by place; expected one number for {of}")
    if not isinstance(steps, int) or steps < 0:
        raise InputError(f"steps: must be a whole number, at least 0 (got {steps})")


def _of_foil(
    target: object, size: float | None, thickness: float, opened: Callable[[], Path], steps: int, device: str | None,
    on_stage: Callable[[str], None],
) -> Design:  # fmt: skip
    """Design a foil balloon from letters or a drawing.

    Raises:
        InputError: the target is neither, or cannot be made.
    """
    from balloon_warp.lab.design.foil import design_of_foil

    if not isinstance(target, str | Path) or Path(target).suffix.lower() in LOADERS:
        got = target if isinstance(target, str | Path) else type(target).__name__
        raise InputError(f"target: foil without panels needs letters or a drawing, .svg (got {got})")
    require_size(size)
    return design_of_foil(str(target), SIZE if size is None else size, thickness, opened(), steps, device, on_stage)


def _temporary() -> Path:
    folder = tempfile.mkdtemp(prefix="balloon_design_")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


Values = NDArray[np.float64]
STRAINS, NEARLY_ALL = 0.25, 99.5
"""Largest change of an edge in a step, over its length, and of how many of the edges it is [%]"""
SHORTENED = 0.5
"""Part of a step that must be left where it is made smaller: else more damping gives a smoother one"""
RAISED, RAISED_MUCH, MUCH = 4.0, 16.0, 0.2
"""Factors on the damping where less of a step is left, and the part of it below which the second counts"""
MOST_DAMPED = 5
"""Largest number of times that a step is made smoother"""
THICKENS = 0.25
"""Largest relative change of a thickness in a step"""
STUCK, MOST_SOLVED = 0.01, 3
"""Part of a change below which a thickness is stuck at a bound; and how often a step is solved without those"""


@dataclass(frozen=True)
class MouldProblem:
    """The places of a mould's vertices."""

    ruler: Ruler
    film: FilmSkin
    """Film with a mould that is the scaled-down target shape"""
    stretch: float
    hanging: Hanging | None = None
    """Gravity, and the vertices that hold the balloon against it"""

    @property
    def topples(self) -> bool:
        """Possibility of unstable equilibria: beyond the largest pressure one part swells at the expense of others."""
        return True

    @property
    def mesh(self) -> PolygonMesh:
        """The wanted shape."""
        return self.ruler.mesh

    @property
    def plain(self) -> Values:
        """The wanted shape made smaller, shape (3 n,)."""
        return (self.mesh.points / self.stretch).ravel()

    @cached_property
    def volume(self) -> Volume:
        """Volume of the mesh."""
        return Volume(self.mesh)

    @cached_property
    def gas(self) -> SealedGas:
        """Gas that fills the target shape, at the pressure that best balances the plain mould."""
        points, slopes = self.mesh.points, self.volume.slopes(self.mesh.points)
        forces = self.film.with_mould(self.plain.reshape(-1, 3)).forces(points)
        pressure = -(forces * slopes).sum() / (slopes * slopes).sum()
        return SealedGas.of(pressure, self.volume.of(points))

    def balance(self, design: Values) -> Balance:
        """Return the balloon of that mould."""
        return self.balance_of(self.film.with_mould(design.reshape(-1, 3)))

    def balance_of(self, film: FilmSkin) -> Balance:
        """Return the balloon of a film."""
        loading = self.hanging.loading(film, self._of_gas) if self.hanging else None
        return Balance(film, self.volume, self.gas, loading)

    def by_design(self, balance: Balance, points: Values) -> sparse.csc_matrix:
        """Return the derivatives of its forces by the mould."""
        forces = balance.skin.forces_by_mould(points)
        if self.hanging:
            forces += self.hanging.forces_by(balance.skin.volumes_by_mould(len(points)))
        return forces

    def allowed(self, design: Values) -> bool:
        """Return whether the mould does not cross itself."""
        return not len(find_crossings(design.reshape(-1, 3), self.ruler.triangles).edges)

    def next_design(self, balance: Balance, design: Values, points: Values, damping: float) -> tuple[Values, float]:
        """Return the mould after a step, and its damping, which is raised until the step is smooth."""
        scales = np.full(len(design), self.edge)
        change, damping = self.smooth_change(balance, points, design, scales, damping)
        return self.moved(design, change), damping

    def smooth_change(
        self, balance: Balance, points: Values, design: Values, scales: Values, damping: float,
        by_design: Callable[[Balance, Values], sparse.csc_matrix] | None = None,
    ) -> tuple[Values, float]:  # fmt: skip
        """Return the change of a design that begins with the mould, and its damping.

        Args:
            scales: Magnitudes of easy changes, shape (m,).
            by_design: Function that returns the derivatives of the forces; by the mould if missing.
        """
        response = Response.of(balance, points, (by_design or self.by_design)(balance, points))
        mould = self._mould(design)
        gaps = Gaps.of(mould, self._mould(self.plain), self.film.corners, self.edge)
        aim = SmoothAim(self.mesh.points - points, self.ruler.squares, self._smoothing, scales, gaps, damping)
        change, part = np.zeros(len(design)), 1.0
        for _ in range(MOST_DAMPED):
            change = smooth_step(response, aim)
            part = self._bearable(mould, change)
            if part > SHORTENED:
                break
            aim = replace(aim, damping=aim.damping * (RAISED if part > MUCH else RAISED_MUCH))
        return part * change, aim.damping

    def moved(self, design: Values, change: Values) -> Values:
        """Return the mould with a change, less of it where the mould would cross itself, or its triangles be flat."""
        mould = self._mould(design)
        spoiled = Flattening(mould, self._mould(self.plain), self.film.corners).vertices
        moves = uncrossed(mould.points, self.ruler.triangles, change.reshape(-1, 3), self._means, spoiled)
        return design + moves.ravel()

    def _bearable(self, mould: PolygonMesh, change: Values) -> float:
        """Return the part of a change that strains the mould's edges no more than it may."""
        first, second = mesh_edges(self.mesh).ends.T
        moves, points = change[: mould.points.size].reshape(-1, 3), mould.points
        strains = np.linalg.norm(moves[second] - moves[first], axis=1)
        strains /= np.linalg.norm(points[second] - points[first], axis=1)
        return float(min(1.0, STRAINS / max(np.percentile(strains, NEARLY_ALL), 1.0e-30)))

    def _mould(self, design: Values) -> PolygonMesh:
        return replace(self.mesh, points=design[: self.mesh.points.size].reshape(-1, 3))

    @cached_property
    def _smoothing(self) -> Smoothing:
        return Smoothing(mesh_edges(self.mesh).ends, self.mesh.vertex_count)

    @cached_property
    def _means(self) -> Any:
        """Means over a vertex and its neighbors, shape (n, n)."""
        return means_over_neighbors(self.mesh)

    @cached_property
    def _of_gas(self) -> Values:
        """Return the loads of the gas's weight [N], shape (n, 3)."""
        assert self.hanging is not None
        return self.hanging.weight_of_air(self.gas, self.volume)

    @cached_property
    def edge(self) -> float:
        """Mean edge of the plain mould [m]."""
        ends, points = mesh_edges(self.mesh).ends, self.mesh.points / self.stretch
        return float(np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1).mean())


@dataclass(frozen=True)
class ThicknessProblem:
    """The places of a mould's vertices, and how thick the rubber is there."""

    mould: MouldProblem
    thickest: float
    """Largest thickness over that of the film, which is the least"""

    @property
    def topples(self) -> bool:
        """Possibility of unstable equilibria."""
        return self.mould.topples

    @property
    def ruler(self) -> Ruler:
        """Return the ruler of the wanted shape."""
        return self.mould.ruler

    def split(self, design: Values) -> tuple[Values, Values]:
        """Split a design into the mould, shape (3 n,), and the thickness at its vertices over the least, shape (n,)."""
        count = 3 * self.mould.mesh.vertex_count
        return design[:count], design[count:]

    def balance(self, design: Values) -> Balance:
        """Return the balance of the balloon of that mould and thickness."""
        mould, weights = self.split(design)
        return self.mould.balance_of(self.mould.film.with_mould(mould.reshape(-1, 3)).with_weights(weights))

    def by_design(self, balance: Balance, points: Values) -> sparse.csc_matrix:
        """Return the derivatives of its forces by both."""
        even = replace(balance.skin, skins=self.mould.film.skins)
        by_weights = even.forces_by_weights(points)
        if self.mould.hanging:
            by_weights += self.mould.hanging.forces_by(even.volumes_by_weights(len(points)))
        return sparse.csc_matrix(sparse.hstack([self.mould.by_design(balance, points), by_weights]))

    def allowed(self, design: Values) -> bool:
        """Return whether the mould does not cross itself."""
        return self.mould.allowed(self.split(design)[0])

    def next_design(self, balance: Balance, design: Values, points: Values, damping: float) -> tuple[Values, float]:
        """Return mould and thickness after a step, and its damping; thickness stays where it is at its bounds."""
        mould, weights = self.split(design)
        stuck, moves, changed = np.zeros(len(weights), dtype=bool), np.zeros(len(mould)), weights
        for _ in range(MOST_SOLVED):
            scales = np.append(np.full(len(mould), self.mould.edge), np.where(stuck, 0.0, THICKENS * weights))
            change, damping = self.mould.smooth_change(balance, points, design, scales, damping, self.by_design)
            moves, thicker = self.split(change)
            changed = self._within(weights, thicker)
            held = (np.abs(changed - weights) < STUCK * np.abs(thicker)) & ~stuck
            if not held.any():
                break
            stuck |= held
        return np.concatenate([self.mould.moved(mould, moves), changed]), damping

    def _within(self, weights: Values, change: Values) -> Values:
        """Return the thickness with a change, within its bounds."""
        low, high = np.maximum(1.0, (1.0 - THICKENS) * weights), np.minimum(self.thickest, (1.0 + THICKENS) * weights)
        return np.clip(weights + change, low, high)


LEAST_MOULD, MOST_MOULD = 1.05, 5.0
GAINED_MOULD = 0.05
"""Least relative gain in cost over two steps for more to be worth it"""
STALLED, UNMOVED = 2.5e-5, 0.9
"""Cost above which a design that stalls is begun anew, and the stretch that it then still has over that of its start"""
EASIER, MOST_ANEW = 0.8, 4
"""Strain of the next start over that of the last, and the most starts anew"""
DENSITY = 940.0
"""Density of latex [kg/m^3]"""


def design_of_latex(job: Job) -> Design:
    """Design the mould.

    Raises:
        InputError: the stretch cannot be, or a plain mould finds no rest.
    """
    if not LEAST_MOULD <= job.stretch <= MOST_MOULD:
        raise InputError(f"stretch: must be from {LEAST_MOULD:g} to {MOST_MOULD:g} for latex (got {job.stretch:g})")
    material = Material(preset="latex", thickness=job.thickness)
    hanging = Hanging(job.held, job.gravity * DOWN, DENSITY) if job.held is not None else None
    problem = MouldProblem(job.ruler, _film(job, material), job.stretch, hanging)
    job.say("inflating a plain mould")
    plain = begin(problem, problem.plain)
    if plain is None:
        raise InputError(f"stretch: a plain mould has no equilibrium at {job.stretch:g}; expected less")
    job.watch(DesignStep(job.ruler, 0, plain.points, job.stretch))
    thick = ThicknessProblem(problem, job.thickest)
    reached = _descended(job, thick, job.saved(Reached.load) or plain)
    places, weights = thick.split(reached.design)
    mould = replace(problem.mesh, points=places.reshape(-1, 3))
    scene = _written(job, problem, mould, weights)
    same = replace(problem, stretch=_mean_stretch(problem, places))
    plain = begin(same, same.plain) or plain
    told: dict[str, Any] = {"thickness_to": job.thickness * float(weights.max())} if len(weights) else {}
    return job.proven(scene, Equilibrium(reached.points, plain.points, same.stretch), mould=mould.points, **told)


def _written(job: Job, problem: MouldProblem, mould: PolygonMesh, weights: Values) -> Scene:
    """Write the mould, and the balloon as it begins, at rest; return its scene."""
    material: dict[str, Any] = {"preset": "latex", "thickness": job.thickness}
    if len(weights):
        material["weights"] = [float(f"{weight:.4g}") for weight in weights]
    of_balloon: dict[str, Any] = {}
    start, inflation = mould, filled(problem.gas, problem.volume.of(mould.points))
    write_stl(job.folder / "mould.stl", mould, job.ruler.triangles)
    if problem.hanging:
        start = problem.hanging.start(mould, problem.mesh.points)
        inflation = filled(problem.gas, problem.volume.of(start.points), DRY_AIR_MOLAR_MASS)
        write_obj(job.folder / "mould.obj", mould)
        material["rest_mesh"] = job.folder / "mould.obj"
        of_balloon["fixed"] = np.flatnonzero(problem.hanging.held).tolist()
    write_obj(job.folder / "balloon.obj", start)
    rate = SWING_DAMPING * swing_rate(job.gravity, job.ruler.size) if problem.hanging else 5.0 * DAMPING_RATE
    mass = DENSITY * job.thickness * total_area(mould)
    balloon = Balloon(
        **common_fields(job.folder / "balloon.obj", inflation), **of_balloon,
        material=Material(**material), damping=float(f"{rate * mass:.4g}"),
    )  # fmt: skip
    told = f"A latex balloon that becomes {problem.mesh.name}"
    return scene_of(balloon, told, 240 + MORE_FRAMES, job.gravity)


def _mean_stretch(problem: MouldProblem, mould: Values) -> float:
    """Return the mean stretch of the target shape over a mould."""
    small = replace(problem.mesh, points=mould.reshape(-1, 3))
    return float(np.sqrt(total_area(problem.mesh) / total_area(small)))


def _descended(job: Job, thick: ThicknessProblem, reached: Reached) -> Reached:
    """Design the mould, and the thickness where it may vary.

    Where a design stalls at the stretch of its start, one half swells more than the other. It then begins anew with a
    larger mould around the same gas, which is stiffer.
    """
    mould, varies = thick.mould, thick.thickest > 1.0
    problem = thick if varies else mould
    even = np.ones(mould.mesh.vertex_count if varies else 0)

    def stretch(reached: Reached) -> float:
        return _mean_stretch(mould, thick.split(reached.design)[0])

    def descended(reached: Reached) -> Reached:
        return descend(problem, reached, job.steps, GOAL, GAINED_MOULD, lambda step: job.on_step(step, stretch(step)))

    best = reached = descended(reached if reached.steps else replace(reached, design=np.append(mould.plain, even)))
    while best.cost > STALLED and reached.steps < job.steps and reached.anew < MOST_ANEW:
        easier = _eased(mould.stretch, reached.anew + 1)
        if stretch(reached) < UNMOVED * _eased(mould.stretch, reached.anew):
            break
        job.say(f"beginning anew with a larger mould, at a stretch of {easier:.3g}")
        first = begin(problem, np.append(mould.mesh.points.ravel() / easier, even))
        if first is None:
            break
        reached = descended(replace(first, steps=reached.steps, anew=reached.anew + 1))
        best = min(best, reached, key=lambda each: each.cost)
    return replace(best, steps=reached.steps)


def _eased(stretch: float, times: int) -> float:
    """Return the stretch with which a design begins after so many starts anew."""
    return 1.0 + EASIER**times * (stretch - 1.0)


def _film(job: Job, material: Material) -> FilmSkin:
    """Return the wanted shape as a film that is at rest."""
    fields = common_fields(job.target, Inflation(pressure=0.0))
    scene = scene_of(Balloon(**fields, material=material), "", 1)
    plan = plan_model(scene)
    parameters: Parameters = plan.parameters
    return film_of(scene, 0, plan.shapes[0], parameters)
