"""The scene network laid out for its kernel: EfficientNet-Lite0 (Tan, Le, ICML 2019) and a light decoder.

Weights and images lie in flat arrays; a table says what is done in which order (`layer_kernels` does it).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..labels import N_FACES, N_LABELS
from .convolution import pack_panels
from .layer_kernels import BLOCK, ENLARGE, LAYER, POINT, STEM, WHOLE, run_layers
from .vector_tiles import HALF_LANES

INPUT_WIDTH, INPUT_HEIGHT = 256, 192
"""Any image is resized to this, whatever its shape: in training the two sides are zoomed differently too."""

STRIDE = 4
"""Pixels of the input per cell of the output."""

ROWS, COLUMNS = INPUT_HEIGHT // STRIDE, INPUT_WIDTH // STRIDE
N_CLASSES = 41
"""NYU40 ids, and 0 for what has no label (never trained, so never likely)."""

N_SCORES = N_LABELS + N_FACES + N_CLASSES

STAGES = (
    (1, 3, 1, 1, 32, 16),
    (2, 3, 2, 6, 16, 24),
    (2, 5, 2, 6, 24, 40),
    (3, 3, 2, 6, 40, 80),
    (3, 5, 1, 6, 80, 112),
    (4, 5, 2, 6, 112, 192),
    (1, 3, 1, 6, 192, 320),
)
"""Blocks of the backbone: repeats, kernel, stride, expansion, channels in and out."""

TAPS = {2: 24, 4: 40, 10: 112, 15: 320}
"""Block after which the decoder reads, and its channels: strides 4, 8, 16, 32."""

WIDTH = 64
"""Channels of the decoder."""
TOP, SMOOTH, BEHIND = (5, 5), (5, 5, 3), 5
"""Kernels of the decoder: at the coarsest scale, after each finer one, for what is behind furniture."""

STEM_KERNEL, STEM_STRIDE, STEM_CHANNELS = 3, 2, 32
"""Of the one full convolution, with which the backbone begins."""

_PICTURE = -1
"""Where the source of the stem lies: it is the picture itself, none of the images."""

Work = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]


class _Image(NamedTuple):
    """Where an image begins in the array of all images, and its shape."""

    first: int
    rows: int
    columns: int
    channels: int

    def of(self, images: NDArray[np.float32]) -> NDArray[np.float32]:
        """(rows, columns, channels) this one of all images."""
        return images[self.first :][: self.rows * self.columns * self.channels].reshape(self[1:])


class SceneLayers:
    """The network laid out for `run_layers`; never changes.

    Parameters
    ----------
    arrays : {name: array} as `learning.scene_model.export_arrays` gives them. NAME.weight of a filter is (kernel,
        kernel, channels), of a product (channels in, channels out); NAME.bias has a number for each channel out.

    Attributes
    ----------
    weights : (n,) float32, all of them. layers : (n,) LAYER, what is done, in order.

    Raises
    ------
    ValueError
        When an array is missing, left over or of another shape.
    """

    __slots__ = ("_layout", "_numbers", "_seen", "layers", "weights")

    def __init__(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        plan = _Plan(arrays)
        self._seen, self._layout = plan.write_down()
        self._numbers, self.weights, self.layers = plan.numbers, plan.weights(), plan.layers()

    def workspace(self) -> Work:
        """Return memory for one run at a time: all images, a widened image, the part of it that is filtered."""
        x = self.layers
        wide = (x["rows"] * (x["columns"] + x["kernel"] - 1) * x["wide"]).max()
        return np.empty(self._numbers, np.float32), np.empty(wide, np.float32), np.empty(wide, np.float32)

    def run(self, color: NDArray[np.float32], work: Work) -> NDArray[np.float32]:
        """(N_SCORES, ROWS, COLUMNS) float32 scores of an (INPUT_HEIGHT, INPUT_WIDTH, 3) float32 image."""
        run_layers(color, self.layers, self.weights, *work)
        seen, layout = self._seen.of(work[0]), self._layout.of(work[0])
        parts = seen[..., :N_LABELS], layout[..., :N_FACES], seen[..., N_LABELS : N_LABELS + N_CLASSES]
        return np.ascontiguousarray(np.moveaxis(np.concatenate(parts, axis=-1), -1, 0))


class _Plan:
    """The network being written down: weights and layers grow with each part of it.

    Attributes
    ----------
    numbers : how many numbers all images have so far.
    """

    def __init__(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        self._arrays, self._unread = arrays, set(arrays)
        self._parts: list[NDArray[np.float32]] = []
        self._steps: list[tuple[int, ...]] = []
        self._kept = self.numbers = 0

    def weights(self) -> NDArray[np.float32]:
        """Return all weights in one array."""
        return np.concatenate(self._parts)

    def layers(self) -> NDArray[np.void]:
        """Return the table of layers."""
        return np.array(self._steps, LAYER)

    def write_down(self) -> tuple[_Image, _Image]:
        """Note all layers in order; return where the scores will be: of labels and classes, of the layout."""
        image = self._stem()
        taps = []
        for number, (kernel, stride, wide, out) in enumerate(blocks()):
            image = self._block(f"blocks.{number}", image, kernel, stride, wide, out)
            if number in TAPS:
                taps.append(image)
        *finer, deepest = taps
        image = self._point((f"lateral.{len(finer)}",), deepest, (WIDTH,))
        self._whole(deepest, image)
        for k, kernel in enumerate(TOP):
            image = self._separable(f"top.{k}", image, kernel)
        for k, (kernel, tap) in enumerate(zip(SMOOTH, reversed(finer), strict=True)):
            larger = self._point((f"lateral.{len(finer) - 1 - k}",), tap, (WIDTH,))
            self._note(ENLARGE, image, larger)
            image = self._separable(f"smooth.{k}", larger, kernel)
        behind = self._separable("behind", image, BEHIND)
        seen = self._point(("labels", "classes"), image, (N_LABELS, N_CLASSES))
        layout = self._point(("layout",), behind, (N_FACES,))
        if self._unread:
            raise ValueError(f"the network holds {min(self._unread)!r}, which it does not need")
        return seen, layout

    def _stem(self) -> _Image:
        source = _Image(_PICTURE, INPUT_HEIGHT, INPUT_WIDTH, 3)
        target = self._image(INPUT_HEIGHT // STEM_STRIDE, INPUT_WIDTH // STEM_STRIDE, STEM_CHANNELS)
        weights = self._product(("stem",), STEM_KERNEL**2 * source.channels, (STEM_CHANNELS,))
        self._note(STEM, source, target, kernel=STEM_KERNEL, stride=STEM_STRIDE, bounded=1, **weights)
        return target

    def _block(self, name: str, source: _Image, kernel: int, stride: int, wide: int, out: int) -> _Image:
        """Inverted residual (MobileNet v2): widen, filter each channel, narrow."""
        target = self._image(source.rows // stride, source.columns // stride, out)
        expand = {}
        if wide > source.channels:
            panels = self._product((f"{name}.expand",), source.channels, (wide,))
            expand = {"expand": panels["project"], "expand_bias": panels["project_bias"]}
        self._note(
            BLOCK, source, target, kernel=kernel, stride=stride, wide=wide, bounded=1,
            residual=int(stride == 1 and out == source.channels),
            **expand, **self._filter(f"{name}.filter", kernel, wide),
            **self._product((f"{name}.project",), wide, (out,)),
        )  # fmt: skip
        return target

    def _separable(self, name: str, source: _Image, kernel: int) -> _Image:
        """Filter each channel, then mix them."""
        target = self._image(source.rows, source.columns, WIDTH)
        weights = {**self._filter(f"{name}.filter", kernel, WIDTH), **self._product((f"{name}.mix",), WIDTH, (WIDTH,))}
        self._note(BLOCK, source, target, kernel=kernel, wide=WIDTH, **weights)
        return target

    def _point(self, names: tuple[str, ...], source: _Image, out: tuple[int, ...]) -> _Image:
        """One product for each pixel; several of the same pixels are joined to one."""
        target = self._image(source.rows, source.columns, _padded(sum(out)))
        self._note(POINT, source, target, **self._product(names, source.channels, out))
        return target

    def _whole(self, deepest: _Image, target: _Image) -> None:
        """Add what the mean of the whole image says, and what the place says, to each pixel."""
        position = self._take("position", (target.rows, target.columns, WIDTH)).ravel()
        weight, bias = self._take("whole.weight", (deepest.channels, WIDTH)), self._take("whole.bias", (WIDTH,))
        places = {"taps": self._keep(position), "project": self._keep(weight.ravel()), "project_bias": self._keep(bias)}
        self._note(WHOLE, deepest, target, **places)

    def _note(self, kind: int, source: _Image, target: _Image, **values: int) -> None:
        """Append a row of the table; weights that a layer does not have are -1."""
        first, rows, columns, channels = source
        step = dict.fromkeys(LAYER.names or (), -1) | {"stride": 1, "residual": 0, "bounded": 0, "kernel": 1, "wide": 0}
        step |= {"kind": kind, "source": first, "rows": rows, "columns": columns, "channels": channels}
        step |= {"target": target.first, "out": target.channels, **values}
        self._steps.append(tuple(step.values()))

    def _image(self, rows: int, columns: int, channels: int) -> _Image:
        """Make room for an image behind the others."""
        image = _Image(self.numbers, rows, columns, channels)
        self.numbers += rows * columns * channels
        return image

    def _product(self, names: tuple[str, ...], depth: int, out: tuple[int, ...]) -> dict[str, int]:
        """Keep the weights of products of the same pixels, side by side and filled up with zeros to whole tiles."""
        sizes = tuple(zip(names, out, strict=True))
        weight = np.concatenate([self._take(f"{name}.weight", (depth, size)) for name, size in sizes], axis=1)
        bias = np.concatenate([self._take(f"{name}.bias", (size,)) for name, size in sizes])
        missing = _padded(len(bias)) - len(bias)
        panels = pack_panels(np.pad(weight, ((0, 0), (0, missing))))
        return {"project": self._keep(panels), "project_bias": self._keep(np.pad(bias, (0, missing)))}

    def _filter(self, name: str, kernel: int, channels: int) -> dict[str, int]:
        weight = self._take(f"{name}.weight", (kernel, kernel, channels))
        return {"taps": self._keep(weight.ravel()), "taps_bias": self._keep(self._take(f"{name}.bias", (channels,)))}

    def _take(self, name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Return an array of the file, checked."""
        if name not in self._arrays:
            raise ValueError(f"the network lacks {name!r}")
        self._unread.discard(name)
        if self._arrays[name].shape != shape:
            raise ValueError(f"{name} of the network has shape {self._arrays[name].shape}; {shape} is needed")
        return self._arrays[name].astype(np.float32)

    def _keep(self, numbers: NDArray[np.float32]) -> int:
        """Append weights; return where they begin."""
        self._parts.append(numbers)
        self._kept += len(numbers)
        return self._kept - len(numbers)


def blocks() -> Iterator[tuple[int, int, int, int]]:
    """Kernel, stride, channels of the widened image and channels out of each block of the backbone."""
    for repeats, kernel, stride, expansion, channels, out in STAGES:
        for k in range(repeats):
            yield (kernel, stride, channels * expansion, out) if k == 0 else (kernel, 1, out * expansion, out)


def _padded(channels: int) -> int:
    """Return the channels of whole tiles that hold so many."""
    return -(-channels // HALF_LANES) * HALF_LANES
