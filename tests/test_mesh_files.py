"""Mesh files: OBJ, formats that trimesh reads, USD, and their texture coordinates."""

import json
import os
import re
import struct
import tracemalloc
from dataclasses import replace
from functools import partial
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import trimesh
from commands import command, lines_executed
from exported import animated, assert_valid
from meshes import cube, grid, prism, quad_sphere
from pxr import Gf, Sdf, Usd, UsdGeom, Vt
from trimesh.exchange.gltf import export_gltf
from trimesh.exchange.stl import export_stl_ascii

from balloon_warp import Balloon, Body, InputError, Obstacle, PolygonMesh, Scene, load_mesh, load_scene, remesh
from balloon_warp.mesh.load import read_usd
from balloon_warp.mesh.obj import read_obj, write_obj
from balloon_warp.mesh.topology import component_count, is_closed, mesh_edges, signed_volume, total_area
from balloon_warp.model import plan_model
from balloon_warp.studio.render.stage_reader import RenderStage

SQUARE = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
# Each is the square above as one quad, written in another way.
FORMS = {
    "plain": SQUARE + b"f 1 2 3 4\n",
    "no final newline": SQUARE + b"f 1 2 3 4",
    "weights": b"v 0 0 0 1.0\nv 1 0 0 1\nv 1 1 0 1\nv 0 1 0 1\nf 1 2 3 4\n",
    "colors": b"v 0 0 0 .1 .2 .3\nv 1 0 0 1 1 1\nv 1 1 0 0 0 0\nv 0 1 0 1e-3 0 0\nf 1 2 3 4\n",
    "forms of numbers": b"v 0 -0.0 +0\nv 1e0 0. .0\nv 10E-1 +1.0 0\nv 0e5 1.000 0\nf 1 2 3 4\n",
    "texture coordinates": SQUARE + b"vt 0 0\nvt 1 1\nf 1/1 2/2 3/1 4/2\n",
    "texture coordinates and normals": SQUARE + b"vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1 4/1/1\n",
    "mixed indices": SQUARE + b"f 1 -3 3/7 -1\n",
    "a face above its vertices": b"f 1 2 3 4\n" + SQUARE,
    "inline comments": b"v 0 0 0 # first\nv 1 0 0#second\nv 1 1 0\nv 0 1 0\nf 1 2 3 4 # v 9 9 9\n# f 1 2 3\n",
    "continued lines": b"v 0 \\\n0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 \\\n  3 \\\n 4\n",
    "a byte order mark": b"\xef\xbb\xbf" + SQUARE + b"f 1 2 3 4\n",
    "leading blanks and tabs": b"  v 0 0 0\n\tv\t1\t0\t0\nv  1   1  0 \t\nv 0 1 0\n \t f\t1 2  3 4\t\n\n\n",
    "Latin-1": b"# caf\xe9\no \xfcber_all\n" + SQUARE + b"usemtl gr\xfcn\nf 1 2 3 4\n",
    "names with underscores": b"o my_mesh\ng a_1\n" + SQUARE + b"f 1 2 3 4\n",
    "a library of materials that is not there": b"mtllib gone.mtl\n" + SQUARE + b"usemtl a\nf 1 2 3 4\n",
    "lines, points and curves": SQUARE + b"l 1 2\np 3\nvp 1 2\ncstype bezier\ncurv 0 1 1 2\nf 1 2 3 4\n",
}


def read(tmp_path: Path, content: bytes):
    (tmp_path / "mesh.obj").write_bytes(content)
    return read_obj(tmp_path / "mesh.obj")


@pytest.mark.parametrize("line_end", [b"\n", b"\r\n", b"\r"], ids=["LF", "CRLF", "CR"])
@pytest.mark.parametrize("form", FORMS)
def test_forms(tmp_path: Path, form: str, line_end: bytes) -> None:
    mesh = read(tmp_path, FORMS[form].replace(b"\n", line_end))
    assert mesh.points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.face_vertex_counts.tolist() == [4]
    assert mesh.face_vertex_indices.tolist() == [0, 1, 2, 3]
    assert (mesh.points.dtype, mesh.face_vertex_indices.dtype) == (np.float64, np.int32)
    assert (mesh.name, mesh.up_axis, mesh.meters_per_unit, mesh.warnings) == ("mesh", "Y", 1.0, ())


