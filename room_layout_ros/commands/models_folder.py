"""The option --models: learned models of one's own in the place of those that ship."""

from __future__ import annotations

import argparse
import sys
from filecmp import cmp
from pathlib import Path

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.model_file import WeightsError
from room_layout_ros.core.models import config_folder, used_files
from room_layout_ros.datasets import DataError


def add_models_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option that names a folder of models."""
    parser.add_argument(
        "--models",
        type=Path,
        metavar="DIR",
        help="learned models of your own: a copy of config/ with the files of room-layout train in it",
    )


def usable_models(
    folder: Path | None, config: EstimatorConfig, also_rgb: bool = False, plain_by: str = "--set scene_network=false"
) -> Path | None:
    """Return the folder that --models names, as every worker finds it; None without the option.

    Says so where all that the settings use of it are the models that ship, and others in it are not.

    Parameters
    ----------
    folder : of the option.
    config : of the estimator that shall use it.
    also_rgb : frames are estimated a second time, without their depth.
    plain_by : the option by which the command leaves the scene network out.

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
    if unused := _unused(folder, used_files(config, also_rgb)):
        others = f" and {len(unused) - 1} more" if len(unused) > 1 else ""
        way = f", {plain_by}" if all(name.endswith("_plain.npz") for name in unused) else ""
        print(
            f"--models {folder}: with these settings all models used are those that ship; {unused[0]}{others} of your "
            f"own need other settings{way}",
            file=sys.stderr,
        )
    return folder


def _unused(folder: Path, used: set[str]) -> list[str]:
    """Return the models of one's own in the folder where none of them is among the files used."""
    shipped = config_folder()
    known = sorted(path.name for path in shipped.glob("*.npz") if (folder / path.name).is_file())
    own = [name for name in known if not cmp(folder / name, shipped / name, shallow=False)]
    return [] if used.intersection(own) else own
