"""Balloons: their meshes, their springs and what fills them."""

import itertools
import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, InstanceOf, model_validator

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.from_python import is_mesh, mesh_from
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.prepare import Holes, Parts, Treatment, Weld
from balloon_warp.mesh.units import Unit
from balloon_warp.scene.pinned import pinned_by, pins_of, weighed_by
from balloon_warp.scene.schema.fields import (
    Color,
    Index,
    Keyframe,
    Keyframed,
    LawTables,
    NonNegative,
    Positive,
    Real,
    Rule,
    Table,
    UnitInterval,
    Vector,
    field_of,
    optional_field_of,
)
from balloon_warp.scene.schema.material import Material, without_rule


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
    weights: list[NonNegative] | dict[str, NonNegative] | Rule | None = None
    """a number for each vertex of the file, or for groups of the mesh by their names, and 1 elsewhere: a spring's
    constant is multiplied by the mean of those at its ends. From Python also a function that takes the mesh's own
    points, shape (n, 3), and gives the number of each, shape (n,)"""
    viscosity: float = field_of("viscosity")
    yield_stretch: float | None = optional_field_of("yield_stretch")
    thin: Literal["alike", "softer"] = "alike"
    """springs of thin parts: "alike" takes the same constants everywhere, so that a pressure stretches thin parts less,
    in proportion to how thick they are; "softer" takes smaller ones there, so that all parts stretch nearly alike"""


class Inflation(Table):
    """What fills a balloon.

    - "pressure": a given pressure acts on every face. On a closed mesh its forces add up to nothing.
    - "gas": a sealed amount of gas does, whose pressure falls as it expands, and which has weight and buoyancy.
    - "normal_force", the paper's: each particle is pushed by 100 k_normal (A_p / A_total) along its normal [N]. These
      forces do not add up to nothing, and what a k_normal does hangs on how the mesh is divided into faces.
    """

    kind: Literal["pressure", "gas", "normal_force"] = "pressure"
    """when left out, the kind that has the fields that are given; a pressure where none is"""
    pressure: Literal["auto"] | Keyframed = "auto"
    """of "pressure": above the air's [Pa]; a number or keyframes; or "auto", which rises within a second to what
    stretches the balloon by a quarter or so, whatever its size, its faces and its springs"""
    k_normal: Keyframed = 0.2
    """of "normal_force"; a number or keyframes"""
    amount: NonNegative | None = None
    """of "gas", at the start [mol]; what `start_pressure` asks for when missing"""
    start_pressure: Real = 0.0
    """of "gas": above the air's, at the start [Pa]; 0 is in balance with springs at their rest lengths"""
    pump: Keyframed = 0.0
    """of "gas": what is pumped in, and if negative let out [mol/s]; a number or keyframes"""
    pump_curve: list[tuple[NonNegative, NonNegative]] = []
    """of "gas": what a pump gives against a pressure, [[pressure, flow], ...], above the air's [Pa] and [mol/s]: linear
    between them, and nothing beyond the last"""
    breaths: float = field_of("fill_breaths")
    litres: float = field_of("fill_litres")
    moles: float = field_of("fill_moles")
    fill_time: float = field_of("fill_time")
    fill_to_pressure: float = field_of("fill_to_pressure")
    fill_to_diameter: float = field_of("fill_to_diameter")
    gamma: float = field_of("gamma")
    breathing_damping: float = field_of("breathing_damping")
    molar_mass: float = field_of("molar_mass")
    added_mass: float = field_of("added_mass")
    leak: float = field_of("leak")

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
    def is_automatic(self) -> bool:
        """whether its pressure is left to us"""
        return self.kind == "pressure" and self.pressure == "auto"

    @property
    def keyframes(self) -> list[Keyframe]:
        """That field as keyframes; a plain number is one keyframe, and NaN a pressure that is left to us."""
        if self.is_automatic:
            return [(0.0, 0.0), (AUTO_SECONDS, math.nan)]
        value = getattr(self, self.keyframed)
        return value if isinstance(value, list) else [(0.0, value)]

    @model_validator(mode="before")
    @classmethod
    def _kind_of_what_is_given(cls, given: Any) -> Any:
        if not isinstance(given, dict) or given.get("kind") is not None:
            return given
        fitting = (kind for kind, fields in FIELDS_OF_KINDS.items() if not given.keys().isdisjoint(fields))
        return given | {"kind": next(fitting, "pressure")}

    @model_validator(mode="after")
    def _fields_of_its_kind(self) -> Self:
        for kind, fields in FIELDS_OF_KINDS.items():
            for field in fields if kind != self.kind else ():
                if getattr(self, field) != type(self).model_fields[field].default:
                    raise ValueError(f'{field}: needs kind = "{kind}" (got kind = "{self.kind}")')
        return self

    @model_validator(mode="after")
    def _one_amount(self) -> Self:
        """One way of saying how much, and one of saying how fast."""
        for several in (MUCH, FAST):
            given = [field for field in several if getattr(self, field) not in (None, 0.0, [])]
            if len(given) > 1:
                raise ValueError(f"{given[1]}: says another way what {given[0]} says; expected one of both")
        return self

    @model_validator(mode="after")
    def _curve_rises(self) -> Self:
        pressures = [pressure for pressure, _ in self.pump_curve]
        if any(later <= earlier for earlier, later in itertools.pairwise(pressures)):
            raise ValueError(f"pump_curve: pressures must increase (got {pressures})")
        return self

    @model_validator(mode="after")
    def _times_increase(self) -> Self:
        times = [time for time, _ in self.keyframes]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"{self.keyframed}: keyframe times must increase (got {times})")
        return self


