"""Named tuples of arrays that compiled code gets as one pointer.

Passed one by one, an array is ten numbers: forty arrays make every call of every function four
hundred stores, and minutes of compiling. Here the arrays stay in the tuple, and compiled code gets
the address of a table of their addresses and shapes; views.py is its side of it.
"""

from __future__ import annotations

import operator
from ctypes import addressof, c_char
from functools import cache
from typing import Annotated, get_type_hints

import numpy as np

# What a field of such a tuple is: an array of so many dimensions. Anything else is a whole number.
Float1, Float2, Float3, Float4 = (Annotated[np.ndarray, "float64", d] for d in (1, 2, 3, 4))
Int1, Int2 = (Annotated[np.ndarray, "int64", d] for d in (1, 2))


@cache
def fields(kind: type) -> tuple[tuple[str, np.dtype, int], ...]:
    """Per field of a tuple class: name, type of number, number of dimensions, 0 for a scalar."""
    hints = get_type_hints(kind, include_extras=True)
    found = ((name, *getattr(hint, "__metadata__", ("int64", 0))) for name, hint in hints.items())
    return tuple((name, np.dtype(number), dimensions) for name, number, dimensions in found)

_first_byte = c_char.from_buffer


def address_of(array: np.ndarray) -> int:
    """Address of the data of a contiguous array, 0 if it is empty; array.ctypes takes three times as long."""
    try:
        return addressof(_first_byte(array)) if array.size else 0
    except TypeError:  # a read-only array
        return array.ctypes.data


def packed(values: tuple) -> np.ndarray:
    """The table of a named tuple: per array its address and shape, per number the number itself.

    It is valid as long as the tuple exists.
    """
    words: list[int] = []
    for value, (name, number, dimensions) in zip(values, fields(type(values)), strict=True):
        if dimensions == 0:
            words.append(operator.index(value))
            continue
        shape, kind = value.shape, value.dtype
        if (kind is not number and kind != number) or len(shape) != dimensions or not value.flags.c_contiguous:
            raise TypeError(f"{name} is not a contiguous array of {dimensions} dimensions of {number}")
        words.append(address_of(value))
        words.extend(shape)
    return np.array(words, np.int64)
