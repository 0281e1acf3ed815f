"""Mesh by itself, and meshes from the wild: a balloon of the same shape that stands, or a refusal or a warning."""

import re
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import solid_shapes
from commands import status_of
from meshes import box, cube, grid, joined, mesh_of, quad_sphere, rings, without
from trajectories import stepped

from balloon_warp import InputError, PolygonMesh, Simulator, build_springs, inspect_mesh, load_mesh, run_batch
from balloon_warp.benchmarks.bad_meshes import ACCEPTED, CUBE, GAS, REFUSED, WARNED, MeshCase, fan_at_an_edge, hub
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.thickness import LEAST, relative_thickness
from balloon_warp.mesh.topology import signed_volume, total_area, vertex_areas
from balloon_warp.model import plan_model
from balloon_warp.run.report import coarse_sentence, many_substeps_sentence, predicted_swellings
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness, load_scene
from balloon_warp.scene.around import STRETCH
from balloon_warp.scene.load import mesh_balloon, override_scene
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
    (said,) = predicted_swellings(load_scene(mesh))
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


@pytest.mark.parametrize(
    ("mesh", "overrides", "why"),
    [
        pytest.param(
            solid_shapes.sheet(5e-4, 8), {}, "springs across its thin walls are stiff; balloon.st", id="across"
        ),
        pytest.param(solid_shapes.slivers(), {"frames_per_second": 20.0}, "its narrow faces have stiff", id="narrow"),
        pytest.param(solid_shapes.blocks(), {"frames_per_second": 10.0}, "its parts are tied by stiff", id="ties"),
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
    said = many_substeps_sentence(plan.scene, plan.shapes, plan.substeps)
    assert said is not None
    assert said.startswith(f"A frame takes {plan.substeps} substeps, since {why}")
    assert said.endswith("helps")


@pytest.mark.parametrize(
    ("mesh", "said"),
    [
        (quad_sphere(3), "mesh is coarse and shows its faces (56 particles, faces up to 0.27 of its size): "),
        (quad_sphere(8), None),
    ],
)
def test_a_coarse_mesh_gets_a_remedy(mesh: PolygonMesh, said: str | None):
    """Only one by itself: a scene's balloon may be as coarse as it is."""
    plan = plan_model(load_scene(mesh))
    found = coarse_sentence(plan.scene, plan.shapes)
    assert (found is None) if said is None else (found or "").startswith(said)
    of_scene = Scene(balloon=[Balloon(mesh=mesh)])
    assert coarse_sentence(of_scene, plan.shapes) is None


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
    **solid_shapes.CAD_SHAPES,
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
    assert many_substeps_sentence(plan.scene, plan.shapes, plan.substeps) is None
    share = plan.shapes[0].mass_share[np.unique(plan.shapes[0].mesh.face_vertex_indices)]
    assert share.sum() == pytest.approx(1.0)
    assert share.min() >= 0.2 * share.mean()
    assert plan.shapes[0].stiffness_scale.min() > 0.0
    (said,) = predicted_swellings(scene)
    assert said.volume is not None
    assert said.volume == pytest.approx((1.0 + STRETCH) ** 3, abs=0.1)
    assert scene.balloon[0].fixed == []


def test_what_a_pressure_does_not_push_has_none_told():
    """A torn sheet with a small ball on it: most of it is carried along."""
    sheet = grid(12, 12)
    small = replace(quad_sphere(2), points=0.5 * quad_sphere(2).points + [3.0, 3.0, 4.0])
    scene = load_scene(joined(sheet, small), {"balloon.fixed": []})
    assert predicted_swellings(scene) == []
    (sentence,) = plan_model(scene).shapes[0].remarks
    assert "is open, like a pane, and has no inside: it is carried along, not inflated" in sentence
    assert "`balloon-warp remesh`" in sentence


def written(case: MeshCase, folder: Path) -> Path:
    path = folder / "mesh.obj"
    path.write_bytes(case.content())
    return path


NAMED = {case.name: case for case in (*REFUSED, *ACCEPTED, *WARNED)}


def each(cases: list[MeshCase]) -> pytest.MarkDecorator:
    """Return a mark that starts a test for each case."""
    return pytest.mark.parametrize("case", cases, ids=[case.name for case in cases])


WITHOUT_A_BALLOON = ["all vertices at one place", "1e6 from the origin", "a scale of 1e-18", "a scale of 1e18"]
"""meshes that are reported on all the same"""


@each(REFUSED)
def test_refused_in_a_sentence(case: MeshCase, tmp_path: Path, capsys) -> None:
    path = written(case, tmp_path)
    sets = [f"--set={place}={value}" for place, value in case.overrides]
    for command in (["run", "-o", str(tmp_path / "out.usdc")], ["inspect"]):
        status = status_of(*command, str(path), *sets)
        out, err = capsys.readouterr()
        reported = command == ["inspect"] and (case.name in WITHOUT_A_BALLOON or GAS[0] in case.overrides)
        assert (status, "vertices" in out) == (2, reported)
        assert reported or not out
        (sentence,) = [line for line in err.splitlines() if line.strip()]
        assert sentence.startswith(f"error: {path if not case.overrides else 'mesh'}")
        assert case.says in sentence
        assert len(sentence) < 300 + len(str(path))
        assert list(tmp_path.iterdir()) == [path]


@each(ACCEPTED)
def test_accepted_without_fuss(case: MeshCase, tmp_path: Path) -> None:
    (tmp_path / "plain.obj").write_bytes(CUBE)
    plain, mesh = load_mesh(tmp_path / "plain.obj"), load_mesh(written(case, tmp_path))
    np.testing.assert_array_equal(mesh.points, plain.points)
    np.testing.assert_array_equal(mesh.face_vertex_indices, plain.face_vertex_indices)
    assert plan_model(load_scene(tmp_path / "mesh.obj")).shapes[0].mesh.warnings == ()


@pytest.mark.full
@each(WARNED)
def test_accepted_with_a_warning(case: MeshCase, tmp_path: Path) -> None:
    path = written(case, tmp_path)
    simulator = Simulator(load_scene(path, case.overrides), device="cpu")
    warnings = simulator.model.shapes[0].mesh.warnings
    assert [warning for warning in warnings if warning.startswith(case.says)]
    simulator.step()
    assert np.isfinite(simulator.read_frame().points[0]).all()
    treatment = mesh_balloon(path, case.overrides).treatment
    assert inspect_mesh(load_mesh(path), treatment=treatment).warnings == list(warnings)


COMMANDS = {
    "run": ["run", "--set=frames=2", "-o", "out.usdc"],
    "batch": ["batch", "--worlds", "2", "--vary", "gravity=1:9", "--set=frames=2", "-o", "out"],
    "view": ["view"],
}


@pytest.mark.full
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("name", "words", "said"),
    [
        ("duplicate face", [], "1 face has the corners of an earlier face; it is face 7, counting from 1. Repeated"),
        ("seams", ["--weld"], "16 vertices that lay exactly on others have been welded to them: they keep their"),
    ],
)
def test_commands_warn_on_standard_error(
    command: str, name: str, words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    if command == "view":
        pytest.importorskip("viser", reason="needs the extra `view`")
        page, start = "balloon_warp.studio.page.page.Page", Mock(side_effect=KeyboardInterrupt)
        monkeypatch.setattr(page, lambda session, *_, **__: Mock(session=session, start=start))
    written(NAMED[name], tmp_path)
    monkeypatch.chdir(tmp_path)
    assert not status_of(*COMMANDS[command], "mesh.obj", *words, "--device", "cpu")
    notes = ("note: mesh.obj inflates above a floor. Unit unknown", "note: auto pressure ", "note: mesh is coarse")
    (warning,) = [line for line in capsys.readouterr().err.splitlines() if not line.startswith(notes)]
    assert warning.startswith(f"warning: mesh: {said}")


def test_unused_vertices_have_no_mass_and_stay(tmp_path: Path) -> None:
    simulator = Simulator(load_scene(written(NAMED["unused vertices"], tmp_path)), device="cpu")
    (shape,) = simulator.model.shapes
    # Of an even skin: in proportion to sums of springs, in another order at each corner.
    assert shape.mass_share.tolist() == [*[pytest.approx(0.125, rel=1e-12)] * 8, 0.0, 0.0]
    assert stepped(simulator, 5).read_frame().points[0][8:].tolist() == [[5, 5, 5], [6, 6, 6]]


def test_a_hub_takes_memory_in_proportion(tmp_path: Path) -> None:
    (tmp_path / "mesh.obj").write_bytes(hub())
    mesh = load_mesh(tmp_path / "mesh.obj")
    tracemalloc.start()
    springs = build_springs(mesh)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert springs.count < 10 * mesh.vertex_count
    assert peak < 64 * 2**20  # all pairs of the hub's 5,000 neighbors would take 200 MB


def test_a_huge_file_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "huge.obj").open("wb") as file:
        file.truncate(2**31)
    with pytest.raises(InputError, match=r"huge\.obj: has 2,147,483,648 bytes; expected at most 1,073,741,824"):
        load_mesh(tmp_path / "huge.obj")


FILES_BESIDE = {
    "mesh.obj": (b"mtllib beside.mtl\nvt 0 0\n" + CUBE + b"usemtl a\nf 1/1 2/1 3/1\n", ["beside.mtl", "beside.png"]),
    "unused.obj": (b"mtllib beside.mtl\n" + CUBE, []),
    "mesh.ply": (
        b"ply\nformat ascii 1.0\ncomment TextureFile beside.png\nelement vertex 3\nproperty float x\n"
        b"property float y\nproperty float z\nproperty float s\nproperty float t\nelement face 1\n"
        b"property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n",
        [],
    ),
}
"""meshes, and the files that they have opened beside them: the materials and the base textures that are used"""


@pytest.mark.full
@pytest.mark.parametrize("name", FILES_BESIDE)
def test_only_used_materials_and_base_textures_are_opened(name: str, tmp_path: Path) -> None:
    content, others = FILES_BESIDE[name]
    (tmp_path / name).write_bytes(content)
    materials = "newmtl a\nmap_Kd beside.png\nmap_Bump other.png\nnewmtl b\nmap_Kd other.png\n"
    (tmp_path / "beside.mtl").write_text(materials)
    for image in ("other.png", "beside.png"):
        (tmp_path / image).write_bytes(b"no picture")
    program = (
        "import sys; from pathlib import Path; from balloon_warp.mesh.load import load_mesh\n"
        "def report(event, arguments):\n"
        "    if event == 'open' and str(arguments[0]).startswith(sys.argv[1]):\n"
        "        print(Path(arguments[0]).name)\n"
        "sys.addaudithook(report)\n"
        "load_mesh(sys.argv[1] + '/' + sys.argv[2])"
    )
    arguments = [sys.executable, "-c", program, str(tmp_path), name]
    result = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    assert (result.stdout.split(), result.stderr) == ([name, *others], "")


PUSHED = {"kind": "pressure", "pressure": 12.0}


def simulator_of(content: bytes, folder: Path, device: str, **balloon: object) -> Simulator:
    """Return the simulator of a mesh alone: no gravity, and inflation as asked for."""
    path = folder / "mesh.obj"
    path.write_bytes(content)
    overrides = [("gravity", 0.0), *((f"balloon.{name}", value) for name, value in balloon.items())]
    return Simulator(load_scene(path, overrides), device)


def case(name: str) -> bytes:
    return NAMED[name].content()


def move(simulator: Simulator, particle: int, to: tuple[float, float, float]) -> None:
    points = simulator.state.points.numpy().copy()
    points[0, particle] = to
    simulator.state.points.assign(points)


@pytest.mark.full
@pytest.mark.physics
@pytest.mark.parametrize(("inflation", "pushed"), [({"k_normal": 3.0}, True), (PUSHED, False)])
def test_a_face_without_area_is_inflated_once_it_opens(inflation: dict, pushed: bool, tmp_path: Path, device: str):
    """A corner of a zero-area face on the edge of the cube is a fin without any other face: the paper's inflation
    pushes it once it opens, and a pressure does not."""
    simulator = simulator_of(case("zero-area face"), tmp_path, device, inflation=inflation)
    assert np.abs(simulator.read_frame(net_forces=True).inflation_forces[0][8]).max() < 1e-6
    move(simulator, 8, (0.5, -0.2, 0.0))
    force = np.linalg.norm(simulator.read_frame(net_forces=True).inflation_forces[0][8])
    assert force > 0.1 if pushed else force == 0.0


@pytest.mark.full
@pytest.mark.physics
def test_coincident_vertices_pull_only_once_they_part(tmp_path: Path, device: str):
    limp = {"weld": False, "inflation": {"k_normal": 0.0}, "helium": 0.0}
    simulator = simulator_of(case("coincident vertices"), tmp_path, device, **limp)
    at_rest = simulator.read_frame(net_forces=True)
    assert np.abs(at_rest.net_forces[0]).max() < 5e-5  # rounding: 2e-7 of 20 N, ten springs
    move(simulator, 8, (-0.1, 0.0, 0.0))
    force = simulator.read_frame(net_forces=True).net_forces[0][8]
    assert force[0] > 0.1  # back
    simulator.step()
    assert np.isfinite(simulator.read_frame().points[0]).all()


@pytest.mark.full
@pytest.mark.physics
def test_each_face_of_a_crowded_edge_is_inflated_to_its_side(tmp_path: Path, device: str):
    simulator = simulator_of(fan_at_an_edge(7), tmp_path, device, inflation=PUSHED, fixed=[])
    frame = simulator.read_frame(net_forces=True)
    points, forces = frame.points[0].astype(np.float64), frame.inflation_forces[0].astype(np.float64)
    faces = simulator.model.shapes[0].mesh.face_vertex_indices.reshape(-1, 3)
    assert len(faces) == 7
    first, second, rim = points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]
    area_vectors = 0.5 * np.cross(second - first, rim - first)
    # A third of the pressure on a triangle is on each corner; float32 of a few newtons.
    np.testing.assert_allclose(forces[faces[:, 2]], 12.0 * area_vectors / 3.0, atol=1e-4)


