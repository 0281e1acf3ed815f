"""Stable step: the highest frequency of a network, advice; equilibria and their stiffness; air by its altitude."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sparse
import warp as wp
from batches import stop_after
from conserved import put
from gas_balloons import gas_balloon
from meshes import cube, grid, halved, klein, moebius, quad_sphere, torus
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

import balloon_warp as bw
from balloon_warp import Balloon, InputError, PolygonMesh, Scene, Simulator, String, advise_step, animate, build_springs
from balloon_warp.batch.recorder import units_of
from balloon_warp.frame import ForceReader
from balloon_warp.lab.statics import Balance, SealedGas, Volume, film_of, solver_of, springs_of
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model import Model, build_model, initial_state, plan_model
from balloon_warp.model.spectrum import FEW, MARGIN, highest_squared_frequency
from balloon_warp.model.stability import Network
from balloon_warp.scene import Atmosphere, Inflation, Material, Stiffness, load_scene
from balloon_warp.scene.fields import standard_air
from balloon_warp.scene.load import override_scene, scene_toml, write_scene

MESHES = {"sphere": quad_sphere(9), "cube": cube(), "sheet": grid(12, 12), "fine": quad_sphere(16)}


def whole_matrix(
    pairs: NDArray[np.integer], constants: NDArray[np.float64], held: NDArray[np.float64], masses: NDArray[np.float64]
) -> csr_array:
    """Return M^-1/2 K M^-1/2, with zeros for particles that do not move."""
    roots = np.where(masses > 0.0, np.maximum(masses, 1e-300) ** -0.5, 0.0)
    (first, second), count = pairs.T, len(masses)
    diagonal = held + np.bincount(first, constants, count) + np.bincount(second, constants, count)
    rows, columns = np.concatenate([first, second, range(count)]), np.concatenate([second, first, range(count)])
    values = np.concatenate([-constants, -constants, diagonal]) * roots[rows] * roots[columns]
    return coo_array((values, (rows, columns))).tocsr()


@pytest.mark.full
@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
@pytest.mark.parametrize("seed", range(3))
def test_it_is_that_of_the_whole_matrix_and_never_below_it(mesh: PolygonMesh, seed: int):
    """The frequency of random springs and masses is exact for few particles, else within the margin."""
    random, pairs = np.random.default_rng(seed), build_springs(mesh).pairs
    constants, held = random.uniform(0.1, 10.0, len(pairs)), random.uniform(0.0, 5.0, mesh.vertex_count)
    masses = random.uniform(0.5, 2.0, mesh.vertex_count) * (random.uniform(size=mesh.vertex_count) > 0.1)
    expected = np.linalg.eigvalsh(whole_matrix(pairs, constants, held, masses).toarray()).max()
    found = highest_squared_frequency(pairs, constants, held, masses)
    if np.count_nonzero(masses) <= FEW:
        assert found == pytest.approx(expected, rel=1e-12)
    else:
        assert expected <= found <= 1.0001 * MARGIN * expected


@pytest.mark.parametrize(("masses", "expected"), [((1.0, 3.0), 6.0 * (1.0 + 1.0 / 3.0)), ((0.0, 0.0), 0.0)])
def test_of_a_spring_between_two_masses_it_is_that_of_the_textbook(masses: tuple[float, float], expected: float):
    """The squared frequency is k (1/m + 1/M), and that of fixed particles is zero."""
    found = highest_squared_frequency(np.array([[0, 1]]), np.array([6.0]), np.zeros(2), np.array(masses))
    assert found == pytest.approx(expected)


BALLS = {"quads": quad_sphere(6, 0.1), "triangles": halved(quad_sphere(6, 0.1))}
STIFFEST = {
    "neo_hookean": (Material(kind="neo_hookean"), 1.02),
    "latex": (Material(preset="latex"), 6.0),
    "natural rubber": (Material(preset="natural_rubber_treloar"), 6.0),
    "gent": (Material(kind="gent"), 6.79),
    "squeezed": (Material(kind="neo_hookean", wrinkling=False), 0.81),
}
"""materials, and a stretch at which each is about as stiff as it is counted"""


def scene_of(mesh: PolygonMesh, material: Material, **fields: Any) -> Scene:
    still = Inflation(kind="pressure", pressure=0.0)
    balloon = Balloon(mesh=mesh, material=material, inflation=still, damping=0.0)
    return Scene(balloon=[balloon], gravity=0.0, atmosphere=Atmosphere(density=0.0), **fields)


def stable_step(scene: Scene) -> float:
    plan = plan_model(scene)
    return Network(plan.shapes, plan.held, plan.laws).stable_step(plan.scene, plan.parameters)


def longest_step(model: Model, stretch: float) -> float:
    """Return 2 / omega of the evenly stretched ball, omega^2 the largest eigenvalue of the forces' derivative over the
    masses, by power iteration of differences: from below, by some percent."""
    reader, state = ForceReader(model), initial_state(model)
    points = state.points.numpy()[0].astype(np.float64) * stretch
    roots = np.sqrt(model.parameters["mass"].numpy()[0, 0] * model.shapes[0].mass_share)[:, None]

    def forces(places: np.ndarray) -> np.ndarray:
        wp.copy(state.points, wp.array(places[None], dtype=wp.vec3, device="cpu"))
        reader.refresh(state)
        return reader.net_forces(state).numpy()[0].astype(np.float64)

    way, squared = np.random.default_rng(0).normal(size=points.shape), 0.0
    for _ in range(150):
        aside = way / roots
        aside *= 1e-4 * stretch / np.sqrt((aside**2).sum(axis=1).mean())
        slope = -(forces(points + aside) - forces(points - aside)) / (2.0 * roots)
        way = aside * roots
        squared = float((way * slope).sum() / (way**2).sum())
        way = slope
    return 2.0 / np.sqrt(squared)


@pytest.mark.full
@pytest.mark.parametrize("mesh", BALLS)
@pytest.mark.parametrize("name", STIFFEST)
def test_the_step_is_what_the_stiffest_state_allows(name: str, mesh: str):
    material, stretch = STIFFEST[name]
    scene = scene_of(BALLS[mesh], material)
    step, found = stable_step(scene), longest_step(build_model(scene, "cpu"), stretch)
    assert 1.0 <= found / step < 1.6


def test_film_that_never_leaves_the_verge_of_wrinkling_gets_a_shorter_step():
    """The step of film on the verge of wrinkling is shorter by 1 / sqrt(1.78), so that 0.8 of it is 1.2 / omega; that
    of rubber and of film that does not wrinkle is not."""

    def step(**fields: Any) -> float:
        return stable_step(scene_of(BALLS["triangles"], Material(kind="neo_hookean", **fields)))

    assert step(most_stretch=1.1) == pytest.approx(step(most_stretch=6.0) / np.sqrt(1.78), rel=1e-3)
    assert step(most_stretch=1.1, wrinkling=False) == pytest.approx(step(most_stretch=1.6, wrinkling=False), rel=1e-3)


def fastest(scene: Scene, substeps: int, device: str) -> float:
    """Return the highest speed in ten frames of a ball that starts with random velocities of 0.1 m/s."""
    simulator = Simulator(scene.model_copy(update={"substeps": substeps}), device)
    points = simulator.state.points.numpy()[0]
    put(simulator, 1.01 * points, np.random.default_rng(1).normal(scale=0.1, size=points.shape))
    highest = 0.0
    for _ in range(10):
        simulator.step()
        highest = max(highest, float(np.abs(simulator.state.velocities.numpy()).max()))
    return highest


def test_the_step_allows_for_viscosity(device: str):
    elastic, viscous = Material(kind="neo_hookean"), Material(kind="neo_hookean", viscosity=100.0)
    steps = [stable_step(scene_of(BALLS["quads"], material)) for material in (elastic, viscous)]
    assert steps[1] < 0.2 * steps[0]
    scene = scene_of(BALLS["quads"], viscous)
    assert fastest(scene, int(np.ceil(1.0 / 60.0 / steps[1])), device) < 1.0


def test_worlds_take_the_step_of_the_stiffest(device: str):
    scene = scene_of(BALLS["quads"], Material(kind="neo_hookean"))
    soft, stiff = (plan_model(scene, 2, {"balloon.material.shear_modulus": [3.3e5, mu]}) for mu in (3.3e5, 13.2e5))
    assert stiff.substeps == pytest.approx(2 * soft.substeps, abs=2)
    thick = plan_model(scene, 2, {"balloon.material.thickness": [2e-4, 8e-4]})
    assert thick.substeps == soft.substeps  # heavier as much as stiffer


EGG = replace(quad_sphere(3), points=0.2 * quad_sphere(3).points * [1.0, 0.8, 1.3])
MATERIALS = {
    "springs": bw.Material(),
    "latex": bw.Material(preset="latex"),
    "gent": bw.Material(kind="gent", gent_limit=30.0),
    "without wrinkles": bw.Material(preset="latex", wrinkling=False),
}
KINDS = ("structural", "shear", "flexion")


def gas_scene(mesh, material: bw.Material = MATERIALS["springs"], **of_balloon) -> bw.Scene:
    inflation = bw.Inflation(moles=1.0, fill_time=0.1, added_mass=0.0, molar_mass=0.0)
    balloon = bw.Balloon(mesh=mesh, damping=2.0, material=material, inflation=inflation, parts="free", **of_balloon)
    return bw.Scene(balloon=[balloon], gravity=0.0)


def balance_of(simulator: bw.Simulator) -> Balance:
    """Return the equilibrium problem of a simulator's balloon, on the host."""
    model, frame = simulator.model, simulator.read_frame()
    shape, rows = model.shapes[0], {name: values.numpy() for name, values in model.parameters.items()}
    constants = np.array([float(rows[kind][0, 0]) for kind in KINDS])
    skin = film_of(model.scene, 0, shape, rows) if shape.membrane.count else springs_of(shape, constants)
    return Balance(skin, Volume(shape.mesh), SealedGas(float(frame.gas_amounts[0]), 293.15, 101325.0))


