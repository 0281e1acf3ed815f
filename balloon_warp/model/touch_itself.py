"""Balloons that touch themselves, where the scene leaves it to their meshes."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from balloon_warp.mesh.nearness import nears_itself
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.slenderness import slenderness
from balloon_warp.model.crushing import starts_pressed
from balloon_warp.model.folded import bends_freely, is_in_layers
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Balloon, Scene, Touch

STRETCH = 0.1
"""Stretch of a skin, by which its parts grow, where the inflation names none"""
SLENDER = 2.0 * np.pi
"""Slenderness from which on a balloon may bend into itself: a tube's, whose ends meet around a hole as wide as it"""


def settle_itself(scene: Scene, shapes: Sequence[BalloonShape]) -> Scene:
    """Return the scene with `touch.itself` settled by its meshes, where it is "auto".

    It is true where parts of any balloon are near each other, so that inflation may close the gap between them, and for
    foil, which folds anywhere: it bends freely and is flat or folded at the start. It is "soft" where any balloon is so
    slender that it may bend into itself, or starts pressed inward, by water or a vacuum: walls come together where the
    skin does not bear that. Either should cost next to nothing until then. Where contact cannot be simulated, as with a
    solver that takes over later, `touch` is false.
    """
    if not scene.meshes_settle_itself:
        return scene.model_copy(update={"touch": False}) if scene.touch is None else scene
    itself: bool | Literal["soft"] = _any_is_foil(scene.balloon, shapes) or _any_nears_itself(scene.balloon, shapes)
    itself = itself or ((_any_is_slender(shapes) or _any_is_pressed(scene, shapes)) and "soft")
    if scene.touch:
        return scene.model_copy(update={"touch": scene.touch.model_copy(update={"itself": itself})})
    # spheres touch faces as they do without this table
    return scene.model_copy(update={"touch": Touch(itself=itself, spheres=scene.faces_may_meet)}) if itself else scene


def _any_nears_itself(balloons: Sequence[Balloon], shapes: Sequence[BalloonShape]) -> bool:
    """Return whether any balloon nears itself; of balloons that are alike one is looked at."""
    stretches = [_stretch_of(balloon) for balloon in balloons]
    different = {(*_form(shape.mesh), stretch): shape.mesh for shape, stretch in zip(shapes, stretches, strict=True)}
    return any(nears_itself(mesh, stretch) for (*_, stretch), mesh in different.items())


def _any_is_slender(shapes: Sequence[BalloonShape]) -> bool:
    """Return whether any closed balloon is so slender that it may bend into itself; ribbons, such as hair, are not."""
    closed = {_form(shape.mesh): shape.mesh for shape in shapes if shape.closed}
    return any(slenderness(mesh) >= SLENDER for mesh in closed.values())


def _any_is_pressed(scene: Scene, shapes: Sequence[BalloonShape]) -> bool:
    """Return whether any balloon is pressed inward as it starts."""
    return any(starts_pressed(balloon, shape, scene) for balloon, shape in zip(scene.balloon, shapes, strict=True))


def _any_is_foil(balloons: Sequence[Balloon], shapes: Sequence[BalloonShape]) -> bool:
    """Return whether any balloon bends freely and has layers on each other, as foil has."""
    limp = {_form(shape.mesh): shape.mesh for each, shape in zip(balloons, shapes, strict=True) if bends_freely(each)}
    return any(is_in_layers(mesh) for mesh in limp.values())


def _stretch_of(balloon: Balloon) -> float:
    """Return the stretch that a balloon's inflation names."""
    return balloon.inflation.stretch if balloon.inflation.is_automatic else STRETCH


def _form(mesh: PolygonMesh) -> tuple[bytes, bytes]:
    """Return a key that is alike for meshes that differ in size and place alone."""
    points = mesh.points - mesh.points.min(axis=0)
    return mesh.face_vertex_indices.tobytes(), np.round(points / max(float(points.max()), 1e-30), 5).tobytes()
