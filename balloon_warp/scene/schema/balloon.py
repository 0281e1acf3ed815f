"""Balloons: their meshes and their springs."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

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
from balloon_warp.scene.schema.material import Material, material_named


def _named(given: Any) -> Any:
    """Return the table of a material that is a name; all else as it is."""
    return material_named(given) if isinstance(given, str) else given


class Stiffness(Table):
    """Spring constants k [N/m] of the three kinds of springs (paper, figure 3)."""

    structural: float = field_of("structural")
    """Spring constant k along the edges of faces [N/m]; 20.0 when missing"""
    shear: float = field_of("shear")
    """Spring constant k across faces [N/m]; 10.0 when missing"""
    flexion: float = field_of("flexion")
    """Spring constant k past one particle, against bending [N/m]; 2.0 when missing"""
    torsion: float = field_of("torsion")
    """Torsional stiffness of each edge between two faces, against a change of the dihedral angle [N m/rad]; 0.0 when
    missing"""
    variation: UnitInterval = 0.0
    """Random scatter of spring constants: each is drawn uniformly from k (1 - variation) to k (1 + variation)"""
    seed: Index = 0
    """Seed of the random spring constants"""
    gradient: tuple[NonNegative, NonNegative] = (1.0, 1.0)
    """Factors on the spring constants at the balloon's lowest and highest coordinate, linear between them"""
    gradient_axis: Literal["X", "Y", "Z"] = "Y"
    """Axis of the scene along which `gradient` acts, by the midpoint of each spring at the start"""
    weights: list[NonNegative] | dict[str, NonNegative] | Rule | None = None
    """Factor on the spring constants for each vertex of the file, or for groups of the mesh by their names, 1
    elsewhere; a spring takes the mean of its two ends. In Python also a function from the mesh's own points, shape (n,
    3), to one factor each, shape (n,)"""
    viscosity: float = field_of("viscosity")
    """Damping constant along a spring over its spring constant (Tarantino 1996) [s]; 0.0 when missing"""
    yield_stretch: float | None = optional_field_of("yield_stretch")
    """Length over rest length above which the spring force stays constant (Tarantino 1996) [1]"""
    even: bool = False
    """Weigh each spring by the area beside it, so that stiffness is uniform and isotropic on any mesh, and distribute
    mass in proportion to stiffness, which allows a long step. Otherwise each spring has the constant of its kind and
    each particle the same mass"""
    thin: Literal["alike", "softer", "tied"] = "alike"
    """Treatment of thin parts. "alike": the same spring constants everywhere; pressure stretches a thin part less, in
    proportion to its thickness. "softer": smaller constants in thin parts; all parts stretch nearly alike. "tied":
    springs across thin parts, from wall to wall; legs bear load and thin walls do not swell into pillows"""


def _mesh_of(given: Any) -> Any:
    """Convert a mesh-like Python value to a mesh.

    File names and values of other types pass unchanged.
    """
    return mesh_from(given) if is_mesh(given) else given


