"""Balloons of rubber, beside the same of springs."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness

RADIUS = 0.05
"""[m]"""
AMOUNT = 0.08
"""of gas [mol], which stretches the balloon to 1.5 times its size"""
MASS = 0.0059
"""[kg]; that of the rubber"""


@dataclass(frozen=True)
class RubberCase:
    """Latex balloons of 5 cm with sealed gas, in turns with springs: their particle-substeps a second."""

    name: str
    schedule: str
    worlds: int
    law: str
    cells: int = 9
    substeps: int = 192
    quick: bool = False

    @property
    def particles(self) -> int:
        """Number of particles in one world."""
        return 6 * self.cells**2 + 2

    def scene(self) -> Scene:
        """Return a scene of stretched rubber."""
        preset = "natural_rubber_treloar" if self.law == "ogden" else "latex"
        return self._of({"material": {"preset": preset, "kind": self.law, "most_stretch": 6.0}})

    def without(self) -> Scene:
        """Return the scene with springs as stiff, and as heavy."""
        return self._of({"mass": MASS, "stiffness": Stiffness(structural=40.0, shear=20.0, flexion=4.0)})

    def _of(self, made: Mapping[str, Any]) -> Scene:
        gas = Inflation(kind="gas", amount=AMOUNT)
        fields = {"mesh": quad_sphere(self.cells, radius=RADIUS), "damping": 0.3, "inflation": gas, **made}
        return Scene(balloon=[Balloon(**fields)], gravity=0.0, substeps=self.substeps)


def rubber_cases(schedule: str, worlds: int) -> Iterator[RubberCase]:
    """Return the cases of each law."""
    names = {"neo_hookean": "neo-Hookean", "mooney_rivlin": "Mooney-Rivlin", "gent": "Gent", "ogden": "Ogden"}
    for law, name in names.items():
        substeps = 320 if law == "gent" else 192
        yield RubberCase(f"{worlds:,} balloons of {name} rubber", schedule, worlds, law, substeps=substeps)
