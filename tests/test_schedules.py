"""Every schedule against `scatter`, against itself, and a world alone against the same world in a batch."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
import warp as wp
from meshes import cube, mesh_of, prism, quad_sphere

from balloon_warp.errors import InputError
from balloon_warp.model import build_model, initial_state, lay_out, plan_model
from balloon_warp.scene import (
    Atmosphere,
    Balloon,
    Ground,
    Inflation,
    Scene,
    Sphere,
    Stiffness,
    String,
    Tube,
    Water,
)
from balloon_warp.scene.load import bundled_scenes, load_scene
from balloon_warp.schedules import make_schedule
from balloon_warp.schedules.banks import spread_over_banks, wavefronts
from balloon_warp.schedules.tables import spring_ends
from balloon_warp.simulator import Simulator

ROUNDING = 1e-5
"""Difference allowed after a short run [m], of bodies some meters large: a float32 there is rounded by up to 2e-7, a
run adds some ten of those, and springs and contacts pass them on. Longer runs differ by more, since colliding bodies
are chaotic: a difference doubles every few frames."""


def everything(normals: Literal["cached", "fresh"] = "cached") -> Scene:
    """Two balloons, with all that a scene can have: n-gons, fixed and unused particles, springs that vary."""
    ball = quad_sphere(4, radius=0.5)
    ball = mesh_of([*ball.points, (9.0, 9.0, 9.0)], ball.face_vertex_indices.reshape(-1, 4).tolist())
    return Scene(
        normals=normals,
        substeps=48,
        balloon=[
            Balloon(
                mesh=ball,
                position=(0.0, 0.49, 0.0),
                helium=3.0,
                damping=0.2,
                stiffness=Stiffness(variation=0.3),
                inflation=Inflation(k_normal=[(0.0, 0.1), (0.03, 0.5), (0.1, 0.2)]),
                fixed=[3, 17],
            ),
            Balloon(mesh=prism(5), position=(3.0, 0.85, 0.0), rotation=(20.0, 30.0, 0.0), mass=0.2),
        ],
        sphere=[
            Sphere(position=(0.1, 1.13, 0.0), radius=0.2, mass=0.4, velocity=(0.0, -1.0, 0.0)),
            Sphere(position=(3.2, 2.1, 0.4), radius=0.5, mass=2.0, penalty=2.0, velocity=(0.0, -3.0, 0.0)),
            Sphere(position=(-2.0, 0.3, 0.0), radius=0.29),
        ],
        string=[
            String(anchor=(0.0, 0.0, 0.0), particle="highest", length=0.8),
            String(anchor=(5.0, 1.0, 0.0), balloon=1, particle=4, length=0.5),
            String(anchor=(5.0, 2.0, 0.0), balloon=1, particle=4, length=30.0),
        ],
        ground=Ground(),
    )


def bare() -> Scene:
    """A balloon and nothing else."""
    return Scene(balloon=[Balloon(mesh=quad_sphere(3), helium=12.0)], substeps=33)


def afloat() -> Scene:
    """Everything in a light liquid that cuts through both balloons."""
    return everything().model_copy(update={"water": Water(level=0.7, density=3.0)})


def with_rubber() -> Scene:
    """Everything, and springs that are viscous and stop pulling, the second balloon's sooner."""
    rubber = Stiffness(variation=0.3, viscosity=2e-3, yield_stretch=1.4, gradient=(0.5, 1.5))
    other = Stiffness(viscosity=5e-3, yield_stretch=1.02, torsion=0.05)
    return _with_stiffness(everything(), rubber, other)


def _with_stiffness(scene: Scene, *of_balloons: Stiffness) -> Scene:
    balloons = [
        balloon.model_copy(update={"stiffness": stiffness})
        for balloon, stiffness in zip(scene.balloon, of_balloons, strict=True)
    ]
    return scene.model_copy(update={"balloon": balloons})


IMPULSE = {"contact": "impulse"}
CORRECTED = {"correction": "provot", "correction_limit": 0.01, "correction_sweeps": 2}


def corrected(correction: Literal["provot", "tarantino"]) -> Scene:
    """Everything, with springs that reach their limit soon."""
    return everything().model_copy(update=CORRECTED | {"correction": correction})


def with_torsion() -> Scene:
    """Everything, and angles that are kept, of quads and of pentagons."""
    return _with_stiffness(everything(), Stiffness(variation=0.3, torsion=0.02), Stiffness(torsion=0.05))


def by_forward_euler() -> Scene:
    """Everything, for so short a time that it does not gain much energy."""
    return everything().model_copy(update={"solver": "forward_euler"})


