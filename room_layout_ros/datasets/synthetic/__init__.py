"""Synthetic rooms: an analytic ray caster with exact truth. The same seed gives the same bytes."""

from .floor import floor_map
from .noise import CLEAN, KINECT_NOISE, NOISES, NYU8_NOISE, STEREO_NOISE, SensorNoise
from .paths import camera_pose, random_pose, walk
from .render import KINECT, render
from .room import KINDS, SyntheticRoom, empty_room
from .scene import random_scene
from .source import SyntheticSource

__all__ = [
    "CLEAN",
    "KINDS",
    "KINECT",
    "KINECT_NOISE",
    "NOISES",
    "NYU8_NOISE",
    "STEREO_NOISE",
    "SensorNoise",
    "SyntheticRoom",
    "SyntheticSource",
    "camera_pose",
    "empty_room",
    "floor_map",
    "random_pose",
    "random_scene",
    "render",
    "walk",
]
