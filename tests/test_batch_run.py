"""Outputs of a batch: the table in both forms, and the stage of the chosen worlds."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import quad_sphere
from motion import assert_velocities_are_those_of_the_points
from pxr import Sdf, Usd, UsdGeom, UsdShade, UsdValidation
from small_batch import FRAMES, WORLDS, scene, write_meshes

from balloon_warp import Simulator, run_batch
from balloon_warp.outputs.usd import growing
from balloon_warp.outputs.usd.grid_layout import grid_shifts
from balloon_warp.outputs.usd.string_curve import string_curve
from balloon_warp.scene import Water
from balloon_warp.scene.overrides import override_scene

RADII = np.array([0.1, 0.2, 0.3, 0.4, 0.5])


@pytest.fixture(scope="module")
def meshes(tmp_path_factory) -> list[Path]:
    return write_meshes(tmp_path_factory.mktemp("meshes"))


@pytest.fixture(scope="module")
def vary(meshes: list[Path]) -> dict:
    """Return two meshes in turn, which makes two groups of worlds, and a radius and a length for each world."""
    return {
        "balloon.0.mesh": [meshes[world % 2] for world in range(WORLDS)],
        "sphere.0.radius": RADII,
        "string.1.length": np.linspace(1.0, 3.0, WORLDS),
    }


def alone(vary: dict, world: int) -> Simulator:
    return Simulator(
        override_scene(scene(), [(path, values[world]) for path, values in vary.items()]), "cpu", schedule="lanes"
    )


@pytest.fixture(scope="module")
def written(tmp_path_factory, vary: dict) -> Path:
    folder = tmp_path_factory.mktemp("batch") / "out"
    summary = run_batch(scene(), folder, WORLDS, vary, export=[4, 1, 2], device="cpu", name="small")
    assert summary.worlds == WORLDS
    assert summary.exported_worlds == 3
    assert summary.unhealthy_worlds == 0
    assert summary.particles == 3 * (56 + 8) + 2 * (98 + 8)
    written = [*summary.table, *summary.worlds_table, str(summary.stage), summary.manifest]
    assert sorted(map(Path, written)) == sorted(folder.iterdir())
    return folder


@pytest.fixture
def table(written: Path) -> dict[str, np.ndarray]:
    with np.load(written / "table.npz") as columns:
        return dict(columns)


@pytest.fixture
def stage(written: Path) -> Usd.Stage:
    return Usd.Stage.Open(str(written / "worlds.usdc"))


def test_the_table_has_a_row_for_each_world_and_frame(table: dict[str, np.ndarray], meshes: list[Path]):
    measures = [
        "volume",
        "area",
        "pressure",
        "center_height",
        "largest_stretch",
        "kinetic_energy",
        "sphere_0_height",
        "health",
    ]
    assert list(table) == ["world", "frame", "time", "balloon.0.mesh", "sphere.0.radius", "string.1.length", *measures]
    np.testing.assert_array_equal(table["world"], list(range(WORLDS)) * (FRAMES + 1))
    np.testing.assert_array_equal(table["frame"], np.repeat(np.arange(FRAMES + 1), WORLDS))
    np.testing.assert_array_equal(table["time"], table["frame"] / 30)
    np.testing.assert_array_equal(table["sphere.0.radius"], RADII[table["world"]])
    np.testing.assert_array_equal(table["balloon.0.mesh"], [str(meshes[world % 2]) for world in table["world"]])
    assert (table["health"] == 1).all()


def test_csv_and_npz_are_the_same_to_the_last_bit(written: Path, table: dict[str, np.ndarray]):
    with (written / "table.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == list(table)
    assert len(rows) == WORLDS * (FRAMES + 1)
    for name, texts in zip(header, zip(*rows, strict=True), strict=True):
        np.testing.assert_array_equal(np.array(texts).astype(table[name].dtype), table[name])


def test_each_world_is_as_it_is_alone(table: dict[str, np.ndarray], stage: Usd.Stage, vary: dict):
    """A world is bit-identical alone and in a batch on the CPU; the stage has the chosen worlds only."""
    assert [p.GetName() for p in stage.GetDefaultPrim().GetChildren() if p.GetName().startswith("World_")] == [
        "World_1",
        "World_2",
        "World_4",
    ]
    for world in range(WORLDS):
        heights = []
        for frame in alone(vary, world).run():
            heights.append(frame.sphere_positions[0, 1])
            if world in (1, 2, 4):
                for number, name in enumerate(("ball", "Sphere_0_1")):
                    prim = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/World_{world}/{name}"))
                    np.testing.assert_array_equal(prim.GetPointsAttr().Get(frame.number), frame.points[number])
                sphere = UsdGeom.Sphere(stage.GetPrimAtPath(f"/World/World_{world}/Sphere_0"))
                moved = sphere.GetLocalTransformation(Usd.TimeCode(frame.number)).ExtractTranslation()
                np.testing.assert_array_equal(moved, frame.sphere_positions[0])
        np.testing.assert_array_equal(table["sphere_0_height"][table["world"] == world], heights)


def test_velocities_are_those_of_the_points(stage: Usd.Stage):
    for world in (1, 2, 4):
        prim = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/World_{world}/ball"))
        assert_velocities_are_those_of_the_points(prim, 30.0)


def test_each_world_says_what_differs_in_it(stage: Usd.Stage, meshes: list[Path], vary: dict):
    for world in (1, 2, 4):
        prim = stage.GetPrimAtPath(f"/World/World_{world}")
        said = {attribute.GetDisplayName(): attribute for attribute in prim.GetPropertiesInNamespace("userProperties")}
        assert {path: attribute.GetName() for path, attribute in said.items()} == {
            "balloon.0.mesh": "userProperties:balloon_0:mesh",
            "sphere.0.radius": "userProperties:sphere_0:radius",
            "string.1.length": "userProperties:string_1:length",
        }
        assert said["balloon.0.mesh"].Get() == meshes[world % 2].name
        for path in ("sphere.0.radius", "string.1.length"):
            assert said[path].Get() == vary[path][world]


def test_every_validator_passes(stage: Usd.Stage):
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) >= 20
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetMessage() for error in errors] == []


def test_stage_says_what_it_is(stage: Usd.Stage):
    assert stage.GetDefaultPrim().GetPath() == "/World"
    assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Y", 1.0)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 30.0
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, FRAMES)


def test_topology_is_stored_once_for_each_mesh(stage: Usd.Stage):
    """Only the layer's prototypes have faces and materials; each world composes them."""
    with_faces, with_materials = [], []

    def look(path: Any) -> None:
        if path.name == "faceVertexIndices":
            with_faces.append(path.GetPrimPath().name)
        if path.name == "material:binding" and path.GetPrimPath().HasPrefix("/World/World_1"):
            with_materials.append(path)

    stage.GetRootLayer().Traverse("/", look)
    assert sorted(with_faces) == ["Ground", "Sphere_0_1", "String_0_Knot", "String_1_Knot", "ball", "ball_1"]
    assert with_materials == []
    for world, mesh in ((1, quad_sphere(4)), (2, quad_sphere(3)), (4, quad_sphere(3))):
        prim = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/World_{world}/ball"))
        np.testing.assert_array_equal(prim.GetFaceVertexIndicesAttr().Get(), mesh.face_vertex_indices)
        assert prim.GetSubdivisionSchemeAttr().Get() == "catmullClark"
    for prim in stage.Traverse():
        if UsdGeom.Gprim(prim):
            assert UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0], prim.GetPath()