@pytest.mark.full
@pytest.mark.parametrize("name", MATERIALS)
def test_statics_are_those_of_what_is_simulated(name: str):
    simulator = bw.Simulator(gas_scene(EGG, MATERIALS[name]), "cpu")
    points = simulator.relax(1.0e-4).points[0].astype(float)
    balance, way = balance_of(simulator), np.random.default_rng(0).standard_normal(EGG.points.shape)
    assert balance.left_over(points) < 2.0e-3
    felt = (balance.forces(points + 1e-7 * way) - balance.forces(points - 1e-7 * way)) / 2e-7
    told = (simulator.stiffness() @ way.ravel()).reshape(-1, 3)
    assert np.linalg.norm(felt + told) < 2e-4 * np.linalg.norm(told)  # the pressure was read in float32
    settled = balance.settle(EGG.points * 1.2)
    assert settled is not None
    assert np.linalg.norm(settled - settled.mean(0) - points + points.mean(0), axis=1).max() < 1e-3


def test_a_singular_matrix_is_solved_where_it_has_stiffness():
    """Coarse meshes may have displacements that nothing resists."""
    matrix = sparse.diags([2.0, 0.0, 4.0], format="csc")
    np.testing.assert_allclose(solver_of(matrix)(np.array([2.0, 0.0, 4.0])), [1.0, 0.0, 1.0], rtol=1e-9)


