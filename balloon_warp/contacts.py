"""What presses on what: the net force of each pair of things, on average over a frame."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.model import Model, ModelPlan
from balloon_warp.shown import Shown, described

PAIR_ARRAYS = ("forces", "torques", "areas", "pressures", "places")
"""what `State` has of each pair, after `contact_`"""


@described
@dataclass(frozen=True, repr=False)
class Contact(Shown):
    """What a thing does to a balloon that it touches, on average over a frame."""

    balloon: str
    """its name"""
    other: str
    """the name of the other: an obstacle, a body or a balloon; "ground", or "sphere 0" """
    force: NDArray[np.float64]
    """on the balloon [N], shape (3,); on the other it is the opposite"""
    torque: NDArray[np.float64]
    """on the balloon, about the mean of its points [N m], shape (3,)"""
    area: float
    """of the balloon, that touches [m^2]"""
    pressure: float
    """the largest of any particle: its force over its part of the area; of two balloons both added up [Pa]"""
    place: NDArray[np.float64]
    """the mean of the places that are pressed, by how hard [m], shape (3,)"""
    number: int
    """the balloon's, in the scene"""
    thing: int
    """the other's, among `things_of` the model"""

    def __repr__(self) -> str:
        force = ", ".join(f"{number:.3g}" for number in self.force)
        return f"Contact({self.other} on {self.balloon}: ({force}) N on {self.area:.3g} m^2)"


def things_of(model: Model | ModelPlan) -> list[str]:
    """Name all that balloons may touch, in the order in which kernels number it: see `kernels.loops.contact_things`."""
    scene = model.scene
    kinds = (("obstacle", scene.obstacle), ("body", scene.body))
    named = {kind: [each.name or f"{kind} {number}" for number, each in enumerate(things)] for kind, things in kinds}
    spheres = [f"sphere {number}" for number in range(len(scene.sphere))]
    return ["ground", *named["obstacle"], *spheres, *named["body"], *(shape.name for shape in model.shapes)]


def contacts_of(model: Model, told: Mapping[str, NDArray[np.float64]]) -> list[Contact]:
    """List the pairs that touched in a frame.

    Args:
        told: a world's `PAIR_ARRAYS`, by name.
    """
    things = things_of(model)
    return [
        Contact(
            balloon=model.shapes[number].name,
            other=things[thing],
            force=told["forces"][number, thing],
            torque=told["torques"][number, thing],
            area=float(told["areas"][number, thing]),
            pressure=float(told["pressures"][number, thing]),
            place=told["places"][number, thing],
            number=number,
            thing=thing,
        )
        for number, thing in np.argwhere(told["areas"] > 0.0).tolist()
    ]
