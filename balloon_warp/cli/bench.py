"""The command `balloon-warp bench`."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich import box
from rich.table import Table

from balloon_warp.cli.options import OUTPUT, Device, Json
from balloon_warp.cli.progress import Console
from balloon_warp.errors import InputError
from balloon_warp.warp_logging import quiet_warp

if TYPE_CHECKING:
    from balloon_warp.benchmarks.result import Result

FILE_WIDTH = 200
"""Width of the table where standard output is no terminal [columns]"""


def bench(
    device: Device = None,
    quick: Annotated[bool, typer.Option("--quick", metavar="", help="Measure a few cases only.")] = False,
    scenes: Annotated[
        bool,
        typer.Option(
            "--scenes", metavar="", help="Measure the bundled scenes instead, in each schedule, alone and in batches."
        ),
    ] = False,
    gpus: Annotated[
        str | None,
        typer.Option(metavar="1,2,4", help="Measure scaling with these numbers of GPUs instead, 8,192 balloons each."),
    ] = None,
    workers: Annotated[
        str | None,
        typer.Option(metavar="1,2", help="Measure scaling with these numbers of processes instead, 64 balloons each."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="Also write the results, to this .json file.", rich_help_panel=OUTPUT
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Benchmark the machine, side by side with Newton and Blender's cloth where they are installed.

    The table is Markdown. Rates are in particle-substeps a second, unless the case names another unit.
    """
    quiet_warp()
    from balloon_warp.benchmarks.auto import scene_results
    from balloon_warp.benchmarks.run import run_cases
    from balloon_warp.benchmarks.scaling import CPU_SHARE, GPU_SHARES, measure_scaling
    from balloon_warp.device import pick_device
    from balloon_warp.files import check_writable, whole_file

    if output:
        check_writable(output, (".json",))
    if sum(choice is not None for choice in (device, gpus, workers)) > 1:
        raise InputError("--device, --gpus, --workers: expected only one of them")
    if sum((quick, scenes, bool(gpus or workers))) > 1:
        raise InputError("--quick, --scenes, and --gpus or --workers: expected only one of them")
    if gpus or workers:
        counts = _counts(gpus or workers or "")
        measured = (
            result for share in (GPU_SHARES if gpus else [CPU_SHARE]) for result in measure_scaling(share, counts)
        )
    else:
        measured = scene_results(pick_device(device)) if scenes else run_cases(pick_device(device), quick)
    progress = Console(emoji=False, stderr=True, highlight=False)
    results = []
    for result in measured:
        progress.print(f"{result.case} ({result.schedule}): {result.rate:.3g}", style="dim", markup=False)
        results.append(result)
    written = json.dumps([result.as_json() for result in results], indent=1)
    if as_json:
        print(written)
    else:
        _print_table(results)
    if output:
        with whole_file(output) as file:
            file.write_text(f"{written}\n", encoding="utf-8")


def _print_table(results: Sequence["Result"]) -> None:
    """Print a line for each case, as Markdown."""
    table = Table(box=box.MARKDOWN)
    for header in (
        "case",
        "schedule",
        "worlds",
        "particles",
        "rate",
        "peer",
        "its rate",
        "ratio",
        "of the bound",
        "overlap",
    ):
        table.add_column(header, justify="left" if header in ("case", "schedule", "peer") else "right", no_wrap=True)
    for result in results:
        table.add_row(
            result.case.replace("[", r"\["),
            result.schedule,
            f"{result.worlds:,}",
            f"{result.particles:,}",
            f"{result.rate:.3g}",
            result.peer or "-",
            f"{result.peer_rate:.3g}" if result.peer_rate else "-",
            f"{result.ratio:.3g}" if result.ratio else "-",
            f"{result.bound_fraction:.0%}" if result.bound_fraction else "-",
            " / ".join(f"{each:.1%}" for each in (result.overlap, result.peer_overlap) if each is not None) or "-",
        )
    console = Console(emoji=False, highlight=False)
    (console if console.is_terminal else Console(emoji=False, highlight=False, width=FILE_WIDTH)).print(table)


def _counts(text: str) -> list[int]:
    """Read the numbers of `1,2,4`."""
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise InputError(f"--gpus, --workers: expected numbers such as 1,2,4 (got {text})") from None
