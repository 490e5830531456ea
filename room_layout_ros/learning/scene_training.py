"""Training of the scene network: fine-tuning of an ImageNet backbone on labelled frames and rendered rooms."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from ..core.labels import LEFT_FACE, N_FACES, N_LABELS, RIGHT_FACE
from ..core.network.scene_layers import N_CLASSES
from .scene_augmentation import Augmentation, SceneBatch, make_batch
from .scene_examples import SOME_WALL, SceneExamples
from .scene_model import SceneModel, load_backbone


@dataclass(frozen=True, slots=True)
class SceneSettings:
    """How the network is trained.

    Attributes
    ----------
    epochs, batch : passes and examples per step.
    rate, backbone_rate : highest learning rates of the decoder and of the pretrained part (one cycle, AdamW).
    decay : weight decay. average : decay of the running mean of the weights, which is what is kept.
    layout_share, classes_share : weights of those losses against that of the labels.
    rare : how much more rare classes weigh: the loss of class c counts (its share of the pixels) ** -rare.
    augmentation : of the views. seed : of everything random. threads : of PyTorch; part of what is repeatable.
    frozen : blocks of the backbone (from the stem) that stay as they are: edges and textures of ImageNet serve, and a
        third of the time would go into learning them anew.
    """

    epochs: int = 24
    batch: int = 16
    rate: float = 3e-3
    backbone_rate: float = 6e-4
    decay: float = 0.05
    average: float = 0.99
    layout_share: float = 1.0
    classes_share: float = 0.7
    augmentation: Augmentation = field(default_factory=Augmentation)
    seed: int = 0
    rare: float = 0.4
    threads: int = 2
    frozen: int = 5


@dataclass(frozen=True, slots=True)
class SceneProgress:
    """After an epoch: its number, of how many, the mean loss, and the seconds since the start."""

    epoch: int
    epochs: int
    loss: float
    seconds: float


def train_scene_model(
    examples: SceneExamples,
    backbone: Path,
    settings: SceneSettings,
    progress: Callable[[SceneProgress], object] = lambda _: None,
) -> SceneModel:
    """Train a network; the same examples, settings and libraries give the same numbers.

    Parameters
    ----------
    examples : SceneExamples
    backbone : file with ImageNet weights of EfficientNet-Lite0 (PyTorch, tensors only).
    """
    start = time.monotonic()
    torch.manual_seed(settings.seed)
    torch.set_num_threads(settings.threads)
    model = SceneModel()
    load_backbone(model, backbone)
    model = model.to(memory_format=torch.channels_last)
    model.freeze(settings.frozen)
    pretrained = {id(p) for p in model.backbone()}
    fresh = [p for p in model.parameters() if id(p) not in pretrained]
    optimizer = torch.optim.AdamW(
        [{"params": model.backbone(), "lr": settings.backbone_rate}, {"params": fresh, "lr": settings.rate}],
        weight_decay=settings.decay,
    )
    steps = max(len(examples.number) // settings.batch, 1)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, [settings.backbone_rate, settings.rate], total_steps=settings.epochs * steps, pct_start=0.15
    )
    average = AveragedModel(model, multi_avg_fn=get_ema_multi_avg_fn(settings.average), use_buffers=True)
    model.train()
    weights, total = _class_weights(examples.classes, settings.rare), 0.0
    for step, batch in enumerate(_batches(examples, settings, steps), 1):
        loss = scene_loss(model(_tensor(batch.inputs)), batch, settings, weights)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        average.update_parameters(model)
        total += float(loss.detach())
        if step % steps == 0:
            progress(SceneProgress(step // steps, settings.epochs, total / steps, time.monotonic() - start))
            total = 0.0
    trained = average.module
    if not isinstance(trained, SceneModel):
        raise AssertionError("the averaged model is of another type")
    return trained.eval()


def _class_weights(classes: NDArray[np.uint8], rare: float) -> torch.Tensor:
    """(N_CLASSES,) weights of the classes' losses, 1 on average over the pixels."""
    share = np.bincount(classes.ravel(), minlength=N_CLASSES).astype(np.float64)
    share[0] = 0.0
    share /= max(share.sum(), 1.0)
    weights = np.where(share > 0, np.maximum(share, 1e-4) ** -rare, 0.0)
    return torch.from_numpy(weights / max((weights * share).sum(), 1e-9)).float()


def _batches(examples: SceneExamples, settings: SceneSettings, steps: int) -> Iterator[SceneBatch]:
    """Yield the batches of all epochs in a random order, the next one made while one is used."""
    rng = np.random.default_rng(settings.seed)
    size = min(settings.batch, len(examples.number))
    chosen = [
        rows
        for _ in range(settings.epochs)
        for rows in np.split(rng.permutation(len(examples.number))[: steps * size], steps)
    ]

    def make(step: int) -> SceneBatch:
        return make_batch(
            examples.subset(chosen[step]), settings.augmentation, np.random.default_rng([settings.seed, step])
        )

    with ThreadPoolExecutor(1) as pool:
        ahead = pool.submit(make, 0)
        for step in range(len(chosen)):
            batch = ahead.result()
            if step + 1 < len(chosen):
                ahead = pool.submit(make, step + 1)
            yield batch


def scene_loss(
    scores: torch.Tensor, batch: SceneBatch, settings: SceneSettings, class_weights: torch.Tensor
) -> torch.Tensor:
    """Cross-entropies of labels, layout and classes; pixels without truth do not count.

    Where only "some wall" is known, the probability of the three walls together counts.
    """
    labels, layout, classes = scores.split((N_LABELS, N_FACES, N_CLASSES), dim=1)
    return (
        _label_loss(labels, torch.from_numpy(batch.labels.astype(np.int64)))
        + settings.layout_share * _cross_entropy(layout, torch.from_numpy(batch.layout.astype(np.int64)) - 1)
        + settings.classes_share * _cross_entropy(classes, _known_classes(batch.classes), class_weights)
    )


def _known_classes(classes: NDArray[np.uint8]) -> torch.Tensor:
    truth = torch.from_numpy(classes.astype(np.int64))
    return torch.where(truth == 0, -1, truth)


def _cross_entropy(scores: torch.Tensor, truth: torch.Tensor, weights: torch.Tensor | None = None) -> torch.Tensor:
    """Mean over pixels whose truth is not negative."""
    summed = functional.cross_entropy(scores, truth, weights, ignore_index=-1, reduction="sum")
    return summed / (truth >= 0).sum().clamp(min=1)


def _label_loss(scores: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    log_probability = functional.log_softmax(scores, dim=1)
    named = (truth > 0) & (truth != SOME_WALL)
    own = log_probability.gather(1, torch.where(named, truth - 1, 0)[:, None])[:, 0]
    wall = torch.logsumexp(log_probability[:, LEFT_FACE : RIGHT_FACE + 1], dim=1)
    right = torch.where(named, own, torch.where(truth == SOME_WALL, wall, 0.0))
    return -right.sum() / (truth > 0).sum().clamp(min=1)


def _tensor(inputs: NDArray[np.float32]) -> torch.Tensor:
    return torch.from_numpy(inputs).to(memory_format=torch.channels_last)
