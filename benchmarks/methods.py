"""What each method costs beside the paper's step, and what the balloon looks like with it, on one bundled scene:
python -m balloon_warp.benchmarks.methods [DEVICE]"""

import sys
from collections.abc import Callable, Sequence
from statistics import median
from typing import NamedTuple

from balloon_warp.cli.quiet import quiet_warp
from balloon_warp.comparison.run import Run, simulate
from balloon_warp.errors import InputError
from balloon_warp.scene import load_scene
from balloon_warp.scene.overrides import parse_override

SCENE = "squirrel_inflate"
ROUNDS = 3
"""of all methods in turns, so that what else the machine does slows all"""


class Method(NamedTuple):
    """One line of the table."""

    name: str
    overrides: tuple[str, ...] = ()
    """of the scene, over those of `PAPER`"""
    schedule: str = "auto"


PAPER = ("normals=cached", "solver=symplectic_euler")
METHODS = [
    Method("the paper's step"),
    Method("fresh normals", ("normals=fresh",)),
    Method("forward Euler, in as many substeps", ("solver=forward_euler", "substeps=16")),
    Method("viscous springs", ("balloon.stiffness.viscosity=0.0002",)),
    Method("overextended springs stop pulling", ("balloon.stiffness.yield_stretch=2.0",)),
    Method("stiffness that varies", ("balloon.stiffness.variation=0.5",)),
    Method("given pressure", ("balloon.inflation={kind='pressure', pressure=[[0.2, 0.0], [1.7, 370.0]]}",)),
    Method(
        "sealed gas",
        (
            "balloon.helium=0",
            "balloon.inflation={kind='gas', pump=[[0.2, 0.0], [0.3, 2.3], [1.6, 2.3], [1.7, 0.0]]}",
        ),
    ),
    Method("schedule `gather`", schedule="gather"),
    Method("schedule `scatter`", schedule="scatter"),
]


class Row(NamedTuple):
    """A method's figures, at the last frame; None where it blew up."""

    method: Method
    cost: float | None
    """seconds for a simulated second"""
    ratio: float | None
    """cost over that of the first method"""
    substeps: int | None
    volume: float | None
    """[m^3]"""
    stretch: float | None
    """largest length of a spring over its rest length"""
    unrest: float | None
    """kinetic energy of the balloon, whose action is over [J]"""


def measure_methods(
    methods: Sequence[Method] = METHODS,
    device: str | None = None,
    rounds: int = ROUNDS,
    frames: int | None = None,
    on_run: Callable[[Run], None] = lambda run: None,
) -> list[Row]:
    """A row for each method; the first is what the others' cost is compared with.

    Args:
        frames: of the scene; its own when missing.
        on_run: told each run when it is over.

    Raises:
        InputError: a method's run is refused.
    """
    scene = load_scene(SCENE, [parse_override(text) for text in PAPER] + ([("frames", frames)] if frames else []))
    runs: list[list[Run]] = [[] for _ in methods]
    for _ in range(rounds):
        for method, done in zip(methods, runs, strict=True):
            values = dict(parse_override(text) for text in method.overrides)
            done.append(simulate(scene, values, device=device, schedule=method.schedule))
            on_run(done[-1])
    for method, done in zip(methods, runs, strict=True):
        if done[-1].outcome == "refused":
            raise InputError(f"{method.name}: {done[-1].sentence}")
    return [_row(method, done, runs[0], scene.frames_per_second) for method, done in zip(methods, runs, strict=True)]


def _row(method: Method, runs: Sequence[Run], first: Sequence[Run], frames_per_second: float) -> Row:
    figures = runs[-1].figures
    if not figures:
        return Row(method, *[None] * 6)
    seconds = [run.figures["seconds_a_frame"] for run in runs]
    return Row(
        method=method,
        cost=frames_per_second * median(seconds),
        ratio=median(own / other.figures["seconds_a_frame"] for own, other in zip(seconds, first, strict=True)),
        substeps=int(figures["substeps"]),
        volume=figures["volume"],
        stretch=figures["largest_stretch"],
        unrest=figures["kinetic_energy"],
    )


def as_markdown(rows: Sequence[Row]) -> str:
    """The rows as a table of the README."""
    lines = ["| method | cost | substeps | volume [L] | stretch | unrest [mJ] |", "|---|---|---|---|---|---|"]
    for row in rows:
        cells = ["blows up", "-", "-", "-", "-"]
        if row.ratio is not None:
            cells = [f"{row.ratio:.2f}", f"{row.substeps}", f"{1000 * row.volume:.1f}", f"{row.stretch:.2f}"]
            cells.append(f"{1000 * row.unrest:.2g}")
        lines.append(f"| {row.method.name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    quiet_warp()
    rows = measure_methods(device=sys.argv[1] if len(sys.argv) > 1 else None, on_run=_tell)
    print(as_markdown(rows))
    print(f"\nThe first takes {rows[0].cost:.3g} s for a simulated second.")


def _tell(run: Run) -> None:
    print(run.outcome, ", ".join(run.label), file=sys.stderr)


if __name__ == "__main__":
    main()
