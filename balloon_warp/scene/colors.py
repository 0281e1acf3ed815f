"""Colors of things where a scene does not say them: those of their files, or of a palette. Linear RGB."""

import colorsys

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.looks import Color, Looks
from balloon_warp.scene.schema import Balloon, Body, Obstacle, Scene

BALLOON_COLORS: list[Color] = [
    *[(0.80, 0.07, 0.06), (0.05, 0.30, 0.75), (0.95, 0.50, 0.03), (0.10, 0.50, 0.16)],
    *[(0.42, 0.10, 0.58), (0.03, 0.52, 0.52), (0.88, 0.16, 0.40), (0.90, 0.72, 0.08)],
]
GOLDEN = 0.618034
"""Step on the circle of hues from one balloon to the next, once these colors are used up"""
SPHERE_COLORS: list[Color] = [(0.06, 0.16, 0.45), (0.85, 0.60, 0.05), (0.08, 0.40, 0.35), (0.45, 0.10, 0.35)]
BODY_COLORS: list[Color] = [(0.50, 0.28, 0.10), (0.30, 0.34, 0.40), (0.42, 0.42, 0.16), (0.40, 0.16, 0.12)]
STRING_COLOR: Color = (0.25, 0.20, 0.16)
OBSTACLE_COLOR: Color = (0.45, 0.45, 0.47)
FORCE_COLOR: Color = (0.02, 0.05, 0.25)
GROUND_COLOR: Color = (0.72, 0.70, 0.66)
WATER_COLOR: Color = (0.06, 0.40, 0.52)


def palette_color(number: int) -> Color:
    """Return the palette's color for a number: each balloon has another."""
    if number < len(BALLOON_COLORS):
        return BALLOON_COLORS[number]
    return colorsys.hsv_to_rgb(GOLDEN * number % 1.0, 0.85, 0.75)


def balloon_color(scene: Scene, number: int) -> Color:
    """Return the color of a balloon: its own, or the palette's for its number."""
    return scene.balloon[number].color or palette_color(number)


def paper_of(scene: Scene) -> Color:
    """Return the color of the ground and the backdrop."""
    return (scene.picture and scene.picture.paper) or GROUND_COLOR


def looks_of_file(mesh: PolygonMesh | None, said: Balloon | Obstacle | Body) -> Looks | None:
    """Return the looks of a mesh's file, where they count: a color or print in the scene has precedence."""
    covered = said.color is not None or (isinstance(said, Balloon) and said.print is not None)
    return None if mesh is None or covered else mesh.looks


def mean_color(mesh: PolygonMesh | None, said: Balloon | Obstacle | Body, otherwise: Color) -> Color:
    """Return the looks of a thing as one color.

    Args:
        otherwise: its color where its mesh's file says none, or less than the scene.
    """
    looks = looks_of_file(mesh, said)
    return otherwise if looks is None else looks.mean(otherwise)
