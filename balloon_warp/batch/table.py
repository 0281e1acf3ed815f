"""Tables of a batch, and files of a world each, for learning: NumPy's, HDF5 by h5py, and Zarr, which needs nothing.

Frames may come in any order, and the same frames give the same bytes.
"""

import csv
import io
import json
import os
import struct
import zlib
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from threading import Event
from types import TracebackType
from typing import Any, BinaryIO, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.system.files import PACKED, PAD, NamedArrays, decimals, require_h5py, target_of, whole_file, write_npz

AXES = {"axis": 3, "quaternion": 4}
"""Dimensions of vectors, and their lengths"""
Attribute = int | float | str


@dataclass(frozen=True)
class Field:
    """An array of a file."""

    name: str
    dimensions: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: str
    """Type as NumPy writes it: "<f4" """
    unit: str
    meaning: str

    @property
    def bytes(self) -> int:
        return int(np.prod(self.shape, dtype=np.int64)) * np.dtype(self.dtype).itemsize

    @property
    def bytes_of_frame(self) -> int:
        """Size of one frame, where the first dimension is time."""
        return self.bytes // self.shape[0]

    def as_json(self) -> dict[str, Any]:
        """Describe the field for a manifest."""
        return {"dimensions": self.dimensions, "dtype": self.dtype, "unit": self.unit, "is": self.meaning}


Arrays = Sequence[tuple[Field, NDArray]]
"""Arrays of a file, with their descriptions"""


@dataclass(frozen=True)
class WorldFile:
    """Contents of a world's file, but for its frames."""

    attributes: Mapping[str, Attribute]
    static: Arrays
    """Fields that stay, and are kept once for all worlds that have them in common"""
    times: Arrays
    """Fields that have as many rows as there are frames, and are known before"""
    moving: Sequence[Field]


@dataclass(frozen=True)
class FileContents:
    """Description of a whole file."""

    attributes: Mapping[str, Attribute]
    arrays: Arrays
    elsewhere: Sequence[str] = ()
    """Names of the arrays that stand in another file, at `static` of the attributes from the folder above"""


LEVEL = 1
"""Level of compression: higher ones take several times as long, for a few hundredths of the size"""
SAMPLE, WORTH_IT = 2**14, 0.9
"""Number of bytes that are tried, and the part of their size to which they must shrink"""
CHUNK_BYTES = 2**19
"""Largest size of a piece of several rows: readers keep one of at most 1 MiB in memory"""