def test_what_still_moves_is_not_called_at_rest():
    simulator = bw.Simulator(gas_scene(EGG), "cpu")
    with pytest.raises(InputError, match=r"fastest particle still moves at .* after 0.05 s"):
        simulator.relax(1.0e-6, most_seconds=0.05)
    with pytest.raises(InputError, match="speed: must be above 0"):
        simulator.relax(0.0)


def write_springs(path: Path, **changed) -> Path:
    springs = bw.build_springs(EGG)
    table = {"pairs": springs.pairs, "rest_lengths": springs.rest_lengths, "constants": np.full(springs.count, 30.0)}
    np.savez(path, **(table | changed))
    return path


def test_springs_of_a_file_are_those_that_act(tmp_path: Path):
    springs = bw.build_springs(EGG)
    order = np.random.default_rng(1).permutation(springs.count)
    lengths, constants = 0.5 * springs.rest_lengths, 10.0 + np.arange(springs.count) % 7
    table = {"pairs": springs.pairs[:, ::-1], "rest_lengths": lengths, "constants": constants}
    file = write_springs(tmp_path / "springs.npz", **{name: each[order] for name, each in table.items()})
    scene = bw.load_scene(gas_scene(EGG, springs=file), {"balloon.scale": 2.0})
    shape = bw.Simulator(scene, "cpu").model.shapes[0]
    assert (shape.springs.pairs == springs.pairs).all()
    np.testing.assert_allclose(shape.springs.rest_lengths, 2.0 * lengths)
    of_kind = np.array([20.0, 10.0, 2.0])[shape.springs.kind]
    np.testing.assert_allclose(shape.stiffness_scale * of_kind, constants)
    write_obj(tmp_path / "egg.obj", EGG)
    (tmp_path / "out").mkdir()
    saved = bw.load_scene(scene, {"balloon.mesh": str(tmp_path / "egg.obj")})
    write_scene(saved, tmp_path / "out" / "scene.toml")
    assert 'springs = "../springs.npz"' in (tmp_path / "out" / "scene.toml").read_text()
    read = bw.load_scene(tmp_path / "out" / "scene.toml").balloon[0].springs
    assert read
    assert read.resolve() == file.resolve()


