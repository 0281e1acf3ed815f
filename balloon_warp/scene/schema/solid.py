"""Solids with a shape and a place: a plane, a box, a capsule, or a mesh."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, InstanceOf, model_validator

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.from_python import is_mesh, mesh_from
from balloon_warp.mesh.units import Unit, UpAxis
from balloon_warp.scene.schema.fields import NonNegative, Positive, Prim, Table, Vector

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
