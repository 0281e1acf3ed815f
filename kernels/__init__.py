"""Warp kernels and functions: the physics and the ray caster, and nothing else. Imports warp alone.

`OPTIONS` are those by which Warp compiles the kernels of every module with options, for a CPU. All modules share one
set, since Warp compiles its own headers first, once for each set of flags in a process.
"""

from typing import Any

import warp as wp
from warp._src import codegen


def _flags() -> str:
    """Return Warp's compiler flags, or those that the user has set, plus flags that keep results bitwise the same.

    - Functions are inlined up to a quarter of Warp's limit: kernels are as fast, and those of free bodies compile
      in two thirds of the time.
    - Vector instructions are made of longer chains of sums and products: eight lanes of rubber run up to 1.5 times as
      fast, and compile as soon. They are of eight numbers at most, as lanes are: without a limit the compiler
      mixed up rows of lanes in the adjoint of area vectors, and was slower.
    - Without the short floats that no kernel of ours has: a third of the headers' time.
    - The headers' templates are instantiated once: a tenth of each kernel's time.
    """
    flags = "-march=native" if wp.config.cpu_compiler_flags is None else wp.config.cpu_compiler_flags
    flags = flags.replace("-inline-threshold=9000", "-inline-threshold=2500")
    flags = flags.replace("-slp-recursion-max-depth=4", "-slp-recursion-max-depth=8")
    return f"{flags} -mllvm=-slp-max-vf=8 -DWP_NO_BFLOAT16= -fpch-instantiate-templates"


def _leave_out_derivatives_of_structs() -> None:
    """Have Warp write the functions that derive structs so that our flags leave them out, or else compile on demand.

    Otherwise every kernel has those of all tables, which none of ours calls: a third of the time of a small kernel, and
    a sixth of that of a large one. Kernels without our flags keep them.
    """
    template = codegen.struct_template
    for declared in ("CUDA_CALLABLE {name} add(", "CUDA_CALLABLE void adj_atomic_add("):
        template = template.replace(f"\n{declared}", f"\ninline {declared}")
    for body in (_CONSTRUCTOR, _SUM):
        template = template.replace(body, f"#ifndef {NO_DERIVATIVES}\n{body}\n#endif")
    codegen.struct_template = template


NO_DERIVATIVES = "BALLOON_WARP_NO_DERIVATIVES"
"""Macro of kernels that Warp does not derive: all of ours"""
_CONSTRUCTOR = "static CUDA_CALLABLE void adj_{name}({reverse_args})\n{{\n{reverse_body}}}"
_SUM = "inline CUDA_CALLABLE void adj_atomic_add({name}* p, {name} t)\n{{\n{atomic_add_body}}}"
_leave_out_derivatives_of_structs()
OPTIONS: dict[str, Any] = {"cpu_compiler_flags": f"{_flags()} -D{NO_DERIVATIVES}=", "enable_backward": False}
