"""What has a shape and a place: a box, a capsule, or a mesh."""

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
"""the fields that only some shapes have"""


def _mesh_of(given: Any) -> Any:
    """Make a mesh of what Python has for a mesh; a file's name, and what can be none, stay as they are."""
    return mesh_from(given) if is_mesh(given) else given


class Solid(Table):
    """Its shape, and where it is."""

    shape: ShapeKind = "box"
    """when left out, the one that has the fields that are given. A "plane" fills all that is below it; a "capsule"
    stands along the up axis, as a plane's normal does; a "mesh" that is not closed is a thin sheet, and so
    is that of an obstacle whose faces look inward: a room"""
    size: tuple[Positive, Positive, Positive] = (1.0, 1.0, 1.0)
    """edges of a box [m]"""
    radius: Positive = 0.1
    """of a capsule [m]"""
    length: NonNegative = 1.0
    """of a capsule, between the centers of its two ends [m]; 0 makes it a ball"""
    mesh: Annotated[Path | InstanceOf[PolygonMesh] | None, BeforeValidator(_mesh_of)] = None
    """a mesh file, sought beside the scene file; from Python also a PolygonMesh, a trimesh.Trimesh, or points and
    faces"""
    prim: Prim | None = None
    """of a USD stage, the path of the mesh to take, such as "/Room/Wall0", or of what has meshes below it; or a list of
    such paths. When missing, all meshes that are visible and of purpose "default" or "render" """
    unit: Unit | None = None
    """unit of the mesh's numbers; if missing, the one that its file names, else the meter"""
    up: UpAxis | None = None
    """the axis of the mesh's file that points up; if missing, the one that the file names, else "Y". The mesh is turned
    so that it points up in the scene"""
    scale: Positive = 1.0
    """factor on the mesh's size"""
    position: Vector = (0.0, 0.0, 0.0)
    """of its center, a plane's surface or the mesh's origin [m]"""
    rotation: Vector = (0.0, 0.0, 0.0)
    """about x, then y, then z [degrees], before `position`"""

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
