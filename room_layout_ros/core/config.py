"""Every setting of the estimator in one table: default, bounds, unit, meaning, run-time change."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

Value = bool | int | float | str

JOINT, SIMPLE = "joint", "depth"
"""Values of `method`: the learned model, the simple depth estimator."""

CONTEXT, KERNEL = "context", "kernel"
"""Values of `furniture_features`."""

JOINT_VARIANTS = ("full", "paper", "rgb", "om_only", "gc_only", "no_compatibility", "no_planes", "no_pairs")
"""Values of `joint_variant`: all of `weights.VARIANTS` but that without the scene network, a setting of its own."""

EDGES, DEPTH, NONE = "edges", "depth", "none"
"""Values of `refinement`: onto the edges of the picture too, to the depth alone, none."""

_MIN_WORKING_PX = 160
"""Smaller images have too few cells of depth."""

_MAX_CELLS = 4_000_000
"""Of the free-space grid: so many take 0.25 s a frame; 18 million, 1.2 s and 1.3 GB more than the usual 19 thousand."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One row of the table."""

    name: str
    default: Value
    meaning: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    runtime: bool = True

    def check(self, value: object) -> Value:
        """Return `value` in the parameter's type.

        Raises
        ------
        ValueError
            One sentence with the name, the value and what is allowed.
        """
        kind = type(self.default)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not kind:
            raise ValueError(f"{self.name} is {value!r}; it must be of type {kind.__name__}")
        if self.choices and value not in self.choices:
            raise ValueError(f"{self.name} is {value!r}; allowed are {', '.join(self.choices)}")
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            low = -math.inf if self.low is None else self.low
            high = math.inf if self.high is None else self.high
            if not low <= value <= high:
                raise ValueError(f"{self.name} is {value}{self.unit and ' ' + self.unit}; allowed is {low} to {high}")
        return value


def _p(
    default: Value,
    meaning: str,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    runtime: bool = True,
) -> Any:
    keys = {"meaning": meaning, "unit": unit, "low": low, "high": high, "choices": choices, "runtime": runtime}
    return dataclasses.field(default=default, metadata=keys)


