"""glTF at its default pose: nodes, instances, skins and morph weights, as the specification of glTF 2.0 has them."""

import base64
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import cube
from numpy.typing import NDArray

from balloon_warp import InputError, PolygonMesh, load_mesh
from balloon_warp.mesh.obj import write_obj

TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
KINDS = {"f4": 5126, "u2": 5123, "u1": 5121}
POINTS = cube().points
TRIANGLES = cube().face_vertex_indices.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].ravel()


class Gltf:
    """A file of cubes from 0 to 1 m, a mesh each."""

    def __init__(self, *nodes: dict[str, Any], **more: Any):
        self._binary = b""
        self.tree: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}
        self.tree |= {"nodes": list(nodes), "accessors": [], "bufferViews": [], **more}
        self.points = self.array(POINTS, "f4")
        self.indices = self.array(TRIANGLES[:, None], "u2")
        self.tree["meshes"] = [self.mesh(name="Cube")]

    def mesh(self, **more: Any) -> dict[str, Any]:
        return {"primitives": [{"attributes": {"POSITION": self.points}, "indices": self.indices}], **more}

    def array(self, rows: Any, kind: str, **more: Any) -> int:
        """Add an accessor."""
        data = np.atleast_2d(np.asarray(rows)).astype(f"<{kind}")
        accessor = {"bufferView": self.view(data), "componentType": KINDS[kind], "count": len(data)}
        self.tree["accessors"].append(accessor | {"type": TYPES[data.shape[1]], **more})
        return len(self.tree["accessors"]) - 1

    def view(self, data: NDArray[Any]) -> int:
        self._binary += b"\0" * (-len(self._binary) % 4)
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self._binary), "byteLength": data.nbytes})
        self._binary += data.tobytes()
        return len(self.tree["bufferViews"]) - 1

    def read(self, folder: Path, prim: str | None = None) -> PolygonMesh:
        uri = f"data:application/octet-stream;base64,{base64.b64encode(self._binary).decode()}"
        self.tree["buffers"] = [{"byteLength": len(self._binary), "uri": uri}]
        (folder / "mesh.gltf").write_text(json.dumps(self.tree))
        return load_mesh(folder / "mesh.gltf", prim)


def box(mesh: PolygonMesh) -> list[list[float]]:
    """Return the lower and the upper corner of a mesh."""
    return [mesh.points.min(axis=0).round(6).tolist(), mesh.points.max(axis=0).round(6).tolist()]


@pytest.mark.parametrize(
    ("of_mesh", "of_node", "size"),
    [
        pytest.param(None, None, 1.0, id="no weights"),
        pytest.param([1.0], None, 2.0, id="the mesh's"),
        pytest.param([1.0], [0.5], 1.5, id="the node's before the mesh's"),
        pytest.param([0.5], [0.0], 1.0, id="the node's are 0"),
    ],
)
@pytest.mark.parametrize("sparse", [False, True])
def test_morph_weights_are_applied(tmp_path: Path, of_mesh: Any, of_node: Any, size: float, sparse: bool):
    file = Gltf({"mesh": 0, **({"weights": of_node} if of_node else {})})
    target = file.array(POINTS, "f4")
    if sparse:  # as Blender writes a shape key that moves only some points
        moved = np.flatnonzero(POINTS.any(axis=1))
        indices, values = file.view(moved.astype("<u2")), file.view(POINTS[moved].astype("<f4"))
        accessor = file.tree["accessors"][target]
        del accessor["bufferView"]
        where = {"bufferView": indices, "componentType": 5123}
        accessor["sparse"] = {"count": len(moved), "indices": where, "values": {"bufferView": values}}
    [primitive] = file.tree["meshes"][0]["primitives"]
    primitive["targets"] = [{"POSITION": target}]
    if of_mesh:
        file.tree["meshes"][0]["weights"] = of_mesh
    mesh = file.read(tmp_path)
    assert box(mesh) == [[0.0] * 3, [size] * 3]
    assert mesh.warnings == ()


