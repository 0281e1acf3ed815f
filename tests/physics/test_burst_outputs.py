"""Files and bits: outputs of balloons that burst, the projective solver against Newton's method, and skins."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp
from batches import OFTEN, contents, stop_after
from conserved import advanced, put
from exported import assert_valid
from meshes import grid, mesh_of, quad_sphere
from projective_scenes import SOFT, after_frames, full_scene, kick, kicked_balloon, one_step
from pxr import Usd, UsdGeom
from render_stages import read_stage
from test_bursting import BALL, filled, scene_of

from balloon_warp import Balloon, Change, InputError, Material, Scene, Simulator, StageWriter, Water, run_batch
from balloon_warp.batch.recorder import MEASURES, Recorder, columns_of
from balloon_warp.batch.task import STAGE_NAME
from balloon_warp.mesh.topology import beside_faces, signed_volume, total_area
from balloon_warp.model import State, build_model, plan_model
from balloon_warp.scene import Inflation, Stiffness, load_scene
from balloon_warp.scene.load import override_scene
from balloon_warp.solvers import projective
from balloon_warp.solvers.projective import MOST_PARTICLES


def test_the_stage_loses_the_faces_that_tear(tmp_path, device: str):
    """Areas exclude torn faces, volumes are of the surface that bounds gas, and pictures do not draw them."""
    scene = scene_of(quad_sphere(4, 0.1), needle_time=1e-3, tear_strength=1e6)
    simulator = filled(scene, 2.0, device)
    path = tmp_path / "burst.usdc"
    with StageWriter(path, simulator.model) as writer:
        frame = simulator.read_frame()
        writer.write(frame)
        for _ in range(7):
            frame = simulator.step()
            writer.write(frame)
    stage = Usd.Stage.Open(str(path))
    (mesh,) = (UsdGeom.Mesh(prim) for prim in stage.GetDefaultPrim().GetChildren() if prim.IsA(UsdGeom.Mesh))
    corners = [np.array(mesh.GetFaceVertexIndicesAttr().Get(number)).reshape(-1, 4) for number in range(8)]
    gone = [(each == each[:, :1]).all(axis=1) for each in corners]
    assert gone[0].sum() == 0
    assert gone[-1].sum() == frame.torn[0].sum() > 1
    np.testing.assert_array_equal(gone[-1], frame.torn[0])
    closed = replace(frame.meshes[0], points=frame.points[0].astype(np.float64))
    assert frame.gas_amounts[0] > 0.0  # which the torn faces still bound
    assert frame.volumes[0] == pytest.approx(signed_volume(closed), rel=1e-6)
    assert replace(frame, gas_amounts=np.zeros(1)).volumes[0] == 0.0
    whole = simulator.model.shapes[0].mesh.face_vertex_indices.reshape(-1, 4)[~frame.torn[0]]
    left = mesh_of(frame.points[0].astype(np.float64), whole.tolist())
    assert frame.areas[0] == pytest.approx(total_area(left), rel=1e-5)
    assert_valid(stage)
    drawn = read_stage(path)
    first, last = drawn.gone(0), drawn.gone(7)
    assert first is not None
    assert last is not None
    assert first.sum() == 0 < last.sum()
    assert last.mean() == pytest.approx(gone[-1].mean())


def test_what_a_tear_cut_off_is_not_framed(tmp_path):
    simulator = Simulator(scene_of(quad_sphere(4, 0.1)), "cpu")
    frame = simulator.read_frame()
    mesh, points = frame.meshes[0], frame.points[0].copy()
    around = (mesh.face_vertex_indices.reshape(-1, 4) == 0).any(axis=1)
    points[0] += 50.0
    path = tmp_path / "burst.usdc"
    with StageWriter(path, simulator.model) as writer:
        writer.write(replace(frame, points=[points], torn=[around]))
    stage = Usd.Stage.Open(str(path))
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    (ball,) = (each for each in meshes if not each.GetPath().HasPrefix("/World/Studio"))
    np.testing.assert_allclose(ball.GetExtentAttr().Get(0), [points[1:].min(axis=0), points[1:].max(axis=0)])
    camera = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Studio/Camera")).ComputeLocalToWorldTransform(0)
    assert np.linalg.norm(camera.ExtractTranslation()) < 2.0


def test_a_batch_exports_worlds_that_burst(tmp_path):
    """Stage and tables are those of a run alone, without torn faces, and at last without volume; also when resumed."""
    balloon = scene_of(quad_sphere(4, 0.1), needle_time=1e9, tear_strength=1e5).balloon[0]
    balloon = balloon.model_copy(update={"inflation": Inflation(kind="pressure", pressure=600.0), "damping": 0.5})
    scene = Scene(balloon=[balloon], gravity=0.0, frames=14, frames_per_second=500.0)
    vary, warnings = {"balloon.material.needle_time": [1e9, 4e-3]}, []
    run_batch(scene, tmp_path / "whole", 2, vary, export=[0, 1], device="cpu", on_warning=warnings.append)
    assert not warnings
    stage = Usd.Stage.Open(str(tmp_path / "whole" / STAGE_NAME))
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    with np.load(tmp_path / "whole" / "table.npz") as columns:
        table = {name: columns[name].reshape(15, 2) for name in ("volume", "area", "burst")}
    alone = Simulator(scene, "cpu", 1, {path: values[1:] for path, values in vary.items()}, schedule="gather")
    frame = alone.read_frame()
    for number in range(15):
        whole, burst = (np.array(mesh.GetFaceVertexIndicesAttr().Get(number)) for mesh in meshes)
        np.testing.assert_array_equal(whole, frame.meshes[0].face_vertex_indices)
        np.testing.assert_array_equal(burst, frame.corners(0))
        seen = frame.points[0][beside_faces(frame.meshes[0], frame.torn[0])]
        extent = meshes[1].GetExtentAttr().Get(number)
        np.testing.assert_allclose(extent, [seen.min(axis=0), seen.max(axis=0)], atol=1e-5)
        np.testing.assert_allclose(table["volume"][number, 1], frame.volumes[0], rtol=1e-5)
        np.testing.assert_allclose(table["area"][number, 1], frame.areas[0], rtol=1e-5)
        frame = alone.step()
    assert frame.torn[0].sum() > 2
    assert table["volume"][-1, 0] > 0.0 == table["volume"][-1, 1]
    assert table["burst"][[0, -1]].tolist() == [[0.0, 0.0], [0.0, 1.0]]
    assert "burst" not in columns_of(Scene(balloon=[Balloon(mesh=BALL)]))
    assert_valid(stage)
    again = {"export": [0, 1], "device": "cpu", "checkpoint_seconds": OFTEN}
    with pytest.raises(RuntimeError):
        run_batch(scene, tmp_path / "stopped", 2, vary, on_frame=stop_after(4), **again)
    run_batch(scene, tmp_path / "stopped", 2, vary, resume=True, **again)
    assert contents(tmp_path / "stopped") == contents(tmp_path / "whole")


def test_iterations_converge_to_newtons_method(device):
    step, points = one_step(400, device)
    expected = step.minimum(points)
    assert np.abs(step.slope(expected)[step.share > 0.0]).max() < 1e-9  # N; Newton's method has converged
    assert np.abs(expected - step.start).max() > 0.05
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-6)


def test_springs_far_too_stiff_for_the_explicit_steps_stay_stable(device):
    """A thousand times stiffer than symplectic Euler bears at h = 1/60 s, and kicked."""
    rest = quad_sphere(4, radius=0.5)

    def scene(factor: float, **fields) -> Scene:
        stiffness = Stiffness(structural=factor, shear=factor, flexion=factor)
        balloon = Balloon(mesh=rest, stiffness=stiffness, damping=0.0, inflation=Inflation(k_normal=0.1))
        return Scene(balloon=[balloon], gravity=0.0, substeps=1, **fields)

    bearable = 0.5
    Simulator(scene(bearable), device)
    with pytest.raises(InputError, match="are too few"):
        Simulator(scene(2.0 * bearable), device)
    simulator = Simulator(scene(1000.0 * 2.0 * bearable, solver="projective"), device)
    kick(simulator)
    velocities = [simulator.step().velocities[0] for _ in range(120)]
    speeds = [np.linalg.norm(each - each.mean(axis=0)) for each in velocities]
    assert np.isfinite(speeds).all()
    assert max(speeds[1:]) < 1.05 * speeds[0]


def test_small_steps_approach_scatters_trajectory_at_first_order(device):
    """Areas agree on average, as a particle between two faces may take the area of either."""
    expected = after_frames(full_scene(substeps=1200), device, schedule="scatter").state
    errors = []
    for substeps in (25, 50, 100):
        found = after_frames(full_scene(substeps=substeps, solver="projective"), device).state
        errors.append(np.abs(found.points.numpy() - expected.points.numpy()).mean())
    assert errors[0] < 1e-3
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 1.0, atol=0.2)  # and the next order


def test_springs_that_change_change_the_matrix_too(device):
    changed = kicked_balloon(100, change=[Change(time=0.0, set={"balloon.stiffness.structural": 200.0})])
    stiff = kicked_balloon(100, SOFT.model_copy(update={"structural": 200.0}))
    found, expected = (after_frames(scene, device, 10).state.points.numpy() for scene in (changed, stiff))
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("vary", [{}, {"balloon.0.mass": np.linspace(0.1, 0.3, 3)}])
def test_the_inverse_and_the_factor_give_the_same_trajectory(vary, device):
    states: list[State] = []
    for place, global_step in (("cpu", projective.SparseFactor), (device, projective.DenseInverse)):
        simulator = Simulator(full_scene(solver="projective"), place, 3, vary)
        simulator.schedule = projective.ProjectiveSolver(simulator.model, global_step)
        advanced(simulator, 3)
        states.append(simulator.state)
    assert np.abs(states[0].velocities.numpy()).max() > 0.1
    np.testing.assert_allclose(states[0].points.numpy(), states[1].points.numpy(), rtol=0, atol=1e-5)


def test_the_inverse_solves_the_system_alike_for_one_world_and_for_many(device):
    """Threads have one row each, or several rows of several worlds, for two balloons of 56 rows each."""
    many = projective.MANY_WORLDS + 5
    right_sides = np.random.default_rng(3).normal(size=(many, 112, 3)).astype(np.float32)
    solutions = []
    for rows in (right_sides, right_sides[-1:]):
        model = build_model(full_scene(), device, len(rows))
        solution = wp.zeros(rows.shape[:2], dtype=wp.vec3, device=device)
        matrices = projective.StepMatrices(model)
        going = wp.full(len(rows), 1, dtype=wp.int32, device=device)
        projective.DenseInverse(model, matrices).solve(wp.array(rows, dtype=wp.vec3, device=device), solution, going)
        solutions.append(solution.numpy())
    np.testing.assert_array_equal(solutions[0][-1], solutions[1][0])
    back = np.einsum("pq,wqa->wpa", matrices.matrix(0).toarray(), solutions[0])
    np.testing.assert_allclose(back, right_sides, rtol=0, atol=1e-4)  # float32, times a condition of 100


VARIED = {
    "balloon.0.stiffness.structural": [20.0, 35.0, 0.0],
    "balloon.1.mass": [0.2, 0.3, 0.25],
    "balloon.0.damping": [0.1, 0.1, 0.4],
    "string.0.stiffness": [20.0, 25.0, 40.0],
    "gravity": [9.0, 10.0, 11.0],
}


def test_a_world_alone_is_the_same_world_in_a_batch(device):
    scene = full_scene(solver="projective", normals="fresh", substeps=3)
    vary = {path: (values * 4)[:11] for path, values in VARIED.items()}
    batch = after_frames(scene, device, worlds=11, vary=vary)
    for world in (0, 7, 10):
        alone = after_frames(scene, device, vary={path: values[world : world + 1] for path, values in vary.items()})
        for name in ("points", "velocities", "sphere_positions", "sphere_forces"):
            of_batch, of_one = (getattr(each.state, name).numpy() for each in (batch, alone))
            np.testing.assert_array_equal(of_batch[world], of_one[0], err_msg=name)
    assert (batch.state.points.numpy()[0] != batch.state.points.numpy()[1]).any()


def test_what_it_cannot_simulate_is_refused():
    said = r'^schedule gather: is for explicit steps; solver = "projective" needs auto$'
    with pytest.raises(InputError, match=said):
        Simulator(kicked_balloon(), "cpu", schedule="gather")
    with pytest.raises(InputError, match=r'^solver: "projective" does not support water; expected another'):
        Simulator(kicked_balloon(water=Water()), "cpu")
    many = Balloon(mesh=quad_sphere(27), inflation=Inflation(k_normal=0.2))
    large = build_model(Scene(balloon=[many], solver="projective"), "cpu")
    with pytest.raises(InputError, match=rf"^solver: .* {MOST_PARTICLES:,} particles at most on a GPU \(got 4,376\)"):
        projective.ProjectiveSolver(large, projective.DenseInverse)


OGDEN = {"preset": "natural_rubber_treloar"}
UNSTABLE = {"ogden_moduli": (1e5, -1e3, 0.0), "ogden_exponents": (2.0, 2.0, 1.0)}


def latex(**fields: Any) -> Scene:
    return Scene(balloon=[Balloon(**{"mesh": quad_sphere(3, 0.1), "material": Material(preset="latex")} | fields)])


def test_the_mass_is_that_of_the_skin():
    scene = latex()
    plan = plan_model(scene, 2, {"balloon.material.thickness": [1e-4, 3e-4]})
    area = total_area(plan.shapes[0].mesh)
    # a quad that is not flat is as large as its two triangulations are on average, and so a little larger
    np.testing.assert_allclose(plan.parameters["mass"][:, 0], [area * 1e-4 * 940.0, area * 3e-4 * 940.0], rtol=2e-3)
    np.testing.assert_allclose(plan.shapes[0].mass_share.sum(), 1.0)
    fixed = plan_model(latex(fixed=[0])).shapes[0].mass_share
    np.testing.assert_allclose(fixed[1:], plan.shapes[0].mass_share[1:])  # a fixed particle keeps its own
    assert fixed[0] == 0.0


def test_mass_is_lumped_by_area_and_not_by_particles():
    strip = mesh_of([(0, 0, 0), (3, 0, 0), (4, 0, 0), (4, 1, 0), (3, 1, 0), (0, 1, 0)], [[0, 1, 4, 5], [1, 2, 3, 4]])
    shares = plan_model(latex(mesh=strip, inflation=Inflation(pressure=0.0))).shapes[0].mass_share
    np.testing.assert_allclose(shares, np.array([3.0, 4.0, 1.0, 1.0, 4.0, 3.0]) / 16.0)


def test_weights_make_the_skin_thicker():
    """Twice everywhere is a skin of twice the thickness; a function of points acts by its values."""
    points = quad_sphere(3, 0.1).points
    twice = latex(material=Material(preset="latex", weights=[2.0] * len(points)))
    thick = latex(material=Material(preset="latex", thickness=4e-4))
    rule = {"preset": "latex", "weights": lambda points: np.where(points[:, 1] > 0.0, 3.0, 1.0)}
    by_rule = latex(material=rule)
    assert latex(material=Material(**rule)).balloon[0].material == by_rule.balloon[0].material
    masses = [plan_model(scene).parameters["mass"].item() for scene in (twice, thick, by_rule, latex())]
    assert masses[0] == pytest.approx(masses[1])
    assert 1.6 * masses[3] < masses[2] < 2.4 * masses[3]
    one, other = (advanced(Simulator(scene, "cpu"), 3).points[0] for scene in (twice, thick))
    np.testing.assert_allclose(one, other, atol=1e-4)
    assert np.abs(one - points).max() > 1e-3


def test_rubber_has_no_springs_but_those_that_are_asked_for():
    assert build_model(latex(), "cpu").spring_count == 0
    asked = build_model(latex(material=Material(preset="latex", springs=["flexion"])), "cpu")
    of_springs = build_model(latex(material=Material()), "cpu")
    kinds = of_springs.spring_kind.numpy()
    assert asked.spring_count == (kinds == 2).sum() > 0
    assert of_springs.triangle_count == 0


def test_worlds_differ_in_one_term_of_an_ogden_material():
    vary = {"balloon.material.ogden_moduli.0": [5e5, 7e5], "balloon.material.ogden_exponents.1": [4.0, 5.0]}
    parameters = plan_model(latex(material=Material(**OGDEN)), 2, vary).parameters
    moduli, exponents = parameters["ogden_moduli"][:, 0], parameters["ogden_exponents"][:, 0]
    np.testing.assert_allclose(moduli, [(5e5, 1.2e3, -1e4), (7e5, 1.2e3, -1e4)])
    np.testing.assert_allclose(exponents, [(1.3, 4.0, -2.0), (1.3, 5.0, -2.0)])


@pytest.mark.parametrize(
    ("material", "sentence"),
    [
        ({"kind": "ogden"}, "material.ogden_exponents: is missing"),
        ({"kind": "ogden", **UNSTABLE}, "material.ogden_moduli: .* unstable material; expected modulus times exponent"),
        (OGDEN | {"ogden_exponents": (1.3, 300.0, -2.0)}, r"material.ogden_exponents.1: must be less .* 20 \(got 300"),
        ({"kind": "neo_hookean", "thickness": 0.0}, r"material.thickness: must be greater than .* \(got 0"),
        ({"kind": "gent", "gent_limit": 20.0, "most_stretch": 5.0}, "material.most_stretch: 5 exceeds the .* 3.39"),
        ({"shear_modulus": 1e5}, 'material.shear_modulus: needs kind = "neo_hookean" or'),
        ({"kind": "gent", "mooney_ratio": 0.2}, 'material.mooney_ratio: needs kind = "mooney_rivlin"'),
        ({"preset": "lead"}, "material.preset: must be 'latex'"),
        ({"kind": "neo_hookean", "weights": [1.0, 2.0]}, "material.weights: .* has 56 vertices; expected a number for"),
    ],
)
def test_bad_input_gets_a_sentence(material: dict[str, Any], sentence: str):
    with pytest.raises(InputError, match=sentence):
        build_model(latex(material=material), "cpu")


THICKER = Change(time=0.1, set={"balloon.material.thickness": 1e-3})
BY_NORMALS = Inflation(k_normal=0.1)


@pytest.mark.parametrize(
    ("balloon", "scene", "vary", "sentence"),
    [
        ({"mass": 2.0}, {}, {}, r"balloon.mass: follows from the material's thickness and density \(got 2\)"),
        ({"inflation": BY_NORMALS}, {"solver": "projective"}, {}, '"projective" does not support mooney-rivlin'),
        ({"mesh": mesh_of([(0, 0, 0), (1, 0, 0)], [[0, 1]])}, {}, {}, "material: .* has no face with an area"),
        ({}, {}, {"balloon.mass": [1.0, 2.0]}, "mass: follows from the material"),
        ({}, {}, {"balloon.material.gent_limit": [50.0, 60.0]}, r'material\.gent_limit: needs kind = "gent"'),
        ({}, {"change": [THICKER]}, {}, "thickness: cannot change"),
        ({}, {"substeps": 2}, {}, "substeps: 2 are too few"),
    ],
)
def test_what_does_not_go_with_rubber_gets_a_sentence(balloon: dict, scene: dict, vary: dict, sentence: str):
    with pytest.raises(InputError, match=sentence):
        Simulator(latex(**balloon).model_copy(update=scene), "cpu", 2 if vary else 1, vary)


def test_a_preset_can_be_changed():
    plain = latex()
    softer = override_scene(plain, [("balloon.material.shear_modulus", 1e5)]).balloon[0].material
    assert softer.value("shear_modulus") == 1e5
    assert softer.value("thickness") == plain.balloon[0].material.value("thickness")
    foil = override_scene(plain, [("balloon.material.preset", "foil")]).balloon[0].material
    assert foil.law == "neo_hookean"
    assert foil.value("thickness") == Material(preset="foil").value("thickness") < softer.value("thickness")
    assert load_scene("squirrel_inflate", {"balloon.material.preset": "latex"}).balloon[0].material.is_membrane


@pytest.mark.always
def test_the_largest_stretch_is_that_of_the_skin(device: str):
    """The largest stretch in a batch's table and on the page is that of a sheet stretched askew by 1.5 and 0.9."""
    sheet = latex(mesh=grid(3, 3), inflation=Inflation(pressure=0.0))
    simulator = Simulator(sheet, device)
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    points = simulator.state.points.numpy()[0]
    put(simulator, points @ (np.array([[1.2, 0.3, 0.0], [0.3, 1.2, 0.0], [0.0, 0.0, 1.0]]) @ turn))
    measured = Recorder(simulator, np.arange(1)).read().measures[0, MEASURES.index("largest_stretch")]
    assert measured == pytest.approx(1.5, rel=1e-5)
    membrane = simulator.model.shapes[0].membrane
    np.testing.assert_allclose(membrane.stretches(simulator.state.points.numpy()[0]), 1.5, rtol=1e-5)
