"""Wear of stretched membranes: softening and tearing."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.wear import wear_function
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.phases.holes import opening_function
from balloon_warp.kernels.phases.tears import run_tears, tear_faces, weigh_faces
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits


@cache
def wear_of_state(traits: Traits, at: Any, keeps: bool) -> Any:
    """Make the function that finds what is left of the tension of triangles, and their stresses.

    Args:
        keeps: whether it notes the greatest energy densities in the state.
    """
    read_numbers, wear_of_triangle = numbers_reader(traits.columns), wear_function(traits, at)

    @wp.func
    def wear(t: Tables, state: WorldState, points: Any, world: wp.int32, triangle: wp.int32):
        n = read_numbers(t, world, t.particles.balloon[t.membranes.corners[triangle][0]])
        peak = float(0.0)
        if wp.static(traits.softens):
            peak = state.peaks[world, triangle]
        left, greatest, stress = wear_of_triangle(t, world, triangle, points, peak, n)
        t.membranes.wear.left[world, triangle] = left
        if wp.static(traits.softens and keeps):
            state.peaks[world, triangle] = greatest
        if wp.static(traits.bursts):
            t.membranes.wear.tears.stresses[world, triangle] = stress

    return wear


@phase("triangle", when=lambda traits: traits.wears)
def wear(traits: Traits, look: Look) -> Any:
    """Find the factor on a triangle's tension, and store its peak stretch."""
    return wear_of_state(traits, look.at, True)


@phase("triangle", when=lambda traits: traits.wears)
def look_at_wear(traits: Traits, look: Look) -> Any:
    """Find the factor on a triangle's tension, without storing its peak stretch."""
    return wear_of_state(traits, look.at, False)


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
