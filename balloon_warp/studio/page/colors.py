"""Colors of the page, in sRGB from 0 to 255."""

import numpy as np

from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Scene
from balloon_warp.scene import around as palette
from balloon_warp.scene.around import BODY_COLORS, OBSTACLE_COLOR, SPHERE_COLORS, mean_color

Color = tuple[int, int, int]
SPRINGS: dict[str, Color] = {"structural": (20, 20, 20), "shear": (30, 80, 220), "flexion": (20, 150, 60)}
"""Black, blue and green of the paper (figure 3)"""
WIRE: Color = (60, 30, 30)
NORMALS: Color = (230, 140, 20)
FORCES: Color = (0, 130, 70)
CONTACTS: Color = (30, 30, 45)
STRING: Color = (95, 75, 60)
HAND: Color = (250, 200, 40)
GROUND: Color = (228, 222, 212)
GRID: Color = (214, 207, 196)
PAPER: Color = (255, 255, 255)
"""Color below a print"""
BRAND: Color = (200, 40, 36)
STRAIN_BOUNDS = (0.85, 0.97, 1.03, 1.15, 1.4, 1.8)
"""Bounds of the color bands, length over rest length"""
STRAIN: tuple[Color, ...] = (
    (35, 40, 140),
    (60, 110, 210),
    (205, 215, 220),
    (255, 205, 70),
    (245, 135, 30),
    (215, 45, 30),
    (110, 0, 30),
)


def balloon_color(scene: Scene, number: int, mesh: PolygonMesh) -> Color:
    """Return a balloon's color as in the stage; a single one for a mesh with several colors."""
    return _encoded(mean_color(mesh, scene.balloon[number], palette.balloon_color(scene, number)))


def sphere_color(number: int, own: tuple[float, float, float] | None) -> Color:
    """Return a sphere's color as in the stage: its own, or the palette's."""
    return _encoded(own or SPHERE_COLORS[number % len(SPHERE_COLORS)])


def obstacle_color(scene: Scene, number: int, mesh: PolygonMesh | None) -> Color:
    """Return an obstacle's color as in the stage: the scene's, the mesh's own, or gray."""
    said = scene.obstacle[number]
    return _encoded(said.color or mean_color(mesh, said, OBSTACLE_COLOR))


def body_color(scene: Scene, number: int, mesh: PolygonMesh | None) -> Color:
    """Return a body's color as in the stage: the scene's, the mesh's own, or the palette's."""
    said = scene.body[number]
    return _encoded(said.color or mean_color(mesh, said, BODY_COLORS[number % len(BODY_COLORS)]))


def water_color() -> Color:
    """Return the water's color as in the stage."""
    return _encoded(palette.WATER_COLOR)


def linear(color: Color) -> tuple[float, float, float]:
    """Return a color of the page as scenes have it, in linear RGB."""
    values = np.clip(np.asarray(color, float) / 255.0, 0.0, 1.0)
    r, g, b = (float(value) for value in np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4))
    return r, g, b


def _encoded(linear: tuple[float, float, float]) -> Color:
    values = np.asarray(linear)
    encoded = np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)
    r, g, b = (int(value) for value in np.clip(np.round(255 * encoded), 0, 255))
    return r, g, b
