"""The exported network as a file that OpenCV 4.6 (Ubuntu 24.04) to 5.0 read, at half the size."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def portable_onnx(network: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Rewrite an ONNX file of `scene_model.export_onnx`.

    OpenCV 4.6 reads neither the amounts of Pad that PyTorch computes by a chain of constant nodes nor the bounds of
    Clip as inputs; both are folded (Clip into attributes, the form of opset 6, which all these versions take). Weights
    are rounded to half precision but kept as float32: packed, the file is half as large, and scores change by some
    hundredths at most.

    Parameters
    ----------
    network : (n,) uint8
    """
    import onnx

    model = onnx.load_from_string(network.tobytes())
    _round_weights(model.graph)
    for node in model.graph.node:
        if node.op_type == "Pad":
            amounts = np.asarray(_constant(model, node.input[1]), np.int64)
            model.graph.initializer.append(onnx.numpy_helper.from_array(amounts, f"{node.name}_amounts"))
            node.input[1] = model.graph.initializer[-1].name
            del node.input[2:]
        elif node.op_type == "Clip":
            bounds = [float(_constant(model, name)) for name in node.input[1:]]
            del node.input[1:]
            pairs = zip(("min", "max"), bounds, strict=True)
            node.attribute.extend([onnx.helper.make_attribute(*pair) for pair in pairs])
    _drop_unused(model.graph)
    return np.frombuffer(model.SerializeToString(deterministic=True), np.uint8).copy()


def _round_weights(graph: Any) -> None:
    import onnx

    for weight in graph.initializer:
        if weight.data_type == onnx.TensorProto.FLOAT:
            rounded = onnx.numpy_helper.to_array(weight).astype(np.float16).astype(np.float32)
            weight.CopyFrom(onnx.numpy_helper.from_array(rounded, weight.name))


def _constant(model: Any, name: str) -> NDArray[Any]:
    """Compute what depends on constants alone."""
    import onnx
    from onnx.reference import ReferenceEvaluator

    maker = {output: node for node in model.graph.node for output in node.output}
    nodes: list[Any] = []

    def gather(wanted: str) -> None:
        node = maker.get(wanted)
        if node is not None and node not in nodes:
            for source in node.input:
                gather(source)
            nodes.append(node)

    gather(name)
    result = onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None)
    graph = onnx.helper.make_graph(nodes, "constant", [], [result], list(model.graph.initializer))
    part = onnx.helper.make_model(graph, opset_imports=model.opset_import, ir_version=model.ir_version)
    return np.asarray(ReferenceEvaluator(part).run(None, {})[0])


def _drop_unused(graph: Any) -> None:
    while True:
        used = {name for node in graph.node for name in node.input} | {output.name for output in graph.output}
        unused = [node for node in graph.node if not set(node.output) & used]
        if not unused:
            return
        for node in unused:
            graph.node.remove(node)
