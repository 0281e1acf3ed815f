"""Block layouts with particles in registers or in loops, and values in shared memory or not: the kernels of a GPU, on a
CPU, where a block is one thread. Results agree with launches."""

import re
from typing import Any

import numpy as np
import pytest
from block_layouts import LAYOUTS
from costs import nightly_but
from meshes import quad_sphere

from balloon_warp.kernels.schedules.block import source_of_frame
from balloon_warp.kernels.schedules.block_names import Layout
from balloon_warp.model import build_model, initial_state
from balloon_warp.scene import Balloon, Ground, Inflation, Material, Obstacle, Scene, Sphere, Stiffness, Touch, Water
from balloon_warp.schedules import block_layout
from balloon_warp.schedules.block_layout import step_of
from balloon_warp.schedules.choose import make_schedule
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.slices import kind_slots, spring_ends

PAPERS, GAS, FULL = Inflation(k_normal=0.2), *(Inflation(kind="gas", start_pressure=p) for p in (50.0, 400.0))
LATEX = Material(kind="neo_hookean", shear_modulus=4e5, thickness=3e-4)
GROUND, ABOVE = Ground(height=-0.49), Sphere(position=(0.0, 0.95, 0.0), radius=0.5, mass=1.0)
VISCOUS = Stiffness(viscosity=2e-2)
BESIDE = Sphere(position=(0.9, 0.95, 0.0), radius=0.5, mass=1.0)


def scenes(cells: int) -> dict[str, Scene]:
    """Return scenes of balloons with so many cells along an edge."""
    ball, shared = quad_sphere(cells, radius=0.5), {"substeps": 16, "faces": False, "touch": False}
    falling = Balloon(mesh=ball, position=(0.0, 0.57, 0.0), inflation=PAPERS, velocity=(0.5, -1.0, 0.0))
    of_gas, of_paper = Balloon(mesh=ball, inflation=GAS), Balloon(mesh=ball, inflation=PAPERS)
    latex = {"mesh": ball, "inflation": FULL, "angular_velocity": (20.0, 10.0, -30.0)}
    walls = [Obstacle(size=(8.0, 0.1, 8.0)), Obstacle(size=(0.1, 4.0, 4.0), position=(0.55, 0.0, 0.0))]
    fields: dict[str, dict[str, Any]] = {
        "fresh normals, odd substeps": {"substeps": 15, "normals": "fresh", "balloon": [of_paper], "ground": GROUND},
        "gas, spheres": {"balloon": [of_gas], "ground": GROUND, "sphere": [ABOVE, BESIDE]},
        "two balloons": {
            "normals": "fresh", "sphere": [ABOVE],
            "balloon": [of_gas.model_copy(update={"position": (0.0, 0.0, 2.0)}), of_paper],
        },
        "apart, beside obstacles": {
            "substeps": 15, "balloon": [falling, falling.model_copy(update={"position": (0.0, 0.57, 3.0)})],
            "obstacle": walls, "touch": Touch(),
        },
        "beside obstacles, impulses": {
            "substeps": 15, "contact": "impulse", "sphere": [ABOVE], "obstacle": walls,
            "balloon": [falling.model_copy(update={"stiffness": VISCOUS, "inflation": GAS})],
        },
        "latex": {"substeps": 64, "balloon": [Balloon(**latex, material=LATEX)]},
        "viscous latex": {
            "substeps": 64, "balloon": [Balloon(**latex, material=LATEX.model_copy(update={"viscosity": 50.0}))],
        },
        "in water": {"balloon": [of_gas], "water": Water(level=0.1)},
        "cached normals, corrected": {"correction": "provot", "balloon": [of_paper], "ground": GROUND},
    }  # fmt: skip
    return {name: Scene(**shared | own) for name, own in fields.items()}


NAMES = tuple(scenes(1))
ROUNDING = 2.0e-5
"""of the largest value: the same sums in another order"""
OF_VELOCITIES = 1.0e-4
"""[m/s]: a gas's pressure is rounded by a ten millionth of the air's, which moves some grams by so much"""


def after_frames(scene: Scene, schedule: str) -> dict[str, np.ndarray]:
    model = build_model(scene, "cpu", world_count=2)
    state, advancing = initial_state(model), make_schedule(model, schedule)
    for _ in range(2):
        advancing.advance_frame(state)
    return {name: getattr(state, name).numpy() for name in ("points", "velocities", "pressures", "sphere_positions")}


@pytest.mark.always("viscous latex-held", "fresh normals, odd substeps-held")
@pytest.mark.parametrize("layout", nightly_but(("held", "looped"), LAYOUTS))
@pytest.mark.parametrize("name", NAMES)
def test_blocks_do_what_launches_do(name: str, layout: str, monkeypatch: pytest.MonkeyPatch) -> None:
    layout_of, cells = LAYOUTS[layout]
    scene = scenes(cells)[name]
    expected = after_frames(scene, "gather")
    monkeypatch.setattr(block_layout, "layout_of", layout_of)
    found = after_frames(scene, "block")
    most = {"velocities": OF_VELOCITIES, "pressures": ROUNDING * 1.0e5}
    for what, values in expected.items():
        assert np.isfinite(found[what]).all()
        atol = most.get(what, ROUNDING * np.abs(values).max(initial=0.0))
        np.testing.assert_allclose(found[what], values, atol=atol, err_msg=what)


def test_loops_over_items_leave_what_threads_keep_alone() -> None:
    """A thread that keeps one particle of several balloons loops over faces and balloons as well. A CPU's one thread
    keeps all particles, so the test reads the generated text."""
    scene = scenes(3)["two balloons"].model_copy(update={"normals": "cached", "touch": False})
    model = build_model(scene, "cpu")
    features = model_features(model)
    layout = Layout(64, 128, 1, kind_slots(spring_ends(model)))
    source = source_of_frame(step_of(features, layout), layout)
    text = source.partition('"""\n')[2].splitlines()
    kept, looped, loops = set[str](), set[str](), list[int]()
    for line in text:
        indent = len(line) - len(line.lstrip())
        loops = [each for each in loops if each < indent]
        names = re.match(r"\s*(?:for )?([\w, ]+?) (?:=|in) ", line)
        assigned = set(names[1].split(", ")) if names else set[str]()
        if re.match(r"\s*for (begin|balloon|face|sphere) in", line):
            loops.append(indent)
            looped |= assigned
        elif loops:
            looped |= assigned
        else:
            kept |= assigned
    assert {"is_there_0", "balloon_0", "point_0"} <= kept
    assert {"is_there", "balloon"} <= looped
    assert kept & looped == {"end"}  # of the substep: the same to all
