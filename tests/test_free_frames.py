"""Schedules against themselves: repeated and in batches, frames free of collisions, rounds of substeps."""

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
import warp as wp
from costs import nightly_but
from feature_sets import feature_set
from meshes import mesh_of, quad_sphere
from method_scenes import SCENES as METHODS
from trajectories import ROUNDING as ROUNDING_OF_PLACES
from trajectories import after_frames, arrays, assert_close, stepped
from warp._src.apic.capture import APICapture

from balloon_warp import InputError, Simulator, String, Touch, load_scene
from balloon_warp.kernels.contact.free_frames import BUSY, FREE, HURRIED
from balloon_warp.model import Model, State, build_model, initial_state, lay_out, plan_model
from balloon_warp.scene import Atmosphere, Balloon, Ground, Inflation, Material, Obstacle, Scene, Sphere, Stiffness
from balloon_warp.schedules import choose, frames, gather, slices
from balloon_warp.schedules.choose import fastest_schedule, make_schedule
from balloon_warp.schedules.frames import TURN, Rounds, make_clock
from balloon_warp.schedules.one_launch import LanesSchedule
from balloon_warp.schedules.tables import make_tables, model_features

ROUNDING = 2.0e-5  # of its size: the same sums in another order, over a few frames
OF_PRESSURES = 0.5  # [Pa]: five millionths of the air's; an excess is the difference of two such pressures, in float32
SPHERE = trimesh.creation.icosphere(subdivisions=4)
TRIANGLES = mesh_of(SPHERE.vertices, SPHERE.faces.tolist())  # of 2,562 particles


def of_triangles(**fields: Any) -> Balloon:
    return Balloon(mesh=TRIANGLES, mass=3.0, **fields)


def of_quads(**fields: Any) -> Balloon:
    """Return a ball of 1,178 particles, 1 m in radius."""
    weight = {} if "material" in fields else {"mass": 3.0}
    return Balloon(mesh=quad_sphere(14), **weight | fields)


GAS = Inflation(kind="gas", start_pressure=50.0)
PRESSURE = Inflation(kind="pressure", pressure=30.0)
NORMALS = Inflation(k_normal=30.0)
TWO = [of_quads(inflation=GAS), of_triangles(position=(3, 0, 0), inflation=NORMALS)]
TIED: dict[str, Any] = {"balloon": [of_triangles(inflation=GAS, drag_coefficient=0.4)]}
TIED |= {"string": [String(anchor=(0, -2, 0))], "atmosphere": Atmosphere(wind=(1, 0, 0), gusts=0.2)}
SCENES = {
    "cached normals": Scene(balloon=[of_quads(inflation=NORMALS)], normals="cached"),
    "fresh normals": Scene(balloon=[of_quads(inflation=NORMALS)], normals="fresh"),
    "pressure, triangles": Scene(balloon=[of_triangles(inflation=PRESSURE)]),
    "gas, on the ground": Scene(balloon=[of_quads(position=(0, 1, 0), inflation=GAS)], ground=Ground()),
    "two balloons, two kinds": Scene(balloon=TWO, normals="cached", touch=False),
    "rubber": Scene(balloon=[of_quads(material={"preset": "latex"}, inflation=PRESSURE)]),
    "wind and strings": Scene(**TIED),
    "forward Euler": Scene(balloon=[of_quads(inflation=GAS)], solver="forward_euler", substeps=21),
    "stiffness that varies": Scene(balloon=[of_quads(stiffness={"variation": 0.3})], normals="cached"),
}


@pytest.fixture(params=SCENES)
def scene(request: pytest.FixtureRequest) -> Scene:
    return SCENES[request.param]


def tiles_of(patches: gather.Patches, model: Model) -> list[dict[int, int]]:
    """Return the particles at the places of each patch, its own and those of its halo."""
    halos = np.split(patches.halo_keys % model.particle_count, patches.halo_offsets[1:-1])
    tiles = [{patches.threads + place: particle for place, particle in enumerate(halo.tolist())} for halo in halos]
    for particle, (patch, place) in enumerate(zip(patches.patch.tolist(), patches.place.tolist(), strict=True)):
        assert place not in tiles[patch]
        tiles[patch][place] = particle
    return tiles


