"""Wind that grows with height: that its numbers go together."""

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.model.parameters import Parameters


def require_profile(parameters: Parameters) -> None:
    """Make sure that the wind grows in one way, and from the ground's roughness length on up to where it is known.

    Raises:
        InputError: it does not.
    """
    names = ("wind_roughness", "wind_height", "wind_shear")
    roughness, height, shear = np.broadcast_arrays(*(parameters[name] for name in names))
    for world in np.flatnonzero((roughness > 0.0) & (shear > 0.0))[:1]:
        raise InputError(
            f"atmosphere.roughness: gives another wind profile than shear (got {roughness[world]:g}, and a shear of "
            f"{shear[world]:g}); expected only one of them"
        )
    for world in np.flatnonzero(roughness >= height)[:1]:
        raise InputError(
            f"atmosphere.roughness: must be less than wind_height, {height[world]:g} m (got {roughness[world]:g})"
        )
