"""The option --models: learned models of one's own in the place of those that ship."""

from __future__ import annotations

import argparse
from pathlib import Path

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.model_file import WeightsError
from room_layout_ros.core.models import config_folder
from room_layout_ros.datasets import DataError


def add_models_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option that names a folder of models."""
    parser.add_argument(
        "--models",
        type=Path,
        metavar="DIR",
        help="learned models of your own: a copy of config/ with the files of room-layout train in it",
    )


def usable_models(folder: Path | None, config: EstimatorConfig) -> Path | None:
    """Return the folder that --models names, as every worker finds it; None without the option.

    Raises
    ------
    DataError
        When it lacks a model that the estimator needs, or one cannot be used: told before the first frame.
    """
    if folder is None:
        return None
    folder = folder.absolute()
    try:
        LayoutEstimator(config, folder)
    except WeightsError as error:
        raise DataError(f"{error}; --models needs a copy of {config_folder()} with your own models in it") from None
    return folder