def refused(sentence: str, material: bw.Material = MATERIALS["springs"], **of_balloon) -> None:
    with pytest.raises(InputError, match=sentence):
        bw.Simulator(gas_scene(EGG, material, **of_balloon), "cpu")


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"pairs": [[0, 1]]}, "expected pairs of shape"),
        ({"pairs": "none"}, "expected a .npz file with pairs"),
        ({"constants": -1.0}, "constants: expected numbers of at least 0"),
    ],
)
def test_a_file_that_says_no_springs_is_refused(changed: dict, sentence: str, tmp_path: Path):
    count = bw.build_springs(EGG).count
    table = {name: np.full(count, value) if isinstance(value, float) else value for name, value in changed.items()}
    refused(sentence, springs=write_springs(tmp_path / "springs.npz", **table))
    refused(r"none.npz: no such file", springs=tmp_path / "none.npz")
    springs = write_springs(tmp_path / "springs.npz")
    refused(r'needs material.kind = "springs" \(got "mooney_rivlin"\)', MATERIALS["latex"], springs=springs)


@pytest.mark.parametrize("material", [bw.Material(), bw.Material(preset="latex")])
def test_nothing_pulls_in_the_rest_shape(material: bw.Material, tmp_path: Path):
    """A balloon larger than its mould shrinks to it; a film, which nothing else spreads, under a slight pressure."""
    write_obj(tmp_path / "mould.obj", EGG)
    larger = replace(EGG, points=1.1 * EGG.points)
    there = bw.Material(**{"rest_mesh": tmp_path / "mould.obj", **material.model_dump(exclude_unset=True)})
    slight = bw.Inflation(pressure=20.0 * material.is_membrane)
    balloon = bw.Balloon(mesh=larger, material=there, damping=0.5, inflation=slight)
    simulator = bw.Simulator(bw.Scene(balloon=[balloon], gravity=0.0), "cpu")
    points = simulator.relax(1e-4).points[0]
    edges = bw.build_springs(EGG)
    now = np.linalg.norm(points[edges.pairs[:, 1]] - points[edges.pairs[:, 0]], axis=1)
    np.testing.assert_allclose(now, edges.rest_lengths, rtol=5e-2)


def cut_egg() -> PolygonMesh:
    """Return the faces of the egg, each with corners of its own, lying beside each other."""
    quads = EGG.points[EGG.face_vertex_indices].reshape(-1, 4, 3)
    aside = quads + 0.3 * np.arange(len(quads))[:, None, None]
    indices = np.arange(4 * len(quads), dtype=np.int32)
    return PolygonMesh(aside.reshape(-1, 3), EGG.face_vertex_counts, indices, "panels")


