"""Kinds of contacts that are items of a list, one a line: those of a sweep act at once."""

from balloon_warp.kernels.contact.bodies import BODIES
from balloon_warp.kernels.contact.edges import EDGES
from balloon_warp.kernels.contact.kind import Sweep
from balloon_warp.kernels.contact.ridges import RIDGES

BESIDE_RIDGES = Sweep((RIDGES,), lambda features: features._replace(ground=False))
"""Sweeps before particles leave the ground and obstacles, see docs/design/one_contact.md"""
AT_LAST = Sweep(
    (BODIES, RIDGES._replace(acts=lambda features: features.ridges and not features.ridges_first), EDGES),
    lambda features: features.without_ridges if features.ridges_first else features,
)
"""Sweeps once all have moved, in which bodies, layers, and the ground below them take part"""
