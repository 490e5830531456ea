"""The two inner loops of a convolutional network, in LLVM's own terms: no compiler makes them from loops in Python.

A tile is a few neighbouring pixels by `LANES` channels. All its sums stay in registers while the inputs pass by; that
is what makes it as fast as the matrix products of a BLAS. Arrays are flat float32 and begin where the tile does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import binding, ir
from numba import config, types
from numba.core.errors import TypingError
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

PRODUCT_PIXELS = 8
"""Pixels of a tile of a matrix product."""
FILTER_PIXELS = 4
"""Pixels of a tile of a filter."""
FILTERS = ((3, 1), (3, 2), (5, 1), (5, 2))
"""Sizes and strides that filters have."""
HALF_LANES = 8
"""Channels come in multiples of this."""


def _has_wide_registers() -> bool:
    try:
        return bool(binding.get_host_cpu_features().get("avx512f"))
    except RuntimeError:  # LLVM does not know the features of every CPU
        return False


LANES = 16 if _has_wide_registers() else HALF_LANES
"""Channels of a tile: as wide as the registers, which must hold a tile."""

_FLOAT = ir.FloatType()
_INT32 = ir.IntType(32)


class _Vectors:
    """Vectors of `lanes` floats in the code that `builder` writes; they may begin anywhere (align: of one float)."""

    def __init__(self, builder: Any, lanes: int) -> None:
        self._builder, self.type = builder, ir.VectorType(_FLOAT, lanes)
        self._every = ir.Constant(ir.VectorType(_INT32, lanes), [0] * lanes)

    def load(self, pointer: Any) -> Any:
        return self._builder.load(self._builder.bitcast(pointer, self.type.as_pointer()), align=4)

    def store(self, vector: Any, pointer: Any) -> None:
        self._builder.store(vector, self._builder.bitcast(pointer, self.type.as_pointer()), align=4)

    def spread(self, number: Any) -> Any:
        """Return a vector that is the number in every lane."""
        nothing = ir.Constant(self.type, ir.Undefined)
        one = self._builder.insert_element(nothing, number, ir.Constant(_INT32, 0))
        return self._builder.shuffle_vector(one, nothing, self._every)

    def add_product(self, total: Any, one: Any, other: Any) -> Any:
        """Return total + one x other, rounded once where the CPU has such an instruction."""
        product = self._builder.fmul(one, other, flags=("contract",))
        return self._builder.fadd(total, product, flags=("contract",))

    def store_clamped(self, vectors: list[Any], pointers: list[Any], least: Any, most: Any) -> None:
        """Store vectors held between two numbers."""
        b, lowest, highest = self._builder, self.spread(least), self.spread(most)
        for vector, pointer in zip(vectors, pointers, strict=True):
            raised = b.select(b.fcmp_ordered(">", vector, lowest), vector, lowest)
            self.store(b.select(b.fcmp_ordered("<", raised, highest), raised, highest), pointer)


class _Counting:
    """A loop `for number in range(count)` in the code that `builder` writes; `count` is at least 1."""

    def __init__(self, builder: Any, count: Any) -> None:
        self._builder, self._count = builder, count
        self._before, self._body = builder.block, builder.append_basic_block("body")
        builder.branch(self._body)
        builder.position_at_end(self._body)
        self.number = builder.phi(count.type)
        self.number.add_incoming(ir.Constant(count.type, 0), self._before)

    def carried(self, starts: list[Any]) -> list[Any]:
        """Return values that `end` replaces in each turn."""
        values = [self._builder.phi(start.type) for start in starts]
        for value, start in zip(values, starts, strict=True):
            value.add_incoming(start, self._before)
        return values

    def end(self, values: list[Any], replacements: list[Any]) -> None:
        b, here = self._builder, self._builder.block
        following = b.add(self.number, ir.Constant(self._count.type, 1), flags=("nsw",))
        self.number.add_incoming(following, here)
        for value, replacement in zip(values, replacements, strict=True):
            value.add_incoming(replacement, here)
        after = b.append_basic_block("after")
        b.cbranch(b.icmp_signed("<", following, self._count), self._body, after)
        b.position_at_end(after)


def _pointers(context: Any, builder: Any, signature: Any, arguments: Any) -> list[Any]:
    """Arguments with arrays as pointers to their first number."""
    pairs = zip(signature.args, arguments, strict=True)
    return [
        make_array(kind)(context, builder, value).data if isinstance(kind, types.Array) else value
        for kind, value in pairs
    ]


def _steps(builder: Any, pointer: Any, step: Any, count: int) -> list[Any]:
    """`count` pointers, `step` numbers apart."""
    pointers = [pointer]
    for _ in range(count - 1):
        pointers.append(builder.gep(pointers[-1], [step]))
    return pointers


def _write_product(builder: Any, lanes: int, arguments: list[Any]) -> None:
    """Write the code of `product_tile`."""
    inputs, weights, depth, bias, out, out_step, least, most = arguments
    v = _Vectors(builder, lanes)
    pixels = _steps(builder, inputs, depth, PRODUCT_PIXELS)
    start = v.load(bias)
    loop = _Counting(builder, depth)
    sums = loop.carried([start] * PRODUCT_PIXELS)
    weight = v.load(builder.gep(weights, [builder.mul(loop.number, ir.Constant(depth.type, lanes))]))
    values = [v.spread(builder.load(builder.gep(pixel, [loop.number]))) for pixel in pixels]
    totals = [v.add_product(total, value, weight) for total, value in zip(sums, values, strict=True)]
    loop.end(sums, totals)
    v.store_clamped(totals, _steps(builder, out, out_step, PRODUCT_PIXELS), least, most)


def _write_filter(builder: Any, lanes: int, arguments: list[Any]) -> None:
    """Write the code of `filter_tile`: one piece for each size and stride."""
    *others, size, stride = arguments
    for its_size, its_stride in FILTERS:
        same = [
            builder.icmp_signed("==", given, ir.Constant(given.type, own))
            for given, own in ((size, its_size), (stride, its_stride))
        ]
        with builder.if_then(builder.and_(*same)):
            _write_one_filter(builder, lanes, its_size, its_stride, others)


def _write_one_filter(builder: Any, lanes: int, size: int, stride: int, arguments: list[Any]) -> None:
    """Along a row each input is loaded once, for all pixels that see it."""
    inputs, row_step, channels, weights, rows, bias, out, least, most = arguments
    v = _Vectors(builder, lanes)
    start = [inputs, weights, *[v.load(bias)] * FILTER_PIXELS]
    loop = _Counting(builder, rows)
    row, row_weights, *sums = values = loop.carried(start)
    seen = [v.load(one) for one in _steps(builder, row, channels, (FILTER_PIXELS - 1) * stride + size)]
    for tap, weight in enumerate(_steps(builder, row_weights, channels, size)):
        taps = v.load(weight)
        sums = [v.add_product(total, seen[k * stride + tap], taps) for k, total in enumerate(sums)]
    step = builder.mul(channels, ir.Constant(channels.type, size))
    loop.end(values, [builder.gep(row, [row_step]), builder.gep(row_weights, [step]), *sums])
    v.store_clamped(sums, _steps(builder, out, channels, FILTER_PIXELS), least, most)


def _typed(write: Callable[[Any, int, list[Any]], None], lanes: int, kinds: tuple[Any, ...]) -> tuple[Any, Any]:
    """Signature and code of a function for kernels whose code `write` writes."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        write(builder, lanes, _pointers(context, builder, signature, arguments))
        return context.get_dummy_value()

    for kind in kinds:
        if isinstance(kind, types.Array) and (kind.dtype, kind.layout) != (types.float32, "C"):
            raise TypingError(f"a tile is given {kind}; its arrays must be flat float32")  # it would read rubbish
    given = (kind if isinstance(kind, (types.Array, types.Float)) else types.intp for kind in kinds)
    return types.void(*given), code


