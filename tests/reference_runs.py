"""Runs of the reference, in double precision, whose differences gradients are held to."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from balloon_warp.lab.reference import Reference
from balloon_warp.scene import Scene


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
