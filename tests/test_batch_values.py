"""Varied values on the command line: ranges, grids and lists."""

from pathlib import Path

import numpy as np
import pytest

from balloon_warp.errors import InputError
from balloon_warp.sweep.values import Range, parse_export, parse_vary, spread


@pytest.mark.parametrize(
    ("text", "parsed"),
    [
        ("balloon.inflation.k_normal=0:8", ("balloon.inflation.k_normal", Range(0.0, 8.0))),
        (" sphere.0.mass = 1, 10,1e2", ("sphere.0.mass", [1.0, 10.0, 100.0])),
        ("gravity=-9.81", ("gravity", [-9.81])),
        ("gravity=-3:-1.5", ("gravity", Range(-3.0, -1.5))),
    ],
)
def test_ranges_and_lists_are_read(text: str, parsed: tuple):
    assert parse_vary(text) == parsed


@pytest.mark.parametrize("text", ["gravity", "gravity=", "=1:2", "a..b=1", "gravity=1:", "gravity=2:1", "gravity=1:1"])
def test_what_is_neither_is_told(text: str):
    with pytest.raises(InputError, match=r"--vary .*: expected PATH=LOW:HIGH with LOW below HIGH, or PATH=NUMBER,"):
        parse_vary(text)


@pytest.mark.parametrize("text", ["gravity=a", "gravity=1:2:3", "gravity=1,,2", "gravity=nan", "gravity=0:inf"])
def test_what_is_no_number_is_told(text: str):
    with pytest.raises(InputError, match="expected PATH=LOW:HIGH"):
        parse_vary(text)


def test_meshes_are_sought_here_and_beside_the_scene(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "a.obj").touch()
    monkeypatch.chdir(tmp_path / "here")
    _, meshes = parse_vary("balloon.mesh=a.obj,b.obj", str(tmp_path / "scene.toml"))
    assert meshes == ["a.obj", str(tmp_path / "b.obj")]
    _, bundled = parse_vary("balloon.mesh=turtle.obj", "squirrel_inflate")
    assert isinstance(bundled, list)
    assert Path(str(bundled[0])).is_file()


def test_lists_are_cycled():
    np.testing.assert_array_equal(spread({"a": [1.0, 10.0, 100.0]}, 5)["a"], [1.0, 10.0, 100.0, 1.0, 10.0])


def test_samples_are_uniform_and_go_by_seed_path_and_world():
    """Mean and spread of 10,000 samples are within four standard errors, and depend on no other path's samples."""
    samples = spread({"a": Range(2.0, 8.0)}, 10_000, seed=3)["a"]
    assert 2.0 <= np.min(samples) < np.max(samples) < 8.0
    assert np.mean(samples) == pytest.approx(5.0, abs=4 * 6.0 / np.sqrt(12 * 10_000))
    assert np.var(samples) == pytest.approx(3.0, abs=4 * 9.0 * np.sqrt(1 / 180 / 10_000) * 4)
    fewer = spread({"b": Range(0.0, 1.0), "a": Range(2.0, 8.0)}, 10, seed=3)
    np.testing.assert_array_equal(fewer["a"], samples[:10])
    assert not np.array_equal(6.0 * np.array(fewer["b"]) + 2.0, fewer["a"])
    assert not np.array_equal(spread({"a": Range(2.0, 8.0)}, 10, seed=4)["a"], samples[:10])


def test_a_grid_is_even_with_its_ends_and_the_first_range_fastest():
    grid = spread({"a": Range(0.0, 2.0), "b": Range(5.0, 6.0), "c": [1.0, 2.0]}, 6, grid=True)
    np.testing.assert_array_equal(grid["a"], [0, 1, 2, 0, 1, 2])
    np.testing.assert_array_equal(grid["b"], [5, 5, 5, 6, 6, 6])
    np.testing.assert_array_equal(grid["c"], [1, 2, 1, 2, 1, 2])


@pytest.mark.parametrize(
    ("ranges", "worlds", "sides"),
    [(1, 7, [7]), (2, 4096, [64, 64]), (2, 10, [3, 3]), (2, 12, [4, 3]), (3, 65_536, [40, 40, 40]), (2, 1, [1, 1])],
)
def test_a_grid_has_about_as_many_points_on_each_range_as_fit(ranges: int, worlds: int, sides: list[int]):
    """Worlds that are left over begin the grid anew."""
    grid = spread({str(n): Range(0.0, 1.0) for n in range(ranges)}, worlds, grid=True)
    assert [len(np.unique(values)) for values in grid.values()] == sides
    points = np.stack([np.array(values) for values in grid.values()], axis=1)
    count = int(np.prod(sides))
    assert len(np.unique(points[:count], axis=0)) == count
    np.testing.assert_array_equal(points[count:], points[: worlds - count])


def test_exports_are_all_none_or_chosen_worlds():
    assert parse_export("all", 3) == [0, 1, 2]
    assert parse_export("none", 3) == []
    assert parse_export("5, 0,5", 6) == [0, 5]
    with pytest.raises(InputError, match=r"^--export 0,6: no world 6, the batch has worlds 0 to 5$"):
        parse_export("0,6", 6)
    with pytest.raises(InputError, match=r"^--export first: expected all, none, or worlds such as 0,5,9$"):
        parse_export("first", 6)
