"""Contact forces: the net force of each pair of things, averaged over a frame."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.model import Model, ModelPlan
from balloon_warp.shown import Shown, described

PAIR_ARRAYS = ("forces", "torques", "areas", "pressures", "places")
"""Arrays of `State` for each pair, named after `contact_`"""


@described
@dataclass(frozen=True, repr=False)
class Contact(Shown):
    """Contact of a balloon with another thing, averaged over a frame."""

    balloon: str
    """Name of the balloon"""
    other: str
    """Name of the other thing: an obstacle, a body or a balloon; "ground", or "sphere 0" """
    force: NDArray[np.float64]
    """Force on the balloon [N], shape (3,); the other thing has the opposite"""
    torque: NDArray[np.float64]
    """Torque on the balloon about the mean of its points [N m], shape (3,)"""
    area: float
    """Contact area of the balloon [m^2]"""
    pressure: float
    """Largest pressure at a particle, its force over its share of the area; between two balloons, summed over both
    [Pa]"""
    place: NDArray[np.float64]
    """Center of pressure, the mean of the pressed places weighted by force [m], shape (3,)"""
    number: int
    """Index of the balloon in the scene"""
    thing: int
    """Index of the other thing among `things_of` the model"""

    def __repr__(self) -> str:
        force = ", ".join(f"{number:.3g}" for number in self.force)
        return f"Contact({self.other} on {self.balloon}: ({force}) N on {self.area:.3g} m^2)"


def things_of(model: Model | ModelPlan) -> list[str]:
    """Name all that balloons may touch, in the order in which kernels number it: see `kernels.loops.fixtures`."""
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
