"""Derivatives of functions that are called by others, wherever Warp meets them first.

`wp.grad` asks for the adjoint of a function, and Warp asks for those of its callees as it reads it. But it reads each
function once. A function that it has read before, for a call without derivatives, is not read again, and the
helpers of that helper stay without adjoints: their derivatives are then 0, silently. Here they are requested, once all
has been read. Callers of a function with a `wp.grad` in it are written after that, as if they had one themselves.
"""

from collections.abc import Callable
from typing import Any

HOOK = "_propagate_used_by_backward_kernel"
"""Method of Warp's that runs between reading and writing; it does the same for kernels with a backward pass"""


def derive_helpers() -> None:
    """Make Warp ask for the adjoints of all helpers."""
    from warp._src.context import ModuleBuilder

    before = getattr(ModuleBuilder, HOOK)
    if before.__name__ != _and_helpers.__name__:
        setattr(ModuleBuilder, HOOK, _and_helpers(before))


def _and_helpers(before: Callable[[Any], None]) -> Callable[[Any], None]:
    def propagate(builder: Any) -> None:
        before(builder)
        for function in builder.functions:  # callees come first
            if any(each.adj.uses_grad_call for each in function.adj.called_user_functions):
                function.adj.uses_grad_call = True
        asked = [function.adj for function in builder.functions if function.adj.force_adjoint_codegen]
        while asked:
            for helper in asked.pop().called_user_functions:
                if not helper.adj.force_adjoint_codegen:
                    helper.adj.force_adjoint_codegen = True
                    asked.append(helper.adj)

    propagate.__name__ = _and_helpers.__name__
    return propagate
