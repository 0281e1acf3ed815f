"""Formats read through trimesh, and what loading by suffix refuses."""

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
