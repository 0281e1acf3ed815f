"""Spheres that are small beside faces."""

from dataclasses import replace

import numpy as np

from balloon_warp.model.acting import values_over_time
from balloon_warp.model.model import Model
from balloon_warp.model.tunneling import held_within, widest_opening


def small_spheres(model: Model) -> list[bool]:
    """Return whether each sphere also touches faces, since it may fit through one, in any world at any time."""
    scene = model.scene
    if not scene.touches_spheres:
        return [False] * len(scene.sphere)
    most = held_within(scene) * max(widest_opening(shape.mesh) for shape in model.shapes)
    radii = np.concatenate([rows.reshape(-1, len(scene.sphere)) for rows in values_over_time(model, "sphere_radius")])
    said = np.array([sphere.radius for sphere in scene.sphere])
    least = np.where(radii > 0.0, radii, said).min(axis=0)
    return [bool(radius < most) for radius in least]


def without_small_spheres(model: Model) -> Model:
    """Return a model to which small spheres may be added, and touch no faces.

    It is the same model if it has some that do. They would take all of it to a slower schedule, in which a replay would
    be from the start.
    """
    touch = model.scene.touch
    if model.faces_meet or any(small_spheres(model)) or (touch and not (touch.balloons or touch.itself)):
        return model
    without = {"faces": False, "touch": touch.model_copy(update={"spheres": False}) if touch else touch}
    return replace(model, scene=model.scene.model_copy(update=without))