AUTO_SECONDS = 1.0
"""in which a pressure that is left to us rises"""
MUCH = ("amount", "breaths", "litres", "moles", "fill_to_pressure", "fill_to_diameter")
"""ways of saying how much gas there will be"""
FAST = ("pump", "pump_curve", "breaths", "litres", "moles")
"""ways of saying how fast it comes"""
FIELDS_OF_KINDS: dict[str, tuple[str, ...]] = {
    "normal_force": ("k_normal",),
    "pressure": ("pressure",),
    "gas": (
        *("amount", "start_pressure", "pump", "pump_curve"),
        *("breaths", "litres", "moles", "fill_time", "fill_to_pressure", "fill_to_diameter"),
        *("gamma", "breathing_damping", "molar_mass", "added_mass", "leak"),
    ),
}
KEYFRAMED_FIELDS: dict[str, Literal["k_normal", "pressure", "pump"]] = {
    "normal_force": "k_normal",
    "pressure": "pressure",
    "gas": "pump",
}


class Neck(Table):
    """The neck of a balloon with gas that is let go: open, gas leaves through it in a jet, which drives the balloon."""

    at: Index | Annotated[str, Field(min_length=1)] = "lowest"
    """where it is: the "lowest" or "highest" place along the up axis at the start, a vertex by the order of the file's,
    or the faces of a group of the mesh, by its name; the jet goes straight out from there"""
    diameter: float = field_of("neck_diameter")
    discharge: float = field_of("neck_discharge")
    opens: float = field_of("neck_opens")
    closes: float | None = optional_field_of("neck_closes")

    @model_validator(mode="after")
    def _closes_later(self) -> Self:
        if self.closes is not None and self.closes < self.opens:
            raise ValueError(f"closes: must not come before it opens, at {self.opens:g} s (got {self.closes:g} s)")
        return self


def _mesh_of(given: Any) -> Any:
    """What Python has for a mesh, as a mesh; a file's name, and what can be none, as it is."""
    return mesh_from(given) if is_mesh(given) else given


