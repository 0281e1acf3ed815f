"""Wear of stretched membranes: softening and tearing."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.membranes import wear_of_triangle
from balloon_warp.kernels.params import numbers_reader
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.phases.membranes import run_tears, tear_faces, weigh_faces
from balloon_warp.kernels.tables import Tables


def _may_wear(scene: Any) -> bool:
    """Return whether a balloon is of rubber that softens, or tears."""
    materials = [balloon.material for balloon in scene.balloon]
    return any(each.softening is not None or each.strength is not None for each in materials)


@cache
def wear_of_points(features: Features, at: Any) -> Any:
    """Make the function that finds the factor on the tension of triangles, and their stresses.

    It returns the greatest energy density so far [Pa].
    """
    read_numbers, wear_of_metric = numbers_reader(features.columns), wear_of_triangle(features)

    @wp.func
    def wear(t: Tables, points: Any, world: wp.int32, triangle: wp.int32, peak: float):
        corners = t.membranes.corners[triangle]
        balloon = t.particles.balloon[corners[0]]
        d1 = at(points, corners[1]) - at(points, corners[0])
        d2 = at(points, corners[2]) - at(points, corners[0])
        metric = wp.vec3(wp.dot(d1, d1), wp.dot(d1, d2), wp.dot(d2, d2))
        left, greatest, stress = wear_of_metric(
            t, world, balloon, t.membranes.materials[balloon], metric, t.membranes.corner_rests[triangle], peak,
            read_numbers(t, world, balloon), 0,
        )  # fmt: skip
        t.membranes.wear.left[world, triangle] = left
        if wp.static(features.bursts):
            t.membranes.wear.tears.stresses[world, triangle] = stress
        return greatest

    return wear


@phase("triangle", {"peak": float}, wants=_may_wear, keeps={"peak": 0.0})
def wear(features: Features, look: Look) -> Any:
    """Find the factor on a triangle's tension, and its peak stretch."""
    return wear_of_points(features, look.at)


@phase("triangle", when=lambda features: features.wears)
def look_at_wear(features: Features, look: Look) -> Any:
    """Find the factor on a triangle's tension, without keeping its peak stretch."""
    wear = wear_of_points(features, look.at)

    @wp.func
    def look_at_wear(t: Tables, points: Any, world: wp.int32, triangle: wp.int32, peak: float):
        wear(t, points, world, triangle, peak)

    return look_at_wear


@phase("face", when=lambda features: features.bursts)
def weigh_skin(features: Features, look: Look) -> Any:
    """Find the stress of a face; a torn face has no tension."""
    return weigh_faces


@phase("face", when=lambda features: features.bursts)
def run(features: Features, look: Look) -> Any:
    """Find whether a tear begins at a face, or arrives there."""
    return run_tears


@phase("face", when=lambda features: features.bursts)
def tear(features: Features, look: Look) -> Any:
    """Tear a face that a tear has reached."""
    return tear_faces
