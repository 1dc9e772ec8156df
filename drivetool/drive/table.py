"""Named tuples of arrays that compiled code gets as one pointer.

Numba passes a tuple of arrays as separate arguments, ten numbers for an array: forty arrays make
every call of every function four hundred stores, and minutes of compiling. Here the arrays stay in
the tuple, and compiled code gets the address of a table of their addresses and shapes.
"""

from __future__ import annotations

import operator
from functools import cache
from typing import Annotated, get_type_hints

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, register_model
from numba.np.arrayobj import make_array, populate_array

WORD = 8  # bytes; all numbers are float64 or int64

# What a field of such a tuple is: an array of so many dimensions. Anything else is a whole number.
Float1, Float2, Float3, Float4 = (Annotated[np.ndarray, "float64", d] for d in (1, 2, 3, 4))
Int1, Int2 = (Annotated[np.ndarray, "int64", d] for d in (1, 2))


@cache
def _fields(kind: type) -> tuple[tuple[str, str, int], ...]:
    """Per field of a tuple class: name, type of number, dimensions, 0 for a number by itself."""
    hints = get_type_hints(kind, include_extras=True)
    return tuple((name, *getattr(hint, "__metadata__", ("int64", 0))) for name, hint in hints.items())


class Pointer(types.Type):
    """Numba's type of the address of a table."""

    def __init__(self, kind: type):
        self.members, at = {}, 0
        for name, number, dimensions in _fields(kind):
            scalar = getattr(types, number)
            self.members[name] = at, types.Array(scalar, dimensions, "C") if dimensions else scalar
            at += 1 + dimensions
        super().__init__(kind.__name__)


register_model(Pointer)(models.OpaqueModel)

REAL, WHOLE = types.float64, types.int64
REALS, WHOLES = (tuple(types.Array(k, d, "C") for d in range(5)) for k in (REAL, WHOLE))  # by dimensions


def packed(values: tuple) -> np.ndarray:
    """The table of a named tuple: per array its address and shape, per number the number itself.

    It is good for as long as the tuple lives.
    """
    words: list[int] = []
    for value, (name, number, dimensions) in zip(values, _fields(type(values)), strict=True):
        if dimensions == 0:
            words.append(operator.index(value))
            continue
        if value.dtype != number or value.ndim != dimensions or not value.flags.c_contiguous:
            raise TypeError(f"{name} is not a contiguous array of {dimensions} dimensions of {number}")
        words += [value.ctypes.data, *value.shape]
    return np.array(words, np.int64)


def reader(pointer: Pointer):
    """For compiled code: a function from the table of a tuple to its fields by name, and from None to None."""
    @intrinsic
    def read(context, words):
        if isinstance(words, types.NoneType):
            return types.none(words), lambda context, builder, signature, args: context.get_dummy_value()

        def code(context, builder, signature, args):
            data = make_array(signature.args[0])(context, builder, args[0]).data
            return builder.bitcast(data, cgutils.voidptr_t)

        return pointer(words), code

    return read


@infer_getattr
class _Members(AttributeTemplate):
    key = Pointer

    def generic_resolve(self, pointer, name):
        return pointer.members[name][1] if name in pointer.members else None


@lower_getattr_generic(Pointer)
def _member(context, builder, pointer, value, name):
    at, kind = pointer.members[name]
    words = builder.bitcast(value, ir.IntType(64).as_pointer())

    def word(i):
        # A table does not change while compiled code runs: what was read once need not be again.
        read = builder.load(builder.gep(words, [ir.Constant(ir.IntType(64), at + i)]))
        read.set_metadata("invariant.load", builder.module.add_metadata([]))
        return read

    if not isinstance(kind, types.Array):
        return word(0)
    array = make_array(kind)(context, builder)
    shape = [word(1 + d) for d in range(kind.ndim)]
    strides = [ir.Constant(ir.IntType(64), WORD)]
    for size in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], size))
    populate_array(array, builder.inttoptr(word(0), array.data.type), shape, strides, WORD, None)
    return array._getvalue()
