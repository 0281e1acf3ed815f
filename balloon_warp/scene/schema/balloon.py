"""Balloons: their meshes, their springs and what fills them."""

import itertools
from pathlib import Path
from typing import Literal, Self

from pydantic import InstanceOf, model_validator

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.units import Unit
from balloon_warp.scene.schema.fields import (
    Color,
    Index,
    Keyframe,
    Keyframed,
    LawTables,
    NonNegative,
    Positive,
    Real,
    Table,
    UnitInterval,
    Vector,
    field_of,
    optional_field_of,
)


class Stiffness(Table):
    """Spring constants k [N/m] of the three kinds of springs (paper, figure 3)."""

    structural: float = field_of("structural")
    shear: float = field_of("shear")
    flexion: float = field_of("flexion")
    torsion: float = field_of("torsion")
    variation: UnitInterval = 0.0
    """each spring's constant is drawn uniformly from k (1 - variation) to k (1 + variation)"""
    seed: Index = 0
    """of the draws"""
    gradient: tuple[NonNegative, NonNegative] = (1.0, 1.0)
    """factors on the constants of springs at the balloon's lowest and highest coordinate, and linear between them"""
    gradient_axis: Literal["X", "Y", "Z"] = "Y"
    """of the scene, along which they change; where the middles of springs are at the start counts"""
    viscosity: float = field_of("viscosity")
    yield_stretch: float | None = optional_field_of("yield_stretch")


class Inflation(Table):
    """What fills a balloon.

    - "normal_force", the paper's: each particle is pushed by 100 k_normal (A_p / A_total) along its normal [N].
    - "pressure": a given pressure acts on every face.
    - "gas": a sealed amount of gas does, whose pressure falls as it expands, and which has weight and buoyancy.
    """

    kind: Literal["normal_force", "pressure", "gas"] = "normal_force"
    k_normal: Keyframed = 0.2
    """of "normal_force"; a number or keyframes"""
    pressure: Keyframed = 0.0
    """of "pressure": above the air's [Pa]; a number or keyframes"""
    amount: NonNegative | None = None
    """of "gas", at the start [mol]; what `start_pressure` asks for when missing"""
    start_pressure: Real = 0.0
    """of "gas": above the air's, at the start [Pa]; 0 is in balance with springs at their rest lengths"""
    pump: Keyframed = 0.0
    """of "gas": what is pumped in, and if negative let out [mol/s]; a number or keyframes"""
    gamma: float = field_of("gamma")
    molar_mass: float = field_of("molar_mass")

    @property
    def keyframed(self) -> Literal["k_normal", "pressure", "pump"]:
        """which field its kind may change with time"""
        return KEYFRAMED_FIELDS[self.kind]

    @property
    def own_fields(self) -> tuple[str, ...]:
        """the fields that its kind has"""
        return FIELDS_OF_KINDS[self.kind]

    @property
    def has_keyframes(self) -> bool:
        """whether the field that may change is given as keyframes"""
        return isinstance(getattr(self, self.keyframed), list)

    @property
    def keyframes(self) -> list[Keyframe]:
        """That field as keyframes; a plain number is one keyframe."""
        value = getattr(self, self.keyframed)
        return value if isinstance(value, list) else [(0.0, value)]

    @model_validator(mode="after")
    def _fields_of_its_kind(self) -> Self:
        for kind, fields in FIELDS_OF_KINDS.items():
            for field in fields if kind != self.kind else ():
                if getattr(self, field) != type(self).model_fields[field].default:
                    raise ValueError(f'{field}: needs kind = "{kind}" (got kind = "{self.kind}")')
        return self

    @model_validator(mode="after")
    def _times_increase(self) -> Self:
        times = [time for time, _ in self.keyframes]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"{self.keyframed}: keyframe times must increase (got {times})")
        return self


FIELDS_OF_KINDS: dict[str, tuple[str, ...]] = {
    "normal_force": ("k_normal",),
    "pressure": ("pressure",),
    "gas": ("amount", "start_pressure", "pump", "gamma", "molar_mass"),
}
KEYFRAMED_FIELDS: dict[str, Literal["k_normal", "pressure", "pump"]] = {
    "normal_force": "k_normal",
    "pressure": "pressure",
    "gas": "pump",
}


class Balloon(Table):
    """A mesh that becomes a balloon."""

    mesh: Path | InstanceOf[PolygonMesh]
    """a mesh file, sought beside the scene file; from Python, a PolygonMesh too"""
    weld: bool = False
    """join faces where vertices of the mesh lie at exactly the same place, as along seams"""
    unit: Unit | None = None
    """of the mesh's coordinates; what its file says, and a meter where that says none, when missing"""
    name: str = ""
    """what its prim is called in the stage; the mesh's name when empty"""
    position: Vector = (0.0, 0.0, 0.0)
    """where the mesh's origin goes [m]"""
    rotation: Vector = (0.0, 0.0, 0.0)
    """about x, then y, then z [degrees], before `position`"""
    scale: Positive = 1.0
    """factor on the mesh's size, before `rotation`"""
    mass: float = field_of("mass")
    helium: float = field_of("helium")
    damping: float = field_of("damping")
    drag_coefficient: float = field_of("drag_coefficient")
    stiffness: Stiffness = Stiffness()
    inflation: Inflation = Inflation()
    fixed: list[Index] = []
    """particles that do not move, by the order of the file's vertices"""
    color: Color | None = None
    """linear RGB; one of the palette when missing"""
    law: LawTables = {}
