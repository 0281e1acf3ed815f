"""Numbers of a scene that may be of another unit than was meant, asked for in a sentence each."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from balloon_warp.mesh.seams import size_of
from balloon_warp.mesh.units import METERS, NO_AXIS
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Balloon, Scene

SMALLEST, LARGEST = 0.02, 30.0
"""Range of balloon sizes without a warning [m]"""
TOLD = (0.002, 300.0)
"""Range of sizes without a warning, where the unit is given [m]"""
THICKEST = 0.05
"""Largest wall thickness over a balloon's size"""
HEAVIEST = 100.0
"""Largest mass over that of the air in a sphere of the balloon's size"""
LIGHT = 5.0
"""Largest mass without a warning [kg]: a mesh by itself has less"""
LIFTED = 100.0
"""Largest lift by helium over weight"""
AIR = 1.2
"""Density of air [kg/m^3]"""


def doubts_about(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> list[str]:
    """Return warnings of values that may be in another unit, or of another sign, in any world.

    Of gravity, and of balloons' sizes, walls, masses and lift. Also of meshes turned to an up axis that their files do
    not name.
    """
    found = []
    if (gravity := float(parameters["gravity"].min())) < 0.0:
        found.append(f"gravity: {gravity:g} m/s2 pulls up, since positive is down; meant {-gravity:g}?")
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        size, mass = size_of(shape.mesh), float(parameters["mass"][:, number].max())
        if not SMALLEST <= size <= LARGEST and balloon.unit is None:
            found.append(f"{shape.name}: {size:.3g} m? {_helps(balloon, shape, size)}")
        elif not TOLD[0] <= size <= TOLD[1]:
            found.append(f"{shape.name}: {size:.3g} m? --unit {balloon.unit}?")
        if scene.up_axis != "Y" and isinstance(balloon.mesh, Path) and not shape.mesh.up_known:
            found.append(
                f"{shape.name}: its {NO_AXIS}, so its Y is turned to up_axis, {scene.up_axis}; --up {scene.up_axis} "
                f'(up = "{scene.up_axis}") keeps the mesh as it is'
            )
        thickness = float(parameters["thickness"][:, number].max()) if balloon.material.is_membrane else 0.0
        if thickness > THICKEST * size:
            wall = f"a wall {thickness:.3g} m thick, for a balloon of {size:.3g} m?"
            found.append(f"{shape.name}: {wall} material.thickness is in meters")
        if mass > max(LIGHT, HEAVIEST * AIR * np.pi / 6.0 * size**3):
            found.append(
                f"{shape.name}: a mass of {mass:.3g} kg, for a balloon of {size:.3g} m? Masses are in kilograms"
            )
        lift, weight = float(parameters["helium"][:, number].max()), float(np.abs(parameters["gravity"]).max())
        if lift > LIFTED * max(weight, 1.0):
            found.append(
                f"{shape.name}: helium accelerates upward by {lift:g} m/s2? {1.2 * weight:.3g} lets it rise slowly"
            )
    return found


def _helps(balloon: Balloon, shape: BalloonShape, size: float) -> str:
    """Return the option or field that would give the balloon an ordinary size."""
    units = [unit for unit in ("cm", "mm", "in", "ft") if SMALLEST <= size * METERS[unit] <= LARGEST]
    if size > LARGEST and units and not shape.mesh.unit_known:
        return f"--unit {units[0]}?"
    return f"balloon.scale = {10.0 ** -round(np.log10(size)) * balloon.scale:g}?"