def chunk_shape(field: Field) -> tuple[int, ...]:
    """Return the shape of a field's pieces, whole rows of it."""
    rows = max(1, min(field.shape[0], CHUNK_BYTES // max(field.bytes_of_frame, 1)))
    return (rows, *field.shape[1:])


def chunks_of(field: Field, values: NDArray) -> Iterator[NDArray]:
    """Cut an array into its pieces; the last is filled up with zeros."""
    shape = chunk_shape(field)
    for begin in range(0, field.shape[0], shape[0]):
        piece = np.ascontiguousarray(values[begin : begin + shape[0]], dtype=field.dtype)
        if len(piece) < shape[0]:
            piece = np.concatenate([piece, np.zeros((shape[0] - len(piece), *shape[1:]), dtype=field.dtype)])
        yield piece


def packed(piece: NDArray) -> bytes:
    """Compress a piece: the first bytes of all its numbers, the second ones and so on, which are alike.

    The last digits of measurements are noise, on which most of the time would go: bytes that do not shrink are copied.
    """
    planes = np.ascontiguousarray(piece.reshape(-1).view(np.uint8).reshape(-1, piece.itemsize).T)
    parts, checksum = [b"\x78\x01"], zlib.adler32(planes.data)  # a stream of zlib, block by block
    for left, plane in zip(reversed(range(piece.itemsize)), planes, strict=True):
        middle = len(plane) // 2
        sample = plane[middle : middle + SAMPLE].data
        shrinks = len(zlib.compress(sample, LEVEL)) < WORTH_IT * len(sample)
        packer = zlib.compressobj(LEVEL if shrinks else 0, zlib.DEFLATED, -zlib.MAX_WBITS)
        parts += [packer.compress(plane.data), packer.flush(zlib.Z_FULL_FLUSH if left else zlib.Z_FINISH)]
    return b"".join([*parts, checksum.to_bytes(4, "big")])


SUFFIX = ".frames"


def make_room(path: Path, moving: Sequence[Field]) -> None:
    """Create the file, with room for all frames."""
    with path.open("wb") as file:
        file.truncate(sum(field.bytes for field in moving))


def put_frames(path: Path, moving: Sequence[Field], begin: int, frames: Mapping[str, NDArray]) -> None:
    """Write frames that follow each other, from one on, of each array."""
    descriptor = os.open(path, os.O_WRONLY)
    try:
        for field, room in _places(moving):
            offset, left = room + begin * field.bytes_of_frame, np.ascontiguousarray(frames[field.name]).data.cast("B")
            while left:
                written = os.pwrite(descriptor, left, offset)
                left, offset = left[written:], offset + written
    finally:
        os.close(descriptor)


def all_frames(path: Path, moving: Sequence[Field]) -> Arrays:
    """Return all frames of each array, which are read where they are looked at."""
    return [(field, np.memmap(path, field.dtype, "r", offset, field.shape)) for field, offset in _places(moving)]


def _places(moving: Sequence[Field]) -> Iterator[tuple[Field, int]]:
    """Find where each array begins."""
    offset = 0
    for field in moving:
        yield field, offset
        offset += field.bytes


class Npz:
    """NumPy's .npz."""

    suffix = ".npz"

    def write(self, path: Path, contents: FileContents) -> None:
        """See `Format`."""
        attributes = np.array(json.dumps(dict(contents.attributes)))
        arrays = ((field.name, np.asarray(values)) for field, values in contents.arrays)
        write_npz(path, (*arrays, ("attributes", attributes)), LEVEL)


SMALL = 2**14
"""Size of arrays up to which the index of pieces would take more than compression saves"""


class Hdf5:
    """HDF5 files. Arrays of other files are links, which readers follow.

    Raises:
        MissingExtraError: h5py is not installed.
    """

    suffix = ".h5"

    def __init__(self) -> None:
        self._h5py = require_h5py()

    def write(self, path: Path, contents: FileContents) -> None:
        """See `Format`. h5py writes one thing at a time: pieces are compressed outside of it."""
        with self._h5py.File(path, "w") as file:
            file.attrs.update(contents.attributes)
            arrays = NamedArrays(file)
            for name in contents.elsewhere:
                file[name] = self._h5py.ExternalLink(f"../{contents.attributes['static']}", f"/{name}")
            for field, values in contents.arrays:
                if field.bytes <= SMALL:
                    arrays.add(field.name, values, field.dimensions, field.unit)
                    continue
                storage: dict[str, Any] = {"chunks": chunk_shape(field), **PACKED}
                data = arrays.room(field.name, field.shape, field.dimensions, field.unit, field.dtype, **storage)
                for number, piece in enumerate(chunks_of(field, values)):
                    place = (number * len(piece), *(0 for _ in field.shape[1:]))
                    data.id.write_direct_chunk(place, packed(piece))


class Zarr:
    """Zarr 2, which versions 2 and 3 of its library read, and xarray. It is written without them."""

    suffix = ".zarr"

    def write(self, path: Path, contents: FileContents) -> None:
        """See `Format`."""
        path.mkdir()
        for field, values in contents.arrays:
            (path / field.name).mkdir()
            for name, said in _array(field).items():
                (path / field.name / name).write_text(json.dumps(said), encoding="utf-8")
            for number, piece in enumerate(chunks_of(field, values)):
                name = ".".join([str(number), *("0" for _ in field.shape[1:])])
                (path / field.name / name).write_bytes(packed(piece))
        self._describe(path, contents)

    @staticmethod
    def _describe(path: Path, contents: FileContents) -> None:
        """Write the attributes, and the consolidated metadata of all arrays."""
        said: dict[str, Any] = {".zgroup": {"zarr_format": 2}, ".zattrs": dict(contents.attributes)}
        for name, value in said.items():
            (path / name).write_text(json.dumps(value), encoding="utf-8")
        for field, _ in contents.arrays:
            said |= {f"{field.name}/{name}": value for name, value in _array(field).items()}
        text = json.dumps({"zarr_consolidated_format": 1, "metadata": said})
        (path / ".zmetadata").write_text(text, encoding="utf-8")


def _array(field: Field) -> dict[str, Any]:
    """Describe an array, by the names of the files that do."""
    array = {
        "zarr_format": 2,
        "shape": field.shape,
        "chunks": chunk_shape(field),
        "dtype": field.dtype,
        "compressor": {"id": "zlib", "level": LEVEL},
        "fill_value": None,  # else readers take zeros for missing
        "order": "C",
        "filters": [{"id": "shuffle", "elementsize": int(field.dtype[-1])}],
    }
    return {".zarray": array, ".zattrs": {"_ARRAY_DIMENSIONS": field.dimensions, "units": field.unit}}


class Format(Protocol):
    """A format. Files of several worlds may be written at the same time."""

    suffix: str

    def write(self, path: Path, contents: FileContents) -> None:
        """Write a file."""
        ...


FORMATS: dict[str, type[Format]] = {"h5": Hdf5, "zarr": Zarr, "npz": Npz}


def format_named(name: str) -> type[Format]:
    """Return a format.

    Raises:
        InputError: there is none of that name.
        MissingExtraError: its package is not installed.
    """
    if name not in FORMATS:
        raise InputError(f"format {name}: expected {', '.join(FORMATS)}")
    FORMATS[name]()  # which says if a package is missing
    return FORMATS[name]


__all__ = ["FORMATS", "Field", "FileContents", "Format", "WorldFile", "format_named"]
MAGIC, MAGIC_BYTES, LENGTH_BYTES = b"PAR1", 4, 4
TRUE, FALSE, BYTE, DOUBLE, BINARY, LIST, SET, STRUCT = 1, 2, 3, 7, 8, 9, 10, 12
"""Types of Thrift's compact protocol; integers of 16 to 64 bits are those between"""
ROW_COUNT, ROW_GROUPS = 3, 4
"""Fields of a footer, by their numbers in parquet.thrift: `FileMetaData`"""
OF_GROUP, COLUMNS, ORDINAL = (5,), 1, 7
"""Offset, columns and number of a `RowGroup`"""
OF_COLUMN, METADATA, OF_METADATA = (2, 4, 6), 3, (9, 10, 11, 14)
"""Offsets and metadata of a `ColumnChunk`, and offsets of a `ColumnMetaData`"""
Fields = dict[int, tuple[int, Any]]
"""Fields of a struct: type and value by number"""


class ParquetParts:
    """A Parquet file of parts, which are whole Parquet files of one schema.

    Args:
        file: Output, at its beginning.
    """

    def __init__(self, file: BinaryIO):
        self._file, self._footer = file, Fields()
        file.write(MAGIC)

    def append(self, part: memoryview) -> None:
        """Append the row groups of a part."""
        end = len(part) - MAGIC_BYTES - LENGTH_BYTES
        (length,) = struct.unpack("<I", part[end : end + LENGTH_BYTES])
        shift = self._file.tell() - MAGIC_BYTES
        self._file.write(part[MAGIC_BYTES : end - length])
        footer = _read_struct(io.BytesIO(part[end - length : end]))
        kind, (of, groups) = footer[ROW_GROUPS]
        for group in groups:
            _shift(group, OF_GROUP, shift)
            for column in group[COLUMNS][1][1]:
                _shift(column, OF_COLUMN, shift)
                _shift(column[METADATA][1], OF_METADATA, shift)
        if self._footer:
            there = self._footer[ROW_GROUPS][1][1]
            count = self._footer[ROW_COUNT][1] + footer[ROW_COUNT][1]
            self._footer[ROW_COUNT] = (self._footer[ROW_COUNT][0], count)
            groups = [*there, *groups]
            for number, group in enumerate(groups):
                if ORDINAL in group:
                    group[ORDINAL] = (group[ORDINAL][0], number)
        else:
            self._footer = footer
        self._footer[ROW_GROUPS] = (kind, (of, groups))

    def close(self) -> None:
        """Write the footer, and close the file."""
        footer = io.BytesIO()
        _write_struct(footer, self._footer)
        self._file.write(footer.getvalue() + struct.pack("<I", footer.tell()) + MAGIC)
        self._file.close()


def _shift(fields: Fields, numbers: tuple[int, ...], shift: int) -> None:
    """Move offsets in the file, where they are given: 0 is none."""
    for number in numbers:
        if fields.get(number, (0, 0))[1]:
            kind, offset = fields[number]
            fields[number] = (kind, offset + shift)


def _read_struct(file: io.BytesIO) -> Fields:
    fields, number = Fields(), 0
    while head := file.read(1)[0]:
        number = number + (head >> 4) if head >> 4 else _signed(_read_varint(file))
        kind = head & 15
        fields[number] = (kind, kind == TRUE if kind in (TRUE, FALSE) else _read(file, kind))
    return fields


def _read(file: io.BytesIO, kind: int) -> Any:
    if kind in (TRUE, FALSE, BYTE):
        return file.read(1)[0]
    if kind == DOUBLE:
        return file.read(8)
    if kind == BINARY:
        return file.read(_read_varint(file))
    if kind in (LIST, SET):
        head = file.read(1)[0]
        count = head >> 4 if head >> 4 < 15 else _read_varint(file)
        return head & 15, [_read(file, head & 15) for _ in range(count)]
    return _read_struct(file) if kind == STRUCT else _signed(_read_varint(file))


def _write_struct(file: io.BytesIO, fields: Fields) -> None:
    last = 0
    for number, (kind, value) in fields.items():
        told = (TRUE if value else FALSE) if kind in (TRUE, FALSE) else kind
        if 0 < number - last < 16:
            file.write(bytes([number - last << 4 | told]))
        else:
            file.write(bytes([told]))
            _write_varint(file, _unsigned(number))
        if kind not in (TRUE, FALSE):
            _write(file, kind, value)
        last = number
    file.write(b"\0")


def _write(file: io.BytesIO, kind: int, value: Any) -> None:
    if kind in (TRUE, FALSE, BYTE):
        file.write(bytes([value]))
    elif kind == DOUBLE:
        file.write(value)
    elif kind == BINARY:
        _write_varint(file, len(value))
        file.write(value)
    elif kind in (LIST, SET):
        of, values = value
        file.write(bytes([min(len(values), 15) << 4 | of]))
        if len(values) >= 15:
            _write_varint(file, len(values))
        for each in values:
            _write(file, of, each)
    elif kind == STRUCT:
        _write_struct(file, value)
    else:
        _write_varint(file, _unsigned(value))


def _read_varint(file: io.BytesIO) -> int:
    value = shift = 0
    while True:
        byte = file.read(1)[0]
        value |= (byte & 127) << shift
        if byte < 128:
            return value
        shift += 7


def _write_varint(file: io.BytesIO, value: int) -> None:
    while value > 127:
        file.write(bytes([value & 127 | 128]))
        value >>= 7
    file.write(bytes([value]))


def _signed(zigzag: int) -> int:
    return zigzag >> 1 ^ -(zigzag & 1)


def _unsigned(value: int) -> int:
    return value << 1 ^ value >> 63


BLOCK = 4096
"""Number of worlds whose rows are formatted together: more would only fill the memory"""


class CsvRows:
    """Writes rows of a table, frame by frame, as `TableWriter` tells.

    Args:
        path: of the file.
        columns: names of the columns.
        varied: the parameters that differ between the worlds: columns of shape (world_count,), numbers or words.
    """

    def __init__(self, path: Path, columns: Sequence[str], varied: Mapping[str, NDArray], world_count: int):
        self._columns, self._world_count = columns, world_count
        self._world_text = _padded([str(world).encode() for world in range(world_count)])
        self._varied_text = _padded(_describe_worlds(varied, world_count))
        self._file = path.open("wb")
        self._write_header()

    def write(self, frame: int, time: float, values: NDArray[np.float32], health: NDArray[np.int32]) -> None:
        """Write a frame: values of shape (measures, world_count), health of shape (world_count,)."""
        # nine digits give back every float32, and repr every float64
        moment = _padded([b",%d,%s" % (frame, repr(time).encode())])
        for begin in range(0, self._world_count, BLOCK):
            worlds = slice(begin, begin + BLOCK)
            kinds, kind = np.unique(health[worlds], return_inverse=True)
            columns = [
                self._world_text[worlds],
                moment,
                self._varied_text[worlds],
                *(part for column in decimals(values[:, worlds]) for part in (_COMMA, column)),
                _padded([b",%d\n" % each for each in kinds.tolist()])[kind],
            ]
            rows = np.concatenate([np.broadcast_to(column, (len(kind), column.shape[1])) for column in columns], axis=1)
            self._file.write(rows[rows != PAD].data)

    def begin_again(self) -> None:
        """Forget the written rows."""
        self._file.seek(0)
        self._file.truncate()
        self._write_header()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write_header(self) -> None:
        self._file.write((",".join(self._columns) + "\n").encode())


def _describe_worlds(varied: Mapping[str, NDArray], world_count: int) -> list[bytes]:
    """Return each world's varied values as CSV, with a comma before each."""
    lines = []
    for values in zip(*(column.tolist() for column in varied.values()), strict=True):
        line = io.StringIO()
        csv.writer(line, lineterminator="").writerow(["", *map(str, values)])
        lines.append(line.getvalue().encode())
    return lines or [b""] * world_count


def _padded(texts: Sequence[bytes]) -> NDArray[np.uint8]:
    """Return the texts below each other, filled up to the longest one, shape (len(texts), width)."""
    width = max(map(len, texts))
    filled = b"".join(text.ljust(width, bytes([PAD])) for text in texts)
    return np.frombuffer(filled, dtype=np.uint8).reshape(len(texts), width)


_COMMA = _padded([b","])
ROWS = 2**20
"""Number of rows that are written together, at least, unless they are the last: a row group of the file"""
THREADS = min(os.cpu_count() or 1, 16)
"""Number of row groups that are encoded side by side: more would only fill the memory"""


def has_parquet() -> bool:
    """Return whether Parquet can be written."""
    return find_spec("pyarrow") is not None


def require_pyarrow() -> tuple[Any, Any]:
    """Return Arrow and its Parquet.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise MissingExtraError("Parquet needs pyarrow: pip install 'balloon-warp[data]'") from None


class ParquetRows:
    """Writes rows of a table, frame by frame, as `TableWriter` tells.

    Args:
        path: of the file.
        columns: names of the columns.
        varied: the parameters that differ between the worlds: columns of shape (world_count,), numbers or words.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """

    def __init__(self, path: Path, columns: Sequence[str], varied: Mapping[str, NDArray], world_count: int):
        self._arrow, self._parquet = require_pyarrow()
        self._path, self._columns, self._varied, self._world_count = path, columns, varied, world_count
        measured = columns[3 + len(varied) : -1]
        kinds = {"world": np.int32, "frame": np.int32, "time": np.float64, "health": np.int32}
        types = {name: self._arrow.from_numpy_dtype(kind) for name, kind in kinds.items()}
        types |= {name: self._column(values).type for name, values in varied.items()}
        types |= dict.fromkeys(measured, self._arrow.float32())
        self._repeating = [name for name in columns if name not in measured]  # floats gain nothing by a dictionary
        self._schema = self._arrow.schema([(name, types[name]) for name in columns])
        self._encoders = ThreadPoolExecutor(THREADS, thread_name_prefix="encoder")
        self._encoded: deque[Future[memoryview]] = deque()
        self._open()

    def write(self, frame: int, time: float, values: NDArray[np.float32], health: NDArray[np.int32]) -> None:
        """Write a frame: values of shape (measures, world_count), health of shape (world_count,)."""
        count = self._world_count
        first = [np.arange(count, dtype=np.int32), np.full(count, frame, dtype=np.int32), np.full(count, time)]
        arrays = [*first, *self._varied.values(), *values, health]
        self._waiting.append(self._arrow.record_batch(list(map(self._column, arrays)), schema=self._schema))
        if len(self._waiting) * count >= ROWS:
            self._flush()

    def begin_again(self) -> None:
        """Forget the written rows."""
        self._waiting.clear()
        self._flush(wait_for=0)
        self._parts.close()
        self._open()

    def close(self) -> None:
        """Write the frames that wait, and close the file."""
        self._flush(wait_for=0)
        self._encoders.shutdown()
        self._parts.close()

    def _column(self, values: NDArray[Any]) -> Any:
        """Return values as a column; numbers as they are, since `pyarrow.array` would load pandas, for a second."""
        if values.dtype.kind not in "iuf":
            return self._arrow.array(values)
        numbers = np.ascontiguousarray(values)
        kind = self._arrow.from_numpy_dtype(numbers.dtype)
        return self._arrow.Array.from_buffers(kind, len(numbers), [None, self._arrow.py_buffer(numbers)])

    def _open(self) -> None:
        self._waiting: list[Any] = []
        self._parts = ParquetParts(self._path.open("wb"))

    def _flush(self, wait_for: int = THREADS) -> None:
        """Have the frames that wait encoded as a row group, and write encoded groups, until so many are under way."""
        if self._waiting:
            self._encoded.append(self._encoders.submit(self._encode, self._waiting))
            self._waiting = []
        while len(self._encoded) > wait_for:
            self._parts.append(self._encoded.popleft().result())

    def _encode(self, batches: Sequence[Any]) -> memoryview:
        """Return a Parquet file of a row group."""
        file, options = io.BytesIO(), {"compression": "zstd", "compression_level": 1, "use_dictionary": self._repeating}
        with self._parquet.ParquetWriter(file, self._schema, **options) as writer:
            writer.write_table(self._arrow.Table.from_batches(batches), row_group_size=2**31 - 1)
        return file.getbuffer()


KINDS = {"csv": CsvRows, "parquet": ParquetRows}
"""Kinds of the file beside the .npz"""
MOST_CSV_ROWS = 200_000
"""Largest number of rows that are written as text where nobody asks: a second's work"""


def resolved_table(asked: str, rows: int) -> str:
    """Return the kind of a table: "auto" is CSV for a small one, and Parquet for others where it can be written.

    Raises:
        InputError: there is no such kind.
        MissingExtraError: it is Parquet, and pyarrow is not installed.
    """
    if asked not in (*KINDS, "auto"):
        raise InputError(f"table {asked}: expected auto, {', '.join(KINDS)}")
    if asked == "parquet":
        require_pyarrow()
    if asked == "auto":
        return "parquet" if rows > MOST_CSV_ROWS and has_parquet() else "csv"
    return asked


def table_names(kind: str) -> tuple[str, str]:
    """Return the names of a table's files."""
    return "table.npz", f"table.{kind}"


@dataclass(frozen=True)
class Columns:
    """Columns of a table, beside world, frame, time and health."""

    varied: Mapping[str, NDArray]
    """Parameters that differ between the worlds: numbers or words, shape (world_count,)"""
    measures: Sequence[str]
    """Names of what is measured in each frame"""

    @property
    def names(self) -> list[str]:
        """Names of all columns, in order."""
        return ["world", "frame", "time", *self.varied, *self.measures, "health"]


class TableWriter:
    """Writes `table.npz` and `table.csv` or `table.parquet`, which appear when the `with` block ends well.

    Rows go frame by frame, and within a frame world by world; they may come in any order before their frame is written.

    Args:
        folder: where the files go.
        frame_count: how many frames there will be, the start among them.
        frames_per_second: of the column `time` [s].
        kind: of the file beside the .npz: "csv" or "parquet".
    """

    def __init__(
        self, folder: Path, frame_count: int, frames_per_second: float, columns: Columns, world_count: int,
        kind: str = "csv",
    ):  # fmt: skip
        self.folder, self.frames_per_second, self.kind = folder, frames_per_second, kind
        self.columns, self.world_count = columns, world_count
        self.values = np.zeros((frame_count, len(columns.measures), world_count), dtype=np.float32)
        """Measures of each frame and world, shape (frame_count, len(measures), world_count): columns, as files have"""
        self.health = np.zeros((frame_count, world_count), dtype=np.int32)
        """Health of each frame and world, shape (frame_count, world_count)"""
        self._frames_written = 0
        self._measured, self._failed, self._ended = Event(), False, False

    def __enter__(self) -> Self:
        with ExitStack() as files:
            npz, rows = table_names(self.kind)
            files.push(self._remove_others)
            self._npz = files.enter_context(whole_file(self.folder / npz))
            files.push(self._save_npz)
            thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="arrays")
            self._arrays = thread.submit(write_npz, self._npz, self._arrays_in_turn())
            self._text = files.enter_context(whole_file(self.folder / rows))
            self._rows = KINDS[self.kind](self._text, self.columns.names, self.columns.varied, self.world_count)
            files.callback(self.end_rows)
            self._files = files.pop_all()
        return self

    def write_frame(self) -> None:
        """Write the next frame, whose rows are all in `values` and `health`."""
        frame = self._frames_written
        self._frames_written += 1
        self._rows.write(frame, frame / self.frames_per_second, self.values[frame], self.health[frame])

    def write_arrays(self) -> Path:
        """Write the measured columns of all frames, which are there, while others write rows; return the file so far.

        It has its name once the `with` block ends.
        """
        self._measured.set()
        self._arrays.result()
        return self._npz

    def end_rows(self) -> Path:
        """Write the rows that wait; return the file so far, as `write_arrays` does."""
        if not self._ended:
            self._ended = True
            self._rows.close()
        return self._text

    def write_again(self) -> None:
        """Write the frames again that were written already: their rows have changed since; before `write_arrays`."""
        frames, self._frames_written = self._frames_written, 0
        self._rows.begin_again()
        for _ in range(frames):
            self.write_frame()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._files.__exit__(kind, error, traceback)

    def _remove_others(self, kind: type[BaseException] | None, *_: object) -> None:
        """Remove a table of another kind, which an earlier batch has left, unless this one failed."""
        for other in KINDS:
            path = self.folder / f"table.{other}"
            if kind is None and other != self.kind and path.exists():
                target_of(path).unlink()

    def _save_npz(self, kind: type[BaseException] | None, *_: object) -> None:
        """Write the arrays unless the run failed, or they are written."""
        if kind is None:
            self.write_arrays()
        else:
            self._failed = True
            self._measured.set()
            self._arrays.exception()  # waits for the thread

    def _arrays_in_turn(self) -> Iterator[tuple[str, NDArray]]:
        """Iterate over columns, once they are known: of two in memory one is a copy. The first are known at once."""
        for name in self.columns.names:
            if name in (*self.columns.measures, "health"):
                self._measured.wait()
            if self._failed:
                return
            yield name, self._column(name)

    def _column(self, name: str) -> NDArray:
        frames, worlds = self.health.shape
        match name:
            case "world":
                return np.tile(np.arange(worlds, dtype=np.int32), frames)
            case "frame":
                return np.repeat(np.arange(frames, dtype=np.int32), worlds)
            case "time":
                return np.repeat(np.arange(frames) / self.frames_per_second, worlds)
            case "health":
                return self.health.ravel()
        if name in self.columns.varied:
            return np.tile(self.columns.varied[name], frames)
        return self.values[:, self.columns.measures.index(name)].ravel()


WORLDS_NAMES = ("worlds.npz", "worlds.csv")
WELL, BLEW_UP = "finished", "blew up"
"""Ending of a world, where nothing else is known of it"""
EXTREMES = {"end": "at the end", "min": "minimum over good frames", "max": "maximum over good frames"}
"""Columns of each measure, by the suffixes of their names"""


def write_worlds(
    npz: Path, text: Path, table: TableWriter, endings: Mapping[int, str], further: Mapping[str, NDArray]
) -> None:
    """Write the two files.

    Args:
        table: with all its frames.
        endings: the known endings of worlds that did not blow up.
        further: the last columns, shape (world_count,) each.
    """
    columns = {**dict(_columns(table, endings)), **further}
    write_npz(npz, columns.items())
    with text.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for begin in range(0, table.world_count, BLOCK):
            block = slice(begin, begin + BLOCK)
            writer.writerows(zip(*(_texts(column[block]) for column in columns.values()), strict=True))


def worlds_columns(columns: Columns) -> list[str]:
    """Return the names of the columns, in order."""
    of_measures = (f"{measure}_{end}" for measure in columns.measures for end in EXTREMES)
    return ["world", *columns.varied, "health", "ending", "last_frame", *of_measures]


def _columns(table: TableWriter, endings: Mapping[int, str]) -> Iterator[tuple[str, NDArray]]:
    """Return names and values, shape (world_count,); of a world that blew up the last good frame is the end."""
    worlds, good = np.arange(table.world_count, dtype=np.int32), table.health != 0
    health = table.health[-1]
    words = [endings.get(world, WELL) if well else BLEW_UP for world, well in enumerate(health.tolist())]
    values = table.values[-1], table.values.min(axis=0), table.values.max(axis=0)
    measured = (each[number] for number in range(len(table.columns.measures)) for each in values)
    first = [worlds, *table.columns.varied.values(), health, np.array(words), good.sum(axis=0, dtype=np.int32) - 1]
    yield from zip(worlds_columns(table.columns), [*first, *measured], strict=True)


def _texts(values: NDArray) -> list[str]:
    """Format numbers so that they read back: nine digits of a float32, repr of a float64."""
    if values.dtype == np.float32:
        return [f"{value:.9g}" for value in values.tolist()]
    return [str(value) for value in values.tolist()]
