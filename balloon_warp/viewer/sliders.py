"""Which parameters have a slider in the panel."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from balloon_warp.kernels.laws import PARAMETERS, Law, Parameter
from balloon_warp.kernels.laws.law import FAR
from balloon_warp.model.parameters import value_of
from balloon_warp.scene import Scene


@dataclass(frozen=True)
class Value:
    """A slider for a parameter of the world, or of all balloons alike."""

    row: Parameter
    label: str
    least_reach: float
    """of its range, where the scene's own value is 0 or small"""
    signed: bool = False

    @property
    def path(self) -> str:
        """of the scene"""
        return self.row.path if self.row.of == "world" else f"balloon.{self.row.path}"

    def read(self, scene: Scene) -> float:
        """Now; of the first balloon."""
        return value_of(scene if self.row.of == "world" else scene.balloon[0], self.row)


VALUES = (
    Value(PARAMETERS["gravity"], "gravity [m/s²]", 20.0, signed=True),
    Value(PARAMETERS["helium"], "helium [N/kg]", 30.0),
    Value(PARAMETERS["damping"], "damping [N s/m]", 1.0),
    Value(PARAMETERS["structural"], "structural springs", 1.0),
    Value(PARAMETERS["shear"], "shear springs", 1.0),
    Value(PARAMETERS["flexion"], "flexion springs", 1.0),
)


def values_of(laws: Sequence[Law]) -> Iterator[Value]:
    """Sliders for the parameters of laws of one's own; vectors have none."""
    for row in dict.fromkeys(row for law in laws for row in law.parameters):
        if row.size == 1 and row.name not in PARAMETERS:
            reach = row.most if row.most < FAR else max(5.0 * abs(row.default), 1.0)
            yield Value(row, f"{row.name} [{row.unit}]", reach, signed=row.least < 0.0)
