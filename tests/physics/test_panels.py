"""Foil of panels: gores and seams that are marked, laid flat, sewn and simulated from rest; and latex under gravity,
which is designed for its shape while it hangs by its neck."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from meshes import mesh_of, quad_sphere
from typer.testing import CliRunner

import balloon_warp as bw
from balloon_warp import InputError, PolygonMesh
from balloon_warp.benchmarks.design import cylinder as lids
from balloon_warp.cli.app import app
from balloon_warp.cli.lab import Wanted
from balloon_warp.lab.design import design, measure
from balloon_warp.lab.design import panels as of_panels
from balloon_warp.lab.design.job import simulate_from_rest
from balloon_warp.lab.design.measure import Ruler
from balloon_warp.lab.design.panels import PanelPattern, flattened, laid_out, panels_of, seam_lengths
from balloon_warp.lab.design.springs import DOWN, Hanging
from balloon_warp.lab.design.target import held_target_of
from balloon_warp.lab.statics import Balance, SealedGas, Volume, film_of
from balloon_warp.mesh.obj import write_obj

BALL = quad_sphere(6)
SIDES = 16


def cylinder() -> PolygonMesh:
    """Return a cylinder of radius 1 and height 2: rows of 16 vertices, and lids of one more vertex each."""
    angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
    rim = np.stack([np.cos(angles), np.zeros(SIDES), np.sin(angles)], axis=1)
    rows = [rim + [0.0, y, 0.0] for y in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    points = np.concatenate([*rows, [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]])
    faces = []
    for row in range(4):
        for k in range(SIDES):
            a, b = row * SIDES + k, row * SIDES + (k + 1) % SIDES
            faces.append([a, a + SIDES, b + SIDES, b])
    faces += [[k, (k + 1) % SIDES, 5 * SIDES] for k in range(SIDES)]
    faces += [[4 * SIDES + (k + 1) % SIDES, 4 * SIDES + k, 5 * SIDES + 1] for k in range(SIDES)]
    return mesh_of(points, faces, name="cylinder")


def seams_file(path: Path, *, opened: bool = True) -> Path:
    """Write both rims of the cylinder, and a line up its side, as lines of an .obj file."""
    rims = [[*range(first, first + SIDES), first] for first in (0, 4 * SIDES)]
    lines = rims + [[row * SIDES for row in range(5)]] * opened
    path.write_text("v 0 0 0\n" + "".join(f"l {' '.join(str(v + 1) for v in line)}\n" for line in lines))
    return path


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(measure, "SIZE", (96, 84))
    monkeypatch.setattr(measure, "SAMPLES", 1)
    monkeypatch.setattr(of_panels, "EDGES", 8)


@pytest.mark.parametrize("count", [5, 16])
def test_gores_of_a_ball_are_those_of_the_textbook(count: int):
    """Flattening is off by a sixth of the squared half width in radians, the strain of a doubly curved strip, and by
    some percent, since the ball is of 6 quads a side."""
    off = (np.pi / count) ** 2 / 6.0 + 0.025
    panels = panels_of(BALL, count, 0.3)
    flat = flattened(panels, panels.mesh.points)
    assert panels.count == count
    radius = np.linalg.norm(panels.mesh.points, axis=1)
    np.testing.assert_allclose(radius, 0.15, rtol=0.03)  # of a coarse ball
    lengths = seam_lengths(panels, flat)
    assert np.abs(lengths[:, 0] - lengths[:, 1]).max() < 1e-6
    np.testing.assert_allclose(lengths.sum(axis=0) / count, np.pi * 0.15, rtol=off)
    placed = laid_out(panels, flat)
    for border in panels.borders:
        width, height = np.ptp(placed[border], axis=0)
        assert width == pytest.approx(2.0 * np.pi * 0.15 / count, rel=off)
        assert height == pytest.approx(np.pi * 0.15, rel=off)


def test_what_can_be_laid_flat_is_laid_flat_without_strain(tmp_path):
    """A cylinder, cut along its rims and a line, becomes two lids and a rectangle, and no panel overlaps another."""
    panels = panels_of(cylinder(), seams_file(tmp_path / "seams.obj"), 0.2)
    flat = laid_out(panels, flattened(panels, panels.mesh.points))
    assert panels.count == 3
    edges = panels.corners[:, [0, 1, 2, 0]]
    now = np.linalg.norm(np.diff(flat[edges], axis=1), axis=2)
    rest = np.linalg.norm(np.diff(panels.mesh.points[panels.sewn_to[edges]], axis=1), axis=2)
    np.testing.assert_allclose(now, rest, rtol=1e-5)
    around = 2.0 * SIDES * np.sin(np.pi / SIDES) * 0.1
    boxes = np.array([[flat[border].min(axis=0), flat[border].max(axis=0)] for border in panels.borders])
    sizes = np.sort(boxes[:, 1] - boxes[:, 0], axis=1)
    assert np.abs(sizes - [0.2, around]).max(axis=1).min() < 1e-5
    for one in range(3):
        for other in range(one):
            apart = np.maximum(boxes[one, 0] - boxes[other, 1], boxes[other, 0] - boxes[one, 1])
            assert apart.max() > 0.016  # two allowances


def test_marks_that_have_the_same_number_meet(tmp_path):
    panels = panels_of(cylinder(), seams_file(tmp_path / "seams.obj"), 0.4)
    flat = laid_out(panels, flattened(panels, panels.mesh.points))
    lines, labels = PanelPattern(panels, flat).drawn
    texts = [label.text for label in labels if label.kind == "mark"]
    assert all(texts.count(text) == 2 for text in texts)
    assert sorted(label.text for label in labels if label.kind == "panel") == ["1", "2", "3"]
    outlines = shapely.MultiPolygon([shapely.Polygon(flat[border]) for border in panels.borders])
    for line in lines:
        if line.kind == "mark":
            assert outlines.boundary.distance(shapely.Point(line.places[0])) < 1e-9
            assert not outlines.contains(shapely.Point(line.places.mean(axis=0)))
    PanelPattern(panels, flat).write(tmp_path / "pattern.svg")
    text = (tmp_path / "pattern.svg").read_text()
    assert [text.count(f'class="{kind}"') for kind in ("seam", "cut")] == [3, 3]
    assert text.count('class="mark"') == 2 * len(texts)


def test_a_ball_of_gores_becomes_round_from_rest(tmp_path):

    def stop(stage: str) -> None:
        if stage.startswith("correction 0"):
            raise KeyboardInterrupt

    asked = {"of": "foil", "panels": 6, "size": 0.3, "thickness": 1e-4, "steps": 1, "folder": tmp_path, "device": "cpu"}
    with pytest.raises(KeyboardInterrupt):
        bw.design(BALL, **asked, on_stage=stop)
    told: list[str] = []
    design = bw.design(BALL, **asked, resume=True, on_stage=told.append)
    assert told[0] == "resuming after step 1"
    assert design.error.mean < 0.012
    assert design.plain_error
    assert design.error.mean <= design.plain_error.mean + 1e-3
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["panels"] == 6
    assert report["seams_differ_by"] < 1e-6
    start = bw.load_mesh(tmp_path / "balloon.obj")
    assert np.ptp(start.points, axis=0).max() == pytest.approx(0.27, rel=0.01)
    last = list(bw.Simulator(tmp_path / "balloon.toml", "cpu").run())[-1].points[0]
    np.testing.assert_allclose(last, design.simulated, atol=3e-3)
    for name in ("pattern.svg", "error.png", "panels.obj"):
        assert (tmp_path / name).stat().st_size > 1_000
    with pytest.raises(InputError, match="has another design; --resume needs"):
        bw.design(BALL, **(asked | {"panels": 7}), resume=True)


def grouped(path: Path, kind: str) -> Path:
    """Write a ball whose upper and lower half are groups, or materials."""
    write_obj(path, BALL)
    faces = BALL.face_vertex_indices.reshape(-1, 4)
    upper = BALL.points[faces].mean(axis=1)[:, 1] > 0.0
    text = [line for line in path.read_text().splitlines() if not line.startswith("f ")]
    path.with_suffix(".mtl").write_text("newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n")
    text = [f"mtllib {path.stem}.mtl", *text]
    for name, own in (("a", faces[upper]), ("b", faces[~upper])):
        text += [f"{kind} {name}", *(f"f {' '.join(str(v + 1) for v in face)}" for face in own)]
    path.write_text("\n".join(text))
    return path


@pytest.mark.parametrize(("said", "kind"), [("groups", "g"), ("materials", "usemtl")])
def test_panels_between_parts_of_a_file(said: str, kind: str, tmp_path):
    assert panels_of(grouped(tmp_path / "halves.obj", kind), said, 0.3).count == 2


def tube() -> PolygonMesh:
    """Return a ring, which its axis does not meet."""
    return bw.load_mesh(Path(__file__).parents[2] / "scenes" / "knot.obj")


@pytest.mark.parametrize(
    ("seams", "sentence"),
    [
        ("1 2", r"is closed: the seams do not cut it; expected pieces with one border"),
        ("1 200", r"no edge of .* joins vertices \d+ and \d+, counted from 1, of a seam"),
        ("1 900", r"has vertex 900; expected numbers from 1 to the \d+ of"),
        ("1 two", r"line 1 is '1 two'; expected vertex numbers"),
        ("7", r"line 1 has one vertex; expected two or more"),
        ("# none", r"has no seam; expected lines of vertices"),
    ],
)
def test_seams_that_do_not_cut_are_refused(seams: str, sentence: str, tmp_path):
    (tmp_path / "seams.txt").write_text(seams)
    with pytest.raises(InputError, match=sentence):
        panels_of(BALL, tmp_path / "seams.txt", 0.3)


@pytest.mark.parametrize(
    ("mesh", "said", "sentence"),
    [
        (cylinder(), "rims.obj", r"piece of 128 triangles about .* of cylinder has 2 borders or a handle"),
        (BALL, 2, r"panels: must be from 3 to 64 gores \(got 2\)"),
        (tube(), 8, r"half-plane at .* degrees meets .* in \d+ lines from pole to pole"),
        (BALL, "none.txt", r"panels: .*none.txt cannot be read; expected a number of gores"),
        (BALL, "materials", r"has no materials with a border between them"),
    ],
)
def test_panels_that_cannot_be_are_refused(mesh: PolygonMesh, said: int | str, sentence: str, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    seams_file(Path("rims.obj"), opened=False)
    with pytest.raises(InputError, match=sentence):
        panels_of(mesh, Path(said) if str(said).endswith((".obj", ".txt")) else said, 0.3)


def test_a_panel_that_folds_over_is_refused(tmp_path):
    deep = replace(BALL, points=BALL.points * [0.1, 1.0, 0.1], name="rod")
    ring = [v + 1 for v in np.flatnonzero(np.abs(BALL.points[:, 1]) < 1e-9)]
    assert len(ring) > 3
    order = sorted(ring, key=lambda v: np.arctan2(BALL.points[v - 1, 2], BALL.points[v - 1, 0]))
    (tmp_path / "waist.txt").write_text(" ".join(map(str, [*order, order[0]])))
    panels = panels_of(deep, tmp_path / "waist.txt", 0.3)
    assert panels.count == 2
    with pytest.raises(InputError, match=r"panel \d+, of \d+ triangles, is too curved and folds over"):
        flattened(panels, panels.mesh.points)


@pytest.mark.parametrize(("mesh", "said", "most"), [(BALL, 24, 0.05), (lids(), "groups", 0.15)], ids=["gores", "lids"])
def test_stiff_film_comes_to_rest_at_the_step_of_auto(mesh: PolygonMesh, said: int | str, most: float, tmp_path):
    """Triangles keep changing between taut and wrinkled. A spring that pulls and does not push gains energy in steps
    near the stable one of its taut side. At the narrow ends of gores all triangles gain it together: with 1.6 / omega
    they moved by 1.2 m/s. Lids and sides of a cylinder moved by 2 m/s with 1.36 / omega, and stop with 1.29 / omega.
    Their last speeds depend on rounding: after 45 frames 0.01 m/s for gores, 0.04 to 0.07 m/s for lids."""
    panels = panels_of(mesh, said, 0.3)
    write_obj(tmp_path / "panels.obj", panels.flat_mesh(flattened(panels, panels.mesh.points)))
    material = bw.Material(
        kind="neo_hookean", shear_modulus=1e7, thickness=1e-4, density=1390.0, most_stretch=1.1,
        rest_mesh=tmp_path / "panels.obj",
    )  # fmt: skip
    balloon = bw.Balloon(
        mesh=replace(panels.mesh, points=0.9 * panels.mesh.points), material=material, damping=0.75, parts="free",
        inflation=bw.Inflation(pressure=[(0.0, 0.0), (0.2, 200.0)]),
    )  # fmt: skip
    *_, last = bw.Simulator(bw.Scene(balloon=[balloon], gravity=0.0, frames=45), "cpu").run()
    assert np.linalg.norm(last.velocities[0], axis=1).max() < most


HEIGHT = quad_sphere(3).points[:, 1] / quad_sphere(3).points[:, 1].max()
TOP = np.flatnonzero(HEIGHT > 0.7)
"""Ring and cap by which it hangs"""
DENSITY, SIZE = 940.0, 3.0
"""Density of latex [kg/m^3], and a size [m] at which its weight counts"""


def egg() -> PolygonMesh:
    ball = quad_sphere(3)
    return replace(ball, points=ball.points * [1.0, 1.3, 1.0], groups={"neck": TOP.astype(np.int32)}, name="egg")


def hung_scene(mesh: PolygonMesh) -> bw.Scene:
    """Return a latex balloon of air that hangs by its neck, swings little and comes to rest."""
    inflation = bw.Inflation(start_pressure=150.0, added_mass=0.0, molar_mass=0.0289652)
    material = bw.Material(preset="latex", thickness=2e-4)
    balloon = bw.Balloon(mesh=mesh, material=material, inflation=inflation, damping=10.0, fixed=TOP.tolist())
    return bw.Scene(balloon=[balloon], gravity=9.81)


def test_statics_bear_the_weight_that_is_simulated():
    mesh = replace(egg(), points=1.2 * egg().points)
    simulator = bw.Simulator(hung_scene(mesh), "cpu")
    points = simulator.relax(2e-4).points[0].astype(float)
    model, frame = simulator.model, simulator.read_frame()
    film = film_of(model.scene, 0, model.shapes[0], {name: rows.numpy() for name, rows in model.parameters.items()})
    gas, volume = SealedGas(float(frame.gas_amounts[0]), 293.15, 101325.0), Volume(replace(mesh, points=points))
    held = np.isin(np.arange(mesh.vertex_count), TOP)
    hanging = Hanging(held, 9.81 * DOWN, DENSITY)
    balance = Balance(film, volume, gas, hanging.loading(film, hanging.weight_of_air(gas, volume)))
    weightless = Hanging(held, 0.0 * DOWN, DENSITY)
    without = replace(balance, loading=weightless.loading(film, np.zeros_like(points)))
    assert balance.left_over(points) < 5e-3
    assert balance.left_over(points) < 0.1 * without.left_over(points)
    settled = balance.settle(mesh.points)
    assert settled is not None
    assert np.linalg.norm(settled - points, axis=1).max() < 2e-3
    np.testing.assert_array_equal(settled[TOP], mesh.points[TOP])


def test_the_weight_changes_with_the_mould_as_told():
    scene = hung_scene(egg())
    simulator = bw.Simulator(scene, "cpu")
    rows = {name: values.numpy() for name, values in simulator.model.parameters.items()}
    film, mould, count = film_of(scene, 0, simulator.model.shapes[0], rows), egg().points, egg().vertex_count
    assert film.volumes(count).sum() == pytest.approx(2e-4 * simulator.model.shapes[0].membrane.areas.sum())
    way = np.random.default_rng(0).standard_normal(mould.shape)
    felt = [film.with_mould(mould + sign * 1e-6 * way).volumes(count) for sign in (1.0, -1.0)]
    told = film.volumes_by_mould(count) @ way.ravel()
    np.testing.assert_allclose(told, (felt[0] - felt[1]) / 2e-6, atol=1e-6 * np.abs(told).max())
    thicker = np.random.default_rng(1).uniform(0.0, 0.5, count)
    felt = film.with_weights(1.0 + thicker).volumes(count) - film.volumes(count)
    np.testing.assert_allclose(film.volumes_by_weights(count) @ thicker, felt, rtol=1e-9)


def test_what_hangs_becomes_the_shape_under_its_gravity(tmp_path: Path):
    design = bw.design(egg(), of="latex", stretch=1.3, size=SIZE, gravity=9.81, steps=8, folder=tmp_path, device="cpu")
    ruler = Ruler(held_target_of(egg(), SIZE, None)[0], in_place=True)
    frames = list(bw.Simulator(tmp_path / "balloon.toml", "cpu").run())
    reached = ruler.error(frames[-1].points[0].astype(float))
    assert reached.mean == pytest.approx(design.error.mean, abs=1e-4)
    assert design.error.mean < 1e-3
    assert design.plain_error
    assert design.error.mean < 0.1 * design.plain_error.mean
    np.testing.assert_allclose(frames[0].points[0][TOP], ruler.mesh.points[TOP], atol=1e-5)
    scene = bw.load_scene(tmp_path / "balloon.toml")
    assert scene.gravity == 9.81
    assert scene.balloon[0].fixed == TOP.tolist()
    floating = simulate_from_rest(bw.load_scene(scene, {"gravity": 0.0}), SIZE, "cpu")
    assert not isinstance(floating, str)
    assert ruler.error(floating.points).mean > 5.0 * design.error.mean


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"of": "latex", "panels": 8}, r"panels: need foil; expected none for latex \(got 8\)"),
        ({"of": "springs", "gravity": 9.81}, r"gravity: only latex hangs; expected none for springs"),
        ({"of": "latex", "gravity": -1.0}, r"gravity: must be from 0 to 1000 m/s\^2 \(got -1.0\)"),
        ({"of": "latex", "gravity": float("nan")}, r"gravity: must be from 0 to"),
        ({"of": "latex", "fixed": [0]}, r"fixed: needs a gravity to hang under"),
        ({"of": "latex", "gravity": 9.81}, r"ball: has no group neck to hang from; expected fixed, with .* groups"),
        ({"of": "latex", "gravity": 9.81, "fixed": []}, r"fixed: holds 0 of 56 vertices; expected some, and not all"),
        ({"of": "latex", "gravity": 9.81, "fixed": [99]}, r"fixed: ball has particles 0 to 55 \(got 99\)"),
        ({"of": "latex", "gravity": 9.81, "fixed": ["hook"]}, r"fixed: ball has no group hook; it has none"),
    ],
)
def test_designs_that_cannot_be_are_refused(asked: dict, sentence: str, tmp_path: Path):
    with pytest.raises(InputError, match=sentence):
        bw.design(replace(quad_sphere(3), name="ball"), folder=tmp_path / "out", **asked)
    assert not (tmp_path / "out").exists()


def test_command_says_what_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    asked = []
    monkeypatch.setattr(design, "design", lambda *args, **given: asked.append(given) or 1 / 0)
    write_obj(tmp_path / "egg.obj", egg())
    said = ["design", str(tmp_path / "egg.obj"), "-o", str(tmp_path / "out"), "--of", "latex", "--gravity", "9.81"]
    CliRunner().invoke(app, [*said, "--fixed", "3,neck,7"])
    CliRunner().invoke(app, said)
    assert [(each["gravity"], each["fixed"]) for each in asked] == [(9.81, [3, "neck", 7]), (9.81, Wanted.fixed)]
