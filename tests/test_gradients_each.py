"""Gradients by each spring, each face and each vertex of the shape at rest, against a run in double precision."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gradient_scenes import BALL, CASES, SPRINGS, far, far_of, scene
from reference_runs import run

import balloon_warp as bw
from balloon_warp.kernels.laws.membrane import THICKNESS
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import plan_model
from balloon_warp.reference.of_scene import film_of
from balloon_warp.springs.membrane import Membrane, build_membrane

Change = Callable[[Any, float], None]
"""Function of a balloon of the reference, and of how far it is changed"""
RNG = np.random.default_rng(21)


def slope(of: bw.Scene, change: Change, h: float) -> float:
    """Return the central difference of the loss by how far a balloon's tables are changed."""
    more, less = (
        far_of(of, run(of, change=lambda reference: change(reference.balloons[0], sign * h)))  # noqa: B023
        for sign in (1.0, -1.0)
    )
    return (more - less) / (2.0 * h)


def remould(balloon: Any, membrane: Membrane, edges: np.ndarray) -> None:
    """Give a balloon's film other edges at rest, with the same thickness."""
    sizes = [np.linalg.norm(np.cross(each[:, 0], each[:, 1]), axis=1) for each in (membrane.edges, edges)]
    other = replace(membrane, edges=edges, areas=membrane.areas * sizes[1] / sizes[0])
    balloon.film = film_of(other, "mooney_rivlin")


@pytest.fixture(scope="module")
def rubber(tmp_path_factory: pytest.TempPathFactory) -> bw.Scene:
    """Return a ball of rubber that is stretched everywhere from the start, so that no triangle is at the law's kink."""
    file = tmp_path_factory.mktemp("rest") / "small.obj"
    write_obj(file, replace(BALL, points=0.9 * BALL.points))
    return scene(frames=6, material={"kind": "mooney_rivlin", "rest_mesh": Path(file)})


@pytest.mark.full
def test_of_each_spring(device: str):
    """Gradients along random directions of all lengths, constants and rest points are within 1e-4 of differences."""
    of = CASES["pressure"][0]
    found = bw.gradient(
        of, of=SPRINGS, each=["rest_lengths", "spring_constants", "rest_points"], loss=far, device=device
    )
    shape = plan_model(of).shapes[0]
    np.testing.assert_array_equal(found.spring_pairs[0], shape.springs.pairs)
    lengths, points = shape.springs.rest_lengths, shape.mesh.points
    ways = [lengths * RNG.normal(size=lengths.shape), 10.0 * RNG.normal(size=lengths.shape)]
    ways.append(0.1 * RNG.normal(size=points.shape))

    def longer(balloon: Any, h: float) -> None:
        balloon.springs.lengths = balloon.springs.lengths + h * ways[0][:, None]

    def stiffer(balloon: Any, h: float) -> None:
        balloon.springs.constants = balloon.springs.constants + h * ways[1][:, None]

    def reshaped(balloon: Any, h: float) -> None:
        balloon.springs.lengths = shape.springs.resting_at(points + h * ways[2]).rest_lengths[:, None]

    for (name, arrays), way, change in zip(found.by_each.items(), ways, (longer, stiffer, reshaped), strict=True):
        error = (arrays[0] * way).sum() - slope(of, change, 1e-5)
        assert abs(error) < 1e-4 * np.linalg.norm(arrays[0] * way), name
    kinds = np.bincount(shape.springs.kind, found.by_each["spring_constants"][0])
    assert kinds == pytest.approx([found.gradients[path][0] for path in SPRINGS], rel=1e-5)