def test_tables_of_patches_lead_where_the_models_do(scene: Scene):
    """Patches are alike in size and of one balloon each. Springs, faces and membranes lead to the same particles. Halo
    particles are marked, and halos are mutual, or one patch would run ahead of the other. A halo of two rings around a
    square of 256 has about 144 particles, not a strip's."""
    model = build_model(scene, "cpu")
    assert gather.cut_into_patches(model, model_features(model)) is None  # a CPU has none
    patches = gather.cut_patches(model, 256, model_features(model).gas)  # as for a GPU with enough multiprocessors
    ends = slices.spring_ends(model)
    sizes = np.bincount(patches.patch)
    assert sizes.max() <= patches.threads
    assert np.ptp(sizes) <= 0.3 * patches.threads
    assert (patches.balloons[patches.patch] == model.particle_balloon.numpy()).all()
    tiles = tiles_of(patches, model)
    slots = gather.slots_in_patches(model, patches, slices.quad_rings(model))
    neighbors, lengths, scales = (each.numpy() for each in (slots.neighbors, slots.rest_lengths, slots.scales))
    particle = np.broadcast_to(np.arange(model.particle_count), neighbors.shape)
    led_to = np.array([tiles[patches.patch[p]][n] for p, n in zip(particle.flat, neighbors.flat, strict=True)])
    there, led_to = scales > 0.0, led_to.reshape(particle.shape)
    found = sorted(zip(particle[there].tolist(), led_to[there].tolist(), lengths[there].tolist(), strict=True))
    expected = (ends.particle.tolist(), ends.neighbor.tolist(), ends.rest_length.astype(np.float32).tolist())
    assert found == sorted(zip(*expected, strict=True))
    np.testing.assert_array_equal(led_to[~there], particle[~there])
    without_volumes = gather.cut_patches(model, 256, volumes=False)
    assert without_volumes.largest_halo < 220
    table, patch_of = gather.patch_table(model, without_volumes, measures_faces=False), without_volumes.patch
    halos = table.halos.numpy()
    assert set(halos[halos >= 0].tolist()) == set(np.flatnonzero(table.in_halos.numpy()).tolist())
    pairs = {(patch, int(patch_of[particle])) for patch, row in enumerate(halos) for particle in row[row >= 0]}
    assert pairs == {(other, patch) for patch, other in pairs}
    assert all(patch != other for patch, other in pairs)
    tables = make_tables(model, model_features(model))
    led = gather.tables_in_patches(model, patches, tables)
    for there, known in (
        (led.fans.quads, tables.fans.quads),
        (led.fans.particles, tables.fans.particles),
        (led.membranes.others, tables.membranes.others),
    ):
        if known is not None:
            rows = (each.numpy().reshape(len(each), -1).tolist() for each in (there, known))
            for places, particles in zip(*rows, strict=True):
                assert any([tile.get(place) for place in places] == particles for tile in tiles)


def frames_of(model: Model, count: int) -> State:
    """Advance so many frames in `gather` and return the state."""
    schedule, state = make_schedule(model, "gather"), initial_state(model)
    for _ in range(count):
        schedule.advance_frame(state)
    return state


