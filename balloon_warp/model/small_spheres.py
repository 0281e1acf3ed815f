"""Spheres that touch faces, and not only particles: small ones one by one, larger ones as ridges do."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.model.model import Model
from balloon_warp.model.stability import held_within, widest_opening
from balloon_warp.model.timeline import values_over_time


def small_spheres(model: Model) -> list[bool]:
    """Return whether each sphere also touches faces, since it may fit through one, in any world at any time."""
    scene = model.scene
    if not scene.touches_spheres:
        return [False] * len(scene.sphere)
    most = held_within(scene) * max(widest_opening(shape.mesh) for shape in model.shapes)
    return [bool(radius < most) for radius in _least_radii(model)]


def round_ridges(model: Model) -> list[bool]:
    """Return whether each sphere touches faces as ridges do: it is not small, and exchanges momentum.

    So it is where faces meet ridges, of solids that are thin beside them, or the scene says `faces = true`.
    """
    scene = model.scene
    if not scene.touches_spheres or scene.contact != "impulse":
        return [False] * len(scene.sphere)
    meets = scene.faces is True or model.faces_meet
    return [meets and not small for small in small_spheres(model)]


def _least_radii(model: Model) -> NDArray[np.float64]:
    """Return the least radius of each sphere, in any world at any time, once it is there [m]."""
    spheres = model.scene.sphere
    radii = np.concatenate([rows.reshape(-1, len(spheres)) for rows in values_over_time(model, "sphere_radius")])
    said = np.array([sphere.radius for sphere in spheres])
    return np.where(radii > 0.0, radii, said).min(axis=0)


def without_small_spheres(model: Model) -> Model:
    """Return a model to which small spheres may be added, and touch no faces.

    It is the same model if it has some that do. They would take all of it to a slower schedule, in which a replay would
    be from the start.
    """
    touch = model.scene.touch
    meet_already = model.faces_meet or any(small_spheres(model)) or any(round_ridges(model))
    if meet_already or (touch and not (touch.balloons or touch.itself)):
        return model
    without = {"faces": False, "touch": touch.model_copy(update={"spheres": False}) if touch else touch}
    return replace(model, scene=model.scene.model_copy(update=without))
