"""Default scene of a mesh by itself."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from meshes import cube, grid, quad_sphere
from pxr import Usd, UsdGeom

from balloon_warp import Simulator, load_scene
from balloon_warp.cli import main
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import build_model, plan_model
from balloon_warp.model.obstacles import shape_obstacle
from balloon_warp.scene import Balloon, Obstacle, Scene
from balloon_warp.scene.overrides import parse_override

Y_IS_UP = ". The file names no up axis, so Y is up; --up Z turns it"


def load_with(path: Path, *overrides: str) -> Scene:
    return load_scene(path, [parse_override(text) for text in overrides])


@pytest.mark.parametrize("kind", ["normal_force", "pressure"])
@pytest.mark.parametrize("scale", [0.01, 200.0])
def test_a_mesh_gets_a_scene_scaled_to_its_size(tmp_path: Path, scale: float, kind: str):
    """The motion is the same at any size of a mesh, up to rounding."""

    def motion(factor: float) -> np.ndarray:
        mesh = quad_sphere(3)
        mesh.points[:] *= factor
        write_obj(tmp_path / "ball.obj", mesh)
        scene = load_with(tmp_path / "ball.obj", f"balloon.inflation.kind={kind}")
        simulator = Simulator(scene, "cpu")
        for _ in range(60):
            simulator.step()
        points = simulator.read_frame().points[0]
        assert np.ptp(points, axis=0)[0] > 1.02 * np.ptp(mesh.points, axis=0)[0]  # it has begun to grow
        assert scene.ground is not None
        assert points[:, 1].min() == pytest.approx(scene.ground.height)  # it has fallen to the floor below it
        return points / factor

    np.testing.assert_allclose(motion(scale), motion(1.0), atol=1e-3)


def test_the_numbers_of_its_scene_are_short_and_the_floor_is_below_it_anywhere(tmp_path: Path):
    for shift in (0.0, 123.45678):
        mesh = quad_sphere(3)
        mesh.points[:] = 0.123456789 * mesh.points + np.array([0.0, shift, 0.0])
        write_obj(tmp_path / "ball.obj", mesh)
        scene = load_with(tmp_path / "ball.obj")
        ball = scene.balloon[0]
        for value in (scene.gravity, ball.mass, ball.helium, ball.damping):
            assert len(repr(value).replace(".", "").lstrip("0")) <= 6
        size, low = np.ptp(mesh.points, axis=0).max(), mesh.points[:, 1].min()
        assert scene.ground is not None
        assert scene.ground.height == pytest.approx(low - 0.05 * size, abs=1e-5 * size)
        assert len(repr(scene.ground.height)) <= 12


@pytest.mark.full
def test_a_mesh_by_itself_gets_half_as_much_gas_again_unless_it_is_said_how_much(tmp_path: Path):
    write_obj(tmp_path / "ball.obj", quad_sphere(3))

    def amounts(*overrides: str) -> list[float]:
        scene = load_with(tmp_path / "ball.obj", "balloon.inflation.kind=gas", "frames=95", *overrides)
        return [float(frame.gas_amounts[0]) for frame in Simulator(scene, "cpu").run()]

    pumped = amounts()
    assert pumped[95] / pumped[0] == pytest.approx(1.5, rel=1e-3)  # the ramp is pumped in steps
    assert np.ptp(amounts("balloon.inflation.start_pressure=100")) == 0.0
    assert np.ptp(amounts("balloon.inflation.amount=160")) == 0.0


@pytest.mark.parametrize(
    "said", ["litres=200", "breaths=3", "moles=5", "pump_curve=[[0, 1], [500, 0]]", "fill_to_pressure=50", "pump=0.5"]
)
def test_a_mesh_by_itself_takes_gas_as_one_says_it(tmp_path: Path, said: str):
    """A mesh by itself takes fields of gas with or without the kind, and without a default pump."""
    write_obj(tmp_path / "ball.obj", quad_sphere(3))
    for kind in ([], ["balloon.inflation.kind=gas"]):
        scene = load_with(tmp_path / "ball.obj", f"balloon.inflation.{said}", *kind)
        inflation = scene.balloon[0].inflation
        assert inflation.kind == "gas"
        assert inflation.pump == (0.5 if said == "pump=0.5" else 0.0)
        plan_model(scene)


@pytest.mark.parametrize("kind", ["normal_force", "pressure", "gas"])
@pytest.mark.parametrize("scale", [1e-6, 1e8])
def test_a_mesh_of_any_size_gets_a_scene(tmp_path: Path, scale: float, kind: str):
    mesh = quad_sphere(2)
    mesh.points[:] *= scale
    write_obj(tmp_path / "ball.obj", mesh)
    assert load_with(tmp_path / "ball.obj", f"balloon.inflation.kind={kind}").balloon[0].inflation.kind == kind


def test_an_open_mesh_is_held_at_its_border_unless_that_is_all_of_it(tmp_path: Path):
    write_obj(tmp_path / "sheet.obj", grid(3, 3))
    write_obj(tmp_path / "strip.obj", grid(3, 1))
    inner = {5, 6, 9, 10}
    assert set(load_scene(tmp_path / "sheet.obj").balloon[0].fixed) == set(range(16)) - inner
    assert len(load_scene(tmp_path / "strip.obj").balloon[0].fixed) == 4  # its first face


def test_a_mesh_scene_follows_how_its_mesh_is_placed(tmp_path: Path):
    """A scaled mesh gets the scene of the smaller mesh, and a turned one keeps its floor below."""
    write_obj(tmp_path / "box.obj", cube())
    small = load_with(tmp_path / "box.obj", "balloon.scale=0.01")
    assert small.gravity == pytest.approx(0.0981)
    turned = load_with(tmp_path / "box.obj", "balloon.rotation=[45, 0, 0]")
    assert turned.ground is not None
    assert turned.ground.height < build_model(turned, "cpu").initial_points.numpy()[:, 1].min()


@pytest.mark.parametrize("kind", ["normal_force", "gas"])
def test_a_known_unit_gives_true_size_and_gravity(tmp_path: Path, kind: str):
    """A known unit gives true size and gravity. The balloon sags by its weight as one of a meter does."""
    mesh = quad_sphere(3)
    mesh.points[:] *= 50.0 / np.ptp(mesh.points[:, 1])
    write_obj(tmp_path / "ball.obj", mesh)
    for unit, size in (("cm", 0.5), ("in", 1.27), ("m", 50.0)):
        scene = load_with(tmp_path / "ball.obj", f"balloon.unit={unit}", f"balloon.inflation.kind={kind}")
        (balloon,) = scene.balloon
        assert scene.gravity == pytest.approx(9.81)
        assert balloon.mass * (scene.gravity - balloon.helium) == pytest.approx(
            2.0 * 1.81 * size, rel=1e-5
        )  # six digits
        assert np.ptp(build_model(scene, "cpu").shapes[0].mesh.points[:, 1]) == pytest.approx(size)
        said = f"ball.obj, {size:.3g} m across, inflates above a floor{Y_IS_UP}. Its unit is {unit}, as given"
        assert scene.description == said


def test_gravity_that_is_scaled_to_a_mesh_is_said_with_what_to_do(tmp_path: Path):
    mesh = cube()
    mesh.points[:] *= 171.8
    write_obj(tmp_path / "cow.obj", mesh)
    said = load_scene(tmp_path / "cow.obj")
    assert said.gravity == 1685.36
    assert said.description == (
        "cow.obj inflates above a floor. Its unit is not known, so gravity is 1685.4 m/s2, which suits its size of "
        "171.8. --unit m, cm, mm, km, in or ft gives it true size and gravity" + Y_IS_UP
    )
    assert load_with(tmp_path / "cow.obj", "gravity=0").description == "cow.obj inflates above a floor" + Y_IS_UP


@pytest.mark.parametrize(("said", "gravity"), [(True, 9.81), (False, 0.0981)])
def test_the_unit_of_a_stage_is_known_where_it_says_one(tmp_path: Path, said: bool, gravity: float):
    """The unit of a stage is known where it is authored: USD's default is centimeters."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "box.usda"))
    if said:
        UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    prim, mesh = UsdGeom.Mesh.Define(stage, "/box"), cube()
    prim.CreatePointsAttr(mesh.points)
    prim.CreateFaceVertexCountsAttr(mesh.face_vertex_counts)
    prim.CreateFaceVertexIndicesAttr(mesh.face_vertex_indices)
    stage.Save()
    assert load_scene(tmp_path / "box.usda").gravity == pytest.approx(gravity)