def assert_moves_as_in_launches(model: Model, frames: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Require that patches agree with launch after launch, and repeat bit-identically."""
    assert gather.cut_into_patches(model, model_features(model))
    found, again = frames_of(model, frames), frames_of(model, frames)
    monkeypatch.setattr(gather, "cut_into_patches", lambda model, features: None)
    expected = frames_of(model, frames)
    start = initial_state(model).points.numpy()
    size = np.ptp(start[0], axis=0).max()
    assert np.abs(expected.points.numpy() - start).max() > 100 * ROUNDING * size
    np.testing.assert_allclose(found.points.numpy(), expected.points.numpy(), rtol=0, atol=ROUNDING * size)
    np.testing.assert_allclose(found.pressures.numpy(), expected.pressures.numpy(), rtol=0, atol=OF_PRESSURES)
    np.testing.assert_array_equal(found.points.numpy(), again.points.numpy())
    np.testing.assert_array_equal(found.frame.numpy(), expected.frame.numpy())


def test_trajectories_are_those_of_launches_on_a_gpu(scene: Scene, gpu: wp.Device, monkeypatch: pytest.MonkeyPatch):
    assert_moves_as_in_launches(build_model(scene, gpu), 5, monkeypatch)


@pytest.mark.parametrize("name", ["cached normals", "fresh normals", "gas"])
def test_so_are_those_of_patches_on_nearly_all_multiprocessors(name: str, gpu: wp.Device, monkeypatch):
    """Trajectories agree where patches exchange sums with more others than a warp has threads."""
    inflation = Inflation(kind="gas", start_pressure=5.0e3) if name == "gas" else Inflation(k_normal=20.0)
    balloon = Balloon(mesh=quad_sphere(129), mass=60.0, inflation=inflation)
    normals = "fresh" if name == "fresh normals" else "cached"
    model = build_model(Scene(balloon=[balloon], normals=normals, substeps=40), gpu)
    patches: Any = gather.cut_into_patches(model, model_features(model))
    assert patches.count > 0.9 * gpu.sm_count
    assert_moves_as_in_launches(model, 3, monkeypatch)


@pytest.mark.parametrize("name", ["fresh normals", "gas, on the ground"])
def test_more_worlds_than_a_gpu_moves_at_once_are_each_as_alone(name: str, gpu: wp.Device):
    alone = build_model(SCENES[name], gpu)
    patches: Any = gather.cut_into_patches(alone, model_features(alone))
    many = build_model(SCENES[name], gpu, 2 * gpu.sm_count)
    assert gather.worlds_at_once(many, model_features(many), patches) < many.world_count
    expected, found = frames_of(alone, 2).points.numpy()[0], frames_of(many, 2).points.numpy()
    assert (found == expected).all()


def test_auto_takes_patches_for_few_large_worlds_on_a_gpu(gpu: wp.Device):
    model = build_model(load_scene("squirrel_inflate"), gpu)
    assert fastest_schedule(model, 1) == "gather"
    assert fastest_schedule(model, 4096) == "block"


@pytest.mark.parametrize("inflation", [Inflation(pressure=10.0), Inflation(k_normal=0.1)])
def test_springs_stand_in_their_own_table_beside_rings(inflation: Inflation):
    """Code that visits springs alone needs the table: a GPU reads past an empty one."""
    model = build_model(Scene(balloon=[Balloon(mesh=quad_sphere(5), inflation=inflation)]), "cpu")
    features = model_features(model)
    assert features.rings
    springs = make_tables(model, features).springs
    assert springs.valences.numpy().sum() == 2 * model.spring_count
    assert len(springs.entries) >= 2 * model.spring_count


CLOSING = "balloon.1.velocity.0"
PLACES = 4.0e-5  # rounding of places [m]: the same sums in another order, for balloons of 2 m


def meeting(inflation: Inflation) -> Scene:
    """Return two balloons 0.3 m apart; the value of CLOSING decides when they meet."""
    still, moves = {"inflation": inflation, "damping": 0.1}, {"position": (2.3, 0.1, 0.2), "velocity": (-3.0, 0.0, 0.0)}
    return Scene(balloon=[of_quads(**still), of_quads(**still, **moves)], ground=Ground(height=-1.05), frames=8)


INFLATIONS = {"pressure": PRESSURE, "gas": GAS, "normals": Inflation(k_normal=0.5)}


def launched(scene: Scene, gpu: wp.Device, monkeypatch: pytest.MonkeyPatch) -> Simulator:
    """Return a simulator that launches every substep."""
    with monkeypatch.context() as patch:
        patch.setattr(choose, "_in_patches", lambda model: None)
        simulator = Simulator(scene, str(gpu), schedule="gather")
    assert isinstance(simulator.schedule, gather.GatherSchedule)
    return simulator


@pytest.mark.parametrize("name", INFLATIONS)
def test_balloons_meet_as_in_launches_on_a_gpu(name: str, gpu: wp.Device, monkeypatch: pytest.MonkeyPatch):
    """Frames are free, then busy; places are those of launches to rounding, and to what contact makes of it: at most
    four times of what it makes of starts that are moved by the rounding of places, 2e-7 m."""
    scene = meeting(INFLATIONS[name])
    simulator, peer, *moved = Simulator(scene, str(gpu)), *(launched(scene, gpu, monkeypatch) for _ in range(4))
    seen, rng = [], np.random.default_rng(2)
    for aside in moved:
        points = aside.state.points.numpy()
        aside.state.points.assign((points + 2e-7 * rng.uniform(-1.0, 1.0, points.shape)).astype(np.float32))
    for _ in range(scene.frames):
        for each in (simulator, peer, *moved):
            each.step()
        seen += verdicts(simulator)
        found, expected, *aside = (each.state.points.numpy() for each in (simulator, peer, *moved))
        spread = max(np.abs(each - expected).max() for each in aside)
        np.testing.assert_allclose(found, expected, atol=PLACES + 4.0 * spread)
        np.testing.assert_allclose(simulator.state.pressures.numpy(), peer.state.pressures.numpy(), atol=0.5)
    assert seen[0] == FREE
    assert seen[-1] == BUSY
    # The first has been hit: alone it stays at rest to 1e-8 m/s.
    assert simulator.state.velocities.numpy()[0, :1178, 0].mean() < -0.01


def test_a_world_does_not_feel_how_free_another_is_on_a_gpu(gpu: wp.Device):
    scene, speeds = meeting(INFLATIONS["gas"]), [-3.0, 0.0, -1.0, -12.0]
    batch, seen = Simulator(scene, str(gpu), 4, {CLOSING: speeds}, schedule="gather"), []
    for _ in range(scene.frames):
        batch.step()
        seen.append(verdicts(batch))
    assert {FREE, BUSY} <= set(np.ravel(seen).tolist())
    assert [row[1] for row in seen] == [FREE] * scene.frames
    for world, speed in enumerate(speeds):
        alone = Simulator(scene, str(gpu), 1, {CLOSING: [speed]}, schedule="gather")
        for _ in range(scene.frames):
            alone.step()
        np.testing.assert_array_equal(batch.read_frame(world).points, alone.read_frame().points)


def test_what_goes_further_than_was_free_touches_all_the_same_on_a_gpu(gpu: wp.Device, monkeypatch: pytest.MonkeyPatch):
    """A ball that falls 8 cm in its first frame lands on one that is pinned 3 cm below."""
    inflation = PRESSURE
    below = of_quads(damping=0.1, inflation=inflation, fixed=list(range(1178)))
    above = of_quads(damping=0.1, inflation=inflation, position=(0.0, 2.03, 0.0))
    scene = Scene(balloon=[above, below], gravity=600.0, frames=1)
    simulator, peer = Simulator(scene, str(gpu)), launched(scene, gpu, monkeypatch)
    for each in (simulator, peer):
        each.step()
    assert verdicts(simulator) == [HURRIED]
    np.testing.assert_allclose(simulator.state.points.numpy(), peer.state.points.numpy(), atol=PLACES)


PLATE = Obstacle(size=(4.0, 1e-3, 4.0), position=(0.0, -0.5e-3, 0.0))
FALL = 5000.0  # a gravity by which a balloon at rest falls 0.69 m in a frame, where it is believed to move 3 mm [m/s^2]


def verdicts(simulator: Simulator) -> list[int]:
    return [int(verdict) for verdict in simulator.schedule.busy.contact_horizon.table.verdicts.numpy()]


def free_particles(height: float) -> Balloon:
    """Return four particles without springs and air."""
    corners = [(0.0, height, 0.0), (0.1, height, 0.0), (0.1, height, 0.1), (0.0, height, 0.1)]
    mesh, nothing = mesh_of(corners, [[0, 1, 2, 3]]), Stiffness(structural=0.0, shear=0.0, flexion=0.0)
    return Balloon(mesh=mesh, stiffness=nothing, inflation=Inflation(k_normal=0.0), damping=0.0)


@pytest.mark.full
def test_what_goes_further_than_was_free_is_stopped_all_the_same(device: str):
    """A particle that reaches 83 m/s in the first frame does not tunnel through a plate of 1 mm, 0.3 m below."""
    scene = Scene(balloon=[free_particles(0.3)], obstacle=[PLATE], gravity=FALL, substeps=16, frames=3)
    simulator = Simulator(scene, device, schedule="block")
    simulator.step()
    assert verdicts(simulator) == [HURRIED]
    assert simulator.read_frame().points[0][:, 1].min() >= -1e-6
    simulator.step()
    assert verdicts(simulator) == [BUSY]


TOP = np.flatnonzero(quad_sphere(3, 0.2).points[:, 1] > 0.1).tolist()
RUBBER = Material(kind="neo_hookean", shear_modulus=4e5, thickness=3e-4, softening=0.5)
HANGS = {"position": (0.0, 0.4, 0.0), "inflation": Inflation(pressure=0.0), "fixed": TOP, "damping": 0.0}
AGAIN = {
    "gas": (
        {"position": (0.0, 0.5, 0.0), "inflation": Inflation(kind="gas", amount=1.0, pump=50.0)},
        {"gravity": 300.0, "substeps": 200, "sphere": [Sphere(position=(1.0, 2.0, 0.0), radius=0.1, mass=0.1)]},
    ),
    "rubber": (HANGS | {"material": RUBBER}, {"gravity": 2.0 * FALL, "substeps": 400}),
}


@pytest.mark.full
@pytest.mark.parametrize("name", nightly_but([name for name in AGAIN if name != "gas"], AGAIN))
def test_a_frame_that_is_simulated_again_leaves_nothing_of_the_first_time(name: str, device: str):
    """A repeated frame pumps no gas twice, moves no sphere twice and counts once, as in a schedule that does not
    speculate. Softening is not kept from it: a ball hangs by its top, and falls so fast that a plate stops it; without
    the plate it is stretched further."""
    ball, fields = AGAIN[name]
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(3, 0.2), **ball)], obstacle=[PLATE], frames=2, **fields)
    simulator, peer = Simulator(scene, device, schedule="block"), Simulator(scene, device, schedule="gather")
    for one in (simulator, peer):
        one.step()
    assert verdicts(simulator) == [HURRIED]
    for field in ("gas_amounts", "free_volumes", "pressures", "sphere_positions", "sphere_velocities", "frame"):
        found, expected = (getattr(one.state, field).numpy() for one in (simulator, peer))
        rounding = 0.05 if field == "pressures" else 0.0  # [Pa], of which the air around has 101,325
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=rounding, err_msg=field)
    if name == "rubber":
        expected = peer.state.kept["peak"].numpy()
        assert expected.max() > 0.0
        np.testing.assert_allclose(simulator.state.kept["peak"].numpy(), expected, atol=1e-3 * expected.max())
    else:
        np.testing.assert_allclose(simulator.state.points.numpy(), peer.state.points.numpy(), atol=1e-5)


@pytest.mark.full
def test_a_world_does_not_feel_how_free_another_is(device: str):
    scene = Scene(balloon=[free_particles(0.3)], obstacle=[PLATE], gravity=10.0, substeps=16, frames=1)
    vary = {"gravity": [FALL, 10.0, 10.0], "obstacle.0.position.1": [0.0, 0.299, -0.1]}
    batch = Simulator(scene, device, 3, vary, schedule="block")
    batch.step()
    assert verdicts(batch) == [HURRIED, BUSY, FREE]
    for world in range(3):
        mine = {name: values[world : world + 1] for name, values in vary.items()}
        alone = Simulator(scene, device, 1, mine, schedule="block")
        alone.step()
        np.testing.assert_array_equal(batch.read_frame(world).points[0], alone.read_frame().points[0])


@pytest.mark.full
@pytest.mark.parametrize(
    "motion",
    [
        pytest.param([(0.0, (0, 0, 0)), (0.15, (0, 1, 0))], id="moves"),
        pytest.param([(0.0, (0, 0, 0), (0, 0, 0)), (0.5, (0, 0, 0), (0, 0, 60))], id="turns"),
    ],
)
def test_an_obstacle_that_comes_is_seen_in_time(motion: list, device: str):
    """A racket that comes 11 cm nearer in a frame is detected before it hits balloons which hang in the air."""
    racket = Obstacle(size=(4.0, 1e-3, 4.0), motion=motion)
    still = free_particles(0.53).model_copy(update={"position": (1.5, 0.0, 0.0)})
    scene = Scene(balloon=[still], obstacle=[racket], gravity=0.0, substeps=8, frames=30)
    simulator = Simulator(scene, device, schedule="block")
    simulator.step()
    assert verdicts(simulator) == [FREE]
    *_, last = simulator.run()
    assert last.points[0][:, 1].min() > 0.9  # the racket has passed their place, and has taken all along


@pytest.mark.full
@pytest.mark.parametrize("schedule", ["block", "lanes", "octets"], indirect=True)
def test_a_balloon_that_hurries_to_another_touches_it(schedule: str, device: str):
    """A balloon that falls 4 cm in the first frame lands on one that is pinned 3 cm below."""
    below = free_particles(0.0).model_copy(update={"fixed": [0, 1, 2, 3], "scale": 3.0, "position": (-0.1, 0.0, -0.1)})
    pair = Scene(balloon=[free_particles(0.03), below], touch=Touch(), gravity=300.0, substeps=32, frames=1)
    simulator, peer = Simulator(pair, device, schedule=schedule), Simulator(pair, device, schedule="gather")
    for one in (simulator, peer):
        one.step()
    assert verdicts(simulator) == [HURRIED]
    lowest = simulator.read_frame().points[0][:, 1].min()
    assert lowest > 0.03 - 0.5 * 300.0 / 3600.0 + 0.005  # it would be there if it had not been stopped
    np.testing.assert_allclose(simulator.state.points.numpy(), peer.state.points.numpy(), atol=1e-5)


@pytest.mark.full
def test_a_particle_with_few_faces_may_stand_at_the_origin(schedule, device):
    """Padding of octets' face tables does not reach a particle at the origin, with three faces beside four."""
    ball = quad_sphere(3, radius=0.5)
    corner = int(np.argmax(ball.points.sum(axis=1)))
    x, y, z = (-ball.points[corner]).tolist()
    still = Balloon(mesh=ball, position=(x, y, z), helium=9.81, inflation=Inflation(k_normal=1e-5), damping=0.0)
    scene = Scene(balloon=[still], normals="fresh", gravity=9.81)
    simulators = [after_frames(scene, name, device, 1) for name in (schedule, "scatter")]
    found, expected = (arrays(simulator) for simulator in simulators)
    np.testing.assert_allclose(expected["points"][0, corner], 0.0, atol=ROUNDING_OF_PLACES)
    moved, reference = (simulator.state.velocities.numpy()[0] for simulator in simulators)
    assert np.linalg.norm(reference[corner]) > 1e-5  # by its nearest face
    np.testing.assert_allclose(moved, reference, rtol=1e-3, atol=1e-7)
    assert_close(found, expected, ROUNDING_OF_PLACES)


def test_a_fixed_particle_feels_neither_sphere_nor_ground(schedule, device):
    ball = quad_sphere(3, radius=0.5)
    fixed = [int(np.argmin(ball.points[:, 1])), int(np.argmax(ball.points[:, 1]))]
    scene = Scene(
        balloon=[Balloon(mesh=ball, position=(0.0, 0.4, 0.0), fixed=fixed)],
        sphere=[Sphere(position=(0.0, 0.9, 0.0), radius=0.3)],
        ground=Ground(),
    )
    start, moved = (arrays(after_frames(scene, schedule, device, frames))["points"][0] for frames in (0, 2))
    np.testing.assert_array_equal(moved[fixed], start[fixed])
    start_of_others, others = (np.delete(points, fixed, axis=0) for points in (start, moved))
    assert start[fixed[0], 1] < -0.05
    assert start_of_others[:, 1].min() < -0.05
    assert others[:, 1].min() > -1e-6


PER_WORLD = (
    *("structural", "shear", "flexion", "torsion", "viscosity", "yield_stretch", "correction_limit", "mass", "helium"),
    *("damping", "keyframe_values", "gravity", "initial_gas_amounts", "initial_free_volumes", "gamma"),
    *("breathing_damping", "molar_mass", "drag_coefficient", "tube_conductance", "air_pressure", "air_temperature"),
    *("air_density", "wind", "sphere_mass", "sphere_radius", "sphere_penalty", "string_length", "string_stiffness"),
    *("string_anchor", "pair_frictions", "ground_restitution"),
)


def states_of_worlds(name: str, factors: np.ndarray, schedule: str, device: str) -> dict[str, np.ndarray]:
    """Return the state of a batch after three frames, each world with its parameters times a factor."""
    plan = plan_model(METHODS[name], len(factors))
    names = [each for each in PER_WORLD if each in plan.parameters]
    varied = {name: np.concatenate([factor * plan.parameters[name] for factor in factors]) for name in names}
    varied["ground_height"] = plan.parameters["ground_height"] + 0.02 * (factors - 1.0)
    model = lay_out(replace(plan, parameters=plan.parameters | varied), device)
    state = initial_state(model)
    advance = make_schedule(model, schedule)
    for _ in range(3):
        advance.advance_frame(state)
    return {field: array.numpy().copy() for field, array in state.arrays.items() if field != "frame"}


@pytest.mark.full
@pytest.mark.parametrize("name", ["paper", "gas", "more", "more by penalty, dry", "more corrected"])
def test_a_world_of_a_batch_is_to_the_last_bit_that_world_alone_and_again(name, schedule, device):
    """Worlds differ, and no eight divide their number. No factor is 1: a yield stretch that is as good as infinite
    would leave a law out of that world alone, and other kernels round differently on a GPU."""
    factors = np.linspace(0.9, 1.11, 11)
    batch, again = (states_of_worlds(name, factors, schedule, device) for _ in range(2))
    for field, values in batch.items():
        np.testing.assert_array_equal(again[field], values, err_msg=field)
    for world in (0, 3, 10):
        for field, of_one in states_of_worlds(name, factors[world : world + 1], schedule, device).items():
            np.testing.assert_array_equal(batch[field][world], of_one[0], err_msg=f"{field} of world {world}")
    assert (batch["points"][4] != batch["points"][0]).any()


def test_lanes_look_at_spheres_where_they_are_in_every_substep():
    """Kernels of eight lanes see where spheres and obstacles are before particles are expected there: not only in the
    first substep, in which cached normals are found."""
    lines = LanesSchedule.source_of(build_model(METHODS["more by penalty, dry"], "cpu")).splitlines()
    expected = next(number for number, line in enumerate(lines) if "predict_deflection_may_act" in line)
    loop = next(number for number, line in enumerate(lines) if "for substep in range" in line)
    assert "        show_solids(t, tables, state, solids, group, end)" in lines[loop:expected]


def bare(**fields) -> Scene:
    """Return a balloon and nothing else."""
    balloon = Balloon(mesh=quad_sphere(3), helium=12.0, inflation=Inflation(k_normal=0.2))
    return Scene(balloon=[balloon], normals="cached", substeps=33, **fields)


def test_auto_takes_a_schedule_and_says_which():
    assert Simulator(bare(), "cpu").schedule.name == "octets"
    assert Simulator(bare(), "cpu", 8).schedule.name == "lanes"


@pytest.mark.full
def test_a_world_too_large_for_a_block_is_refused_and_not_taken_by_auto(device):
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(43), mass=50.0)])
    with pytest.raises(InputError, match=r"^schedule block: a world of 11,096 particles is too large .* use gather$"):
        Simulator(scene, device, schedule="block")
    assert Simulator(scene, device).schedule.name == ("octets" if device == "cpu" else "gather")


