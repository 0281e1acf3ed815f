"""Mesh by itself: a balloon of the same shape, however it is meshed, that stands."""

from dataclasses import replace

import numpy as np
import pytest
import solid_shapes
from meshes import cube, quad_sphere

from balloon_warp import Simulator, load_scene
from balloon_warp.cli import main
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume, vertex_areas
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import plan_model
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness
from balloon_warp.scene.overrides import override_scene
from balloon_warp.springs import build_springs
from balloon_warp.springs.across import springs_across
from balloon_warp.springs.even import even_scales, film_tension
from balloon_warp.swelling import foretold_swellings

SPHERES = {
    "16 x 32": lambda: solid_shapes.uv_sphere(16, 32),
    "32 x 16": lambda: solid_shapes.uv_sphere(32, 16),
    "64 x 32": lambda: solid_shapes.uv_sphere(64, 32),
    "ico": solid_shapes.ico_sphere,
    "quads": lambda: quad_sphere(8),
    "stretched quads": solid_shapes.stretched_quad_sphere,
    "scattered": lambda: solid_shapes.scattered_sphere(600),
    "denser on one side": lambda: solid_shapes.scattered_sphere(1200, denser=4.0),
}


def at_the_end(mesh: PolygonMesh, seconds: float, **overrides: object) -> tuple[np.ndarray, np.ndarray]:
    """Return the mesh's points at the start and after so many seconds, in its default scene, at 24 frames a second."""
    scene = load_scene(mesh, [("frames_per_second", 24.0), *overrides.items()])
    simulator = Simulator(scene, "cpu")
    for _ in range(round(24.0 * seconds)):
        simulator.step()
    return simulator.model.shapes[0].mesh.points, simulator.read_frame().points[0].astype(np.float64)


@pytest.mark.parametrize("name", SPHERES)
def test_a_ball_stays_a_ball_however_it_is_meshed(name: str):
    """A ball is as high as wide within 2 %, on the floor, whose push is about 1 %. By springs of one constant a ball of
    32 times 16 faces becomes 0.86 times as high as wide, and one of 16 times 32 is 1.29 times as high."""
    before, after = at_the_end(SPHERES[name](), 3.0)
    wide, high, deep = np.ptp(after, axis=0) / np.ptp(before, axis=0)
    assert high / np.sqrt(wide * deep) == pytest.approx(1.0, abs=0.02)
    assert wide / deep == pytest.approx(1.0, abs=0.02)
    assert wide == pytest.approx(1.1, abs=0.02)


@pytest.mark.full
@pytest.mark.parametrize("name", solid_shapes.SHAPES)
def test_a_closed_mesh_of_any_shape_swells_alike_and_keeps_its_features(name: str):
    """The volume grows by 1.2 to 1.8, and the size by less than a ball's of 1.8 times its volume. A film alone made it
    11 times as large of a cup, and 8 times of a plate. The height stays."""
    mesh = solid_shapes.solid(name)
    before, after = at_the_end(mesh, 4.0)
    volume = signed_volume(replace(mesh, points=after)) / signed_volume(mesh)
    assert 1.2 < volume < 1.8
    larger = np.ptp(after, axis=0) / np.ptp(before, axis=0)
    assert larger[1] > 0.95
    assert larger.max() < 1.8 ** (1 / 3) + 0.15
    (said,) = foretold_swellings(load_scene(mesh))
    assert said.volume == pytest.approx(volume, abs=0.03)  # which has no weight


def test_the_stretch_is_what_is_asked_for():
    """The stretch of a ball's skin is the requested one; a given pressure overrides it."""
    ball = quad_sphere(6)
    for stretch in (0.05, 0.3):
        before, after = at_the_end(ball, 3.0, **{"balloon.inflation.stretch": stretch, "gravity": 0.0})
        sizes = np.linalg.norm(after - after.mean(axis=0), axis=1) / np.linalg.norm(before, axis=1)
        assert sizes.mean() == pytest.approx(1.0 + stretch, rel=0.01)
    assert load_scene(ball, {"balloon.inflation.pressure": 7.0}).balloon[0].inflation.pressure == 7.0
    given = Scene(balloon=[Balloon(mesh=ball, inflation=Inflation(pressure=7.0))])
    assert override_scene(given, [("balloon.inflation.stretch", 0.1)]).balloon[0].inflation.is_automatic


