"""Usage errors of the command line, in one sentence."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, cast

import typer
from pydantic import ValidationError

from balloon_warp.scene import Scene
from balloon_warp.scene.load import bundled_scenes
from balloon_warp.suggestions import ask, did_you_mean

UsageError = cast("type[Exception]", typer.BadParameter.__base__)
"""Base of Typer's usage errors, whose place differs from version to version"""
ALSO_CALLED = {"duration": "--seconds", "length": "--seconds", "out": "--output", "framerate": "--fps", "rate": "--fps"}
"""Options by names that other programs have for them"""


def usage_sentence(error: Any, program: Any, words: Sequence[str]) -> str:
    """Return a sentence on the error, the expectation, and where to read more.

    Args:
        error: A `UsageError`.
        program: Typer's group of all commands.
        words: Words after the program's name.
    """
    name = words[0] if words[0] in program.commands else ""
    command = program.commands.get(name, program)
    mistake = _mistake(error, command, name or "balloon-warp", words)
    path = f"balloon-warp {name}" if name else "balloon-warp"
    return mistake if mistake.endswith("?") else f"{mistake}; {path} --help explains"


def _mistake(error: Any, command: Any, name: str, words: Sequence[str]) -> str:
    option, parameter = getattr(error, "option_name", None), getattr(error, "param", None)
    if option and hasattr(error, "possibilities"):  # newer versions have some for a command, too
        known = [text for each in command.params for text in each.opts if text.startswith("--")]
        written = next((word for word in words if word.startswith(str(option))), str(option))
        return f"{written}: unknown option of {name}{_option_meant(written, known)}"
    if option:
        metavar = next((each.metavar for each in command.params if option in each.opts), None)
        return f"{option}: has no value; expected {option} {metavar}" if metavar else f"{option}: takes no value"
    if parameter is not None and type(error).__name__ == "MissingParameter":
        return f"{name}: {_called(parameter)} is missing"
    if parameter is not None:
        return f"{_called(parameter)}: {_expected(error)}"
    if extra := re.search(r"unexpected extra .*\((.*)\)", error.message):
        return f"{name}: did not expect {extra[1]}{'; --set goes before PATH=VALUE' if '=' in extra[1] else ''}"
    if unknown := re.match("No such command ['\"](.*?)['\"]", error.message):
        return f"{unknown[1]}: no such command{_command_meant(unknown[1], command.commands)}"
    return error.message.rstrip(".")


def _option_meant(written: str, known: Sequence[str]) -> str:
    """End a sentence with the option that another program calls so, the field of a scene, or a name that is like it."""
    field = written.partition("=")[0].lstrip("-").replace("-", "_")
    if ALSO_CALLED.get(field) in known:
        return ask([ALSO_CALLED[field]])
    if field == "vary":
        return "; `batch` and `compare` have it"
    if field in Scene.model_fields and "--set" in known and f"--{field}" not in known:
        return ask([f"--set {field}="])
    return did_you_mean(written, known)


def _command_meant(word: str, commands: Iterable[str]) -> str:
    if word in bundled_scenes() or Path(word).is_file():
        return ask([f"balloon-warp run {word}"])
    return did_you_mean(word, commands) or f"; commands are {', '.join(commands)}"


def _called(parameter: Any) -> str:
    """Name an option by its long name, an argument by its metavar in the help."""
    if parameter.param_type_name == "argument":
        return parameter.metavar
    return max(parameter.opts, key=len)


def _expected(error: Any) -> str:
    """Return Pydantic's sentence, where newer versions of Typer have it from there, and the value found."""
    message = re.split(", (?:unable|got) ", error.message.rstrip("."))[0].replace("Input should", "must")
    found = error.__cause__.errors()[0]["input"] if isinstance(error.__cause__, ValidationError) else None
    return message if found is None else f"{message} (got {found})"
