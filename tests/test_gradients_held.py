"""Gradients with particles in registers: the kernels of a GPU, on a CPU, where a block is one thread. And those of a
CPU, which goes around eight particles at a time. They agree with launches.
"""

from typing import Any

import numpy as np
import pytest
from block_layouts import held as held_layout
from gradient_scenes import DRIVEN, scene
from meshes import quad_sphere

import balloon_warp as bw
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.model import Model
from balloon_warp.schedules import backward_block
from balloon_warp.schedules.features import model_features

SMALL = quad_sphere(1, 1.0)
OF = ["balloon.damping", "balloon.velocity.0", "gravity"]
SPRINGS = ["balloon.mass", "balloon.stiffness.structural", "balloon.stiffness.shear"]
CASES: dict[str, tuple[bw.Scene, list[str]]] = {
    "springs and gas, on the ground, driven": (
        scene("gas", mesh=SMALL, ground=True, substeps=8, force=DRIVEN),
        [*OF, *SPRINGS, "balloon.inflation.start_pressure"],
    ),
    "springs that vary, torsion and a pressure": (
        scene(mesh=SMALL, substeps=8, springs={"torsion": 2.0, "variation": 0.2}),
        [*OF, *SPRINGS, "balloon.0.inflation.pressure.0.1"],
    ),
    "rubber and gas": (
        scene("gas", mesh=SMALL, frames=4, gas={"start_pressure": 3000.0}, material={"kind": "neo_hookean"}),
        [*OF, "balloon.material.shear_modulus"],
    ),
}
"""Scenes of 8 particles: the one thread keeps all, whose source is long"""
CANCELS = {"balloon.material.shear_modulus": 1e-4}
"""Tolerances where what triangles add nearly cancels: by a run in double precision it is 8.0768e-7, and both ways are
some 1e-4 off that"""


def layout_of_one_thread(model: Model) -> Layout:
    layout = held_layout(model, model_features(model))
    return layout._replace(odd=False, registers=backward_block.REGISTERS)


def lengths(moved: Any) -> tuple[Any, dict[str, Any]]:
    """Return the loss: weighted squares of places and velocities of all frames, with derivatives."""
    weights = np.random.default_rng(4).uniform(0.5, 1.5, (len(SMALL.points), 3))
    tracks = {name: getattr(moved, name)[0].astype(float) for name in ("points", "velocities")}
    slopes = {name: [2.0 * weights * track] for name, track in tracks.items()}
    return sum((weights * track**2).sum(axis=(-3, -2, -1)) for track in tracks.values()), slopes


@pytest.mark.full
@pytest.mark.parametrize(
    ("case", "held"),
    [
        *((case, ("layout_backwards", "layout_again")) for case in CASES),
        ("springs and gas, on the ground, driven", ("layout_again",)),
        ("springs that vary, torsion and a pressure", ()),
    ],
    ids=[*CASES, "held forward, looped backwards", "looped"],
)
def test_a_thread_finds_what_launches_find(case: str, held: tuple[str, ...], monkeypatch: pytest.MonkeyPatch):
    """Derivatives agree to 1e-5: the same formulas, in another order, in float32. Where parts cancel, see `CANCELS`."""
    of, paths = CASES[case]
    told = bw.gradient(of, of=paths, loss=lengths, world_count=2, device="cpu", schedule="launched")
    for layout in held:
        monkeypatch.setattr(backward_block, layout, layout_of_one_thread)
    found = bw.gradient(of, of=paths, loss=lengths, world_count=2, device="cpu", schedule="block")
    for path in paths:
        rtol = CANCELS.get(path, 1e-5)
        np.testing.assert_allclose(found.gradients[path], told.gradients[path], rtol=rtol, err_msg=path)
        assert found.gradients[path].all()
    by_points = told.by_points[0]
    np.testing.assert_allclose(found.by_points[0], by_points, rtol=0, atol=1e-5 * np.abs(by_points).max())
