"""How the functions of the kernel are compiled. Only the compiling process imports this: see machine_code.py."""

from __future__ import annotations

from collections.abc import Callable

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from drivetool.drive.compile import numba_private as private

# The kernel allocates nothing, so it needs no reference counts: counting every array at every call cost ten times
# the arithmetic. Functions that run every sample are inlined (INLINED).
BASE_OPTIONS = {
    "nogil": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy", **private.NO_REFERENCE_COUNTS}
COMPILE = {**BASE_OPTIONS, **private.NO_WRAPPERS}
INLINED = {**COMPILE, **private.INLINE}
# The same where no written array overlaps another argument. Otherwise the compiler tests for overlap at every call,
# and vectorises only loops so long that the test pays.
NO_OVERLAP = {**INLINED, "pipeline_class": private.NoOverlap}
COMPILE_LAW = numba.njit(**COMPILE)  # how an effect compiles its smooth law


def as_unit(*kinds: types.Type, gives: types.Type = types.none) -> Callable:
    """Compile a function separately, and only when its address is requested.

    Numba compiles an ordinary callee into every caller, and again into the callers of that: a minute for a deep
    tree of functions. A unit is called by its address, passed in a table: `unit_function(address, arguments ...)`.

    kinds  Numba types of the arguments
    gives  that of the result
    """
    def decorate(function: Callable) -> Callable:
        @intrinsic
        def call(typing, place, *arguments):
            def code(context, builder, signature, values):
                numbers = [private.value_type(context, k) for k in kinds]
                kind = ir.FunctionType(private.value_type(context, gives), numbers)
                function = builder.inttoptr(values[0], kind.as_pointer())
                result = builder.call(function, private.tuple_members(builder, values[1]))
                return private.none_value(context) if gives is types.none else result

            return gives(types.int64, types.StarArgTuple(kinds)), code

        call.made = lambda: numba.cfunc(gives(*kinds), **BASE_OPTIONS)(function)
        call.home = function.__module__
        return call

    return decorate
