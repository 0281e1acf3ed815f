"""Formats read through trimesh, and refusals of loading by suffix."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from meshes import cube
from trimesh.exchange.gltf import export_gltf
from trimesh.exchange.stl import export_stl_ascii

from balloon_warp.errors import InputError
from balloon_warp.mesh.geometry import signed_volume, total_area
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.topology import component_count, is_closed, mesh_edges

BOX = trimesh.creation.box((1.0, 2.0, 3.0))


def assert_is_the_box(path: Path) -> None:
    mesh = load_mesh(path)
    assert (mesh.vertex_count, mesh.face_count) == (8, 12)
    assert is_closed(mesh_edges(mesh))
    # Every coordinate is a half or a whole number, exact in float32.
    assert signed_volume(mesh) == pytest.approx(6.0, abs=1e-12)
    assert total_area(mesh) == pytest.approx(22.0, abs=1e-12)


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".off", ".glb", ".STL"])
def test_a_box_in_each_format(tmp_path: Path, suffix: str) -> None:
    BOX.export(tmp_path / f"box{suffix}", file_type=suffix[1:].lower())
    assert_is_the_box(tmp_path / f"box{suffix}")


def test_gltf_in_several_files(tmp_path: Path) -> None:
    for name, content in export_gltf(trimesh.Scene(BOX)).items():
        (tmp_path / name).write_bytes(content)
    assert_is_the_box(tmp_path / "model.gltf")


def test_a_text_stl(tmp_path: Path) -> None:
    (tmp_path / "box.stl").write_text(export_stl_ascii(BOX))
    assert_is_the_box(tmp_path / "box.stl")


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


def test_vertex_order_is_kept(tmp_path: Path) -> None:
    shuffled = np.random.default_rng(2).permutation(8)
    points, faces = BOX.vertices[shuffled], np.argsort(shuffled)[BOX.faces]
    trimesh.Trimesh(points, faces, process=False).export(tmp_path / "box.ply")
    assert load_mesh(tmp_path / "box.ply").points.tolist() == points.tolist()


def test_coincident_and_unused_vertices_of_a_ply_stay(tmp_path: Path) -> None:
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 0), (5, 5, 5), (0, 0, 1)])
    trimesh.Trimesh(points, [[0, 1, 2], [3, 5, 1]], process=False).export(tmp_path / "pair.ply")
    mesh = load_mesh(tmp_path / "pair.ply")
    assert mesh.points.tolist() == points.tolist()
    assert mesh.face_vertex_indices.tolist() == [0, 1, 2, 3, 5, 1]


def test_quads_of_a_ply_become_triangles(tmp_path: Path) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 6\nproperty list uchar int vertex_indices\nend_header\n"
    points = "".join(f"{x} {y} {z}\n" for x, y, z in cube().points)
    faces = "".join(f"4 {a} {b} {c} {d}\n" for a, b, c, d in cube().face_vertex_indices.reshape(-1, 4))
    (tmp_path / "cube.ply").write_text(header + points + faces)
    mesh = load_mesh(tmp_path / "cube.ply")
    assert mesh.face_vertex_counts.tolist() == [3] * 12
    assert signed_volume(mesh) == pytest.approx(1.0, abs=1e-12)


def test_obj_goes_to_its_own_reader(tmp_path: Path) -> None:
    write_obj(tmp_path / "cube.OBJ", cube())
    assert load_mesh(tmp_path / "cube.OBJ").face_vertex_counts.tolist() == [4] * 6


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.stl", b""),
        ("short.stl", bytes(80) + struct.pack("<I", 9)),
        ("text.ply", b"ply\nnonsense"),
        ("text.off", b"OFF\n1 2"),
        ("text.glb", b"glTF1234"),
        ("none.gltf", b"{}"),
        ("text.gltf", b"nonsense"),
    ],
)
def test_broken_files_are_refused_in_a_sentence(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as refusal:
        load_mesh(tmp_path / name)
    assert str(refusal.value).startswith(f"{tmp_path / name}: ")
    assert "\n" not in str(refusal.value)


def test_missing_files_folders_and_unknown_suffixes_are_refused(tmp_path: Path) -> None:
    readable = r"\.obj \.usd \.usda \.usdc \.usdz \.stl \.ply \.off \.glb \.gltf"
    with pytest.raises(InputError, match=r"gone\.obj: no such file$"):
        load_mesh(tmp_path / "gone.obj")
    with pytest.raises(InputError, match=r"is a folder, not a mesh file$"):
        load_mesh(tmp_path)
    with pytest.raises(InputError, match=rf"cow\.blend: expected a mesh file \({readable}\), got suffix \.blend$"):
        load_mesh(tmp_path / "cow.blend")
    with pytest.raises(InputError, match=rf"cow: expected a mesh file \({readable}\), got suffix none$"):
        load_mesh(tmp_path / "cow")


def quantized(path: Path, kind: int, normalized: bool, **more: object) -> Path:
    """Return a box 2 wide, 1 high and 0.5 deep, of integers, at x = 10, by KHR_mesh_quantization."""
    dtype, largest = {5122: (np.int16, 32767), 5121: (np.uint8, 255), 5120: (np.int8, 127)}[kind]
    unit = BOX.vertices / np.ptp(BOX.vertices, axis=0).max()
    unit -= unit.min(axis=0)
    scale = 2.0 if normalized else 2.0 / largest
    corners = np.zeros((8, 4), dtype)  # each at a multiple of four bytes
    corners[:, :3] = np.round(unit * largest)
    triangles = BOX.faces.astype(np.uint16)
    binary = corners.tobytes() + triangles.tobytes()
    length = corners.nbytes
    said = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_mesh_quantization"],
        "extensionsRequired": ["KHR_mesh_quantization"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [10.0, 0.0, 0.0], "scale": [scale] * 3}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(binary), "uri": "box.bin"}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": length, "byteStride": 4 * corners.itemsize},
            {"buffer": 0, "byteOffset": length, "byteLength": triangles.nbytes},
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": kind,
                "count": 8,
                "type": "VEC3",
                "normalized": normalized,
                "min": corners[:, :3].min(axis=0).tolist(),
                "max": corners[:, :3].max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": 5123, "count": triangles.size, "type": "SCALAR"},
        ],
        **more,
    }
    if path.suffix == ".gltf":
        (path.parent / "box.bin").write_bytes(binary)
    else:
        del said["buffers"][0]["uri"]
    text = json.dumps(said).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    glb = b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks
    path.write_bytes(text if path.suffix == ".gltf" else glb)
    return path


@pytest.mark.parametrize("name", ["box.glb", "box.gltf"])
@pytest.mark.parametrize(("kind", "normalized"), [(5122, True), (5121, True), (5120, True), (5122, False)])
def test_integers_of_gltf_are_what_they_stand_for(tmp_path: Path, name: str, kind: int, normalized: bool) -> None:
    mesh = load_mesh(quantized(tmp_path / name, kind, normalized))
    size = 2.0 * np.ptp(BOX.vertices, axis=0) / np.ptp(BOX.vertices, axis=0).max()
    np.testing.assert_allclose(np.ptp(mesh.points, axis=0), size, rtol=0.02)  # an eighth bit of a quarter
    assert mesh.points[:, 0].min() == pytest.approx(10.0)


def test_gltf_is_in_meters(tmp_path: Path) -> None:
    trimesh.Scene(BOX).export(tmp_path / "box.glb")
    assert load_mesh(tmp_path / "box.glb").unit_known


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_draco_mesh_compression", "ACME_points"])
def test_an_extension_that_a_gltf_requires_and_that_is_not_decoded_is_named(tmp_path: Path, extension: str) -> None:
    path = quantized(tmp_path / "box.glb", 5122, True, extensionsRequired=["KHR_mesh_quantization", extension])
    with pytest.raises(InputError, match=rf"box\.glb: requires the extension {extension}, which is not supported"):
        load_mesh(path)
    quantized(path, 5122, True, extensionsRequired=["KHR_materials_transmission", "EXT_texture_webp"])
    assert load_mesh(path).face_count == 12
