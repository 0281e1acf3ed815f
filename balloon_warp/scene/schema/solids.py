"""Solids: obstacles, free bodies, spheres, strings and outer forces."""

import itertools
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, InstanceOf, model_validator

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.load import is_mesh, mesh_from
from balloon_warp.mesh.polygon_mesh import Unit, UpAxis
from balloon_warp.scene.presets import pins_of
from balloon_warp.scene.schema.fields import (
    Color,
    Index,
    LawTables,
    NonNegative,
    Positive,
    Prim,
    Table,
    UnitInterval,
    Vector,
)

ShapeKind = Literal["box", "capsule", "plane", "mesh"]
FIELDS_OF_SHAPES: dict[ShapeKind, tuple[str, ...]] = {
    "box": ("size",),
    "capsule": ("radius", "length"),
    "plane": (),
    "mesh": ("mesh", "prim", "unit", "up", "scale"),
}
"""Fields that only some shapes have"""


def _mesh_of(given: Any) -> Any:
    """Convert a mesh-like Python value to a mesh.

    File names and values of other types pass unchanged.
    """
    return mesh_from(given) if is_mesh(given) else given


class Solid(Table):
    """Shape and placement of a solid."""

    shape: ShapeKind = "box"
    """Shape; when left out, it follows from the fields that are given. A "plane" fills the half space below it; a
    "capsule" stands along the up axis, as a plane's normal does; a "mesh" that is not closed is a thin sheet, and so is
    an obstacle's mesh whose faces look inward: a room"""
    size: tuple[Positive, Positive, Positive] = (1.0, 1.0, 1.0)
    """Edge lengths of a box [m]"""
    radius: Positive = 0.1
    """Radius of a capsule [m]"""
    length: NonNegative = 1.0
    """Distance between the centers of a capsule's two ends [m]; 0 makes it a ball"""
    mesh: Annotated[Path | InstanceOf[PolygonMesh] | None, BeforeValidator(_mesh_of)] = None
    """Mesh file, sought beside the scene file. In Python also a PolygonMesh, a trimesh.Trimesh, or points and faces"""
    prim: Prim | None = None
    """Object of the mesh file, or a list of several: in a USD stage the path of a prim, such as "/Room/Wall0", or of
    what it stands in; in an OBJ file an object or a group, in a glTF file a node or a mesh, by name. When missing, all
    that the file shows: of a stage, what is visible and of purpose "default" or "render" """
    unit: Unit | None = None
    """Unit of the mesh's coordinates; when missing, the unit in the mesh file, else the meter"""
    up: UpAxis | None = None
    """Up axis of the mesh file; when missing, the one in the file, else "Y". The mesh is turned so that this axis
    points up in the scene"""
    scale: Positive = 1.0
    """Factor on the mesh's size"""
    position: Vector = (0.0, 0.0, 0.0)
    """Position of the center, of a plane's surface, or of the mesh's origin [m]"""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Rotation about x, then y, then z, applied before `position` [degrees]"""

    @model_validator(mode="before")
    @classmethod
    def _shape_of_what_is_given(cls, given: Any) -> Any:
        if not isinstance(given, dict) or given.get("shape") is not None:
            return given
        fitting = (shape for shape, fields in FIELDS_OF_SHAPES.items() if not given.keys().isdisjoint(fields))
        return given | {"shape": next(fitting, "box")}

    @model_validator(mode="after")
    def _fields_of_its_shape(self) -> Self:
        for shape, fields in FIELDS_OF_SHAPES.items():
            for field in fields if shape != self.shape else ():
                if getattr(self, field) != type(self).model_fields[field].default:
                    raise ValueError(f'{field}: needs shape = "{shape}" (got shape = "{self.shape}")')
        if self.shape == "mesh" and self.mesh is None:
            raise ValueError('mesh: is missing; shape = "mesh" needs a mesh file')
        return self


Moved = tuple[NonNegative, Vector] | tuple[NonNegative, Vector, Vector]
"""Time [s], shift from `position` [m], and rotation on top of `rotation` [degrees]"""


class Obstacle(Solid):
    """Rigid obstacle that balloons and spheres cannot enter: fixed, or moved as the scene says, whatever pushes it."""

    motion: Annotated[list[Moved], Field(min_length=1)] | None = None
    """Keyframes [[time, shift], ...] or [[time, shift, turn], ...]: shifts from `position` [m], turns on top of
    `rotation` about x, then y, then z [degrees]; linear between them, and constant before the first and after the last.
    When missing, a mesh of a USD stage moves by its time samples"""
    friction: NonNegative = 0.5
    """Coulomb friction coefficient [1]"""
    restitution: UnitInterval = 0.3
    """Coefficient of restitution for spheres [1]"""
    thickness: NonNegative | None = None
    """Distance from the surface at which balloons are held, half the thickness of a sheet [m]; 0 when missing, and a
    thousandth of its size for a sheet"""
    name: str = ""
    """Name of the prim in the stage; the shape's name when empty"""
    color: Color | None = None
    """Linear RGB, or a color of the web, "red" or "#ff8000"; when missing, the color in the mesh file, else gray"""

    @model_validator(mode="after")
    def _times_increase(self) -> Self:
        times = [keyframe[0] for keyframe in self.motion or ()]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"motion: keyframe times must increase (got {times})")
        return self


