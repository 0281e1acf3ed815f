"""Inverse design: the balloon that becomes a given shape, always simulated from rest."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import quad_sphere
from PIL import Image

import balloon_warp as bw
from balloon_warp.designing import picture
from balloon_warp.designing.crossings import crossing_count
from balloon_warp.designing.measure import Ruler
from balloon_warp.designing.target import target_of
from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.obj import write_obj

BALL = quad_sphere(4)


def pear() -> PolygonMesh:
    """Return a convex pear, thicker at one end."""
    points = BALL.points / np.linalg.norm(BALL.points, axis=1)[:, None]
    return replace(BALL, points=points * (1.0 + 0.25 * points[:, 2:]) * [1.0, 1.0, 1.2], name="pear")


def waisted() -> PolygonMesh:
    """Return a waisted shape, which springs that only pull cannot hold well."""
    points = BALL.points / np.linalg.norm(BALL.points, axis=1)[:, None]
    waist = 1.0 - 0.35 * np.exp(-6.0 * points[:, 2] ** 2)
    return replace(BALL, points=points * np.stack([waist, waist, np.full(len(points), 1.5)], axis=1), name="peanut")


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch):
    monkeypatch.setattr(picture, "SIZE", (96, 84))
    monkeypatch.setattr(picture, "SAMPLES", 1)


@pytest.mark.parametrize(
    ("of", "stretch", "steps", "most"), [("springs", 1.2, 5, 2e-4), ("latex", 1.5, 8, 2e-3)], ids=["springs", "latex"]
)
def test_a_design_becomes_the_shape_from_rest(of: str, stretch: float, steps: int, most: float, tmp_path):
    """A design simulated from rest is nearer to the shape than its rival, also by its scene file."""
    design = bw.design(pear(), of=of, stretch=stretch, size=0.2, folder=tmp_path, steps=steps, device="cpu")
    assert design.error.mean < most
    assert design.plain_error
    assert design.error.mean < 0.2 * design.plain_error.mean
    assert abs(design.held_error.mean - design.error.mean) < most
    assert design.cannot == []
    frames = list(bw.Simulator(tmp_path / "balloon.toml", "cpu").run())
    ruler = Ruler(target_of(pear(), 0.2))
    assert ruler.error(frames[-1].points[0].astype(float)).mean == pytest.approx(design.error.mean, abs=1e-4)
    assert ruler.error(frames[0].points[0].astype(float)).mean > 0.05
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["error"]["mean"] == design.error.mean
    assert report["plain_error"]["worst"] == design.plain_error.worst
    assert (tmp_path / "error.png").stat().st_size > 1_000
    width = Image.open(tmp_path / "error.png").width
    assert width // picture.SIZE[0] == (4 if of == "latex" else 3)  # of latex the mould, too
    if of == "latex":
        mould, stl = bw.load_mesh(tmp_path / "balloon.obj"), bw.load_mesh(tmp_path / "mould.stl")
        np.testing.assert_allclose(np.ptp(stl.points, axis=0), 1000.0 * np.ptp(mould.points, axis=0), rtol=1e-5)


def boxy() -> PolygonMesh:
    """Return a rounded box with nearly flat sides."""
    points = BALL.points / np.linalg.norm(BALL.points, axis=1)[:, None]
    return replace(BALL, points=points / (np.sum(points**4, axis=1) ** 0.15)[:, None], name="box")


@pytest.mark.full
def test_rubber_that_varies_in_thickness_comes_nearer(tmp_path):
    """A designed thickness comes nearer to a box than the mould alone in half the steps; a resumed design agrees."""

    def stop(stage: str) -> None:
        if stage.startswith("step 4"):
            raise KeyboardInterrupt

    asked = {"of": "latex", "stretch": 2.0, "size": 0.2, "device": "cpu"}
    alone = bw.design(boxy(), **asked, thickness=2e-4, steps=3, folder=tmp_path / "alone")
    thick = asked | {"thickness": (2e-4, 8e-4), "steps": 6, "folder": tmp_path / "thick"}
    with pytest.raises(KeyboardInterrupt):
        bw.design(boxy(), **thick, on_stage=stop)
    told: list[str] = []
    both = bw.design(boxy(), **thick, resume=True, on_stage=told.append)
    assert told[1] == "resuming after step 4"
    assert both.error.mean < 0.9 * alone.error.mean
    weights = bw.load_scene(tmp_path / "thick" / "balloon.toml").balloon[0].material.weights
    assert isinstance(weights, list)
    assert len(weights) == BALL.vertex_count
    assert min(weights) >= 1.0
    assert 1.1 < max(weights) <= 4.0
    report = json.loads((tmp_path / "thick" / "report.json").read_text())
    assert report["thickness_to"] == pytest.approx(2e-4 * max(weights), rel=1e-3)  # as the scene has it, in four digits


def test_springs_that_may_push_hold_what_tension_does_not(tmp_path):
    """Springs that may push hold a shape that tension does not; springs that only pull are nowhere too long."""
    found = {
        hold: bw.design(waisted(), hold=hold, size=0.2, folder=tmp_path / hold, steps=4, device="cpu")
        for hold in ("tension", "any")
    }
    assert found["any"].error.mean <= found["tension"].error.mean
    springs = np.load(tmp_path / "tension" / "springs.npz")
    target = target_of(waisted(), 0.2).points
    lengths = np.linalg.norm(target[springs["pairs"][:, 1]] - target[springs["pairs"][:, 0]], axis=1)
    assert (springs["rest_lengths"] <= lengths * (1.0 + 1e-9)).all()


def test_a_design_that_was_stopped_goes_on(tmp_path):
    """A resumed design takes the same steps as an uninterrupted one."""

    def stop(stage: str) -> None:
        if stage.startswith("step 1"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bw.design(pear(), folder=tmp_path / "a", steps=2, device="cpu", on_stage=stop)
    assert not (tmp_path / "a" / "balloon.toml").exists()
    told: list[str] = []
    resumed = bw.design(pear(), folder=tmp_path / "a", steps=2, device="cpu", resume=True, on_stage=told.append)
    whole = bw.design(pear(), folder=tmp_path / "b", steps=2, device="cpu")
    assert "resuming after step 1" in told
    assert resumed.error == whole.error
    with pytest.raises(InputError, match="has another design; --resume needs"):
        bw.design(pear(), folder=tmp_path / "a", stretch=1.1, resume=True)
    with pytest.raises(InputError, match="has no design to --resume"):
        bw.design(pear(), folder=tmp_path / "c", resume=True)


def two_balls() -> PolygonMesh:
    points = np.concatenate([BALL.points, BALL.points + [3.0, 0.0, 0.0]])
    indices = np.concatenate([BALL.face_vertex_indices, BALL.face_vertex_indices + len(BALL.points)])
    return PolygonMesh(points, np.tile(BALL.face_vertex_counts, 2), indices, "two")


def crossed() -> PolygonMesh:
    """Return a ball whose top is pushed through its bottom."""
    x, y, z = BALL.points.T
    pushed = z > 0.6 * z.max()
    return replace(
        BALL, points=np.stack([x + 0.1 * pushed, y + 0.07 * pushed, z - 2.6 * pushed], axis=1), name="crossed"
    )


def opened() -> PolygonMesh:
    return PolygonMesh(BALL.points, BALL.face_vertex_counts[:-20], BALL.face_vertex_indices[:-80], "open")


@pytest.mark.parametrize(
    ("mesh", "sentence"),
    [
        (opened(), "open: is open, between vertex .* expected a closed shape"),
        (two_balls(), "two: has 2 parts; expected one closed shape"),
        (replace(BALL, points=BALL.points * [1.0, 1.0, 0.0], name="disk"), "disk: is flat and encloses no volume"),
        (crossed(), r"crossed: crosses itself at \d+ places; expected a surface that does not"),
    ],
    ids=["open", "parts", "flat", "crossing"],
)
def test_shapes_that_no_balloon_becomes_are_refused(mesh: PolygonMesh, sentence: str, tmp_path):
    with pytest.raises(InputError, match=sentence):
        bw.design(mesh, folder=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_what_touches_itself_along_edges_does_not_cross():
    assert crossing_count(BALL) == 0
    assert crossing_count(bw.load_mesh(Path(__file__).parent.parent / "scenes" / "squirrel.obj")) == 0


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"of": "steel"}, r"of: must be springs or latex or foil \(got 'steel'\)"),
        ({"hold": "none"}, r"hold: must be tension or any"),
        ({"stretch": 3.0}, r"stretch: must be from 1.02 to 2 for springs"),
        ({"stretch": float("nan")}, r"stretch: must be a number greater than 0"),
        ({"of": "latex", "stretch": 9.0}, r"stretch: must be from 1.05 to 5 for latex"),
        ({"size": -1.0}, r"size: must be from 0.01 to 100 m \(got -1.0\)"),
        ({"steps": -1}, r"steps: must be a whole number"),
        ({"thickness": 0.0}, r"thickness: must be a number greater than 0"),
        ({"of": "latex", "thickness": (4e-4, 2e-4)}, r"thickness: the range must go from low to high"),
        ({"thickness": (2e-4, 4e-4)}, r"thickness: only latex varies by place; expected one number for springs"),
    ],
)
def test_numbers_that_cannot_be_are_refused(asked: dict, sentence: str, tmp_path):
    with pytest.raises(InputError, match=sentence):
        bw.design(pear(), folder=tmp_path, **asked)


def test_where_a_shape_is_off_is_said():
    """The report of errors names sides, with the number of vertices, and flat places as flat."""
    from balloon_warp.designing.where import places_off

    cut = replace(BALL, points=BALL.points / np.linalg.norm(BALL.points, axis=1)[:, None])
    flat = replace(cut, points=np.maximum(cut.points, [-9.0, -0.5, -9.0]))
    sentence = places_off(Ruler(flat), cut.points, "; push")[0]
    assert sentence.startswith("the bottom (")
    assert " vertices, flat) is off by " in sentence
    assert sentence.endswith("% of the size; push")


def test_command(tmp_path):
    """The command writes the folder, and reports the error reached and how to run it."""
    from typer.testing import CliRunner

    from balloon_warp.cli.app import app

    write_obj(tmp_path / "pear.obj", pear())
    asked = ["design", str(tmp_path / "pear.obj"), "-o", str(tmp_path / "out"), "--steps", "2", "--device", "cpu"]
    said = CliRunner().invoke(app, asked)
    assert said.exit_code == 0, said.output
    assert "simulated from rest: " in said.output
    assert f"balloon-warp run {tmp_path / 'out' / 'balloon.toml'}" in said.output.replace("\n", " ")


CIRCLE = '<svg xmlns="http://www.w3.org/2000/svg" width="90" height="90"><circle cx="45" cy="45" r="40"/></svg>'


@pytest.mark.full
def test_foil_gets_an_outline_that_shrinks_to_the_wanted_one(tmp_path, monkeypatch):
    """A circle's foil pattern is larger by 1 / 0.7627, as theory says, and its drawing in millimeters has that size."""
    pytest.importorskip("shapely")
    from balloon_warp.designing import of_foil

    monkeypatch.setattr(of_foil, "EDGES", 12)
    (tmp_path / "circle.svg").write_text(CIRCLE)
    asked = {"of": "foil", "size": 0.3, "thickness": 1e-4, "folder": tmp_path / "out", "device": "cpu"}
    design = bw.design(tmp_path / "circle.svg", **asked, steps=3)
    assert design.error.mean < 0.006
    assert design.plain_error
    assert design.plain_error.mean > 0.1
    pattern = bw.load_mesh(tmp_path / "out" / "balloon_1.obj").points
    assert np.ptp(pattern[:, 0]) == pytest.approx(0.3 / 0.7627, rel=0.04)
    svg = (tmp_path / "out" / "pattern.svg").read_text()
    assert svg.count('class="seam"') == 1
    assert svg.count('class="cut"') == 1
    width = float(svg.split('width="')[1].split("mm")[0])
    assert width == pytest.approx(1000.0 * (np.ptp(pattern[:, 0]) + 2 * 0.008 + 2 * 0.01), rel=0.01)
    frames = list(bw.Simulator(tmp_path / "out" / "balloon.toml", "cpu").run())
    assert np.ptp(frames[-1].points[0][:, 0]) == pytest.approx(0.3, rel=0.03)