@pytest.mark.physics
def test_free_components_are_inflated_as_one_and_otherwise_apart(tmp_path: Path, device: str):
    """The paper's inflation is shared by area: a cube of two has half the push of one alone."""
    simulator = simulator_of(CUBE, tmp_path, device, inflation={"k_normal": 3.0})
    alone = simulator.read_frame(net_forces=True).inflation_forces[0]
    simulator = simulator_of(case("several components"), tmp_path, device, inflation={"k_normal": 3.0}, parts="free")
    both = simulator.read_frame(net_forces=True).inflation_forces[0]
    np.testing.assert_allclose(both, 0.5 * np.concatenate([alone, alone]), atol=1e-4)
    pairs = simulator.model.shapes[0].springs.pairs
    assert ((pairs < 8).all(axis=1) | (pairs >= 8).all(axis=1)).all()


@pytest.mark.full
@pytest.mark.physics
def test_schedules_move_odd_meshes_alike(schedule: str, tmp_path: Path, device: str):
    path = tmp_path / "mesh.obj"
    for odd in WARNED:
        if odd.name == "a hub of 5,000 quads":
            continue
        path.write_bytes(odd.content())
        # In free air: whether a particle stands on the ground in a substep hangs on rounding, and so how far it slides.
        free = [("gravity", 0.0), ("ground.height", -9.0), ("balloon.fixed", [])]
        overrides = [*free, ("balloon.inflation.k_normal", 3.0), *odd.overrides]
        simulators = [Simulator(load_scene(path, overrides), device, schedule=name) for name in ("scatter", schedule)]
        start = simulators[0].read_frame().points[0]
        if odd.name in ("not orientable", "an edge of 100 faces"):
            # Several faces are equally near to a particle, which is inflated by one of them: rounding would choose.
            start = start + np.random.default_rng(1).uniform(-0.05, 0.05, start.shape).astype(np.float32)
        for simulator in simulators:
            simulator.state.points.assign(start[None])
        expected, found = (stepped(simulator, 5).read_frame().points[0] for simulator in simulators)
        assert np.abs(expected - start).max() > 1e-3, odd.name
        # Sums in another order: float32 of coordinates of some meters, over a few dozen substeps.
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-5, err_msg=odd.name)


@pytest.mark.full
@pytest.mark.physics
def test_a_spring_without_length_is_of_no_stretch_in_a_table(tmp_path: Path, device: str):
    (tmp_path / "mesh.obj").write_bytes(case("coincident vertices"))
    overrides = [("frames", 4), ("balloon.inflation.k_normal", 3.0), ("balloon.fixed", []), ("balloon.weld", False)]
    scene = load_scene(tmp_path / "mesh.obj", overrides)
    summary = run_batch(scene, tmp_path / "out", 2, {"gravity": [0.0, 9.0]}, device=device)
    assert summary.unhealthy_worlds == 0
    with np.load(tmp_path / "out" / "table.npz") as table:
        stretch = table["largest_stretch"]
    assert ((stretch > 0.9) & (stretch < 10.0)).all()
