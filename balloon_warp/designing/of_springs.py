"""Design of a balloon of springs: from a target shape to rest lengths, simulated."""

from dataclasses import replace
from pathlib import Path

from balloon_warp.designing.descent import Reached, begin, descend
from balloon_warp.designing.folder import write_springs
from balloon_warp.designing.job import Job
from balloon_warp.designing.proof import DAMPING_RATE, MORE_FRAMES, common_fields, filled, scene_of
from balloon_warp.designing.result import Design
from balloon_warp.designing.springs import OF_KINDS, SpringProblem
from balloon_warp.designing.step import DesignStep
from balloon_warp.errors import InputError
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Balloon, Scene, Stiffness

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
    return job.proven(scene, reached.points, plain.points, problem.mean_stretch(reached.design), help_)


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
