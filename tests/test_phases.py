"""Lists of phases without any physics, cut into pieces and launched, against NumPy: a missing barrier would be seen."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from feature_sets import feature_set
from meshes import cube, quad_sphere
from toy_phases import KEEPING, LISTS, Values, add, by_numpy, double, follow, halve, heed, look_aside, trade

from balloon_warp import Balloon, InputError, Scene, load_scene
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.schedules.lanes import LOOKS
from balloon_warp.kernels.schedules.launched import GATHERED, SUMMED, source_of
from balloon_warp.kernels.schedules.writer import Step, cut
from balloon_warp.kernels.substep import PROJECTIVE_STEP, READING, STEP, phases_of
from balloon_warp.model import Model, State, build_model, initial_state
from balloon_warp.model.state import Allocating
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.lanes import LanesSchedule, OctetsSchedule
from balloon_warp.schedules.launched import Launches
from balloon_warp.schedules.tables import make_tables
from balloon_warp.tools.doctor import kernel_source

DOCS = Path(__file__).parent.parent / "docs"


@pytest.fixture(scope="module", params=["small", "large"])
def model(request: pytest.FixtureRequest) -> Model:
    """Return balloons of 26 and 8 particles, or one so large that it is summed in parts."""
    meshes = [quad_sphere(2), cube()] if request.param == "small" else [cube(), quad_sphere(19)]
    return build_model(Scene(balloon=[Balloon(mesh=mesh) for mesh in meshes], touch=False), "cpu", 3)


def at_random(model: Model) -> tuple[State, Values]:
    """Return a random state of worlds that differ, and its values."""
    rng = np.random.default_rng(2)
    shape = (model.world_count, model.particle_count, 3)
    have: Values = {name: rng.uniform(-1.0, 1.0, shape).astype(np.float32) for name in ("point", "velocity")}
    state = initial_state(model)
    state.points, state.velocities = (wp.array(each, dtype=wp.vec3, device="cpu") for each in have.values())
    have |= {"trace": np.full(shape[:2], 1.0), "height": np.full((shape[0], model.face_count), 2.0)}
    state.kept = {name: wp.array(have[name], dtype=wp.float32, device="cpu") for name in ("trace", "height")}
    return state, {name: each.astype(np.float64) for name, each in have.items()}


def features_of(model: Model) -> Features:
    """Return features of a model with state for these phases."""
    return model_features(model)._replace(keeps=tuple(kept for each in KEEPING for kept in each.kept))


def assert_done(
    phases: Sequence[Phase], model: Model, have: Values, now: Sequence[wp.array], kept: dict[str, wp.array]
) -> None:
    """Require the result of three substeps of the phases."""
    first = model.face_particles.numpy()[model.face_offsets.numpy()[:-1]]
    for _ in range(3):
        for each in phases:
            if not each.light:
                by_numpy(each.name, have, np.asarray(model.particle_offsets), first)
    for found, name in zip((*now, *kept.values()), ("point", "velocity", *kept), strict=True):
        size = np.abs(have[name]).max()
        np.testing.assert_allclose(found.numpy(), have[name], atol=4e-6 * size)  # float32, sums of thousands among them


@pytest.mark.full
@pytest.mark.parametrize("doubles", [True, False], ids=["two places", "barriers"])
@pytest.mark.parametrize("phases", LISTS, ids=lambda phases: " ".join(each.name for each in phases))
def test_a_list_does_what_its_phases_do_one_after_the_other(phases, doubles, model):
    features = features_of(model)
    step = cut(phases, features, GATHERED, doubles=doubles)
    assert doubles or not step.doubled
    state, have = at_random(model)
    launches, now = Launches(model, step, make_tables(model, features), Allocating(model.device)), None
    for substep in range(3):
        now = launches.substep(state, substep, now or (state.points, state.velocities))
    assert now is not None
    assert_done(phases, model, have, now, state.kept)


@pytest.mark.full
@pytest.mark.parametrize("schedule", [LanesSchedule, OctetsSchedule], ids=["lanes", "octets"])
@pytest.mark.parametrize("phases", LISTS, ids=lambda phases: " ".join(each.name for each in phases))
def test_eight_side_by_side_do_the_same(phases, schedule, model):

    class OfPhases(schedule):
        @classmethod
        def step_of(cls, features: Features) -> Step:
            return cut(phases, features_of(model), LOOKS[cls.layout], sums_along=True)

    state, have = at_random(model)
    of_phases = OfPhases(model)
    of_phases.tables.substeps = 3
    of_phases.advance_frame(state)
    assert_done(phases, model, have, (state.points, state.velocities), state.kept)


def test_what_nothing_writes_is_refused_by_name(model):
    with pytest.raises(TypeError, match="a phase reads seen, which nothing before it writes"):
        source_of(cut((follow,), model_features(model), GATHERED))


def test_a_phase_that_looks_at_what_others_have_moved_waits_for_them(model):
    def names(phases: Sequence[Phase], **how: Any) -> list[list[str]]:
        step = cut(phases, model_features(model), GATHERED, **how)
        return [[each.name for each in piece.phases] for piece in step.pieces]

    assert names((look_aside, follow)) == [["look_aside", "follow"]]
    assert names((look_aside, follow), doubles=False) == [["look_aside"], ["follow"]]
    assert names((trade, look_aside, follow)) == [["trade"], ["look_aside", "follow"]]
    assert names((look_aside, follow), apart=("follow",)) == [["look_aside"], ["follow"]]
    assert names((add, halve, double, heed)) == [["add", "halve"], ["heed"]]


def test_phases_of_a_step_have_names_of_their_own():
    for step in (STEP, READING, PROJECTIVE_STEP):
        names = [each.name for each in step]
        assert len(names) == len(set(names))


def test_a_scene_has_in_its_source_only_what_it_needs():
    model = build_model(Scene(balloon=[Balloon(mesh=cube())]), "cpu")
    features = model_features(model)
    source = source_of(cut(phases_of(features), features, GATHERED))
    assert "leave" not in source
    assert "pull(" in source
    scattered = source_of(cut(phases_of(features), features, SUMMED, doubles=False))
    assert "points" not in scattered.partition("force, area_vector")[2].partition(")")[0]


def code_blocks(page: Path) -> list[str]:
    """Return the blocks of Python on a page of the docs."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M)