class Balloon(Table):
    """A mesh that becomes a balloon."""

    mesh: Annotated[Path | InstanceOf[PolygonMesh], BeforeValidator(_mesh_of)]
    """a mesh file, sought beside the scene file; from Python also a PolygonMesh, a trimesh.Trimesh, or points and
    faces"""
    weld: Weld = "auto"
    """join faces where vertices of the mesh lie at exactly the same place: along seams, open edges that do ("auto"),
    everywhere (true) or nowhere (false)"""
    holes: Holes = "cap"
    """close holes in the mesh's surface, such as pinholes and eye sockets, or "keep" them; openings such as the rim of
    a bowl or a sleeve always stay"""
    parts: Parts = "held"
    """hold parts of the mesh that share no vertex together by springs, of the structural kind, or leave them "free" """
    unit: Unit | None = None
    """of the mesh's coordinates; what its file says, and a meter where that says none, when missing"""
    name: str = ""
    """what its prim is called in the stage; the mesh's name when empty"""
    position: Vector = (0.0, 0.0, 0.0)
    """where the mesh's origin goes [m]"""
    rotation: Vector = (0.0, 0.0, 0.0)
    """about x, then y, then z [degrees], before `position`"""
    velocity: Vector = (0.0, 0.0, 0.0)
    """of the whole balloon at the start [m/s]"""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """at the start, about its center of mass, along the axes of the scene [rad/s]"""
    scale: Positive = 1.0
    """factor on the mesh's size, before `rotation`"""
    mass: float = field_of("mass")
    helium: float = field_of("helium")
    damping: float = field_of("damping")
    drag_coefficient: float = field_of("drag_coefficient")
    face_drag: float = field_of("face_drag")
    face_friction: float = field_of("face_friction")
    friction: float | None = optional_field_of("balloon_friction")
    stiffness: Stiffness = Stiffness()
    material: Material = Material()
    inflation: Inflation = Inflation()
    neck: Neck | None = None
    fixed: Annotated[list[Index | Annotated[str, Field(min_length=1)]], BeforeValidator(pins_of)] = []
    """particles that do not move: by the order of the file's vertices, or all of a group of the mesh, by its name (`g`
    and `o` of an OBJ file, subsets of USD). From Python also a mask, or a function that takes the mesh's own points,
    shape (n, 3), and says yes or no of each, shape (n,)"""
    color: Color | None = None
    """linear RGB; one of the palette when missing"""
    law: LawTables = {}
    """parameters of laws of one's own that are the balloon's, by law and name"""

    @property
    def treatment(self) -> Treatment:
        """what becomes of the mesh's seams, holes and parts"""
        return Treatment(self.weld, self.holes, self.parts)

    @model_validator(mode="after")
    def _one_mass(self) -> Self:
        if self.material.is_membrane and self.mass != type(self).model_fields["mass"].default:
            raise ValueError(
                f"mass: follows from the material's thickness and density (got {self.mass:g}); expected none, or "
                'material.kind = "springs"'
            )
        return self

    @model_validator(mode="after")
    def _neck_of_gas(self) -> Self:
        if self.neck and self.inflation.kind != "gas":
            raise ValueError(f'neck: needs inflation.kind = "gas" (got "{self.inflation.kind}")')
        return self

    @model_validator(mode="before")
    @classmethod
    def _without_rules(cls, given: Any) -> Any:
        """A function of points becomes what it says, so that a scene can be written down."""
        if not isinstance(given, dict) or "mesh" not in given:
            return given
        stiffness, material = given.get("stiffness"), given.get("material")
        weights = stiffness.get("weights") if isinstance(stiffness, dict) else getattr(stiffness, "weights", None)
        thickness = material.get("weights") if isinstance(material, dict) else None
        rules = ("fixed", given.get("fixed")), ("stiffness.weights", weights), ("material.weights", thickness)
        for field, rule in rules:
            if not callable(rule):
                continue
            try:
                points = load_mesh(given["mesh"]).points
                if field == "fixed":
                    given = {**given, "fixed": pinned_by(rule, points)}
                elif field == "material.weights":
                    given = {**given, "material": without_rule(material, points)}
                else:
                    given = {**given, "stiffness": {**dict(stiffness or {}), "weights": weighed_by(rule, points)}}
            except InputError as mistake:
                raise ValueError(f"{field}: {mistake}") from None
        return given
