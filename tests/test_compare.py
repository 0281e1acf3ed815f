"""Comparison of a scene's runs side by side."""

import csv
import itertools
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import status_of
from meshes import open_cube, quad_sphere
from PIL import Image

from balloon_warp import Balloon, BlowUpError, Inflation, InputError, Scene, Simulator
from balloon_warp.cli.stages import figure_console, print_comparison
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.topology import signed_volume, total_area
from balloon_warp.scene.load import override_scene
from balloon_warp.tools.compare import Comparison, Run, Tile, compare, compose_sheet, parse_choices

SIZE = (96, 64)
GREEN = Balloon(mesh=quad_sphere(3), color=(0.0, 1.0, 0.0), damping=1.0, inflation=Inflation(k_normal=0.2))
BALL = Scene(gravity=0.0, frames=6, picture_frame=4, balloon=[GREEN])
K_NORMAL = "balloon.inflation.k_normal"


def compared(folder: Path, vary: dict[str, list[Any]], **options: Any) -> Comparison:
    return compare(BALL, vary, folder / "out.png", size=SIZE, samples=1, device="cpu", **options)


def tiles(folder: Path, rows: int, columns: int) -> list[np.ndarray]:
    """Return the sheet cut evenly, row by row; a tile keeps its label."""
    sheet = np.asarray(Image.open(folder / "out.png").convert("RGB"))
    return [part for band in np.array_split(sheet, rows) for part in np.array_split(band, columns, axis=1)]


def green(tile: np.ndarray) -> int:
    return int(((tile[..., 1] > 60) & (tile[..., 0] < 0.7 * tile[..., 1])).sum())


@pytest.mark.parametrize(
    ("text", "path", "values"),
    [
        ("a.b=1,2.5, x", "a.b", [1, 2.5, "x"]),
        ("a=[[0, 1], [1, 2]],3", "a", [[[0, 1], [1, 2]], 3]),
        ("a='x,y',true", "a", ["x,y", True]),
        ("balloon.mesh=some.obj", "balloon.mesh", [Path("some.obj")]),
    ],
)
def test_choices_are_read_as_in_set(text: str, path: str, values: list[Any]):
    assert parse_choices(text) == (path, values)


@pytest.mark.parametrize("text", ["a", "a=", "=1", "a=1,,2", "a..b=1"])
def test_choices_without_path_or_value_are_refused(text: str):
    with pytest.raises(InputError, match="expected PATH=VALUE"):
        parse_choices(text)


@pytest.mark.full
def test_every_value_meets_every_other_and_the_last_path_makes_the_columns(tmp_path):
    result = compared(tmp_path, {"frames_per_second": [60, 120], K_NORMAL: [0.0, 1.0, 2.0]})
    assert [tuple(run.values.values()) for run in result.runs] == [(f, k) for f in (60, 120) for k in (0.0, 1.0, 2.0)]
    assert {run.outcome for run in result.runs} == {"done"}
    assert result.runs[0].figures["substeps"] > result.runs[-1].figures["substeps"]
    small, larger, largest, *others = [green(tile) for tile in tiles(tmp_path, 2, 3)]
    assert 1.05 * small < larger < 0.95 * largest  # one camera: a ball that grew more looks larger
    assert others[0] == pytest.approx(small, rel=0.02)  # where nothing happens time does not matter
    assert others[0] < others[1] < others[2]


def test_the_figures_are_those_of_the_frame_that_is_shown(tmp_path):
    result = compared(tmp_path, {K_NORMAL: [0.5]})
    simulator = Simulator(override_scene(BALL, [(K_NORMAL, 0.5)]), "cpu")
    *_, last = (frame for frame in simulator.run() if frame.number <= 4)
    shape = replace(simulator.model.shapes[0].mesh, points=last.points[0].astype(np.float64))
    figures, volume, area = result.runs[0].figures, signed_volume(shape), total_area(shape)
    assert figures["frame"] == last.number == 4
    np.testing.assert_allclose([figures["volume"], figures["area"]], [volume, area], rtol=1e-5)  # sums of 54 faces
    np.testing.assert_allclose(figures["roundness"], 36 * np.pi * volume**2 / area**3, rtol=5e-5)
    assert compared(tmp_path, {K_NORMAL: [0.5]}, frame=6).runs[0].figures["volume"] > figures["volume"]


@pytest.mark.full
def test_only_one_closed_balloon_is_round(tmp_path):
    """Summed volumes and areas have no shape."""
    alone = compared(tmp_path, {K_NORMAL: [0.0]}).runs[0].figures
    assert 0.5 < alone["roundness"] < 1.0
    aside, opened = (GREEN.model_copy(update=each) for each in ({"position": (3.0, 0.0, 0.0)}, {"mesh": open_cube()}))
    for balloons in ([GREEN, aside], [opened]):
        scene = BALL.model_copy(update={"balloon": balloons})
        run = compare(scene, {K_NORMAL: [0.0]}, tmp_path / "out.png", size=SIZE, samples=1, device="cpu").runs[0]
        assert run.outcome == "done"
        assert "roundness" not in run.figures


