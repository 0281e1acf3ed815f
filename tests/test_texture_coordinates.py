"""Texture coordinates of a mesh in the stage, each at its corner."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import cube
from pxr import Sdf, Usd, UsdGeom, UsdValidation

from balloon_warp import Simulator, StageWriter, load_scene, remesh
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.repair import repaired

TWO_FACES = """
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 2 0 0
vt 0 0
vt 0.5 0 0
vt 0.5 1
vt 0.25
vt 1 0.5
f 1/1 2/2/1 3/3 4/-2
f 2/2 5/5 3/3
"""
AT_CORNERS = [[0, 0], [0.5, 0], [0.5, 1], [0.25, 0], [0.5, 0], [1, 0.5], [0.5, 1]]


def textured(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with a texture coordinate for each vertex, x + 2 y and z, so that mixed-up corners show."""
    places = mesh.points @ [[1.0, 0.0], [2.0, 0.0], [0.0, 1.0]]
    return replace(mesh, texture_coordinates=places[mesh.face_vertex_indices].astype(np.float32))


def obj(folder: Path, text: str) -> Path:
    path = folder / "mesh.obj"
    path.write_text(text)
    return path


def test_each_corner_has_what_the_file_names_there(tmp_path: Path):
    np.testing.assert_array_equal(load_mesh(obj(tmp_path, TWO_FACES)).texture_coordinates, AT_CORNERS)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("4/-2", "4"),
        ("4/-2", "4//1"),
        ("4/-2", "4/6"),
        ("4/-2", "4/0"),
        ("4/-2", "4/-6"),
        ("4/-2", "4/99999999999"),
        ("4/-2", "4/x"),
        ("vt 1 0.5", "vt 1 nan"),
        ("vt 1 0.5", "vt 1 1e39"),
        ("vt 1 0.5", "vt one half"),
        ("vt 1 0.5", "vt"),
    ],
)
def test_there_are_none_where_they_make_no_sense_and_the_mesh_is_what_it_is(tmp_path: Path, old: str, new: str):
    mesh = load_mesh(obj(tmp_path, TWO_FACES.replace(old, new)))
    assert mesh.texture_coordinates is None
    assert mesh.face_count == 2


def test_repairs_take_them_along():
    mesh = cube()
    flipped = mesh.face_vertex_indices.reshape(-1, 4).copy()
    flipped[2] = flipped[2, ::-1]
    corners = np.concatenate([flipped.ravel(), flipped[0], [0, 1, 1, 0]]).astype(np.int32)
    counts = np.full(8, 4, dtype=np.int32)
    mesh = textured(replace(mesh, face_vertex_counts=counts, face_vertex_indices=corners))
    mended = repaired(mesh, "cube")
    assert mended.face_count == 6
    assert (mended.face_vertex_indices[8:12] != flipped[2]).any()  # it was turned over
    np.testing.assert_array_equal(mended.texture_coordinates, textured(mended).texture_coordinates)


def test_a_remeshed_surface_has_them_too():
    assert remesh(textured(cube()), 6).texture_coordinates is not None


@pytest.mark.parametrize("interpolation", ["faceVarying", "vertex", "uniform"])
def test_usd_has_them_at_corners_or_vertices(tmp_path: Path, interpolation: str):
    mesh = textured(cube())
    stage = Usd.Stage.CreateNew(str(tmp_path / "mesh.usda"))
    prim = UsdGeom.Mesh.Define(stage, "/mesh")
    prim.CreatePointsAttr(mesh.points)
    prim.CreateFaceVertexCountsAttr(mesh.face_vertex_counts)
    prim.CreateFaceVertexIndicesAttr(mesh.face_vertex_indices)
    prim.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    values = np.asarray(mesh.texture_coordinates)
    if interpolation == "vertex":
        _, first = np.unique(mesh.face_vertex_indices, return_index=True)
        values = values[first]
    st = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, interpolation)
    st.Set(values)
    stage.Save()
    read = load_mesh(tmp_path / "mesh.usda")
    if interpolation == "uniform":
        assert read.texture_coordinates is None
    else:
        np.testing.assert_array_equal(read.texture_coordinates, textured(read).texture_coordinates)


def test_the_stage_has_them(tmp_path: Path):
    scene = load_scene(obj(tmp_path, TWO_FACES), {"frames": 1})
    simulator = Simulator(scene, "cpu")
    with StageWriter(tmp_path / "out.usdc", simulator.model) as writer:
        for frame in simulator.run():
            writer.write(frame)
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    st = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/mesh")).GetPrimvar("st")
    assert (st.GetInterpolation(), st.GetTypeName()) == ("faceVarying", Sdf.ValueTypeNames.TexCoord2fArray)
    np.testing.assert_array_equal(st.Get(), AT_CORNERS)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert [error.GetMessage() for error in UsdValidation.ValidationContext(validators).Validate(stage)] == []
    np.testing.assert_array_equal(load_mesh(tmp_path / "out.usdc").texture_coordinates, AT_CORNERS)
