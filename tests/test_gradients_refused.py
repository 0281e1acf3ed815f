"""Refusals of gradients, each in a sentence."""

import re
from typing import Any

import numpy as np
import pytest
import warp as wp
from gradient_scenes import CASES, SPRINGS, far, scene

import balloon_warp as bw
from balloon_warp.kernels.adjoint import NoAdjointError
from balloon_warp.kernels.adjoints.derived import by_grad
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.schedules.launched.looks import GATHERED
from balloon_warp.kernels.schedules.launched.trace import traces_of
from balloon_warp.kernels.schedules.pieces import cut
from balloon_warp.model import build_model
from balloon_warp.schedules.choose_backward import bytes_backwards
from balloon_warp.schedules.features import model_features
from balloon_warp.trajectories import Trajectories


def nothing(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    return 0.0, {}


REFUSED: dict[str, tuple[dict[str, Any], Any, Any, str]] = {
    "unknown": ({}, ["balloon.mas"], far, "balloon.0.mas: unknown field; did you mean mass?"),
    "a text": ({}, ["balloon.name"], far, "balloon.name: cannot be derived by; expected the path of a number"),
    "no list": ({}, "balloon.mass", far, "of: expected a list of paths"),
    "no number a world": ({}, SPRINGS, lambda moved: ([1.0, 2.0], {}), "loss: expected a number for each of 1 worlds"),
    "a number alone": ({}, SPRINGS, lambda moved: 1.0, "loss: expected two things"),
    "unknown slopes": ({}, SPRINGS, lambda moved: (1.0, {"areas": 0.0}), "loss: has no derivatives by areas"),
    "a wrong shape": ({}, SPRINGS, lambda moved: (1.0, {"points": [np.zeros(3)]}), "must have the shape"),
    "no list by balloon": ({}, SPRINGS, lambda moved: (1.0, {"points": 1.0}), "must be a list of 1"),
    "not finite": ({}, SPRINGS, lambda moved: (np.nan, {}), "loss: is not finite in world 0"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_derived_is_refused_in_a_sentence(case: str):
    more, paths, loss, sentence = REFUSED[case]
    with pytest.raises(bw.InputError, match=re.escape(sentence)):
        bw.gradient(scene(**more), of=paths, loss=loss, device="cpu")


def test_a_phase_without_an_adjoint_is_refused_by_its_name():
    of = scene(correction="provot")
    with pytest.raises(bw.InputError, match="gradients: `correct` has no adjoint yet; expected a scene without"):
        bw.gradient(of, of=SPRINGS, loss=far, device="cpu")


WAYS = {
    "gather": "schedule: expected auto, launched, block or lanes, which run backwards (got 'gather')",
    "lanes": "schedule: lanes runs one balloon of springs or rubber backwards on a CPU",
    "block": "schedule: block runs one balloon backwards that fits in a block",
}


@pytest.mark.parametrize("way", WAYS)
def test_a_way_backwards_that_cannot_be_is_refused(way: str):
    """A backward pass in blocks is refused for two separate balloons, which only launches simulate."""
    pair = [*scene().balloon, *scene(position=(4.0, 1.0, 0.0)).balloon]
    of = scene().model_copy(update={"balloon": pair, "touch": False})
    with pytest.raises(bw.InputError, match=re.escape(WAYS[way])):
        bw.gradient(of, of=["balloon.mass"], loss=bw.losses.height(1.0), device="cpu", schedule=way)
    found = bw.gradient(of, of=["balloon.1.velocity.1"], loss=bw.losses.height(1.0, balloon=1), device="cpu")
    assert found.by_points[0].shape == found.by_points[1].shape == (26, 3)
    assert not found.by_points[0].any()  # which the second's height knows nothing of


@pytest.mark.full
def test_what_has_no_effect_is_refused():
    """A parameter without effect is refused: the balloon is far above the ground."""
    with pytest.raises(bw.InputError, match=r"ground\.height: no path leads from it to the loss"):
        bw.gradient(scene(ground=True, position=(0.0, 9.0, 0.0)), of=CASES["ground"][1], loss=far, device="cpu")


@pytest.mark.full
def test_a_loss_without_slopes_has_gradients_of_zero():
    found = bw.gradient(scene(), of=CASES["pressure"][1], loss=nothing, device="cpu")
    assert all((values == 0.0).all() for values in found.gradients.values())


def test_frames_that_do_not_fit_are_refused_before_any_is_simulated(monkeypatch: pytest.MonkeyPatch):
    """Frames that exceed the memory are refused before any is simulated: 26 particles take 72 bytes each."""
    monkeypatch.setattr("balloon_warp.gradients.refusals.usable_memory", lambda device: 26 * 72 * 2000)
    asked = []
    with pytest.raises(bw.InputError, match="enough for 1000 frames, or 0 worlds"):
        bw.gradient(scene(frames=3000), of=SPRINGS, loss=far, device="cpu", world_count=2, on_frame=asked.append)
    assert not asked


def test_a_device_keeps_little_of_each_frame():
    """Memory of each frame on the device is small: places and velocities stay with the trajectories."""
    model = build_model(scene(), "cpu")
    few, many = (bytes_backwards(model, (), frames) for frames in (10, 10_010))
    assert many - few < 10_000 * model.particle_count * 4


CHANGED = {
    "substeps": ({"substeps": 40}, "balloon.mass", "change.0.set: substeps: has no adjoint if it changes on the way"),
    "no such change": ({"gravity": 1.0}, "change.1.set.gravity", "the scene has 1 changes; expected change.NUMBER"),
    "not set": ({"gravity": 1.0}, "change.0.set.balloon.mass", "change 0 sets no number there; expected one of what"),
    "friction": ({"ground.friction": 0.1}, "change.0.set.ground.friction", "cannot be derived by yet, for it acts by"),
}


@pytest.mark.parametrize("case", CHANGED)
def test_changes_that_cannot_be_derived_are_refused(case: str):
    changed, path, sentence = CHANGED[case]
    of = scene(ground=True, frames=2, change=[{"time": 0.01, "set": changed}])
    with pytest.raises(bw.InputError, match=re.escape(sentence)):
        bw.gradient(of, of=[path], loss=far, device="cpu")


@phase("particle", {"warmth": float}, keeps={"warmth": 0.0}, adjoint=by_grad)
def warm_up(features: Features, look: Look) -> Any:
    @wp.func
    def warm_up(warmth: float):
        return warmth + 1.0

    return warm_up


def test_a_phase_that_keeps_values_is_refused_by_its_name():
    """A phase with state has no adjoint and is refused by name."""
    features = model_features(build_model(scene(), "cpu"))
    with pytest.raises(NoAdjointError, match="`warm_up`, which keeps values"):
        traces_of(cut((warm_up,), features, GATHERED))