def test_the_command_says_it_first_and_takes_a_unit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    write_obj(tmp_path / "box.obj", cube())
    run = ["balloon-warp", "run", str(tmp_path / "box.obj"), "--set", "frames=1", "--device", "cpu"]
    run += ["-o", str(tmp_path / "out.usdc")]
    for more, first in (
        (
            [],
            "note: box.obj inflates above a floor. Its unit is not known, so gravity is 9.81 m/s2, which suits its ",
        ),
        (["--unit", "ft"], "note: box.obj, 0.305 m across, inflates above a floor"),
        (["--unit", "furlong"], "error: --unit furlong: expected m, cm, mm, km, in, ft"),
    ):
        monkeypatch.setattr("sys.argv", [*run, *more])
        with pytest.raises(SystemExit) as ended:
            main()
        assert capsys.readouterr().err.startswith(first)
        assert (ended.value.code or 0) == (2 if "furlong" in more else 0)


def test_a_closed_mesh_wound_inward_is_turned_outward(tmp_path: Path):
    mesh = cube()
    inward = replace(mesh, face_vertex_indices=mesh.face_vertex_indices.reshape(-1, 4)[:, ::-1].ravel())
    (shape,) = build_model(Scene(balloon=[Balloon(mesh=inward)]), "cpu").shapes
    assert signed_volume(shape.mesh) == pytest.approx(1.0)
    assert shape.mesh.warnings == (
        "1 closed component winds inward; it has face 1, counting from 1. Such a component is flipped outward.",
    )


