"""Spheres that are larger than faces, which meet faces as ridges do, with `contact = "impulse"`."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conserved import angular_momentum, energy, momentum, sphere_energies, sphere_momenta
from meshes import quad_sphere
from numpy.typing import NDArray

from balloon_warp import check_stage
from balloon_warp.job import animate
from balloon_warp.model.small_spheres import round_ridges
from balloon_warp.model.touch import edge_length
from balloon_warp.scene import Atmosphere, Balloon, Inflation, Obstacle, Scene, Sphere
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

COARSE = quad_sphere(3, 0.5)
EDGE = edge_length(COARSE)


def thrown(radius: float = 2.0 * EDGE, friction: float = 0.0, pressure: float = 0.0, **given: Any) -> Scene:
    """Return a coarse ball, and a sphere that flies at the middle of one of its faces, in space."""
    ball = Balloon(mesh=COARSE, mass=0.3, damping=0.0, inflation=Inflation(kind="pressure", pressure=pressure))
    place = (0.56 + radius, 0.16, 0.15)
    sphere = Sphere(position=place, radius=radius, mass=0.2, velocity=(-2.0, 0.0, 0.5), friction=friction)
    space = {"gravity": 0.0, "atmosphere": Atmosphere(density=0.0), "contact": "impulse", "substeps": 60, "faces": True}
    return Scene(balloon=[ball], sphere=[sphere], **space | given)


@pytest.mark.full
@pytest.mark.parametrize("faces", [True, False])
def test_flat_faces_do_not_dip_into_a_sphere(faces: bool, tmp_path: Path) -> None:
    animate(thrown(pressure=15.0, faces=faces, frames=40), tmp_path / "stage.usdc", device="cpu")
    crossings = check_stage(tmp_path / "stage.usdc").crossings
    if not faces:  # what the other is about
        assert max(crossing.depth for crossing in crossings) > 0.08 * EDGE
    assert bool(crossings) is not faces, "\n".join(str(crossing) for crossing in crossings[:5])


@pytest.mark.full
@pytest.mark.parametrize("friction", [0.0, 0.6])
def test_both_keep_momentum_and_angular_momentum_and_gain_no_energy(friction: float) -> None:
    simulator = Simulator(thrown(friction=friction), "cpu")

    def whole() -> NDArray[np.float64]:
        state, own = simulator.state, sphere_momenta(simulator)[0]
        center, spin = (each.numpy()[0, 0].astype(float) for each in (state.sphere_positions, state.sphere_spins))
        turning = np.cross(center, own) + 0.4 * 0.2 * (2.0 * EDGE) ** 2 * spin
        return np.concatenate([momentum(simulator) + own, angular_momentum(simulator) + turning])

    def energies() -> float:
        spin = simulator.state.sphere_spins.numpy()[0, 0].astype(float)
        turning = 0.2 * 0.2 * (2.0 * EDGE) ** 2 * float(spin @ spin)
        return energy(simulator) + float(sphere_energies(simulator).sum()) + turning

    start, least = whole(), energies()
    first = least
    for _ in range(40):
        simulator.step()
        np.testing.assert_allclose(whole()[:3], start[:3], atol=2e-6)
        np.testing.assert_allclose(whole()[3:], start[3:], atol=6e-5)  # places are rounded, 2,400 times by 6e-8 m
        assert energies() < 1.001 * least  # which a step of symplectic Euler is off by
        least = min(least, energies())
    assert least < 0.95 * first


@pytest.mark.full
def test_it_repeats_to_the_bit_and_worlds_stay_apart() -> None:
    places = [0.16, 0.16, 0.3]

    def points(worlds: int) -> NDArray[np.float32]:
        vary = {"sphere.0.position.1": places[:worlds]}
        simulator = Simulator(thrown(pressure=15.0), "cpu", worlds, vary)
        for _ in range(20):
            simulator.step()
        return np.array(simulator.state.points.numpy(), dtype=np.float32)

    alone, three = points(1), points(3)
    np.testing.assert_array_equal(three[:2], np.repeat(alone, 2, axis=0))
    assert np.abs(three[2] - three[0]).max() > 1e-3


@pytest.mark.full
def test_one_that_comes_later_meets_faces_from_then_on(tmp_path: Path) -> None:
    scene = thrown(pressure=15.0, frames=40)
    late = scene.sphere[0].model_copy(update={"start": 0.2})
    animate(scene.model_copy(update={"sphere": [late]}), tmp_path / "stage.usdc", device="cpu")
    assert check_stage(tmp_path / "stage.usdc").passed


def test_which_spheres_meet_faces_so() -> None:
    """Spheres that are not small meet ridges, where something is thin beside faces; none by the paper's rule."""

    def which(**given: Any) -> list[bool]:
        return round_ridges(Simulator(thrown(**given), "cpu").model)

    rod = Obstacle(shape="capsule", radius=0.01, length=1.0, position=(0.0, -2.0, 0.0))
    assert which() == which(faces="auto", obstacle=[rod]) == [True]
    assert which(faces="auto") == which(faces=False, obstacle=[rod]) == [False]
    assert which(radius=0.3 * EDGE) == [False]  # it meets them otherwise
    assert which(contact="penalty") == [False]
