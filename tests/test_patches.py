"""Worlds cut into patches, which blocks of a GPU advance at once: their tables lead to the model's entries, and
trajectories are those of launch after launch."""

import numpy as np
import pytest
import trimesh
import warp as wp
from meshes import mesh_of, quad_sphere

from balloon_warp.model import Model, State, build_model, initial_state
from balloon_warp.scene import Atmosphere, Balloon, Ground, Inflation, Scene, String
from balloon_warp.scene.load import load_scene
from balloon_warp.schedules import gather
from balloon_warp.schedules.choose import fastest_schedule, make_schedule
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.patches import cut_into_patches, worlds_at_once
from balloon_warp.schedules.patching import Patches, cut, patch_table, slots_in_patches, tables_in_patches
from balloon_warp.schedules.rings import quad_rings
from balloon_warp.schedules.spring_ends import spring_ends
from balloon_warp.schedules.tables import make_tables

ROUNDING = 2.0e-5
"""of its size: the same sums in another order, over a few frames"""
OF_PRESSURES = 0.5
"""[Pa]: five millionths of the air's; an excess is the difference of two such pressures, in float32"""


def triangle_sphere() -> trimesh.Trimesh:
    """Return an icosphere of 2,562 vertices."""
    return trimesh.creation.icosphere(subdivisions=4)


def with_mass(fields: dict) -> dict:
    """Return the fields of a balloon with a mass, unless its material determines that."""
    return fields if "material" in fields else {"mass": 3.0, **fields}


def of_triangles(**fields) -> Balloon:
    """Return a ball of triangles."""
    sphere = triangle_sphere()
    return Balloon(mesh=mesh_of(sphere.vertices, sphere.faces.tolist()), **with_mass(fields))


def of_quads(**fields) -> Balloon:
    """Return a ball of 1,178 particles."""
    return Balloon(mesh=quad_sphere(14), **with_mass(fields))


GAS = Inflation(kind="gas", start_pressure=50.0)
PRESSURE = Inflation(kind="pressure", pressure=30.0)
SCENES = {
    "cached normals": Scene(balloon=[of_quads(inflation=Inflation(k_normal=30.0))], normals="cached"),
    "fresh normals": Scene(balloon=[of_quads(inflation=Inflation(k_normal=30.0))], normals="fresh"),
    "pressure, triangles": Scene(balloon=[of_triangles(inflation=Inflation(kind="pressure", pressure=30.0))]),
    "gas, on the ground": Scene(balloon=[of_quads(position=(0, 1, 0), inflation=GAS)], ground=Ground()),
    "two balloons, two kinds": Scene(
        balloon=[of_quads(inflation=GAS), of_triangles(position=(3, 0, 0), inflation=Inflation(k_normal=30.0))],
        normals="cached",
        touch=False,
    ),
    "rubber": Scene(balloon=[of_quads(material={"preset": "latex"}, inflation=PRESSURE)]),
    "wind and strings": Scene(
        balloon=[of_triangles(inflation=GAS, drag_coefficient=0.4)],
        string=[String(anchor=(0, -2, 0))],
        atmosphere=Atmosphere(wind=(1, 0, 0), gusts=0.2),
    ),
    "forward Euler": Scene(balloon=[of_quads(inflation=GAS)], solver="forward_euler", substeps=21),
    "stiffness that varies": Scene(balloon=[of_quads(stiffness={"variation": 0.3})], normals="cached"),
}


@pytest.fixture(params=SCENES)
def scene(request: pytest.FixtureRequest) -> Scene:
    """Return each scene that is advanced in patches."""
    return SCENES[request.param]


def patches_on_cpu(model: Model) -> Patches:
    """Return patches as for a GPU with enough multiprocessors."""
    return cut(model, 256, model_features(model).gas)