def in_air() -> Scene:
    """Gas that is pumped and flows through a tube, pressure and normal forces, beside all that a scene can have."""
    scene = everything("fresh")
    ball, pentagon = scene.balloon
    gas = Inflation(kind="gas", start_pressure=30.0, pump=[(0.0, 0.02), (0.05, -0.01)], gamma=1.3)
    less_gas = gas.model_copy(update={"start_pressure": 9.0})
    balloons = [
        ball.model_copy(update={"helium": 0.0, "inflation": gas, "drag_coefficient": 0.4}),
        pentagon.model_copy(update={"inflation": Inflation(kind="pressure", pressure=[(0.0, 5.0), (0.1, 20.0)])}),
        Balloon(mesh=cube(), position=(6.0, 0.3, 0.0), drag_coefficient=1.0, helium=9.0),
        Balloon(mesh=quad_sphere(3), position=(-6.0, 2.0, 0.0), inflation=less_gas),
    ]
    surroundings = {
        "tube": [Tube(balloons=(0, 3), conductance=1e-4)],
        "atmosphere": Atmosphere(wind=(3.0, 0.0, -1.0)),
        "water": Water(level=0.3, density=3.0),
    }
    return scene.model_copy(update={"balloon": balloons, **surroundings})


def in_air_with_rubber() -> Scene:
    """The same, with springs that look at velocities."""
    return _with_stiffness(in_air(), *[Stiffness(viscosity=2e-3, yield_stretch=1.4)] * 4)


def in_air_by_forward_euler() -> Scene:
    """The same, with points that move by the old velocities."""
    return in_air().model_copy(update={"solver": "forward_euler"})


SCENES = {
    "everything": everything(),
    "fresh": everything("fresh"),
    "bare": bare(),
    "afloat": afloat(),
    "rubber": with_rubber(),
    "torsion": with_torsion(),
    "provot": corrected("provot"),
    "tarantino": corrected("tarantino"),
    "forward Euler": by_forward_euler(),
    "in air": in_air(),
    "rubber in air": in_air_with_rubber(),
    "corrected in air": in_air().model_copy(update=CORRECTED),
    "forward Euler in air": in_air_by_forward_euler(),
    "impulse": everything().model_copy(update=IMPULSE),
    "impulse in air": in_air().model_copy(update=IMPULSE),
    "corrected impulse in air": in_air().model_copy(update=CORRECTED | IMPULSE),
}


@pytest.fixture(params=["gather", "lanes", "octets", "block"])
def schedule(request: pytest.FixtureRequest, device: str) -> str:
    """Each schedule that is tested against `scatter`, where it runs."""
    if request.param in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{request.param} is for the CPU")
    return request.param


def skip_beyond(schedule: str, scene: Scene) -> None:
    """Octets refuses what it does not simulate."""
    if False:
        pytest.skip("octets does not simulate this")


def after_frames(scene: Scene, schedule: str, device: str, frames: int = 3, worlds: int = 1) -> Simulator:
    simulator = Simulator(scene, device, worlds, schedule=schedule)
    for _ in range(frames):
        simulator.step()
    return simulator


def arrays(simulator: Simulator) -> dict[str, np.ndarray]:
    return {name: array.numpy() for name, array in vars(simulator.state).items()}


def advance_both(scene: Scene, schedule: str, device: str, settled: int, frames: int) -> list[dict[str, np.ndarray]]:
    """The states that `schedule` and `scatter` reach from what `scatter` reached after `settled` frames, and that."""
    start = after_frames(scene, "scatter", device, settled)
    states = []
    for name in (schedule, "scatter"):
        simulator = Simulator(scene, device, schedule=name)
        for field, array in vars(start.state).items():
            wp.copy(getattr(simulator.state, field), array)
        for _ in range(frames):
            simulator.step()
        states.append(arrays(simulator))
    return [*states, arrays(start)]


def tolerance_of(scene: Scene) -> float:
    """With fresh normals a particle between two faces may take the area of either; and whether a spring is corrected,
    and pulls, hangs on the rounding of its length, and c / h on that of c: differences grow fourfold each frame."""
    return ROUNDING if scene.normals == "cached" and scene.correction == "none" else 10 * ROUNDING


