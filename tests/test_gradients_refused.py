"""Refusals of gradients, each in a sentence."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from gradient_losses import far
from gradient_scenes import BELOW, BETWEEN_CORNERS, CASES, SPRINGS, exchange, scene

import balloon_warp as bw
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Look, NoAdjointError, by_grad, phase
from balloon_warp.kernels.schedules.launched import GATHERED
from balloon_warp.kernels.schedules.writer import cut, traces_of
from balloon_warp.model import build_model, plan_model
from balloon_warp.schedules.backward_launched import bytes_backwards
from balloon_warp.schedules.features import model_features


def told(loss: Any, *slopes: Any) -> dict[str, Any]:
    """Return the arguments with a loss that is the same for any run."""
    return {"of": SPRINGS, "loss": lambda moved: (loss, *slopes) if slopes else loss}


def on_the_way(**changed: Any) -> bw.Scene:
    return scene(ground=True, frames=2, change=[{"time": 0.01, "set": changed}])


def both() -> bw.Scene:
    """Return two balls that are apart, which only launches simulate."""
    pair = [*scene().balloon, *scene(position=(4.0, 1.0, 0.0)).balloon]
    return scene().model_copy(update={"balloon": pair, "touch": False})


MASS, LENGTHS = ["balloon.mass"], ["rest_lengths"]
BOX = scene(frames=2, substeps=16, obstacle=[BELOW], faces=False)
UNDER_A_SPHERE = {"sphere": [{"position": (0.0, 3.0, 0.0), "radius": 0.6}], "contact": "impulse"}
WITH_A_SPHERE = scene(obstacle=[BELOW], faces=False, **UNDER_A_SPHERE)
CARRIED = BOX.model_copy(update={"string": [bw.String(anchor=(0.0, 3.0, 0.0), obstacle=0, length=1.0)]})
TIED = {"body": [bw.Body(position=(0.0, 4.0, 0.0))], "string": [bw.String(anchor=(0.0, 0.0, 0.0), body=0)]}
FACES_MEET_IT = scene(obstacle=[BELOW], faces=True)
NO_CHANGE = on_the_way(gravity=1.0)
REFUSED: dict[str, tuple[bw.Scene, dict[str, Any], str]] = {
    "unknown": (scene(), {"of": ["balloon.mas"]}, "balloon.0.mas: unknown field; did you mean mass?"),
    "a text": (scene(), {"of": ["balloon.name"]}, "balloon.name: cannot be derived by; expected the path of a number"),
    "no list": (scene(), {"of": "balloon.mass"}, "of: must be a list of texts (got 'balloon.mass')"),
    "no number a world": (scene(), told([1.0, 2.0], {}), "loss: expected a number for each of 1 worlds"),
    "a number alone": (scene(), told(1.0), "loss: expected two things"),
    "unknown slopes": (scene(), told(1.0, {"areas": 0.0}), "loss: has no derivatives by areas"),
    "a wrong shape": (scene(), told(1.0, {"points": [np.zeros(3)]}), "must have the shape"),
    "no list by balloon": (scene(), told(1.0, {"points": 1.0}), "must be a list of 1"),
    "not finite": (scene(), told(np.nan, {}), "loss: is not finite in world 0"),
    "a correction": (scene(correction="provot"), {"of": SPRINGS},
                     "gradients: `correct` has no adjoint yet; expected a scene without"),
    "a string to a body": (BOX.model_copy(update=TIED), {"of": MASS}, "gradients: `tie` has no adjoint yet; expected"),
    "gather": (both(), {"of": MASS, "schedule": "gather"},
               "schedule: expected auto, launched, block or lanes, which run backwards (got 'gather')"),
    "lanes of two": (both(), {"of": MASS, "schedule": "lanes"},
                     "schedule: lanes runs one balloon of springs or rubber backwards on a CPU"),
    "a block of two": (both(), {"of": MASS, "schedule": "block"},
                       "schedule: block runs one balloon backwards that fits in a block"),
    "a string": (CASES["a viscous ball on a string"].scene, {"of": ["string.0.length"], "schedule": "block"},
                 "string.0.length: is derived by launches; expected the schedule launched"),
    "substeps that change": (on_the_way(substeps=40), {"of": MASS},
                             "change.0.set: substeps: has no adjoint if it changes on the way"),
    "no such change": (NO_CHANGE, {"of": ["change.1.set.gravity"]},
                       "the scene has 1 changes; expected change.NUMBER"),
    "not set": (NO_CHANGE, {"of": ["change.0.set.balloon.mass"]},
                "change 0 sets no number there; expected one of what"),
    "friction that changes": (on_the_way(**{"ground.friction": 0.1}), {"of": ["change.0.set.ground.friction"]},
                              "cannot be derived by yet, for it acts by"),
    "no obstacle": (BOX, {"of": ["obstacle.3.motion.0.1.0"]},
                    "the scene has 1 obstacles; expected obstacle.NUMBER, from 0"),
    "no keyframe": (BOX, {"of": ["obstacle.0.motion.7.1.0"]},
                    "obstacle 0 has 3 keyframes; expected obstacle.0.motion.KEYFRAME.1.AXIS"),
    "a time": (BOX, {"of": ["obstacle.0.motion.1.0"]}, "obstacle 0 has 3 keyframes; expected"),
    "the place of what spheres meet": (WITH_A_SPHERE, {"of": ["obstacle.0.position.1"]},
                                       "obstacle.0.position.1: cannot be derived by yet, for it acts by"),
    "the anchor that an obstacle carries": (CARRIED, {"of": ["string.0.anchor.0"]},
                                            "string.0.anchor.0: cannot be derived by yet, for it acts by"),
    "the obstacle that carries it": (CARRIED, {"of": ["obstacle.0.position.1"]},
                                     "obstacle.0.position.1: cannot be derived by yet, for it acts by"),
    "the way of what spheres meet": (WITH_A_SPHERE, {"of": ["obstacle.0.motion.1.1.0"]},
                                     "obstacle.0.motion.1.1.0: cannot be derived by yet, for it acts by"),
    "the place of what faces meet": (FACES_MEET_IT, {"of": ["obstacle.0.position.1"]}, "cannot be derived by yet"),
    "the friction of what faces meet": (FACES_MEET_IT, {"of": ["obstacle.0.friction"]}, "cannot be derived by yet"),
    "the way of what faces meet": (FACES_MEET_IT, {"of": ["obstacle.0.motion.1.1.0"]}, "cannot be derived by yet"),
    "friction where a sphere meets faces": (exchange(BETWEEN_CORNERS, 1.75, faces=True), {"of": ["sphere.1.friction"]},
                                            "sphere.1.friction: cannot be derived by yet"),
    "ground far below": (scene(ground=True, position=(0.0, 9.0, 0.0)), {"of": CASES["ground"].paths},
                         "ground.height: no path leads from it to the loss"),
    "no list of parts": (scene(), {"each": "rest_lengths"}, "each: must be a list of texts"),
    "unknown parts": (scene(), {"each": ["lengths"]}, "each: expected some of rest_lengths, spring_constants"),
    "no springs": (scene(material={"kind": "mooney_rivlin"}), {"each": LENGTHS}, "the scene has no springs"),
    "no rubber": (scene(), {"each": ["thicknesses"]}, "each: thicknesses: the scene has no rubber or film"),
    "parts in blocks": (scene(), {"each": LENGTHS, "schedule": "block"}, "each: rest_lengths: is derived by launches"),
    "no frame": (scene(frames=2), {"every": 0},
                 "every: must be a whole number from 1 to 2, the frames of the scene (got 0)"),
    "too few frames": (scene(frames=2), {"every": 3}, "every: must be a whole number from 1 to 2"),
    "no checkpoint": (scene(frames=2), {"checkpoints": 0}, "checkpoints: must be at least 1 (got 0)"),
    "half a checkpoint": (scene(frames=2), {"checkpoints": 1.5},
                          "checkpoints: must be a whole number or None (got 1.5)"),
}  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_derived_is_refused_in_a_sentence(case: str):
    of, asked, sentence = REFUSED[case]
    with pytest.raises(bw.InputError, match=re.escape(sentence)):
        bw.gradient(of, **{"of": [] if "each" in asked else SPRINGS, "loss": far, "device": "cpu"} | asked)


def test_rest_points_need_springs_that_follow_from_them(tmp_path: Path):
    of, springs = scene(), plan_model(scene()).shapes[0].springs
    lengths = 0.9 * springs.rest_lengths
    np.savez(tmp_path / "own.npz", pairs=springs.pairs, rest_lengths=lengths, constants=np.full(springs.count, 50.0))
    of = of.model_copy(update={"balloon": [of.balloon[0].model_copy(update={"springs": tmp_path / "own.npz"})]})
    with pytest.raises(bw.InputError, match="have lengths at rest of their own; expected rest_lengths"):
        bw.gradient(of, each=["rest_points"], loss=far, device="cpu")


def test_a_balloon_that_the_loss_knows_nothing_of_has_no_slopes():
    found = bw.gradient(both(), of=["balloon.1.velocity.1"], loss=bw.losses.height(1.0, balloon=1), device="cpu")
    assert found.by_points[0].shape == found.by_points[1].shape == (26, 3)
    assert not found.by_points[0].any()
    assert found.by_points[1].any()


@pytest.mark.full
def test_a_loss_without_slopes_has_gradients_of_zero():
    found = bw.gradient(scene(), of=CASES["pressure"].paths, loss=lambda moved: (0.0, {}), device="cpu")
    assert all((values == 0.0).all() for values in found.gradients.values())


def test_frames_that_do_not_fit_are_refused_before_any_is_simulated(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("balloon_warp.lab.gradients.derive.usable_memory", lambda device: 26 * 72 * 2000)
    asked = []
    with pytest.raises(bw.InputError, match="enough for 1000 frames, or 0 worlds"):
        bw.gradient(scene(frames=3000), of=SPRINGS, loss=far, device="cpu", world_count=2, on_frame=asked.append)
    assert not asked


def test_a_device_keeps_little_of_each_frame():
    model = build_model(scene(), "cpu")
    few, many = (bytes_backwards(model, (), frames) for frames in (10, 10_010))
    assert many - few < 10_000 * model.particle_count * 4


@phase("particle", {"warmth": float}, keeps={"warmth": 0.0}, adjoint=by_grad)
def warm_up(features: Features, look: Look) -> Any:
    @wp.func
    def warm_up(warmth: float):
        return warmth + 1.0

    return warm_up


def test_a_phase_that_keeps_values_is_refused_by_its_name():
    features = model_features(build_model(scene(), "cpu"))
    with pytest.raises(NoAdjointError, match="`warm_up`, which keeps values"):
        traces_of(cut((warm_up,), features, GATHERED))
