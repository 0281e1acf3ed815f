"""Results of measurements: a file a command, with the day, the machine and the table that it printed.

    python -m balloon_warp.benchmarks.results               writes RESULTS.md of all files
    python -m balloon_warp.benchmarks.results cpu health    first runs the commands of these again, here and now

In the project's folder.
"""

import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any

from balloon_warp.errors import InputError

FOLDER = Path("benchmarks/results")
INTRODUCTION = FOLDER / "introduction.md"
PAGE = Path("benchmarks/RESULTS.md")


@dataclass(frozen=True)
class Measurement:
    """A command, and its output on a day."""

    title: str
    measured: date
    machine: str
    command: str
    """as a shell takes it"""
    table: str
    """Markdown's"""
    says: str = ""
    """meaning of the table, and notes on it"""


def read(path: Path) -> Measurement:
    """Read a measurement from its file."""
    told = tomllib.loads(path.read_text(encoding="utf-8"))
    fields: dict[str, Any] = {name: value.strip() if isinstance(value, str) else value for name, value in told.items()}
    return Measurement(**fields)


def as_toml(measurement: Measurement) -> str:
    """Write a measurement as its file has it."""
    lines = [f'title = "{measurement.title}"', f"measured = {measurement.measured}"]
    lines += [f'machine = "{measurement.machine}"', f"command = '{measurement.command}'"]
    if measurement.says:
        lines.append(f"says = '''\n{measurement.says}\n'''")
    return "\n".join([*lines, f"table = '''\n{measurement.table}\n'''"]) + "\n"


def as_markdown(measurements: Iterable[Measurement]) -> str:
    """Write the page of all measurements."""
    introduction = INTRODUCTION.read_text(encoding="utf-8").strip()
    return "\n\n".join([introduction, *map(_section, measurements)]) + "\n"


def _section(measurement: Measurement) -> str:
    where = f"{measurement.machine}, {measurement.measured:%d %B %Y}: `{measurement.command}`".lstrip("0")
    return "\n\n".join(filter(None, [f"## {measurement.title}", where, measurement.table, measurement.says]))


def again(measurement: Measurement) -> Measurement:
    """Run the command of a measurement on this machine.

    Raises:
        InputError: the command fails, or prints no table.
    """
    words = shlex.split(measurement.command)
    words = [sys.executable, *words[1:]] if words[0] == "python" else [sys.executable, "-m", *_as_module(words)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    table = "\n".join(line.strip() for line in done.stdout.splitlines() if line.lstrip().startswith("|"))
    if done.returncode or not table:
        raise InputError(f"{measurement.command}: expected a table (status {done.returncode})\n{done.stderr[-2000:]}")
    return replace(measurement, measured=date.today(), machine=_machine(measurement.command), table=table)


def _as_module(words: Sequence[str]) -> list[str]:
    return [words[0].replace("-", "_"), *words[1:]]


def _machine(command: str) -> str:
    """Name the device that a command runs on."""
    import warp as wp

    device = wp.get_device("cuda:0" if "cuda" in command or "--gpus" in command else "cpu")
    name = " ".join(device.name.split())
    return f"One {name}" if device.is_cuda else f"A CPU, {name}"


def files() -> dict[str, Path]:
    """Find the files of measurements in their order, by name."""
    return {path.stem.partition("_")[2]: path for path in sorted(FOLDER.glob("*.toml"))}


def main(names: Sequence[str] | None = None) -> None:
    """Measure some again, and write the page of all."""
    found = files()
    for name in sys.argv[1:] if names is None else names:
        if name not in found:
            raise InputError(f"{name}: there is no such measurement; expected one of {', '.join(found)}")
        found[name].write_text(as_toml(again(read(found[name]))), encoding="utf-8")
    PAGE.write_text(as_markdown(map(read, found.values())), encoding="utf-8")


if __name__ == "__main__":
    main()
