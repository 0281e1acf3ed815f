"""Swelling: the volume that a balloon reaches by a pressure that "auto" chooses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.model import Model, plan_model
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.pressure import volume_under
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene
from balloon_warp.warp_lock import lock_of


@dataclass(frozen=True)
class Swelling:
    """Result of an "auto" pressure."""

    balloon: str
    pressure: float
    """Pressure [Pa]"""
    volume: float | None
    """Volume in equilibrium with the springs, without weight, over that at the start; None where it is not predicted:
    for open balloons, rubber and film, and large meshes"""

    def __str__(self) -> str:
        volume = "" if self.volume is None else f", volume 1.00 -> {self.volume:.2f}"
        return f"auto pressure {self.pressure:.4g} Pa{volume}"


def swellings(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> list[Swelling]:
    """Return the swelling of each balloon that an "auto" pressure inflates, in the first world."""
    found = []
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        pressure = float(parameters["keyframe_values"][0, number, -1]) if balloon.inflation.is_automatic else 0.0
        if pressure and shape.inflated:
            constants = np.array([parameters[row.name][0, number] for row in KINDS])
            volume = None if shape.membrane.count else volume_under(shape, constants, pressure)
            found.append(Swelling(shape.name, pressure, volume))
    return found


def swellings_of(model: Model) -> list[Swelling]:
    """Foretell the swellings of a model."""
    names = ("keyframe_values", *(row.name for row in KINDS))
    with lock_of(model.device):
        read = {name: np.asarray(model.parameters[name].numpy(), dtype=np.float64) for name in names}
    return swellings(model.scene, model.shapes, read)


def foretold_swellings(scene: Scene) -> list[Swelling]:
    """Foretell the swellings of a scene.

    Raises:
        InputError: as `plan_model`.
    """
    plan = plan_model(scene)
    return swellings(plan.scene, plan.shapes, plan.parameters)


def sentences(found: Sequence[Swelling]) -> list[str]:
    """Return sentences on the swelling of balloons, with the balloon's name where there are several."""
    return [f"{each.balloon}: {each}" if len(found) > 1 else str(each) for each in found]


def told_before(
    found: Sequence[Swelling], on_note: Callable[[str], None], on_frame: Callable[[int], None]
) -> Callable[[int], None]:
    """Make a listener to frames that notes these before the first.

    Where no frame comes, something is wrong, and there is nothing to say but that.
    """
    waiting = sentences(found)

    def listen(number: int) -> None:
        while waiting:
            on_note(waiting.pop(0))
        on_frame(number)

    return listen