def skinned(*, weights: Any = ((1.0, 0.0, 0.0, 0.0),) * 8, bound: bool = True) -> Gltf:
    """Return a cube whose node is elsewhere, and two joints, of which the second stands 3 m above."""
    file = Gltf(
        {"children": [1, 2]},
        {"mesh": 0, "skin": 0, "translation": [100.0, 0.0, 0.0]},
        {"translation": [0.0, 1.0, 0.0], "children": [3]},
        {"translation": [0.0, 2.0, 0.0]},
    )
    file.tree["skins"] = [{"joints": [2, 3]}]
    if bound:
        inverse = np.tile(np.eye(4), (2, 1, 1))
        inverse[:, 3, 1] = -1.0  # columns come first
        file.tree["skins"][0]["inverseBindMatrices"] = file.array(inverse.reshape(2, 16), "f4")
    [primitive] = file.tree["meshes"][0]["primitives"]
    primitive["attributes"]["JOINTS_0"] = file.array([[0, 1, 0, 0]] * 8, "u1")
    primitive["attributes"]["WEIGHTS_0"] = file.array(255.0 * np.array(weights), "u1", normalized=True)
    return file


def test_skins_go_where_their_joints_are(tmp_path: Path):
    assert box(skinned().read(tmp_path)) == [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
    assert box(skinned(bound=False).read(tmp_path)) == [[0.0, 1.0, 0.0], [1.0, 2.0, 1.0]]
    upper = [(0.0, 1.0, 0.0, 0.0) if y else (1.0, 0.0, 0.0, 0.0) for _, y, _ in POINTS]
    assert box(skinned(weights=upper).read(tmp_path)) == [[0.0, 0.0, 0.0], [1.0, 3.0, 1.0]]


def test_a_skin_that_cannot_be_read_is_named(tmp_path: Path):
    file = skinned()
    file.tree["skins"][0]["joints"] = [2, 77]
    file.tree["nodes"][1]["name"] = "Body"
    (sentence,) = file.read(tmp_path).warnings
    assert sentence.startswith("The skin of Body cannot be read")


def test_instances_that_are_used_but_not_required_are_placed(tmp_path: Path):
    extension = "EXT_mesh_gpu_instancing"
    node = {"mesh": 0, "translation": [10.0, 0.0, 0.0], "extensions": {extension: {"attributes": {}}}}
    file = Gltf(node, extensionsUsed=[extension])
    attributes = node["extensions"][extension]["attributes"]
    attributes["TRANSLATION"] = file.array([(0, 0, 0), (5, 0, 0)], "f4")
    attributes["SCALE"] = file.array([(1, 1, 1), (1, 2, 1)], "f4")
    mesh = file.read(tmp_path)
    assert (mesh.vertex_count, mesh.warnings) == (16, ())
    assert box(mesh) == [[10.0, 0.0, 0.0], [16.0, 2.0, 1.0]]
    attributes["TRANSLATION"] = 77
    (sentence,) = file.read(tmp_path).warnings
    assert "instances of node 0 cannot be read (EXT_mesh_gpu_instancing)" in sentence


@pytest.mark.parametrize(
    ("extension", "named"), [("ACME_points", True), ("KHR_materials_ior", False), ("EXT_meshopt_compression", False)]
)
def test_an_extension_that_may_change_the_shape_is_named(tmp_path: Path, extension: str, named: bool):
    warnings = Gltf({"mesh": 0}, extensionsUsed=[extension]).read(tmp_path).warnings
    assert warnings == ((f"Uses the extension {extension}, which is passed over.",) if named else ())


ASIDE = {"mesh": 0, "translation": [2.0, 0.0, 0.0]}
HIDDEN = {"extensions": {"KHR_node_visibility": {"visible": False}}}


@pytest.mark.parametrize(
    ("first", "second", "end"),
    [
        pytest.param({"camera": 0, "translation": [5.0, 0.0, 0.0]}, ASIDE, 8.0, id="what is below a camera"),
        pytest.param({}, ASIDE | HIDDEN, 1.0, id="what is not visible is left out"),
    ],
)
def test_each_is_where_its_nodes_say(tmp_path: Path, first: dict[str, Any], second: dict[str, Any], end: float):
    file = Gltf({"mesh": 0, "children": [1], **first}, second)
    file.tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]
    assert box(file.read(tmp_path)) == [first.get("translation", [0.0] * 3), [end, 1.0, 1.0]]