TURNS = Obstacle(
    size=(4, 0.2, 4), position=(0, -0.1, 0), motion=[(0, (0, 0, 0), (0, 0, 0)), (1, (0, 1, 0), (0, 90, 0))]
)
SOFT = Balloon(mesh=quad_sphere(3), position=(0, 1.1, 0), inflation=Inflation(k_normal=[(0, 0.0), (1, 1.0)]))
SOLVED = Scene(balloon=[SOFT], obstacle=[TURNS], frames=4, substeps=67, solver="projective")
MANY, MORE = 501, 2003
"""Numbers of substeps of which none is a multiple of a turn, nor of the substeps between two searches"""


@pytest.mark.parametrize("interval", [0, 1, 5, TURN, TURN + 1, 2 * TURN - 1, 2 * TURN, 119, 600, 5000])
@pytest.mark.parametrize("count", [1, 65, 96, 590, 782])
def test_every_substep_runs_once_in_order_and_searches_when_it_should(count: int, interval: int):
    model: Any = SimpleNamespace(device=wp.get_device("cpu"), substeps=count, step_seconds=1.0e-4)
    clock, ran, launched = make_clock(model), [], 0
    a_frame = Rounds(model, interval, clock)

    def launch_substeps(numbers: range) -> None:
        nonlocal launched
        launched += 1
        for number in numbers:
            true = number + int(clock.done.numpy()[0])
            assert (number == 0) == (true == 0)
            if interval:
                assert (number % interval == 0) == (true % interval == 0)
            ran.append(true)

    for _ in range(2):
        a_frame.go_through(launch_substeps)
    assert ran == 2 * list(range(count))
    assert clock.done.numpy()[0] == 0
    assert a_frame.are_short == (count > frames.FLAT)