def _product_tile(lanes: int) -> Any:
    def tile(context, inputs, weights, depth, bias, out, out_step, least, most):  # type: ignore[no-untyped-def]
        """Write `lanes` channels of `PRODUCT_PIXELS` pixels: bias + inputs x weights, held between `least` and `most`.

        Pixels follow each other by `depth` in and by `out_step` out; the weights are (depth, lanes).
        """
        return _typed(_write_product, lanes, (inputs, weights, depth, bias, out, out_step, least, most))

    return intrinsic(tile)


def _filter_tile(lanes: int) -> Any:
    def tile(context, inputs, row_step, channels, weights, rows, bias, out, least, most, size, stride):  # type: ignore[no-untyped-def]
        """Write `lanes` channels of `FILTER_PIXELS` pixels: bias + the sum of rows x `size` inputs of the same channel
        by their weights, held between `least` and `most`. Size and stride are one of `FILTERS`.

        Inputs follow each other by `channels` along a row, pixels by `stride` times that in and by `channels` out; the
        weights are (rows, size, channels).
        """
        kinds = (inputs, row_step, channels, weights, rows, bias, out, least, most, size, stride)
        return _typed(_write_filter, lanes, kinds)

    return intrinsic(tile)


def _plain_product_tile(lanes: int) -> Any:
    """Return the same for Python, where nothing is compiled (NUMBA_DISABLE_JIT)."""

    def tile(inputs, weights, depth, bias, out, out_step, least, most):  # type: ignore[no-untyped-def]
        panel = weights[: depth * lanes].reshape(depth, lanes)
        for k in range(PRODUCT_PIXELS):
            total = bias[:lanes] + inputs[k * depth : (k + 1) * depth] @ panel
            out[k * out_step : k * out_step + lanes] = total.clip(least, most)

    return tile


def _plain_filter_tile(lanes: int) -> Any:
    def tile(inputs, row_step, channels, weights, rows, bias, out, least, most, size, stride):  # type: ignore[no-untyped-def]
        for k in range(FILTER_PIXELS):
            total = bias[:lanes].copy()
            for tap in range(rows * size):
                at = tap // size * row_step + (k * stride + tap % size) * channels
                total += inputs[at : at + lanes] * weights[tap * channels : tap * channels + lanes]
            out[k * channels : k * channels + lanes] = total.clip(least, most)

    return tile


_of_products, _of_filters = (
    (_plain_product_tile, _plain_filter_tile)
    if getattr(config, "DISABLE_JIT", False)
    else (_product_tile, _filter_tile)
)
product_tile, product_half_tile = _of_products(LANES), _of_products(HALF_LANES)
filter_tile, filter_half_tile = _of_filters(LANES), _of_filters(HALF_LANES)
