"""The commands, and what happens when one fails."""

import signal
import sys
from importlib import metadata
from typing import Annotated

import typer
from rich.console import Console

from balloon_warp.cli.batch import batch
from balloon_warp.cli.bench import bench
from balloon_warp.cli.compare import compare
from balloon_warp.cli.inspect import inspect
from balloon_warp.cli.remesh import remesh
from balloon_warp.cli.render import render
from balloon_warp.cli.run import run
from balloon_warp.cli.scenes import scenes
from balloon_warp.cli.view import view
from balloon_warp.errors import BlowUpError, InputError, MissingExtraError, StoppedError, WorkersLostError


def _print_version(wanted: bool) -> None:
    if wanted:
        print(metadata.version("balloon-warp"))
        raise typer.Exit


app = typer.Typer(
    help="Simulate balloons: any mesh in, animated USD out.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (run, view, batch, compare, scenes, inspect, remesh, render, bench):
    app.command()(command)


@app.callback()
def balloon_warp(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and stop.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Simulate balloons: any mesh in, animated USD out."""


def main() -> None:
    """Run a command. A user's mistake becomes one sentence on standard error and exit status 2; a blow-up
    or the loss of all workers, 1; Ctrl-C, 130; SIGTERM, 143."""
    terminations: list[int] = []

    def terminate(number: int, _: object) -> None:
        terminations.append(number)
        raise KeyboardInterrupt  # so that half-written files are removed

    signal.signal(signal.SIGTERM, terminate)
    try:
        app()
    except (InputError, MissingExtraError) as mistake:
        _fail(mistake, status=2)
    except (BlowUpError, WorkersLostError) as failure:
        _fail(failure, status=1)
    except StoppedError as stop:
        _fail(stop, status=128 + (terminations or [signal.SIGINT])[0])
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _fail(error: Exception, status: int) -> None:
    Console(stderr=True, soft_wrap=True, highlight=False).print("[bold red]error:[/]", str(error).replace("[", r"\["))
    sys.exit(status)