class Balloon(Table):
    """A mesh that becomes a balloon."""

    mesh: Annotated[Path | InstanceOf[PolygonMesh], BeforeValidator(_mesh_of)]
    """Mesh file, sought beside the scene file. In Python also a PolygonMesh, a trimesh.Trimesh, or points and faces"""
    prim: Prim | None = None
    """Object of the mesh file, or a list of several: in a USD stage the path of a prim, such as "/Room/Wall0", or of
    what it stands in; in an OBJ file an object or a group, in a glTF file a node or a mesh, by name. When missing, all
    that the file shows: of a stage, what is visible and of purpose "default" or "render" """
    weld: bool | Literal["auto"] | Annotated[float, Field(ge=LEAST_GAP, le=LARGEST_GAP)] = "auto"
    """Weld seams, where open edges meet from end to end. "auto": within a millionth of the mesh's size; a number:
    within that fraction of it; true: wherever vertices coincide exactly; false: nowhere"""
    holes: Holes = "cap"
    """Close holes in the mesh's surface, such as pinholes and eye sockets, or "keep" them. Openings such as the rim of
    a bowl or a sleeve always stay"""
    parts: Parts = "held"
    """Tie parts of the mesh that share no vertex together by structural springs, or leave them "free"; `taken` chooses
    parts"""
    taken: Taken = "all"
    """Parts of the mesh that make up the balloon: "all", the "closed" ones, without loose ribbons such as hair, or the
    "largest" by area; --parts of commands"""
    unit: Unit | None = None
    """Unit of the mesh's coordinates; when missing, the unit in the mesh file, else the meter"""
    name: str = ""
    """Name of the prim in the stage; the mesh's name when empty"""
    position: Vector = (0.0, 0.0, 0.0)
    """Position of the mesh's origin [m]"""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Rotation about x, then y, then z, applied before `position` [degrees]"""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity of the whole balloon at the start [m/s]"""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """Angular velocity at the start about the center of mass, along the axes of the scene [rad/s]"""
    up: UpAxis | None = None
    """Up axis of the mesh file; when missing, the one in the file, else "Y". The mesh is turned so that this axis
    points up in the scene"""
    scale: Positive = 1.0
    """Factor on the mesh's size, applied before `rotation`"""
    mass: float = field_of("mass")
    """Mass of the whole balloon, shared equally by its particles [kg]; 0.1 when missing"""
    helium: float = field_of("helium")
    """Buoyant acceleration; above `gravity` the balloon rises [m/s^2]; 0.0 when missing"""
    damping: float = field_of("damping")
    """Linear drag coefficient of the whole balloon, distributed like the mass [N s/m]; 0.1 when missing"""
    drag_coefficient: float = field_of("drag_coefficient")
    """Drag coefficient C_d of 1/2 density C_d A u^2, as for a sphere, at airspeed u [1]; 0.0 when missing"""
    face_drag: float = field_of("face_drag")
    """Normal coefficient C_n of each face in the air: 1/2 density C_n A |u| u_n against the part of u along the face's
    normal; it gives lift and drag [1]; 0.0 when missing"""
    face_friction: float = field_of("face_friction")
    """Tangential coefficient C_t of the air's force along each face, with C_t in place of C_n [1]; 0.0 when missing"""
    friction: float | None = optional_field_of("balloon_friction")
    """Coulomb friction coefficient; a contact takes the geometric mean of both. When missing, the other thing's
    coefficient counts alone, and between balloons `touch.friction` [1]"""
    stiffness: Stiffness = Stiffness()
    """Spring constants k [N/m] of the three kinds of springs (paper, figure 3)."""
    springs: Path | None = None
    """File of springs (.npz), sought beside the scene file, in place of the mesh's own springs: `pairs` of particles,
    shape (m, 2); `rest_lengths` in the mesh's unit; and `constants` [N/m], which a later change of `stiffness`
    multiplies"""
    material: Annotated[Material, BeforeValidator(_named)] = Material()
    """Material of the balloon: springs, as in the paper, or rubber or film with a thickness."""
    inflation: Inflation = Inflation()
    """Inflation of a balloon: a pressure, a sealed gas, or the paper's normal forces."""
    neck: Neck | None = None
    """The neck of a balloon with gas that is let go: open, gas leaves through it in a jet, which drives the balloon."""
    fixed: Annotated[list[Index | Annotated[str, Field(min_length=1)]], BeforeValidator(pins_of)] = []
    """Particles that do not move: vertices of the file, counted from 0, or all of a group of the mesh, by its name (`g`
    and `o` of an OBJ file, subsets of USD). In Python also a mask, or a function from the mesh's own points, shape (n,
    3), to a mask, shape (n,)"""
    color: Color | None = None
    """Linear RGB, or a color of the web, "red" or "#ff8000"; when missing, the colors or images of the mesh file, else
    a color of the palette"""
    look: Literal["latex", "foil"] | None = None
    """Appearance: translucent latex, or foil, which mirrors. When missing, latex, but foil where the material's preset
    is foil or nylon, and an opaque skin where the color is the mesh's own"""
    print: Path | None = None
    """Image file, such as a .png, sought beside the scene file, printed on the balloon in place of its color by the
    mesh's texture coordinates"""
    law: LawTables = {}
    """Balloon parameters of user-defined laws, by law and name"""

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
    def _parts_or_taken(cls, given: Any) -> Any:
        for field, other, words in (("parts", "taken", get_args(Taken)), ("taken", "parts", get_args(Parts))):
            found = given.get(field) if isinstance(given, dict) else None
            if isinstance(found, str) and found in words:
                raise ValueError(f'{field}: "{found}" is a value of {other}; expected {other} = "{found}"')
        return given

    @model_validator(mode="before")
    @classmethod
    def _without_rules(cls, given: Any) -> Any:
        """Evaluate functions of points, so that a scene can be written down."""
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
    """Return a field of a table, or of an object."""
    return given.get(name) if isinstance(given, dict) else getattr(given, name, None)


def with_value(given: Any, name: str, value: Any) -> dict[str, Any]:
    """Return the same as a table with another value of a field, which is checked like the others."""
    table = given if isinstance(given, dict) else {field: getattr(given, field) for field in given.model_fields_set}
    return {**table, name: value}