def test_extents_hold_at_every_sample(stage: Usd.Stage):
    checked = 0
    for prim in stage.Traverse():
        if (boundable := UsdGeom.Boundable(prim)) and prim.GetName() != "Ground":
            for time_code in range(FRAMES + 1):
                computed = UsdGeom.Boundable.ComputeExtentFromPlugins(boundable, Usd.TimeCode(time_code))
                np.testing.assert_allclose(boundable.GetExtentAttr().Get(time_code), np.array(computed), atol=1e-6)
                checked += 1
    assert checked == 3 * 7 * (FRAMES + 1)  # two balloons, a sphere, two strings, their knots


def test_worlds_stand_side_by_side_with_their_own_spheres(stage: Usd.Stage):
    boxes = UsdGeom.BBoxCache(Usd.TimeCode(0), [UsdGeom.Tokens.default_])
    footprints = []
    for world in (1, 2, 4):
        sphere = UsdGeom.Sphere(stage.GetPrimAtPath(f"/World/World_{world}/Sphere_0"))
        assert sphere.GetRadiusAttr().Get() == RADII[world]
        box = boxes.ComputeWorldBound(stage.GetPrimAtPath(f"/World/World_{world}")).ComputeAlignedRange()
        footprints.append([np.array(box.GetMin())[[0, 2]], np.array(box.GetMax())[[0, 2]]])
    for first, (low, high) in enumerate(footprints):
        for other_low, other_high in footprints[:first]:
            assert (high < other_low).any() or (other_high < low).any()
    ground = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Ground")).GetExtentAttr().Get()
    assert (np.array(ground[0])[[0, 2]] < np.min(footprints, axis=(0, 1))).all()
    assert (np.array(ground[1])[[0, 2]] > np.max(footprints, axis=(0, 1))).all()