def test_run_scenes_and_inspect_take_a_stretch_and_say_what_it_comes_to(tmp_path, monkeypatch, capsys):
    write_obj(tmp_path / "ball.obj", quad_sphere(3))
    ball, out = str(tmp_path / "ball.obj"), str(tmp_path / "out.usda")
    for words in (
        ["run", ball, "--inflate", "0.2", "--frames", "1", "--device", "cpu", "-o", out, "--json"],
        ["scenes", ball, "--inflate", "0.2"],
        ["inspect", ball, "--inflate", "0.2"],
    ):
        monkeypatch.setattr("sys.argv", ["balloon-warp", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code in (None, 0)
        said = capsys.readouterr()
        wanted = "stretch = 0.2" if words[0] == "scenes" else "auto pressure 74.95 Pa, volume 1.00 -> 1.73"
        assert wanted in said.out + said.err
        assert words[0] != "run" or '"pressure": 74.9' in said.out


def test_an_even_skin_has_the_same_tension_both_ways_at_each_vertex():
    """Even springs give an isotropic tension at each vertex: half the sum of k L^2 t t^T over the vertex's area, in the
    surface; a square grid's springs keep their constants."""
    constants = np.array([100.0, 50.0, 20.0])
    mesh = solid_shapes.scattered_sphere(300)
    springs = build_springs(mesh)
    pulls = constants[springs.kind] * even_scales(mesh, springs, constants)
    ways = mesh.points[springs.pairs[:, 1]] - mesh.points[springs.pairs[:, 0]]
    tensors = np.zeros((mesh.vertex_count, 3, 3))
    for end in (0, 1):
        np.add.at(tensors, springs.pairs[:, end], 0.5 * pulls[:, None, None] * ways[:, :, None] * ways[:, None, :])
    across = np.eye(3) - mesh.points[:, :, None] * mesh.points[:, None, :]  # on a sphere the normals are the places
    tensions = np.linalg.eigvalsh(across @ tensors @ across)[:, 1:] / vertex_areas(mesh)[:, None]
    np.testing.assert_allclose(tensions / film_tension(constants), 1.0, atol=0.1)


def test_springs_go_across_what_is_thin_from_wall_to_wall():
    """Springs join the walls of a thin plate straight across; a ball has none, and two free parts have none between
    them."""
    plate = solid_shapes.solid("plate")
    pairs = springs_across(plate, between_parts=True).pairs
    ways = plate.points[pairs[:, 1]] - plate.points[pairs[:, 0]]
    heights = np.abs(ways[:, 1])
    assert len(pairs) > 0.4 * plate.vertex_count
    assert np.median(heights) == pytest.approx(np.ptp(plate.points[:, 1]), rel=0.01)
    assert not len(springs_across(quad_sphere(8), between_parts=True).pairs)
    hollow = solid_shapes.solid("hollow")
    for together in (True, False):
        pairs = springs_across(hollow, between_parts=together).pairs
        lengths = np.linalg.norm(hollow.points[pairs[:, 1]] - hollow.points[pairs[:, 0]], axis=1)
        assert (np.median(lengths) < 0.2) == together  # the wall is 0.1 m thick, the hollow and all about 0.7 m wide


def test_masses_lie_where_springs_are_stiff_and_make_for_a_long_step():
    """Masses follow the stiffness: a ball with narrow faces at its poles takes half as many substeps."""
    ball = solid_shapes.uv_sphere(64, 32)
    alike, even = (plan_model(Scene(balloon=[Balloon(mesh=ball, stiffness=Stiffness(even=e))])) for e in (False, True))
    assert even.shapes[0].mass_share.sum() == pytest.approx(1.0)
    assert even.substeps < 0.6 * alike.substeps


def test_nothing_of_it_needs_area_springs_or_volume():
    flat = replace(cube(), points=cube().points * (1.0, 0.0, 1.0))
    none = {"structural": 0.0, "shear": 0.0, "flexion": 0.0}
    for mesh, constants in ((flat, {}), (cube(), {"structural": 0.0}), (cube(), none)):
        stiffness = Stiffness(even=True, thin="tied", **constants)
        plan = plan_model(Scene(balloon=[Balloon(mesh=mesh, stiffness=stiffness)]))
        assert np.isfinite(plan.parameters["keyframe_values"]).all()
        assert np.isfinite(plan.shapes[0].stiffness_scale).all()
