"""Restored simulations, bit-identical to uninterrupted ones."""

import numpy as np
import pytest
from meshes import cube, quad_sphere

from balloon_warp.model import Vary
from balloon_warp.outputs.npz import write_npz
from balloon_warp.scene import Balloon, Body, Change, Ground, Inflation, Scene, Sphere, String, Water
from balloon_warp.simulator import Simulator

FRAMES, SAVED_AT, WORLDS = 6, 3, 3
SECONDS = 1 / 60
"""of a frame"""
BALLOON = Balloon(mesh=quad_sphere(3), position=(0.0, 1.2, 0.0), inflation=Inflation(k_normal=0.2))
PLAIN = Scene(
    balloon=[BALLOON],
    normals="cached",
    sphere=[Sphere(position=(0.2, 2.1, 0.0), radius=0.3)],
    string=[String(anchor=(0.0, 0.0, 0.0), length=0.1)],
    ground=Ground(),
)
PUMPED = BALLOON.model_copy(update={"inflation": Inflation(kind="gas", pump=[(0.0, 0.0), (0.1, 0.5)])})
CHANGES = [
    Change(time=SECONDS, set={"gravity": 3.0}),
    Change(time=2 * SECONDS, set={"normals": "fresh"}),
    Change(time=SAVED_AT * SECONDS, set={"balloon.damping": 0.5}),
]
STACK = [  # which comes down while it is saved
    Body(size=(0.4, 0.2, 0.4), position=(2.0, 0.1, 0.0)),
    Body(size=(0.2, 0.2, 0.2), position=(2.05, 0.302, 0.0), rotation=(0.0, 20.0, 0.0), mass=20.0),
]
SCENES = {
    "plain": PLAIN,
    "impulse": PLAIN.model_copy(update={"contact": "impulse"}),
    "gas": PLAIN.model_copy(update={"balloon": [PUMPED]}),
    "water": PLAIN.model_copy(update={"water": Water(level=1.0)}),
    "changes": PLAIN.model_copy(update={"change": CHANGES}),
    "changes of solver": PLAIN.model_copy(
        update={"change": [Change(time=2 * SECONDS, set={"solver": "projective", "substeps": 4})]}
    ),
    "bodies": PLAIN.model_copy(update={"body": STACK}),
    "limit": PLAIN.model_copy(update={"correction": "provot"}),
    "projective": PLAIN.model_copy(update={"solver": "projective"}),
}
WAYS = {
    **{(name, schedule): SCENES[name] for name in SCENES for schedule in ("gather", "lanes", "block")},
    ("plain", "octets"): PLAIN,
    ("projective", "auto"): SCENES["projective"],
    ("changes of solver", "auto"): SCENES["changes of solver"],
}
for name in ("gather", "lanes", "block"):  # these are the other solver's
    del WAYS["projective", name], WAYS["changes of solver", name]


def simulators(way: tuple[str, str], device: str) -> list[Simulator]:
    name, schedule = way
    if device != "cpu" and schedule in ("octets", "lanes"):
        pytest.skip("simulates on the CPU")
    vary: Vary = {"balloon.mass": 0.1 + 0.01 * np.arange(WORLDS)}
    return [Simulator(WAYS[name, schedule], device, WORLDS, vary, schedule) for _ in range(2)]


def contents(simulator: Simulator) -> dict[str, bytes]:
    return {name: array.numpy().tobytes() for name, array in simulator.state.arrays.items()}


@pytest.mark.parametrize("way", WAYS, ids="-".join)
def test_the_same_bits_follow(way: tuple[str, str], device: str, tmp_path):
    left, restored = simulators(way, device)
    for _ in range(SAVED_AT):
        left.step()
    scene_then = left.model.scene
    write_npz(tmp_path / "state.npz", ((name, array.numpy()) for name, array in left.state.arrays.items()))
    for _ in range(FRAMES - SAVED_AT):
        left.step()
    with np.load(tmp_path / "state.npz") as saved:
        restored.restore(saved)
    assert restored.frame_number == SAVED_AT
    assert restored.model.scene == scene_then
    assert contents(restored) != contents(left)
    for _ in range(FRAMES - SAVED_AT):
        restored.step()
    assert contents(restored) == contents(left)
    assert restored.frame_number == FRAMES


def test_a_world_that_blew_up_is_still_known(device: str):
    bad = Scene(balloon=[Balloon(mesh=cube(), inflation=Inflation(k_normal=0.2))])
    vary: Vary = {"balloon.inflation.k_normal": [0.2, 9e11]}
    left, restored = (Simulator(bad, device, 2, vary) for _ in range(2))
    for _ in range(3):
        left.advance()
    restored.restore({name: array.numpy() for name, array in left.state.arrays.items()})
    np.testing.assert_array_equal(restored.state.first_bad.numpy(), left.state.first_bad.numpy())
    assert restored.state.first_bad.numpy()[0] != restored.state.first_bad.numpy()[1]


def test_what_a_scene_does_not_have_need_not_be_saved():
    """A checkpoint may lack state that the scene does not have, as one from before balloons could touch."""
    simulator = Simulator("squirrel_tether", "cpu")
    simulator.step()
    saved = {name: array.numpy() for name, array in simulator.state.arrays.items() if array.size}
    assert "holds" not in saved
    again = Simulator("squirrel_tether", "cpu")
    again.restore(saved)
    np.testing.assert_array_equal(again.read_frame().points[0], simulator.read_frame().points[0])
