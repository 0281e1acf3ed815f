"""Gradients of eight worlds, or eight particles of one, side by side on a CPU.

They agree with launches, and a world has the same in a batch of any size and alone.
"""

from typing import Any

import numpy as np
import pytest
from gradient_scenes import CASES, N, far, scene, value_at

import balloon_warp as bw

OF = ["balloon.mass", "balloon.damping", "gravity", "balloon.velocity.0", "balloon.stiffness.structural"]
SCENES: dict[str, tuple[bw.Scene, list[str]]] = {
    "springs that vary, in a wind": (
        scene(substeps=24, springs={"variation": 0.2}, drag_coefficient=0.5, atmosphere={"wind": (6.0, 0.0, 2.0)}),
        [*OF, "balloon.drag_coefficient", "atmosphere.wind.2", "balloon.stiffness.flexion"],
    ),
    "triangles and a gas": (
        scene("gas", substeps=8, mesh=CASES["triangles"][0].balloon[0].mesh),
        [*OF, "balloon.inflation.start_pressure", "balloon.inflation.molar_mass"],
    ),
    "moved by the old velocity": (
        scene(substeps=96, solver="forward_euler"),
        [*OF, "balloon.0.inflation.pressure.1.1"],
    ),
    "some fixed, on the ground": (scene(substeps=8, helium=2.0, fixed=[0, 3], ground=True), [*OF, "balloon.helium"]),
}
"""Scenes of 26 particles, the last octet of which is not full, and what they are derived by"""


OF_RUBBER = ["balloon.material.thickness", "balloon.velocity.0", "gravity", "balloon.damping"]
RUBBERS: dict[str, dict[str, Any]] = {
    "neo_hookean": {"wrinkling": 0.0},
    "mooney_rivlin": {"mooney_ratio": 0.2},
    "gent": {"gent_limit": 30.0},
    "ogden": {"ogden_moduli": (6e5, 2e3, -1e4), "ogden_exponents": (1.3, 5.0, -2.0)},
}
"""Laws of rubber, and their numbers"""


def rubber(law: str) -> tuple[bw.Scene, list[str]]:
    """Return a ball of rubber, of triangles for one law, that is taut in places and in wrinkles in others."""
    mesh = {"mesh": CASES["triangles"][0].balloon[0].mesh} if law == "gent" else {}
    material = {"kind": law, **RUBBERS[law]}
    of = scene("gas", frames=2, substeps=24, material=material, gas={"start_pressure": 2000.0}, **mesh)
    named = ["balloon.material.ogden_moduli.0"] if law == "ogden" else ["balloon.material.shear_modulus"]
    return of, [*OF_RUBBER, "balloon.inflation.start_pressure", *named]


def squares(moved: Any) -> tuple[Any, dict[str, Any]]:
    """Return the loss: weighted squares of places and velocities of all frames, with derivatives."""
    weights = np.random.default_rng(4).uniform(0.5, 1.5, (N, 3))
    tracks = {name: getattr(moved, name)[0].astype(float) for name in ("points", "velocities")}
    slopes = {name: [2.0 * weights * track] for name, track in tracks.items()}
    return sum((weights * track**2).sum(axis=(-3, -2, -1)) for track in tracks.values()), slopes


def varied(of: bw.Scene, worlds: int) -> dict[str, np.ndarray]:
    """Return values that differ between worlds."""
    return {
        path: value_at(of, path) * np.linspace(1.0, 1.3, worlds)
        for path in ("balloon.mass", "balloon.velocity.0", "balloon.stiffness.structural")
    }


@pytest.mark.parametrize("worlds", [1, 11])
@pytest.mark.parametrize("case", SCENES)
def test_side_by_side_they_find_what_launches_find(case: str, worlds: int):
    """Derivatives agree to 1e-4, where parts cancel, or 1e-5: the same formulas, in another order, in float32."""
    of, paths = SCENES[case]
    asked: dict[str, Any] = {
        "of": paths,
        "loss": squares,
        "world_count": worlds,
        "vary": varied(of, worlds),
        "device": "cpu",
    }
    told = bw.gradient(of, **asked, schedule="launched")
    found = bw.gradient(of, **asked, schedule="lanes")
    for path in paths:
        least = 1e-5 * np.abs(told.gradients[path]).max()
        np.testing.assert_allclose(found.gradients[path], told.gradients[path], rtol=1e-4, atol=least, err_msg=path)
        assert found.gradients[path].all()
    for name in ("by_points", "by_velocities"):
        one, other = getattr(found, name)[0], getattr(told, name)[0]
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-5 * np.abs(other).max())