def particles_at(patches: Patches, owners: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the particles at these places in the patches of the owners."""
    count = len(patches.patch)
    seats = zip(patches.patch.tolist(), patches.place.tolist(), strict=True)
    own = {seat: particle for particle, seat in enumerate(seats)}
    halos = patches.halo_keys % count
    found = []
    for owner, place in zip(owners.tolist(), places.tolist(), strict=True):
        patch = int(patches.patch[owner])
        in_halo = place >= patches.threads
        found.append(halos[patches.halo_offsets[patch] + place - patches.threads] if in_halo else own[patch, place])
    return np.array(found)


def test_each_particle_has_one_place(scene: Scene):
    model = build_model(scene, "cpu")
    patches = patches_on_cpu(model)
    assert len(set(zip(patches.patch.tolist(), patches.place.tolist(), strict=True))) == model.particle_count
    sizes = np.bincount(patches.patch)
    assert sizes.max() <= patches.threads
    assert sizes.max() - sizes.min() <= 0.3 * patches.threads
    balloon = model.particle_balloon.numpy()
    assert (patches.balloons[patches.patch] == balloon).all()


def test_patches_are_compact():
    """Patches are compact: a halo of two rings around a square of 256 has about 144 particles, not a strip's."""
    patches = patches_on_cpu(build_model(Scene(balloon=[Balloon(mesh=quad_sphere(40), mass=3.0)]), "cpu"))
    assert patches.largest_halo < 220


def test_springs_lead_where_they_did(scene: Scene):
    model = build_model(scene, "cpu")
    patches, ends = patches_on_cpu(model), spring_ends(model)
    ring = quad_rings(model)
    slots = slots_in_patches(model, patches, ring)
    neighbors, lengths, scales = (each.numpy() for each in (slots.neighbors, slots.rest_lengths, slots.scales))
    particle = np.broadcast_to(np.arange(model.particle_count), neighbors.shape)
    there = scales > 0.0
    led_to = particles_at(patches, particle[there], neighbors[there])
    found = sorted(zip(particle[there].tolist(), led_to.tolist(), lengths[there].tolist(), strict=True))
    expected = (ends.particle.tolist(), ends.neighbor.tolist(), ends.rest_length.astype(np.float32).tolist())
    assert found == sorted(zip(*expected, strict=True))
    idle = particles_at(patches, particle[~there], neighbors[~there])
    np.testing.assert_array_equal(idle, particle[~there])


def test_faces_and_membranes_lead_where_they_did(scene: Scene):
    model = build_model(scene, "cpu")
    patches, tables = patches_on_cpu(model), make_tables(model, model_features(model))
    led = tables_in_patches(model, patches, tables)
    for found, expected in (
        (led.fans.quads, tables.fans.quads),
        (led.fans.particles, tables.fans.particles),
        (led.membranes.others, tables.membranes.others),
    ):
        if expected is not None:
            assert_led(patches, model, found.numpy(), expected.numpy())


def assert_led(patches: Patches, model: Model, found: np.ndarray, expected: np.ndarray) -> None:
    """Require that each entry belongs to a particle whose patch has the named one at the place it leads to."""
    halos = np.split(patches.halo_keys % model.particle_count, patches.halo_offsets[1:-1])
    tiles = []
    for patch, halo in enumerate(halos):
        inside = np.flatnonzero(patches.patch == patch)
        tiles.append({**dict(zip(patches.place[inside].tolist(), inside.tolist(), strict=True))})
        tiles[-1] |= {patches.threads + place: particle for place, particle in enumerate(halo.tolist())}
    rows = zip(found.reshape(len(found), -1).tolist(), expected.reshape(len(expected), -1).tolist(), strict=True)
    for places, particles in rows:
        assert any([tile.get(place) for place in places] == particles for tile in tiles)


def test_what_patches_are_told_of_is_told(scene: Scene):
    """Halo particles are marked, and halos are mutual, or one patch would run ahead of the other."""
    model = build_model(scene, "cpu")
    patches = cut(model, 256, volumes=False)
    table = patch_table(model, patches, measures_faces=False)
    halos = table.halos.numpy()
    assert set(halos[halos >= 0].tolist()) == set(np.flatnonzero(table.in_halos.numpy()).tolist())
    pairs = {(patch, int(patches.patch[particle])) for patch, row in enumerate(halos) for particle in row[row >= 0]}
    assert pairs == {(other, patch) for patch, other in pairs}
    assert all(patch != other for patch, other in pairs)


def test_a_cpu_has_no_patches(scene: Scene):
    model = build_model(scene, "cpu")
    assert cut_into_patches(model, model_features(model)) is None


def frames_of(model: Model, count: int) -> State:
    """Advance so many frames in `gather` and return the state."""
    schedule, state = make_schedule(model, "gather"), initial_state(model)
    for _ in range(count):
        schedule.advance_frame(state)
    return state


def assert_moves_as_in_launches(model: Model, frames: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Require that patches agree with launch after launch, and repeat bit-identically."""
    assert cut_into_patches(model, model_features(model))
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
def test_so_are_those_of_patches_on_nearly_all_multiprocessors_of_a_gpu(
    name: str, gpu: wp.Device, monkeypatch: pytest.MonkeyPatch
):
    """Trajectories agree where patches exchange sums with more others than a warp has threads."""
    inflation = Inflation(kind="gas", start_pressure=5.0e3) if name == "gas" else Inflation(k_normal=20.0)
    balloon = Balloon(mesh=quad_sphere(129), mass=60.0, inflation=inflation)
    normals = "fresh" if name == "fresh normals" else "cached"
    model = build_model(Scene(balloon=[balloon], normals=normals, substeps=40), gpu)
    patches = cut_into_patches(model, model_features(model))
    assert patches
    assert patches.count > 0.9 * gpu.sm_count
    assert_moves_as_in_launches(model, 3, monkeypatch)


@pytest.mark.parametrize("name", ["fresh normals", "gas, on the ground"])
def test_more_worlds_than_a_gpu_moves_at_once_are_each_as_alone(name: str, gpu: wp.Device):
    alone = build_model(SCENES[name], gpu)
    patches = cut_into_patches(alone, model_features(alone))
    assert patches
    many = build_model(SCENES[name], gpu, 2 * gpu.sm_count)
    assert worlds_at_once(many, model_features(many), patches) < many.world_count
    expected, found = frames_of(alone, 2).points.numpy()[0], frames_of(many, 2).points.numpy()
    assert (found == expected).all()


def test_auto_takes_patches_for_few_large_worlds_on_a_gpu(gpu: wp.Device):
    model = build_model(load_scene("squirrel_inflate"), gpu)
    assert fastest_schedule(model, 1) == "gather"
    assert fastest_schedule(model, 4096) == "block"
