"""Mesh by itself: a balloon of the same shape, however it is meshed, that stands; thin parts of it."""

import re
from dataclasses import replace

import cad_shapes
import numpy as np
import pytest
import solid_shapes
from commands import status_of
from meshes import box, cube, grid, joined, mesh_of, quad_sphere, rings
from odd_meshes import without
from trajectories import stepped

from balloon_warp import Balloon, Inflation, PolygonMesh, Scene, Simulator, Stiffness, build_springs, load_scene
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.thickness import LEAST, relative_thickness
from balloon_warp.mesh.topology import signed_volume, total_area, vertex_areas
from balloon_warp.model import plan_model
from balloon_warp.model.many_substeps import coarse_said, many_substeps_said
from balloon_warp.run.job import foretold_swellings
from balloon_warp.scene.around import STRETCH
from balloon_warp.scene.load import override_scene
from balloon_warp.springs.even import even_scales, film_tension, springs_across

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
    simulator = stepped(Simulator(scene, "cpu"), round(24.0 * seconds))
    return simulator.model.shapes[0].mesh.points, simulator.read_frame().points[0].astype(np.float64)


@pytest.mark.full
@pytest.mark.parametrize("name", SPHERES)
def test_a_ball_stays_a_ball_however_it_is_meshed(name: str):
    """A ball is as high as wide within 2 %, on the floor, whose push is about 1 %. By springs of one constant a ball of
    32 times 16 faces becomes 0.86 times as high as wide, and one of 16 times 32 is 1.29 times as high."""
    before, after = at_the_end(SPHERES[name](), 3.0)
    wide, high, deep = np.ptp(after, axis=0) / np.ptp(before, axis=0)
    assert high / np.sqrt(wide * deep) == pytest.approx(1.0, abs=0.02)
    assert wide / deep == pytest.approx(1.0, abs=0.02)
    assert wide == pytest.approx(1.0 + STRETCH, abs=0.02)


@pytest.mark.full
@pytest.mark.parametrize("name", solid_shapes.SHAPES)
def test_a_closed_mesh_of_any_shape_swells_alike_and_keeps_its_features(name: str):
    """The volume grows as a ball's, within a tenth: the pressure for it is foretold at another one. The size grows by
    less than that of a ball of 1.8 times its volume. A film alone made the volume 11 times as large of a cup, and 8
    times of a plate. The height stays."""
    mesh = solid_shapes.solid(name)
    before, after = at_the_end(mesh, 4.0)
    volume = signed_volume(replace(mesh, points=after)) / signed_volume(mesh)
    assert volume == pytest.approx((1.0 + STRETCH) ** 3, abs=0.1)
    larger = np.ptp(after, axis=0) / np.ptp(before, axis=0)
    assert larger[1] > 0.95
    assert larger.max() < 1.8 ** (1 / 3) + 0.15
    (said,) = foretold_swellings(load_scene(mesh))
    assert said.volume == pytest.approx(volume, abs=0.03)  # which has no weight


def test_the_stretch_is_what_is_asked_for_and_a_given_pressure_overrides_it():
    ball = quad_sphere(6)
    for stretch in (0.05, 0.3):
        before, after = at_the_end(ball, 3.0, **{"balloon.inflation.stretch": stretch, "gravity": 0.0})
        sizes = np.linalg.norm(after - after.mean(axis=0), axis=1) / np.linalg.norm(before, axis=1)
        assert sizes.mean() == pytest.approx(1.0 + stretch, rel=0.01)
    assert load_scene(ball, {"balloon.inflation.pressure": 7.0}).balloon[0].inflation.pressure == 7.0
    given = Scene(balloon=[Balloon(mesh=ball, inflation=Inflation(pressure=7.0))])
    assert override_scene(given, [("balloon.inflation.stretch", 0.1)]).balloon[0].inflation.is_automatic


