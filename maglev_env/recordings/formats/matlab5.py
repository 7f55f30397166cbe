"""MATLAB v5 files, read without scipy, whose reader can crash the process on a damaged file; this one only raises.

Format: MathWorks, "MAT-File Format", chapter 1. Numbers, structs, objects and cells are read. Text, sparse matrices,
function handles and opaque objects are returned as a str that says what they are.
"""

import math
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

_HEADER = 128
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _CHAR, _FIRST_NUMERIC, _LAST_NUMERIC = 1, 2, 3, 4, 6, 15
_ENCODINGS = {1: "latin-1", 2: "latin-1", 4: "utf-16-{}", 16: "utf-8", 17: "utf-16-{}", 18: "utf-32-{}"}  # of text
_COMPLEX = 0x0800
_NAME_WITHIN = 4096  # a variable's name lies within its first bytes


@dataclass(frozen=True)
class Variables:
    """The variables of a file: name -> (type, data as stored), and the byte order, "<" or ">"."""

    elements: dict[str, tuple[int, memoryview]]
    order: str

    def size(self, name: str) -> int:
        """Bytes that a variable takes when it is unpacked; also struct.error or zlib.error."""
        kind, data = self.elements[name]
        return _unpacked_size(data, self.order) if kind == _COMPRESSED else len(data)

    def read(self, name: str) -> Any:
        """A variable as ndarray, dict (struct), list (cells, or structs of an array, column by column) or str.

        Raises:
            ValueError: The bytes are not such a variable; also struct.error or zlib.error.
        """
        kind, data = self.elements[name]
        if kind == _COMPRESSED:
            size = _unpacked_size(data, self.order)
            unpack = zlib.decompressobj()
            data = memoryview(unpack.decompress(data, size))
            if len(data) < size:
                raise ValueError(f"it ends after {len(data)} of {size} bytes")
            kind, data, _ = _element(data, 0, self.order)
        return _Matrix(data, self.order).value()


def open_variables(path: Path) -> Variables:
    """The variables of a v5 file.

    Raises:
        ValueError: It is damaged or of another kind; also struct.error or zlib.error.
    """
    data = memoryview(path.read_bytes())
    order = {b"IM": "<", b"MI": ">"}.get(bytes(data[126:_HEADER]))
    if order is None:
        raise ValueError("it has no MATLAB v5 header; save it with '-v7' or '-v7.3'")
    elements: dict[str, tuple[int, memoryview]] = {}
    position = _HEADER
    while position < len(data):
        kind, body, position = _element(data, position, order)
        head, inner = body, kind
        if kind == _COMPRESSED:
            head = memoryview(zlib.decompressobj().decompress(body, _NAME_WITHIN))
            inner, head = struct.unpack_from(order + "I", head)[0], head[8:]
        if inner != _MATRIX:
            raise ValueError(f"an element of type {inner} stands where a variable should")
        name = _Matrix(head, order).name
        if name in elements:
            raise ValueError(f"the variable {name} is there twice")
        if name:  # MATLAB's own workspace of function handles has no name
            elements[name] = (kind, body)
    return Variables(elements, order)


def _unpacked_size(data: memoryview, order: str) -> int:
    """Bytes of the compressed element, which the tag at its beginning states, with the tag."""
    return 8 + struct.unpack_from(order + "II", zlib.decompressobj().decompress(data, 8))[1]


def _element(data: memoryview, position: int, order: str) -> tuple[int, memoryview, int]:
    """Type and body of the element at a position, and where the next one begins."""
    kind, size = struct.unpack_from(order + "II", data, position)
    start = position + 8
    if kind >> 16:  # small element: size and type share one word, and the body is the next word
        kind, size, start = kind & 0xFFFF, kind >> 16, position + 4
        following = position + 8
    else:
        following = start + size + (0 if kind == _COMPRESSED else -size % 8)
    if start + size > len(data) or (start == position + 4 and size > 4):
        raise ValueError(f"an element of {size} bytes goes beyond the end")
    return kind, data[start : start + size], following


class _Matrix:
    """A cursor over the body of one miMATRIX element; its header is read at once."""

    def __init__(self, data: memoryview, order: str) -> None:
        self._data, self._order, self._position = data, order, 0
        self._class, self.name, self._shape, self._complex = 0, "", (0, 0), False
        if not len(data):  # an empty cell
            return
        flags = self._numbers()
        self._class, self._complex = int(flags[0]) & 0xFF, bool(int(flags[0]) & _COMPLEX)
        if self._class <= _LAST_NUMERIC + 1:  # opaque objects have no shape
            self._shape = tuple(map(int, self._numbers()))
        self.name = self._text()

    def value(self) -> Any:
        if self._class == 0:
            return np.empty(0)
        if _FIRST_NUMERIC <= self._class <= _LAST_NUMERIC:
            if self._complex:
                return "complex values"
            values = self._numbers()
            if min(self._shape, default=0) < 0 or values.size != math.prod(self._shape):
                raise ValueError(f"{values.size} values do not have the shape {self._shape}")
            return values.reshape(self._shape, order="F")
        if self._class == _CELL:
            return [self._matrix() for _ in range(self._count(1))]
        if self._class in (_STRUCT, _OBJECT):
            if self._class == _OBJECT:
                self._text()
            width = int(self._numbers()[0])
            text = self._text()
            names = [text[i : i + width].split("\0")[0] for i in range(0, len(text), width)]
            rows = [{name: self._matrix() for name in names} for _ in range(self._count(len(names)))]
            return rows[0] if len(rows) == 1 else rows
        if self._class == _CHAR:
            kind, body = self._next()
            encoding = _ENCODINGS.get(kind, "latin-1").format("le" if self._order == "<" else "be")
            return bytes(body).decode(encoding, "replace")
        return "a sparse matrix or an object"

    def _next(self) -> tuple[int, memoryview]:
        kind, body, self._position = _element(self._data, self._position, self._order)
        return kind, body

    def _numbers(self) -> np.ndarray:
        kind, body = self._next()
        if kind not in _TYPES:
            raise ValueError(f"an element of type {kind} stands where numbers should")
        return np.frombuffer(body, self._order + _TYPES[kind])

    def _text(self) -> str:
        return bytes(self._next()[1]).decode()

    def _matrix(self) -> Any:
        kind, body = self._next()
        if kind != _MATRIX:
            raise ValueError(f"an element of type {kind} stands where an array should")
        return _Matrix(body, self._order).value()

    def _count(self, arrays_each: int) -> int:
        """Number of elements that the shape states; refused when the remaining bytes cannot hold them."""
        count = math.prod(self._shape)
        if min(self._shape, default=0) < 0 or 8 * count * max(arrays_each, 1) > max(len(self._data), 8):
            raise ValueError(f"an array of shape {self._shape} goes beyond the end")
        return count
