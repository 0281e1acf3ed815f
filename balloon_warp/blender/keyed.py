"""Keyframes of a scene from animated volumes and litres: pressures, and the flow of a pump."""

from collections.abc import Sequence

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.air import molar_volume
from balloon_warp.run.job import foretold_swellings
from balloon_warp.scene import Balloon, Scene, load_scene

SAMPLES = 8
"""Number of stretches whose pressures are foretold; others lie on lines between them"""
LITRE = 1e-3
"""[m^3]"""


def with_keyframes(scene: Scene, number: int, amounts: Sequence[float]) -> Scene:
    """Return the scene with a balloon whose volume, over that of its mesh, or litres of gas follow frames.

    Raises:
        InputError: the balloon has no volume.
    """
    balloon = scene.balloon[number]
    times = (np.arange(len(amounts)) / scene.frames_per_second).tolist()
    if balloon.inflation.kind == "gas":
        air = scene.atmosphere
        moles = np.array(amounts) * LITRE / molar_volume(air.pressure, air.temperature)
        flows = np.gradient(moles, times[1])
        flows[0] += 2.0 * moles[0] / times[1]  # what is there at once comes within the first frame
        said = {"pump": list(zip(times, flows.tolist(), strict=True))}
    else:
        pressures = pressures_of(balloon, scene.up_axis, np.cbrt(amounts) - 1.0)
        said = {"pressure": list(zip(times, pressures, strict=True))}
    return load_scene(scene, {f"balloon.{number}.inflation.{field}": value for field, value in said.items()})


def pressures_of(balloon: Balloon, up_axis: str, stretches: np.ndarray) -> list[float]:
    """Return the pressures that stretch the skin of a balloon so far [Pa].

    Raises:
        InputError: it has no volume.
    """
    known = np.linspace(0.0, max(float(stretches.max()), 1e-6), SAMPLES + 1)
    pressures = [0.0]
    for stretch in known[1:].tolist():
        inflation = balloon.inflation.model_copy(update={"stretch": stretch})
        alone = balloon.model_copy(update={"inflation": inflation, "fixed": []})
        found = foretold_swellings(Scene(up_axis=up_axis, balloon=[alone]))  # pyright: ignore[reportArgumentType]
        if not found:
            raise InputError(f"{balloon.name}: its mesh is open; expected a closed one, whose volume can be animated")
        pressures.append(found[0].pressure)
    return np.interp(stretches, known, pressures).tolist()