RUN = "run ball.obj --frames 1 --device cpu -o out.usda"
PRESSURE = r"auto pressure 74\.95 Pa, volume 1\.00 -> 1\.73"
SHORT = r"A frame takes \d+ substeps, since its mass of 0\.00374 kg is small for its springs"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        pytest.param(f"{RUN} --inflate 0.2 --json", rf'{PRESSURE}(?s:.*)"pressure": 74\.9', id="run takes a stretch"),
        pytest.param("scenes ball.obj --inflate 0.2", r"stretch = 0\.2", id="scenes takes a stretch"),
        pytest.param("inspect ball.obj --inflate 0.2", PRESSURE, id="inspect says what a stretch comes to"),
        pytest.param(f"{RUN} --unit mm", rf"^note: .*{SHORT}", id="the first line of a run says why a step is short"),
        pytest.param("inspect ball.obj --unit mm", SHORT, id="inspect says why a step is short"),
    ],
)
def test_commands_say_what_a_mesh_by_itself_comes_to(words: str, said: str, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_obj("ball.obj", quad_sphere(3))
    assert status_of(*words.split()) == 0
    out, err = capsys.readouterr()
    assert re.search(said.replace(" ", r"\s+"), err + out)


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
    plate = solid_shapes.solid("plate")
    pairs = springs_across(plate, between_parts=True).pairs
    ways = plate.points[pairs[:, 1]] - plate.points[pairs[:, 0]]
    heights = np.abs(ways[:, 1])
    assert len(pairs) > 0.4 * plate.vertex_count
    assert np.median(heights) == pytest.approx(np.ptp(plate.points[:, 1]), rel=0.01)
    with_a_hole = without(plate, np.arange(plate.face_count) == plate.face_count - 1)
    assert len(springs_across(with_a_hole, between_parts=True).pairs) > 0.9 * len(pairs)
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


@pytest.mark.parametrize(
    ("mesh", "overrides", "why"),
    [
        pytest.param(cad_shapes.sheet(5e-4, 8), {}, "springs across its thin walls are stiff; balloon.st", id="across"),
        pytest.param(cad_shapes.slivers(), {"frames_per_second": 20.0}, "its narrow faces have stiff", id="narrow"),
        pytest.param(cad_shapes.blocks(), {"frames_per_second": 10.0}, "its parts are tied by stiff", id="ties"),
        pytest.param(quad_sphere(6), {"balloon.unit": "mm"}, "its mass of 0.004 kg is small for its", id="mass"),
        pytest.param(quad_sphere(20), {"frames_per_second": 15.0}, "it has 2,402 particles; remesh with", id="many"),
        pytest.param(
            quad_sphere(20),
            {"balloon.material": "latex", "frames_per_second": 15.0},
            "latex is stiff for its mass: springs take ",
            id="latex",
        ),
    ],
)
def test_a_short_step_is_explained(mesh: PolygonMesh, overrides: dict, why: str):
    plan = plan_model(load_scene(mesh, overrides))
    said = many_substeps_said(plan.scene, plan.shapes, plan.substeps)
    assert said is not None
    assert said.startswith(f"A frame takes {plan.substeps} substeps, since {why}")
    assert said.endswith("helps")


@pytest.mark.parametrize(
    ("mesh", "said"),
    [
        (
            quad_sphere(3),
            "mesh is coarse and shows its faces (56 particles, faces up to 0.27 of its size): ",
        ),
        (cad_shapes.blocks(), "mesh is coarse"),
        (quad_sphere(8), None),
        (quad_sphere(20), None),
    ],
)
def test_a_coarse_mesh_gets_a_remedy(mesh: PolygonMesh, said: str | None):
    """Only one by itself: a scene's balloon may be as coarse as it is."""
    plan = plan_model(load_scene(mesh))
    found = coarse_said(plan.scene, plan.shapes)
    assert (found is None) if said is None else (found or "").startswith(said)
    of_scene = Scene(balloon=[Balloon(mesh=mesh)])
    assert coarse_said(of_scene, plan.shapes) is None


def test_nothing_of_it_needs_area_springs_or_volume():
    flat = replace(cube(), points=cube().points * (1.0, 0.0, 1.0))
    none = {"structural": 0.0, "shear": 0.0, "flexion": 0.0}
    for mesh, constants in ((flat, {}), (cube(), {"structural": 0.0}), (cube(), none)):
        stiffness = Stiffness(even=True, thin="tied", **constants)
        plan = plan_model(Scene(balloon=[Balloon(mesh=mesh, stiffness=stiffness)]))
        assert np.isfinite(plan.parameters["keyframe_values"]).all()
        assert np.isfinite(plan.shapes[0].stiffness_scale).all()


AROUND = 16
"""corners of each ring"""


def ball_with_handle(handle: float, length: float) -> PolygonMesh:
    """Return a ball of radius 1, and a tube upon it of this radius and length."""
    turn = np.linspace(-1.4, np.arccos(handle), 8)  # the quads of both are as long as wide
    edge = 2.0 * np.pi * handle / AROUND
    tube = np.arange(1, int(length / edge) + 1) * edge
    radii = np.concatenate([np.cos(turn), np.full(len(tube), handle), [0.5 * handle]])
    top = np.sin(turn[-1])
    return rings(radii, np.concatenate([np.sin(turn), top + tube, [top + tube[-1] + 0.5 * handle]]))


@pytest.mark.physics
def test_a_sphere_is_as_thick_as_a_sphere_wherever_and_however_divided():
    for cells in (4, 8, 12):
        thickness = relative_thickness(quad_sphere(cells))
        assert thickness.min() > 0.9
        assert np.ptp(thickness) < 0.06


@pytest.mark.physics
def test_a_tube_is_thin_in_proportion_to_its_radius():
    """A long tube is 6.4 radii over 2.43 of the radius of the sphere with its area in the middle. Size does not
    matter."""
    for radius in (0.05, 0.1, 0.2):
        mesh = rings(np.full(60, radius), np.linspace(0.0, 6.0, 60))
        sphere = np.sqrt(total_area(mesh) / (4.0 * np.pi))
        middle = relative_thickness(mesh)[30 * AROUND]
        assert middle == pytest.approx(6.4 * radius / (2.43 * sphere), rel=0.2)
        mesh.points[:] *= 64.0
        assert relative_thickness(mesh)[30 * AROUND] == pytest.approx(middle, rel=1e-6)


@pytest.mark.physics
def test_what_cannot_be_measured_counts_as_thick_and_crumbs_as_thin():
    np.testing.assert_array_equal(relative_thickness(cube()), 1.0)  # too coarse
    flat = mesh_of([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [[0, 1, 2]])
    np.testing.assert_array_equal(relative_thickness(flat), 1.0)
    ball, crumb = quad_sphere(5), quad_sphere(2, radius=0.01)
    crumb.points[:] += (3.0, 0.0, 0.0)
    thickness = relative_thickness(joined(ball, crumb))
    np.testing.assert_array_equal(thickness[ball.vertex_count :], LEAST)
    assert thickness[: ball.vertex_count].min() > 0.83


def growth(thin: str) -> tuple[float, float]:
    """Return the growth of the girth at the ball's equator, and half-way along its handle."""
    mesh = ball_with_handle(0.12, 2.0)
    balloon = Balloon(mesh=mesh, damping=2.0, stiffness=Stiffness(structural=5.0, shear=2.5, flexion=0.5, thin=thin))
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0, frames_per_second=20.0), "cpu")
    points = stepped(simulator, 60).read_frame().points[0].reshape(-1, AROUND, 3).astype(np.float64)
    rest = mesh.points.reshape(-1, AROUND, 3)
    sides = (np.linalg.norm(np.roll(rings, 1, axis=1) - rings, axis=2) for rings in (points, rest))
    equator = int(np.linalg.norm(rest[..., :2], axis=2).mean(axis=1).argmax())
    girths = [each.sum(axis=1)[[equator, 28]] for each in sides]
    ball, handle = girths[0] / girths[1] - 1.0
    return float(ball), float(handle)


