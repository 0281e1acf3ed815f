"""Command line: all commands, and the report of failures."""

import errno
import signal
import sys
from importlib import metadata
from typing import Annotated

import typer

from balloon_warp.cli.files import check, compare, convert, foil, inspect, remesh, render
from balloon_warp.cli.lab import design, fit
from balloon_warp.cli.machine import bench, doctor, kernel, scenes, warm_up
from balloon_warp.cli.options import Command, UsageError, spread, usage_sentence
from balloon_warp.cli.progress import Console, with_options
from balloon_warp.cli.simulate import batch, run, view
from balloon_warp.errors import BlowUpError, InputError, MissingExtraError, StoppedError, WorkersLostError
from balloon_warp.system.process import OutputLostError, lose_output


def _print_version(wanted: bool) -> None:
    if wanted:
        print(metadata.version("balloon-warp"))
        raise typer.Exit


WRITERS = (run, batch, compare, scenes, remesh, foil, design, fit, render, convert)
"""Commands that choose names of files themselves"""
app = typer.Typer(
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (
    run,
    view,
    batch,
    compare,
    scenes,
    inspect,
    remesh,
    foil,
    design,
    fit,
    render,
    check,
    convert,
    warm_up,
    kernel,
    bench,
    doctor,
):
    app.command(cls=Command)(spread(command, writes=command in WRITERS))


@app.callback()
def balloon_warp(
    version: Annotated[
        bool,
        typer.Option(
            "--version", metavar="", help="Print the version and stop.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Simulate balloons: any mesh in, animated USD out.

    Try `balloon-warp run squirrel_tether --picture`. `balloon-warp COMMAND --help` explains a command.
    """


def main() -> None:
    """Run a command; without one, print the help.

    A user's mistake becomes one sentence on standard error and exit status 2, as does standard output that is full; a
    blow-up or the loss of all workers, 1; Ctrl-C, 130; SIGTERM, 143.
    """
    for stream in (sys.stdout, sys.stderr):
        if reconfigure := getattr(stream, "reconfigure", None):
            reconfigure(errors="backslashreplace")  # a terminal or log that is not UTF-8 loses letters, no work
    signals: list[int] = []

    def stop(number: int, _: object) -> None:
        signals.append(number)
        raise KeyboardInterrupt  # so that half-written files are removed

    heard = [number for number in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, stop) for number in heard}  # a process in the background ignores Ctrl-C
    try:
        status = app(sys.argv[1:] or ["--help"], standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()
    except UsageError as mistake:
        _fail(usage_sentence(mistake, typer.main.get_command(app), sys.argv[1:]), status=2)
    except (InputError, MissingExtraError) as mistake:
        _fail(mistake, status=2)
    except (BlowUpError, WorkersLostError) as failure:
        _fail(failure, status=1)
    except MemoryError as failure:
        _fail(f"memory is exhausted{f' ({failure})' if str(failure) else ''}; less may be asked for", status=1)
    except StoppedError as stopped:
        _fail(stopped, status=128 + (signals or [signal.SIGINT])[0])
    except OutputLostError as lost:
        lose_output()
        if lost.errno == errno.EPIPE:  # whoever read it has enough
            sys.exit(1)
        _fail(f"standard output: cannot be written: {lost.strerror}", status=2)
    else:
        if status == 128 + signal.SIGINT:  # Typer's form of a KeyboardInterrupt
            _fail(f"{sys.argv[1]} was interrupted", status=128 + (signals or [signal.SIGINT])[0])
        sys.exit(status)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _fail(error: Exception | str, status: int) -> None:
    Console(emoji=False, stderr=True, soft_wrap=True, highlight=False).print(
        "[bold red]error:[/]", with_options(str(error)).replace("[", r"\[")
    )
    sys.exit(status)
