"""A state, its sensitivity columns and its covariance in registers: tuples with unrolled element-wise operations.

These intrinsics compile to code without loops and without intermediate memory, for any number of states n. A
row of a step matrix is over z = [x, u, 1], n + 2 numbers. A covariance is a tuple of the lower half of its rows,
in sequence.

The compiler vectorises plain loops over columns too, but it keeps an address for each of the n (n + 2) rows of
derivatives that a step adds up, and runs out of registers. In blocks of WIDE_BLOCK columns (Cache.dphi_blocks)
these rows are contiguous, and one address serves all.
"""

from __future__ import annotations

from collections.abc import Callable

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, register_model

from drivetool.drive.compile import numba_private as private

_FLAGS = ("contract", "nsz")  # those of all other code of the kernel


class Columns(types.Type):
    """Numba's type of `width` adjacent numbers: one or two vector registers of the processor."""

    def __init__(self, width: int):
        super().__init__(f"Columns{width}")
        self.vector = ir.VectorType(ir.DoubleType(), width)


@register_model(Columns)
class _Model(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, kind.vector)


class _Code:
    """Emits products, sums and reads of contiguous arrays, from flat index `at` on."""

    def __init__(self, context, builder):
        self.context, self.builder = context, builder

    def plus(self, a, b):
        return self.builder.fadd(a, b, flags=_FLAGS)

    def minus(self, a, b):
        return self.builder.fsub(a, b, flags=_FLAGS)

    def times(self, number, b):
        """Product; where b is columns, of each of them."""
        if isinstance(b.type, ir.VectorType):
            one = self.builder.insert_element(ir.Constant(b.type, ir.Undefined), number, self.whole(0, 32))
            places = ir.Constant(ir.VectorType(ir.IntType(32), b.type.count), [0] * b.type.count)
            number = self.builder.shuffle_vector(one, one, places)
        return self.builder.fmul(number, b, flags=_FLAGS)

    def dot(self, numbers, others):
        """Sum of products."""
        total = None
        for a, b in zip(numbers, others, strict=True):
            total = self.times(a, b) if total is None else self.plus(total, self.times(a, b))
        return total

    def whole(self, number: int, bits: int = 64):
        return ir.Constant(ir.IntType(bits), number)

    def place(self, kind, array, at, step: int = 0, vector=None):
        first = private.data_pointer(self.context, self.builder, kind, array)
        place = self.builder.gep(self.builder.gep(first, [at]), [self.whole(step)])
        return self.builder.bitcast(place, vector.as_pointer()) if vector else place

    def read(self, kind, array, at, step: int = 0, vector=None):
        return self.builder.load(self.place(kind, array, at, step, vector), align=8)

    def row(self, kind, array, at, count: int):
        """Numbers in sequence."""
        return [self.read(kind, array, at, j) for j in range(count)]

    def all_of(self, values):
        return private.tuple_members(self.builder, values)

    def together(self, kind, values):
        return private.tuple_of(self.context, self.builder, kind, values)


def tuple_reader(n: int, width: int = 0) -> Callable:
    """read(array, at, step): n numbers, or `width` columns at n places, with stride `step`."""
    each = Columns(width) if width else types.float64

    @intrinsic
    def read(typing, array, at, step):
        def code(context, builder, signature, values):
            do, found, place = _Code(context, builder), [], values[1]
            for _ in range(n):
                found.append(do.read(array, values[0], place, vector=each.vector if width else None))
                place = builder.add(place, values[2])
            return do.together(signature.return_type, found)

        return types.UniTuple(each, n)(array, types.int64, types.int64), code

    return read


@intrinsic
def write(typing, array, at, value):
    """Write a number, columns, or a tuple of numbers into a contiguous array."""
    def code(context, builder, signature, values):
        do, vector = _Code(context, builder), getattr(value, "vector", None)
        many = do.all_of(values[2]) if isinstance(value, types.UniTuple) else [values[2]]
        for j, one in enumerate(many):
            builder.store(one, do.place(array, values[0], values[1], j, vector), align=8)
        return private.none_value(context)

    return types.none(array, types.int64, value), code


