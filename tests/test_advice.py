"""Stability limit of the step, and the particle that sets it."""

import numpy as np
import pytest
from batches import stop_after
from meshes import quad_sphere, torus

from balloon_warp import Balloon, InputError, PolygonMesh, Scene, Stiffness, String, advise_step, animate, build_springs
from balloon_warp.model import plan_model


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