def test_the_source_in_the_docs_is_the_one_that_is_printed():
    for begins, scene, schedule in (
        ("def particles_inflate_to_leave(", "latex_inflate", "gather"),
        ("        for particle in", "squirrel_tether", "block"),
    ):
        (shown,) = (text for text in code_blocks(DOCS / "ARCHITECTURE.md") if text.startswith(begins))
        assert shown in kernel_source(load_scene(scene), schedule)


def test_a_source_has_its_phases_in_the_order_of_the_list():
    for schedule in ("gather", "scatter", "block", "lanes", "octets"):
        printed = kernel_source(feature_set("all"), schedule)
        called = [each.name for each in STEP if not each.light and re.search(rf"\b{each.name}\(", printed)]
        assert len(called) > 10
        places = [re.search(rf"\b{name}\(", printed) for name in called]
        assert [place.start() for place in places if place] == sorted(place.start() for place in places if place)


@pytest.mark.full
def test_octets_of_a_model_with_bodies_are_launches_and_their_forces_for_eight():
    """Kernels are those that `gather` launches, in the same order, but for the forces."""
    printed, launched = (kernel_source(load_scene("turtle_pillow"), schedule) for schedule in ("octets", "gather"))
    kernels = re.findall(r"^def (\w+)\(", printed, re.M)
    assert kernels.count("pull_octets") == 1
    assert kernels.index("worlds_tumble") < kernels.index("pull_octets") < kernels.index("worlds_meet")
    assert "pull_octets" not in launched
    assert printed[printed.index("def worlds_meet(") :] in launched


def test_who_has_no_kernels_is_refused():
    with pytest.raises(InputError, match="schedule weave: no such schedule"):
        kernel_source(load_scene("latex_inflate"), "weave")