def test_a_chain_of_nodes_takes_no_longer_than_a_list(tmp_path: Path):
    nodes = [{"children": [number + 1], "translation": [1.0, 0.0, 0.0]} for number in range(20_000)]
    assert box(Gltf(*nodes, {"mesh": 0}).read(tmp_path))[0] == [20_000.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("deep.gltf", '{"asset":{"version":"2.0"},"x":' + "[" * 100_000, r"cannot be read as GLTF \(it is nested too"),
        ("digits.gltf", '{"asset":' + "9" * 5_000 + "}", r"cannot be read as GLTF \(Exceeds the limit"),
        ("circle.gltf", '{"nodes":[{"children":[0]}],"scenes":[{"nodes":[7]}]}', r"it has no list index"),
        ("pipe.gltf", '{"buffers":[{"byteLength":36,"uri":"pipe.bin"}]}', r"pipe\.bin: is not a regular file"),
        ("gone.gltf", '{"buffers":[{"byteLength":36,"uri":"gone.bin"}]}', r"gone\.bin: cannot be read \(No such"),
    ],
)
def test_hostile_files_get_a_sentence(tmp_path: Path, name: str, text: str, said: str):
    os.mkfifo(tmp_path / "pipe.bin")
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=said):
        load_mesh(tmp_path / name)


@pytest.mark.parametrize("suffix", [".glb", ".stl", ".ply", ".obj", ".usda", ".usdc"])
def test_a_pipe_or_a_device_is_refused_unread(tmp_path: Path, suffix: str):
    os.mkfifo(tmp_path / f"pipe{suffix}")
    (tmp_path / f"zero{suffix}").symlink_to("/dev/zero")
    for name in ("pipe", "zero"):
        with pytest.raises(InputError, match=r"is not a regular file"):
            load_mesh(tmp_path / f"{name}{suffix}")


def objects(folder: Path, kind: str) -> Path:
    """Write a table of a top and a leg, beside a balloon."""
    path = folder / f"mesh.{kind}"
    if kind == "obj":
        write_obj(path, cube())
        lines = [line for line in path.read_text().splitlines() if line[0] != "#"]
        path.write_text("\n".join([*lines[:8], "o Top", *lines[8:10], "o Leg", lines[10], "o Balloon", *lines[11:]]))
        return path
    file = Gltf({"name": "Table", "children": [1, 2]}, {"name": "Top", "mesh": 0}, {"name": "Leg", "mesh": 0})
    file.tree["nodes"].append({"name": "Balloon", "mesh": 0, "translation": [9.0, 0.0, 0.0]})
    file.tree["scenes"][0]["nodes"] = [0, 3]
    file.read(folder)
    return folder / "mesh.gltf"


@pytest.mark.parametrize("kind", ["obj", "gltf"])
def test_an_object_is_taken_by_its_name(tmp_path: Path, kind: str):
    path = objects(tmp_path, kind)
    balloon = load_mesh(path, "Balloon")
    whole = 3 if kind == "obj" else 12
    assert (balloon.name, balloon.face_count, balloon.warnings) == ("Balloon", whole, ())
    assert set(balloon.face_vertex_indices.tolist()) == set(range(balloon.vertex_count))
    assert load_mesh(path, ["Top", "/Leg"]).face_count == (3 if kind == "obj" else 24)
    if kind == "gltf":
        assert load_mesh(path, "/Table/Leg").face_count == 12
        assert load_mesh(path, "Table").face_count == 24
    with pytest.raises(InputError, match=r"has no object Baloon \(it has .*Top.*\); did you mean Balloon"):
        load_mesh(path, "Baloon")