def _row_times_state(do: _Code, row, x, u):
    """row [x, u, 1]; sums in short chains, so that few operations depend on the newest state."""
    n = len(x)
    total = do.plus(do.times(row[n - 1], x[n - 1]), do.plus(do.times(row[n], u), row[n + 1]))
    for j in range(n - 2, -1, -2):
        pair = slice(max(j - 1, 0), j + 1)
        total = do.plus(total, do.dot(row[pair][::-1], x[pair][::-1]))
    return total


@intrinsic
def row_times_state(typing, rows, at, x, u):
    """rows [x, u, 1]."""
    def code(context, builder, signature, values):
        do = _Code(context, builder)
        return _row_times_state(do, do.row(rows, values[0], values[1], len(x) + 2), do.all_of(values[2]), values[3])

    return types.float64(rows, types.int64, x, types.float64), code


@intrinsic
def next_state(typing, e, x, u):
    """The state after a step: e [x, u, 1]."""
    def code(context, builder, signature, values):
        do, n = _Code(context, builder), len(x)
        state = do.all_of(values[1])
        rows = [do.row(e, values[0], do.whole(r * (n + 2)), n + 2) for r in range(n)]
        return do.together(x, [_row_times_state(do, row, state, values[2]) for row in rows])

    return x(e, x, types.float64), code


@intrinsic
def row_times(typing, row, at, x):
    """A row times the state, or its columns."""
    def code(context, builder, signature, values):
        do = _Code(context, builder)
        return do.dot(do.row(row, values[0], values[1], len(x)), do.all_of(values[2]))

    return x[0](row, types.int64, x), code


@intrinsic
def corrected(typing, x, gain, e):
    """The state after the correction by gain (n,) times the innovation e."""
    def code(context, builder, signature, values):
        do = _Code(context, builder)
        gains = do.all_of(values[1]) if isinstance(gain, types.UniTuple) else do.row(
            gain, values[1], do.whole(0), len(x))
        return do.together(x, [do.plus(a, do.times(k, values[2]))
                               for a, k in zip(do.all_of(values[0]), gains, strict=True)])

    return x(x, gain, types.float64), code


@intrinsic
def scaled(typing, numbers, factor):
    """Every number times the factor."""
    def code(context, builder, signature, values):
        do = _Code(context, builder)
        return do.together(numbers, [do.times(values[1], number) for number in do.all_of(values[0])])

    return numbers(numbers, types.float64), code


@intrinsic
def elementwise_product(typing, numbers, factors):
    """Number by number, times an array (n,)."""
    def code(context, builder, signature, values):
        do, n = _Code(context, builder), len(numbers)
        by = do.row(factors, values[1], do.whole(0), n)
        return do.together(numbers, [do.times(a, b) for a, b in zip(by, do.all_of(values[0]), strict=True)])

    return numbers(numbers, factors), code


@intrinsic
def row_times_with_sources(typing, e, at, columns, d, x, u):
    """The same plus the source term of the columns' own parameters: d [x, u, 1], rows as wide as the columns."""
    def code(context, builder, signature, values):
        do, vector = _Code(context, builder), columns[0].vector
        numbers, width = [*do.all_of(values[4]), values[5]], vector.count
        start = builder.mul(values[1], do.whole(width))
        total = do.read(d, values[3], start, len(numbers) * width, vector)
        for j, number in enumerate(numbers):
            total = do.plus(total, do.times(number, do.read(d, values[3], start, j * width, vector)))
        return do.plus(total, do.dot(do.row(e, values[0], values[1], len(columns)), do.all_of(values[2])))

    return columns[0](e, types.int64, columns, d, x, types.float64), code


@intrinsic
def plus_scaled(typing, columns, factor, other):
    """Columns plus the factor times other ones."""
    def code(context, builder, signature, values):
        do = _Code(context, builder)
        return do.plus(values[0], do.times(values[1], values[2]))

    return columns(columns, types.float64, columns), code


@intrinsic
def add_weighted(typing, totals, factors, at, columns):
    """Totals plus columns times a factor each: factors[m, at] for the m-th total."""
    def code(context, builder, signature, values):
        do, (old, array, place, added) = _Code(context, builder), values
        width = builder.extract_value(private.shape_of(context, builder, factors, array), 1)
        new = []
        for total in do.all_of(old):
            new.append(do.plus(total, do.times(do.read(factors, array, place), added)))
            place = builder.add(place, width)
        return do.together(totals, new)

    return totals(totals, factors, types.int64, columns), code


