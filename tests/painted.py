"""Cubes with a color a side, by an image or by materials, in several formats; and a reader of .glb files."""

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import face_starts, face_vector_areas

SIDES = [(220, 30, 30), (30, 180, 40), (40, 60, 220), (230, 200, 30), (200, 40, 200), (40, 200, 200)]
"""sRGB of the sides toward -x, x, -y, y, -z and z"""
PLAIN = "".join(f"newmtl {side}\nKd {0.1 * side:g} 0.5 0.25\n" for side in range(6))
"""materials of a color a side, by the sides' numbers"""
CORNERS = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
QUADS = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
"""corners of the sides, in the order of `SIDES`, seen from outside"""
WITHIN = np.array([(0.2, 0.2), (0.8, 0.2), (0.8, 0.8), (0.2, 0.8)])
"""where they are in a side's tile of the image"""


def places() -> np.ndarray:
    """Return the corners of each side in the image, three tiles wide and two high, shape (6, 4, 2), v up."""
    tiles = np.array([(side % 3, 1 - side // 3) for side in range(6)])
    return (tiles[:, None] + WITHIN) / (3.0, 2.0)


def atlas() -> Image.Image:
    """Return the image: the first three sides above the others."""
    rows = np.array(SIDES, np.uint8).reshape(2, 3, 3)
    return Image.fromarray(rows.repeat(16, axis=0).repeat(16, axis=1))


def linear(color) -> np.ndarray:
    """Return linear values of sRGB from 0 to 255."""
    values = np.asarray(color) / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def write_painted(folder: Path, kind: str) -> Path:
    """Write the cube with its image beside it or in it; kind is the suffix."""
    path = folder / f"cube.{kind}"
    if kind == "obj":
        write_obj_cube(folder)
    elif kind == "usda":
        write_usd_cube(folder)
    else:
        triangles = np.arange(24).reshape(6, 4)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
        material = trimesh.visual.material.PBRMaterial(name="paint", baseColorTexture=atlas())
        visual = trimesh.visual.TextureVisuals(uv=places().reshape(-1, 2), material=material)
        mesh = trimesh.Trimesh(CORNERS[QUADS].reshape(-1, 3), triangles, process=False, visual=visual)
        if kind == "glb":
            mesh.export(path)
        else:
            files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh))
            tree = json.loads(files.pop("model.gltf"))
            tree["images"] = [{"uri": "the%20atlas.png"}]
            atlas().save(folder / "the atlas.png")
            path.write_text(json.dumps(tree))
            for name, data in files.items():
                (folder / name).write_bytes(data)
    return path


def write_obj_cube(folder: Path, materials: str = "newmtl paint\nKd 0 0 0\nmap_Kd images/the atlas.png\n") -> Path:
    """Write a cube with each side in the material of its number, where there is one; else in "paint"."""
    (folder / "images").mkdir(exist_ok=True)
    atlas().save(folder / "images/the atlas.png")
    (folder / "cube.mtl").write_text(materials)
    lines = ["mtllib cube.mtl", *("v {:g} {:g} {:g}".format(*tuple(p)) for p in CORNERS)]
    lines += ["vt {:.9g} {:.9g}".format(*tuple(place)) for place in places().reshape(-1, 2)]
    for side, quad in enumerate(QUADS):
        lines.append(f"usemtl {side}" if f"newmtl {side}\n" in materials else "usemtl paint")
        lines.append("f " + " ".join(f"{vertex + 1}/{4 * side + n + 1}" for n, vertex in enumerate(quad)))
    (folder / "cube.obj").write_text("\n".join(lines) + "\n")
    return folder / "cube.obj"


def write_usd_cube(folder: Path) -> Path:
    """Write a left-handed cube, so that its corners are reversed when it is read."""
    atlas().save(folder / "atlas.png")
    stage = Usd.Stage.CreateNew(str(folder / "cube.usda"))
    mesh = UsdGeom.Mesh.Define(stage, "/cube")
    mesh.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    mesh.CreatePointsAttr(CORNERS)
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr(QUADS[:, ::-1].ravel().tolist())
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("uv", Sdf.ValueTypeNames.TexCoord2fArray, "faceVarying")
    st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(places()[:, ::-1].reshape(-1, 2), np.float32)))
    material = UsdShade.Material.Define(stage, "/paint")
    surface = UsdShade.Shader.Define(stage, "/paint/s")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    show_image(material, surface, "atlas.png", "uv")
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    stage.Save()
    return folder / "cube.usda"


