"""Settings of the node (streams, outputs, diagnostics) beside those of the estimator; one table, no ROS."""

from __future__ import annotations

from dataclasses import dataclass

from .core.config import _p as setting
from .core.config import parameters


@dataclass(frozen=True, slots=True)
class NodeConfig:
    """Settings of the ROS 2 node; a change makes a new value (`dataclasses.replace`).

    Raises
    ------
    ValueError
        When a value is of the wrong type, out of its bounds or at odds with another.
    """

    # streams
    max_stamp_gap: float = setting(
        0.02, "largest difference of the stamps of colour and depth of one frame", "s", 0.0, 1.0
    )
    reset_gap: float = setting(
        0.5,
        "a frame older than the last one by more than this is a jump of the clock (bag loop): start afresh",
        "s",
        0.05,
        60.0,
    )
    queue_size: int = setting(10, "messages of a stream that may wait for their partner", "", 1, 100)
    no_data_timeout: float = setting(
        5.0, "silence after which missing input is an error on /diagnostics", "s", 0.5, 3600.0
    )
    lazy_inputs: bool = setting(True, "subscribe to the inputs only while an output has a listener")
    # estimation
    warm_start: bool = setting(
        True, "hand the axes of one frame to the next (false: each frame alone, bit-equal to the offline result)"
    )
    # outputs
    marker_lifetime: float = setting(0.5, "markers vanish from RViz after this (0: never)", "s", 0.0, 3600.0)
    diagnostics_period: float = setting(1.0, "time between messages on /diagnostics", "s", 0.1, 60.0, runtime=False)

    def __post_init__(self) -> None:
        for parameter in parameters(type(self)):
            object.__setattr__(self, parameter.name, parameter.check(getattr(self, parameter.name)))
        if self.max_stamp_gap >= self.reset_gap:
            raise ValueError(
                f"max_stamp_gap is {self.max_stamp_gap} s; it must be below reset_gap, which is {self.reset_gap} s"
            )
