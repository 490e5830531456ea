"""The ROS 2 node `estimator`, plain and lifecycle, and how it runs until it is told to end."""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.utilities import ok

from .core.estimator import LayoutEstimator
from .ros_process import BAD_SETTINGS, idle_files, join, leave, sentence, unknown_remaps
from .settings import MakeEstimator
from .shell import Shell

NODE_NAME = "estimator"


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
        if options.get("enable_communication_interface", True):
            self._answer_change_state = self._service_change_state.callback
            self._service_change_state.callback = self._change_state
        self.shell = Shell(self, make_estimator)
        name = self.get_fully_qualified_name()
        self.get_logger().info(f"waits to be configured: ros2 lifecycle set {name} configure; then activate")

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

    def _change_state(self, request: Any, response: Any) -> Any:
        """Answer the service. rclpy lets the exception of an illegal transition out, and then nobody answers."""
        try:
            return self._answer_change_state(request, response)
        except Exception as error:  # noqa: BLE001
            asked, state = request.transition, self._state_machine.current_state[1]
            self.get_logger().warning(
                f"transition {asked.label or asked.id} is not possible from {state}: {sentence(error)}"
            )
            response.success = False
            return response

    def _transition(self, work: Callable[[], Any]) -> TransitionCallbackReturn:
        try:
            ended = work()
        except Exception as error:  # noqa: BLE001  rclpy swallows it without a word
            self.get_logger().error(f"{type(error).__name__} in a transition: {error}")
            return TransitionCallbackReturn.ERROR
        if ended is False:
            self.get_logger().warning("a thread is still inside a frame; it ends by itself and publishes nothing")
        return TransitionCallbackReturn.SUCCESS


def run(make_node: Callable[[], Any], args: Sequence[str] | None) -> int:
    """Run a node until SIGINT or SIGTERM; 0 at the end, 2 when the settings are wrong."""
    ended = False
    try:
        code, ended = _work(make_node, args)
        return code
    except (KeyboardInterrupt, ExternalShutdownException):  # while it starts, or a second Ctrl-C during the end
        return 0
    finally:
        _take_signals(signal.SIG_IGN)  # all is done
        leave()
        _take_signals(signal.SIG_IGN)  # rclpy gives them back as it found them
        if not ended:  # a worker inside a compilation cannot be stopped
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(0)


def _interrupt(_number: int, _frame: object) -> None:
    """End by KeyboardInterrupt; an object of the compiler that it leaves half made ends with the process in silence."""
    sys.unraisablehook = lambda _unraisable: None
    raise KeyboardInterrupt


def _work(make_node: Callable[[], Any], args: Sequence[str] | None) -> tuple[int, bool]:
    """Return the exit code and whether all threads have ended."""
    _take_signals(_interrupt)  # rclpy puts its own handlers on top of these
    initialised = False
    try:
        join(args)
        initialised = True
        node = make_node()
    except BAD_SETTINGS as error:
        if initialised and not ok():  # a signal ended the context while the node was made
            return 0, False
        print(f"{NODE_NAME}: {sentence(error)}", file=sys.stderr)
        return 2, True
    given = sys.argv if args is None else args
    for warning in (*unknown_remaps(node, given, node.shell.topics()), *idle_files(node, given)):
        node.get_logger().warning(warning)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    _keep_what_is_loaded()
    try:
        _spin(executor, node)
    finally:
        _take_signals(_interrupt)  # with its own rclpy took these away: the next signal would kill
        ended = node.close()
    return 0, ended


def _take_signals(handler: Any) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)


def _keep_what_is_loaded() -> None:
    """Tell the garbage collector to pass over what is there by now, all of NumPy, Numba and rclpy.

    Searching it, every minute or so, held up the frame in hand by 100 ms; what comes later takes 3 ms.
    """
    gc.collect()
    gc.freeze()


def _spin(executor: SingleThreadedExecutor, node: Any) -> None:
    while ok():
        try:
            executor.spin()
        except (KeyboardInterrupt, ExternalShutdownException):
            return
        except Exception as error:  # noqa: BLE001
            node.shell.complain("executor", f"{type(error).__name__} in the executor: {error}")
            time.sleep(0.01)
