"""Balloons: their meshes and their springs."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, InstanceOf, model_validator

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.from_python import is_mesh, mesh_from
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.parts import Taken
from balloon_warp.mesh.prepare import LARGEST_GAP, LEAST_GAP, Holes, Parts, Treatment
from balloon_warp.mesh.units import Unit, UpAxis
from balloon_warp.scene.pinned import pinned_by, pins_of, weighed_by
from balloon_warp.scene.schema.fields import (
    Color,
    Index,
    LawTables,
    NonNegative,
    Positive,
    Prim,
    Rule,
    Table,
    UnitInterval,
    Vector,
    field_of,
    optional_field_of,
)
from balloon_warp.scene.schema.inflation import Inflation, Neck
from balloon_warp.scene.schema.material import Material


class Stiffness(Table):
    """Spring constants k [N/m] of the three kinds of springs (paper, figure 3)."""

    structural: float = field_of("structural")
    """along the edges of faces [N/m]; 20.0 when missing"""
    shear: float = field_of("shear")
    """across faces [N/m]; 10.0 when missing"""
    flexion: float = field_of("flexion")
    """past one particle, against bending [N/m]; 2.0 when missing"""
    torsion: float = field_of("torsion")
    """of each edge between two faces, against a change of the angle between them [N m/rad]; 0.0 when missing"""
    variation: UnitInterval = 0.0
    """each spring's constant is drawn uniformly from k (1 - variation) to k (1 + variation)"""
    seed: Index = 0
    """another seed draws other constants"""
    gradient: tuple[NonNegative, NonNegative] = (1.0, 1.0)
    """factors on the constants of springs at the balloon's lowest and highest coordinate, and linear between them"""
    gradient_axis: Literal["X", "Y", "Z"] = "Y"
    """the axis of the scene along which they change; what counts is where the middle of a spring is at the start"""
    weights: list[NonNegative] | dict[str, NonNegative] | Rule | None = None
    """a number for each vertex of the file, or for groups of the mesh by their names, and 1 elsewhere: a spring's
    constant is multiplied by the mean of those at its ends. From Python also a function that takes the mesh's own
    points, shape (n, 3), and gives the number of each, shape (n,)"""
    viscosity: float = field_of("viscosity")
    """damping constant of each spring along it, over its spring constant (Tarantino 1996) [s]; 0.0 when missing"""
    yield_stretch: float | None = optional_field_of("yield_stretch")
    """length over rest length from which on a spring pulls no more (Tarantino 1996) [1]"""
    even: bool = False
    """weigh each spring by the area beside it, so that all together are as stiff everywhere and in all directions,
    however faces divide the surface; and put the mass where springs are stiff, which makes for a long step. Else each
    spring has the constant of its kind, and each particle the same mass"""
    thin: Literal["alike", "softer", "tied"] = "alike"
    """thin parts: "alike" takes the same constants everywhere, so that a pressure stretches thin parts less, in
    proportion to how thick they are; "softer" takes smaller ones there, so that all parts stretch nearly alike; "tied"
    has springs across them, from wall to wall, so that legs bear and thin walls do not swell into pillows"""


def _mesh_of(given: Any) -> Any:
    """Make a mesh of what Python has for a mesh; a file's name, and what can be none, stay as they are."""
    return mesh_from(given) if is_mesh(given) else given


