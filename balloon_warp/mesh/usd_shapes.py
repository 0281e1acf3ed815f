"""Shapes of a USD stage that are no meshes, as meshes, in memory: cubes, spheres, cylinders, capsules, cones, planes.

So whoever reads a stage knows meshes alone. Other kinds of a stage's shapes are named.
"""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from balloon_warp.errors import InputError
from balloon_warp.mesh.plain_shapes import Faces, box_faces, capsule_faces, cylinder_faces, rectangle_faces
from balloon_warp.mesh.quad_sphere import quad_sphere
from balloon_warp.mesh.usd_instances import expand_instancers, share_nothing

CELLS = 12
"""Number of quads along a quarter of a sphere"""
STRETCHED = 1e-4
"""Difference between the scales of a shape's axes from which on it is no sphere or capsule"""


def _sphere(radius: float) -> Faces:
    made = quad_sphere(CELLS, radius)
    return Faces(made.points, made.face_vertex_counts, made.face_vertex_indices)


class Kind(NamedTuple):
    """A kind of shape."""

    attributes: tuple[str, ...]
    make: Callable[..., Faces]
    """Function of the values of the attributes, and of the axis, if it has one"""


SHAPES = {
    "Cube": Kind(("size",), box_faces),
    "Sphere": Kind(("radius",), _sphere),
    "Plane": Kind(("width", "length", "axis"), rectangle_faces),
    "Cylinder": Kind(
        ("radius", "height", "axis"), lambda radius, height, axis: cylinder_faces((radius, radius), height, axis)
    ),
    "Cylinder_1": Kind(
        ("radiusTop", "radiusBottom", "height", "axis"), lambda top, low, *more: cylinder_faces((top, low), *more)
    ),
    "Cone": Kind(("radius", "height", "axis"), lambda radius, *more: cylinder_faces((0.0, radius), *more)),
    "Capsule": Kind(("radius", "height", "axis"), lambda radius, *more: capsule_faces((radius, radius), *more)),
    "Capsule_1": Kind(
        ("radiusTop", "radiusBottom", "height", "axis"), lambda top, low, *more: capsule_faces((top, low), *more)
    ),
}
"""Shapes by their type's name in USD"""
ROUND = ("Sphere", "Capsule")
"""Shapes that pictures and checks take as they are, not as meshes"""


def as_meshes(stage: Usd.Stage, source: str, *, rounds: bool) -> list[str]:
    """Turn all shapes of a stage into meshes, and each instance of a PointInstancer into a prim, in memory.

    Args:
        stage: its session layer takes the changes.
        source: name of the file.
        rounds: whether spheres and capsules become meshes, too; otherwise only those stretched along an axis do.

    Returns:
        Sentences on PointInstancers that could not be taken.

    Raises:
        InputError: there are too many instances, or a size is not finite.
    """
    kinds = SHAPES if rounds else {name: kind for name, kind in SHAPES.items() if name not in ROUND}
    share_nothing(stage, lambda prim: prim.GetTypeName() in kinds or bool(UsdGeom.PointInstancer(prim)))
    _turn(stage, source, [prim for prim in stage.TraverseAll() if prim.GetTypeName() in kinds])
    sentences = expand_instancers(stage, source)
    if not rounds:
        _turn(
            stage, source, [prim for prim in stage.TraverseAll() if prim.GetTypeName() in ROUND and _is_stretched(prim)]
        )
    return sentences


def others_than(prims: Iterable[Usd.Prim], kinds: tuple[type[UsdGeom.Imageable], ...]) -> list[str]:
    """Return the path and the type of each prim that has a shape of another kind than these."""
    return [
        f"{prim.GetPath()} ({prim.GetTypeName()})"
        for prim in prims
        if (UsdGeom.Gprim(prim) or prim.GetTypeName() == "Volume") and not any(kind(prim) for kind in kinds)
    ]


def _turn(stage: Usd.Stage, source: str, prims: list[Usd.Prim]) -> None:
    """Turn prims into meshes.

    Raises:
        InputError: a size is not finite.
    """
    made = [(prim.GetPath(), _shapes(prim, source)) for prim in prims]
    layer = stage.GetSessionLayer()
    with Sdf.ChangeBlock():
        for path, shapes in made:
            spec = Sdf.CreatePrimInLayer(layer, path)
            spec.typeName = "Mesh"
            points = Sdf.AttributeSpec(spec, "points", Sdf.ValueTypeNames.Point3fArray)
            for time, faces in shapes:
                placed = Vt.Vec3fArray.FromNumpy(faces.points.astype(np.float32))
                if time.IsDefault():
                    points.default = placed
                else:
                    layer.SetTimeSample(points.path, time.GetValue(), placed)
            faces = shapes[0][1]
            of_ints, of_token = Sdf.ValueTypeNames.IntArray, Sdf.ValueTypeNames.Token
            Sdf.AttributeSpec(spec, "faceVertexCounts", of_ints).default = Vt.IntArray.FromNumpy(faces.counts)
            Sdf.AttributeSpec(spec, "faceVertexIndices", of_ints).default = Vt.IntArray.FromNumpy(faces.indices)
            for name, said in (("subdivisionScheme", "none"), ("orientation", "rightHanded")):
                Sdf.AttributeSpec(spec, name, of_token, Sdf.VariabilityUniform).default = said


def _shapes(prim: Usd.Prim, source: str) -> list[tuple[Usd.TimeCode, Faces]]:
    """Return the shape of a prim at each sample of its sizes, or by default."""
    kind = SHAPES[prim.GetTypeName()]
    attributes = [prim.GetAttribute(name) for name in kind.attributes]
    samples = sorted({time for each in attributes for time in each.GetTimeSamples()})
    times = [Usd.TimeCode(time) for time in samples] or [Usd.TimeCode.Default()]
    return [(time, kind.make(*(_value(each, time, source) for each in attributes))) for time in times]


def _value(attribute: Usd.Attribute, time: Usd.TimeCode, source: str) -> Any:
    """Return a size, or the number of an axis."""
    value = attribute.Get(time)
    if isinstance(value, str):
        return "XYZ".index(value)
    if not 0.0 <= value < np.inf:
        raise InputError(f"{source}: {attribute.GetPath()} is {value:g}; expected a finite size of 0 or more")
    return value


def _is_stretched(prim: Usd.Prim) -> bool:
    """Return whether a prim's axes have several scales, or are not at right angles, where it is first."""
    matrix = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode.EarliestTime())
    turned = np.array(matrix)[:3, :3]
    square = turned @ turned.T
    size = np.trace(square) / 3.0
    return bool(np.abs(square - size * np.eye(3)).max() > 2.0 * STRETCHED * size)
