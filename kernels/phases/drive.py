"""Outer forces on groups of particles, which a scene says or somebody steers by."""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.added import add_backwards
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import any_positive
from balloon_warp.kernels.loops.outer_forces import outer_force
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables


def _is_driven(features: Features, look: Look) -> Any:
    @wp.func
    def is_driven(t: Any, params: Any):
        """Return whether an outer force drives any particle of eight."""
        return any_positive(t.outer.slots[params.number, 0])

    return is_driven


@phase(
    "particle",
    {"force": wp.vec3},
    when=lambda features: features.driven,
    rare=_is_driven,
    adjoint=add_backwards,
)
def drive(features: Features, look: Look) -> Any:
    """Add the outer forces on groups of particles."""

    @wp.func
    def drive(t: Tables, params: Any, force: wp.vec3):
        return force + outer_force(t.outer, params.world, params.number)

    return drive
