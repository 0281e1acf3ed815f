"""Adjoint of phases that add to the force on a particle a term that depends on nothing, or runs backwards elsewhere."""

from collections.abc import Sequence

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Look, Phase


def add_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint: the bar of the force before is that of the force after it."""

    @wp.func
    def added_adjoint(force_bar: wp.vec3):
        return force_bar

    return (Adjoint(added_adjoint, ("force",)),)