def show_image(material: UsdShade.Material, surface: UsdShade.Shader, file: str, primvar: str) -> None:
    """Let an image be the color of a surface, where a primvar says."""
    texture, reader = (
        UsdShade.Shader.Define(material.GetPrim().GetStage(), material.GetPath().AppendChild(name))
        for name in ("t", "r")
    )
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(primvar)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    surface.GetInput("diffuseColor").ConnectToSource(texture.ConnectableAPI(), "rgb")


def seen_sides(mesh: PolygonMesh) -> list[tuple[int, tuple[float, ...]]]:
    """Return the number of each face's side and its color, sRGB from 0 to 255 or linear from 0 to 1, as an image or a
    material has it."""
    looks = mesh.looks
    assert looks is not None
    normals, found = face_vector_areas(mesh), []
    for face, start in enumerate(face_starts(mesh).tolist()):
        axis = int(np.abs(normals[face]).argmax())
        side, number = 2 * axis + int(normals[face, axis] > 0.0), int(looks.of_corners[start])
        look = looks.materials[number]
        color: tuple[float, ...] = look.color
        if look.picture is not None:
            assert mesh.texture_coordinates is not None
            uv = mesh.texture_coordinates[start : start + mesh.face_vertex_counts[face]].mean(axis=0)
            color = color_in(look.picture.data, uv)
        found.append((side, color))
    return found


def color_in(data, uv) -> tuple[float, ...]:
    """Return the color in an image or its file at u and v, v up."""
    image = (data if isinstance(data, Image.Image) else Image.open(io.BytesIO(data))).convert("RGB")
    return tuple(np.asarray(image)[int((1.0 - uv[1]) * image.height), int(uv[0] * image.width)].tolist())


class Glb:
    """Contents of a .glb file, and its arrays."""

    def __init__(self, path: Path):
        data = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        said = data[20 : 20 + size]
        binary, kind = struct.unpack_from("<I4s", data, 20 + size)
        self.said: dict[str, Any] = json.loads(said)
        json.dumps(self.said, allow_nan=False)  # JSON has no NaN
        assert 28 + size + binary == length
        self.binary = data[28 + size :]
        self.nodes = {node["name"]: node for node in self.said["nodes"]}

    def array(self, number: int) -> np.ndarray:
        """Return the numbers of an accessor."""
        accessor = self.said["accessors"][number]
        view = self.said["bufferViews"][accessor["bufferView"]]
        columns = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        kind = {5126: np.float32, 5125: np.uint32}[accessor["componentType"]]
        assert view["byteLength"] == accessor["count"] * columns * 4
        values = np.frombuffer(self.binary, kind, accessor["count"] * columns, view["byteOffset"])
        values = values.reshape(-1, columns)
        if "min" in accessor:
            np.testing.assert_array_equal(values.min(axis=0), np.float32(accessor["min"]))
            np.testing.assert_array_equal(values.max(axis=0), np.float32(accessor["max"]))
        return values

    def channels(self, name: str) -> dict[str, tuple[np.ndarray, np.ndarray, str]]:
        """Return a node's channels by their targets: times, values, and interpolation."""
        [animation] = self.said["animations"]
        found = {}
        for channel in animation["channels"]:
            if self.said["nodes"][channel["target"]["node"]]["name"] == name:
                sampler = animation["samplers"][channel["sampler"]]
                times, values = self.array(sampler["input"])[:, 0], self.array(sampler["output"])
                found[channel["target"]["path"]] = times, values, sampler["interpolation"]
        return found

    def primitive(self, name: str) -> dict[str, Any]:
        return self.said["meshes"][self.nodes[name]["mesh"]]["primitives"][0]

    def shapes(self, name: str, attribute: str = "POSITION") -> np.ndarray:
        """Return the shapes of a mesh at each keyframe's weights, shape (keyframes, vertex_count, 3)."""
        primitive = self.primitive(name)
        rest = self.array(primitive["attributes"][attribute]).astype(np.float64)
        moves = np.array([self.array(target[attribute]) for target in primitive["targets"]], np.float64)
        times, weights, how = self.channels(name)["weights"]
        assert how == "LINEAR"
        return rest + np.einsum("ft,tvi->fvi", weights.reshape(len(times), -1), moves)
