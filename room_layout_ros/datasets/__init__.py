"""Where frames come from: frames folders, rosbag2, NYU v2 .mat, synthetic rooms; all yield the same samples."""

from .calibration import CameraCalibration
from .errors import DataError
from .folder import FramesFolder, open_folder
from .sample import BadFrame, FloorMap, FrameSource, FrameTruth, Sample, good_samples, labels_from_classes
from .source import open_source

__all__ = [
    "BadFrame",
    "CameraCalibration",
    "DataError",
    "FloorMap",
    "FrameSource",
    "FrameTruth",
    "FramesFolder",
    "Sample",
    "good_samples",
    "labels_from_classes",
    "open_folder",
    "open_source",
]
