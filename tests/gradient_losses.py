"""A loss of all that moves, its value in the reference, and differences of that."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

import feature_sets
import numpy as np
from gradient_scenes import CASES

import balloon_warp as bw
from balloon_warp.batch.trajectories import Trajectories
from balloon_warp.lab.reference import Reference
from balloon_warp.lab.statics import Volume
from balloon_warp.model import plan_model
from balloon_warp.scene import Scene, load_scene


class Run(NamedTuple):
    """Places and velocities in all frames, from the start on."""

    points: list[np.ndarray]
    """Of each balloon, shape (frames + 1, n, 3)"""
    velocities: list[np.ndarray]
    sphere_positions: np.ndarray
    """Shape (frames + 1, spheres, 3)"""
    sphere_velocities: np.ndarray
    reference: Reference
    """At its end"""


def run(
    scene: Scene,
    values: Mapping[str, float] | None = None,
    shifts: tuple[Any, Any] = (0.0, 0.0),
    change: Callable[[Reference], None] = lambda reference: None,
) -> Run:
    """Run a scene where some values are others, by their paths.

    Args:
        shifts: Offsets of all particles' places and velocities at the start.
        change: Function that changes the reference before it runs."""
    reference = Reference(scene, values, shifts)
    change(reference)
    frames = [_now(reference)]
    for _ in range(scene.frames):
        reference.frame()
        frames.append(_now(reference))
    x, v, positions, motions = zip(*frames, strict=True)
    balloons = [[np.array(track) for track in zip(*tracks, strict=True)] for tracks in (x, v)]
    return Run(*balloons, np.array(positions), np.array(motions), reference)


def _now(reference: Reference) -> tuple[Any, ...]:
    balls = ([ball[name] for ball in reference.spheres] for name in ("position", "velocity"))
    return reference.points, reference.velocities, *balls


AROUND = ("obstacle.", "string.")
"""Beginnings of paths that the reference takes from a scene alone"""
RNG = np.random.default_rng(3)
WEIGHTS, OF_COURSES = RNG.uniform(0.5, 1.5, (26, 3)), RNG.normal(size=(2, 3, 3))
ULP = 6e-8
"""Rounding of a float32 over its value"""
SIGMAS = 4.0
SPHERE_TRACKS = ("sphere_positions", "sphere_velocities")


def far(moved: Trajectories) -> tuple[np.ndarray, dict[str, Any]]:
    """Return the loss: squares of distances from places at the end and of volumes on the way, and sums of velocities in
    all frames, whose squares would have the rounding of velocities in their derivatives; of balloons and spheres."""
    names = "points", "velocities", "sphere_positions", "sphere_velocities", "volumes"
    loss, found = _far([getattr(moved, name) for name in names])
    return loss, dict(zip(names, found, strict=True))


def _far(tracks: list[Any]) -> tuple[Any, list[Any]]:
    """Return the loss of tracks, shape (..., frames, items, 3), and its derivatives."""
    points, velocities, balls, motions, volumes = tracks
    loss, found, rng = (volumes[..., 1:, :] ** 2).sum(axis=(-2, -1)), [], np.random.default_rng(3)
    for number, track in enumerate((*points, balls, *velocities, motions)):
        weights, target = rng.uniform(0.5, 1.5, (track.shape[-2], 1)), rng.normal(size=track.shape[-2:])
        slopes = np.zeros(track.shape)
        if number <= len(points):
            off = track[..., -1, :, :] - target
            slopes[..., -1, :, :] = 2.0 * weights * off
            loss = loss + (weights * off**2).sum(axis=(-2, -1))
        else:
            slopes[..., 1:, :, :] = 0.05 * target
            loss = loss + (slopes * track).sum(axis=(-3, -2, -1))
        found.append(slopes)
    by_volumes = np.zeros(volumes.shape)
    by_volumes[..., 1:, :] = 2.0 * volumes[..., 1:, :]
    count = len(points)
    return loss, [found[:count], found[count + 1 : -1], found[count], found[-1], by_volumes]


def far_of(moved: Run) -> float:
    """Return the loss of a run of the reference."""
    skins = [Volume(shape.mesh) for shape in moved.reference.plan.shapes]
    volumes = [[skin.of(each) for each in track] for skin, track in zip(skins, moved.points, strict=True)]
    balls, motions = (
        np.reshape(each, (len(each), -1, 3)) for each in (moved.sphere_positions, moved.sphere_velocities)
    )
    loss, _ = _far([moved.points, moved.velocities, balls, motions, np.transpose(volumes)])
    return float(loss)


def far_in_float64(
    of: bw.Scene,
    values: Mapping[str, float] | None = None,
    shifts: tuple[Any, Any] = (0.0, 0.0),
    change: Callable[[Reference], None] = lambda reference: None,
) -> float:
    """Return the loss in the reference, of other values and of a start that is shifted."""
    around = {path: value for path, value in (values or {}).items() if path.startswith(AROUND)}
    others = {path: value for path, value in (values or {}).items() if path not in around}
    of = load_scene(of, around) if around else of
    return far_of(run(of, others, shifts, change))


def value_at(of: bw.Scene, path: str) -> float:
    """Return the value of a scene at a path: of its first balloon where no number says which."""
    if path.startswith("change."):
        number, inner = path.removeprefix("change.").split(".set.")
        return float(of.change[int(number)].set[inner])
    names = path.split(".")
    if names[0] == "balloon" and not names[1].isdecimal():
        names.insert(1, "0")
    value = feature_sets.value_at(of, ".".join(names))
    return float(plan_model(of).parameters[names[-1]][0, 0] if value is None else value)


def ends(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return a loss of the last frame: weighted places, and places and velocities of spheres, with derivatives."""
    tracks = {"points": moved.points[0], **{name: getattr(moved, name) for name in SPHERE_TRACKS}}
    slopes, loss = {name: np.zeros(track.shape) for name, track in tracks.items()}, 0.0
    for (name, track), each in zip(tracks.items(), (WEIGHTS, *OF_COURSES), strict=True):
        weights = each[: track.shape[-2]]
        slopes[name][..., -1, :, :] = weights
        loss = loss + (weights * track[..., -1, :, :]).sum(axis=(-2, -1))
    return loss, {**slopes, "points": [slopes["points"]]}


