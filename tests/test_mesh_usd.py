"""Transforms, times and winding of USD meshes."""

import json
from pathlib import Path

import numpy as np
import pytest
from inspecting import command
from meshes import cube, prism
from pxr import Gf, Usd, UsdGeom, Vt

from balloon_warp import Balloon, Body, Obstacle, PolygonMesh, Scene, load_scene
from balloon_warp.errors import InputError
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.usd import read_usd
from balloon_warp.model import plan_model

# USD holds points in float32.
ROUND_OFF = 1e-6


def add_mesh(stage: Usd.Stage, path: str, mesh: PolygonMesh) -> UsdGeom.Mesh:
    prim = UsdGeom.Mesh.Define(stage, path)
    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(mesh.points.astype(np.float32)))
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_counts))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_indices))
    return prim


def stage_at(path: Path) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    return stage


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usd"])
def test_polygons_units_and_axis(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"stage{suffix}"
    stage = stage_at(path)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    add_mesh(stage, "/World/prism", prism(5))
    stage.Save()
    mesh = read_usd(path)
    np.testing.assert_allclose(mesh.points, prism(5).points, atol=ROUND_OFF)
    assert mesh.face_vertex_counts.tolist() == prism(5).face_vertex_counts.tolist()
    assert mesh.face_vertex_indices.tolist() == prism(5).face_vertex_indices.tolist()
    assert (mesh.name, mesh.up_axis, mesh.meters_per_unit, mesh.warnings) == ("prism", "Z", 0.01, ())


def test_a_stage_that_says_no_unit_is_in_centimeters(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "stage.usda"))
    add_mesh(stage, "/cube", cube())
    stage.Save()
    mesh = read_usd(tmp_path / "stage.usda")
    assert (mesh.up_axis, mesh.meters_per_unit) == ("Y", 0.01)  # the fallbacks of USD


def test_points_are_placed_in_the_world(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "stage.usda")
    UsdGeom.Xform.Define(stage, "/World").AddTranslateOp().Set(Gf.Vec3d(10, 0, 0))
    prim = add_mesh(stage, "/World/cube", cube())
    prim.AddRotateZOp().Set(90.0)
    prim.AddScaleOp().Set(Gf.Vec3f(2, 1, 1))
    stage.Save()
    x, y, z = cube().points.T
    # Scaled first, then turned a quarter from x to y, then moved.
    expected = np.stack([10.0 - y, 2.0 * x, z], axis=1)
    np.testing.assert_allclose(read_usd(tmp_path / "stage.usda").points, expected, atol=ROUND_OFF)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("left_handed", [False, True])
def test_winding_is_outward_whatever_the_handedness(tmp_path: Path, mirrored: bool, left_handed: bool) -> None:
    stage = stage_at(tmp_path / "stage.usda")
    mesh = prism(5)
    if left_handed:
        first_kept = [[face[0], *face[:0:-1]] for face in np.split(mesh.face_vertex_indices, [5, 10, 14, 18, 22, 26])]
        mesh.face_vertex_indices[:] = np.concatenate(first_kept)
    prim = add_mesh(stage, "/prism", mesh)
    if left_handed:
        prim.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    if mirrored:
        prim.AddScaleOp().Set(Gf.Vec3f(-1, 1, 1))
    stage.Save()
    assert signed_volume(read_usd(tmp_path / "stage.usda")) == pytest.approx(signed_volume(prism(5)), abs=ROUND_OFF)


def test_default_time_comes_before_samples_and_the_earliest_sample_otherwise(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "stage.usda")
    points = add_mesh(stage, "/cube", cube()).GetPointsAttr()
    for time in (3.0, 7.0):
        points.Set(Vt.Vec3fArray.FromNumpy((time * cube().points).astype(np.float32)), time)
    stage.Save()
    assert signed_volume(read_usd(tmp_path / "stage.usda")) == pytest.approx(1.0, abs=ROUND_OFF)
    points.ClearDefault()
    stage.Save()
    assert signed_volume(read_usd(tmp_path / "stage.usda")) == pytest.approx(27.0, rel=ROUND_OFF)


def test_a_transform_of_samples_only_is_taken_at_its_earliest(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "stage.usda")
    scale = UsdGeom.Xform.Define(stage, "/World").AddScaleOp()
    scale.Set(Gf.Vec3f(2, 2, 2), 5.0)
    scale.Set(Gf.Vec3f(9, 9, 9), 6.0)
    add_mesh(stage, "/World/cube", cube())
    stage.Save()
    assert signed_volume(read_usd(tmp_path / "stage.usda")) == pytest.approx(8.0, rel=ROUND_OFF)


def test_all_meshes_that_are_shown_are_taken_as_one_or_the_named(tmp_path: Path) -> None:
    path = tmp_path / "stage.usda"
    stage = stage_at(path)
    add_mesh(stage, "/World/a", cube())
    add_mesh(stage, "/World/more/b", prism(5)).AddTranslateOp().Set(Gf.Vec3d(3, 0, 0))
    add_mesh(stage, "/World/more/c", cube()).AddTranslateOp().Set(Gf.Vec3d(6, 0, 0))
    add_mesh(stage, "/World/hidden", cube()).MakeInvisible()
    add_mesh(stage, "/World/more/guide", cube()).CreatePurposeAttr("guide")
    add_mesh(stage, "/World/proxy", cube()).CreatePurposeAttr("proxy")
    add_mesh(stage, "/World/render", cube()).CreatePurposeAttr("render")
    stage.Save()
    every = read_usd(path)
    assert (every.name, every.face_count) == ("stage", 6 + 7 + 6 + 6)
    assert signed_volume(every) == pytest.approx(3 * 1.0 + signed_volume(prism(5)), rel=ROUND_OFF)
    assert {name: len(vertices) for name, vertices in every.groups.items()} == {"a": 8, "b": 10, "c": 8, "render": 8}
    assert every.points[every.groups["c"]].min(axis=0)[0] == pytest.approx(6.0)
    assert every.warnings == (
        "Left out of the stage: /World/more/guide (purpose guide), /World/hidden (invisible), /World/proxy "
        "(purpose proxy); prim selects other meshes.",
    )
    below = read_usd(path, "/World/more")
    assert (below.name, below.face_count, below.warnings) == ("more", 13, ())
    named = read_usd(path, "/World/hidden")  # whether it is shown or not
    assert (named.name, named.face_count, named.warnings) == ("hidden", 6, ())
    assert read_usd(path, ["/World/more/c", "/World/a"]).face_count == 12
    with pytest.raises(
        InputError, match=r"below prim /World/mor/c \(it has .* and 2 more\); did you mean /World/more/c"
    ):
        read_usd(path, "/World/mor/c")


