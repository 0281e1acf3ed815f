"""Contact of balloons: the push, and now and then the search for pairs."""

from typing import Any

from balloon_warp.kernels.adjoints.derived import nothing
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Look, phase


@phase("launches", when=lambda features: features.touches, adjoint=nothing)
def touch_balloons(features: Features, look: Look) -> Any:
    """Search for contacts now and then, and apply their forces: own launches, see `schedules.balloon_contact`.

    Backwards it has launches of its own, too, once particles have gone back, see `schedules.backward_touch`.
    """
    return None
