"""All that the kernel uses of Numba beyond its documented interface.

No other file imports from numba.core or numba.np, or calls a method of Numba's contexts. A version of Numba may
change any of this without notice: a test lists each item, and pyproject.toml bounds the versions that passed it.
"""

from __future__ import annotations

from collections.abc import Sequence

from llvmlite import ir
from numba import types
from numba.core import cgutils, codegen
from numba.core.compiler import Compiler
from numba.core.typing.templates import AttributeTemplate
from numba.np.arrayobj import populate_array

__all__ = ["AttributeTemplate"]  # for modules that describe attributes of a type

# Options of numba.njit that its manual does not list.
NO_REFERENCE_COUNTS = {"_nrt": False}
NO_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
INLINE = {"forceinline": True}


class NoOverlap(Compiler):
    """Compiles a function whose arrays do not overlap."""

    def __init__(self, typingctx, targetctx, library, args, return_type, flags, locals):
        flags.noalias = True
        super().__init__(typingctx, targetctx, library, args, return_type, flags, locals)


def defer_code_generation() -> None:
    """Skip Numba's optimisation and code generation of each function, which take half of the time.

    build.py does both once for a whole part. Nothing that is compiled after this runs in this process.
    """
    codegen.CPUCodeLibrary._optimize_final_module = lambda library: None
    codegen.JITCodeLibrary._finalize_specific = lambda library: None
    codegen.JITCodeLibrary.get_pointer_to_function = lambda library, name: library._ensure_finalized() or 0
    codegen.JITCPUCodegen.set_env = lambda self, name, environment: None


def value_type(context, kind: types.Type) -> ir.Type:
    """The LLVM type of values of this type."""
    return context.get_value_type(kind)


def none_value(context):
    """The value None."""
    return context.get_dummy_value()


def tuple_members(builder: ir.IRBuilder, values) -> list:
    """The members of a tuple."""
    return cgutils.unpack_tuple(builder, values)


def tuple_of(context, builder: ir.IRBuilder, kind: types.Type, values: Sequence):
    """A tuple of these members."""
    return context.make_tuple(builder, kind, values)


def data_pointer(context, builder: ir.IRBuilder, kind: types.Array, array):
    """The address of an array's first number."""
    return context.make_array(kind)(context, builder, array).data


def shape_of(context, builder: ir.IRBuilder, kind: types.Array, array):
    """The numbers of rows, columns and so on of an array."""
    return context.make_array(kind)(context, builder, array).shape


def array_of(context, builder: ir.IRBuilder, kind: types.Array, place, shape: Sequence, strides: Sequence,
             item_bytes: int):
    """The array at an address, an integer; shape in numbers, strides in bytes."""
    array = context.make_array(kind)(context, builder)
    populate_array(array, builder.inttoptr(place, array.data.type), shape, strides, item_bytes, None)
    return array._getvalue()