def test_polygons_objects_and_unused_vertices_stay_in_place(tmp_path: Path) -> None:
    content = b"o first\nv 9 9 9\nv 0 0 0\nv 1 0 0\nv 1 1 0\ng a\nusemtl one\nf 2 3 4\n"
    content += b"o second\nv 0 1 0\nv 0 2 0\ns 1\nusemtl two\nf -5 -4 -3 -2 -1\n"
    mesh = read(tmp_path, content)
    assert mesh.points[:, 1].tolist() == [9, 0, 0, 1, 1, 2]
    assert mesh.face_vertex_counts.tolist() == [3, 5]
    assert mesh.face_vertex_indices.tolist() == [1, 2, 3, 1, 2, 3, 4, 5]
    triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n"  # from where they stand
    assert read(tmp_path, triangle * 3).face_vertex_indices.tolist() == list(range(9))


CORNERS = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
BAD = {
    "empty": (b"", ": has no vertices (no line begins with v)"),
    "no faces": (CORNERS, ": has no faces (no line begins with f)"),
    "NaN": (b"v 0 0 0\nv nan 0 0\n" + CORNERS + b"f 1 2 3\n", ", line 2: coordinates must be finite"),
    "float32 overflow": (b"v 0 0 3.5e38\n" + CORNERS + b"f 1 2 3\n", ", line 1: coordinates must be finite and fit"),
    "no number": (b"#\n#\nv 3.1+e2 0 0\n", ", line 3: coordinates must be decimal numbers (got 'v 3.1+e2 0 0')"),
    "Python's digit groups": (b"v 1_0 0 0\n", ", line 1: coordinates must be decimal numbers"),
    "a word for a weight": (b"v 0 0 0 heavy\n", ", line 1: coordinates must be decimal numbers"),
    "index 0": (CORNERS + b"f 0 1 2\n", ", line 4: vertex numbers begin at 1, not 0 (got 'f 0 1 2')"),
    "before the start": (CORNERS + b"f -1 -2 -4\n", ", line 4: there is no vertex -4, only 3 stand above this line"),
    "negative before its vertices": (b"f -1 -2 -3\n" + CORNERS, ", line 1: there is no vertex -1, only 0 stand above"),
    "fraction": (CORNERS + b"f 1 2 3.0\n", ", line 4: vertex numbers must be integers (got 'f 1 2 3.0')"),
    "33 bits": (CORNERS + b"f 1 2 4294967297\n", ", line 4: there is no vertex 4294967297, which takes more than 32"),
    "two corners": (CORNERS + b"f 1 2\n", ", line 4: a face needs three corners or more, not 2 (got 'f 1 2')"),
    "a bad line after a continued one": (b"v 0 \\\n 0 \\\n 0\nv 1 x 0\n", ", line 4: coordinates must be decimal"),
    "UTF-16": ("v 0 0 0\n".encode("utf-16"), ": is binary or UTF-16, not the plain text of an OBJ file"),
    "binary": (b"\x7fELF\x02\x01\x00\x00v 0 0 0\n", ": is binary or UTF-16"),
}


@pytest.mark.parametrize("line_end", [b"\n", b"\r\n", b"\r"], ids=["LF", "CRLF", "CR"])
@pytest.mark.parametrize("case", BAD)
def test_bad_files_are_refused_in_a_sentence(tmp_path: Path, case: str, line_end: bytes) -> None:
    content, sentence = BAD[case]
    with pytest.raises(InputError) as refusal:
        read(tmp_path, content.replace(b"\n", line_end) if b"\0" not in content else content)
    message = str(refusal.value)
    assert message.startswith(f"{tmp_path / 'mesh.obj'}{sentence}")
    assert "\n" not in message


