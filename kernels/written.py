"""Functions of Warp that are written out by the program: a text becomes one."""

import linecache
from collections.abc import Mapping
from typing import Any

import warp as wp


def function_from(name: str, source: str, names: Mapping[str, Any]) -> Any:
    """A `wp.func` of a text, which Warp reads again by the file that is noted for it.

    Args:
        names: what the text may refer to.
    """
    filename = f"<balloon_warp {name} {hash(source):x}>"
    linecache.cache[filename] = (len(source), None, source.splitlines(keepends=True), filename)
    space = {"wp": wp, "Any": Any, **names}
    exec(compile(source, filename, "exec"), space)
    return wp.func(space[name])
