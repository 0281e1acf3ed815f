"""Wear of stretched membranes: softening and tearing."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.wear import wear_function
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.phases.holes import opening_function
from balloon_warp.kernels.phases.tears import run_tears, tear_faces, weigh_faces
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


def _may_wear(scene: Any) -> bool:
    """Return whether a balloon is of rubber that softens, or tears."""
    materials = [balloon.material for balloon in scene.balloon]
    return any(each.softening is not None or each.strength is not None for each in materials)


@cache
def wear_of_points(traits: Traits, at: Any) -> Any:
    """Make the function that finds what is left of the tension of triangles, and their stresses.

    It returns the greatest energy density so far [Pa].
    """
    read_numbers, wear_of_triangle = numbers_reader(traits.columns), wear_function(traits, at)

    @wp.func
    def wear(t: Tables, points: Any, world: wp.int32, triangle: wp.int32, peak: float):
        n = read_numbers(t, world, t.particles.balloon[t.membranes.corners[triangle][0]])
        left, greatest, stress = wear_of_triangle(t, world, triangle, points, peak, n)
        t.membranes.wear.left[world, triangle] = left
        if wp.static(traits.bursts):
            t.membranes.wear.tears.stresses[world, triangle] = stress
        return greatest

    return wear


@phase("triangle", {"peak": float}, wants=_may_wear, keeps={"peak": 0.0})
def wear(traits: Traits, look: Look) -> Any:
    """Find the factor on a triangle's tension, and its peak stretch."""
    return wear_of_points(traits, look.at)


@phase("triangle", when=lambda traits: traits.wears)
def look_at_wear(traits: Traits, look: Look) -> Any:
    """Find the factor on a triangle's tension, without keeping its peak stretch."""
    wear = wear_of_points(traits, look.at)

    @wp.func
    def look_at_wear(t: Tables, points: Any, world: wp.int32, triangle: wp.int32, peak: float):
        wear(t, points, world, triangle, peak)

    return look_at_wear


@phase("face", when=lambda traits: traits.bursts)
def weigh_skin(traits: Traits, look: Look) -> Any:
    """Find the stress of a face; a torn face has no tension."""
    return weigh_faces


@phase("face", when=lambda traits: traits.bursts)
def run(traits: Traits, look: Look) -> Any:
    """Find whether a tear begins at a face, or arrives there."""
    return run_tears


@phase("face", when=lambda traits: traits.bursts)
def tear(traits: Traits, look: Look) -> Any:
    """Tear a face that a tear has reached."""
    return tear_faces


@phase("balloon", when=lambda traits: traits.bursts)
def burst(traits: Traits, look: Look) -> Any:
    """Burst a balloon, and find the area of its hole."""
    return opening_function(traits.columns)
