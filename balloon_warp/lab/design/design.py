"""The balloon that becomes a given shape."""

import atexit
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
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
)
from balloon_warp.lab.design.latex import design_of_latex
from balloon_warp.lab.design.panels import design_of_panels, panels_of
from balloon_warp.lab.design.springs import OF_KINDS, Hold, Reached, SpringProblem, begin, descend, require_gravity
from balloon_warp.lab.design.target import held_target_of, require_size, target_of
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.load import LOADERS, MeshLike
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Balloon, Scene, Stiffness
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