def test_panels_that_are_sewn_are_what_they_were_before(tmp_path: Path):
    write_obj(tmp_path / "panels.obj", cut_egg())
    cut = bw.Simulator(gas_scene(EGG, bw.Material(preset="latex", rest_mesh=tmp_path / "panels.obj")), "cpu")
    whole = bw.Simulator(gas_scene(EGG, MATERIALS["latex"]), "cpu")
    ours, theirs = cut.model.shapes[0], whole.model.shapes[0]
    assert (ours.membrane.corners == theirs.membrane.corners).all()
    np.testing.assert_allclose(ours.membrane.rests, theirs.membrane.rests, rtol=1e-5)
    np.testing.assert_allclose(ours.mass_share, theirs.mass_share, rtol=1e-5)
    assert cut.model.substeps == whole.model.substeps


def test_a_rest_shape_of_other_vertices_or_faces_is_refused(tmp_path: Path):
    cut = cut_egg()
    sewn_wrong = replace(cut, face_vertex_indices=np.r_[0, 0, cut.face_vertex_indices[2:]].astype(np.int32))
    for mesh, sentence in (
        (replace(cut, face_vertex_counts=cut.face_vertex_counts[1:], face_vertex_indices=cut.face_vertex_indices[4:]),
         r"53 faces; expected the 56 of .*, or panels: its 54 faces, in its order"),
        (sewn_wrong, "vertex 1 of .*, counted from 1, would be sewn to several"),
    ):  # fmt: skip
        write_obj(tmp_path / "panels.obj", mesh)
        refused(sentence, bw.Material(preset="latex", rest_mesh=tmp_path / "panels.obj"))
    refused("has 216 vertices; expected the 56 of", bw.Material(rest_mesh=tmp_path / "panels.obj"))
    write_obj(tmp_path / "other.obj", quad_sphere(4))
    of_other = r"material.rest_mesh: .*other.obj has 98 vertices; expected the 56"
    refused(of_other, bw.Material(rest_mesh=tmp_path / "other.obj"))


def test_thicker_rubber_pulls_as_its_derivatives_say():
    scene = gas_scene(EGG, MATERIALS["latex"])
    simulator = bw.Simulator(scene, "cpu")
    rows = {name: values.numpy() for name, values in simulator.model.parameters.items()}
    film, points = film_of(scene, 0, simulator.model.shapes[0], rows), 1.3 * EGG.points * [1.0, 0.7, 1.1]
    way = np.random.default_rng(3).uniform(-0.5, 0.5, EGG.vertex_count)
    felt = film.with_weights(1.0 + way).forces(points) - film.with_weights(1.0 - way).forces(points)
    told = 2.0 * film.forces_by_weights(points) @ way
    np.testing.assert_allclose(told, felt.ravel(), atol=1e-12 * np.abs(felt).max() + 1e-15)


def stiffest_particle(mesh: PolygonMesh, stiffness: Stiffness) -> int:
    """Return the stiffest particle by the definition: springs' constants summed at each particle, all of one mass."""
    springs = build_springs(mesh)
    constants = np.array([stiffness.structural, stiffness.shear, stiffness.flexion])[springs.kind]
    return int(np.argmax(np.bincount(springs.pairs.ravel(), np.repeat(constants, 2))))


def test_advice_names_the_particle_that_limits_the_step_and_the_least_substeps():
    soft, stiff, ring = Stiffness(structural=10.0), Stiffness(structural=200.0, shear=50.0), torus(7, 5)
    balloons = [Balloon(mesh=quad_sphere(5), stiffness=soft), Balloon(mesh=ring, stiffness=stiff, name="ring")]
    scene = Scene(balloon=balloons, substeps=1, touch=False)
    advice = advise_step(scene)
    assert (advice.limiting_balloon, advice.limiting_particle) == ("ring", stiffest_particle(ring, stiff))
    soft_step, stiff_step = (advise_step(Scene(balloon=[balloon])).stable_step for balloon in balloons)
    assert advice.stable_step == stiff_step < 0.9 * soft_step
    least = advice.least_substeps
    assert plan_model(scene.model_copy(update={"substeps": least})).substeps == least < advice.substeps
    with pytest.raises(InputError, match=f"at least {least} are needed"):
        plan_model(scene.model_copy(update={"substeps": least - 1}))


