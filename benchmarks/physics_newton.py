"""The properties that Newton's own cloth has, too, on it in the same scenes: springs and weight."""
# pyright: reportAttributeAccessIssue=false

import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.benchmarks.newton_peer import add_balloons, import_newton
from balloon_warp.benchmarks.physics_alike import (
    is_alike_mirrored,
    is_alike_moved,
    is_alike_relisted,
    is_alike_turned,
)
from balloon_warp.benchmarks.physics_properties import (
    keeps_angular_momentum,
    keeps_momentum,
    repeats,
    stays_finite,
)
from balloon_warp.benchmarks.physics_runs import STATES, Case, Run, simulated
from balloon_warp.benchmarks.physics_scenes import KINDS, drawn
from balloon_warp.benchmarks.physics_twins import Tables
from balloon_warp.errors import InputError
from balloon_warp.model import Vary, build_model
from balloon_warp.model.state import initial_state
from balloon_warp.scene import Scene

SHARED = (
    stays_finite, repeats, keeps_momentum, keeps_angular_momentum, is_alike_turned, is_alike_mirrored, is_alike_moved,
    is_alike_relisted,
)  # fmt: skip
SOLVERS = ("SolverSemiImplicit", "SolverVBD")


def compared_with_newton(seconds: float, number: int, device: str) -> str:
    """Return a table of how many scenes hold to each property here and in Newton's solvers."""
    held: Counter[tuple[str, str]] = Counter()
    asked: Counter[tuple[str, str]] = Counter()
    runners: dict[str, Callable[..., Run]] = {"balloon-warp": simulated}
    runners |= {solver: partial(simulated_by_newton, solver) for solver in SOLVERS}
    end = time.monotonic() + seconds

    def count(tables: Tables) -> None:
        for balloon in tables["balloon"]:  # which Newton has not
            balloon["inflation"]["pressure"] = balloon["stiffness"]["viscosity"] = 0.0
        for name, simulate in runners.items():
            case = Case(tables, device, simulate)
            for holds in SHARED:
                try:
                    measure = holds(case)
                except InputError:
                    continue
                if measure:
                    asked[name, holds.__name__] += 1
                    held[name, holds.__name__] += measure.holds

    while time.monotonic() < end:
        drawn(KINDS["springs"], 5, number, count)
        number += 1
    rows = [["property", *runners], ["---"] * (1 + len(runners))]
    for holds in SHARED:
        keys = [(name, holds.__name__) for name in runners]
        rows.append([holds.__name__.replace("_", " "), *(f"{held[key]:,} of {asked[key]:,}" for key in keys)])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def simulated_by_newton(
    solver_name: str, scene: Scene, device: str, schedule: str = "auto", vary: Vary | None = None
) -> Run:
    """Simulate the balloons of a scene by Newton's springs, with as many substeps.

    Args:
        schedule, vary: as of `simulated`; Newton has one way.

    Raises:
        InputError: the scene is refused.
    """
    newton = import_newton()
    model = build_model(scene, device)
    state = initial_state(model)
    builder: Any = newton.ModelBuilder(up_axis=scene.up_axis, gravity=tuple(-scene.gravity * axis for axis in scene.up))
    add_balloons(builder, model)
    if solver_name == "SolverVBD":
        builder.color()
    built = builder.finalize(device=model.device)
    built.particle_grid = None
    now, after = built.state(), built.state()
    wp.copy(now.particle_q, state.points.flatten())
    wp.copy(now.particle_qd, state.velocities.flatten())
    solver, control = getattr(newton.solvers, solver_name)(built), built.control()
    states: dict[str, list] = {name: [] for name in STATES}

    def note() -> None:
        for name in states:
            states[name].append(np.array(getattr(state, name).numpy()[0], dtype=np.float64))
        states["points"][-1] = np.array(now.particle_q.numpy(), dtype=np.float64)
        states["velocities"][-1] = np.array(now.particle_qd.numpy(), dtype=np.float64)

    note()
    for _ in range(scene.frames):
        for _ in range(model.substeps):
            solver.step(now, after, control, None, model.step_seconds)
            now, after = after, now
        note()
    return Run(model, {name: np.array(kept) for name, kept in states.items()}, None)
