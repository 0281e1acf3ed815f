"""What advances a model: a schedule of explicit steps, or the implicit solver that its scene asks for."""

from balloon_warp.errors import InputError
from balloon_warp.model import Model
from balloon_warp.schedules.choose import Schedule, schedule_named, settled_schedule
from balloon_warp.solvers.projective import ProjectiveSolver


def solver_named(schedule: str, model: Model) -> type[Schedule]:
    """The schedule of that name, or the fastest for the model with "auto"; the scene's implicit solver, which is laid
    out in one way only. Not made yet.

    Raises:
        InputError: there is no such schedule, or the scene's solver has none.
    """
    name = ProjectiveSolver.name
    if model.scene.solver != name:
        return schedule_named(schedule, model)
    if schedule not in ("auto", name):
        raise InputError(f'--schedule {schedule}: is for explicit steps; solver = "{name}" takes auto only')
    return ProjectiveSolver


def settled_solver(schedule: str, model: Model, world_count: int) -> str:
    """`schedule`, with `auto` settled for a batch of that many worlds, of which the model may be any part."""
    if schedule == "auto" and model.scene.solver == ProjectiveSolver.name:
        return ProjectiveSolver.name
    return settled_schedule(schedule, model, world_count)