def test_the_axis_of_a_file_that_points_up_can_be_told(tmp_path: Path):
    """A cone along Z stands once the up axis is given, in any world; a file that names its axis needs no option."""
    cone = trimesh.creation.cone(radius=0.3, height=1.2)
    cone.export(tmp_path / "cone.stl")
    for world, up_axis in (("Y", 1), ("Z", 2)):
        for told, height in ((["balloon.up=Z"], 1.2), ([], 0.6)):
            scene = load_with(tmp_path / "cone.stl", f"up_axis={world}", *told)
            points = plan_model(scene).shapes[0].mesh.points
            assert np.ptp(points[:, up_axis]) == pytest.approx(height, rel=0.02)  # of 32 corners
            up = "Z is up, as given" if told else "The file names no up axis, so Y is up; --up Z turns it"
            turned = f". It is turned to the scene's {world}" if (world == "Z") != bool(told) else ""
            assert scene.description.endswith(f". {up}{turned}")
            asked = [warning for warning in plan_model(scene).warnings if "names no up axis" in warning]
            assert len(asked) == (world == "Z" and not told)
            obstacle = Obstacle(mesh=tmp_path / "cone.stl", up="Z" if told else None)
            shape = shape_obstacle(0, obstacle, scene)
            assert shape.mesh
            assert np.ptp(shape.mesh.points[:, up_axis]) == pytest.approx(height, rel=0.02)
    trimesh.Scene(cone).export(tmp_path / "cone.glb")
    assert load_scene(tmp_path / "cone.glb").description == (
        "cone.glb, 1.2 m across, inflates above a floor. Y is up, as its file says. Its unit is m, as its file says"
    )
