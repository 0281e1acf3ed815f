"""Solvers that take large steps, beside the explicit steps of the schedules."""

from balloon_warp.solvers.choose import settled_solver, solver_named

__all__ = ["settled_solver", "solver_named"]
