"""Outputs of a batch: the table in both forms, the stage of the chosen worlds, the command, and refusals."""

import json
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from batches import assert_text_has_the_numbers_of
from commands import status_of
from exported import assert_valid, assert_velocities_are_those_of_the_points
from meshes import quad_sphere
from pxr import Usd, UsdGeom, UsdShade
from small_batch import FRAMES, WORLDS, scene, write_meshes

from balloon_warp import Cluster, InputError, Scene, Simulator, Water, load_scene, run_batch
from balloon_warp.batch import batch as batch_module
from balloon_warp.batch.recorder import Group, plan_groups
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import lay_out, shape, state, world_bytes
from balloon_warp.scene.load import override_scene
from balloon_warp.schedules.one_launch import LanesSchedule
from balloon_warp.usd.balloon import string_curve

never = Mock(side_effect=AssertionError("is not to be called"))
CLUSTER = Cluster(workers=2)
RADII, CHOSEN = np.array([0.1, 0.2, 0.3, 0.4, 0.5]), (1, 2, 4)  # of the spheres, and worlds that are exported


@pytest.fixture(scope="module")
def meshes(tmp_path_factory) -> list[Path]:
    return write_meshes(tmp_path_factory.mktemp("meshes"))


@pytest.fixture(scope="module")
def vary(meshes: list[Path]) -> dict:
    """Return two meshes in turn, which makes two groups of worlds, and two numbers for each world."""
    return {
        "balloon.0.mesh": [meshes[world % 2] for world in range(WORLDS)],
        "sphere.0.radius": RADII,
        "string.1.length": np.linspace(1.0, 3.0, WORLDS),
    }


def prim_in(stage: Usd.Stage, world: int, name: str = "") -> Usd.Prim:
    return stage.GetPrimAtPath(f"/World/World_{world}/{name}".rstrip("/"))


def mesh_in(stage: Usd.Stage, world: int, name: str = "ball") -> UsdGeom.Mesh:
    return UsdGeom.Mesh(prim_in(stage, world, name))


def names_of_worlds(stage: Usd.Stage) -> list[str]:
    names = [prim.GetName() for prim in stage.GetDefaultPrim().GetChildren()]
    return [name for name in names if name.startswith("World_")]


@pytest.fixture(scope="module")
def written(tmp_path_factory, vary: dict) -> Path:
    folder = tmp_path_factory.mktemp("batch") / "out"
    summary = run_batch(scene(), folder, WORLDS, vary, export=[4, 1, 2], device="cpu", name="small")
    assert (summary.worlds, summary.exported_worlds, summary.unhealthy_worlds) == (WORLDS, 3, 0)
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


def test_the_table_has_a_row_for_each_world_and_frame(table: dict[str, np.ndarray], meshes: list[Path], written: Path):
    measures = ["volume", "area", "pressure", "center_height", "largest_stretch", "kinetic_energy", "sphere_0_height"]
    varied = ["balloon.0.mesh", "sphere.0.radius", "string.1.length"]
    assert list(table) == ["world", "frame", "time", *varied, *measures, "health"]
    np.testing.assert_array_equal(table["world"], list(range(WORLDS)) * (FRAMES + 1))
    np.testing.assert_array_equal(table["frame"], np.repeat(np.arange(FRAMES + 1), WORLDS))
    np.testing.assert_array_equal(table["time"], table["frame"] / 30)
    np.testing.assert_array_equal(table["sphere.0.radius"], RADII[table["world"]])
    np.testing.assert_array_equal(table["balloon.0.mesh"], [meshes[world % 2].name for world in table["world"]])
    assert (table["health"] == 1).all()
    assert_text_has_the_numbers_of(written / "table.npz")