def test_writing_and_reading_gives_the_same_mesh(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    # All sizes of float64 that a float32 can hold, and values without a short decimal form.
    points = random.normal(size=(12, 3)) * 10.0 ** random.integers(-30, 30, size=(12, 3))
    points[0] = (1 / 3, np.nextafter(1.0, 2.0), -0.0)
    mesh = replace(textured(prism(6)), points=points)
    write_obj(tmp_path / "mesh.obj", mesh)
    again = read_obj(tmp_path / "mesh.obj")
    assert again.points.tobytes() == mesh.points.tobytes()
    np.testing.assert_allclose(again.texture_coordinates, mesh.texture_coordinates, rtol=1e-6)  # of float32
    assert again.face_vertex_counts.tolist() == mesh.face_vertex_counts.tolist()
    assert again.face_vertex_indices.tolist() == mesh.face_vertex_indices.tolist()


def test_writing_replaces_a_file_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, full = tmp_path / "mesh.obj", OSError(28, "No space left on device")
    with pytest.raises(InputError, match="cannot be written: No such file or directory"):
        write_obj(tmp_path / "gone" / "mesh.obj", grid(1, 1))
    write_obj(path, grid(1, 1))
    before = path.read_bytes()
    monkeypatch.setattr(os, "replace", Mock(side_effect=full))
    with pytest.raises(InputError, match=r"mesh\.obj: cannot be written: No space left on device"):
        write_obj(path, quad_sphere(3))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_each_line_is_worked_on_once(tmp_path: Path) -> None:
    counts = []
    for size in (10, 100):
        write_obj(tmp_path / "mesh.obj", grid(size, size))
        lines = lines_executed(lambda: read_obj(tmp_path / "mesh.obj"))
        counts.append(lines / ((size + 1) ** 2 + size**2))  # of vertices and faces
    assert counts[1] < 1.1 * counts[0]
    assert counts[1] < 25


BOX = trimesh.creation.box((1.0, 2.0, 3.0))


TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
MANY = {
    "vertices": b"v 0 0 0\n" * 20_000 + TRIANGLE,
    "faces": TRIANGLE + b"f 1 2 3\n" * 20_000,
    "empty comments": b"##\n" * 50_000 + TRIANGLE,
    "continued lines": TRIANGLE[:-1] + b"\\\n" * 50_000,
    "continued words": b"ab\\\n" * 50_000 + b"\n" + TRIANGLE,
}


@pytest.mark.full
@pytest.mark.parametrize("what", MANY)
def test_reading_takes_a_few_times_the_memory_of_the_file(tmp_path: Path, what: str) -> None:
    """The peak memory is a few times the file: the shortest vertex line has 8 bytes, its numbers 28."""
    path = tmp_path / "mesh.obj"
    path.write_bytes(MANY[what])
    tracemalloc.start()
    read_obj(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 9 * path.stat().st_size + 50_000


def assert_is_the_box(path: Path) -> None:
    mesh = load_mesh(path)
    assert (mesh.vertex_count, mesh.face_count) == (8, 12)
    assert is_closed(mesh_edges(mesh))
    # Every coordinate is a half or a whole number, exact in float32.
    assert signed_volume(mesh) == pytest.approx(6.0, abs=1e-12)
    assert total_area(mesh) == pytest.approx(22.0, abs=1e-12)


BOXES = {
    **{f"box{s}": partial(BOX.export, file_type=s[1:].lower()) for s in (".stl", ".ply", ".off", ".glb", ".STL")},
    "text.stl": lambda path: path.write_text(export_stl_ascii(BOX)),
    "model.gltf": lambda path: [
        (path.parent / name).write_bytes(content) for name, content in export_gltf(trimesh.Scene(BOX)).items()
    ],
}
"""writers of a box"""


@pytest.mark.parametrize("name", BOXES)
def test_a_box_in_each_format(tmp_path: Path, name: str) -> None:
    BOXES[name](tmp_path / name)
    assert_is_the_box(tmp_path / name)
    assert load_mesh(tmp_path / name).unit_known == (Path(name).suffix in (".glb", ".gltf"))  # which are in meters


def test_a_glb_that_repeats_vertices_for_flat_shading_is_one_surface(tmp_path: Path) -> None:
    flat = trimesh.Trimesh(BOX.triangles.reshape(-1, 3), np.arange(36).reshape(12, 3), process=False)
    trimesh.Scene(flat).export(tmp_path / "flat.glb")
    assert len(trimesh.load_mesh(tmp_path / "flat.glb", process=False).vertices) == 36
    assert_is_the_box(tmp_path / "flat.glb")


def test_a_scene_is_joined_in_its_world(tmp_path: Path) -> None:
    scene = trimesh.Scene(BOX)
    scene.add_geometry(BOX, transform=trimesh.transformations.translation_matrix((10.0, 0.0, 0.0)))
    scene.export(tmp_path / "two.glb")
    mesh = load_mesh(tmp_path / "two.glb")
    assert (component_count(mesh, mesh_edges(mesh)), mesh.face_count) == (2, 24)
    assert np.ptp(mesh.points, axis=0).tolist() == [11.0, 2.0, 3.0]


@pytest.mark.parametrize("seed", [2, None])
def test_vertices_of_a_ply_stay_in_order_coincident_and_unused_ones_too(tmp_path: Path, seed: int | None) -> None:
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 0), (5, 5, 5), (0, 0, 1)])
    faces = np.array([[0, 1, 2], [3, 5, 1]])
    if seed:
        shuffled = np.random.default_rng(seed).permutation(8)
        points, faces = BOX.vertices[shuffled], np.argsort(shuffled)[BOX.faces]
    trimesh.Trimesh(points, faces, process=False).export(tmp_path / "box.ply")
    mesh = load_mesh(tmp_path / "box.ply")
    assert mesh.points.tolist() == points.tolist()
    assert mesh.face_vertex_indices.tolist() == faces.ravel().tolist()


