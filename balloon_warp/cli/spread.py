"""Options that several commands share, as one argument of each."""

from collections.abc import Callable
from copy import copy
from dataclasses import MISSING, fields, is_dataclass
from functools import wraps
from inspect import Parameter, signature
from typing import Annotated, Any, get_type_hints

from balloon_warp.cli.options import Force
from balloon_warp.ownership import replacing_any

LISTED_ELSEWHERE = "listed elsewhere"
"""Mark of options that the help of another command lists"""


def spread(command: Callable[..., None], writes: bool = False) -> Callable[..., None]:
    """Return a command as Typer wants it: with every field of a dataclass that it takes as an option of its own.

    Args:
        command: of whose keyword arguments some are dataclasses, whose fields are annotated as options; one that is
            annotated by `LISTED_ELSEWHERE` is not in its help.
        writes: whether it writes files whose names nobody gave, and so has the option `--force`.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: kind for name, kind in get_type_hints(command).items() if is_dataclass(kind)}
    parameters: list[Parameter] = []
    for name, parameter in signature(command).parameters.items():
        if name in groups:
            parameters += _options(groups[name], LISTED_ELSEWHERE in getattr(hints[name], "__metadata__", ()))
        else:
            parameters.append(parameter.replace(annotation=hints[name]))
    if writes:
        parameters.append(Parameter("force", Parameter.KEYWORD_ONLY, default=False, annotation=Force))

    @wraps(command)
    def spread_out(force: bool = False, **given: Any) -> None:
        for name, kind in groups.items():
            given[name] = kind(**{each.name: given.pop(each.name) for each in fields(kind)})
        with replacing_any(force):
            command(**given)

    spread_out.__dict__["__signature__"] = signature(command).replace(parameters=parameters)
    spread_out.__annotations__ = {each.name: each.annotation for each in parameters}
    return spread_out


def _options(group: Any, hidden: bool) -> list[Parameter]:
    hints = get_type_hints(group, include_extras=True)
    if hidden:
        hints = {name: _hidden(hint) for name, hint in hints.items()}
    return [
        Parameter(
            each.name,
            Parameter.KEYWORD_ONLY,
            default=Parameter.empty if each.default is MISSING else each.default,
            annotation=hints[each.name],
        )
        for each in fields(group)
    ]


def _hidden(hint: Any) -> Any:
    option = copy(hint.__metadata__[0])
    option.hidden = True
    return Annotated[hint.__origin__, option]
