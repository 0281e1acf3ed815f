"""Methods agree with the trajectory of `scatter` in every schedule that takes them; the docs' tables of schedules, of
methods and of validation are those of the code, and each line of them runs."""

import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from costs import nightly_but
from method_scenes import SCENES, VARIANTS, features, switches
from own_laws import TESTED, model_of_all
from trajectories import ROUNDING, advance_both, assert_close, tolerance_of

from balloon_warp import InputError, bundled_scenes, load_scene
from balloon_warp.benchmarks import methods, validation
from balloon_warp.benchmarks.matrix import METHODS, Method, as_markdown
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws import LAWS
from balloon_warp.kernels.substep import conditional_phases
from balloon_warp.model import Model, build_model
from balloon_warp.scene.load import parse_override
from balloon_warp.schedules.choose import LAUNCHED, only_launched, schedule_named
from balloon_warp.schedules.layouts import fits_in_block

DOCS = Path(__file__).parent.parent / "docs"
USUAL = ("more", "more in touch", "more, bursting")
"""the variants in which most features meet; the others vary one of them"""


@pytest.mark.full
@pytest.mark.parametrize("name", nightly_but(USUAL, VARIANTS))
def test_a_schedule_gives_scatters_trajectory(name, schedule, device):
    """Schedules agree with `scatter` where features meet that do not in the sets of test_reference.py."""
    scene = VARIANTS[name]
    if schedule not in LAUNCHED and only_launched(model_of(name)):
        pytest.skip(f"{schedule} refuses it")
    frames = 2 if scene.correction == "none" else 1
    found, expected, start = advance_both(scene, schedule, device, settled=2, frames=frames)
    assert np.abs(expected["points"] - start["points"]).max() > 1000 * ROUNDING  # there is something to compare
    assert_close(found, expected, tolerance_of(scene))


ACTION = {"letter_slot": 15, "turtle_pillow": 40, "pop": 75, "two_latex_balloons": 10}
"""the frame in the thick of it, where that is not the thirtieth"""
LONG_AGO = ("airbag",)
"""scenes that take `scatter` minutes to get there: `auto` leads to it"""


@pytest.mark.full
@pytest.mark.parametrize("schedule", ["gather", "block"])
@pytest.mark.parametrize("name", bundled_scenes())
def test_a_gpu_gives_scatters_trajectory_of_a_bundled_scene(name: str, schedule: str, gpu: wp.Device):
    """Schedules agree over a frame in the thick of the action, with as many particles as users have. On a CPU the
    scenes above have all features, as a test below requires, and threads do not share work."""
    scene, device = load_scene(name), str(gpu)
    model = build_model(scene, device)
    if schedule == "block" and (only_launched(model) or not fits_in_block(model)):
        pytest.skip("block refuses it")
    settled, settled_by = ACTION.get(name, 30), "auto" if name in LONG_AGO else "scatter"
    found, expected, start = advance_both(scene, schedule, device, settled, frames=1, settled_by=settled_by)
    assert np.abs(expected["points"] - start["points"]).max() > 300 * ROUNDING
    # Scatter adds in another order every time, and whether a particle touches an obstacle may hang on that; as anywhere
    # whether one that is as near to two faces takes the area of the one or the other.
    assert_close(found, expected, tolerance_of(scene), outliers=0.001)


@cache
def model_of(name: str) -> Model:
    """Return the model of a scene of methods."""
    return build_model(SCENES[name], "cpu")


@cache
def model_with(method: str) -> Model:
    """Return the model of a line of the table."""
    return next(line for line in METHODS if line.name == method).model()


@cache
def simulated() -> set[str]:
    """Return the features of the scenes of methods, and of those of test_law_schedules.py."""
    models = [model_of(name) for name in SCENES]
    return set().union(*map(features, models + [model_of_all(law, "cpu")[0] for law in TESTED]))


@pytest.mark.full
@pytest.mark.parametrize("name", bundled_scenes())
def test_every_feature_of_a_bundled_scene_is_run_in_every_schedule(name: str):
    assert features(build_model(load_scene(name), "cpu")) <= simulated()


