"""Solvers that take large steps, beside the explicit steps of the schedules."""

from balloon_warp.solvers.choose import settled_solver, solver_named
from balloon_warp.solvers.projective import ProjectiveSolver

__all__ = ["ProjectiveSolver", "settled_solver", "solver_named"]
