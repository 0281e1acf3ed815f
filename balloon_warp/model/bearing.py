"""Part of a liquid's pressure gradient that the skin of a balloon of sealed gas bears. Host side."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws.gas import STANDARD_PRESSURE
from balloon_warp.kernels.laws.hooke import KINDS
from balloon_warp.kernels.laws.water import EVENED
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.model.materials import law_of, numbers_of
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.pressure import pressures_of_membrane, pressures_of_springs
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene

Values = NDArray[np.float64]
BEARS = 0.4
"""Pressure of a liquid over the radius that a skin bears, over how fast its own rises with stretch: balls keep their
shape up to 0.37, and turn inside out from 0.75 on"""
TAUT, SLACK = 0.97, 0.94
"""Stretch at the start below which a skin bears less, and that below which it hangs slack"""
PUSHED = 0.15
"""Part that springs bear of it then, which push where they are short; rubber and film do not"""
LEAST = 1.0e-3
"""Part of a skin that bears all while it is taut and not once it hangs slack, as where a balloon sinks"""
WIDEST, VACUUM = 10.0, 1.0
"""Largest stretch that is looked at, and least pressure around [Pa]"""
CLOSE = 1.0e-3
"""Difference of stretches by which slopes are taken"""


def settle_bearing(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> Values:
    """Return the part of a liquid's pressure that acts evenly on each balloon, shape (W, balloon_count).

    What a skin bears is in proportion to how fast its own pressure rises with stretch, as of a sphere, where its gas is
    at the air's pressure. Skin that hangs slack, because it is large for its gas or pressed small at the start, bears
    little or nothing. The part is 0 without gas, and without a liquid.
    """
    said = parameters[EVENED.name]
    parts = [np.zeros(len(said))] * len(shapes)
    for number, shape in enumerate(shapes):
        if scene.water is not None and scene.balloon[number].inflation.kind == "gas":
            own = said[:, number]
            parts[number] = np.where(own < 0.0, _not_borne(scene, number, shape, parameters), own)
    return np.stack(np.broadcast_arrays(*parts), axis=1)


def _not_borne(scene: Scene, number: int, shape: BalloonShape, parameters: Parameters) -> Values:
    """Return the part of a liquid's pressure that a skin does not bear where it is, shape (W,)."""
    names = ("water_density", "gravity", "water_level", "air_pressure")
    density, gravity, level, air = (parameters[name] for name in names)
    depth = np.maximum(level - parameters["initial_centers"][:, number] @ np.array(scene.up), 0.0)
    free_volume, gamma = (parameters[name][:, number] for name in ("initial_free_volumes", "gamma"))
    room = max(signed_volume(shape.mesh), 1.0e-30)
    out, here = (
        np.cbrt(free_volume * (STANDARD_PRESSURE / np.maximum(pressure, VACUUM)) ** (1.0 / gamma) / room)
        for pressure in (air, air + density * gravity * depth)
    )
    stretch = np.clip(out, 1.0, WIDEST)
    rise = (_pressure(scene, number, shape, parameters, stretch + CLOSE)
            - _pressure(scene, number, shape, parameters, stretch)) / CLOSE  # fmt: skip
    head = density * np.abs(gravity) * stretch * np.sqrt(shape.area / (4.0 * np.pi))
    borne = BEARS * np.nan_to_num(rise) / np.maximum(head, 1.0e-30)
    pushed = 0.0 if law_of(scene, number) else PUSHED
    taut = np.clip((here - SLACK) / (TAUT - SLACK), pushed, 1.0)
    return np.clip(1.0 - borne * taut, np.where(borne * pushed < 1.0, LEAST, 0.0), 1.0)


def _pressure(scene: Scene, number: int, shape: BalloonShape, parameters: Parameters, stretch: Values) -> Values:
    """Return the pressure that stretches a sphere of the balloon's area so far [Pa], shape (W,)."""
    if law := law_of(scene, number):
        return pressures_of_membrane(shape, law, numbers_of(parameters, number), stretch[:, None])[:, 0]
    constants = np.stack(np.broadcast_arrays(*(parameters[row.name][:, number] for row in KINDS)), axis=-1)
    return constants @ pressures_of_springs(shape) * (stretch - 1.0) / stretch**2
