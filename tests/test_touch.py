"""Contact of balloons with each other, and with themselves."""

import re
from dataclasses import replace

import numpy as np
import pytest
import small_batch
from conserved import angular_momentum, masses, momentum, motion, put
from meshes import cube, prism, quad_sphere
from overlaps import deepest
from touching import (
    RADIUS,
    SLACK,
    VACUUM,
    ball,
    centers,
    collision,
    energy,
    fast,
    horseshoe,
    pile,
    run,
    touching,
)
from trajectories import ROUNDING, advance_both, arrays, assert_close

from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness, Touch, load_scene
from balloon_warp.schedules import SCHEDULES
from balloon_warp.schedules.touch_table import part_count, surface_of
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

EPSILON = float(np.finfo(np.float32).eps)


@pytest.fixture(params=SCHEDULES)
def way(request: pytest.FixtureRequest, device: str) -> str:
    """Return each schedule."""
    if request.param in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{request.param} is for the CPU")
    return request.param


def require_the_same_sums(way: str, device: str) -> None:
    if way == "scatter" and device != "cpu":
        pytest.skip("adds springs' forces in another order every time")


def test_momentum_and_angular_momentum_are_kept(way, device):
    """Momentum and angular momentum are conserved to the rounding of velocities and places."""
    simulator = Simulator(collision(), device, schedule=way)
    start, spin, kick, touched = momentum(simulator), angular_momentum(simulator), 0.0, 0
    first = masses(simulator)[: simulator.model.particle_offsets[1]]
    own = first @ motion(simulator)[1][: len(first)]
    for frame in range(1, 41):
        simulator.step()
        touched = max(touched, touching(simulator))
        rounding = EPSILON * np.sqrt(48 * frame) * 0.6 * 4.0
        assert np.abs(momentum(simulator) - start).max() < rounding
        assert np.abs(angular_momentum(simulator) - spin).max() < rounding
        kick = max(kick, float(np.abs(first @ motion(simulator)[1][: len(first)] - own).max()))
    assert touched > 20
    assert kick > 0.5  # kg m/s, of 0.6


def test_contact_gives_no_energy(way, device):
    """Energy of motion and springs does not grow in contact, from springs at rest and a push, but for the swing of
    explicit steps, half of h omega of what is in the springs' fastest modes."""
    simulator = Simulator(collision(), device, schedule=way)
    start, most = energy(simulator), 0.0
    for _ in range(60):
        simulator.step()
        most = max(most, energy(simulator))
    assert touching(simulator) == 0  # it is over
    assert most < 1.001 * start
    assert 0.5 * start < energy(simulator) < 0.99 * start


@pytest.mark.full
def test_what_lies_on_another_is_hardly_in_it(way, device):
    """Penetration is below 2 % of the radius while a ball bounces and when it lies, with default thickness and
    stiffness; and no gap is visible."""
    simulator, deep = Simulator(pile(), device, schedule=way), 0.0
    for frame in range(240):
        simulator.step()
        if frame % 4 == 0:
            deep = max(deep, deepest(simulator))
    assert deep < 0.02 * RADIUS
    assert touching(simulator) > 10
    points = motion(simulator)[0]
    lower, upper = np.split(points, simulator.model.particle_offsets[1:-1])
    assert 0.2 < centers(simulator)[1, 1] - centers(simulator)[0, 1] < 2.6 * RADIUS
    gaps = np.linalg.norm(upper[:, None] - lower[None], axis=2).min()
    assert gaps < 0.1 * RADIUS


@pytest.mark.full
def test_fast_balloons_do_not_come_through_each_other(way, device):
    simulator = Simulator(fast(), device, schedule=way)
    for _ in range(30):
        simulator.step()
        assert centers(simulator)[1, 0] > centers(simulator)[0, 0]
    assert touching(simulator) == 0


def test_with_touch_false_they_do(device):
    simulator = run(fast().model_copy(update={"touch": False}), device, "gather", 20)
    assert centers(simulator)[1, 0] < centers(simulator)[0, 0]


def test_worlds_are_as_each_alone(way, device):
    """Worlds are bit-identical to each alone, and do not touch others at the same place, or they would fly apart."""
    require_the_same_sums(way, device)
    places = [0.7, 0.72, 0.7, 5.0]
    block = Simulator(collision(), device, 4, {"balloon.1.position.0": places}, schedule=way)
    for _ in range(16):
        block.step()
    found = arrays(block)
    for world, place in enumerate(places):
        scene = load_scene(collision(), {"balloon.1.position.0": place})
        alone = arrays(run(scene, device, way, 16))
        for name in ("points", "velocities", "holds"):
            np.testing.assert_array_equal(found[name][world], alone[name][0])
    assert (found["holds"][:3, :, 3] != 0.0).any(axis=1).all()
    assert not found["holds"][3].any()


