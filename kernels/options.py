"""How Warp compiles kernels on a CPU: options of every module that has some.

All have the same, since Warp compiles its own headers first, once for each set of flags in a process.
"""

import warp as wp

_FLAGS = "-march=native" if wp.config.cpu_compiler_flags is None else wp.config.cpu_compiler_flags
OPTIONS = {"cpu_compiler_flags": f"{_FLAGS} -DWP_NO_BFLOAT16= -fpch-instantiate-templates"}
"""Warp's own flags; without the short floats that no kernel of ours has, a third of its headers' time; and with what is
made of their templates made once, a tenth of each kernel's"""
