"""Layout and labelling error on the hand-made layouts of NYU v2, beside plain solutions and the paper."""

from __future__ import annotations

import sys

from benchmarks._frames import DATA
from room_layout_ros.cli import main as room_layout


def main() -> int:
    if not (DATA / "nyuv2" / "splits.json").exists():
        print(f"{DATA / 'nyuv2'} is not here: nothing to measure")
        return 0
    return room_layout(["evaluate", str(DATA / "nyuv2"), "--frames", "layout_dev"])


if __name__ == "__main__":
    sys.exit(main())