@pytest.mark.full
def test_of_each_face(rubber: bw.Scene, device: str):
    found = bw.gradient(rubber, each=["thicknesses", "rest_points"], loss=far, device=device).by_each
    membrane = plan_model(rubber).shapes[0].membrane
    ways = [1e-4 * RNG.normal(size=BALL.face_count), 0.1 * RNG.normal(size=BALL.points.shape)]

    def thicker(balloon: Any, h: float) -> None:
        balloon.film.areas = membrane.areas * (1.0 + h * ways[0][membrane.faces] / THICKNESS.default)

    def reshaped(balloon: Any, h: float) -> None:
        corners = (0.9 * BALL.points + h * ways[1])[membrane.corners]
        remould(balloon, membrane, corners[:, 1:] - corners[:, :1])

    for (name, arrays), way, change in zip(found.items(), ways, (thicker, reshaped), strict=True):
        error = (arrays[0] * way).sum() - slope(rubber, change, 1e-5)
        assert abs(error) < 1e-4 * np.linalg.norm(arrays[0] * way), name


def test_of_panels_before_they_are_sewn(tmp_path: Path, device: str):
    """Each face is a panel of its own, whose vertices go their own ways."""
    points = 0.9 * BALL.points[BALL.face_vertex_indices]
    panels = replace(BALL, points=points, face_vertex_indices=np.arange(len(points), dtype=np.int32))
    write_obj(tmp_path / "panels.obj", panels)
    of = scene(frames=2, material={"kind": "mooney_rivlin", "rest_mesh": tmp_path / "panels.obj"})
    (found,) = bw.gradient(of, each=["rest_points"], loss=far, device=device).by_each["rest_points"]
    way = 0.1 * RNG.normal(size=points.shape)

    def recut(balloon: Any, h: float) -> None:
        corners = (points + h * way)[build_membrane(panels).corners]
        remould(balloon, plan_model(of).shapes[0].membrane, corners[:, 1:] - corners[:, :1])

    assert abs((found * way).sum() - slope(of, recut, 1e-5)) < 1e-4 * np.linalg.norm(found * way)


def test_a_world_in_a_batch_has_the_derivatives_that_it_has_alone(device: str):
    of, each = CASES["pressure"][0], ["rest_lengths", "spring_constants"]
    masses = np.array([0.05, 0.07])
    found = bw.gradient(of, each=each, loss=far, world_count=2, vary={"balloon.mass": masses}, device=device)
    alone = bw.gradient(of, each=each, loss=far, vary={"balloon.mass": masses[1:]}, device=device)
    for name in each:
        np.testing.assert_array_equal(found.by_each[name][0][1], alone.by_each[name][0])
        assert not np.array_equal(*found.by_each[name][0])


REFUSED = {
    "no list": ({}, "rest_lengths", "each: expected a list of some of rest_lengths"),
    "unknown": ({}, ["lengths"], "each: expected some of rest_lengths, spring_constants"),
    "no springs": ({"material": {"kind": "mooney_rivlin"}}, ["rest_lengths"], "the scene has no springs"),
    "no rubber": ({}, ["thicknesses"], "each: thicknesses: the scene has no rubber or film"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_no_part_has_is_refused(case: str):
    more, each, sentence = REFUSED[case]
    with pytest.raises(bw.InputError, match=re.escape(sentence)):
        bw.gradient(scene(**more), each=each, loss=far, device="cpu")


def test_blocks_are_refused():
    with pytest.raises(bw.InputError, match="each: rest_lengths: is derived by launches"):
        bw.gradient(scene(), each=["rest_lengths"], loss=far, device="cpu", schedule="block")


def test_rest_points_need_springs_that_follow_from_them(tmp_path: Path):
    springs = plan_model(scene()).shapes[0].springs
    lengths = 0.9 * springs.rest_lengths
    np.savez(tmp_path / "own.npz", pairs=springs.pairs, rest_lengths=lengths, constants=np.full(springs.count, 50.0))
    of = scene()
    of = of.model_copy(update={"balloon": [of.balloon[0].model_copy(update={"springs": tmp_path / "own.npz"})]})
    with pytest.raises(bw.InputError, match="have lengths at rest of their own; expected rest_lengths"):
        bw.gradient(of, each=["rest_points"], loss=far, device="cpu")
