"""Command line of the current run, as it would be typed again."""

import shlex
from collections.abc import Collection

import typer

from balloon_warp.provenance import command_without_folders


def command_line(context: typer.Context, without: Collection[str] = ()) -> str:
    """Write the command as a shell takes it, its arguments and the options given in the order of its help.

    Absolute paths lose their folders: who reads it elsewhere learns nothing from them.

    Args:
        context: of the command.
        without: names of parameters that are left out: those which do not change the result, but its place.
    """
    words = ["balloon-warp", str(context.info_name)]
    for parameter in context.command.params:
        name = str(parameter.name)
        source = context.get_parameter_source(name)
        if source is None or source.name != "COMMANDLINE" or name in without:
            continue
        value = context.params[name]
        for each in value if isinstance(value, list | tuple) else [value]:
            if parameter.param_type_name == "option":
                words.append(max(parameter.opts, key=len))
            if not isinstance(each, bool):
                words.append(str(each))
    return (
        shlex.join(command_without_folders(words)).encode(errors="replace").decode()
    )  # names of files may be no Unicode
