"""Methods agree with the trajectory of `scatter` in every schedule that takes them; the docs have a table of both."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from costs import nightly_but
from features import bundled, bundled_model, features, some_bundled_scenes, switches
from lone_laws import TESTED, model_of_all
from method_scenes import SCENES, VARIANTS
from trajectories import ROUNDING, advance_both, assert_close, tolerance_of

from balloon_warp import bundled_scenes
from balloon_warp.benchmarks.matrix import METHODS, Method, as_markdown
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws import LAWS
from balloon_warp.kernels.substep import asking_phases
from balloon_warp.model import Model, build_model
from balloon_warp.schedules.block_room import fits_in_block
from balloon_warp.schedules.choose import LAUNCHED, fastest_schedule, only_launched

PAGE = Path(__file__).parent.parent / "docs" / "MATRIX.md"


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


@cache
def model_of(name: str) -> Model:
    """Return the model of a scene of methods."""
    return build_model(SCENES[name], "cpu")


@cache
def model_with(method: str) -> Model:
    """Return the model of a line of the table."""
    return next(line for line in METHODS if line.name == method).model()


@pytest.mark.full
@pytest.mark.parametrize("name", bundled_scenes())
def test_a_schedule_gives_scatters_trajectory_of_a_bundled_scene(name, schedule, device):
    """Schedules agree over a frame in the thick of the action. On a CPU, to save time, a scene with no feature of its
    own runs in the schedule that it has alone there, and of those only some that cover all features."""
    scene, model = bundled(name), bundled_model(name, device)
    large = schedule == "block" and not fits_in_block(model)
    if schedule not in LAUNCHED and (only_launched(model) or large):
        pytest.skip(f"{schedule} refuses it")
    usual = schedule == fastest_schedule(model, 1)
    enough = usual and name in some_bundled_scenes()
    if device == "cpu" and not enough and features(model) <= shown_otherwise():
        pytest.skip("shows nothing that the scenes above do not")
    settled, settled_by = ACTION.get(name, 30), "auto" if name in LONG_AGO else "scatter"
    found, expected, start = advance_both(scene, schedule, device, settled, frames=1, settled_by=settled_by)
    assert np.abs(expected["points"] - start["points"]).max() > 300 * ROUNDING
    # On a GPU scatter adds in another order every time, and whether a particle touches an obstacle may hang on that; as
    # anywhere whether one that is as near to two faces takes the area of the one or the other.
    exact = device == "cpu" and tolerance_of(scene) == ROUNDING
    assert_close(found, expected, tolerance_of(scene), outliers=0.0 if exact else 0.001)


@cache
def shown_otherwise() -> set[str]:
    """Return the features of the scenes of methods, and of those of test_law_schedules.py."""
    models = [model_of(name) for name in SCENES]
    return set().union(*map(features, models + [model_of_all(law, "cpu")[0] for law in TESTED]))


@cache
def simulated() -> set[str]:
    """Return the features of the scenes of methods and of the bundled scenes."""
    return shown_otherwise().union(*(features(bundled_model(name)) for name in bundled_scenes()))


@pytest.mark.full
@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_every_method_of_the_table_is_run_in_every_schedule(method: Method):
    assert features(model_with(method.name)) <= simulated()


def test_methods_ask_for_different_things():
    """Methods have distinct features, or the test above would leave some out."""
    assert len({frozenset(features(model_with(method.name))) for method in METHODS}) == len(METHODS)


ASKED_BY_CONTROLS = {"fixtures_steered True"}
"""features that no scene asks for; test_controls.py runs them in every schedule"""


@pytest.mark.full
def test_every_law_and_every_trait_is_run_on_and_off():
    names = {law.name for law in LAWS}
    switched = {f"{name} {value}" for name in switches(Features((), None)) for value in (True, False)}
    assert simulated() | ASKED_BY_CONTROLS >= names | switched | {f"phase {phase.name}" for phase in asking_phases()}


@pytest.mark.full
def test_the_table_in_the_docs_is_what_schedules_say():
    (table,) = re.findall(r"<!-- matrix -->\n\n(.*?)\n\n<!-- end -->", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert table == as_markdown(), "python -m balloon_warp.benchmarks.matrix makes it anew"
