"""The reference of the commands, made of the command line itself."""

from typing import Any

import typer

from balloon_warp.cli.app import app


def command_reference() -> str:
    """Return a section a command: its help, its arguments and its options."""
    commands = typer.main.get_command(app).commands  # pyright: ignore[reportAttributeAccessIssue]
    return "## Every option\n\n" + "\n\n".join(_section(name, command) for name, command in commands.items())


def _section(name: str, command: Any) -> str:
    rows = [_row(parameter) for parameter in command.params if parameter.name != "help"]
    table = "\n".join(["| | | default |", "|---|---|---|", *rows])
    arguments = " ".join(each.metavar for each in command.params if each.param_type_name == "argument")
    usage = f"balloon-warp {name} {arguments} [OPTIONS]".replace("  ", " ")
    return f"### balloon-warp {name}\n\n```sh\n{usage}\n```\n\n{command.help}\n\n{table}"


def _row(parameter: Any) -> str:
    """Return the row of an option, with all of its names."""
    if parameter.param_type_name == "argument":
        names = f"`{parameter.metavar}`"
    else:
        names = " ".join(filter(None, [", ".join(f"`{text}`" for text in parameter.opts), _value(parameter)]))
    default = parameter.default
    shown = "must be given" if parameter.required else "" if default in (None, False, "") else f"`{default}`"
    return f"| {names} | {_cell(parameter.help)} | {shown} |"


def _value(parameter: Any) -> str:
    return f"`{_cell(parameter.metavar)}`" if parameter.metavar else ""


def _cell(text: str | None) -> str:
    return (text or "").replace("|", "\\|")