def test_each_of_several_frames_is_shown_and_one_past_the_end_is_refused(tmp_path):
    result = compared(tmp_path, {"picture_frame": [2, 5, 7]})
    assert [run.figures.get("frame") for run in result.runs] == [2, 5, None]
    assert result.runs[2].sentence == "frame: 7 is not in the scene; expected 0 to 6"


@pytest.mark.full
def test_refused_and_exploded_runs_stand_beside_the_others(tmp_path):
    result = compared(tmp_path, {K_NORMAL: [0.1, 9e11, "much"]}, table=tmp_path / "out.csv")
    assert [run.outcome for run in result.runs] == ["done", "blew up", "refused"]
    rows = list(csv.DictReader((tmp_path / "out.csv").open(encoding="utf-8")))
    assert [row["outcome"] for row in rows] == ["done", "blew up", "refused"]
    assert [float(row["volume"]) > 0.0 if row["volume"] else None for row in rows] == [True, None, None]
    assert rows[0]["sentence"] == ""
    assert rows[1]["sentence"].startswith("the simulation blew up")
    assert rows[2]["sentence"].startswith(f"{K_NORMAL.replace('balloon', 'balloon.0')}: must be a valid number")
    good, *bad = tiles(tmp_path, 1, 3)
    assert green(good) > 100 > max(map(green, bad))
    assert all(tile.min() < 100 for tile in bad)  # the sentence


@pytest.mark.parametrize(
    ("vary", "options", "error", "sentence"),
    [
        ({}, {}, InputError, "nothing differs"),
        ({K_NORMAL: []}, {}, InputError, "nothing differs"),
        ({K_NORMAL: ["much", "more"]}, {}, InputError, "must be a valid number"),
        ({"no.such": [1]}, {}, InputError, "no: unknown table"),
        ({K_NORMAL: [9e11, 8e11]}, {}, BlowUpError, "the simulation blew up"),
        ({K_NORMAL: [1]}, {"frame": 7}, InputError, "frame: 7 is not in the scene; expected 0 to 6"),
        ({K_NORMAL: list(range(600))}, {}, InputError, "expected at most 8192x8192"),
        ({K_NORMAL: [1]}, {"table": "out.txt"}, InputError, "cannot write .txt; expected .csv"),
    ],
)
def test_where_no_run_is_good_nothing_is_written(tmp_path, vary, options, error, sentence):
    with pytest.raises(error, match=sentence):
        compared(tmp_path, vary, **options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.full
def test_a_single_path_with_many_values_fills_even_rows(tmp_path):
    compared(tmp_path, {K_NORMAL: [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]}, frame=0)
    width, height = Image.open(tmp_path / "out.png").size
    assert 3 * SIZE[0] < width < 4 * SIZE[0]
    assert 2 * SIZE[1] < height < 4 * SIZE[1]


def test_long_labels_are_broken_and_a_wide_table_is_not_cut_off(capsys):
    black = np.zeros((64, 96, 3), dtype=np.uint8)
    short = compose_sheet([Tile(["a"], black, "")], 1, SIZE)
    sheet = compose_sheet([Tile(["word " * 12], black, ""), Tile([], black, "")], 2, SIZE)
    assert len(sheet) > len(short) + 24  # two lines more at least
    assert (sheet[: len(sheet) - len(short), -SIZE[0] :] == 255).all()  # nothing over the other tile
    figures = {f"sphere_{number}_height": 0.5 for number in range(8)} | {"particles": 8, "substeps": 4}
    values = [{"picture_frame": number, "balloon.inflation.k_normal.1.1": 7} for number in (1, 2)]
    runs = [Run(own, "done", "", {"frame": own["picture_frame"], **figures}) for own in values]
    print_comparison(figure_console(), Comparison(runs, "out.png", None))
    alike, header, *rows = capsys.readouterr().out.splitlines()
    assert alike == "particles 8, substeps 4"
    heights = [f"sphere {number} height" for number in range(8)]
    assert re.split(r"\s{2,}", header) == ["picture_frame", "k_normal.1.1", "frame", *heights]
    assert [row.split() for row in rows] == [[number, "7", number, *["0.5"] * 8] for number in "12"]


@pytest.mark.full
def test_the_command_prints_a_table_and_says_what_it_wrote(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    write_obj(tmp_path / "other.obj", quad_sphere(6))  # which takes other substeps
    words = "compare ball.obj --set frames=2 --device cpu --table t.csv --vary balloon.mesh=ball.obj,other.obj"
    assert status_of(*words.split(), "--vary", "normals=cached,fresh,stale") == 0
    lines, notes = (text.splitlines() for text in capsys.readouterr())
    assert [line.split(": ")[0] for line in notes] == [f"ball, run {n} of 6" for n in (1, 2, 4, 5)]
    assert lines[0] == "frame 2"
    assert lines[1].split()[:3] == ["mesh", "normals", "volume"]
    pairs = itertools.product(("ball.obj", "other.obj"), ("cached", "fresh", "stale"))
    assert [line.split()[:2] for line in lines[2:8]] == list(map(list, pairs))
    assert lines[8].startswith("refused: balloon.mesh = ball.obj, normals = stale: normals: must be 'cached' or")
    assert lines[-2:] == ["wrote ball_compare.png", "wrote t.csv"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.obj", "ball_compare.png", "other.obj", "t.csv"]
