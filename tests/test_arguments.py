"""Arguments of wrong types in public functions: each gets a sentence that names it, before anything is done."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from meshes import cube
from typing_extensions import TypeAliasType

import balloon_warp as bw
from balloon_warp import InputError, PolygonMesh
from balloon_warp.system.arguments import checked, fits

Alias = TypeAliasType("Alias", Mapping[str, Any])


@pytest.mark.parametrize(
    ("hint", "right", "wrong"),
    [
        (int, [3, np.int64(3)], [3.0, True, "3", None, np.zeros(2)]),
        (float, [3, 0.5, np.float32(0.5), float("inf")], [True, "0.5", None]),
        (bool, [True, np.bool_(False)], [1, None, np.zeros(2)]),
        (str | Path, ["a", Path("a")], [b"a", 3, None, ["a"]]),
        (str | None, ["a", None], [3, b"a"]),
        (Literal["a", "b"], ["a"], ["c", ["a"], np.zeros(2)]),
        (Sequence[str], [["a"], ("a",), []], ["a", [1], {"a": 1}, None]),
        (Sequence[int], [[1], np.array([1, 2]), range(3)], [[1.5], 3, np.zeros((2, 2)), np.array(1)]),
        (Iterable[Any], [[1], (each for each in "a")], ["a", 3]),
        (tuple[int, int], [(1, 2), [1, 2], np.array([1, 2])], [(1,), (1, 2, 3), (1, "a"), 1]),
        (tuple[int | None, int | None], [(None, 2)], [(None, "a")]),
        (Mapping[str, tuple[float, float]], [{"a": (1, 2.5)}], [{1: (1, 2)}, [("a", (1, 2))]]),
        (Callable[[int], None], [print], [3, None]),
        (PolygonMesh, [cube()], ["cube", None]),
        (Alias, [{"a": object()}], [3]),
    ],
)
def test_values_of_types(hint: Any, right: list[Any], wrong: list[Any]):
    assert [value for value in right if not fits(value, hint)] == []
    assert [value for value in wrong if fits(value, hint)] == []


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: bw.remesh(cube(), "8"), r"cells: must be a whole number \(got '8'\)"),
        (lambda: bw.inspect_mesh(3), r"mesh: must be a PolygonMesh \(got 3\)"),
        (lambda: bw.Simulator("two_balloons", schedule=[]), r"schedule: must be text \(got \[\]\)"),
        (lambda: bw.animate("two_balloons", 3.5), r"output: must be a path \(got 3.5\)"),
        (
            lambda: bw.render_stage("a.usdc", "a.png", size=np.zeros((2, 2))),
            r"size: must be 2 whole numbers \(got an array of shape \(2, 2\)\)",
        ),
        (lambda: bw.run_batch("two_balloons", "a", 2, export="1"), r"export: must be a list of whole numbers"),
        (lambda: bw.Cluster(workers="3"), r"workers: must be a whole number or None \(got '3'\)"),
        (lambda: bw.TrajectoryFiles("a", format="csv"), r"format: must be h5 or zarr or npz \(got 'csv'\)"),
        (lambda: bw.design("a.obj", of="steel"), r"of: must be springs or latex or foil"),
    ],
)
def test_a_wrong_argument_is_named(call: Callable[[], Any], sentence: str, tmp_path: Path, monkeypatch: Any):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=f"^{sentence}"):
        call()
    assert not list(tmp_path.iterdir())


def test_the_signature_stays():
    @checked
    def add(a: int, *, b: int = 2) -> int:
        return a + b

    assert add(1) + add(1, b=1) == 5


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: bw.Simulator(device="cpu"), "Simulator: missing a required argument: 'scene'"),  # pyright: ignore
        (
            lambda: bw.simulate("two_balloons", device_name="cpu"),  # pyright: ignore
            "simulate: got an unexpected keyword argument 'device_name'; did you mean device?",
        ),
        (
            lambda: bw.Simulator("two_balloons", fps=24),  # pyright: ignore
            "Simulator: got an unexpected keyword argument 'fps'; known are scene, device, world_count, vary, "
            "schedule, laws",
        ),
    ],
)
def test_arguments_that_do_not_fit_the_signature_are_named_with_the_function(call: Callable[[], Any], sentence: str):
    with pytest.raises(TypeError, match=f"^{re.escape(sentence)}$"):
        call()