@pytest.mark.parametrize("binary", [False, True])
def test_strips_of_a_ply_become_triangles_that_face_outward(binary: bool, tmp_path: Path) -> None:
    """Scanners write them: a tetrahedron is a strip of 0 1 2 3 and two triangles, with a strip too short between."""
    points = np.array([(0, 0, 0), (0, 1, 0), (1, 0, 0), (0, 0, 1)], np.float32)
    strip = np.array([0, 1, 2, 3, -1, 0, 1, -1, 0, 2, 3, -1, 0, 3, 1, -1], np.int32)
    kind = "binary_little_endian" if binary else "ascii"
    header = f"ply\nformat {kind} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    numbers = np.array([len(strip), *strip], np.int32)
    text = "".join(" ".join(map(str, row)) + "\n" for row in [*points.tolist(), numbers.tolist()])
    (tmp_path / "strips.ply").write_bytes(
        header.encode() + (points.tobytes() + numbers.tobytes() if binary else text.encode())
    )
    mesh = load_mesh(tmp_path / "strips.ply")
    np.testing.assert_array_equal(mesh.points, points)
    faces = mesh.face_vertex_indices.reshape(-1, 3).tolist()
    assert faces == [[0, 1, 2], [2, 1, 3], [0, 2, 3], [0, 3, 1]]
    assert signed_volume(mesh) == pytest.approx(1.0 / 6.0)


def test_quads_of_a_ply_become_triangles_and_those_of_an_obj_do_not(tmp_path: Path) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 6\nproperty list uchar int vertex_indices\nend_header\n"
    points = "".join(f"{x} {y} {z}\n" for x, y, z in cube().points)
    faces = "".join(f"4 {a} {b} {c} {d}\n" for a, b, c, d in cube().face_vertex_indices.reshape(-1, 4))
    (tmp_path / "cube.ply").write_text(header + points + faces)
    mesh = load_mesh(tmp_path / "cube.ply")
    assert mesh.face_vertex_counts.tolist() == [3] * 12
    assert signed_volume(mesh) == pytest.approx(1.0, abs=1e-12)
    write_obj(tmp_path / "cube.OBJ", cube())
    assert load_mesh(tmp_path / "cube.OBJ").face_vertex_counts.tolist() == [4] * 6


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.stl", b""),
        ("text.ply", b"ply\nnonsense"),
        ("text.off", b"OFF\n1 2"),
        ("text.glb", b"glTF1234"),
        ("text.gltf", b"nonsense"),
    ],
)
def test_broken_files_are_refused_in_a_sentence(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"^{re.escape(str(tmp_path / name))}: .*\Z"):
        load_mesh(tmp_path / name)


def test_missing_files_folders_and_unknown_suffixes_are_refused(tmp_path: Path) -> None:
    readable = r"expected a mesh file \(\.obj \.usd \.usda \.usdc \.usdz \.stl \.ply \.off \.glb \.gltf\), got suffix"
    for name, sentence in (
        ("gone.obj", r"gone\.obj: no such file$"),
        ("", r"is a folder, not a mesh file$"),
        ("cow.blend", rf"cow\.blend: {readable} \.blend$"),
        ("cow", rf"cow: {readable} none$"),
    ):
        with pytest.raises(InputError, match=sentence):
            load_mesh(tmp_path / name)
    with pytest.raises(InputError, match=r"gone\.obj: cannot be read \(No such file or directory\)"):
        read_obj(tmp_path / "gone.obj")


