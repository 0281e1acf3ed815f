"""Balloons that touch push each other off; now and then it is found which may."""

from typing import Any

from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.traits import Traits


@phase("launches", when=lambda traits: traits.touches)
def press(traits: Traits, look: Look) -> Any:
    """Search for contacts now and then, and apply their forces: launches of their own, see `schedules.touching`."""
    return None
