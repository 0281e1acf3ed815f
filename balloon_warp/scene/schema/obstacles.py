"""What is in the way of balloons and goes where it is told, whatever pushes it."""

import itertools
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, InstanceOf, model_validator

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.from_python import is_mesh, mesh_from
from balloon_warp.mesh.units import Unit
from balloon_warp.scene.schema.fields import Color, NonNegative, Positive, Table, UnitInterval, Vector

ShapeKind = Literal["box", "capsule", "plane", "mesh"]
Moved = tuple[NonNegative, Vector] | tuple[NonNegative, Vector, Vector]
"""a time [s], a shift from `position` [m], and a turn on top of `rotation` [degrees]"""
FIELDS_OF_SHAPES: dict[ShapeKind, tuple[str, ...]] = {
    "box": ("size",),
    "capsule": ("radius", "length"),
    "plane": (),
    "mesh": ("mesh", "unit", "scale"),
}
"""the fields that only some shapes have"""


def _mesh_of(given: Any) -> Any:
    """What Python has for a mesh, as a mesh; a file's name, and what can be none, as it is."""
    return mesh_from(given) if is_mesh(given) else given


class Obstacle(Table):
    """A rigid thing that balloons and spheres cannot enter: it stays, or moves as it is told, whatever pushes it."""

    shape: ShapeKind = "box"
    """when left out, the one that has the fields that are given. A "plane" fills all that is below it; a "capsule"
    stands along the up axis, as a plane's normal does; a "mesh" that is not closed is a thin sheet"""
    size: tuple[Positive, Positive, Positive] = (1.0, 1.0, 1.0)
    """edges of a box [m]"""
    radius: Positive = 0.1
    """of a capsule [m]"""
    length: NonNegative = 1.0
    """of a capsule, between the centers of its two ends [m]; 0 makes it a ball"""
    mesh: Annotated[Path | InstanceOf[PolygonMesh] | None, BeforeValidator(_mesh_of)] = None
    """a mesh file, sought beside the scene file; from Python also a PolygonMesh, a trimesh.Trimesh, or points and
    faces"""
    unit: Unit | None = None
    """of the mesh's coordinates; what its file says, and a meter where that says none, when missing"""
    scale: Positive = 1.0
    """factor on the mesh's size"""
    position: Vector = (0.0, 0.0, 0.0)
    """of its center, a plane's surface or the mesh's origin [m]"""
    rotation: Vector = (0.0, 0.0, 0.0)
    """about x, then y, then z [degrees], before `position`"""
    motion: Annotated[list[Moved], Field(min_length=1)] | None = None
    """keyframes [[time, shift], ...] or [[time, shift, turn], ...]: shifts from `position` [m], turns on top of
    `rotation` about x, then y, then z [degrees]; linear between them, and still before the first and after the last.
    When missing, a mesh of a USD stage moves as the time samples there say"""
    friction: NonNegative = 0.5
    """Coulomb's coefficient, for balloons [1]"""
    restitution: UnitInterval = 0.3
    """rebound speed over impact speed, for spheres [1]"""
    thickness: NonNegative | None = None
    """how far from its surface balloons are held [m]: half of what a sheet is thick; 0 when missing, and a thousandth
    of its size for a sheet"""
    name: str = ""
    """what its prim is called in the stage; its shape when empty"""
    color: Color | None = None
    """linear RGB; gray when missing"""

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

    @model_validator(mode="after")
    def _times_increase(self) -> Self:
        times = [keyframe[0] for keyframe in self.motion or ()]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"motion: keyframe times must increase (got {times})")
        return self