def test_strings_hang_by_their_own_lengths_from_anchor_to_particle(stage: Usd.Stage, vary: dict):
    for world in (1, 2, 4):
        box = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/World_{world}/Sphere_0_1")).GetPointsAttr()
        string = UsdGeom.BasisCurves(stage.GetPrimAtPath(f"/World/World_{world}/String_1")).GetPointsAttr()
        for time_code in range(FRAMES + 1):
            expected = string_curve((4, 0, 0), box.Get(time_code)[6], vary["string.1.length"][world], (0, 1, 0), 0.0)
            np.testing.assert_array_equal(string.Get(time_code), expected)
            shift = stage.GetPrimAtPath(f"/World/World_{world}").GetAttribute("xformOp:translate").Get()
            knot = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/World_{world}/String_1_Knot"))
            place = np.array(knot.ComputeLocalToWorldTransform(time_code))[3, :3] - np.array(shift)
            np.testing.assert_allclose(place, expected[-1], atol=1e-6)


def test_where_grounds_and_anchors_differ_each_world_has_its_own(tmp_path):
    heights, anchors = np.array([-1.0, 0.25]), np.array([0.5, 2.0])
    vary = {"ground.height": heights, "string.1.anchor.1": anchors}
    run_batch(scene(), tmp_path / "out", 2, vary, export=[0, 1], device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "out" / "worlds.usdc"))
    assert not stage.GetPrimAtPath("/World/Ground")
    boxes = UsdGeom.BBoxCache(Usd.TimeCode(0), [UsdGeom.Tokens.default_])
    for world in (0, 1):
        floor = boxes.ComputeWorldBound(stage.GetPrimAtPath(f"/World/World_{world}/Floor")).ComputeAlignedRange()
        assert floor.GetMin()[1] == floor.GetMax()[1] == heights[world]
        string = UsdGeom.BasisCurves(stage.GetPrimAtPath(f"/World/World_{world}/String_1")).GetPointsAttr().Get(0)
        assert tuple(string[0]) == (4.0, anchors[world], 0.0)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert UsdValidation.ValidationContext(validators).Validate(stage) == []
    run_batch(scene(), tmp_path / "alike", 2, {"ground.height": heights[[1, 1]]}, export=[0, 1], device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "alike" / "worlds.usdc"))
    assert UsdGeom.Mesh(stage.GetPrimAtPath("/World/Ground")).GetPointsAttr().Get()[0][1] == heights[1]
    assert not stage.GetPrimAtPath("/World/World_0/Floor")


