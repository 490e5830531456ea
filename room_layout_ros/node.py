"""The ROS 2 node `estimator`, plain and lifecycle, and their processes."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.qos_overriding_options import InvalidQosOverridesError
from rclpy.utilities import ok, try_shutdown

from .core.estimator import LayoutEstimator
from .settings import MakeEstimator
from .shell import Shell

NODE_NAME = "estimator"

_SETTINGS_ERRORS = (
    ValueError,
    ParameterException,
    NameValidationException,
    InvalidQosOverridesError,
    RuntimeError,  # what rcl says of its arguments and files
)


class EstimatorNode(Node):
    """The plain node: works from the start."""

    def __init__(self, make_estimator: MakeEstimator = LayoutEstimator, **options: Any) -> None:
        super().__init__(NODE_NAME, **options)
        self.shell = Shell(self, make_estimator)
        self.shell.configure()
        self.shell.activate()

    def close(self) -> bool:
        """End the worker; False if it is still inside a frame."""
        return self.shell.cleanup()


class EstimatorLifecycleNode(LifecycleNode):
    """The lifecycle node: configure makes the topics and warms up, activate subscribes."""

    def __init__(self, make_estimator: MakeEstimator = LayoutEstimator, **options: Any) -> None:
        super().__init__(NODE_NAME, **options)
        self.shell = Shell(self, make_estimator)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unconfigured -> inactive."""
        return self._transition(self.shell.configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive -> active."""
        return self._transition(self.shell.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Active -> inactive."""
        return self._transition(self.shell.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive -> unconfigured."""
        return self._transition(self.shell.cleanup)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Any -> finalized."""
        return self._transition(self.shell.cleanup)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """After a failed transition: back to unconfigured."""
        return self._transition(self.shell.cleanup)

    def close(self) -> bool:
        """End the worker; False if it is still inside a frame."""
        return self.shell.cleanup()

    def _transition(self, work: Callable[[], Any]) -> TransitionCallbackReturn:
        try:
            work()
        except Exception as error:  # noqa: BLE001  rclpy swallows it without a word
            self.get_logger().error(f"{type(error).__name__} in a transition: {error}")
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS


def main(args: Sequence[str] | None = None) -> int:
    """Run the plain node until SIGINT or SIGTERM; 0 at the end, 2 when the settings are wrong."""
    return _run(EstimatorNode, args)


def lifecycle_main(args: Sequence[str] | None = None) -> int:
    """Run the lifecycle node until SIGINT or SIGTERM."""
    return _run(EstimatorLifecycleNode, args)


def _run(make_node: Callable[[], Any], args: Sequence[str] | None) -> int:
    ended = True
    try:
        initialised = False
        try:
            rclpy.init(args=None if args is None else list(args))
            initialised = True
            node = make_node()
        except (KeyboardInterrupt, ExternalShutdownException):
            return 0
        except _SETTINGS_ERRORS as error:
            if initialised and not ok():  # a signal ended the context while the node was made
                return 0
            print(f"estimator: {error}", file=sys.stderr)
            return 2
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        try:
            _spin(executor, node)
        finally:
            ended = node.close()
    except KeyboardInterrupt:  # a second Ctrl-C during the end
        ended = False
    finally:
        try_shutdown()
        if not ended:  # a worker inside a compilation cannot be stopped
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(0)
    return 0


def _spin(executor: SingleThreadedExecutor, node: Any) -> None:
    while ok():
        try:
            executor.spin()
        except (KeyboardInterrupt, ExternalShutdownException):
            return
        except Exception as error:  # noqa: BLE001
            node.shell.complain("executor", f"{type(error).__name__} in the executor: {error}")
            time.sleep(0.01)


if __name__ == "__main__":
    sys.exit(main())
