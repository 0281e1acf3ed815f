"""Arrows in the page: how hard things press balloons, an arrow for each pair that touches."""

from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from balloon_warp.viewer import colors
from balloon_warp.viewer.geometry import Lines
from balloon_warp.viewer.picture import Picture

ROOT = "/contacts"
LONGEST = 0.4
"""Length of the arrow of the strongest force, over the balloons' size"""
LEAST = 0.02
"""Fraction of the strongest force below which a force has no arrow"""
FADING = 0.99
"""Decay factor of the strongest force from picture to picture, so that an impact does not dwarf later ones"""
THIN = 0.012
"""Radius of the shafts, over the balloons' size"""
CLEAR = 0.45
"""Opacity of balloons while arrows are shown"""


class PressLayer:
    """Arrows of net forces of contacts, in scenes that have `contacts`.

    Args:
        server: of the page.
        size: of the balloons [m].
    """

    def __init__(self, server: viser.ViserServer, size: float):
        server.scene.remove_by_name(ROOT)
        self._size, self._strongest = size, 0.0
        nothing, thin = np.zeros((1, 2, 3), np.float32), THIN * size
        self._arrows: Any = server.scene.add_arrows(
            ROOT, nothing, colors.CONTACTS, visible=False,
            shaft_radius=thin, head_radius=2.5 * thin, head_length=6.0 * thin,
        )  # fmt: skip

    def draw(self, picture: Picture, shown: bool) -> None:
        """Show the net contact forces on a picture's balloons."""
        arrows = self.arrows_of(picture) if shown else np.zeros((0, 2, 3), np.float32)
        if len(arrows):
            self._arrows.points = arrows
        if self._arrows.visible != (len(arrows) > 0):
            self._arrows.visible = len(arrows) > 0

    def arrows_of(self, picture: Picture) -> Lines:
        """Find where the arrows begin, where a balloon is pressed, and where they end."""
        contacts = picture.frame.contacts
        forces, places = (
            np.array([getattr(each, name) for each in contacts]).reshape(-1, 3) for name in ("force", "place")
        )
        return self._scaled(forces, places)

    def _scaled(self, forces: NDArray[np.float64], places: NDArray[np.float64]) -> Lines:
        sizes = np.linalg.norm(forces, axis=1)
        self._strongest = max(float(sizes.max(initial=0.0)), FADING * self._strongest)
        seen = (sizes > LEAST * self._strongest) & (sizes > 0.0)
        lengths = LONGEST * self._size / max(self._strongest, 1e-30)
        return np.stack([places, places + lengths * forces], axis=1)[seen].astype(np.float32)
