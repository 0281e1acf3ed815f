"""Ground and water in the page: level planes, moved to their heights."""

from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from balloon_warp.outputs.usd.planes import PLANES, SIZES
from balloon_warp.viewer import colors
from balloon_warp.viewer.picture import Picture

ROOT = "/levels"
SHADOW = 0.55
"""Darkness of shadows on the ground"""
GRID_SIZES = 14.0
"""Distance from the middle of the ground to where it has faded out, over the balloons' size"""


class LevelLayer:
    """Ground and water of a scene.

    Args:
        server: Server of the page.
        picture: First picture of the scene.
        center: Center of the balloons at the start [m], shape (3,).
        size: Size of the balloons [m].
    """

    def __init__(self, server: viser.ViserServer, picture: Picture, center: NDArray[np.floating], size: float):
        self._server = server
        self._up = np.array(picture.scene.up)
        self._middle = center - (center @ self._up) * self._up
        server.scene.add_frame(ROOT, show_axes=False)
        self._planes: dict[str, Any] = {}
        """Planes by the field of a frame with their height"""
        if picture.scene.ground:
            self._planes[PLANES["ground"].height] = self._add_ground(size)
        if picture.scene.water:
            self._planes[PLANES["water"].height] = self._add_water(SIZES * size)

    def draw(self, picture: Picture) -> None:
        """Move the levels to their heights; the page is told only of changes."""
        for height, plane in self._planes.items():
            position = tuple((self._middle + getattr(picture.frame, height) * self._up).tolist())
            if tuple(plane.position) != position:
                plane.position = position

    def _add_ground(self, size: float) -> Any:
        """Return a plane to throw shadows on, with a grid half a balloon's size wide."""
        wide = GRID_SIZES * size
        return self._server.scene.add_grid(
            f"{ROOT}/ground",
            width=2 * wide,
            height=2 * wide,
            plane="xz" if self._up[1] else "xy",
            cell_size=size / 2,
            section_size=size / 2,
            cell_color=colors.GRID,
            section_color=colors.GRID,
            plane_color=colors.GROUND,
            plane_opacity=1.0,
            shadow_opacity=SHADOW,
            fade_distance=wide,
        )

    def _add_water(self, half: float) -> Any:
        """Return a square that one looks through.

        Args:
            half: half its side [m].
        """
        sideways, along = (np.roll(self._up, turns) for turns in (1, 2))
        corners = [half * (a * sideways + b * along) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return self._server.scene.add_mesh_simple(
            f"{ROOT}/water",
            np.array(corners),
            np.array([(0, 1, 2), (0, 2, 3)]),
            color=colors.water_color(),
            opacity=PLANES["water"].opacity,
            side="double",
            cast_shadow=False,
        )