@intrinsic
def matrix_times(typing, matrix, columns):
    """A square matrix times columns."""
    def code(context, builder, signature, values):
        do, n = _Code(context, builder), len(columns)
        old = do.all_of(values[1])
        return do.together(columns, [do.dot(do.row(matrix, values[0], do.whole(n * r), n), old) for r in range(n)])

    return columns(matrix, columns), code


# Covariances: entry (r, c) of the lower half is at r (r + 1) / 2 + c.

def _entry(r: int, c: int) -> int:
    return max(r, c) * (max(r, c) + 1) // 2 + min(r, c)


@intrinsic
def covariance_column(typing, p, like, index):
    """Column `pick` of a covariance; like: a tuple of as many numbers."""
    def code(context, builder, signature, values):
        do, n, found = _Code(context, builder), len(like), []
        entries = do.all_of(values[0])
        for r in range(n):
            one = entries[_entry(r, 0)]
            for c in range(1, n):
                here = builder.icmp_signed("==", values[2], do.whole(c))
                one = builder.select(here, entries[_entry(r, c)], one)
            found.append(one)
        return do.together(like, found)

    return like(p, like, types.int64), code


@intrinsic
def covariance_times_row(typing, p, row, like):
    """A covariance times a row (n,); like: a tuple of n numbers."""
    def code(context, builder, signature, values):
        do, n = _Code(context, builder), len(like)
        entries, numbers = do.all_of(values[0]), do.row(row, values[1], do.whole(0), n)
        return do.together(like, [do.dot(numbers, [entries[_entry(r, c)] for c in range(n)]) for r in range(n)])

    return like(p, row, like), code


@intrinsic
def measurement_updated(typing, p, v, k):
    """The covariance p - k v'."""
    def code(context, builder, signature, values):
        do = _Code(context, builder)
        entries, v_, k_ = (do.all_of(value) for value in values)
        return do.together(p, [do.minus(entries[_entry(r, c)], do.times(k_[r], v_[c]))
                               for r in range(len(v)) for c in range(r + 1)])

    return p(p, v, k), code


@intrinsic
def time_updated(typing, p, f, noise, q, extra):
    """The covariance f p f' + q noise noise' + diag(extra), f (n, n or more)."""
    def code(context, builder, signature, values):
        do, n = _Code(context, builder), len(noise)
        entries, noise_input_numbers = do.all_of(values[0]), do.all_of(values[2])
        width = builder.extract_value(private.shape_of(context, builder, f, values[1]), 1)
        rows = [do.row(f, values[1], builder.mul(do.whole(r), width), n) for r in range(n)]
        made = []
        for r in range(n):
            half = [do.dot(rows[r], [entries[_entry(m, c)] for m in range(n)]) for c in range(n)]
            share = do.times(values[3], noise_input_numbers[r])
            for c in range(r + 1):
                added = do.times(share, noise_input_numbers[c])
                if c == r:
                    added = do.plus(added, do.read(extra, values[4], do.whole(r)))
                made.append(do.plus(do.dot(half, rows[c]), added))
        return do.together(p, made)

    return p(p, f, noise, types.float64, extra), code


@intrinsic
def lower_half(typing, full, like):
    """The covariance tuple of a symmetric matrix (n, n); like: a tuple of n numbers."""
    n = len(like)
    kind = types.UniTuple(types.float64, n * (n + 1) // 2)

    def code(context, builder, signature, values):
        do = _Code(context, builder)
        places = [do.whole(r * n + c) for r in range(n) for c in range(r + 1)]
        return do.together(kind, [do.read(full, values[0], place) for place in places])

    return kind(full, like), code


@intrinsic
def write_symmetric(typing, full, p, like):
    """Write a covariance as a symmetric matrix (n, n)."""
    def code(context, builder, signature, values):
        do, n, entries = _Code(context, builder), len(like), _Code(context, builder).all_of(values[1])
        for r in range(n):
            for c in range(n):
                builder.store(entries[_entry(r, c)], do.place(full, values[0], do.whole(r * n + c)), align=8)
        return private.none_value(context)

    return types.none(full, p, like), code
