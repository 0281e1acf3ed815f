"""Spheres that are small beside faces."""

from dataclasses import replace

import numpy as np

from balloon_warp.model.acting import values_over_time
from balloon_warp.model.model import Model
from balloon_warp.model.tunneling import MOST_STRETCH, widest_opening


def small_spheres(model: Model) -> list[bool]:
    """Of each sphere, whether it meets faces, too, since it may fit through one, stretched to twice its size, in any
    world at any time."""
    scene = model.scene
    if not scene.touches_spheres:
        return [False] * len(scene.sphere)
    most = MOST_STRETCH * max(widest_opening(shape.mesh) for shape in model.shapes)
    radii = np.concatenate([rows.reshape(-1, len(scene.sphere)) for rows in values_over_time(model, "sphere_radius")])
    said = np.array([sphere.radius for sphere in scene.sphere])
    least = np.where(radii > 0.0, radii, said).min(axis=0)
    return [bool(radius < most) for radius in least]


def without_small_spheres(model: Model) -> Model:
    """The model to which small spheres may be added, and meet no faces; the same if it has some that do. They would
    take all of it to a slower schedule, in which a replay would be from the start."""
    touch = model.scene.touch
    if touch is None or any(small_spheres(model)) or not (touch.balloons or touch.itself):
        return model
    return replace(model, scene=model.scene.model_copy(update={"touch": touch.model_copy(update={"spheres": False})}))