def test_each_world_is_as_it_is_alone(table: dict[str, np.ndarray], stage: Usd.Stage, vary: dict):
    assert names_of_worlds(stage) == ["World_1", "World_2", "World_4"]
    for world in range(WORLDS):
        heights, own = [], override_scene(scene(), [(path, values[world]) for path, values in vary.items()])
        for frame in Simulator(own, "cpu", schedule="lanes").run():
            heights.append(frame.sphere_positions[0, 1])
            if world in CHOSEN:
                for number, name in enumerate(("ball", "Sphere_0_1")):
                    points = mesh_in(stage, world, name).GetPointsAttr().Get(frame.number)
                    np.testing.assert_array_equal(points, frame.points[number])
                sphere = UsdGeom.Sphere(prim_in(stage, world, "Sphere_0"))
                moved = sphere.GetLocalTransformation(Usd.TimeCode(frame.number)).ExtractTranslation()
                np.testing.assert_array_equal(moved, frame.sphere_positions[0])
        np.testing.assert_array_equal(table["sphere_0_height"][table["world"] == world], heights)
    for world in CHOSEN:
        assert_velocities_are_those_of_the_points(mesh_in(stage, world), 30.0)


def test_the_stage_is_valid_and_says_what_it_is_and_what_differs_in_each_world(
    stage: Usd.Stage, meshes: list[Path], vary: dict
):
    assert_valid(stage)
    assert stage.GetDefaultPrim().GetPath() == "/World"
    assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Y", 1.0)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 30.0
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, FRAMES)
    for world in CHOSEN:
        properties = prim_in(stage, world).GetPropertiesInNamespace("userProperties")
        assert {each.GetDisplayName(): (each.GetName(), each.Get()) for each in properties} == {
            "balloon.0.mesh": ("userProperties:balloon_0:mesh", meshes[world % 2].name),
            "sphere.0.radius": ("userProperties:sphere_0:radius", vary["sphere.0.radius"][world]),
            "string.1.length": ("userProperties:string_1:length", vary["string.1.length"][world]),
        }


def test_topology_is_stored_once_for_each_mesh(stage: Usd.Stage):
    found = {"faceVertexIndices": [], "material:binding": []}
    stage.GetRootLayer().Traverse("/", lambda path: found.get(path.name, []).append(path.GetPrimPath()))
    with_faces = ["Ground", "Sphere_0_1", "String_0_Knot", "String_1_Knot", "ball", "ball_1"]  # prototypes
    assert sorted(path.name for path in found["faceVertexIndices"]) == with_faces
    assert [path for path in found["material:binding"] if path.HasPrefix("/World/World_1")] == []
    for world, mesh in ((1, quad_sphere(4)), (2, quad_sphere(3)), (4, quad_sphere(3))):
        prim = mesh_in(stage, world)
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
    for world in CHOSEN:
        assert UsdGeom.Sphere(prim_in(stage, world, "Sphere_0")).GetRadiusAttr().Get() == RADII[world]
        box = boxes.ComputeWorldBound(prim_in(stage, world)).ComputeAlignedRange()
        footprints.append([np.array(box.GetMin())[[0, 2]], np.array(box.GetMax())[[0, 2]]])
    for first, (low, high) in enumerate(footprints):
        for other_low, other_high in footprints[:first]:
            assert (high < other_low).any() or (other_high < low).any()
    ground = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Ground")).GetExtentAttr().Get()
    assert (np.array(ground[0])[[0, 2]] < np.min(footprints, axis=(0, 1))).all()
    assert (np.array(ground[1])[[0, 2]] > np.max(footprints, axis=(0, 1))).all()


def test_strings_hang_by_their_own_lengths_from_anchor_to_particle(stage: Usd.Stage, vary: dict):
    for world in CHOSEN:
        box = mesh_in(stage, world, "Sphere_0_1").GetPointsAttr()
        string = UsdGeom.BasisCurves(prim_in(stage, world, "String_1")).GetPointsAttr()
        for time_code in range(FRAMES + 1):
            expected = string_curve((4, 0, 0), box.Get(time_code)[6], vary["string.1.length"][world], (0, 1, 0), 0.0)
            np.testing.assert_array_equal(string.Get(time_code), expected)
            shift = prim_in(stage, world).GetAttribute("xformOp:translate").Get()
            knot = mesh_in(stage, world, "String_1_Knot").ComputeLocalToWorldTransform(time_code)
            np.testing.assert_allclose(np.array(knot)[3, :3] - np.array(shift), expected[-1], atol=1e-6)