@pytest.mark.full
@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_every_method_of_the_table_is_run_in_every_schedule(method: Method):
    assert features(model_with(method.name)) <= simulated()


ASKED_BY_CONTROLS = {"fixtures_steered True"}
"""features that no scene asks for; test_timeline.py runs them in every schedule"""


@pytest.mark.full
def test_every_law_and_every_trait_is_run_on_and_off():
    names = {law.name for law in LAWS}
    switched = {f"{name} {value}" for name in switches(Features((), None)) for value in (True, False)}
    assert simulated() | ASKED_BY_CONTROLS >= names | switched | {
        f"phase {phase.name}" for phase in conditional_phases()
    }


@pytest.mark.full
def test_the_table_in_the_docs_is_what_schedules_say():
    (table,) = re.findall(
        r"<!-- matrix -->\n\n(.*?)\n\n<!-- end -->", (DOCS / "MATRIX.md").read_text(encoding="utf-8"), re.DOTALL
    )
    assert table == as_markdown(), "python -m balloon_warp.benchmarks.matrix makes it anew"


@pytest.mark.full
@pytest.mark.parametrize("method", methods.METHODS, ids=lambda method: method.name)
def test_every_method_can_be_measured(method: methods.Method):
    overrides = [parse_override(text) for text in (*methods.PAPER, *method.overrides)]
    model = build_model(load_scene(methods.SCENE, overrides), "cpu")
    schedule_named(method.schedule, model)


def test_the_page_has_a_line_for_every_method_with_the_values_that_were_measured():
    """The overrides repeat a line; of a long table the beginning stands there."""
    page = (DOCS / "METHODS.md").read_text("utf-8")
    for method in methods.METHODS:
        [line] = re.findall(rf"^\| {re.escape(method.name)} \|.*", page, re.M)
        assert [value for value in method.overrides if value.split(",")[0] not in line] == [], method.name


@pytest.mark.full
def test_a_method_that_blows_up_is_said_to_and_one_that_is_refused_is_a_mistake():
    rows = methods.measure_methods(
        [methods.Method("first"), methods.Method("wild", ("balloon.inflation.k_normal=9e11",))], "cpu", 1, 3
    )
    assert methods.as_markdown(rows).splitlines()[-1].startswith("| wild | blows up |")
    with pytest.raises(InputError, match=r"wrong: balloon\.0\.mass: must be greater than 0"):
        methods.measure_methods([methods.Method("first"), methods.Method("wrong", ("balloon.mass=-1",))], "cpu", 1, 1)


KEPT = json.loads((DOCS / "validation.json").read_text(encoding="utf-8"))

MOST = {"rubber": 0.01, "gas": 0.001, "drag": 0.01, "convergence": 0.15}
"""rubber that is pumped is not quite at rest; polyhedra are not quite spheres; errors have a next order, a tenth"""


def test_the_table_is_that_of_the_json():
    page = (DOCS / "VALIDATION.md").read_text("utf-8")
    (table,) = re.findall(r"<!-- table -->\n\n(.*)\n\n<!-- end -->", page, re.DOTALL)
    assert table == validation.table(KEPT)


@pytest.mark.parametrize("name", validation.CASES)
def test_curves_are_near_their_formulas_and_have_pictures(name: str):
    for each in KEPT[name]["curves"]:
        assert validation.Curve(**each).error < MOST[name]
        assert np.ptp(each["x"]) > 0.5 * np.abs(each["x"]).max()
        assert np.ptp(each["simulated"]) > 0.3 * np.abs(each["simulated"]).max()
    assert (DOCS / "pictures" / f"validation_{name}.svg").read_text("utf-8").count("<svg") == 1
    assert f"(pictures/validation_{name}.svg)" in (DOCS / "VALIDATION.md").read_text("utf-8")


@pytest.mark.full
@pytest.mark.parametrize("name", ["gas", "drag"])
def test_the_kept_curves_are_simulated_again(name: str):
    for found, kept in zip(validation.CASES[name]().curves, KEPT[name]["curves"], strict=True):
        np.testing.assert_allclose(found.simulated, kept["simulated"], rtol=1e-3, atol=1e-3 * max(kept["simulated"]))