def assert_close(
    found: dict[str, np.ndarray], expected: dict[str, np.ndarray], tolerance: float, outliers: float = 0.0
) -> None:
    """All but some of the particles; where so many are outliers, those are not far off."""
    for name in ("points", "sphere_positions", "inflation_aims"):
        apart = np.abs(found[name] - expected[name]).max(axis=-1, initial=0.0)
        assert (apart > tolerance).sum() <= outliers * apart.size, (name, apart.max())
        assert apart.max(initial=0.0) <= 10 * tolerance, (name, apart.max())
    np.testing.assert_allclose(found["gas_amounts"], expected["gas_amounts"], rtol=1e-7)
    # a float32 volume is rounded by up to 1e-7 of itself, and so the pressure by that of the air's, over some frames,
    # in which forward Euler does not damp it
    np.testing.assert_allclose(found["pressures"], expected["pressures"], rtol=0, atol=0.5)
    np.testing.assert_array_equal(found["frame"], expected["frame"])


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_a_schedule_gives_scatters_trajectory(scene, schedule, device):
    skip_beyond(schedule, scene)
    frames = 3 if scene.correction == "none" else 1
    found, expected, start = advance_both(scene, schedule, device, settled=2, frames=frames)
    assert np.abs(expected["points"] - start["points"]).max() > 1000 * ROUNDING  # there is something to compare
    assert_close(found, expected, tolerance_of(scene))


@pytest.mark.parametrize("correction", ["provot", "tarantino"])
def test_corrections_show_in_the_scene_with_everything(correction, device):
    """Within a frame, or the test above would say nothing about them."""
    plain, with_it = (
        arrays(after_frames(scene, "scatter", device, 1))["points"] for scene in (everything(), corrected(correction))
    )
    assert np.abs(plain - with_it).max() > 100 * tolerance_of(corrected(correction))


def test_the_scene_with_everything_has_contacts(device):
    """Or the test above would say nothing about them."""
    state = arrays(after_frames(everything(), "scatter", device, frames=4))
    assert (np.abs(state["sphere_forces"]).sum(axis=-1) > 0.0)[0, :2].all()
    assert state["points"][..., 1].min() == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("name", bundled_scenes())
def test_a_schedule_gives_scatters_trajectory_of_a_bundled_scene(name, schedule, device):
    """A frame in the thick of the action."""
    scene = load_scene(name)
    skip_beyond(schedule, scene)
    found, expected, start = advance_both(scene, schedule, device, settled=30, frames=1)
    assert np.abs(expected["points"] - start["points"]).max() > 500 * ROUNDING
    # On a GPU scatter adds in another order every time, and whether a particle touches an obstacle may hang on that.
    assert_close(found, expected, tolerance_of(scene), outliers=0.0 if device == "cpu" else 0.001)


def test_a_particle_with_few_faces_may_stand_at_the_origin(schedule, device):
    """Three faces meet at a corner of the cube, and four at the particles beside it, from which octets fill up."""
    ball = quad_sphere(3, radius=0.5)
    corner = int(np.argmax(ball.points.sum(axis=1)))
    x, y, z = (-ball.points[corner]).tolist()
    still = Balloon(mesh=ball, position=(x, y, z), helium=9.81, inflation=Inflation(k_normal=0.0), damping=0.0)
    scene = Scene(balloon=[still], normals="fresh", gravity=9.81)
    found, expected = (arrays(after_frames(scene, name, device, 1)) for name in (schedule, "scatter"))
    np.testing.assert_allclose(expected["points"][0, corner], 0.0, atol=ROUNDING)
    assert np.linalg.norm(expected["inflation_aims"][0, corner]) > 0.01
    assert_close(found, expected, ROUNDING)


def test_a_fixed_particle_feels_neither_sphere_nor_ground(schedule, device):
    """Beside particles that do."""
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


@pytest.mark.parametrize("name", ["everything", "fresh", "in air", "tarantino"])
def test_a_run_repeats_to_the_last_bit(name, schedule, device):
    skip_beyond(schedule, SCENES[name])
    first, second = (arrays(after_frames(SCENES[name], schedule, device, worlds=9)) for _ in range(2))
    for field in first:
        np.testing.assert_array_equal(first[field], second[field], err_msg=field)


@pytest.mark.parametrize("name", ["everything", "fresh", "in air", "tarantino"])
def test_a_world_alone_is_the_same_world_in_a_batch(name, schedule, device):
    """To the last bit, also in a batch that no eight divide, beside a world that starts elsewhere."""
    skip_beyond(schedule, SCENES[name])
    alone = arrays(after_frames(SCENES[name], schedule, device))
    batch = Simulator(SCENES[name], device, 11, schedule=schedule)
    points = batch.state.points.numpy()
    points[4] += (0.0, 0.05, 0.0)
    wp.copy(batch.state.points, wp.array(points, dtype=wp.vec3, device=device))
    for _ in range(3):
        batch.step()
    for field, of_batch in arrays(batch).items():
        if field != "frame":
            for world in (0, 3, 5, 10):
                np.testing.assert_array_equal(of_batch[world], alone[field][0], err_msg=f"{field} of world {world}")
    assert (arrays(batch)["points"][4] != alone["points"][0]).any()