def heights_of(stage: Usd.Stage, name: str) -> list[float]:
    """Return the height of a level plane in each world."""
    boxes = UsdGeom.BBoxCache(Usd.TimeCode(0), [UsdGeom.Tokens.default_])
    planes = [boxes.ComputeWorldBound(prim_in(stage, world, name)).ComputeAlignedRange() for world in (0, 1)]
    assert all(plane.GetMin()[1] == plane.GetMax()[1] for plane in planes)
    return [float(plane.GetMin()[1]) for plane in planes]


@pytest.mark.full
def test_where_grounds_anchors_and_water_differ_each_world_has_its_own(tmp_path):
    heights, anchors, levels = [-1.0, 0.25], [0.5, 2.0], [-1.5, 0.125]
    afloat = scene(water=Water(density=1.0))

    def exported(name: str, vary: dict[str, list[float]]) -> Usd.Stage:
        run_batch(afloat, tmp_path / name, 2, {"water.level": levels} | vary, export=[0, 1], device="cpu")
        return Usd.Stage.Open(str(tmp_path / name / "worlds.usdc"))

    stage = exported("out", {"ground.height": heights, "string.1.anchor.1": anchors})
    assert not stage.GetPrimAtPath("/World/Ground")
    assert not stage.GetPrimAtPath("/World/Water")
    assert (heights_of(stage, "Floor"), heights_of(stage, "Pool")) == (heights, levels)
    for world in (0, 1):
        string = UsdGeom.BasisCurves(prim_in(stage, world, "String_1")).GetPointsAttr().Get(0)
        assert tuple(string[0]) == (4.0, anchors[world], 0.0)
    assert_valid(stage)
    stage = exported("alike", {"ground.height": [0.25, 0.25]})
    assert UsdGeom.Mesh(stage.GetPrimAtPath("/World/Ground")).GetPointsAttr().Get()[0][1] == 0.25
    assert not prim_in(stage, 0, "Floor")
    assert prim_in(stage, 0, "Pool")


MIXED = {"balloon.0.mesh": [quad_sphere(n) for n in (2, 3, 2, 3, 2)], "balloon.mass": [1.0, 1.0, 1.0, -1.0, 1.0]}
"""two groups of worlds, and a wrong value in the second of the second: it is told with its number in the batch"""


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"world_count": 0}, r"^world_count 0: expected at least 1$"),
        ({"vary": {"balloon.mesh": ["a.obj"] * 3}}, r"^balloon\.mesh: expected a mesh for each of 5 worlds \(got 3\)$"),
        ({"vary": {"balloon.0.mesh": ["none.obj"] * 5}}, r"^none\.obj: no such file"),
        ({"vary": MIXED}, r"^balloon\.0\.mass: must be greater than 0 \(got -1\.0\), in world 3$"),
        ({"folder": "missing/out"}, r"out: the folder .*missing does not exist$"),
        ({"folder": "file"}, r"file: is a file; expected a folder$"),
    ],
)
def test_mistakes_are_told_before_the_run(tmp_path, change: dict, complaint: str):
    (tmp_path / "file").touch()
    arguments = {"folder": "out", "world_count": 5, "vary": {}} | change
    arguments["folder"] = tmp_path / arguments["folder"]
    with pytest.raises(InputError, match=complaint):
        run_batch(scene(), **arguments, device="cpu", on_frame=never)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("module", "skipped", "cluster"),
    [(batch_module, "plan_groups", None), (batch_module, "plan_groups", CLUSTER), (shape, "relative_thickness", None)],
    ids=["before they get values", "nor on workers", "without finding what is thin"],
)
def test_far_too_many_worlds_are_refused_before_much_work(
    module: ModuleType, skipped: str, cluster: Cluster | None, tmp_path, monkeypatch
):
    """The search for thin parts takes longest, and adds no memory."""
    monkeypatch.setattr(module, skipped, never)
    many = load_scene(scene(frames=400), {"balloon.stiffness.thin": "softer"})
    with pytest.raises(InputError, match=r"^100000000 worlds do not fit: they need .* GiB, and cpu has "):
        run_batch(many, tmp_path, 10**8, device=None if cluster else "cpu", cluster=cluster)
    assert list(tmp_path.iterdir()) == []