class Balloon(Table):
    """A mesh that becomes a balloon."""

    mesh: Annotated[Path | InstanceOf[PolygonMesh], BeforeValidator(_mesh_of)]
    """a mesh file, sought beside the scene file; from Python also a PolygonMesh, a trimesh.Trimesh, or points and
    faces"""
    prim: Prim | None = None
    """of a USD stage, the path of the mesh to take, such as "/Room/Wall0", or of what has meshes below it; or a list of
    such paths. When missing, all meshes that are visible and of purpose "default" or "render" """
    weld: bool | Literal["auto"] | Annotated[float, Field(ge=LEAST_GAP, le=LARGEST_GAP)] = "auto"
    """join faces along seams, where open edges meet, from end to end: "auto" where they lie within a millionth of the
    mesh's size of each other, a number within that part of it. true does so wherever vertices are at exactly the same
    place; false nowhere"""
    holes: Holes = "cap"
    """close holes in the mesh's surface, such as pinholes and eye sockets, or "keep" them; openings such as the rim of
    a bowl or a sleeve always stay"""
    parts: Parts = "held"
    """hold parts of the mesh that share no vertex together by springs, of the structural kind, or leave them "free" """
    taken: Taken = "all"
    """which parts of the mesh the balloon is made of: "all", those that are "closed", without loose ribbons such as
    hair, or the "largest" by area"""
    unit: Unit | None = None
    """unit of the mesh's numbers; if missing, the one that its file names, else the meter"""
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
    up: UpAxis | None = None
    """the axis of the mesh's file that points up; if missing, the one that the file names, else "Y". The mesh is turned
    so that it points up in the scene"""
    scale: Positive = 1.0
    """factor on the mesh's size, before `rotation`"""
    mass: float = field_of("mass")
    """of the whole balloon, shared alike by its particles [kg]; 0.1 when missing"""
    helium: float = field_of("helium")
    """lift for each kilogram of balloon, against gravity's 9.81 [N/kg]; 0.0 when missing"""
    damping: float = field_of("damping")
    """drag of the whole balloon for each m/s, shared like the mass [N s/m]; 0.1 when missing"""
    drag_coefficient: float = field_of("drag_coefficient")
    """C_d of 1/2 density C_d A u^2, as for a sphere, u the speed relative to the air [1]; 0.0 when missing"""
    face_drag: float = field_of("face_drag")
    """C_n of each face in the air: 1/2 density C_n A |u| u_n against the part of u along its normal, which is lift and
    drag [1]; 0.0 when missing"""
    face_friction: float = field_of("face_friction")
    """C_t of the same along the face [1]; 0.0 when missing"""
    friction: float | None = optional_field_of("balloon_friction")
    """Coulomb's coefficient; where two things meet, the geometric mean of both counts; if missing, that of the other
    thing alone, or between balloons `touch.friction` [1]"""
    stiffness: Stiffness = Stiffness()
    """Spring constants k [N/m] of the three kinds of springs (paper, figure 3)."""
    springs: Path | None = None
    """a .npz file, sought beside the scene file, that says which springs there are, in place of the mesh's own: `pairs`
    of particles, shape (m, 2); `rest_lengths` in the mesh's unit; and `constants` [N/m], which a later change of
    `stiffness` multiplies"""
    material: Material = Material()
    """What the balloon is made of: springs, as in the paper, or rubber or film that has a thickness."""
    inflation: Inflation = Inflation()
    """What fills a balloon."""
    neck: Neck | None = None
    """The neck of a balloon with gas that is let go: open, gas leaves through it in a jet, which drives the balloon."""
    fixed: Annotated[list[Index | Annotated[str, Field(min_length=1)]], BeforeValidator(pins_of)] = []
    """particles that do not move: by the order of the file's vertices, counted from 0, or all of a group of the mesh,
    by its name (`g` and `o` of an OBJ file, subsets of USD). From Python also a mask, or a function that takes the
    mesh's own points, shape (n, 3), and says yes or no of each, shape (n,)"""
    color: Color | None = None
    """linear RGB; when missing, what the mesh's file says, colors or images, else one of the palette"""
    look: Literal["latex", "foil"] | None = None
    """what it is drawn as, thin rubber that light shines through or foil, which mirrors; when missing, latex, but foil
    where the material's preset is foil or nylon, and an opaque skin where the color is the mesh's own"""
    print: Path | None = None
    """an image, such as a .png, sought beside the scene file: it is printed on the balloon, in place of its color,
    where the mesh's texture coordinates say"""
    law: LawTables = {}
    """parameters of laws of one's own that are the balloon's, by law and name"""

    @property
    def looks_like(self) -> Literal["latex", "foil"]:
        """Look of the balloon, or that of its material."""
        return self.look or ("foil" if self.material.preset in ("foil", "nylon") else "latex")

    @property
    def treatment(self) -> Treatment:
        """Treatment of the mesh's seams, holes and parts."""
        return Treatment(self.weld, self.holes, self.parts, self.taken)

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
        """Turn a function of points into what it says, so that a scene can be written down."""
        if not isinstance(given, dict) or "mesh" not in given:
            return given
        for field in ("fixed", "stiffness.weights", "material.weights"):
            table, _, of_table = field.partition(".")
            holder = given.get(table) if of_table else given
            rule = value_in(holder, of_table or table)
            if not callable(rule):
                continue
            try:
                points = load_mesh(given["mesh"], given.get("prim")).points
                if of_table:
                    given = {**given, table: with_value(holder, of_table, weighed_by(rule, points))}
                else:
                    given = {**given, table: pinned_by(rule, points)}
            except InputError as mistake:
                raise ValueError(f"{field}: {mistake}") from None
        return given


def value_in(given: Any, name: str) -> Any:
    """Return a field of what is given as a table, or as an object."""
    return given.get(name) if isinstance(given, dict) else getattr(given, name, None)


def with_value(given: Any, name: str, value: Any) -> dict[str, Any]:
    """Return the same as a table with another value of a field, which is checked like the others."""
    table = given if isinstance(given, dict) else {field: getattr(given, field) for field in given.model_fields_set}
    return {**table, name: value}
