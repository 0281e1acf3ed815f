"""Properties of two runs: the same scene in other schedules, in the reference, turned, scaled, or listed otherwise."""

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from balloon_warp.batch.trajectories import Trajectories
from balloon_warp.benchmarks.physics_energy import EPSILON, forces_rounding
from balloon_warp.benchmarks.physics_runs import NUDGE, Case, Run, farthest
from balloon_warp.benchmarks.physics_twins import Array, relisted, scaled, turned
from balloon_warp.errors import InputError
from balloon_warp.lab.gradients.gradient import gradient
from balloon_warp.lab.reference import Reference
from balloon_warp.scene import Scene

SIGMAS = 4.0
"""Rounding of many substeps over that of one, times their root: several particles round at once, and the nudges that
measured the growth of an error were but two of all directions"""
SCHEDULES = ["gather", "lanes", "block"]
"""Schedules that are compared with the one of `auto`, on a device that has them: `lanes` runs on the CPU"""
FEW_SUBSTEPS = 120
"""Substeps of a whole run up to which it is repeated in the reference, which takes a thousand times as long"""
CHAOTIC = 1.0e-3
"""Spread over the size from which on two runs of a chaotic scene are not compared"""


class Measure(NamedTuple):
    """Outcome of a property: it holds where `found` is at most `allowed`."""

    found: float
    allowed: float
    note: str = ""

    @property
    def holds(self) -> bool:
        return self.found <= self.allowed  # and so not where it is NaN


Property = Callable[[Case], Measure | None]


def is_alike_in_schedules(case: Case) -> Measure | None:
    """Schedules agree, within rounding times the amplification of the scene."""
    worst = None
    for schedule in SCHEDULES:
        if (schedule != "gather" and case.run.model.bursts) or (schedule == "lanes" and case.device != "cpu"):
            continue  # refused
        other = case.in_schedule(schedule)
        worst = worse(worst, compared(case, other, other.points, schedule))
    return worst


def is_alike_turned(case: Case) -> Measure | None:
    """Move alike when turned about the up axis, with Z up instead of Y; corrections go by places, one by one."""
    if case.scene.correction != "none":
        return None
    angle = Rotation.from_euler("y", 0.7).as_matrix()
    matrix = np.roll(np.eye(3), 1, axis=0) @ angle
    return compared(case, *case.as_twin("turned", lambda tables: turned(tables, matrix)))


def is_alike_mirrored(case: Case) -> Measure | None:
    """Move as the image in a mirror; corrections go by places, one by one."""
    if case.scene.correction != "none":
        return None
    return compared(case, *case.as_twin("mirrored", lambda tables: turned(tables, np.diag((-1.0, 1.0, 1.0)))))


def is_alike_moved(case: Case) -> Measure | None:
    """Move alike 100 sizes away, within the rounding of those places."""
    shift = np.array([80.0, 0.0, -60.0]) * case.size
    return compared(case, *case.as_twin("moved", lambda tables: turned(tables, np.eye(3), shift)))


def is_alike_scaled(case: Case) -> Measure | None:
    """Similarity: lengths, masses and times by powers of two leave the motion as it was.

    Times stay where things meet: spheres and bodies take 480 steps a second, and overlaps decay by a tenth in 10 ms.
    """
    steady = case.scene.sphere or case.scene.body or case.scene.touches
    units = (0.25, 8.0, 1.0 if steady else 2.0)
    try:
        twin = case.as_twin("scaled", lambda tables: scaled(tables, *units))
    except ValidationError:  # it has numbers beyond those of legal scenes
        return None
    return compared(case, *twin)


def is_alike_relisted(case: Case) -> Measure | None:
    """Move alike with vertices, faces and balloons in another order."""
    return compared(case, *case.as_twin("relisted", relisted))


def is_as_in_reference(case: Case) -> Measure | None:
    """Move as the reference of the step in NumPy and float64."""
    run = case.run
    if Reference.lacks(case.scene) or run.blow_up or case.substeps * case.scene.frames > FEW_SUBSTEPS:
        return None
    reference = Reference(case.with_substeps(1))
    places = [run.points[0]]
    count = run.model.particle_count
    for points in run.points[1:]:
        with np.errstate(all="ignore"):  # it divides where it then takes another value
            reference.frame()
        places.append(np.concatenate([*reference.points, points[count:]]))
    return compared(case, run, np.array(places), "reference")


