"""Arrays in files: as decimal text, in .npz, in HDF5.

Many float32 as decimal text at once: the text that `"%.9g" % value` gives, and so the same number when it is read.

A number x of the decimal exponent e has the nine digits round(x 10^(8 - e)). In float64 that power is exact where e is
from `LEAST` to `MOST`, and the product is rounded once, by less than 1e-7: only next to a half could that change a
digit. Such numbers, and those of other exponents, are written one by one.
"""

import zipfile
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import MissingExtraError

WIDTH = 15
"""Largest number of characters of a number"""
PAD = 0xFF
"""Padding: a byte that no text has"""
LEAST, MOST = -14, 30
"""Decimal exponents whose powers of ten, 10^22 at most, float64 has exactly"""
_POINT, _NOUGHT, _E, _SIGN_OF_EXPONENT, _TENS, _UNITS, _NOTHING, _SIGN = range(9, 17)
"""Places behind the nine digits of a number, in the row that its characters are taken from"""


def decimals(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the text of each number as ASCII, with `PAD` wherever nothing stands, shape (*values.shape, WIDTH)."""
    flat = np.ascontiguousarray(values, dtype=np.float32).reshape(-1)
    bits = flat.view(np.uint32)
    with np.errstate(invalid="ignore"):  # a NaN
        size = np.abs(flat).astype(np.float64)
    index = _INDEX_OF_POWER[(bits >> 23) & 0xFF]
    index += size >= _NEXT_TENS[index]
    nought = size == 0.0
    alone = ((index == 0) | (index == len(_NEXT_TENS) - 1)) & ~nought
    size[alone] = 0.0
    scaled = size * _FACTORS[index] / _DIVISORS[index]
    alone |= np.abs(scaled - np.floor(scaled) - 0.5) < 1e-6
    digits = np.rint(scaled).astype(np.uint32)
    carried = digits == 10**9
    digits[carried] = 10**8
    text = _lay_out(digits, np.where(nought | alone, 0, index + (LEAST - 1) + carried), bits >> 31)
    for number in np.flatnonzero(alone).tolist():
        word = b"%.9g" % flat[number]
        text[number] = PAD
        text[number, : len(word)] = np.frombuffer(word, dtype=np.uint8)
    return text.reshape(*values.shape, WIDTH)


def _lay_out(digits: NDArray[np.uint32], exponent: NDArray[np.int64], sign: NDArray[np.integer]) -> NDArray[np.uint8]:
    """Return Args: nine digits as one number, the exponent of the first, and 1 for a minus; each of shape (N,)."""
    high, rest = np.divmod(digits, np.uint32(10**6))
    middle, low = np.divmod(rest, np.uint32(1000))
    characters = np.empty((len(digits), 17), dtype=np.uint8)
    for begin, three in ((0, high), (3, middle), (6, low)):
        characters[:, begin : begin + 3] = _TRIPLES[three]
    characters[:, _POINT : _NOTHING + 1] = _BEHIND[exponent - LEAST]
    characters[:, _SIGN] = _SIGNS[sign]
    noughts = _NOUGHTS[low]
    noughts += (noughts == 3) * _NOUGHTS[middle]
    noughts += (noughts == 6) * _NOUGHTS[high]
    places = _LAYOUTS[exponent - LEAST, 9 - noughts]
    return characters.reshape(-1)[places + 17 * np.arange(len(digits))[:, None]]


def _layout(exponent: int, count: int) -> list[int]:
    """Return the place in its row of each character of a number.

    Args:
        count: Number of its digits, without trailing zeros.
    """
    figures = list(range(count))
    if exponent < -4 or exponent > 8:
        power = [_E, _SIGN_OF_EXPONENT, _TENS, _UNITS]
        places = [*figures[:1], *([_POINT] if count > 1 else []), *figures[1:], *power]
    elif exponent < 0:
        places = [_NOUGHT, _POINT, *[_NOUGHT] * (-exponent - 1), *figures]
    else:
        whole = [*figures, *[_NOUGHT] * 9][: exponent + 1]
        after = figures[exponent + 1 :]
        places = [*whole, *([_POINT] if after else []), *after]
    return [_SIGN, *places, *[_NOTHING] * WIDTH][:WIDTH]


_EXPONENTS = range(LEAST, MOST + 2)
"""Exponents of numbers that are laid out: one that is rounded up to a power of ten has the next one"""
_TRIPLES = np.array([list(b"%03d" % number) for number in range(1000)], dtype=np.uint8)
_NOUGHTS = np.array([3 - len((b"%03d" % number).rstrip(b"0")) for number in range(1000)], dtype=np.int64)
"""Trailing zeros of three digits"""
_BEHIND = np.array([[*b".0e", *(b"%+03d" % exponent), PAD] for exponent in _EXPONENTS], dtype=np.uint8)
_SIGNS = np.array([PAD, ord("-")], dtype=np.uint8)
_LAYOUTS = np.array([[_layout(exponent, count) for count in range(10)] for exponent in _EXPONENTS])
_INDEXED = range(LEAST - 1, MOST + 2)
"""Exponents by their index in the tables below: at both ends, all that are beyond"""
_FACTORS = np.array([10.0 ** max(8 - exponent, 0) for exponent in _INDEXED])
_DIVISORS = np.array([10.0 ** max(exponent - 8, 0) for exponent in _INDEXED])
_NEXT_TENS = np.array([*(float(f"1e{exponent + 1}") for exponent in _INDEXED[:-1]), np.nan])
"""Number from which on the exponent is one more; nothing is behind the last"""
_INDEX_OF_POWER = np.array(
    [min(max(int(np.floor(np.log10(2.0) * (power - 127))), _INDEXED[0]), _INDEXED[-1]) for power in range(256)]
) - (LEAST - 1)
"""Index of each power of two that a float32 is at least; its own may be one more"""


def write_npz(path: Path, arrays: Iterable[tuple[str, NDArray]], level: int = 0) -> None:
    """Write named arrays as they come; the same arrays give the same bytes.

    Args:
        level: of compression, 1 to 9, or 0 for none.
    """
    with zipfile.ZipFile(
        path, "w", zipfile.ZIP_DEFLATED if level else zipfile.ZIP_STORED, compresslevel=level
    ) as archive:
        for name, array in arrays:
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                if array.flags.c_contiguous and array.ndim and not array.dtype.hasobject:
                    np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(array))
                    file.write(array.data.cast("B") if array.size else b"")  # in one piece, without a copy
                else:
                    np.lib.format.write_array(file, array, allow_pickle=False)


PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
"""Options of h5py by which arrays are compressed, without loss, as every reader of HDF5 knows it"""


def require_h5py() -> Any:
    """Return the module.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return import_module("h5py")
    except ImportError:
        raise MissingExtraError("an .h5 needs h5py: pip install 'balloon-warp[data]'") from None


class NamedArrays:
    """Writes arrays into a group of an HDF5 file, or into the file itself.

    Args:
        group: of h5py.
    """

    def __init__(self, group: Any):
        self.group = group

    def add(self, name: str, values: NDArray, dimensions: tuple[str, ...], unit: str) -> None:
        """Write an array."""
        self._label(self.group.create_dataset(name, data=values), dimensions, unit)

    def room(
        self, name: str, shape: tuple[int, ...], dimensions: tuple[str, ...], unit: str, dtype: Any, **storage: Any
    ) -> Any:
        """Create an array that is written later; `storage` is as of h5py's `create_dataset`."""
        data = self.group.create_dataset(name, shape, dtype, **storage)
        self._label(data, dimensions, unit)
        return data

    @staticmethod
    def _label(data: Any, dimensions: tuple[str, ...], unit: str) -> None:
        for dimension, name in zip(data.dims, dimensions, strict=True):
            dimension.label = name
        data.attrs["units"] = unit
