"""Sliders of the panel, and the parameters that have one."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from balloon_warp.kernels.laws import PARAMETERS, Law, Parameter
from balloon_warp.kernels.laws.law import FAR
from balloon_warp.model.parameters import value_of
from balloon_warp.scene import Balloon, Scene


@dataclass(frozen=True)
class Value:
    """A slider for a parameter of the world, or of all balloons alike."""

    row: Parameter
    label: str
    least_reach: float
    """Least range, where the scene's own value is 0 or small"""
    signed: bool = False

    @property
    def path(self) -> str:
        """Path in the scene."""
        return self.row.path if self.row.of == "world" else f"balloon.{self.row.path}"

    def read(self, scene: Scene) -> float:
        """Return the current value, that of the first balloon."""
        return float(value_of(scene if self.row.of == "world" else scene.balloon[0], self.row))


VALUES = (
    Value(PARAMETERS["gravity"], "gravity [m/s²]", 20.0, signed=True),
    Value(PARAMETERS["helium"], "lift [m/s^2]", 30.0),
    Value(PARAMETERS["damping"], "damping [N s/m]", 1.0),
    Value(PARAMETERS["structural"], "structural springs", 1.0),
    Value(PARAMETERS["shear"], "shear springs", 1.0),
    Value(PARAMETERS["flexion"], "flexion springs", 1.0),
)
"""Values that every scene has"""
SPRINGS = ("structural", "shear", "flexion")
TABLES = {
    "Contacts": ("touch", "ground", "friction"),
    "Material": ("material",),
    "Air and water": ("atmosphere", "water", "drag_coefficient", "face_drag", "face_friction"),
    "Gas": ("inflation", "neck"),
}
"""Folders of the panel, and the tables, or single values, of a scene or balloon in them"""
MUCH = {"m": 0.1, "N/m": 10.0, "m^2": 1e-5, "Pa s": 1e4}
"""Least range of a slider by unit, where 1 is out of proportion"""
SET_ONCE = ("fill_", "molar_mass", "neck_opens", "neck_closes", "gust_seed", "most_stretch", "wrinkling", "air_lapse")
"""Prefixes of parameters that set the start of a scene, or that are no amounts"""
WIDER = 5.0
"""Range of a slider over the default, where the scene has no value"""


def of_tables() -> dict[str, list[Value]]:
    """Return sliders for the numbers in tables that not every scene has, by their folders, from the rows."""
    return {
        folder: [
            _value_of_row(row)
            for row in PARAMETERS.values()
            if row.path.partition(".")[0] in tables and row.size == 1 and not row.name.startswith(SET_ONCE)
        ]
        for folder, tables in TABLES.items()
    }


IN_WIND = ("wind_shear", "wind_height", "roughness", "gusts", "gust_length")
"""Suffixes of parameters without effect in calm air"""
OF_AIR = ("air_pressure", "air_temperature")
"""Parameters without effect on balloons without drag or gas"""


def does_something(scene: Scene, row: Parameter) -> bool:
    """Return whether a parameter of a scene, or of its first balloon, exists, and has an effect at present."""
    if not stands_in(scene, row):
        return False
    if row.name in SPRINGS:
        material = scene.balloon[0].material
        return not material.is_membrane or row.name in material.springs
    if row.name.endswith(IN_WIND):
        gusty = scene.atmosphere.gusts > 0.0 or not row.name.endswith("gust_length")
        return any(scene.atmosphere.wind) and gusty
    if row.name in OF_AIR:
        return any(_feels_air(balloon) for balloon in scene.balloon)
    return True


def _feels_air(balloon: Balloon) -> bool:
    drag = balloon.drag_coefficient, balloon.face_drag, balloon.face_friction
    return balloon.inflation.kind == "gas" or any(drag)


def stands_in(scene: Scene, row: Parameter) -> bool:
    """Return whether a scene, or its first balloon, has a row's table, a use for it, and a number in it.

    A value of "auto" follows from others, and has no slider.
    """
    table: Any = scene if row.of == "world" else scene.balloon[0]
    for name in row.path.split(".")[:-1]:
        table = getattr(table, name, None)
        if table is None:
            return False
    if value_of(scene if row.of == "world" else scene.balloon[0], row) < row.least:
        return False
    if row.path.startswith("inflation."):
        return scene.balloon[0].inflation.kind == "gas"
    if row.path.startswith("material."):
        return table.is_membrane and row.path.rpartition(".")[2] in table.own_fields
    return True


def _value_of_row(row: Parameter) -> Value:
    name = re.sub(
        r"[._]", " ", row.path.replace("atmosphere.", "air ").removeprefix("inflation.").removeprefix("material.")
    )
    return Value(row, name if row.unit == "1" else f"{name} [{row.unit}]", _reach(row), signed=-FAR < row.least < 0.0)


def _reach(row: Parameter) -> float:
    """Return the range of a slider, where the scene has no value or a small one."""
    return row.most if row.most < FAR else max(WIDER * abs(row.default), MUCH.get(row.unit, 1.0))


def values_of(laws: Sequence[Law]) -> Iterator[Value]:
    """Return the sliders for the parameters of laws of one's own; vectors have none."""
    for row in dict.fromkeys(row for law in laws for row in law.parameters):
        if row.size == 1 and row.name not in PARAMETERS:
            yield Value(row, f"{row.name} [{row.unit}]", _reach(row), signed=row.least < 0.0)