def test_all_groups_take_the_step_of_the_stiffest_world(meshes: list[Path]):
    """The balloons are so light that stability asks for more substeps than spheres do."""
    automatic = scene(substeps="auto")
    vary = {"balloon.0.mesh": [meshes[0], meshes[1], meshes[0]], "balloon.mass": [1e-4, 1e-4, 2e-5]}
    alone = [plan_groups(automatic, 1, {path: [values[n]] for path, values in vary.items()}) for n in range(3)]
    groups = plan_groups(automatic, 3, vary)
    assert [group.worlds.tolist() for group in groups] == [[0, 2], [1]]
    assert [group.plan.substeps for group in groups] == [max(one[0].plan.substeps for one in alone)] * 2
    assert len({one[0].plan.substeps for one in alone}) == 3
    with pytest.raises(InputError, match=r"^substeps: \d+ are too few"):
        plan_groups(scene(substeps=alone[0][0].plan.substeps), 3, vary)


def simulated_bytes(groups: list[Group]) -> int:
    models = [lay_out(group.plan, "cpu") for group in groups]
    return sum(model.world_count * (world_bytes(model) + LanesSchedule.world_bytes(model)) for model in models)


def test_a_batch_that_does_not_fit_is_refused_before_anything_is_made(tmp_path, meshes: list[Path], monkeypatch):
    """The memory check counts all groups, the exported worlds and the table: in each case the rest alone would fit."""
    varied = {"balloon.0.mesh": meshes * 20}
    one_mesh = simulated_bytes(plan_groups(scene(), 40, {}))
    two_meshes = simulated_bytes(plan_groups(scene(), 40, varied))
    sums = 40 * (2 * 32 * 40 + 4 * 7)  # 32 lanes of each balloon, seven measures
    row = 40 * 4 * 8  # of the table: seven measures and the health
    table = (FRAMES + 1) * row
    exported = 40 * 5 * (12 * (56 + 8) + 12)  # on the device, and four frames under way

    def refused(usable: float, needed: int, scene: Scene, **arguments: Any) -> None:
        assert usable < needed
        monkeypatch.setattr(state, "free_memory", lambda device: int(usable / state.USABLE))
        with pytest.raises(InputError, match=r"^40 worlds do not fit: ") as refusal:
            run_batch(scene, tmp_path / "out", 40, device="cpu", **arguments)
        fitting = int(str(refusal.value).split()[-2])
        assert fitting == pytest.approx(40 * usable / needed, abs=1)  # rounded down
        assert list(tmp_path.iterdir()) == []

    refused(0.6 * (two_meshes + sums + table), two_meshes + sums + table, scene(), vary=varied)
    refused(one_mesh + sums + table, one_mesh + sums + table + exported, scene(), export=range(40))
    refused(one_mesh + sums + table, one_mesh + sums + table + 1000 * row, scene(frames=FRAMES + 1000))


SCENE = """
frames = 3
balloon = [{ mesh = "ball.obj", inflation = { k_normal = 0.2 } }]
sphere = [{ position = [0, 4, 0], radius = 1.2 }]
"""
TABLES = ("table.npz", "table.csv", "worlds.npz", "worlds.csv")
BELOW = "must be greater than 0 (got -1.0), in world 1"
BETWEEN_RUNS = "cannot differ between worlds, only between runs of `compare`"


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "ball.toml").write_text(SCENE)
    write_obj(tmp_path / "scenes" / "ball.obj", quad_sphere(2))
    write_obj(tmp_path / "other.obj", quad_sphere(3))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def batch(*words: str) -> int:
    return status_of("batch", "scenes/ball.toml", "--device", "cpu", *words)


@pytest.mark.full
def test_a_batch_in_which_nothing_varies_says_so(folder: Path, capsys):
    note = "\nnote: all worlds are alike; --vary PATH=LOW:HIGH"
    for words, alike in (("2", True), ("2 --vary sphere.0.mass=10,10", True), ("1", False)):
        assert batch("--worlds", *words.split()) == 0
        assert (note in capsys.readouterr().err) == alike


