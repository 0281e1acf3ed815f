"""Design of a latex balloon: from a target shape to its mould, simulated."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.descent import Reached, begin, descend
from balloon_warp.designing.folder import write_stl
from balloon_warp.designing.hanging import DOWN, SWING_DAMPING, Hanging, swing_rate
from balloon_warp.designing.job import Job
from balloon_warp.designing.mould import MouldProblem, ThicknessProblem
from balloon_warp.designing.proof import DAMPING_RATE, MORE_FRAMES, common_fields, filled, scene_of
from balloon_warp.designing.result import Design
from balloon_warp.designing.step import DesignStep
from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.air import DRY_AIR_MOLAR_MASS
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import total_area
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.plan import plan_model
from balloon_warp.scene import Balloon, Inflation, Material, Scene
from balloon_warp.statics.film import FilmSkin
from balloon_warp.statics.of_model import film_of

Values = NDArray[np.float64]
LEAST_STRETCH, MOST_STRETCH = 1.05, 5.0
GOAL, GAINED = 1.0e-10, 0.05
"""Cost from which on it is near enough, and least relative gain in cost over two steps for more to be worth it"""
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
    if not LEAST_STRETCH <= job.stretch <= MOST_STRETCH:
        raise InputError(f"stretch: must be from {LEAST_STRETCH:g} to {MOST_STRETCH:g} for latex (got {job.stretch:g})")
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
    return job.proven(scene, reached.points, plain.points, same.stretch, mould=mould.points, **told)


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
        return descend(problem, reached, job.steps, GOAL, GAINED, lambda step: job.on_step(step, stretch(step)))

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
