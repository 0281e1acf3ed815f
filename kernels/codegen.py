"""Code generation: functions of Warp from text."""

import linecache
from collections.abc import Mapping
from typing import Any

import warp as wp


def function_from(name: str, source: str, names: Mapping[str, Any]) -> Any:
    """Return a `wp.func` of a text, which Warp reads again by the file that is noted for it.

    Args:
        names: objects that the text may refer to, by name.
    """
    return wp.func(_read(name, source, names))


def _read(name: str, source: str, names: Mapping[str, Any]) -> Any:
    """Return the function of a text."""
    filename = f"<balloon_warp {name} {hash(source):x}>"
    linecache.cache[filename] = (len(source), None, source.splitlines(keepends=True), filename)
    space = {"wp": wp, "Any": Any, **names}
    exec(compile(source, filename, "exec"), space)
    return space[name]


def kernel_from(name: str, source: str, names: Mapping[str, Any], **options: Any) -> Any:
    """Return a kernel of a text, in a module of its own.

    Args:
        names: objects that the text may refer to, by name.
        options: of `wp.kernel`.
    """
    return wp.kernel(_read(name, source, names), module="unique", enable_backward=False, **options)
