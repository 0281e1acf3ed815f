"""Adjoint of phases that add to the force on a particle what depends on nothing, or runs backwards elsewhere."""

from collections.abc import Sequence

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Look, Phase


def add_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint: the force before is worth what the force after it is."""

    @wp.func
    def added_adjoint(force_bar: wp.vec3):
        return force_bar

    return (Adjoint(added_adjoint, ("force",)),)
