"""Parquet files joined without being decoded: the row groups of parts that are encoded side by side."""

import struct
from io import BytesIO
from typing import Any, BinaryIO

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
        footer = _read_struct(BytesIO(part[end - length : end]))
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
        footer = BytesIO()
        _write_struct(footer, self._footer)
        self._file.write(footer.getvalue() + struct.pack("<I", footer.tell()) + MAGIC)
        self._file.close()


def _shift(fields: Fields, numbers: tuple[int, ...], shift: int) -> None:
    """Move offsets in the file, where they are given: 0 is none."""
    for number in numbers:
        if fields.get(number, (0, 0))[1]:
            kind, offset = fields[number]
            fields[number] = (kind, offset + shift)


def _read_struct(file: BytesIO) -> Fields:
    fields, number = Fields(), 0
    while head := file.read(1)[0]:
        number = number + (head >> 4) if head >> 4 else _signed(_read_varint(file))
        kind = head & 15
        fields[number] = (kind, kind == TRUE if kind in (TRUE, FALSE) else _read(file, kind))
    return fields


def _read(file: BytesIO, kind: int) -> Any:
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


def _write_struct(file: BytesIO, fields: Fields) -> None:
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


def _write(file: BytesIO, kind: int, value: Any) -> None:
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


def _read_varint(file: BytesIO) -> int:
    value = shift = 0
    while True:
        byte = file.read(1)[0]
        value |= (byte & 127) << shift
        if byte < 128:
            return value
        shift += 7


def _write_varint(file: BytesIO, value: int) -> None:
    while value > 127:
        file.write(bytes([value & 127 | 128]))
        value >>= 7
    file.write(bytes([value]))


def _signed(zigzag: int) -> int:
    return zigzag >> 1 ^ -(zigzag & 1)


def _unsigned(value: int) -> int:
    return value << 1 ^ value >> 63
