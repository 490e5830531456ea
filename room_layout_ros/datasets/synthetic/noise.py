"""What depth cameras do to depth: quantised disparity, shadows, lost pixels, blobs, bias."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics

from .shapes import GLASS, SHINY

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """One kind of sensor. Zero switches a term off.

    Attributes
    ----------
    baseline_m : between projector or second camera and the first; 0 for exact depth.
    disparity_sigma_px : noise of the disparity. disparity_step_px : its quantisation.
    blob_sigma_px, blob_px : disparity noise that is smooth over `blob_px` pixels.
    bias_px : largest slow error of the disparity over the image.
    jitter_px : depth is taken this far beside the pixel (rough edges).
    min_m, max_m : range. edge_loss : share of pixels lost along depth edges.
    plain_loss : share lost where the picture has no texture (stereo).
    shadow : 1 where the projector does not reach. glass_loss, shiny_loss : share lost, in blobs.
    step_mm : final quantisation. fill_holes : as the NYU v2 data set does.
    color_sigma : grey levels. border_px : white border of the colour image.
    """

    name: str
    baseline_m: float = 0.0
    disparity_sigma_px: float = 0.0
    disparity_step_px: float = 0.0
    blob_sigma_px: float = 0.0
    blob_px: float = 6.0
    bias_px: float = 0.0
    jitter_px: float = 0.0
    min_m: float = 0.0
    max_m: float = np.inf
    edge_loss: float = 0.0
    plain_loss: float = 0.0
    shadow: bool = False
    glass_loss: float = 0.0
    shiny_loss: float = 0.0
    step_mm: float = 0.0
    fill_holes: bool = False
    color_sigma: float = 0.0
    border_px: int = 0


CLEAN = SensorNoise("clean")

# sigma_z = z^2 / (f b) sigma_d: with f b = 525 * 0.075 px m, 0.055 px gives the 0.0014 z^2 of the Kinect.
KINECT_NOISE = SensorNoise(
    "kinect", 0.075, 0.055, 0.125, 0.02, 9.0, 0.03, 0.5, 0.5, 8.0, 0.45, 0.0, True, 0.9, 0.35, 1.0, False, 2.5
)
STEREO_NOISE = SensorNoise(
    "stereo", 0.050, 0.04, 0.03125, 0.09, 7.0, 0.12, 1.0, 0.3, 6.0, 0.6, 0.2, True, 0.7, 0.3, 1.0, False, 3.0
)
NYU8_NOISE = SensorNoise(
    "nyu8", 0.075, 0.055, 0.125, 0.02, 9.0, 0.03, 0.5, 0.5, 10.0, 0.45, 0.0, True, 0.9, 0.35, 10000 / 255, True, 2.5, 9
)
NOISES = {noise.name: noise for noise in (CLEAN, KINECT_NOISE, STEREO_NOISE, NYU8_NOISE)}


def sense_color(radiance: Image, noise: SensorNoise, rng: np.random.Generator | None) -> NDArray[np.uint8]:
    """Return the (H, W, 3) uint8 picture: slight blur of the optics, vignette, noise, border."""
    if rng is None or noise.color_sigma <= 0:
        return np.clip(radiance + 0.5, 0, 255).astype(np.uint8)
    picture = cv2.GaussianBlur(radiance, (3, 3), 0.6)
    height, width = picture.shape[:2]
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    picture = picture * (1.0 - 0.09 * (x * x + y * y)).astype(np.float32)[..., None]
    grain = rng.standard_normal(picture.shape, np.float32)
    picture += (grain + cv2.GaussianBlur(grain, (3, 3), 0)) * np.float32(noise.color_sigma / 1.4)
    color = np.clip(picture + 0.5, 0, 255).astype(np.uint8)
    if noise.border_px:
        b = noise.border_px
        color[:b], color[-b:], color[:, :b], color[:, -b:] = 255, 255, 255, 255
    return color


def sense_depth(
    depth_m: Image,
    normals: Image,
    sensing: NDArray[np.uint8],
    color: NDArray[np.uint8],
    camera: CameraIntrinsics,
    noise: SensorNoise,
    rng: np.random.Generator | None,
) -> Image:
    """Return what the sensor measures: (H, W) float32 metres, NaN where nothing."""
    if rng is None or noise.baseline_m <= 0:
        return np.where(np.isfinite(depth_m), depth_m, np.float32(np.nan)).astype(np.float32)
    scale = camera.fx * noise.baseline_m
    clean = scale / depth_m
    disparity = _jittered(clean, noise, rng)
    disparity += rng.standard_normal(depth_m.shape, np.float32) * np.float32(noise.disparity_sigma_px)
    disparity += _smooth(depth_m.shape, noise.blob_px, rng) * np.float32(noise.blob_sigma_px)
    disparity += _smooth(depth_m.shape, 160.0, rng) * np.float32(noise.bias_px / 2)
    if noise.disparity_step_px > 0:
        disparity = np.rint(disparity / noise.disparity_step_px) * np.float32(noise.disparity_step_px)
    lost = _lost(depth_m, clean, normals, sensing, color, camera, noise, rng)
    with np.errstate(divide="ignore"):
        measured = scale / disparity
    lost |= ~((measured > noise.min_m) & (measured < noise.max_m))
    if noise.fill_holes:
        measured = _fill(measured, lost)
        lost[:] = False
    step_m = noise.step_mm / 1000.0
    measured = np.rint(measured / step_m) * step_m
    return np.where(lost | (measured <= 0), np.nan, measured).astype(np.float32)


def _jittered(disparity: Image, noise: SensorNoise, rng: np.random.Generator) -> Image:
    if noise.jitter_px <= 0:
        return disparity.copy()
    height, width = disparity.shape
    y, x = np.indices(disparity.shape)
    dx, dy = (np.rint(rng.standard_normal(disparity.shape, np.float32) * noise.jitter_px).astype(int) for _ in "xy")
    yy, xx = np.clip(y + dy, 0, height - 1), np.clip(x + dx, 0, width - 1)
    # Only across edges is the neighbour's depth another; on a plane the jitter would be noise that no sensor has.
    near = disparity[yy, xx]
    return np.where(np.abs(near - disparity) > 0.04 * disparity, near, disparity)


def _smooth(shape: tuple[int, ...], size_px: float, rng: np.random.Generator) -> Image:
    """Return unit-variance noise with features of about `size_px` pixels."""
    rows, columns = (max(3, round(n / size_px) + 3) for n in shape)
    coarse = rng.standard_normal((rows, columns), np.float32)
    field = cv2.resize(coarse, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return np.asarray(field / max(float(field.std()), 1e-6), dtype=np.float32)


def _lost(
    depth_m: Image,
    disparity: Image,
    normals: Image,
    sensing: NDArray[np.uint8],
    color: NDArray[np.uint8],
    camera: CameraIntrinsics,
    noise: SensorNoise,
    rng: np.random.Generator,
) -> NDArray[np.bool_]:
    chance = rng.random(depth_m.shape, np.float32)
    blobs = _uniform(_smooth(depth_m.shape, 14.0, rng))
    lost = ~np.isfinite(depth_m)
    lost |= (sensing == GLASS) & (blobs < noise.glass_loss)
    lost |= (sensing == SHINY) & (blobs < noise.shiny_loss)
    near = cv2.dilate(disparity, np.ones((3, 3), np.uint8))
    far = cv2.erode(disparity, np.ones((3, 3), np.uint8))
    lost |= (near - far > 0.06 * disparity) & (chance < noise.edge_loss)
    rays = camera.rays()
    facing = np.abs(np.einsum("ijk,ijk->ij", normals, rays)) / np.linalg.norm(rays, axis=2)
    lost |= facing < 0.07 + 0.09 * chance  # too flat a view: the pattern is smeared
    if noise.plain_loss > 0:
        grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY).astype(np.float32)
        mean = cv2.blur(grey, (11, 11))
        spread = cv2.blur(grey * grey, (11, 11)) - mean * mean
        plain = spread < 2.5 * max(noise.color_sigma, 1.0) ** 2
        lost |= plain & (_uniform(_smooth(depth_m.shape, 22.0, rng)) < noise.plain_loss)
    if noise.shadow:
        lost |= _shadow(disparity)
    return np.asarray(lost)


def _uniform(field: Image) -> Image:
    """Map unit-variance noise to about 0..1 evenly (logistic approximation of the normal distribution)."""
    return np.asarray(1.0 / (1.0 + np.exp(-1.702 * field)), dtype=np.float32)


@njit(cache=True, nogil=True)
def _shadow(disparity):  # type: ignore[no-untyped-def]
    """Pixels that the projector, to the right of the camera, cannot reach: another one stands before them."""
    height, width = disparity.shape
    hidden = np.zeros((height, width), np.bool_)
    for y in range(height):
        reach = 1e9
        for x in range(width - 1, -1, -1):
            column = x - disparity[y, x]
            # Seen from the projector columns must fall from right to left; what turns back is behind something.
            if column > reach + 0.5:
                hidden[y, x] = True
            else:
                reach = min(reach, column)
    return hidden


def _fill(measured: Image, lost: NDArray[np.bool_]) -> Image:
    """Fill holes from their nearest measured neighbours, smoothly inside, as a data set would."""
    if lost.all():
        return np.zeros_like(measured)
    _, nearest = cv2.distanceTransformWithLabels(lost.astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL)
    values = np.zeros(int(nearest.max()) + 1, np.float32)
    values[nearest[~lost]] = measured[~lost]
    filled = values[nearest]
    soft = cv2.blur(filled, (5, 5))
    return np.where(lost, soft, measured)
