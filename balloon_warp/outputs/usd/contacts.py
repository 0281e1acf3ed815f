"""Contacts in the stage: of each balloon and each thing that may press it, attributes with a value at every frame."""

import numpy as np
from pxr import Gf, Sdf, Usd

from balloon_warp.contacts import things_of
from balloon_warp.frame import Frame
from balloon_warp.model import Model
from balloon_warp.outputs.usd.names import prim_names

KINDS = {
    "force": Sdf.ValueTypeNames.Vector3d,
    "torque": Sdf.ValueTypeNames.Vector3d,
    "area": Sdf.ValueTypeNames.Double,
    "pressure": Sdf.ValueTypeNames.Double,
}
"""Types of the measures, as `Contact` has them [N, N m, m^2, Pa]"""


class ContactChannels:
    """Contact attributes of one balloon, `userProperties:contacts:THING:force` and so on.

    There are none unless the scene asks for them.
    """

    def __init__(self, prim: Usd.Prim, model: Model, number: int):
        self._attributes: dict[int, dict[str, Usd.Attribute]] = {}
        if not model.scene.contacts:
            return
        things = things_of(model)
        own = len(things) - model.balloon_count + number
        for thing, name in enumerate(prim_names(each.replace(" ", "_") for each in things)):
            if thing != own and (thing > 0 or model.scene.ground):
                self._attributes[thing] = {
                    kind: prim.CreateAttribute(f"userProperties:contacts:{name}:{kind}", value, custom=True)
                    for kind, value in KINDS.items()
                }
        self._number = number

    def write(self, frame: Frame) -> None:
        """Write the contacts of the balloon, and zero for things that do not touch it."""
        found = {each.thing: each for each in frame.contacts if each.number == self._number} if self._attributes else {}
        for thing, attributes in self._attributes.items():
            contact = found.get(thing)
            for kind, attribute in attributes.items():
                if kind in ("force", "torque"):
                    vector = np.asarray(getattr(contact, kind)).tolist() if contact else (0.0, 0.0, 0.0)
                    attribute.Set(Gf.Vec3d(*vector), frame.number)
                else:
                    attribute.Set(getattr(contact, kind) if contact else 0.0, frame.number)
