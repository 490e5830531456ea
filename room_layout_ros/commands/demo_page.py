"""The page at the end of a demo: what happened, to be understood without having read anything else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from room_layout_ros.core.labels import CLUTTER, LABEL_COLORS, LABEL_NAMES
from room_layout_ros.evaluation import page
from room_layout_ros.evaluation.floor_picture import FREE_COLOR, OCCUPIED_COLOR, UNKNOWN_COLOR

PAIR = "colour and depth pair"
"""What a room is made of where both streams are there."""


@dataclass(frozen=True, slots=True)
class DemoFacts:
    """What the page tells; texts are plain, they are escaped here.

    Attributes
    ----------
    title, source : what was shown. estimated : what a room is made of, as `PAIR`.
    without_node : why it went without; "" if live, over DDS.
    cards : (number, what, beside). topics : (name, type, messages) of the recording.
    animation, sheet, mcap, bag : paths relative to the page. sheets : all contact sheets. floors : picture of the free
        space of some frames; None where no frame has any.
    commands : what was run, for whoever wants to repeat it. notes : anything that fell short.
    """

    title: str
    source: str
    estimated: str
    without_node: str
    cards: Sequence[tuple[str, str, str]]
    topics: Sequence[tuple[str, str, int]]
    animation: Path
    sheet: Path
    sheets: Sequence[Path]
    floors: Path | None
    mcap: Path
    bag: Path
    commands: Sequence[str]
    notes: Sequence[str]


_LIVE = """A player published the frames as ROS 2 topics, the <code>estimator</code> node turned each {estimated} into
the room you see, and a recorder wrote down what the node published: three processes, talking over DDS like on a robot.
Everything on this page comes from that recording."""

_OFFLINE = """so the same bag went through the same estimator without the node. What you see is the same; left out are
the transport over DDS and the topics that are not listed below."""

_READING = """Left is what the camera saw. Beside it is what the estimator says: the room's ceiling, floor and walls as
coloured faces with their edges drawn also behind furniture. Everything that stands in the room, the clutter, keeps the
colours of the picture, under a grey hatch and with a dark rim."""


_FLOORS = """The same frames from above, as on the right of the moving picture: the camera is the blue dot and looks up,
a square is a metre. What is behind things or out of view is not known, and so not free."""

_FLOOR_COLORS = (
    ("green: floor that was seen free", FREE_COLOR),
    ("red: occupied, a wall or a thing", OCCUPIED_COLOR),
    ("grey: not known", UNKNOWN_COLOR),
)

_NO_FLOORS = "There is no free space to show: it needs depth, and floor in view."

_FOXGLOVE = """(or <code>ros2 bag play</code> it). In a 3D panel switch on <code>markers</code>; an Image panel shows
<code>overlay</code>."""


def demo_html(facts: DemoFacts) -> str:
    """Return the page."""
    colors = zip(LABEL_NAMES, LABEL_COLORS.tolist(), strict=True)
    names = [(f"{name} (hatched)" if name == LABEL_NAMES[CLUTTER] else name, tuple(color)) for name, color in colors]
    more = [_link(sheet) for sheet in facts.sheets if sheet != facts.sheet]
    body = [
        f"<h1>{escape(facts.title)}</h1><p class='soft'>{escape(facts.source)}</p>",
        _image(facts.animation, "colour, the estimate, and the free space from above, moving"),
        page.legend(names[1:]),
        f"<p>{_READING}</p>",
        page.cards(facts.cards),
        "<h2>Where a robot can drive</h2>",
        *_floors(facts.floors),
        *(f"<p><b>Note:</b> {escape(note)}</p>" for note in facts.notes),
        "<h2>What just happened</h2>",
        f"<p>{_happened(facts)}</p>",
        "<h2>Contact sheet</h2>",
        _image(facts.sheet, "contact sheet"),
        f"<p>Every frame: {', '.join(more)}</p>" if more else "",
        "<h2>Look around in it yourself</h2>",
        f"<p>Open {_link(facts.mcap)} in Foxglove {_FOXGLOVE} The input is {_link(facts.bag)}.</p>",
        page.table(["topic", "type", "messages"], [[t, kind, str(n)] for t, kind, n in facts.topics]),
        "<h2>Again, by hand</h2>",
        f"<pre><code>{escape(chr(10).join(facts.commands))}</code></pre>",
    ]
    return page.page(facts.title, body)


def _happened(facts: DemoFacts) -> str:
    if facts.without_node:
        return f"{escape(facts.without_node)}, {_OFFLINE}"
    return _LIVE.format(estimated=escape(facts.estimated))


def _floors(picture: Path | None) -> list[str]:
    if picture is None:
        return [f"<p>{_NO_FLOORS}</p>"]
    return [f"<p>{_FLOORS}</p>", page.legend(_FLOOR_COLORS), _image(picture, "free space from above")]


def _image(path: Path, alt: str) -> str:
    return f"<img src='{escape(path.as_posix(), quote=True)}' alt='{escape(alt, quote=True)}'>"


def _link(path: Path) -> str:
    return f"<a href='{escape(path.as_posix(), quote=True)}'>{escape(path.name)}</a>"
