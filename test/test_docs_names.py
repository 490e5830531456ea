"""What the pages name is what the code has: topics, parameters with their values, launch arguments, sentences."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from sentences import Sentences

from room_layout_ros import node_config
from room_layout_ros.core.config import EstimatorConfig, parameters
from room_layout_ros.node_config import NodeConfig

REPOSITORY = Path(__file__).resolve().parent.parent
PAGES = ("README.md", "docs/free_space.md", "docs/troubleshooting.md")
TABLES: tuple[Any, ...] = (EstimatorConfig, NodeConfig)
OWN = {row.name for _, table in node_config.TABLES for row in parameters(table)}
FOREIGN = {
    "use_sim_time": "every ROS node",
    "qos_overrides": "rclpy; what may stand behind it is test_node's",
    "allow_unknown": "Nav2's planners",
    "bond_timeout": "Nav2's lifecycle manager",
    "base_footprint": "frame, the default of robot_frame",
    "camera_link": "frame of a camera driver",
    "lifecycle_estimator": "executable",
}
"""Names of the form of a parameter that are none of ours."""


def cited_sections(text: str) -> set[int]:
    """Return the sections of docs/method.md that a text names: "section 3 and 4", "sections 6 to 9", "11"."""
    cited: set[int] = set()
    for first, word, last in re.findall(
        r"method\.md\)?[,:]?\s+(?:sections?\s+)?(\d+)(?:\s+(and|to)\s+(\d+))?", text, flags=re.IGNORECASE
    ):
        cited |= {int(first)} | ({int(last)} if last else set())
        cited |= set(range(int(first), int(last))) if word == "to" else set()
    return cited


def test_citations_of_sections_are_read_in_all_their_forms() -> None:
    several = "(docs/method.md, section 3 and 4). Method.md section 7; method.md,\n11) method.md 2"
    assert cited_sections(several) == {2, 3, 4, 7, 11}
    assert cited_sections("[method](method.md), sections 6 to 9") == {6, 7, 8, 9}
    assert cited_sections("in method.md. 37 frames; docs/evidence.md, section 5") == set()


def test_every_section_of_the_method_that_is_cited_is_there() -> None:
    headings = re.findall(r"^## (\d+)\. ", (REPOSITORY / "docs" / "method.md").read_text("utf-8"), flags=re.MULTILINE)
    assert [int(number) for number in headings] == list(range(1, len(headings) + 1)), "in order, none left out"
    folders = ("room_layout_ros", "msg_adapters", "benchmarks", "launch", "test")
    files = [file for folder in folders for file in sorted((REPOSITORY / folder).rglob("*.py"))]
    files += [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").glob("*.md"))]
    cited = {file.name: cited_sections(file.read_text("utf-8")) for file in files if file != Path(__file__).resolve()}
    assert sum(map(bool, cited.values())) > 20
    lacking = {name: sections - set(map(int, headings)) for name, sections in cited.items()}
    assert {name: sections for name, sections in lacking.items() if sections} == {}


def heading_anchors(text: str) -> set[str]:
    """Return the anchors that GitHub gives the headings of a page."""
    headings = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_between_pages_lead_somewhere() -> None:
    pages = [REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md", *sorted((REPOSITORY / "docs").glob("*.md"))]
    links = [
        (page, *link)
        for page in pages
        for link in re.findall(r"\]\(([\w./-]*)(?:#([\w-]+))?\)", page.read_text("utf-8"))
    ]
    assert len(links) > 40
    assert [(page.name, file) for page, file, _ in links if not (page.parent / file).exists()] == []
    targets = [(page.parent / file if file else page, anchor) for page, file, anchor in links if anchor]
    assert [link for link in targets if link[1] not in heading_anchors(link[0].read_text("utf-8"))] == []


@pytest.fixture(params=PAGES)
def page(request: pytest.FixtureRequest) -> str:
    return (REPOSITORY / request.param).read_text("utf-8")


def quoted(text: str) -> list[str]:
    """Return what stands in backquotes, blocks of code left out."""
    return re.findall(r"`([^`\n]+)`", re.sub(r"^ *```.*?^ *```", "", text, flags=re.DOTALL | re.MULTILINE))


def costmap_keys() -> set[str]:
    text = (REPOSITORY / "config" / "nav2_costmap.yaml").read_text("utf-8")
    return set(re.findall(r"^ *([a-z_]+):", text, flags=re.MULTILINE))


def launch_arguments() -> set[str]:
    tree = ast.parse((REPOSITORY / "launch" / "estimator.launch.py").read_text("utf-8"))
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict) and "ARGUMENTS" in ast.unparse(node):
            return {ast.literal_eval(key) for key in node.value.keys if key}
    raise AssertionError("the launch file has no ARGUMENTS")


def test_topics_are_those_of_the_node(page: str) -> None:
    pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")
    from room_layout_ros.inputs import IMU_TOPIC, INPUT_TOPICS
    from room_layout_ros.outputs import OUTPUTS
    from room_layout_ros.publications import LABEL_NAMES_TOPIC

    published = {*(output.topic for output in OUTPUTS), LABEL_NAMES_TOPIC}
    named = {word for span in quoted(page) for word in re.findall(r"~/\w+", span)}
    named |= {f"~/{name}" for name in re.findall(r"/estimator/(\w+)", page)}
    assert named
    assert named - published == set()
    taken = {*INPUT_TOPICS.values(), IMU_TOPIC}
    remapped = set(re.findall(r"-r ([\w/]+):=", page))
    remapped |= {span for span in quoted(page) if re.fullmatch(r"(rgb|depth|depth_registered)/[a-z_]+", span)}
    assert remapped - taken == set()


def test_names_in_the_form_of_a_parameter_are_parameters(page: str) -> None:
    named = {span for span in quoted(page) if re.fullmatch(r"[a-z]+(_[a-z0-9]+)+", span)}
    assert named - OWN - set(FOREIGN) - costmap_keys() == set()


def settings(page: str) -> list[tuple[str, str]]:
    """Return names and values of all `name: value` and -p name:=value."""
    spans = [match for span in quoted(page) if (match := re.fullmatch(r"([a-z]\w+): (\S+)", span))]
    return [(m[1], m[2]) for m in (*spans, *re.finditer(r"-p (\w+):=([^\s`]+)", page))]


def test_settings_are_of_parameters_and_allowed(page: str) -> None:
    for name, value in settings(page):
        if name not in OWN:
            assert name in FOREIGN or name in costmap_keys(), name
            continue
        table = next(t for t in TABLES if name in {row.name for row in parameters(t)})
        table(**{name: yaml.safe_load(value)})


def test_launch_arguments_are_those_of_the_launch_file(page: str) -> None:
    named = set(re.findall(r"(?<!-[pr] )(?<![\w/])([a-z_]+):=", page))
    assert named - launch_arguments() == set()


def said_by_the_node(page: str) -> list[str]:
    """Return the sentences in the first column of the table; RViz and Nav2 say those of rows that begin so."""
    cells = re.findall(r"^\| ([^|]+) \|", page, flags=re.MULTILINE)
    return [sentence for cell in cells if not cell.startswith(("RViz", "Nav2")) for sentence in quoted(cell)]


SENTENCES = said_by_the_node((REPOSITORY / "docs" / "troubleshooting.md").read_text("utf-8"))


@pytest.fixture(scope="module")
def code() -> Sentences:
    own, core = REPOSITORY / "room_layout_ros", REPOSITORY / "room_layout_ros" / "core"
    folders = (own, own / "runtime", core, core / "floor", own / "decoding", REPOSITORY / "msg_adapters")
    return Sentences(file for folder in folders for file in sorted(folder.glob("*.py")))


def test_the_page_has_sentences() -> None:
    assert len(SENTENCES) > 25


@pytest.mark.parametrize("sentence", SENTENCES)
def test_what_the_page_says_the_node_says_the_code_can_say(sentence: str, code: Sentences) -> None:
    assert code.can_say(sentence)


@pytest.mark.parametrize(
    "sentence",
    (
        "no colours for 5 s on /x; nobody publishes it",
        "frames without an estimate (no idea)",
        "no floor (none in sight) for ...",
        "pose_source is tf, but no transformation between ...",
        "dropped: newer image",
        "has another QoS setting RELIABILITY",
        "EstimatorError in the estimator",
        "12 depth messages were lost on the way",
    ),
)
def test_what_it_does_not_say_is_found_out(sentence: str, code: Sentences) -> None:
    assert not code.can_say(sentence)