def test_parts_of_a_pattern_do_not_overlap(tmp_path):
    """Parts of a pattern, which are larger flat than inflated, lie side by side."""
    pytest.importorskip("shapely")
    from balloon_warp.designing.pattern import write_pattern

    square = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]])
    rims = [square, square + [0.05, 0.0], square + [0.5, 0.0]]
    write_pattern(tmp_path / "pattern.svg", rims, [[np.arange(4)]] * 3)
    cuts = [line for line in (tmp_path / "pattern.svg").read_text().splitlines() if 'class="cut"' in line]
    across = [[float(pair.split(",")[0]) for pair in cut.split('points="')[1].split('"')[0].split()] for cut in cuts]
    assert len(cuts) == 3
    assert max(across[0]) < min(across[1])
    assert max(across[1]) < min(across[2])


def test_foil_of_an_inflated_size_is_drawn_larger(tmp_path, monkeypatch):
    """A circle by `foil --inflated-size` is larger flat by 1 / 0.7627; its scene brings it to the size."""
    pytest.importorskip("shapely")
    from typer.testing import CliRunner

    from balloon_warp.cli.app import app
    from balloon_warp.designing import of_foil

    monkeypatch.setattr(of_foil, "EDGES", 12)
    monkeypatch.setattr(of_foil, "CORRECTIONS", 2)
    (tmp_path / "circle.svg").write_text(CIRCLE)
    asked = ["foil", str(tmp_path / "circle.svg"), "-o", str(tmp_path / "disk.toml")]
    said = CliRunner().invoke(app, [*asked, "--inflated-size", "0.3"])
    assert said.exit_code == 0, said.output
    assert np.ptp(bw.load_mesh(tmp_path / "disk_1.obj").points[:, 0]) == pytest.approx(0.3 / 0.7627, rel=0.04)
    frames = list(bw.Simulator(tmp_path / "disk.toml", "cpu").run())
    assert np.ptp(frames[-1].points[0][:, 0]) == pytest.approx(0.3, rel=0.03)
    said = CliRunner().invoke(app, [*asked, "--inflated-size", "0.3", "--height", "0.3"])
    assert "--inflated-size, --height: " in str(said.exception)


def test_foil_of_a_mesh_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"target: foil without panels needs letters or a drawing"):
        bw.design(pear(), of="foil", folder=tmp_path)
