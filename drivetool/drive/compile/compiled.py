"""How the functions of the kernel are compiled. Only who compiles them needs this: see machine_code.py."""

from __future__ import annotations

from collections.abc import Callable

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from drivetool.drive.compile import numba_private as private

# The kernel allocates nothing, so it does without reference counts: counting every array at
# every call cost ten times the arithmetic. What runs every sample is inlined (HOT).
PLAIN = {"nogil": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy", **private.NO_COUNTS}
COMPILE = {**PLAIN, **private.NO_WRAPPERS}
HOT = {**COMPILE, **private.INLINE}
# The same where no array that is written overlaps another argument: else the compiler tests for that
# at every call, and takes vectors only for loops so long that the test pays.
APART = {**HOT, "pipeline_class": private.Apart}
LAW = numba.njit(**COMPILE)  # how an effect compiles its smooth law


def unit(*kinds: types.Type, gives: types.Type = types.none) -> Callable:
    """Compile a function by itself, and only when its address is asked for.

    What compiled code calls in the usual way Numba compiles once more into every caller, and with
    that again into the caller's callers: a minute for a deep tree of functions. A unit is called
    by its address, which travels in a table: `unit_function(address, arguments ...)`.

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
                result = builder.call(function, private.numbers_of(builder, values[1]))
                return private.nothing(context) if gives is types.none else result

            return gives(types.int64, types.StarArgTuple(kinds)), code

        call.made = lambda: numba.cfunc(gives(*kinds), **PLAIN)(function)
        call.home = function.__module__
        return call

    return decorate