def is_alike_among_worlds(case: Case) -> Measure | None:
    """Move alike beside other worlds of a batch, to the bit, as GUARANTEES.md says."""
    if case.run.model.bursts or case.run.blow_up:
        return None
    schedule = "block" if case.device != "cpu" else "lanes"
    alone = case.in_schedule(schedule)
    scene = case.with_substeps(1)
    path, value = stiffness_of(scene)
    beside = case.simulate(scene, case.device, schedule, {path: value * np.array([1.0, 0.5, 0.7])})
    if alone.blow_up or beside.blow_up:
        return None
    return Measure(float(np.abs(beside.points - alone.points).max()), 0.0, "apart beside other worlds [m]")


def converges(case: Case) -> Measure | None:
    """Twice the substeps halve the error: |x(4n) - x(8n)| is at most 0.75 of |x(2n) - x(4n)|, for order 1.

    The next term of the error, of order 2, makes up a half at most where the differences are below a hundredth of the
    size, by experience. Contact, strings and wrinkles happen in one substep or the next, and a flow by the root of a
    pressure has no slope where it turns: these are left out.
    """
    scene = case.scene
    wrinkles = any(balloon.material.is_membrane and balloon.material.wrinkling for balloon in scene.balloon)
    if meets(scene) or wrinkles or scene.string or scene.tube or scene.water or scene.change or case.run.blow_up:
        return None
    if case.substeps * scene.frames > FEW_SUBSTEPS:
        return None
    runs = [case.finer(times) for times in (2, 4, 8)]
    if any(run.blow_up for run in runs):
        return None
    coarse, fine = (farthest(first.points, second.points).max() for first, second in itertools.pairwise(runs))
    if coarse > 0.01 * case.size:
        return None
    return Measure(
        float(fine), float(0.75 * coarse) + rounding(case, runs[2])[-1], "difference by twice the substeps [m]"
    )


def slopes_are_differences(case: Case) -> Measure | None:
    """Gradients equal differences: dL/dp of L = w . x at the end, by the reference's central differences.

    The sum over particles cancels, so the error is a hundredth of |w| |dx/dp|, a part of the sum of its terms: each
    term is known to the rounding that the motion amplifies, which is below a thousandth where the scene is calm. Where
    things meet a loss has jumps, of which the gradient knows nothing: it only has to be finite.
    """
    scene = case.with_substeps(1)
    if case.run.blow_up or case.substeps * scene.frames > FEW_SUBSTEPS or Reference.lacks(scene) or not case.is_calm:
        return None
    path, value = stiffness_of(scene)
    weights = np.random.default_rng(5).normal(size=(case.run.model.particle_count, 3))
    parts = np.split(weights, case.run.model.particle_offsets[1:-1])

    def loss(moved: Trajectories) -> tuple[Array, dict[str, Any]]:
        shown = [np.zeros_like(points) for points in moved.points]
        for slopes, part in zip(shown, parts, strict=True):
            slopes[..., -1, :, :] = part
        total = sum((slopes * points).sum() for slopes, points in zip(shown, moved.points, strict=True))
        return np.array([total]), {"points": shown}

    try:
        found = gradient(scene, of=[path], loss=loss, device=case.device)
    except InputError:
        return None  # refused by name, see GRADIENTS.md
    change = 1.0e-4 * value
    ends = [Reference(scene, {path: value + sign * change}) for sign in (1.0, -1.0)]
    for end in ends:
        with np.errstate(all="ignore"):
            for _ in range(scene.frames):
                end.frame()
    slopes = (ends[0].x - ends[1].x) / (2.0 * change)
    expected = float((weights * slopes).sum())
    size = float(np.linalg.norm(weights) * np.linalg.norm(slopes))
    if meets(scene):
        return Measure(float(not np.isfinite(found.gradients[path]).all()), 0.0, "gradients that are not finite")
    off = abs(float(np.ravel(found.gradients[path])[0]) - expected)
    return Measure(
        off * value, 0.01 * size * value + 1.0e-6 * case.size, "slope and difference apart, times the value [m]"
    )


