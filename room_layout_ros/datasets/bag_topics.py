"""Which topics of a bag hold colour, depth and calibration."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from .bag_messages import CAMERA_INFO, COMPRESSED, IMAGE, POSE
from .errors import DataError

COLOR_TOPIC, DEPTH_TOPIC = "/rgb/image_rect_color", "/depth_registered/image_rect"
COLOR_INFO_TOPIC = "/rgb/camera_info"
LAYOUT_TOPIC, CLASSES_TOPIC, POSE_TOPIC = "/ground_truth/layout", "/ground_truth/labels40", "/ground_truth/pose"

# In the order of preference. Registered depth comes before depth in its own camera.
_DEPTH_HINTS = ("depth_registered", "aligned_depth", "depth_to_rgb", "depth")
_COLOR_HINTS = ("rgb", "color", "colour", "left", "image")
_FINISH_HINTS = ("image_rect", "image")
_DEPTH_WORDS = ("depth", "/stereo/image")
"""What tells depth from colour by name; DepthAI drivers call depth /oak/stereo/image_raw."""
_AS_PICTURES = "/compressed"
_NEVER = (
    *("ground_truth", "infra", "/ir/", "theora", "confidence", "mask", "label", "overlay", "mono", "/zstd"),
    "/stereo/image_rect_color",
)
"""No candidates; the last is both images of a ZED beside each other."""


@dataclass(frozen=True, slots=True)
class BagTopics:
    """The topics that make frames; None where the bag has no such stream."""

    color: str | None
    depth: str | None
    info: str | None

    @property
    def images(self) -> tuple[str, ...]:
        """The image topics that are there."""
        return tuple(topic for topic in (self.color, self.depth) if topic)


def choose_topics(
    types: Mapping[str, str],
    color_topic: str | None = None,
    depth_topic: str | None = None,
    color_info_topic: str | None = None,
    depth_info_topic: str | None = None,
    needs_info: bool = True,
    in_png: Collection[str] = (),
) -> BagTopics:
    """Choose the topics by name and type; what the caller names is taken as it is.

    Parameters
    ----------
    types : mapping
        Message type by topic.
    needs_info : bool
        False where the camera is known from elsewhere: no camera_info is chosen.
    in_png : collection of str
        Of `compressed_depth`, those that hold depth and no JPEG of it.

    Raises
    ------
    DataError
        When a named topic is not there or of the wrong type, no camera's image is found, or several fit equally well.
    """
    images = [t for t, kind in types.items() if kind in (IMAGE, COMPRESSED)]
    for named in (color_topic, depth_topic):
        if named and named not in images:
            raise DataError(f"the bag has no image topic {named}; it has {_listed(images)}")
    results = [t for t in images if _is_result(t, types) and t not in (color_topic, depth_topic)]
    if results and len(results) == len(images):
        raise DataError(f"the bag holds results of the estimator ({_listed(images)}), no images of a camera")
    images = [t for t in images if t not in results and not any(word in t.lower() for word in _NEVER)]
    depths = [t for t in images if _is_depth(t)]
    colors = [t for t in images if t not in depths and t != depth_topic]
    depths = [t for t in depths if t != color_topic and (t in in_png or not t.endswith(_AS_PICTURES))]
    depth = depth_topic or _best("depth", _beside(color_topic, depths), _DEPTH_HINTS)
    color = color_topic or _best("colour", _without_right(_beside(depth_topic, colors)), _COLOR_HINTS)
    if not color and not depth:
        raise DataError(f"the bag has no colour or depth images; its topics are {_listed(list(types))}")
    if not needs_info:
        return BagTopics(color, depth, None)
    infos = [t for t, kind in types.items() if kind == CAMERA_INFO]
    info = (color_info_topic or depth_info_topic) if color else (depth_info_topic or color_info_topic)
    if info and info not in infos:
        raise DataError(f"the bag has no camera_info topic {info}; it has {_listed(infos)}")
    return BagTopics(color, depth, info or _info(color, depth, infos))


def compressed_depth(types: Mapping[str, str]) -> list[str]:
    """Return the topics of depth that is compressed as colour is: as JPEG, which loses it, or as PNG."""
    pictures = (t for t, kind in types.items() if kind == COMPRESSED and t.endswith(_AS_PICTURES))
    return [t for t in pictures if _is_depth(t) and not any(word in t.lower() for word in _NEVER)]


def _is_depth(topic: str) -> bool:
    return any(word in topic.lower() for word in _DEPTH_WORDS)


def _without_right(topics: list[str]) -> list[str]:
    """Leave out the right images of stereo pairs: those whose left one is there too."""
    return [t for t in topics if "right" not in t or t.replace("right", "left") not in topics]


def _beside(named: str | None, topics: list[str]) -> list[str]:
    """Return the topics that share most of the leading parts of their names with `named`; all where none is named."""
    if not named:
        return topics
    parts = named.split("/")

    def shared(topic: str) -> int:
        return next((i for i, (a, b) in enumerate(zip(parts, topic.split("/"), strict=False)) if a != b), len(parts))

    most = max(map(shared, topics), default=0)
    return [t for t in topics if shared(t) == most]


def _is_result(topic: str, types: Mapping[str, str]) -> bool:
    """Whether an estimator published it: the names of its labels lie beside it."""
    return f"{topic.rpartition('/')[0]}/label_names" in types


def _best(what: str, topics: list[str], hints: tuple[str, ...]) -> str | None:
    def rank(topic: str) -> tuple[int, int, int]:
        name = topic.lower()
        first = next((i for i, hint in enumerate(hints) if hint in name), len(hints))
        last = next((i for i, hint in enumerate(_FINISH_HINTS) if hint in name), len(_FINISH_HINTS))
        return first, last, ("/compressed" in name) + name.endswith(_AS_PICTURES)  # compressedDepth before it

    ranked = sorted(topics, key=lambda t: (rank(t), t))
    if len(ranked) > 1 and rank(ranked[0]) == rank(ranked[1]):
        option = "color" if what == "colour" else what
        raise DataError(f"several {what} topics fit: {_listed(ranked)}; choose one with --{option}-topic")
    return ranked[0] if ranked else None


def _info(color: str | None, depth: str | None, infos: list[str]) -> str:
    """Return the camera_info beside the colour image (depth is registered to it), else beside the depth image."""
    for topic in (color, depth):
        namespace = topic or ""
        while namespace:
            namespace = namespace.rpartition("/")[0]
            if f"{namespace}/camera_info" in infos:
                return f"{namespace}/camera_info"
    if len(infos) == 1:
        return infos[0]
    raise DataError(
        f"no camera_info belongs to {color or depth}; the bag has {_listed(infos)} "
        "(choose with --color-info-topic, or give a calibration file with --camera)"
    )


def _listed(topics: list[str]) -> str:
    return ", ".join(sorted(topics)) or "none"


TRUTH_TYPES = {LAYOUT_TOPIC: IMAGE, CLASSES_TOPIC: IMAGE, POSE_TOPIC: POSE}