PER_WORLD = ["structural", "shear", "flexion", "mass", "helium", "damping", "keyframe_values", "gravity"]
PER_WORLD += ["sphere_mass", "sphere_radius", "sphere_penalty", "string_length", "string_stiffness"]
PER_WORLD += ["string_anchor", "ground_height", "ground_friction", "ground_restitution"]

PER_WORLD_BEYOND_OCTETS = ["torsion", "viscosity", "yield_stretch", "correction_limit"]
PER_WORLD_IN_AIR = ["initial_gas_amounts", "gamma", "molar_mass", "drag_coefficient", "tube_conductance"]
PER_WORLD_IN_AIR += ["air_pressure", "air_temperature", "air_density", "wind"]


def states_of_worlds(name: str, factors: list[float], schedule: str, device: str) -> list[np.ndarray]:
    """Points, sphere positions and pressures of a batch, each world with its parameters times a factor."""
    scene = SCENES[name]
    names = PER_WORLD
    if name != "everything":
        names = PER_WORLD + PER_WORLD_BEYOND_OCTETS + PER_WORLD_IN_AIR
    plan = plan_model(scene, len(factors))
    varied = {name: np.concatenate([factor * plan.parameters[name] for factor in factors]) for name in names}
    varied["ground_height"] = 0.2 * (np.array(factors) - 1.0)  # of the ground, which is at 0
    model = lay_out(replace(plan, parameters=plan.parameters | varied), device)
    state = initial_state(model)
    advance = make_schedule(model, schedule)
    for _ in range(3):
        advance.advance_frame(state)
    return [state.points.numpy(), state.sphere_positions.numpy(), state.pressures.numpy()]


@pytest.mark.parametrize("name", ["everything", "rubber", "in air", "tarantino"])
def test_parameters_of_worlds_may_differ(name, schedule, device):
    """Each world of such a batch is that world alone, to the last bit."""
    factors = [1.0, 0.9, 1.05]
    skip_beyond(schedule, SCENES[name])
    batch = states_of_worlds(name, factors, schedule, device)
    for world, factor in enumerate(factors):
        for of_batch, of_one in zip(batch, states_of_worlds(name, [factor], schedule, device), strict=True):
            np.testing.assert_array_equal(of_batch[world], of_one[0])


def test_an_unknown_schedule_is_refused():
    with pytest.raises(InputError, match="--schedule weave: no such schedule; there are auto, scatter, gather"):
        Simulator(bare(), "cpu", schedule="weave")


def test_auto_takes_a_schedule_and_says_which():
    assert Simulator(bare(), "cpu").schedule.name == "octets"
    assert Simulator(bare(), "cpu", 8).schedule.name == "lanes"


def test_what_octets_lacks_is_refused_and_gathered_instead():
    with pytest.raises(InputError, match=r"^--schedule octets: does not simulate forward Euler; use gather$"):
        Simulator(by_forward_euler(), "cpu", schedule="octets")
    assert Simulator(by_forward_euler(), "cpu").schedule.name == "gather"


def test_a_world_too_large_for_a_block_is_refused_and_not_taken_by_auto(device):
    """43 cells a side make 11,096 particles; two buffers of them take more than a block's memory."""
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(43), mass=50.0)])
    with pytest.raises(InputError, match=r"^--schedule block: a world of 11,096 particles is too large .* use gather$"):
        Simulator(scene, device, schedule="block")
    assert Simulator(scene, device).schedule.name == ("octets" if device == "cpu" else "gather")


def test_wavefronts_are_counted_by_hand():
    """Sixty-four particles, one slot: the first warp meets in bank 0 twice, the second reads one particle alone."""
    own = np.arange(64)
    assert wavefronts(own[None]) == 1.0
    clash = own.copy()
    clash[1] = 32  # bank 0 for thread 1, beside particle 0 for thread 0
    clash[32:] = 7  # the same word for all threads
    assert wavefronts(clash[None]) == (2 + 1) / 2


def test_slots_are_ordered_against_bank_conflicts():
    """Of the structural springs of 488 particles; each particle keeps its neighbors."""
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(9), mass=5.0)])
    ends = spring_ends(build_model(scene, "cpu"))
    structural = ends.kind == 0
    counts = ends.by_kind[:, 0]
    slot = np.arange(structural.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    neighbors = np.repeat(np.arange(488)[None], 4, axis=0)
    neighbors[slot, ends.particle[structural]] = ends.neighbor[structural]
    spread = np.take_along_axis(neighbors, spread_over_banks(neighbors), axis=0)
    np.testing.assert_array_equal(np.sort(spread, axis=0), np.sort(neighbors, axis=0))
    assert wavefronts(neighbors) > 1.8
    assert wavefronts(spread) < 1.4