class Body(Solid):
    """Free rigid body, with mass and inertia: balloons press on it and carry it.

    It falls, turns and meets spheres, obstacles, the ground and other bodies.
    """

    shape: Literal["box", "capsule", "mesh"] = "box"  # pyright: ignore[reportIncompatibleVariableOverride]
    """Shape; when left out, it follows from the fields that are given. A "capsule" stands along the up axis; a "mesh"
    that is not closed is a sheet, and needs a thickness"""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity of the center of mass at the start [m/s]"""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """Angular velocity at the start about the center of mass, along the axes of the scene [rad/s]"""
    mass: Positive | None = None
    """Mass [kg]; when missing, it follows from `density`, or is 1 kg"""
    density: Positive | None = None
    """Density of the material that fills the body, or of a sheet's material [kg/m^3]; instead of `mass`"""
    friction: NonNegative = 0.5
    """Coulomb friction coefficient; a contact takes the geometric mean of both, if a balloon has one of its own [1]"""
    restitution: UnitInterval = 0.3
    """Coefficient of restitution; a contact takes the geometric mean of both [1]"""
    thickness: NonNegative | None = None
    """Distance from the surface at which others are held, half the thickness of a sheet [m]; 0 when missing"""
    name: str = ""
    """Name of the prim in the stage; the shape's name when empty"""
    color: Color | None = None
    """Linear RGB, or a color of the web, "red" or "#ff8000"; when missing, the color in the mesh file, else a color of
    the palette"""

    @model_validator(mode="after")
    def _weighs_something(self) -> Self:
        if self.mass is not None and self.density is not None:
            raise ValueError(f"density: must be left out where mass is given (got {self.density:g} and {self.mass:g})")
        return self


def _ends_after_its_start(lasting: Any) -> Any:
    if lasting.end is not None and lasting.end < lasting.start:
        raise ValueError(f"end: must not come before the start, {lasting.start:g} s (got {lasting.end:g} s)")
    return lasting


class Sphere(Table):
    """A rigid sphere that collides with balloons, spheres, obstacles and the ground."""

    radius: Positive = 0.15
    """Radius [m]"""
    mass: Positive = 1.0
    """Mass [kg]"""
    position: Vector
    """Position of the center at the start [m]"""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity at the start [m/s]"""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """Angular velocity at the start [rad/s]; it has no effect without friction"""
    penalty: NonNegative = 1.0
    """Contact force on the sphere as a multiple of the touching particle's inflation force; it has no effect with
    `contact = "impulse"`"""
    restitution: UnitInterval = 0.3
    """Coefficient of restitution between spheres; of two different ones, their geometric mean [1]"""
    friction: NonNegative = 0.0
    """Coulomb friction coefficient; a contact takes the geometric mean of both, so that 0 slides on everything and does
    not turn. Against balloons it acts with `contact = "impulse"`, or where the sphere is small and touches faces [1]"""
    color: Color | None = None
    """Linear RGB, or a color of the web, "red" or "#ff8000"; a color of the palette when missing"""
    start: NonNegative = 0.0
    """Time at which the sphere appears, at its position and velocity [s]; until then nothing touches it"""
    end: NonNegative | None = None
    """Time at which the sphere disappears [s]; never when missing"""

    law: LawTables = {}
    """Parameters of phases of the step that are of spheres, by phase and name"""

    _lives = model_validator(mode="after")(_ends_after_its_start)


class String(Table):
    """A string from an anchor to one particle: it pulls when taut and does not push."""

    anchor: Vector
    """Position of the anchored end [m]; with `obstacle` or `body`, in its own axes from its `position`"""
    obstacle: Index | None = None
    """Obstacle that carries the anchor, by its index in the scene: the anchor moves and turns with it. Fixed in the
    scene when missing"""
    body: Index | None = None
    """Free body that carries the anchor, by its index in the scene, and that the string pulls as hard as the balloon:
    a basket"""
    motion: Annotated[list[tuple[NonNegative, Vector]], Field(min_length=1)] | None = None
    """Keyframes [[time, shift], ...]: shifts from `anchor` [m], linear between them, and constant before the first and
    after the last, as of a hand"""
    balloon: Index = 0
    """Balloon that the string holds, by its index in the scene"""
    particle: Index | Literal["highest", "lowest"] = "lowest"
    """Particle that the string holds, by the order of the file's vertices, counted from 0, or by its place along the up
    axis at the start"""
    length: Positive | None = None
    """Length [m]; the distance from anchor to particle at the start when missing"""
    stiffness: Positive = 20.0
    """Spring constant [N/m]"""
    start: NonNegative = 0.0
    """Time at which the string is tied [s]"""
    end: NonNegative | None = None
    """Time at which the string is cut [s]; never when missing"""
    knot: bool = True
    """Draw the balloon's neck and a knot at the string; they are not simulated, and foil has none"""

    _lives = model_validator(mode="after")(_ends_after_its_start)

    @property
    def moves(self) -> bool:
        """Return whether the anchor may move."""
        return any(each is not None for each in (self.obstacle, self.body, self.motion))

    @model_validator(mode="after")
    def _follows_one(self) -> Self:
        followed = [name for name in ("obstacle", "body", "motion") if getattr(self, name) is not None]
        if len(followed) > 1:
            raise ValueError(f"{followed[1]}: an anchor follows an obstacle, a body or keyframes; expected one of them")
        times = [time for time, _ in self.motion or ()]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"motion: keyframe times must increase (got {times})")
        return self


Particles = list[Index | Annotated[str, Field(min_length=1)]]


class Force(Table):
    """Outer force on some of a balloon's particles, such as the push of a hand or of a motor."""

    balloon: Index = 0
    """Balloon that the force acts on, by its index in the scene"""
    particles: Annotated[Annotated[Particles, Field(min_length=1)], BeforeValidator(pins_of)] | None = None
    """Particles that share the force by their masses: vertices of the file, counted from 0, or all of a group of the
    mesh, by its name; all of the balloon when missing. Fixed ones take no share. In Python also a mask"""
    newtons: Vector = (0.0, 0.0, 0.0)
    """Force on them together, along the axes of the scene [N]"""