@dataclass(frozen=True, slots=True)
class EstimatorConfig:
    """Settings of `LayoutEstimator`; a change makes a new value (`dataclasses.replace`).

    Raises
    ------
    ValueError
        When a value is of the wrong type or out of its bounds, the working size is too small, the nearest depth is not
        before the farthest, the lowest obstacle is not lower than the robot, or the free-space grid has too many cells.
    """

    use_color: bool = _p(True, "use the colour image (false: depth-only operation)")
    use_depth: bool = _p(True, "use the depth image (false: the paper's RGB variant)")
    working_size_px: int = _p(
        640, "images are resized by a whole factor until the longer side is about this (0: not at all; at least 160); "
        "results have the image's size", "px", 0, 8192,
    )  # fmt: skip
    method: str = _p(
        JOINT, "joint: the learned model; depth: the simple depth estimator (a baseline)", choices=(JOINT, SIMPLE)
    )
    scene_network: bool = _p(True, "look at the colour image with the convolutional network, the most accurate way")
    furniture_features: str = _p(
        CONTEXT, "what tells furniture: context, a forest, 1 ms; kernel, the paper's kernel descriptors, 0.3 s",
        choices=(CONTEXT, KERNEL),
    )  # fmt: skip
    axes_hypotheses: int = _p(4, "namings and triples of the axes that the joint energy chooses from", "", 1, 8)
    axes_hypotheses_rgb: int = _p(2, "the same without depth", "", 1, 8)
    min_depth_m: float = _p(0.2, "nearer measurements, as those of the robot itself, are ignored", "m", 0.0, 5.0)
    max_depth_m: float = _p(12.0, "farther measurements are ignored", "m", 1.0, 100.0)
    min_valid_depth: float = _p(
        0.02, "below this share of measured pixels a frame has no depth: colour alone, or NO_DEPTH", "", 0.0, 1.0
    )
    # superpixels (paper 3.1)
    superpixel_count: int = _p(200, "superpixels per image", "", 16, 4000)
    superpixel_oversegmentation: float = _p(
        2.0, "superpixels before neighbours are merged, over the number wanted; 1 is SLIC alone", "", 1.0, 8.0
    )
    superpixel_lambda_color: float = _p(10.0, "weight of the colour term (paper: lambda_a)", "", 0.0, 100.0)
    superpixel_lambda_depth: float = _p(
        2.0, "weight of the depth term, the residual to the superpixel's plane; 0 is the paper's plain SLIC only with "
        "superpixel_oversegmentation 1", "", 0.0, 100.0,
    )  # fmt: skip
    superpixel_lambda_gradient: float = _p(
        0.0, "weight of the gradient of inverse depth, the paper's own term (lambda_d); 20 ms more", "", 0.0, 100.0
    )
    superpixel_depth_cap: float = _p(20.0, "largest cost of a residual to the plane, in squared noise", "", 0.1, 1000.0)
    superpixel_noise_inverse_depth: float = _p(0.004, "noise of inverse depth (Kinect: constant)", "1/m", 1e-6, 1.0)
    superpixel_noise_depth_m: float = _p(0.02, "noise of depth besides (steps of 8-bit depth)", "m", 0.0, 1.0)
    superpixel_noise_gradient: float = _p(0.0005, "noise of the gradient of inverse depth", "1/m/px", 1e-7, 1.0)
    # line segments and vanishing points
    line_scale: float = _p(0.5, "line segments are sought in the working image reduced by this factor", "", 0.1, 1.0)
    line_min_length_px: float = _p(16.0, "shorter segments (pixels of the working image) are dropped", "px", 2.0, 500.0)
    vp_max_tilt_deg: float = _p(50.0, "largest pitch searched when axes come from lines alone", "deg", 1.0, 60.0)
    vp_max_roll_deg: float = _p(20.0, "largest roll searched when axes come from lines alone", "deg", 0.0, 45.0)
    # joint model (paper 3.2, 3.3)
    layout_rays: int = _p(50, "states per ray of the layout, on average", "", 2, 400)
    layout_angle_bins: int = _p(320, "bins of the corner angle in all four quadrants", "", 8, 4096)
    layout_pixel_step: int = _p(5, "one in so many pixels is counted in the faces; 1 is exact", "", 1, 16)
    layout_scales: int = _p(12, "candidate distances of the front wall", "", 4, 64)
    layout_temperature: float = _p(0.01, "energy (share of the image) at which belief falls to 1/e", "", 1e-6, 10.0)
    joint_alternations: int = _p(5, "rounds of labels and layout at most (Alg. 1: M)", "", 1, 50)
    joint_starts: int = _p(2, "diverse layouts that the alternation starts from", "", 1, 20)
    joint_variant: str = _p("full", "blocks of the model that are used", choices=JOINT_VARIANTS)
    refinement: str = _p(
        EDGES, "of the joint solution's planes: to the depth and onto the edges of the picture; to the depth alone; "
        "none, as in the paper", choices=(EDGES, DEPTH, NONE),
    )  # fmt: skip
    joint_bound: bool = _p(False, "compute the lower bound of the joint energy too")
    labelling_sweeps: int = _p(10, "sweeps of message passing at most", "", 1, 1000)
    # free space (issue 5): the floor plane, the grid on it, obstacles and drops
    free_space_resolution_m: float = _p(0.05, "side of a cell of the free-space grid", "m", 0.01, 0.5)
    free_space_forward_m: float = _p(6.0, "the grid reaches this far ahead of the camera", "m", 0.5, 30.0)
    free_space_side_m: float = _p(4.0, "the grid reaches this far to either side", "m", 0.5, 30.0)
    floor_min_share: float = _p(0.005, "share of the image that must be floor to fit the floor plane", "", 0.0001, 0.5)
    floor_tolerance_m: float = _p(
        0.15, "the depth may correct a given camera height by this much; set it below the height of steps that matter",
        "m", 0.01, 1.0,
    )  # fmt: skip
    obstacle_min_height_m: float = _p(0.02, "what is lower lies on the floor and can be driven over", "m", 0.005, 0.5)
    robot_height_m: float = _p(
        2.0, "what is higher the robot passes under (less than 0.2: under what is higher than 0.2)", "m", 0.05, 5.0
    )
    obstacle_noise_factor: float = _p(
        3.5, "a pixel is an obstacle above this many standard deviations of the floor's height", "", 1.0, 10.0
    )
    obstacle_min_area: float = _p(
        0.15, "visible surface that makes a thing an obstacle, as a share of a cell's square", "", 0.001, 1.0
    )
    obstacle_margin_m: float = _p(0.10, "cells this near before an obstacle are not called free", "m", 0.0, 1.0)
    free_min_seen: float = _p(0.5, "share of a cell's floor that must be seen to call it free", "", 0.05, 1.0)
    free_seen_height_m: float = _p(
        0.0, "floor is free only where the picture reaches this high above it (0: not asked; 0.8: above a table's top)",
        "m", 0.0, 5.0,
    )  # fmt: skip
    free_by_picture: bool = _p(
        False, "floor without depth may be free within 10 cm of measured floor where the picture shows no outline"
    )
    free_beyond_walls: bool = _p(False, "floor seen beyond a wall of the room (open door) may be free")
    scan_beams: int = _p(160, "beams of the scan across the field of view", "", 8, 4000)
    cloud_step: int = _p(2, "one in so many pixels per row and column enters the obstacle and floor clouds", "", 1, 16)

    object_min_pixels: int = _p(400, "a patch of clutter with fewer pixels is no object", "px", 1, 100000)

    def __post_init__(self) -> None:
        for parameter in parameters(type(self)):
            object.__setattr__(self, parameter.name, parameter.check(getattr(self, parameter.name)))
        if 0 < self.working_size_px < _MIN_WORKING_PX:
            raise ValueError(
                f"working_size_px is {self.working_size_px} px; "
                f"allowed are 0 (no resizing) and {_MIN_WORKING_PX} or more"
            )
        if self.min_depth_m >= self.max_depth_m:
            raise ValueError(
                f"min_depth_m is {self.min_depth_m} m and max_depth_m {self.max_depth_m} m; the first must be less"
            )
        if self.obstacle_min_height_m >= self.robot_height_m:
            raise ValueError(
                f"obstacle_min_height_m is {self.obstacle_min_height_m} m; "
                f"it must be below robot_height_m, which is {self.robot_height_m} m"
            )
        self._check_grid()

    def namings(self, with_depth: bool) -> int:
        """Namings of the axes that are tried in a frame with depth, or without."""
        return self.axes_hypotheses if with_depth else self.axes_hypotheses_rgb

    def _check_grid(self) -> None:
        forward_m, width_m, size_m = self.free_space_forward_m, 2 * self.free_space_side_m, self.free_space_resolution_m
        cells = round(forward_m / size_m) * round(width_m / size_m)
        if cells > _MAX_CELLS:
            raise ValueError(
                f"free_space_resolution_m is {size_m} m for a grid of {forward_m} m x {width_m} m: "
                f"{cells} cells; at most {_MAX_CELLS} are allowed"
            )


def parameters(table: type = EstimatorConfig) -> Iterator[Parameter]:
    """Yield the rows of a settings table in their order."""
    for field in dataclasses.fields(table):
        default: Any = field.default
        yield Parameter(name=field.name, default=default, **field.metadata)


def nearest_name(wanted: str, known: Iterable[str], otherwise: str) -> str:
    """Return "the nearest name is X" for a name that is none of those known, `otherwise` where none is near."""
    near = difflib.get_close_matches(wanted, known, 1)
    return f"the nearest name is {near[0]}" if near else otherwise