def test_it_repeats_to_the_bit(device):
    first, second = (arrays(run(collision(), device, "gather", 20)) for _ in range(2))
    for name, array in first.items():
        np.testing.assert_array_equal(array, second[name])


def test_gather_does_what_scatter_does(device):
    found, expected, start = advance_both(collision(), "gather", device, settled=10, frames=2)
    assert (start["holds"][..., 3] != 0.0).any()
    # which of two triangles is nearest may hang on rounding, and with it where it pushes
    assert_close(found, expected, ROUNDING, outliers=0.02)


def test_going_on_from_a_state_is_going_on(way, device):
    """A restored run is bit-identical, as contact history is in the state."""
    require_the_same_sums(way, device)
    on = run(collision(), device, way, 14)
    again = Simulator(collision(), device, schedule=way)
    again.restore(arrays(on))
    for simulator in (on, again):
        for _ in range(4):
            simulator.step()
    for name, array in arrays(on).items():
        np.testing.assert_array_equal(array, arrays(again)[name])


def test_coincident_balloons_stay_finite(way, device):
    """Coincident balloons stay finite, be it particle by particle or one in the very center of another."""
    mesh = quad_sphere(4, RADIUS)
    coarse, grain = ball(0, 0, 0, mesh=mesh), Balloon(mesh=mesh, scale=1e-3, inflation=SLACK)
    scene = Scene(balloon=[coarse, coarse, grain], touch=Touch(itself=True), **VACUUM)
    simulator = run(scene, device, way, 10)
    assert np.isfinite(arrays(simulator)["points"]).all()
    assert np.isfinite(arrays(simulator)["holds"]).all()


def test_a_balloon_does_not_touch_what_it_hangs_together_with(way, device):
    """A ball has no contact with its own neighborhood, at rest and as pressure swells it."""
    for inflation in (SLACK, Inflation(pressure=10.0)):
        scene = Scene(balloon=[ball(0.0, 0.0, 0.0, inflation=inflation)], touch=Touch(itself=True), **VACUUM)
        assert touching(run(scene, device, way, 10)) == 0


@pytest.mark.parametrize("itself", [True, False])
def test_a_folded_balloon_touches_itself_if_it_is_to(itself, way, device):
    """A horseshoe whose ends come together at 4 m/s has self-contact if enabled."""
    mesh = horseshoe()
    stiffness = Stiffness(structural=100.0, shear=50.0, flexion=50.0)
    shoe = Balloon(mesh=mesh, mass=0.5, damping=0.0, inflation=SLACK, stiffness=stiffness)
    lone = Balloon(mesh=mesh, mass=0.5, position=(9.0, 0.0, 0.0), inflation=SLACK)
    scene = Scene(balloon=[shoe, lone], touch=Touch(itself=itself), **VACUUM)
    simulator = Simulator(scene, device, schedule=way)
    count = mesh.vertex_count
    first, last = np.arange(8), np.arange(count - 8, count)
    velocities = np.zeros((2 * count, 3))
    bend = np.clip(mesh.points[:, 0], 0.0, None) * np.sign(mesh.points[:, 1])
    velocities[:count, 1] = -4.0 * bend
    put(simulator, velocities=velocities)
    start, spin, gaps = momentum(simulator), angular_momentum(simulator), []
    for _ in range(25):
        simulator.step()
        points = motion(simulator)[0]
        gaps.append(float(points[first, 1].mean() - points[last, 1].mean()))
    assert (min(gaps) > 0.0) == itself
    assert np.abs(momentum(simulator) - start).max() < 1e-4
    assert np.abs(angular_momentum(simulator) - spin).max() < 1e-4


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"thickness": -1.0}, "touch.thickness: must be greater than or equal to 0 (got -1.0)"),
        ({"stiffness": -1.0}, "touch.stiffness: must be greater than or equal to 0 (got -1.0)"),
        ({"friction": -0.1}, "touch.friction: must be greater than or equal to 0 (got -0.1)"),
        (
            {"balloons": False, "itself": False, "spheres": False},
            "touch.balloons: expected true for balloons, itself or spheres (got none); touch = false turns all "
            "contact off",
        ),
        ({"frictoin": 0.1}, "touch.frictoin: unknown field; did you mean friction?"),
    ],
)
def test_mistakes_are_named(fields, said):
    with pytest.raises(InputError, match=re.escape(said)):
        load_scene(collision(), {f"touch.{name}": value for name, value in fields.items()})


