"""`balloon-warp bench`"""

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from balloon_warp.cli.quiet import quiet_warp


def bench(
    device: Annotated[str | None, typer.Option(help="cpu, cuda:0, ...; the GPU if there is one.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A few cases only.")] = False,
    output: Annotated[Path | None, typer.Option("--json", help="Write the results to this file, too.")] = None,
) -> None:
    """Measure how fast the schedules are, side by side with Newton where it is installed."""
    quiet_warp()
    from balloon_warp.benchmarks.run import run_cases
    from balloon_warp.device import pick_device

    console = Console(highlight=False)
    results = []
    for result in run_cases(pick_device(device), quick):
        console.print(f"{result.case} ({result.schedule}): {result.rate:.3g}", style="dim")
        results.append(result)
    table = Table(box=None, pad_edge=False)
    for header in ("case", "schedule", "particle-substeps/s", "Newton", "ratio", "of the bound"):
        table.add_column(header, justify="left" if header in ("case", "schedule") else "right")
    for result in results:
        table.add_row(
            result.case,
            result.schedule,
            f"{result.rate:.3g}",
            f"{result.peer_rate:.3g}" if result.peer_rate else "-",
            f"{result.ratio:.1f}" if result.ratio else "-",
            f"{result.bound_fraction:.0%}" if result.bound_fraction else "-",
        )
    console.print(table)
    if output:
        output.write_text(json.dumps([result.as_json() for result in results], indent=1) + "\n", encoding="utf-8")
