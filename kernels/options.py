"""Options by which Warp compiles the kernels of every module with options, for a CPU.

All modules share one set, since Warp compiles its own headers first, once for each set of flags in a process.
"""

import warp as wp
from warp._src import codegen


def _flags() -> str:
    """Return Warp's compiler flags, or those that the user has set, plus flags that keep results bitwise the same.

    - Functions are inlined up to a quarter of what Warp allows: kernels are as fast, and those of free bodies compile
      in two thirds of the time.
    - Vector instructions are made of longer chains of sums and products: eight lanes of rubber run up to 1.5 times as
      fast, and compile as soon.
    - Without the short floats that no kernel of ours has: a third of the headers' time.
    - What is made of the headers' templates is made once: a tenth of each kernel's time.
    """
    flags = "-march=native" if wp.config.cpu_compiler_flags is None else wp.config.cpu_compiler_flags
    flags = flags.replace("-inline-threshold=9000", "-inline-threshold=2500")
    flags = flags.replace("-slp-recursion-max-depth=4", "-slp-recursion-max-depth=8")
    return f"{flags} -DWP_NO_BFLOAT16= -fpch-instantiate-templates"


def _compile_sums_of_structs_on_demand() -> None:
    """Have Warp declare the sums of each struct `inline`, so that they are compiled where a kernel adds structs.

    Otherwise every kernel has those of all tables, which none of ours adds: a third of the time of a small kernel, and
    a sixth of that of a large one.
    """
    for declared in ("CUDA_CALLABLE {name} add(", "CUDA_CALLABLE void adj_atomic_add("):
        codegen.struct_template = codegen.struct_template.replace(f"\n{declared}", f"\ninline {declared}")


_compile_sums_of_structs_on_demand()
OPTIONS = {"cpu_compiler_flags": _flags()}