def test_a_stage_that_shows_no_mesh_is_refused_with_the_reason(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "stage.usda")
    add_mesh(stage, "/collider", cube()).MakeInvisible()
    stage.Save()
    with pytest.raises(
        InputError, match=r'has no visible mesh: /collider \(invisible\); prim = "/collider" selects it'
    ):
        read_usd(tmp_path / "stage.usda")


def test_parts_of_one_name_are_told_apart(tmp_path: Path) -> None:
    """Parts of one name are told apart by their paths, as exporters write a mesh of the same name below each object."""
    stage = stage_at(tmp_path / "stage.usda")
    for x, wheel in enumerate(("left", "right")):
        add_mesh(stage, f"/{wheel}/mesh", cube()).AddTranslateOp().Set(Gf.Vec3d(3 * x, 0, 0))
    stage.Save()
    assert sorted(read_usd(tmp_path / "stage.usda").groups) == ["/left/mesh", "/right/mesh"]


@pytest.mark.full
def test_a_prim_is_named_in_a_scene_and_on_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "stage.usda"
    stage = stage_at(path)
    add_mesh(stage, "/a", cube())
    add_mesh(stage, "/b", prism(5)).AddTranslateOp().Set(Gf.Vec3d(3, 0, 0))
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
    with pytest.raises(InputError, match=r"selects a part of a USD stage; expected a USD file as mesh"):
        plan_model(Scene(balloon=[Balloon(mesh=cube(), prim="/a")]))


def test_a_mesh_inside_an_instance_is_found(tmp_path: Path) -> None:
    path = tmp_path / "stage.usda"
    stage = stage_at(path)
    stage.CreateClassPrim("/prototype")
    add_mesh(stage, "/prototype/cube", cube())
    instance = UsdGeom.Xform.Define(stage, "/instance")
    instance.GetPrim().GetReferences().AddInternalReference("/prototype")
    instance.GetPrim().SetInstanceable(True)
    instance.AddTranslateOp().Set(Gf.Vec3d(5, 0, 0))
    stage.Save()
    np.testing.assert_allclose(read_usd(path).points, cube().points + (5, 0, 0), atol=ROUND_OFF)


def broken(attribute: str, value: object):
    def spoil(prim: UsdGeom.Mesh) -> None:
        if value is None:
            prim.GetPrim().RemoveProperty(attribute)
        else:
            prim.GetPrim().GetAttribute(attribute).Set(value)

    return spoil


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (broken("points", None), "/cube: has no points"),
        (broken("points", []), "/cube: has 0 vertices and 6 faces; expected both"),
        (broken("points", [(0, 0, 0)]), "/cube: a face refers to point 7; expected 0 to 0"),
        (broken("points", [(float("nan"), 0, 0)] * 8), "/cube: vertex 1: coordinates must be finite"),
        (broken("faceVertexCounts", None), "/cube: has no faceVertexCounts"),
        (broken("faceVertexCounts", [4] * 5), "/cube: the face sizes add up to 20 corners, but 24 are given"),
        (broken("faceVertexCounts", [2, 6, 4, 4, 4, 4]), "/cube: face 1: a face needs three corners or more (got 2)"),
        (broken("faceVertexIndices", [-1] * 24), "/cube: a face refers to point -1; expected 0 to 7"),
    ],
)
def test_broken_meshes_are_refused_in_a_sentence(tmp_path: Path, spoil, sentence: str) -> None:
    stage = stage_at(tmp_path / "stage.usda")
    spoil(add_mesh(stage, "/cube", cube()))
    stage.Save()
    with pytest.raises(InputError) as refusal:
        read_usd(tmp_path / "stage.usda")
    assert str(refusal.value).startswith(f"{tmp_path / 'stage.usda'}: {sentence}")


def test_a_stage_without_a_mesh_is_refused(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "stage.usda")
    UsdGeom.Sphere.Define(stage, "/sphere")
    stage.Save()
    with pytest.raises(InputError, match=r"stage\.usda: has no mesh"):
        read_usd(tmp_path / "stage.usda")


@pytest.mark.parametrize("name", ["stage.usda", "stage.usdc", "stage.usdz"])
def test_what_is_no_stage_is_refused_and_usd_prints_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    (tmp_path / name).write_bytes(b"no stage")
    with pytest.raises(InputError, match="cannot be read as a USD stage"):
        read_usd(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_a_reference_that_is_not_there_is_passed_over_quietly(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    stage = stage_at(tmp_path / "stage.usda")
    add_mesh(stage, "/cube", cube()).GetPrim().GetReferences().AddReference("./gone.usda")
    stage.Save()
    capfd.readouterr()
    assert read_usd(tmp_path / "stage.usda").face_count == 6
    assert capfd.readouterr() == ("", "")