def of_rounds(substeps: int = MANY, name: str = "all") -> Scene:
    """Return a set; in that of all features a balloon inflates by a ramp, others touch and an obstacle moves."""
    return feature_set(name).model_copy(update={"frames": 2, "substeps": substeps})


def points_of(made: Scene, schedule: str, device: str = "cpu") -> np.ndarray:
    """Return the points at the end of all frames."""
    simulator = Simulator(made, device=device, schedule=schedule)
    return np.stack([stepped(simulator, 1).state.points.numpy().copy() for _ in range(made.frames)])


@pytest.mark.full
@pytest.mark.parametrize("schedule", ["gather", "octets", "scatter", "projective"])
def test_a_frame_of_rounds_is_to_the_bit_one_of_single_substeps(
    monkeypatch: pytest.MonkeyPatch, device: str, schedule: str
):
    if schedule in ("octets", "scatter") and device != "cpu":
        pytest.skip("octets are a CPU's, and a GPU's scatter adds forces in any order")
    made = SOLVED if schedule == "projective" else of_rounds()
    in_rounds = points_of(made, schedule, device)
    monkeypatch.setattr(frames, "FLAT", MORE)
    monkeypatch.setattr("balloon_warp.schedules.frames.FEW", 99)
    np.testing.assert_array_equal(in_rounds, points_of(made, schedule, device))


def test_what_is_recorded_does_not_grow_with_the_substeps(monkeypatch: pytest.MonkeyPatch):
    recorded, record = [0], APICapture.build_launch_info

    def counted(*given: Any, **named: Any) -> Any:
        recorded[-1] += 1
        return record(*given, **named)

    monkeypatch.setattr("balloon_warp.system.warp_threads._remembering", nullcontext)
    monkeypatch.setattr(APICapture, "build_launch_info", counted)
    for substeps in (MANY, MORE):
        recorded.append(0)
        points_of(of_rounds(substeps, "touch"), "octets")
    _, few, many = recorded
    assert 0 < many <= 1.2 * few, "what is left over of a turn, and between two searches, has fewer than a turn"
