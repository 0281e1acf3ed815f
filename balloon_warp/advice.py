"""Stable step of a scene's springs, and the particle that limits it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

from balloon_warp.arguments import checked
from balloon_warp.kernels.laws import Law
from balloon_warp.model.many_substeps import many_substeps_said
from balloon_warp.model.plan import plan_model
from balloon_warp.model.stability import Network
from balloon_warp.model.strain_bound import strain_bound_said
from balloon_warp.model.unit_checks import doubts_about
from balloon_warp.scene import SceneLike, scene_of
from balloon_warp.scene.overrides import override_scene


@dataclass(frozen=True)
class StepAdvice:
    """The step part of `balloon-warp inspect`; its fields are keys of the JSON."""

    solver: str
    """Solver of the scene; "projective" is stable at any step, so that the limits are those of symplectic Euler"""
    stable_step: float
    """Longest stable step at the start [s], by the highest frequency of springs and masses"""
    least_substeps: int
    """Number of substeps in a frame at that step"""
    substeps: int
    """Number of substeps in a frame that "auto" chooses: with a margin, and for all changes during the simulation"""
    frames_per_second: float
    limiting_balloon: str
    """Balloon that needs the shortest step"""
    limiting_particle: int
    """Particle of that balloon whose springs are the stiffest for its mass, by the order of the file's vertices,
    counted from 0"""
    limiting_place: tuple[float, float, float]
    """Position of that particle at the start [m]"""
    limiting_body: int | None
    """Free body that needs that step instead, by the strings that are tied to it, by its index in the scene"""
    many_substeps: str | None
    """Sentence on the cause of many substeps of a mesh by itself, and its remedy; None if there are few"""
    strain_bound: str | None
    """Sentence on film that is softer than its material, and the substeps that this spares; None without such film"""
    doubts: tuple[str, ...]
    """Warnings of values that may be in another unit than intended, and of axes, as sentences"""


@checked
def advise_step(scene: SceneLike, laws: Sequence[Law] = ()) -> StepAdvice:
    """Find the stable step of a scene, even if the scene itself asks for too few substeps.

    Args:
        laws: User-defined laws beside the built-in ones, which count where they have bounds.

    Raises:
        InputError: the scene's meshes or particles are wrong, or no step would do.
    """
    scene = scene_of(scene)
    plan = plan_model(override_scene(scene, [("substeps", "auto")]), laws=laws)
    network = Network(plan.shapes, plan.held, plan.laws, plan.bodies)
    step = network.stable_step(plan.scene, plan.parameters)
    balloon, particle = network.limiting_particle(plan.scene, plan.parameters)
    shape = plan.shapes[balloon]
    x, y, z = shape.mesh.points[particle].tolist()
    return StepAdvice(
        solver=scene.solver,
        stable_step=step,
        least_substeps=max(ceil(1.0 / scene.frames_per_second / step), 1),
        substeps=plan.substeps,
        frames_per_second=scene.frames_per_second,
        limiting_balloon=shape.name,
        limiting_particle=particle,
        limiting_place=(x, y, z),
        limiting_body=network.limiting_body(plan.scene, plan.parameters),
        many_substeps=many_substeps_said(plan.scene, plan.shapes, plan.substeps),
        strain_bound=strain_bound_said(plan),
        doubts=tuple(doubts_about(plan.scene, plan.shapes, plan.parameters)),
    )