def test_the_summary_is_one_object_and_the_files_are_where_it_says(folder: Path, capsys):
    varied = ["--vary", "balloon.inflation.k_normal=0:8", "--vary", "sphere.0.mass=1,10,100", "--grid"]
    assert batch("--worlds", "9", *varied, "--export", "0,5", "-o", "out", "--json") == 0
    captured = capsys.readouterr()
    line, *_ = captured.err.splitlines()  # a slow machine also estimates its time
    assert line.startswith("ball: 9 worlds, 234 particles, ")
    summary = json.loads(captured.out)
    assert (summary["worlds"], summary["exported_worlds"], summary["unhealthy_worlds"]) == (9, 2, 0)
    assert (summary["scene"], summary["frames"], summary["particles"]) == ("ball", 3, 9 * 26)
    assert summary["table"] == ["out/table.npz", "out/table.csv"]
    with np.load(folder / "out" / "table.npz") as table:
        np.testing.assert_array_equal(table["balloon.inflation.k_normal"][:9], np.arange(9.0))
        np.testing.assert_array_equal(table["sphere.0.mass"][:9], [1, 10, 100] * 3)
        volume = table["volume"].reshape(4, 9)
    assert (np.diff(volume[-1]) > 0.0).all()  # the more a balloon is inflated, the larger it is
    assert names_of_worlds(Usd.Stage.Open(summary["stage"])) == ["World_0", "World_5"]


@pytest.mark.full
def test_what_blew_up_is_told(folder: Path, capsys):
    assert batch("--worlds", "3", "--vary", "balloon.inflation.k_normal=0,9e11,0") == 0
    captured = capsys.readouterr()
    said, warned = captured.out.splitlines(), captured.err.splitlines()[1:]
    assert said[0].startswith("ball: 3 worlds, 78 particles, 3 frames of ")
    assert warned[0].startswith("warning: the simulation blew up in frame 1, world 1, substep 1 of ")
    assert warned[1:] == ["warning: 1 of 3 worlds blew up: health 0; their rows repeat the last good frame"]
    assert said[1:] == [f"wrote ball_batch/{name}" for name in (*TABLES, "manifest.json")]


def test_the_stage_of_an_earlier_batch_does_not_stay_beside_a_later_table(folder: Path, capsys):
    assert batch("--worlds", "2", "--export", "all") == 0
    said = "wrote ball_batch/worlds.usdc: 0.05 s at 60 frames/s; in Blender, set the frame rate to 60, "
    assert said in capsys.readouterr().out
    assert batch("--worlds", "2", "--vary", "gravity=2:1") == 2
    assert (folder / "ball_batch" / "worlds.usdc").exists()  # a batch that is refused leaves all as it was
    capsys.readouterr()
    assert batch("--worlds", "3") == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("removed ball_batch/worlds.usdc")
    assert {path.name for path in (folder / "ball_batch").iterdir()} == {*TABLES, "manifest.json"}
    assert batch("--worlds", "3") == 0
    assert "removed" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--vary", "balloon.scale=1,-1"], f"--vary balloon.scale: balloon.0.scale: {BELOW}\n"),
        (["--vary", "frames=1,2"], f"--vary frames: {BETWEEN_RUNS}; what can: "),
        (["--vary", "normals=cached,fresh"], "--vary normals=cached,fresh: expected PATH=LOW:HIGH with LOW below HIGH"),
        (["--export", "64"], "--export 64: no world 64, the batch has worlds 0 to 63"),
        (["--worlds", "0", "--vary", "gravity=1,2"], "--worlds 0: expected at least 1"),
    ],
)
def test_a_mistake_gets_one_sentence_and_status_2(folder: Path, capsys, arguments, sentence):
    assert batch(*arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"error: {sentence}")
    assert len(captured.err.splitlines()) == 1
    assert not (folder / "ball_batch").exists()


@pytest.mark.full
def test_a_step_that_only_soft_thin_parts_allow_is_no_reason_for_an_early_refusal(monkeypatch):
    monkeypatch.setattr(batch_module, "MANY", 1)
    stiff = {"balloon.stiffness.structural": 5000.0}
    stable, stiffer = (
        plan_groups(load_scene("squirrel_tether", stiff | {"balloon.stiffness.thin": thin}), 1, {})[0].plan.substeps
        for thin in ("softer", "alike")
    )
    assert stable < stiffer
    batch_module.require_room(load_scene("squirrel_tether", stiff | {"substeps": stable}), 2, device="cpu")
