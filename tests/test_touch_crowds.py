"""Crowded contacts, as of slack balloons that crumple: no particle is thrown off, and ignored contacts are reported."""

import re
from typing import Any

import numpy as np
import pytest
from conserved import masses, motion
from meshes import grid, mesh_of, quad_sphere
from touching import RADIUS, SLACK, VACUUM, ball, energy, fast, pile, touching

from balloon_warp import Cluster, run_batch
from balloon_warp.job import animate
from balloon_warp.scene import Atmosphere, Balloon, Ground, Scene, Stiffness, Touch, load_scene
from balloon_warp.schedules import SCHEDULES
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics


@pytest.fixture(params=SCHEDULES)
def way(request: pytest.FixtureRequest, device: str) -> str:
    """Return each schedule."""
    if request.param in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{request.param} is for the CPU")
    return request.param


def sheet() -> Balloon:
    """Return a fixed sheet, in quads as large as a ball's."""
    square = grid(12, 12)
    flat = mesh_of(0.1 * (square.points - (6.0, 6.0, 0.0)), square.face_vertex_indices.reshape(-1, 4).tolist())
    return Balloon(mesh=flat, fixed=list(range(169)), inflation=SLACK)


@pytest.mark.full
def test_many_contacts_on_a_particle_give_no_energy(way, device):
    """Energy does not grow as a ball bounces from eight sheets in one place, each as stiff as the step allows for one,
    but for the swing of explicit steps."""
    coming = ball(0.0, 0.0, 0.6, velocity=(0.0, 0.0, -2.0), inflation=SLACK)
    scene = Scene(balloon=[coming, *(sheet() for _ in range(8))], touch=Touch(), **VACUUM)
    simulator = Simulator(scene, device, schedule=way)
    start, most, touched = energy(simulator), 0.0, 0
    for _ in range(60):
        simulator.step()
        most = max(most, energy(simulator))
        touched = max(touched, touching(simulator))
    assert touched > 10
    assert most < 1.001 * start
    assert touching(simulator) == 0
    assert motion(simulator)[0][:386, 2].mean() > 0.4  # it has left them, to where it came from


def heap(count: int, fineness: int, softness: float) -> Scene:
    """Return slack balls, one over the other, that fall down and crumple."""
    soft = Stiffness(structural=40.0 * softness, shear=20.0 * softness, flexion=2.0 * softness)
    slack = {"mesh": quad_sphere(fineness, RADIUS), "stiffness": soft, "damping": 0.3, "inflation": SLACK}
    balls = [ball(0.1 * n, 0.55 + 1.05 * n, 0.05 * n, **slack) for n in range(count)]
    air = Atmosphere(density=0.0)
    return Scene(balloon=balls, ground=Ground(), touch=Touch(itself=True), atmosphere=air)


@pytest.mark.full
@pytest.mark.parametrize(
    ("count", "fineness", "softness", "frames"),
    [(1, 12, 0.1, 80), (2, 8, 1.0, 120), (6, 4, 0.1, 110)],
    ids=["one", "two", "six"],
)
def test_what_crumples_is_no_faster_than_it_falls(count, fineness, softness, frames, way, device):
    """Speeds of crumpling balls stay below that of the fall, but for a fifth, by which a skin may whip. Lost energy
    does not return, but for the swing of explicit steps: a two-thousandth. If contacts in a crowd did not share what a
    step allows, six would gain more while they settle."""
    simulator = Simulator(heap(count, fineness, softness), device, schedule=way)
    weights = 9.81 * masses(simulator)
    fall = np.sqrt(2.0 * 9.81 * motion(simulator)[0][:, 1].max())

    def whole() -> float:
        return energy(simulator) + float(weights @ motion(simulator)[0][:, 1])

    energies, fastest = [whole()], []
    for _ in range(frames):
        simulator.step()
        energies.append(whole())
        fastest.append(float(np.linalg.norm(motion(simulator)[1], axis=1).max()))
    assert touching(simulator) > 20
    assert max(fastest) < 1.2 * fall
    assert np.max(energies - np.minimum.accumulate(energies)) < 0.0005 * energies[0]


def test_what_has_no_place_in_a_list_is_told(device, tmp_path):
    told: dict[str, list[str]] = {"fast": [], "slow": []}
    for scene, name in ((fast(), "fast"), (pile(), "slow")):
        animate(
            load_scene(scene, {"frames": 4}), tmp_path / f"{name}.usdc", device=device, on_warning=told[name].append
        )
    (sentence,) = told["fast"]
    assert re.match(r"touch: contacts were too crowded [\d,]+ times and some were ignored: .* the 24 nearest", sentence)
    assert not told["slow"]


@pytest.mark.parametrize("spread", [False, True])
def test_a_batch_tells_it_of_all_worlds(spread, device, tmp_path):
    """A batch counts ignored contacts of all worlds: each has as many as alone, here and in shares."""

    def count(sentences: list[str]) -> int:
        (sentence,) = (each for each in sentences if each.startswith("touch: "))
        (times,) = re.findall(r"too crowded ([0-9,]+) times", sentence)
        return int(times.replace(",", ""))

    scene = load_scene(fast(), {"frames": 4})
    told: list[str] = []
    alone: list[str] = []
    where: dict[str, Any] = {"cluster": Cluster(workers=2)} if spread else {"device": device}
    own = "cpu" if spread else device
    animate(scene, tmp_path / "one.usdc", device=own, schedule="gather", on_warning=alone.append)
    run_batch(scene, tmp_path, 16, schedule="gather", on_warning=told.append, **where)
    assert count(told) == 16 * count(alone)
