"""Solvers that take large steps, beside the explicit steps of the schedules, and the choice of a model's."""

from balloon_warp.errors import InputError
from balloon_warp.model import Model
from balloon_warp.schedules.choose import Schedule, resolved_schedule, schedule_named

PROJECTIVE = "projective"
"""Name of the implicit solver, which loads when first needed"""


def solver_named(schedule: str, model: Model) -> type[Schedule]:
    """Return the schedule of that name, or the fastest for the model with "auto", not made yet.

    Where the scene asks for the implicit solver, it is that one, which is laid out in one way only.

    Raises:
        InputError: there is no such schedule, or the scene's solver has none.
    """
    if model.scene.solver != PROJECTIVE:
        return schedule_named(schedule, model)
    if schedule not in ("auto", PROJECTIVE):
        raise InputError(f'schedule {schedule}: is for explicit steps; solver = "{PROJECTIVE}" needs auto')
    from balloon_warp.solvers.projective import ProjectiveSolver

    return ProjectiveSolver


def resolved_solver(schedule: str, model: Model, world_count: int) -> str:
    """Return `schedule`, with `auto` settled for a batch of that many worlds, of which the model may be any part."""
    if schedule == "auto" and model.scene.solver == PROJECTIVE:
        return PROJECTIVE
    return resolved_schedule(schedule, model, world_count)


__all__ = ["resolved_solver", "solver_named"]