def quantized(path: Path, kind: int, normalized: bool, **more: object) -> Path:
    """Return a box 2 wide, 1 high and 0.5 deep, of integers, at x = 10, by KHR_mesh_quantization."""
    dtype, largest = {5122: (np.int16, 32767), 5121: (np.uint8, 255), 5120: (np.int8, 127)}[kind]
    unit = (BOX.vertices - BOX.vertices.min(axis=0)) / np.ptp(BOX.vertices, axis=0).max()
    corners = np.zeros((8, 4), dtype)  # each at a multiple of four bytes
    corners[:, :3] = np.round(unit * largest)
    triangles = BOX.faces.astype(np.uint16)
    binary = corners.tobytes() + triangles.tobytes()
    low, high = (bound.tolist() for bound in (corners[:, :3].min(axis=0), corners[:, :3].max(axis=0)))
    points = {"bufferView": 0, "componentType": kind, "count": 8, "type": "VEC3", "min": low, "max": high}
    said = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_mesh_quantization"],
        "extensionsRequired": ["KHR_mesh_quantization"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [10.0, 0.0, 0.0], "scale": [2.0 if normalized else 2.0 / largest] * 3}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(binary)} | ({"uri": "box.bin"} if path.suffix == ".gltf" else {})],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": corners.nbytes, "byteStride": 4 * corners.itemsize},
            {"buffer": 0, "byteOffset": corners.nbytes, "byteLength": triangles.nbytes},
        ],
        "accessors": [
            points | {"normalized": normalized},
            {"bufferView": 1, "componentType": 5123, "count": triangles.size, "type": "SCALAR"},
        ],
        **more,
    }
    text = json.dumps(said).encode()
    if path.suffix == ".gltf":
        (path.parent / "box.bin").write_bytes(binary)
        path.write_bytes(text)
        return path
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
    return path


@pytest.mark.parametrize("name", ["box.glb", "box.gltf"])
@pytest.mark.parametrize(("kind", "normalized"), [(5122, True), (5121, True), (5120, True), (5122, False)])
def test_integers_of_gltf_are_what_they_stand_for(tmp_path: Path, name: str, kind: int, normalized: bool) -> None:
    mesh = load_mesh(quantized(tmp_path / name, kind, normalized))
    size = 2.0 * np.ptp(BOX.vertices, axis=0) / np.ptp(BOX.vertices, axis=0).max()
    np.testing.assert_allclose(np.ptp(mesh.points, axis=0), size, rtol=0.02)  # an eighth bit of a quarter
    assert mesh.points[:, 0].min() == pytest.approx(10.0)


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_draco_mesh_compression", "ACME_points"])
def test_an_extension_that_a_gltf_requires_and_that_is_not_decoded_is_named(tmp_path: Path, extension: str) -> None:
    path = quantized(tmp_path / "box.glb", 5122, True, extensionsRequired=["KHR_mesh_quantization", extension])
    with pytest.raises(InputError, match=rf"box\.glb: requires the extension {extension}, which is not supported"):
        load_mesh(path)
    quantized(path, 5122, True, extensionsRequired=["KHR_materials_transmission", "EXT_texture_webp"])
    assert load_mesh(path).face_count == 12


# USD holds points in float32.
ROUND_OFF = 1e-6


def add_mesh(stage: Usd.Stage, path: str, mesh: PolygonMesh) -> UsdGeom.Mesh:
    prim = UsdGeom.Mesh.Define(stage, path)
    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(mesh.points.astype(np.float32)))
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_counts))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_indices))
    return prim


