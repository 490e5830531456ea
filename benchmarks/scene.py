"""The scene network: our kernels beside OpenCV's and ONNX Runtime's on one thread, milliseconds and agreement.

The peers need the network as an ONNX file: `pip install onnx onnxruntime`. Without them only our time is measured.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.models import load_scene_network
from room_layout_ros.core.network.scene_layers import (
    COLUMNS,
    INPUT_HEIGHT,
    INPUT_WIDTH,
    N_SCORES,
    ROWS,
    STEM_CHANNELS,
    STEM_KERNEL,
    STEM_STRIDE,
    TAPS,
    TOP,
    SceneLayers,
    blocks,
)

RUNS = 40
Look = Callable[[NDArray[np.float32]], NDArray[np.float32]]


def main() -> int:
    cv2.setNumThreads(1)
    ways = _ways()
    color = np.random.default_rng(0).standard_normal((INPUT_HEIGHT, INPUT_WIDTH, 3)).astype(np.float32)
    scores = {name: look(color) for name, look in ways.items()}
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(RUNS):
        for name, look in ways.items():
            start = time.perf_counter()
            look(color)
            taken[name].append(1e3 * (time.perf_counter() - start))
    print("                       min     p50 ms   apart from ours at most")
    for name, values in taken.items():
        apart = np.abs(scores[name] - scores["ours"]).max()
        print(f"{name:20s} {min(values):6.1f}  {np.median(values):6.1f}      {apart:.1e}")
    return 0


def _ways() -> dict[str, Look]:
    arrays = load_scene_network().arrays
    layers = SceneLayers(arrays)
    work = layers.workspace()
    ways: dict[str, Look] = {"ours": lambda color: layers.run(color, work)}
    if importlib.util.find_spec("onnx") is None:
        print("onnx is not installed (pip install onnx onnxruntime): no peers")
        return ways
    network = _onnx(arrays)
    ways[f"OpenCV {cv2.__version__}"] = _by_opencv(network)
    if importlib.util.find_spec("onnxruntime") is not None:
        import onnxruntime

        ways[f"ONNX Runtime {onnxruntime.__version__}"] = _by_onnx_runtime(network)
    return ways


def _by_opencv(network: bytes) -> Look:
    net = cv2.dnn.readNetFromONNX(np.frombuffer(network, np.uint8))

    def look(color: NDArray[np.float32]) -> NDArray[np.float32]:
        net.setInput(_channels_first(color))
        return np.asarray(net.forward()[0], np.float32)

    return look


def _by_onnx_runtime(network: bytes) -> Look:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"])
    return lambda color: np.asarray(session.run(None, {"color": _channels_first(color)})[0][0], np.float32)


def _channels_first(color: NDArray[np.float32]) -> NDArray[np.float32]:
    """(1, 3, H, W) of (H, W, 3)."""
    return np.ascontiguousarray(np.moveaxis(color, -1, 0)[None])


class _Graph:
    """An ONNX graph in the making; its layers are named by their outputs."""

    def __init__(self, arrays: dict[str, NDArray[Any]]) -> None:
        import onnx

        self._onnx, self._arrays = onnx, arrays
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        for name, value in (("zero", 0.0), ("six", 6.0)):
            self.constant(name, np.array(value, np.float32))

    def constant(self, name: str, values: NDArray[Any]) -> str:
        self.constants.append(self._onnx.numpy_helper.from_array(values, name))
        return name

    def add(self, kind: str, *inputs: str, **attributes: Any) -> str:
        self.nodes.append(self._onnx.helper.make_node(kind, inputs, [f"x{len(self.nodes)}"], **attributes))
        return str(self.nodes[-1].output[0])

    def stem(self, x: str) -> str:
        weight = self._arrays["stem.weight"].reshape(STEM_KERNEL, STEM_KERNEL, 3, STEM_CHANNELS)
        return self.relu6(self._conv("stem", x, weight.transpose(3, 2, 0, 1), STEM_STRIDE))

    def filter(self, name: str, x: str, stride: int = 1) -> str:
        weight = self._arrays[f"{name}.weight"].transpose(2, 0, 1)[:, None]
        return self._conv(name, x, weight, stride, groups=len(weight))

    def mix(self, name: str, x: str) -> str:
        return self._conv(name, x, self._arrays[f"{name}.weight"].T[:, :, None, None])

    def _conv(self, name: str, x: str, weight: NDArray[Any], stride: int = 1, groups: int = 1) -> str:
        size = weight.shape[2]
        before = (size - stride) // 2
        after = size - stride - before
        names = [
            self.constant(f"{name}.{part}", np.ascontiguousarray(values, np.float32))
            for part, values in (("weight", weight), ("bias", self._arrays[f"{name}.bias"]))
        ]
        return self.add("Conv", x, *names, group=groups, pads=[before, before, after, after], strides=[stride] * 2)

    def relu6(self, x: str) -> str:
        return self.add("Clip", x, "zero", "six")

    def separable(self, name: str, x: str) -> str:
        return self.add("Relu", self.mix(f"{name}.mix", self.filter(f"{name}.filter", x)))


def _onnx(arrays: dict[str, NDArray[Any]]) -> bytes:
    """Write the network down for other libraries."""
    import onnx

    g = _Graph(arrays)
    x, width, taps = g.stem("color"), STEM_CHANNELS, []
    for number, (_, stride, wide, out) in enumerate(blocks()):
        name = f"blocks.{number}"
        y = g.relu6(g.mix(f"{name}.expand", x)) if wide > width else x
        y = g.mix(f"{name}.project", g.relu6(g.filter(f"{name}.filter", y, stride)))
        x, width = g.add("Add", x, y) if stride == 1 and width == out else y, out
        taps += [x] if number in TAPS else []
    *finer, deepest = taps
    position = g.constant("position", np.moveaxis(arrays["position"], -1, 0)[None].astype(np.float32))
    whole = g.mix("whole", g.add("GlobalAveragePool", deepest))
    x = g.add("Add", g.add("Add", g.mix(f"lateral.{len(finer)}", deepest), position), whole)
    for k in range(len(TOP)):
        x = g.separable(f"top.{k}", x)
    sizes = g.constant("sizes", np.array([1.0, 1.0, 2.0, 2.0], np.float32))
    for k, tap in enumerate(reversed(finer)):
        larger = g.add("Resize", x, "", sizes, mode="linear", coordinate_transformation_mode="half_pixel")
        x = g.separable(f"smooth.{k}", g.add("Add", larger, g.mix(f"lateral.{len(finer) - 1 - k}", tap)))
    parts = g.mix("labels", x), g.mix("layout", g.separable("behind", x)), g.mix("classes", x)
    scores = g.add("Concat", *parts, axis=1)
    kind, make = onnx.TensorProto.FLOAT, onnx.helper.make_tensor_value_info
    inputs = [make("color", kind, [1, 3, INPUT_HEIGHT, INPUT_WIDTH])]
    graph = onnx.helper.make_graph(
        g.nodes, "scene", inputs, [make(scores, kind, [1, N_SCORES, ROWS, COLUMNS])], g.constants
    )
    opset = [onnx.helper.make_opsetid("", 13)]
    return bytes(onnx.helper.make_model(graph, opset_imports=opset, ir_version=8).SerializeToString())


if __name__ == "__main__":
    sys.exit(main())