def test_advice_knows_strings_and_passes_over_particles_that_do_not_move():
    mesh = quad_sphere(4)
    scene = Scene(balloon=[Balloon(mesh=mesh)], string=[String(anchor=(0, -2, 0), particle=9, stiffness=1e3)])
    assert advise_step(scene).limiting_particle == 9
    rest = [particle for particle in range(mesh.vertex_count) if particle != 5]
    held = Scene(balloon=[Balloon(mesh=mesh, fixed=rest)])
    assert advise_step(held).limiting_particle == 5
    assert advise_step(Scene(balloon=[Balloon(mesh=mesh, fixed=[*rest, 5])])).substeps == 1


@pytest.mark.full
def test_strings_that_start_overstretched_are_named_with_how_much():
    """A slack string, or one tied later, is not named."""
    ends = [String(anchor=(0, -2, 0), length=length, particle=0) for length in (3.0, 1.0, None)]
    strings = [*ends, ends[1].model_copy(update={"start": 1.0})]
    mesh = quad_sphere(2)
    mesh.points[0] = (0.0, -0.5, 0.0)
    scene = Scene(balloon=[Balloon(mesh=mesh)], string=strings)
    sentence = "string 1 starts overstretched by {}%{}: it is 1 m long, and its ends are {} m apart"
    assert plan_model(scene).warnings == [sentence.format(50, "", 1.5)]
    varied = plan_model(scene, 3, {"string.1.anchor.1": np.array([-1.2, -1.75, -1.7])})
    assert varied.warnings == [sentence.format(25, " in world 1", 1.25)]
    warnings: list[str] = []
    with pytest.raises(RuntimeError, match="stopped"):
        animate(scene, "never.usda", device="cpu", on_warning=warnings.append, on_frame=stop_after(0))
    assert warnings == plan_model(scene).warnings


TABLE = {
    -1000.0: (294.651, 1.1393e5, 1.3470),
    0.0: (288.150, 1.01325e5, 1.2250),
    10000.0: (223.252, 2.6499e4, 4.1351e-1),
    20000.0: (216.650, 5.5293e3, 8.8910e-2),
    40000.0: (250.350, 2.8714e2, 3.9957e-3),
    50000.0: (270.650, 7.9779e1, 1.0269e-3),
    70000.0: (219.585, 5.2209, 8.2829e-5),
}
"""Temperature [K], pressure [Pa] and density [kg/m^3] by altitude, from table I of the U.S. Standard Atmosphere 1976"""


def parameters(scene: Scene, worlds: int = 1, vary: dict[str, Any] | None = None) -> dict[str, list[float]]:
    plan = plan_model(scene, worlds, vary or {})
    names = ("air_pressure", "air_temperature", "air_density", "air_lapse")
    return {name: np.ravel(plan.parameters[name]).tolist() for name in names}


@pytest.mark.parametrize("altitude", list(TABLE))
def test_it_is_the_standards_table(altitude: float):
    temperature, pressure, density = TABLE[altitude]
    air = standard_air(altitude)
    assert air["temperature"] == pytest.approx(temperature, abs=6e-4)
    assert air["pressure"] == pytest.approx(pressure, rel=4e-5)
    assert 0.0289644 * air["pressure"] / (8.31432 * air["temperature"]) == pytest.approx(density, rel=4e-5)


@pytest.mark.parametrize("altitude", [2000.0, 15000.0, 25000.0, 40000.0, 60000.0, 75000.0])
def test_its_lapse_is_the_slope_of_its_temperature(altitude: float):
    low, high = (standard_air(altitude + step)["temperature"] for step in (-1.0, 1.0))
    assert standard_air(altitude)["lapse"] == pytest.approx(0.5 * (low - high), abs=1e-9)