def test_where_water_differs_each_world_has_its_own(tmp_path):
    levels = np.array([-1.0, 0.25])
    afloat = scene(water=Water(density=1.0))
    run_batch(afloat, tmp_path / "out", 2, {"water.level": levels}, export=[0, 1], device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "out" / "worlds.usdc"))
    assert not stage.GetPrimAtPath("/World/Water")
    assert stage.GetPrimAtPath("/World/Ground")  # which is alike in both
    boxes = UsdGeom.BBoxCache(Usd.TimeCode(0), [UsdGeom.Tokens.default_])
    for world in (0, 1):
        pool = boxes.ComputeWorldBound(stage.GetPrimAtPath(f"/World/World_{world}/Pool")).ComputeAlignedRange()
        assert pool.GetMin()[1] == pool.GetMax()[1] == levels[world]


@pytest.mark.parametrize(("up_axis", "flat"), [("Y", 1), ("Z", 2)])
def test_the_grid_is_square_and_centered(up_axis: str, flat: int):
    shifts = grid_shifts(9, 2.0, up_axis)
    across = np.delete(shifts, flat, axis=1)
    np.testing.assert_array_equal(shifts[:, flat], 0.0)
    np.testing.assert_array_equal(
        np.unique(across, axis=0), [(2.0 * i, 2.0 * j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    )


def test_saving_often_gives_the_same_samples(written: Path, vary: dict, tmp_path, monkeypatch):
    """A file that is appended to after each frame has the samples of one that is written once."""
    monkeypatch.setattr(growing, "SAVE_BYTES", 0)
    run_batch(scene(), tmp_path / "out", WORLDS, vary, export=[4, 1, 2], device="cpu")
    often, once = (Sdf.Layer.FindOrOpen(str(folder / "worlds.usdc")) for folder in (tmp_path / "out", written))
    assert often.ExportToString() == once.ExportToString()


def test_no_export_no_stage(tmp_path):
    summary = run_batch(scene(frames=1), tmp_path, 2, device="cpu")
    assert summary.stage is None
    assert {path.stem for path in tmp_path.iterdir()} == {"manifest", "table", "worlds"}
    assert not (tmp_path / "worlds.usdc").exists()


@pytest.mark.full
def test_a_world_that_blows_up_is_marked_and_never_written(tmp_path):
    """A pull that no step is small enough for marks its world; the other world is as it is alone."""
    vary = {"balloon.inflation.k_normal": [0.2, 9e11]}
    summary = run_batch(scene(), tmp_path, 2, vary, export=[0, 1], device="cpu")
    assert summary.unhealthy_worlds == 1
    with np.load(tmp_path / "table.npz") as table:
        health = table["health"].reshape(FRAMES + 1, 2)
        volume = table["volume"].reshape(FRAMES + 1, 2)
        assert all(np.isfinite(table[name]).all() for name in table)
    assert health[:, 0].all()
    assert health[:, 1].tolist() == [1] + [0] * FRAMES
    np.testing.assert_array_equal(volume[:, 1], volume[0, 1])
    stage = Usd.Stage.Open(str(tmp_path / "worlds.usdc"))
    for time_code in range(FRAMES + 1):
        bad = UsdGeom.Mesh(stage.GetPrimAtPath("/World/World_1/ball")).GetPointsAttr()
        np.testing.assert_array_equal(bad.Get(time_code), bad.Get(0))
    assert np.ptp([attribute_height(stage, time_code) for time_code in (0, FRAMES)]) > 0.0


def attribute_height(stage: Usd.Stage, time_code: int) -> float:
    return float(
        np.mean(np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/World/World_0/ball")).GetPointsAttr().Get(time_code)))
    )