@pytest.mark.full
def test_a_world_that_fits_in_no_block_goes_side_by_side_too():
    """A world too large for a block advances by eight particles at a time on a CPU, with the contacts of `gather`.

    Its forces are summed in another order, as in `scatter`, so that a contact may begin a substep later.
    """
    large = collision().model_copy(
        update={
            "balloon": [balloon.model_copy(update={"mesh": quad_sphere(32, 0.3)}) for balloon in collision().balloon]
        }
    )
    assert Simulator(collision(), "cpu").schedule.name == "octets"
    assert Simulator(large, "cpu").schedule.name == "octets"
    (found, _, start), (expected, _, _) = (
        advance_both(large, schedule, "cpu", settled=15, frames=1) for schedule in ("octets", "gather")
    )
    assert (start["holds"][..., 3] != 0.0).any()
    assert_close(found, expected, ROUNDING, outliers=0.02)


def test_large_steps_are_refused():
    said = 'solver: "projective" does not support balloons that touch; expected another solver'
    with pytest.raises(InputError, match=re.escape(said)):
        Simulator(load_scene(collision(), {"solver": "projective"}), "cpu")


@pytest.mark.full
def test_a_blow_up_names_what_touched(device):
    """The report names a touching particle, any of two plates so thin that all of theirs lie on the other."""
    box = cube()
    plate = replace(box, points=box.points * [0.01, 1.0, 1.0])
    boxes = [Balloon(mesh=plate, position=(x, 0.0, 0.0), inflation=SLACK) for x in (0.0, -0.0101)]
    simulator = Simulator(Scene(balloon=boxes, touch=Touch(), **VACUUM), device)
    simulator.step()
    assert touching(simulator) > 0
    simulator.set_parameters({"gravity": [1e12 - 1e9]})
    with pytest.raises(BlowUpError, match="it touched a balloon"):
        simulator.step()


def test_the_parts_of_a_surface_are_as_many_as_memory_is_counted_for():
    for mesh in (quad_sphere(1), quad_sphere(5), prism(7), cube()):
        surface = surface_of(mesh)
        assert part_count(mesh) == len(surface.ends)
        whole = [part for part, after in enumerate(surface.ends) if after == part + 1]
        found = np.concatenate([np.arange(*surface.ranges[part]) for part in whole])
        np.testing.assert_array_equal(found, np.arange(len(surface.triangles)))  # each once, in order
        for part, (begin, end) in enumerate(surface.ranges):
            inner = [each for each in whole if part <= each < surface.ends[part]]
            assert (surface.ranges[inner[0]][0], surface.ranges[inner[-1]][1]) == (begin, end)


def test_stiff_contacts_ask_for_shorter_steps():
    def substeps(**fields: float) -> int:
        return Simulator(collision(touch=Touch(**fields), substeps="auto"), "cpu").model.substeps

    without = Simulator(collision(substeps="auto").model_copy(update={"touch": False}), "cpu").model.substeps
    assert without < substeps() < 2 * without
    assert substeps(stiffness=1e5) > 20 * without
    with pytest.raises(InputError, match="substeps: 12 are too few"):
        Simulator(collision(touch=Touch(stiffness=1e5), substeps=12), "cpu")


@pytest.mark.full
def test_a_world_that_blows_up_leaves_the_others_alone(way, device):
    """A world that blows up leaves the others unchanged: no triangle is near points that are not numbers, where a
    regression read one before the first. `scatter` adds in any order on a GPU, and so agrees to rounding."""
    scene = small_batch.scene().model_copy(update={"touch": Touch()})
    vary = {"balloon.inflation.k_normal": [0.2, 9e11]}
    simulator = Simulator(scene, device, 2, vary, schedule=way)
    alone = Simulator(load_scene(scene, {"balloon.inflation.k_normal": 0.2}), device, schedule=way)
    for _ in range(4):
        simulator.advance()
        alone.advance()
    points = simulator.state.points.numpy()
    assert not np.isfinite(points[1]).all()
    rounding = 1e-5 if way == "scatter" and device != "cpu" else 0.0
    np.testing.assert_allclose(points[0], alone.state.points.numpy()[0], atol=rounding, rtol=0.0)
