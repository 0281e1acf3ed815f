"""Notes of each substep of a frame on its particles' values: a row of words for each substep of each world.

Values that others look at stand in an array of their own. A row has a value's first components side by side, then all
second ones: neighboring threads read neighboring words, and the stride of components is known as a kernel is compiled,
so that one address serves them all. They are a line more apart than particles need: an odd number of lines, so that
they do not all fall into the same few sets of a cache.
"""

from collections.abc import Mapping
from typing import Any

import warp as wp

from balloon_warp.kernels.phase import STATE

WORDS_OF_LINE = 32
"""Words of a line of a GPU's memory"""


class Notes:
    """Places of values in a row.

    Args:
        array: name of the array that holds the rows.
        capacity: particles for which there is room.
        types: numbers and vectors of particles that are noted, by their names.
    """

    def __init__(self, array: str, capacity: int, types: Mapping[str, Any]):
        self._array, self._apart = array, capacity + WORDS_OF_LINE
        self._places: dict[str, tuple[int, int]] = {}
        end = 0
        for name, dtype in types.items():
            size = 1 if dtype is float else 3
            self._places[name] = end, size
            end += size
        self.words = end * self._apart
        """Number of words of a row"""

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def words_of(self, name: str) -> tuple[int, int]:
        """Return where in a row a value's first component begins, and how far apart components are."""
        return self._places[name][0] * self._apart, self._apart

    def read(self, name: str, row: str, place: str = "particle") -> str:
        """Return the text that reads a value of a particle."""
        if name in self:
            return f"{name}_of_{self._array}({self._array}, {row}, {place})"
        array = f"all_{STATE.get(name, name)}"
        return f"vector_in({array}, {row}, {place})" if name in STATE else f"{array}[{row}, {place}]"

    def write(self, name: str, row: str, text: str, place: str = "particle") -> str:
        """Return the statement that notes a value of a particle."""
        if name in self:
            return f"put_{name}_of_{self._array}({self._array}, {row}, {place}, {text})"
        array = f"all_{STATE.get(name, name)}"
        if name in STATE:
            return f"put_vector_in({array}, {row}, {place}, {text})"
        return f"{array}[{row}, {place}] = {text}"

    def names(self) -> dict[str, Any]:
        """Return the functions that such texts refer to."""
        readers = {f"{name}_of_{self._array}": self._reader(*place) for name, place in self._places.items()}
        readers[f"fetch_{self._array}"] = self._fetcher()
        return readers | {f"put_{name}_of_{self._array}": self._writer(*place) for name, place in self._places.items()}

    def _fetcher(self) -> Any:
        lines = -(-self.words // WORDS_OF_LINE)

        line = f"notes.data + (size_t)(unsigned int)row * {self.words}u + {WORDS_OF_LINE} * line"

        @wp.func_native(f"""
        #if defined(__CUDA_ARCH__)
            for (int line = row < 0 ? {lines} : thread; line < {lines}; line += blockDim.x)
                asm volatile("prefetch.global.L2 [%0];" :: "l"({line}));
        #endif
        """)
        def fetch_notes(notes: wp.array2d[float], row: wp.int32, thread: wp.int32):
            """Bring a row nearer that is read later: a line of the memory by each thread."""
            ...

        return fetch_notes

    def _at(self, place: int) -> str:
        begin = f"notes.data + (size_t)(unsigned int)row * {self.words}u + (unsigned int)particle"
        return f"({begin})[{place * self._apart}]"

    def _reader(self, place: int, size: int) -> Any:
        if size == 1:

            @wp.func_native(f"return {self._at(place)};")
            def number_noted(notes: wp.array2d[float], row: wp.int32, particle: wp.int32) -> float:
                """Return a number of a particle."""
                ...

            return number_noted

        parts = ", ".join(self._at(place + part) for part in range(3))

        @wp.func_native(f"return wp::vec_t<3, float>({parts});")
        def vector_noted(notes: wp.array2d[float], row: wp.int32, particle: wp.int32) -> wp.vec3:
            """Return a vector of a particle."""
            ...

        return vector_noted

    def _writer(self, place: int, size: int) -> Any:
        if size == 1:

            @wp.func_native(f"{self._at(place)} = value;")
            def note_number(notes: wp.array2d[float], row: wp.int32, particle: wp.int32, value: float):
                """Note a number of a particle."""
                ...

            return note_number

        @wp.func_native(" ".join(f"{self._at(place + part)} = value[{part}];" for part in range(3)))
        def note_vector(notes: wp.array2d[float], row: wp.int32, particle: wp.int32, value: wp.vec3):
            """Note a vector of a particle."""
            ...

        return note_vector
