"""The types of compiled code, and how it reads the named tuples of arrays/table.py."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import infer_getattr, lower_getattr_generic, models, register_model

from drivetool.drive.arrays import Cache, FilterBuffers, Laws, ModalSums, SimulationBuffers, System, fields
from drivetool.drive.compile.numba_private import AttributeTemplate, array_of

WORD = 8  # bytes; all numbers are float64 or int64


class Pointer(types.Type):
    """Numba's type of the address of a table."""

    def __init__(self, kind: type):
        self.members, at = {}, 0
        for name, number, dimensions in fields(kind):
            scalar = getattr(types, number.name)
            self.members[name] = at, types.Array(scalar, dimensions, "C") if dimensions else scalar
            at += 1 + dimensions
        super().__init__(kind.__name__)


register_model(Pointer)(models.OpaqueModel)

REAL, WHOLE = types.float64, types.int64
REALS, WHOLES = (tuple(types.Array(k, d, "C") for d in range(5)) for k in (REAL, WHOLE))  # by dimensions



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
        # A table does not change while compiled code runs: one read is enough.
        read = builder.load(builder.gep(words, [ir.Constant(ir.IntType(64), at + i)]))
        read.set_metadata("invariant.load", builder.module.add_metadata([]))
        return read

    if not isinstance(kind, types.Array):
        return word(0)
    shape = [word(1 + d) for d in range(kind.ndim)]
    strides = [ir.Constant(ir.IntType(64), WORD)]
    for size in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], size))
    return array_of(context, builder, kind, word(0), shape, strides, WORD)


SYSTEM, CACHE, LAWS, PASS, FILTERING, MODES = (
    Pointer(kind) for kind in (System, Cache, Laws, SimulationBuffers, FilterBuffers, ModalSums))