def compared(case: Case, other: Run, places: Array, name: str = "twin") -> Measure | None:
    """Compare places with those of the scene as it is, within `rounding`, as long as it is not chaotic.

    Contact that begins a substep earlier or later makes a motion jump, which two nudges may not show. So where it is
    beyond rounding, eight more starts are tried, as far apart as all rounding together, and twice their spread.
    """
    if case.run.blow_up or other.blow_up:
        return None
    allowed, found = rounding(case, other), farthest(places, case.run.points)
    measure = _worst(case, found, np.maximum(allowed, case.spread), allowed, name)
    if measure and not measure.holds and meets(case.scene):
        jumps = 2.0 * case.spread_by(float(_roundings(case, other)[-1]) / case.size, 8)
        frames = min(len(allowed), len(jumps))
        allowed = np.maximum(allowed[:frames], jumps[:frames])
        measure = _worst(case, found, allowed, allowed, name)
    return measure


def _worst(case: Case, found: Array, spread: Array, allowed: Array, name: str) -> Measure | None:
    """Measure the worst frame over its bound, among those in which the scene is not chaotic."""
    frames = min(len(found), len(allowed))
    ratio = np.where(spread[:frames] < CHAOTIC * case.size, found[:frames] / allowed[:frames], -1.0)
    worst = int(np.argmax(ratio))
    if ratio[worst] < 0.0:
        return None
    return Measure(float(found[worst]), float(allowed[worst]), f"{name}: apart [m] in frame {worst}")


def rounding(case: Case, other: Run) -> Array:
    """Return the largest deviation of places by rounding, by frame [m], shape (frames + 1,).

    From each substep on its rounding grows as starts that are 1e-6 apart have grown, at most.
    """
    return _roundings(case, other) * np.maximum(case.spread / (NUDGE * case.size), 1.0) + _drifts(case)


def _drifts(case: Case) -> Array:
    """Return how far rounded forces push a freely floating balloon, by frame [m], shape (frames + 1,).

    Where each particle finds the forces on itself, the same is lost in each substep, and a balloon that nothing holds
    goes a t^2 / 2 by it.
    """
    scene, model = case.scene, case.run.model
    held = scene.ground or scene.obstacle or scene.string or scene.water or any(each.fixed for each in scene.balloon)
    masses = model.parameters["mass"].numpy()[0]
    lost = [np.linalg.norm(forces_rounding(model, number)) / mass for number, mass in enumerate(masses)]
    times = model.frame_seconds * np.arange(len(case.spread), dtype=np.float64)
    return 0.5 * (0.0 if held else SIGMAS * float(max(lost))) * times**2


def _roundings(case: Case, other: Run) -> Array:
    """Return the sum of the roundings of places until each frame [m], shape (frames + 1,).

    Each substep rounds each coordinate by half an epsilon of itself, and moves it by the rounding of the forces that
    the faces around it add up to, h^2 F / m, which counts where the step is as long as is stable. After n substeps the
    errors' sum is sqrt(n) of one, by `SIGMAS`; and n where all round the same way, as in steady flight.
    """
    model = case.run.model
    extent = max(float(np.abs(run.points).max()) for run in (case.run, other))
    pushed = 0.0
    for number, (mass, shape) in enumerate(zip(model.parameters["mass"].numpy()[0], model.shapes, strict=True)):
        of_moving = np.divide(forces_rounding(model, number), mass * shape.mass_share, where=shape.mass_share > 0.0,
                              out=np.zeros(len(shape.mass_share)))  # fmt: skip
        pushed = max(pushed, float(of_moving.max()))
    substeps = 1.0 + other.model.substeps * np.arange(len(case.spread))
    one = 0.5 * EPSILON * extent + model.step_seconds**2 * pushed
    return one * (substeps + SIGMAS * np.sqrt(substeps))


def meets(scene: Scene) -> bool:
    """Return whether balloons can meet anything."""
    return bool(scene.sphere or scene.body or scene.obstacle or scene.ground or scene.touches)


def stiffness_of(scene: Scene) -> tuple[str, float]:
    """Return the path of the first balloon's stiffness, and its value."""
    balloon = scene.balloon[0]
    if balloon.material.shear_modulus:
        return "balloon.0.material.shear_modulus", balloon.material.shear_modulus
    return "balloon.0.stiffness.structural", balloon.stiffness.structural


def worse(first: Measure | None, second: Measure | None) -> Measure | None:
    """Return the measure that is larger over its bound."""
    measures = [each for each in (first, second) if each]
    return max(measures, key=lambda each: each.found / max(each.allowed, 1e-300), default=None)