@pytest.fixture
def stage(tmp_path: Path) -> Usd.Stage:
    """Return a stage in meters, Y up."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "stage.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    return stage


def read_again(stage: Usd.Stage, prim: str | list[str] | None = None) -> PolygonMesh:
    stage.Save()
    return read_usd(Path(stage.GetRootLayer().realPath), prim)


def move(prim: UsdGeom.Xformable, x: float) -> None:
    prim.AddTranslateOp().Set(Gf.Vec3d(x, 0, 0))


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usd"])
def test_polygons_units_and_axis(tmp_path: Path, suffix: str) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / f"stage{suffix}"))
    add_mesh(stage, "/World/prism", prism(5))
    mesh = read_again(stage)
    assert (mesh.up_axis, mesh.meters_per_unit) == ("Y", 0.01)  # the fallbacks of USD
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 0.1)
    mesh = read_again(stage)
    np.testing.assert_allclose(mesh.points, prism(5).points, atol=ROUND_OFF)
    assert mesh.face_vertex_counts.tolist() == prism(5).face_vertex_counts.tolist()
    assert mesh.face_vertex_indices.tolist() == prism(5).face_vertex_indices.tolist()
    assert (mesh.name, mesh.up_axis, mesh.meters_per_unit, mesh.warnings) == ("prism", "Z", 0.1, ())


def test_points_are_placed_in_the_world(stage: Usd.Stage) -> None:
    move(UsdGeom.Xform.Define(stage, "/World"), 10.0)
    prim = add_mesh(stage, "/World/cube", cube())
    prim.AddRotateZOp().Set(90.0)
    prim.AddScaleOp().Set(Gf.Vec3f(2, 1, 1))
    x, y, z = cube().points.T
    # Scaled first, then turned a quarter from x to y, then moved.
    np.testing.assert_allclose(read_again(stage).points, np.stack([10.0 - y, 2.0 * x, z], axis=1), atol=ROUND_OFF)


def test_a_mesh_inside_an_instance_is_found(stage: Usd.Stage) -> None:
    stage.CreateClassPrim("/prototype")
    add_mesh(stage, "/prototype/cube", cube())
    instance = UsdGeom.Xform.Define(stage, "/instance")
    instance.GetPrim().GetReferences().AddInternalReference("/prototype")
    instance.GetPrim().SetInstanceable(True)
    move(instance, 5.0)
    np.testing.assert_allclose(read_again(stage).points, cube().points + (5, 0, 0), atol=ROUND_OFF)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("left_handed", [False, True])
def test_winding_is_outward_whatever_the_handedness(stage: Usd.Stage, mirrored: bool, left_handed: bool) -> None:
    mesh = prism(5)
    if left_handed:
        first_kept = [[face[0], *face[:0:-1]] for face in np.split(mesh.face_vertex_indices, [5, 10, 14, 18, 22, 26])]
        mesh.face_vertex_indices[:] = np.concatenate(first_kept)
    prim = add_mesh(stage, "/prism", mesh)
    if left_handed:
        prim.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    if mirrored:
        prim.AddScaleOp().Set(Gf.Vec3f(-1, 1, 1))
    assert signed_volume(read_again(stage)) == pytest.approx(signed_volume(prism(5)), abs=ROUND_OFF)


def test_default_time_comes_before_samples_and_the_earliest_sample_otherwise(stage: Usd.Stage) -> None:
    points = add_mesh(stage, "/World/cube", cube()).GetPointsAttr()
    for time in (3.0, 7.0):
        points.Set(Vt.Vec3fArray.FromNumpy((time * cube().points).astype(np.float32)), time)
    assert signed_volume(read_again(stage)) == pytest.approx(1.0, abs=ROUND_OFF)
    points.ClearDefault()
    assert signed_volume(read_again(stage)) == pytest.approx(27.0, rel=ROUND_OFF)
    scale = UsdGeom.Xform.Define(stage, "/World").AddScaleOp()
    for size, time in ((2, 5.0), (9, 6.0)):
        scale.Set(Gf.Vec3f(size, size, size), time)
    assert signed_volume(read_again(stage)) == pytest.approx(8.0 * 27.0, rel=2.0 * ROUND_OFF)


def test_all_meshes_that_are_shown_are_taken_as_one_or_the_named(stage: Usd.Stage) -> None:
    add_mesh(stage, "/World/a", cube())
    move(add_mesh(stage, "/World/more/b", prism(5)), 3.0)
    move(add_mesh(stage, "/World/more/c", cube()), 6.0)
    add_mesh(stage, "/World/hidden", cube()).MakeInvisible()
    for path, purpose in (("more/guide", "guide"), ("proxy", "proxy"), ("render", "render")):
        add_mesh(stage, f"/World/{path}", cube()).CreatePurposeAttr(purpose)
    every = read_again(stage)
    assert (every.name, every.face_count) == ("stage", 6 + 7 + 6 + 6)
    assert signed_volume(every) == pytest.approx(3 * 1.0 + signed_volume(prism(5)), rel=ROUND_OFF)
    assert {name: len(vertices) for name, vertices in every.groups.items()} == {"a": 8, "b": 10, "c": 8, "render": 8}
    assert every.points[every.groups["c"]].min(axis=0)[0] == pytest.approx(6.0)
    assert every.warnings == (
        "Left out of the stage: /World/more/guide (purpose guide), /World/hidden (invisible), /World/proxy "
        "(purpose proxy); prim selects other meshes.",
    )
    below, named = read_again(stage, "/World/more"), read_again(stage, "/World/hidden")  # whether it is shown or not
    assert (below.name, below.face_count, below.warnings) == ("more", 13, ())
    assert (named.name, named.face_count, named.warnings) == ("hidden", 6, ())
    assert read_again(stage, ["/World/more/c", "/World/a"]).face_count == 12
    similar = r"below prim /World/mor/c \(it has .* and 2 more\); did you mean /World/more/"
    with pytest.raises(InputError, match=similar):
        read_again(stage, "/World/mor/c")


@pytest.mark.parametrize("first", ["invisible", "inherited"])
def test_what_appears_or_goes_counts_as_at_first_and_is_named(stage: Usd.Stage, first: str) -> None:
    add_mesh(stage, "/always", cube())
    add_mesh(stage, "/World/wall", prism(5))
    seen = UsdGeom.Xform.Define(stage, "/World").CreateVisibilityAttr()
    for time, value in ((0.0, first), (12.0, "inherited" if first == "invisible" else "invisible")):
        seen.Set(value, time)
    mesh = read_again(stage)
    assert mesh.face_count == (6 if first == "invisible" else 13)
    (sentence,) = mesh.warnings
    assert ("/World/wall (invisible at first)" in sentence) == (first == "invisible")
    assert ("The visibility of /World/wall changes over time" in sentence) == (first == "inherited")
    (sentence,) = read_again(stage, "/World/wall").warnings
    assert "The visibility of /World/wall changes over time, which is not followed" in sentence


def test_parts_of_one_name_are_told_apart(stage: Usd.Stage) -> None:
    for x, wheel in enumerate(("left", "right")):
        move(add_mesh(stage, f"/{wheel}/mesh", cube()), 3.0 * x)
    assert sorted(read_again(stage).groups) == ["/left/mesh", "/right/mesh"]


@pytest.mark.full
def test_a_prim_is_named_in_a_scene_and_on_the_command_line(stage: Usd.Stage, tmp_path: Path) -> None:
    path = tmp_path / "stage.usda"
    add_mesh(stage, "/a", cube())
    move(add_mesh(stage, "/b", prism(5)), 3.0)
    add_mesh(stage, "/c", prism(5)).MakeInvisible()
    stage.Save()
    assert json.loads(command(path, "--prim", "/b", "--json").stdout)["faces"] == 7
    balloon, body = Balloon(mesh=path, prim="/a"), Body(mesh=path, prim="/a", position=(0.0, 9.0, 0.0))
    walls = [Obstacle(mesh=path, prim="/b", position=(9.0, 0.0, 0.0)), Obstacle(mesh=path, position=(-9.0, 0.0, 0.0))]
    plan = plan_model(Scene(balloon=[balloon], obstacle=walls, body=[body]))
    meshes = [plan.shapes[0].mesh, *(shape.mesh for shape in plan.obstacles), plan.bodies[0].solid.mesh]
    assert [mesh.face_count for mesh in meshes if mesh] == [6, 7, 13, 6]
    assert plan.warnings == [f"{path}: Left out of the stage: /c (invisible); prim selects other meshes."]
    assert load_scene(path, {"balloon.prim": "/b"}).balloon[0].prim == "/b"
    with pytest.raises(InputError, match=r"selects an object of a file; expected a file as mesh"):
        plan_model(Scene(balloon=[Balloon(mesh=cube(), prim="/a")]))


@pytest.mark.parametrize(
    ("attribute", "value", "sentence"),
    [
        ("points", None, "/cube: has no points"),
        ("points", [], "/cube: has 0 vertices and 6 faces; expected both"),
        ("points", [(float("nan"), 0, 0)] * 8, "/cube: vertex 1: coordinates must be finite"),
        ("faceVertexCounts", [4] * 5, "/cube: the face sizes add up to 20 corners, but 24 are given"),
        ("faceVertexCounts", [2, 6, 4, 4, 4, 4], "/cube: face 1: a face needs three corners or more (got 2)"),
        ("faceVertexIndices", [-1] * 24, "/cube: a face refers to point -1; expected 0 to 7"),
        ("visibility", "invisible", 'has no visible mesh: /cube (invisible); prim = "/cube" selects it'),
        (None, None, "has no mesh"),
    ],
)
def test_broken_stages_are_refused_in_a_sentence(stage: Usd.Stage, attribute: str | None, value, sentence: str) -> None:
    UsdGeom.Camera.Define(stage, "/camera")
    if attribute:
        prim = add_mesh(stage, "/cube", cube()).GetPrim()
        prim.RemoveProperty(attribute) if value is None else prim.GetAttribute(attribute).Set(value)
    with pytest.raises(InputError) as refusal:
        read_again(stage)
    assert str(refusal.value).startswith(f"{stage.GetRootLayer().realPath}: {sentence}")


@pytest.mark.parametrize("name", ["stage.usda", "stage.usdc", "stage.usdz"])
def test_what_is_no_stage_is_refused_and_usd_prints_nothing(tmp_path: Path, capfd, name: str) -> None:
    (tmp_path / name).write_bytes(b"no stage")
    with pytest.raises(InputError, match="cannot be read as a USD stage"):
        read_usd(tmp_path / name)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("what", ["reference", "payload", "sublayer"])
def test_what_is_not_there_is_named_with_who_wants_it_and_usd_is_silent(stage: Usd.Stage, capfd, what: str) -> None:
    prim = add_mesh(stage, "/cube", cube()).GetPrim()
    for name in ("gone.usda", "lost.usda"):
        if what == "reference":
            prim.GetReferences().AddReference(f"./{name}")
        elif what == "payload":
            prim.GetPayloads().AddPayload(f"./{name}")
        else:
            stage.GetRootLayer().subLayerPaths.append(f"./{name}")
    stage.Save()
    capfd.readouterr()
    mesh = read_again(stage)
    assert mesh.face_count == 6
    for name, sentence in zip(("gone.usda", "lost.usda"), mesh.warnings, strict=True):
        assert f"{what} " in sentence
        assert name in sentence
        assert ("stage.usda" if what == "sublayer" else "</cube>") in sentence
    notes: list[str] = []
    RenderStage(Path(stage.GetRootLayer().realPath), on_note=notes.append)
    assert notes == [*mesh.warnings]
    assert capfd.readouterr() == ("", "")


TWO_FACES = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nvt 0 0\nvt 0.5 0 0\nvt 0.5 1\nvt 0.25\nvt 1 0.5\n"
TWO_FACES += "f 1/1 2/2/1 3/3 4/-2\nf 2/2 5/5 3/3\n"
AT_CORNERS = [[0, 0], [0.5, 0], [0.5, 1], [0.25, 0], [0.5, 0], [1, 0.5], [0.5, 1]]


def textured(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with a texture coordinate for each vertex, x + 2 y and z, so that mixed-up corners show."""
    places = mesh.points @ [[1.0, 0.0], [2.0, 0.0], [0.0, 1.0]]
    return replace(mesh, texture_coordinates=places[mesh.face_vertex_indices].astype(np.float32))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        *[("4/-2", corner) for corner in ("4", "4//1", "4/6", "4/0", "4/-6", "4/99999999999", "4/x")],
        *[("vt 1 0.5", place) for place in ("vt 1 nan", "vt 1 1e39", "vt one half", "vt")],
    ],
)
def test_there_are_none_where_they_make_no_sense_and_the_mesh_is_what_it_is(tmp_path: Path, old: str, new: str):
    mesh = read(tmp_path, TWO_FACES.replace(old, new).encode())
    assert mesh.texture_coordinates is None
    assert mesh.face_count == 2