@pytest.mark.physics
@pytest.mark.full
def test_a_thin_handle_stretches_like_the_ball_it_is_on_where_its_springs_are_softer():
    """A handle with softer springs stretches by 0.6 to 1.6 times as much as the ball. With equal springs it is less
    than a third: the tension around a tube is p r, around a ball p R / 2."""
    ball, handle = growth("alike")
    assert handle < ball / 3.0
    ball, handle = growth("softer")
    assert 0.6 * ball < handle < 1.6 * ball
    assert ball == pytest.approx(0.25, abs=0.1)


@pytest.mark.physics
def test_softer_springs_change_neither_the_pressure_nor_other_methods_of_stiffness():
    """Default pressure is that of the springs before softening, which multiplies other variations."""
    stiffnesses = [Stiffness(variation=0.4, gradient=(1.0, 2.0), thin=thin) for thin in ("alike", "softer")]
    balloons = [Balloon(mesh=ball_with_handle(0.12, 2.0), stiffness=stiffness) for stiffness in stiffnesses]
    plans = [plan_model(Scene(balloon=[balloon])) for balloon in balloons]
    pressures = [plan.parameters["keyframe_values"][0, 0, 1] for plan in plans]
    assert pressures[1] == pytest.approx(pressures[0], rel=1e-12)
    alike, softer = (plan.shapes[0] for plan in plans)
    np.testing.assert_allclose(softer.stiffness_scale, alike.stiffness_scale * softer.softness)
    assert (softer.softness.min() < 0.4, softer.softness.max() <= 1.0) == (True, True)