def ends_along(of: bw.Scene, steps: Mapping[str, float]) -> float:
    """Return half the difference of that loss in the reference between both ends of steps."""
    sides = []
    for side in (1.0, -1.0):
        told = run(of, {path: value_at(of, path) + side * step for path, step in steps.items()})
        courses = (told.points[0], *(getattr(told, name) for name in SPHERE_TRACKS))
        tracks = zip(courses, (WEIGHTS, *OF_COURSES), strict=True)
        sides.append(float(sum((weights[: track.shape[1]] * track[-1]).sum() for track, weights in tracks)))
    return 0.5 * (sides[0] - sides[1])


@cache
def loss_of(name: str) -> float:
    """Return the loss of a case in the reference."""
    return far_in_float64(CASES[name].scene)


@cache
def slope_of(name: str, path: str, rounded: int = 0) -> float:
    """Return the central difference of the loss of a case by a value, in the reference, see `_rounded`."""
    of, reach = CASES[name].scene, CASES[name].reach
    value, shifts = value_at(of, path), _rounded(of, rounded)
    h = reach * (abs(value) or 1.0)
    more, less = (far_in_float64(of, {path: value + sign * h}, shifts) for sign in (1.0, -1.0))
    return (more - less) / (2.0 * h)


def random_shifts(of: bw.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return a random direction of the places and velocities at the start of all particles that are not fixed."""
    rng, shares = np.random.default_rng(11), [shape.mass_share for shape in plan_model(of).shapes]
    moves = np.concatenate(shares)[:, None] > 0.0
    return 0.05 * moves * rng.normal(size=(len(moves), 3)), moves * rng.normal(size=(len(moves), 3))


@cache
def slope_by_start(name: str, rounded: int = 0) -> float:
    """Return the central difference of a case's loss along that direction, in the reference, see `_rounded`."""
    of, h = CASES[name].scene, 1e-6
    ways, aside = random_shifts(of), _rounded(of, rounded)
    starts = [[off + sign * h * way for off, way in zip(aside, ways, strict=True)] for sign in (1.0, -1.0)]
    more, less = (far_in_float64(of, {}, (points, velocities)) for points, velocities in starts)
    return (more - less) / (2.0 * h)


def _rounded(of: bw.Scene, number: int) -> tuple[Any, Any]:
    """Return offsets of places and velocities at the start that are drawn from the rounding of float32; 0: none."""
    if number == 0:
        return 0.0, 0.0
    rng, reference = np.random.default_rng(number), Reference(of)
    tracks = np.concatenate(reference.points), np.concatenate(reference.velocities)
    points, velocities = (ULP * np.abs(track) * rng.uniform(-1.0, 1.0, track.shape) for track in tracks)
    return points, velocities


def rounding(name: str, slope: Callable[..., float], *path: str) -> float:
    """Return how far off a derivative may be in float32: all places and velocities are rounded in each substep, which
    adds up as a random walk, and each does what it does to the slope at the start, by three draws."""
    of = CASES[name].scene
    assert isinstance(of.substeps, int)
    apart = [slope(name, *path, rounded) - slope(name, *path) for rounded in (1, 2, 3)]
    return SIGMAS * float(np.sqrt(np.mean(np.square(apart)) * of.frames * of.substeps))