@pytest.mark.parametrize("interpolation", ["faceVarying", "vertex", "uniform"])
def test_usd_has_them_at_corners_or_vertices(stage: Usd.Stage, interpolation: str):
    mesh = textured(cube())
    prim = add_mesh(stage, "/mesh", mesh)
    prim.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    values = np.asarray(mesh.texture_coordinates)
    if interpolation == "vertex":
        values = values[np.unique(mesh.face_vertex_indices, return_index=True)[1]]
    st = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, interpolation)
    st.Set(values)
    found = read_again(stage)
    if interpolation == "uniform":
        assert found.texture_coordinates is None
    else:
        np.testing.assert_array_equal(found.texture_coordinates, textured(found).texture_coordinates)


@pytest.mark.full
def test_each_corner_has_what_the_file_names_there_in_the_stage_too(tmp_path: Path):
    np.testing.assert_array_equal(read(tmp_path, TWO_FACES.encode()).texture_coordinates, AT_CORNERS)
    stage = animated(load_scene(tmp_path / "mesh.obj", {"frames": 1}), tmp_path / "out.usdc")
    st = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/mesh")).GetPrimvar("st")
    assert (st.GetInterpolation(), st.GetTypeName()) == ("faceVarying", Sdf.ValueTypeNames.TexCoord2fArray)
    np.testing.assert_array_equal(st.Get(), AT_CORNERS)
    assert_valid(stage)
    np.testing.assert_array_equal(load_mesh(tmp_path / "out.usdc").texture_coordinates, AT_CORNERS)
    assert remesh(textured(cube()), 6).texture_coordinates is not None  # a remeshed surface has them, too