def cabinet() -> PolygonMesh:
    """Return five thin boards that share edges, four faces at each, as soups do once they are welded."""
    boards = [((0.36, 0.38), (0.0, 0.74)), ((0.74, 0.76), (0.0, 0.74)), ((0.38, 0.74), (0.74, 0.76)),
              ((0.38, 0.74), (-0.02, 0.0)), ((0.0, 0.36), (0.74, 0.76))]  # fmt: skip
    sizes = [(0.37, y[1] - y[0], z[1] - z[0]) for y, z in boards]
    middles = [(0.0, sum(y) / 2.0, sum(z) / 2.0) for y, z in boards]
    soup = joined(*(box(middle, size, cells=(1, 1, 1)) for middle, size in zip(middles, sizes, strict=True)))
    points, same = np.unique(soup.points.round(9), axis=0, return_inverse=True)
    return mesh_of(points, same.ravel()[soup.face_vertex_indices].reshape(-1, 4).tolist())


def bad_scan(fins: int, holes: int, repeats: int) -> PolygonMesh:
    """Return a ball as a scanner has it: with triangles on edges of others, holes, and faces twice."""
    draw, ball = np.random.default_rng(1), solid_shapes.ico_sphere()
    faces = ball.face_vertex_indices.reshape(-1, 3).tolist()
    around = [{vertex for face in faces if place in face for vertex in face} for place in range(ball.vertex_count)]
    opened = set(draw.choice(ball.vertex_count, holes, replace=False).tolist())
    faces = [face for face in faces if not opened & set(face)]
    for number in draw.choice(len(faces), fins, replace=False).tolist():
        first, second, third = faces[number]
        far = set().union(*(around[place] for place in around[third])) - around[first] - around[second] - opened
        faces.append([first, second, min(far)])
    faces += [faces[number][::-1] for number in draw.choice(len(faces), repeats, replace=False).tolist()]
    return mesh_of(ball.points, faces)


SWELLING = {
    **cad_shapes.SHAPES,
    "boards that share edges": cabinet,
    "fins": lambda: bad_scan(fins=15, holes=0, repeats=40),
    "fins and holes": lambda: bad_scan(fins=20, holes=4, repeats=10),
}


@pytest.mark.parametrize("name", SWELLING)
def test_a_mesh_of_the_trade_or_with_bad_edges_takes_few_substeps_and_swells_as_others_do(name: str):
    """A frame of the default scene takes at most 30 substeps. All particles have springs, and mass: a quarter of the
    mean before the light ones were made heavier, and so at least a fifth of the mean afterwards. None is pinned."""
    scene = load_scene(SWELLING[name]())
    plan = plan_model(scene)
    assert plan.substeps <= 30
    assert many_substeps_said(plan.scene, plan.shapes, plan.substeps) is None
    share = plan.shapes[0].mass_share[np.unique(plan.shapes[0].mesh.face_vertex_indices)]
    assert share.sum() == pytest.approx(1.0)
    assert share.min() >= 0.2 * share.mean()
    assert plan.shapes[0].stiffness_scale.min() > 0.0
    (said,) = foretold_swellings(scene)
    assert said.volume is not None
    assert said.volume == pytest.approx((1.0 + STRETCH) ** 3, abs=0.1)
    assert scene.balloon[0].fixed == []


def test_what_a_pressure_does_not_push_has_none_told():
    """A torn sheet with a small ball on it: most of it is carried along."""
    sheet = grid(12, 12)
    small = replace(quad_sphere(2), points=0.5 * quad_sphere(2).points + [3.0, 3.0, 4.0])
    scene = load_scene(joined(sheet, small), {"balloon.fixed": []})
    assert foretold_swellings(scene) == []
    (sentence,) = plan_model(scene).shapes[0].remarks
    assert "is open, like a pane, and has no inside: it is carried along, not inflated" in sentence
    assert "`balloon-warp remesh`" in sentence
