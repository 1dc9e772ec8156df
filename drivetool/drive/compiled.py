"""How the functions of the kernel are compiled. Only who compiles them needs this: see machine_code.py."""

from __future__ import annotations

from collections.abc import Callable

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.compiler import Compiler
from numba.extending import intrinsic


class _Apart(Compiler):
    def __init__(self, typingctx, targetctx, library, args, return_type, flags, locals):
        flags.noalias = True
        super().__init__(typingctx, targetctx, library, args, return_type, flags, locals)


# The kernel allocates nothing, so it does without reference counts (_nrt): counting every array at
# every call cost ten times the arithmetic. What runs every sample is inlined (HOT).
PLAIN = {"nogil": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy", "_nrt": False}
COMPILE = {**PLAIN, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
HOT = {**COMPILE, "forceinline": True}
# The same where no array that is written overlaps another argument: else the compiler tests for that
# at every call, and takes vectors only for loops so long that the test pays.
APART = {**HOT, "pipeline_class": _Apart}
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
                numbers = [context.get_value_type(k) for k in kinds]
                kind = ir.FunctionType(context.get_value_type(gives), numbers)
                function = builder.inttoptr(values[0], kind.as_pointer())
                result = builder.call(function, cgutils.unpack_tuple(builder, values[1]))
                return context.get_dummy_value() if gives is types.none else result

            return gives(types.int64, types.StarArgTuple(kinds)), code

        call.made = lambda: numba.cfunc(gives(*kinds), **PLAIN)(function)
        call.home = function.__module__
        return call

    return decorate
