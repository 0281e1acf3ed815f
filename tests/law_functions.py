"""Functions of Warp called for many samples, their slopes by Warp's adjoint and by differences."""

import inspect
import linecache
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels import OPTIONS

COUNT = 64
"""of samples"""
STEP = 0.01
"""of differences, over the size of the moved argument: of the fourth order, they are off by some STEP^4 = 1e-8, and by
a float32's 1e-7 / STEP = 1e-5, of the function's size over the argument's"""
Samples = Mapping[str, NDArray]
"""by argument, shape (COUNT,) or (COUNT, size)"""

LAWS = wp.get_module("laws")
"""Module of the kernels that call small functions, of whatever file of tests: it compiles once"""
TYPES = {1: wp.float32, 3: wp.vec3, 4: wp.vec4}
"""by the count of numbers"""
kernels: dict[Any, Any] = {}
"""that call functions"""


def compile_together(results: Mapping[Any, str], module: Any = LAWS) -> None:
    """Put the kernels that call functions into one module, which compiles once, by the functions' types of results."""
    kernels.update({function: _kernel(function, result, module) for function, result in results.items()})


def _kernel(function: Any, result: str, module: Any) -> Any:
    """Return the kernel that calls a function for each sample."""
    module.options |= OPTIONS | {"enable_backward": True}
    types = {f"{name}_": wp.array[kind] for name, kind in function.input_types.items()}
    name, call = f"call_{function.key.rpartition('.')[2]}", ", ".join(f"{name}[i]" for name in types)
    source = f"def {name}({', '.join(types)}, out):\n    i = wp.tid()\n    out[i] = function({call})\n"
    filename = f"<{name} {id(function)}>"
    linecache.cache[filename] = (len(source), None, source.splitlines(keepends=True), filename)
    space: dict[str, Any] = {"wp": wp, "function": function}
    exec(compile(source, filename, "exec"), space)
    space[name].__annotations__ = types | {"out": wp.array[getattr(wp, result)]}
    return wp.kernel(space[name], module=module)


def _arrays(samples: Samples, names: Sequence[str], gradients: bool) -> list[wp.array]:
    arrays = []
    for name in names:
        values = samples[name]
        if values.dtype.kind == "i":
            arrays.append(wp.array(values, dtype=wp.int32, device="cpu"))
        else:
            size = values.shape[1] if values.ndim > 1 else 1
            arrays.append(wp.array(values, dtype=TYPES[size], device="cpu", requires_grad=gradients))
    return arrays


def called(function: Any, samples: Samples, result: str = "float32") -> NDArray[np.float64]:
    """Return the results of a function, a row for each sample."""
    out, _ = _launched(function, samples, result, False)
    return out.numpy().astype(np.float64)


def _launched(function: Any, samples: Samples, result: str, gradients: bool) -> tuple[Any, list[wp.array]]:
    inputs = _arrays(samples, list(inspect.signature(function.func).parameters), gradients)
    out = wp.zeros(len(inputs[0]), dtype=getattr(wp, result), device="cpu", requires_grad=gradients)
    if function not in kernels:
        compile_together({function: result}, wp.get_module(f"calls_{function.key}"))
    wp.launch(kernels[function], len(out), [*inputs, out], device="cpu")
    return out, inputs


def difference(
    function: Any, samples: Samples, name: str, axis: int | None = None, result: str = "float32"
) -> NDArray[np.float64]:
    """Return the finite difference of the function by an argument, or by a component of it."""
    size, total = size_of(samples[name]), 0.0
    for steps, weight in ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0)):
        moved = np.array(samples[name], dtype=np.float64)
        moved[... if axis is None else (slice(None), axis)] += steps * STEP * size
        total = total + weight * called(function, {**samples, name: moved.astype(np.float32)}, result)
    return total / (12.0 * STEP * size)


def size_of(values: NDArray) -> float:
    """Return the magnitude of an argument."""
    return float(np.sqrt(np.mean(np.square(values)))) or 1.0


def adjoint(function: Any, samples: Samples, weights: NDArray, result: str) -> dict[str, NDArray[np.float64]]:
    """Return Warp's derivatives of the weighted sum of a function's results, by argument."""
    with wp.Tape() as tape:
        out, inputs = _launched(function, samples, result, True)
    tape.backward(grads={out: wp.array(weights, dtype=out.dtype, device="cpu")})
    names = inspect.signature(function.func).parameters
    return {
        name: array.grad.numpy().astype(np.float64)
        for name, array in zip(names, inputs, strict=True)
        if array.grad is not None
    }


def most_agree(found: NDArray, expected: NDArray, scale: float) -> None:
    """Require that nine samples of ten agree to a thousandth: far above the truncation error of `STEP`, and far below a
    wrong term. The others may have a kink within the difference's stencil."""
    apart = np.abs(found - expected).reshape(COUNT, -1).max(axis=1)
    assert np.mean(apart <= 1e-3 * scale) >= 0.9, (float(np.median(apart)), scale)