def test_gas_begins_at_the_pressure_of_the_air_that_thins_out():
    """p = p_0 (1 - L h / T_0)^(rho_0 g T_0 / (p_0 L)), T = T_0 - L h: a sealed gas begins as p V / (R T)."""
    air, height = {"pressure": 101325.0, "temperature": 288.15, "density": 1.225, "lapse": 0.0065}, 3000.0
    ball = Balloon(mesh=quad_sphere(3, 0.5), position=(0.0, height, 0.0), inflation=Inflation(kind="gas"))
    plan = plan_model(Scene(balloon=[ball], atmosphere=Atmosphere(**air)))
    temperature = air["temperature"] - air["lapse"] * height
    power = air["density"] * 9.81 * air["temperature"] / (air["pressure"] * air["lapse"])
    pressure = air["pressure"] * (temperature / air["temperature"]) ** power
    amount = pressure * signed_volume(plan.shapes[0].mesh) / (8.31446 * temperature)
    assert plan.parameters["initial_gas_amounts"][0, 0] == pytest.approx(amount, rel=1e-4)


def test_a_scene_at_an_altitude_has_its_air():
    scene = Scene(balloon=[Balloon(mesh=cube())], atmosphere=Atmosphere(altitude=30000.0))
    air = standard_air(30000.0)
    assert {name: getattr(scene.atmosphere, name) for name in air} == air
    assert air["lapse"] < 0.0  # warmer above
    found = parameters(scene)
    assert found["air_pressure"] == [air["pressure"]]
    assert found["air_lapse"] == [air["lapse"]]
    given = Atmosphere(altitude=30000.0, temperature=240.0, lapse=None)
    assert (given.pressure, given.temperature, given.lapse) == (air["pressure"], 240.0, None)


def test_what_follows_from_the_altitude_follows_anew_and_what_is_given_stays(tmp_path: Path):
    scene = Scene(balloon=[Balloon(mesh=cube())], atmosphere=Atmosphere(altitude=30000.0, temperature=240.0))
    for raised in (
        override_scene(scene, [("atmosphere.altitude", 20000.0)]),
        override_scene(override_scene(scene, [("gravity", 9.7)]), [("atmosphere.altitude", 20000.0)]),
    ):
        air = raised.atmosphere
        assert (air.pressure, air.temperature) == (standard_air(20000.0)["pressure"], 240.0)
    assert override_scene(scene, [("atmosphere.pressure", 5.0)]).atmosphere.pressure == 5.0
    (tmp_path / "it.toml").write_text(scene_toml(load_scene("helium_rise", {"atmosphere.altitude": 3e4}), tmp_path))
    text = (tmp_path / "it.toml").read_text()
    assert "altitude = 30000.0" in text
    assert "pressure = 11" not in text
    assert load_scene(tmp_path / "it.toml", {"atmosphere.altitude": 0.0}).atmosphere.pressure == 101325.0
    assert Atmosphere(**scene.atmosphere.model_dump()) == scene.atmosphere


def test_altitudes_may_differ_between_worlds():
    altitudes = [0.0, 11000.0, 30000.0]
    scene = Scene(balloon=[Balloon(mesh=cube())], atmosphere=Atmosphere(temperature=250.0))
    found = parameters(scene, 3, {"atmosphere.altitude": altitudes})
    airs = [standard_air(altitude) for altitude in altitudes]
    assert found["air_pressure"] == [air["pressure"] for air in airs]
    assert found["air_lapse"] == [air["lapse"] for air in airs]
    assert set(found["air_temperature"]) == {250.0}  # is given
    assert units_of(scene, ["atmosphere.altitude"], ()) == {"atmosphere.altitude": "m"}


@pytest.mark.parametrize(
    ("mesh", "complaint"),
    [
        (grid(2, 2), "an open mesh cannot hold gas"),
        (moebius(8), "an open mesh cannot hold gas"),
        (replace(cube(), points=cube().points * [1.0, 1.0, 0.0]), "encloses no volume at the start"),
        (klein(5, 5), "not orientable cannot hold gas; the first edge of opposite winding goes from "),
    ],
    ids=["open", "moebius", "flat", "klein"],
)
def test_a_mesh_that_cannot_hold_gas_is_refused(mesh: PolygonMesh, complaint: str):
    with pytest.raises(InputError, match=complaint):
        Simulator(Scene(balloon=[gas_balloon(mesh)]), "cpu")


