"""Balloons that are pressed from outside harder than from within: by water, or in a vacuum. Host side."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws.gas import NO_INSIDE
from balloon_warp.kernels.laws.outer import EVENED
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.starts import start_of
from balloon_warp.scene import Balloon, Scene

LEAST = 1.0
"""Pressure of water that is worth a sentence [Pa]"""
PERCENT = 0.01
"""Part of it, beyond what a skin bears, that is worth a sentence"""
ROUNDING = 1.0e-6
"""Volume over the cube of the size that may be rounding's, as that of flat foil"""


def inside_volume(shape: BalloonShape) -> float:
    """Return a mesh's volume that may be used up [m^3]; `NO_INSIDE` if it is open, or has its inner side outside."""
    volume = signed_volume(shape.skin) if shape.encloses else NO_INSIDE
    size = float(np.ptp(shape.mesh.points, axis=0).max())
    return max(volume, 0.0) if volume > -ROUNDING * size**3 else NO_INSIDE


def may_be_crushed(scene: Scene, shapes: Sequence[BalloonShape], pressures: Sequence[NDArray[np.floating]]) -> bool:
    """Return whether a balloon of a given pressure may lose its volume: in water, or by a pressure below the air's.

    Args:
        pressures: at keyframes [Pa]: at the start, shape (W, balloon_count, keyframe_count), and what they change to.
    """
    if scene.solver == "projective":
        return False
    of_pressure = [number for number, balloon in enumerate(scene.balloon) if balloon.inflation.kind == "pressure"]
    start, *changed = pressures
    if scene.water is None and not any((values < 0.0).any() for values in (start[:, of_pressure], *changed)):
        return False
    return any(inside_volume(shapes[number]) != NO_INSIDE for number in of_pressure)


def starts_pressed(balloon: Balloon, shape: BalloonShape, scene: Scene) -> bool:
    """Return whether a balloon is pressed inward as it starts: under water, or by a pressure below the air's."""
    if balloon.inflation.kind == "normal_force" or not shape.encloses:
        return False
    if scene.water is not None and float((shape.mesh.points @ np.array(scene.up)).mean()) < scene.water.level:
        return True
    given = balloon.inflation.kind == "pressure" and not balloon.inflation.is_automatic
    return given and any(value < 0.0 for _, value in balloon.inflation.keyframes)


def water_pressures(
    scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters, number: int
) -> NDArray[np.float64]:
    """Return the pressure of the water on a balloon as it starts [Pa], shape (W, 3): on top, in the middle and below.

    0 above the water, and without any.
    """
    if scene.water is None:
        return np.zeros((1, 3))
    heights = start_of(scene, parameters, number, shapes[number].mesh.points) @ np.array(scene.up)
    places = np.stack([heights.max(axis=1), heights.mean(axis=1), heights.min(axis=1)], axis=1)
    level, density, gravity = (parameters[name][:, None] for name in ("water_level", "water_density", "gravity"))
    return np.maximum(density * gravity * (level - places), 0.0)


def step_while_crushed(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> float:
    """Return the longest step [s] in which the turning of skins is stable under inward pressures at the start.

    It is that of the bound of a gas's pressure, see `model.most_pressure`. Of a gas, what water presses harder below
    than above counts alone: the rest makes it smaller, which is stable at any step.
    """
    steps = [np.inf]
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        if balloon.inflation.kind == "normal_force" or not shape.encloses:
            continue
        top, _, below = water_pressures(scene, shapes, parameters, number).T
        inward = below - top
        if balloon.inflation.kind == "pressure":
            inward = below - parameters["keyframe_values"][:, number].min(axis=1)
        hardest = float(np.max(np.maximum(inward, 0.0) / parameters["mass"][:, number]))
        if hardest > 0.0:
            steps.append(float(np.sqrt(shape.pressure_bound / hardest)))
    return min(steps)


def crushed_starts(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> list[str]:
    """Return a sentence for each balloon that water presses harder at the start than it presses back, in any world."""
    found = []
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        kind = balloon.inflation.kind
        if scene.water is None or kind == "normal_force" or not shape.encloses:
            continue
        outside = water_pressures(scene, shapes, parameters, number)[:, 1]
        inside = parameters["initial_pressures"][:, number]
        if kind == "pressure":
            inside = parameters["keyframe_values"][:, number].max(axis=1)
        outside, inside, evened = np.broadcast_arrays(outside, inside, parameters[EVENED.name][:, number])
        world = int(np.argmax(outside - inside))
        if outside[world] > max(inside[world], LEAST):
            follows = "its gas shrinks until it presses as hard" if kind == "gas" else "it is crushed flat"
            if evened[world] >= PERCENT:
                percent = 100.0 * (1.0 - evened[world])
                follows += (
                    f"; its skin bears {percent:.0f} % of how much harder water presses below than above, and the rest "
                    "lifts it as a whole (inflation.water_evened)"
                )
            found.append(
                f"{shape.name}: water presses on it with {_told(outside[world])} where it starts, and it presses back "
                f"with {_told(inside[world])}: {follows}"
            )
    return found


def _told(pressure: float) -> str:
    """Return a pressure [Pa] in words."""
    return f"{pressure / 1000.0:.3g} kPa" if abs(pressure) >= 1000.0 else f"{pressure:.3g} Pa"