@pytest.mark.parametrize("case", ["frames", "gas"])
def test_a_world_has_the_gradients_that_it_has_alone(case: str):
    """Eight worlds add up in the order of eight particles of one."""
    of, paths = CASES[case]
    values = varied(of, 9)
    together = bw.gradient(of, of=paths, loss=far, world_count=9, vary=values, device="cpu", schedule="lanes")
    for world in (0, 8):
        alone = {path: each[world : world + 1] for path, each in values.items()}
        single = bw.gradient(of, of=paths, loss=far, vary=alone, device="cpu", schedule="lanes")
        assert single.loss[0] == together.loss[world]
        for path in paths:
            assert single.gradients[path][0] == together.gradients[path][world], path
        assert np.array_equal(single.by_points[0], together.by_points[0][world])
    assert together.loss[0] != together.loss[8]


def test_threads_share_worlds_without_a_trace(monkeypatch: pytest.MonkeyPatch):
    """Threads have groups of worlds each, and their number leaves no trace in any bit."""
    of, paths = SCENES["some fixed, on the ground"]
    found = []
    for cores in (1, 3):
        monkeypatch.setattr("os.cpu_count", lambda cores=cores: cores)
        found.append(
            bw.gradient(of, of=paths, loss=squares, world_count=17, vary=varied(of, 17), device="cpu", schedule="lanes")
        )
    for path in paths:
        assert np.array_equal(found[0].gradients[path], found[1].gradients[path])
        assert len(set(found[0].gradients[path])) == 17


@pytest.mark.parametrize("law", RUBBERS)
def test_quads_of_rubber_side_by_side_find_what_blocks_find(law: str):
    """Derivatives agree with a block's, which derives each triangle by itself, to 3e-4, or where parts cancel, as in
    one of three worlds, to 5e-5 of the largest: both runs are float32, and round otherwise."""
    of, paths = rubber(law)
    vary = {"balloon.velocity.0": np.linspace(0.3, 0.5, 3), "balloon.material.thickness": np.linspace(2e-4, 3e-4, 3)}
    asked: dict[str, Any] = {"of": paths, "loss": squares, "world_count": 3, "vary": vary, "device": "cpu"}
    told, found = (bw.gradient(of, **asked, schedule=schedule) for schedule in ("block", "lanes"))
    for path in paths:
        least = 5e-5 * np.abs(told.gradients[path]).max()
        np.testing.assert_allclose(found.gradients[path], told.gradients[path], rtol=3e-4, atol=least, err_msg=path)
        assert found.gradients[path].all()
    for name in ("by_points", "by_velocities"):
        one, other = getattr(found, name)[0], getattr(told, name)[0]
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-5 * np.abs(other).max())


@pytest.mark.parametrize("law", ["mooney_rivlin", "gent"])
def test_rubber_has_the_gradients_that_it_has_alone(law: str):
    """Eight quads add to their corners one after the other, as they do in eight worlds."""
    of, paths = rubber(law)
    values = {"balloon.velocity.0": np.linspace(0.3, 0.5, 9), "balloon.material.thickness": np.linspace(2e-4, 3e-4, 9)}
    together = bw.gradient(of, of=paths, loss=squares, world_count=9, vary=values, device="cpu", schedule="lanes")
    for world in (0, 8):
        alone = {path: each[world : world + 1] for path, each in values.items()}
        single = bw.gradient(of, of=paths, loss=squares, vary=alone, device="cpu", schedule="lanes")
        assert single.loss[0] == together.loss[world]
        for path in paths:
            assert single.gradients[path][0] == together.gradients[path][world], path
        assert np.array_equal(single.by_points[0], together.by_points[0][world])
    without = bw.simulate(of, vary={path: each[8:] for path, each in values.items()}, device="cpu", schedule="octets")
    assert np.array_equal(without.points[0], together.trajectories.points[0][8])


def test_what_is_beside_rubber_leaves_no_trace():
    """Eight worlds of which some are slack are computed otherwise than taut ones alone, with the same bits."""
    of = scene(frames=6, substeps=24, material={"kind": "mooney_rivlin"})
    pressures = np.array([300.0, 20.0, 0.0])

    def points(values: np.ndarray) -> np.ndarray:
        vary = {f"balloon.0.inflation.pressure.{key}.1": values for key in (0, 1)}
        return bw.simulate(of, vary=vary, world_count=3, device="cpu", schedule="lanes").points[0]

    mixed = points(pressures)
    for world, pressure in enumerate(pressures):
        assert np.array_equal(mixed[world], points(np.full(3, pressure))[0])
    sizes = np.ptp(mixed[:, -1], axis=1).min(axis=-1) / np.ptp(mixed[:, 0], axis=1).min(axis=-1)
    assert sizes[0] > 1.5 > 1.02 > sizes[1]