SCENES = {
    "two": Scene(balloon=[gas_balloon(cube())] * 2, tube=[{"balloons": (0, 1), "conductance": 1.0}]),
    "neck": Scene(balloon=[gas_balloon(quad_sphere(4, 0.17), {"molar_mass": 0.029}, neck={"opens": 1.0})]),
    "wind": Scene(balloon=[Balloon(mesh=cube(), inflation=Inflation(pressure=0))], atmosphere=Atmosphere()),
}
GAS, ONE = "balloon.0.inflation", "; expected only one of them"


@pytest.mark.parametrize(
    ("name", "overrides", "complaint"),
    [
        ("two", {f"{GAS}.k_normal": 3.0}, 'inflation.k_normal: needs kind = "normal_force" (got kind = "gas"'),
        ("two", {"balloon.0.helium": 3.0}, "balloon.0.helium: must be 0, since its gas lifts it (got 3"),
        ("two", {"tube.0.balloons": [0, 0]}, "tube.0.balloons: must be two balloons below the number of balloons, 2"),
        ("two", {"balloon.1.inflation": {}}, 'tube.0.balloons: both must have inflation.kind = "gas"'),
        ("two", {"balloon.1.inflation.gamma": 1.4}, "both must have the same gamma and molar_mass"),
        ("two", {"atmosphere.altitude": 80001.0}, "atmosphere.altitude: must be less than or equal to 80000"),
        ("two", {f"{GAS}.breaths": 1.0, f"{GAS}.litres": 2.0}, f"litres: gives the same quantity as breaths{ONE}"),
        ("two", {f"{GAS}.pump": 0.1, f"{GAS}.breaths": 2.0}, f"breaths: gives the same quantity as pump{ONE}"),
        ("two", {f"{GAS}.pump_curve": [(5.0, 1.0), (5.0, 0.0)]}, "pump_curve: pressures must increase (got [5.0, 5.0]"),
        ("two", {f"{GAS}.kind": "pressure", f"{GAS}.litres": 1.0}, 'litres: needs kind = "gas" (got kind = "pressure"'),
        ("neck", {"balloon.0.neck.at": 500}, "neck.at: mesh has particles 0 to 97 (got 500"),
        ("neck", {"balloon.0.neck.at": "spout"}, "neck.at: mesh has no group spout; it has none"),
        ("neck", {"balloon.0.neck.diameter": 1.0}, "balloon.0.neck.diameter: must be at most 0.3"),
        ("neck", {"balloon.0.neck.closes": 0.5}, "closes: must not come before it opens, at 1 s (got 0.5 s"),
        ("neck", {f"{GAS}.leak": 1.0}, "balloon.0.inflation.leak: must be at most"),
        ("neck", {f"{GAS}.molar_mass": 0.0}, "molar_mass: must be above 0 where gas leaves"),
        ("neck", {f"{GAS}.kind": "pressure"}, 'neck: needs inflation.kind = "gas" (got "pressure"'),
        (
            "wind",
            {"atmosphere.roughness": 0.1, "atmosphere.shear": 0.2},
            "roughness: gives another wind profile than shear",
        ),
        ("wind", {"atmosphere.roughness": 10.0}, "roughness: must be less than wind_height, 10 m (got 10)"),
    ],
)
def test_what_does_not_fit_gas_or_air_is_refused(name: str, overrides: dict[str, Any], complaint: str):
    with pytest.raises(InputError, match=re.escape(complaint)):
        Simulator(override_scene(SCENES[name], list(overrides.items())), "cpu")


def test_roughness_is_below_the_height_of_the_wind_in_every_world():
    rough = override_scene(SCENES["wind"], [("atmosphere.roughness", 0.1)])
    with pytest.raises(InputError, match=r"less than wind_height, 0.05 m \(got 0.1\)"):
        plan_model(rough, 2, {"atmosphere.wind_height": [10.0, 0.05]})
