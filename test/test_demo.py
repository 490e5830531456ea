"""The demo makes what it says: every file, every frame, and one sentence where it cannot."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from room_frames import CAMERA, room_images, stamp_ns

from room_layout_ros.cli import main as room_layout
from room_layout_ros.commands import demo, demo_live
from room_layout_ros.commands.demo_page import DemoFacts, demo_html
from room_layout_ros.commands.demo_pictures import ANIMATION_FRAMES, evenly, write_animation
from room_layout_ros.commands.demo_results import DIAGNOSTICS, no_room, read_recording
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.freespace import compute_free_space
from room_layout_ros.core.tracking import TemporalPrior, next_prior
from room_layout_ros.datasets import CameraCalibration, DataError, good_samples, open_source
from room_layout_ros.datasets import bag_messages as messages
from room_layout_ros.evaluation.floor_picture import FREE_COLOR, OCCUPIED_COLOR, UNKNOWN_COLOR

N_FRAMES = 3


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("demo") / "out"
    assert room_layout(["demo", "--no-node", "--frames", str(N_FRAMES), "--out", str(out)]) == 0
    return out


def check_page(out: Path) -> str:
    """Everything the page points to is there; return the page."""
    page = (out / "index.html").read_text()
    targets = re.findall(r"(?:src|href)='([^']+)'", page)
    assert targets
    assert [t for t in targets if not (out / t).exists()] == []
    return page


def test_page_points_to_files_that_are_there(made: Path) -> None:
    page = check_page(made)
    assert f"{N_FRAMES} of {N_FRAMES}" in page
    assert "--no-node was given, so the same bag went through the same estimator without the node" in page
    assert "wheels" not in page
    assert "the clutter, keeps the colours of the picture, under a grey hatch" in " ".join(page.split())
    assert "clutter (hatched)" in page


def test_page_states_the_layout_error_against_the_rendered_truth(made: Path) -> None:
    (shown,) = re.findall(r"<b>([\d.]+) %</b>layout error", check_page(made))
    recording = read_recording(next((made / "results").glob("*.mcap")))
    errors = []
    for sample in good_samples(open_source(made / "input")):
        assert sample.truth is not None
        assert sample.truth.layout is not None
        errors.append(float(np.mean(recording.layout[sample.frame.stamp_ns] != sample.truth.layout)))
    assert float(shown) <= 100 * np.mean(errors) + 0.005  # wall names may be permuted there, not here
    assert float(shown) < 10.0


def test_recorded_labels_are_the_estimators_for_the_same_frames(made: Path) -> None:
    recording = read_recording(next((made / "results").glob("*.mcap")))
    estimator, prior = LayoutEstimator(), TemporalPrior()
    for sample in good_samples(open_source(made / "input")):
        estimate = estimator.estimate(sample.frame, prior)
        prior = next_prior(estimate)
        np.testing.assert_array_equal(recording.labels[sample.frame.stamp_ns], estimate.labels)
        np.testing.assert_array_equal(recording.layout[sample.frame.stamp_ns], estimate.layout)


def test_moving_picture_has_every_frame_beside_its_estimate(made: Path) -> None:
    with Image.open(made / "overlay.webp") as picture:
        assert picture.is_animated  # type: ignore[attr-defined]
        assert picture.n_frames == N_FRAMES  # type: ignore[attr-defined]
        assert picture.size == (1440, 360), "colour, estimate, free space"


def test_page_shows_the_free_space_that_was_recorded_and_says_what_its_colours_are(made: Path) -> None:
    page = check_page(made)
    assert "free-space.png" in page
    for words in ("green: floor that was seen free", "red: occupied, a wall or a thing", "grey: not known"):
        assert words in page
    recording, config = read_recording(next((made / "results").glob("*.mcap"))), LayoutEstimator().config
    estimator, prior = LayoutEstimator(), TemporalPrior()
    for sample in good_samples(open_source(made / "input")):
        estimate = estimator.estimate(sample.frame, prior)
        prior = next_prior(estimate)
        geometry = compute_depth_geometry(sample.frame, config)
        assert geometry is not None
        space = compute_free_space(geometry, estimate, config, color=sample.frame.color)
        assert space is not None
        grid = recording.free_space[sample.frame.stamp_ns]
        np.testing.assert_array_equal(grid.cells, space.grid)
        assert grid.origin_m == pytest.approx(space.origin_m)
    with Image.open(made / "free-space.png") as picture:
        colors = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    for color in (FREE_COLOR, OCCUPIED_COLOR, UNKNOWN_COLOR):
        assert (colors == color).all(axis=1).mean() > 0.01


def test_frames_without_depth_have_no_free_space_and_the_page_says_so(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames, out = tmp_path / "frames", tmp_path / "out"
    assert room_layout(["convert", str(made / "input"), str(frames)]) == 0
    shutil.rmtree(frames / "depth")
    assert room_layout(["demo", "--no-node", "--input", str(frames), "--out", str(out)]) == 0
    told = f"{N_FRAMES} of {N_FRAMES} frames have no depth: estimated from colour alone, lengths have no unit"
    assert f"demo: {told}\n" in capsys.readouterr().err
    page = check_page(out)
    assert told in page
    assert "frames came back as rooms<br><span>by the stamp of the colour image<" in page
    assert "There is no free space to show" in page
    assert not (out / "free-space.png").exists()


def test_depth_of_another_unit_is_asked_about(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames, out = tmp_path / "frames", tmp_path / "out"
    assert room_layout(["convert", str(made / "input"), str(frames)]) == 0
    for path in (frames / "depth").iterdir():
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert depth is not None
        cv2.imwrite(str(path), 3 * depth)
    assert room_layout(["demo", "--no-node", "--input", str(frames), "--out", str(out)]) == 0
    asked = "is the depth unit right for a camera "
    assert capsys.readouterr().err.count(f"demo: {asked}") == 1
    assert asked in check_page(out)
    assert "depth unit" not in check_page(made)


@pytest.mark.parametrize("dark", [1, N_FRAMES])
def test_only_rooms_are_counted_as_rooms(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], dark: int
) -> None:
    frames, out = tmp_path / "frames", tmp_path / "out"
    assert room_layout(["convert", str(made / "input"), str(frames)]) == 0
    for folder in ("rgb", "depth"):
        for path in sorted((frames / folder).iterdir())[:dark]:
            pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            assert pixels is not None
            cv2.imwrite(str(path), 0 * pixels)
    assert room_layout(["demo", "--no-node", "--input", str(frames), "--out", str(out)]) == 0
    page, said = check_page(out), capsys.readouterr().err
    assert f"<b>{N_FRAMES - dark} of {N_FRAMES}</b>frames came back as rooms" in page
    have = "has" if dark == 1 else "have"
    told = f"{dark} of {N_FRAMES} frames {have} no room: no room in view ({dark})"
    lost = f"{dark} of {N_FRAMES} frames {have} no usable depth: no room was found"
    for sentence in (told, lost):
        assert sentence in page
        assert f"demo: {sentence}" in said
    assert "colour alone" not in said


def test_why_the_node_sent_no_room_is_in_its_last_diagnostics(tmp_path: Path) -> None:
    counted = {"no estimate: no room in view": "6", "dropped: newer frame": "1", "published": "0"}
    write_diagnostics(tmp_path / "results", {"no estimate: no room in view": "2"}, counted)
    with pytest.raises(DataError) as refused:
        read_recording(next((tmp_path / "results").glob("*.mcap")))
    why = "no room in view (6), left out for a newer frame as the node was late (1)"
    assert f"results.mcap holds no room: {why}; recorded was /diagnostics (2)" in str(refused.value)


def test_frames_without_a_room_have_the_nodes_reasons_and_no_others() -> None:
    reasons = no_room({"no estimate: no room in view": "4", "dropped: newer frame": "1", "no floor: none": "3"})
    (told,) = demo._without_room(reasons, 10, 5)
    late = "left out for a newer frame as the node was late (1)"
    assert told == f"5 of 10 frames have no room: no room in view (4), {late}"
    assert demo._without_room({}, 2, 1) == ("1 of 2 frames has no room: the node does not say why (1)",)
    assert demo._without_room({}, 2, 2) == ()


def write_diagnostics(path: Path, *counted: dict[str, str]) -> None:
    """Write what a node says of its estimates, once for each."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    store = messages.typestore()
    types = store.types
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/diagnostics", DIAGNOSTICS, typestore=store)
        for second, values in enumerate(counted):
            said = [types["diagnostic_msgs/msg/KeyValue"](key=key, value=value) for key, value in values.items()]
            status = types["diagnostic_msgs/msg/DiagnosticStatus"](
                level=0, name="estimator: estimates", message="", hardware_id="", values=said
            )
            stamp = types["builtin_interfaces/msg/Time"](sec=second, nanosec=0)
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
            message = types[DIAGNOSTICS](header=header, status=[status])
            writer.write(connection, second, bytes(store.serialize_cdr(message, DIAGNOSTICS)))


def test_each_step_is_told_when_it_begins(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert room_layout(["demo", "--no-node", "--frames", "1", "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().err.splitlines()
    assert [line.split()[1] for line in told if line.startswith("demo: ")] == ["render", "estimate", "draw"]
    assert any("the first run" in line for line in told)


def test_demo_replaces_its_own_folder_and_no_other(made: Path, tmp_path: Path) -> None:
    foreign = tmp_path / "thesis"
    foreign.mkdir()
    (foreign / "chapter1.tex").write_text("the only copy")
    assert room_layout(["demo", "--no-node", "--frames", "1", "--out", str(foreign)]) == 2
    assert (foreign / "chapter1.tex").read_text() == "the only copy"
    assert (made / demo.MADE_BY_US).exists()


def test_an_input_inside_the_output_folder_is_refused_and_kept(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    look = tmp_path / "look"
    shutil.copytree(made, look)
    (tmp_path / "link").symlink_to(look)
    for source in (look / "input", next((tmp_path / "link" / "input").glob("*.mcap"))):
        assert room_layout(["demo", "--no-node", "--frames", "1", "--input", str(source), "--out", str(look)]) == 2
        assert f"lies in --out {look}, where it would be replaced" in capsys.readouterr().err
        assert len(list(good_samples(open_source(look / "input")))) == N_FRAMES


def test_the_next_demo_removes_what_the_last_one_wrote_and_nothing_else(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    look = tmp_path / "look"
    shutil.copytree(made, look)
    mine = [look / "notes.txt", look / "estimates" / "a.png", look / "log" / "mine.pdf"]
    stale = [look / "contact-sheet-all-7.jpg", look / "log" / "player.txt", look / "log" / "ros" / "x.log"]
    for path in (*mine, *stale):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
    again = ["demo", "--no-node", "--frames", "1", "--out", str(look)]
    assert room_layout(again) == 0
    assert all(path.exists() for path in mine)
    assert not any(path.exists() for path in stale)
    page = check_page(look)
    assert "<b>1 of 1</b>frame came back as a room<br>" in page
    assert "1 frames" not in page
    (look / "results" / "mine.csv").write_text("x")
    capsys.readouterr()
    assert room_layout(again) == 2
    assert "mine.csv is not of the demo, which makes results/ anew" in capsys.readouterr().err
    assert (look / "index.html").exists(), "refused before anything is gone"


def test_an_input_without_a_usable_frame_removes_and_makes_nothing(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    look, frames = tmp_path / "look", tmp_path / "frames"
    shutil.copytree(made, look)
    assert room_layout(["convert", str(made / "input"), str(frames)]) == 0
    for path in (frames / "depth").iterdir():
        path.write_bytes(path.read_bytes()[:100])
    for out in (look, tmp_path / "new"):
        assert room_layout(["demo", "--no-node", "--input", str(frames), "--out", str(out)]) == 2
        assert "frames holds no usable frame: 000000: " in capsys.readouterr().err
    check_page(look)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    (
        (["--input", "/no/such/bag"], "does not exist"),
        (["--frames", "0"], "1 or more"),
        (["--rate", "0"], "argument --rate: '0' is given; it must be a number, 0.01 to 10"),
        (["--seed", "-1"], "argument --seed: '-1' is given; it must be a whole number, 0 or more"),
        (["--camera", "camera.yaml"], "--camera is for a bag, and without --input a room is rendered"),
        (["--max-stamp-gap", "0.1"], "--max-stamp-gap is for a bag, and without --input a room is rendered"),
        (["--input", "{tmp}"], "no frames folder"),
    ),
)
def test_bad_input_is_one_sentence_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    filled = [word.format(tmp=tmp_path) for word in arguments]
    assert room_layout(["demo", "--no-node", "--out", str(tmp_path / "out"), *filled]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.strip().splitlines()) == 1


def test_frames_that_cannot_be_used_are_counted_on_the_page(made: Path, tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    assert room_layout(["convert", str(made / "input"), str(frames)]) == 0
    broken = sorted((frames / "depth").glob("*.png"))[1]
    broken.write_bytes(broken.read_bytes()[:100])
    out = tmp_path / "out"
    assert room_layout(["demo", "--no-node", "--input", str(frames), "--out", str(out)]) == 0
    page = check_page(out)
    assert f"{N_FRAMES - 1} of {N_FRAMES - 1}" in page
    assert "1 frame of the input could not be used" in page


def test_a_bag_with_two_cameras_is_shown_by_the_topics_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What the README says beside `make demo INPUT=`."""
    bag, out = two_cameras(tmp_path / "bag"), tmp_path / "out"
    assert room_layout(["demo", "--no-node", "--input", str(bag), "--out", str(out)]) == 2
    assert "choose one with --depth-topic" in capsys.readouterr().err
    words = ["--color-topic=/front/color", "--depth-topic=/front/depth", "--color-info-topic=/front/camera_info"]
    assert room_layout(["demo", "--no-node", "--input", str(bag), "--out", str(out), *words]) == 0
    assert f"{N_FRAMES} of {N_FRAMES}" in check_page(out)
    for sample in good_samples(open_source(out / "input")):
        assert sample.frame.color is not None
        assert sample.frame.color[0, 0].tolist() == [10, 20, 30], "the front camera's pixels"


def two_cameras(path: Path) -> Path:
    """Write a bag of two RGB-D cameras, told apart by the colour of their first pixel."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for camera, pixel in (("back", (90, 80, 70)), ("front", (10, 20, 30))):
            topics = {name: f"/{camera}/{name}" for name in ("color", "depth", "camera_info")}
            kinds = {"color": messages.IMAGE, "depth": messages.IMAGE, "camera_info": messages.CAMERA_INFO}
            opened = {
                name: writer.add_connection(topic, kinds[name], typestore=messages.typestore())
                for name, topic in topics.items()
            }
            for i in range(N_FRAMES):
                color, depth_mm = room_images(i)
                color[0, 0] = pixel
                stamp, calibration = stamp_ns(i), CameraCalibration.from_intrinsics(CAMERA)
                raw = {
                    "color": messages.encode_image_message(color, "rgb8", stamp, camera),
                    "depth": messages.encode_image_message(depth_mm, "16UC1", stamp, camera),
                    "camera_info": messages.encode_camera_info(calibration, stamp, camera),
                }
                for name, connection in opened.items():
                    writer.write(connection, stamp, raw[name])
    return path


def test_where_ros_is_missing_the_demo_says_so_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo, "ros_is_here", lambda: False)
    assert room_layout(["demo", "--frames", "1", "--out", str(tmp_path / "out")]) == 0
    assert "No ROS 2 wheels" in capsys.readouterr().err
    assert "No ROS 2 wheels are installed here (they exist for Linux on x86-64), so the same" in check_page(
        tmp_path / "out"
    )


@pytest.mark.parametrize(
    ("missing", "settings"),
    [("depth", ["--ros-args", "-p", "use_depth:=false"]), ("rgb", ["--ros-args", "-p", "use_color:=false"]), ("", [])],
)
def test_the_node_is_told_to_do_without_a_stream_that_is_not_there(
    made: Path, tmp_path: Path, missing: str, settings: list[str]
) -> None:
    frames, bag = tmp_path / "frames", tmp_path / "bag"
    assert room_layout(["convert", str(made / "input"), str(frames)]) == 0
    shutil.rmtree(frames / missing if missing else tmp_path / "none", ignore_errors=True)
    assert room_layout(["convert", str(frames), str(bag), "--to", "bag"]) == 0
    words = demo_live.node_words(bag, {})
    assert words == settings
    assert len(demo_live.played_topics(bag)) == (2 if missing else 3)
    estimated = {"": "colour and depth pair", "depth": "colour image", "rgb": "depth image"}[missing]
    assert demo._what_is_estimated(bag) == estimated
    by_hand = " ".join(["estimator", *settings])
    first, *_ = demo._by_hand(bag, words, {})
    assert first.split("        # or: ") == [f"ros2 run room_layout_ros {by_hand}", by_hand], "on the page too"


def test_a_process_that_ends_early_is_named_with_its_last_words(tmp_path: Path) -> None:
    log = tmp_path / "node.txt"
    with log.open("wb") as file:
        popen = subprocess.Popen([sys.executable, "-c", "print('no such camera'); raise SystemExit(3)"], stdout=file)
    popen.wait()
    with pytest.raises(DataError, match=r"estimator ended with exit code 3: no such camera"):
        demo_live.Process("estimator", popen, log).alive_or_refuse()


@pytest.mark.parametrize(("count", "wanted"), ((1, 24), (24, 24), (220, 24), (7, 3)))
def test_choice_of_frames_is_even_and_keeps_both_ends(count: int, wanted: int) -> None:
    chosen = evenly(count, wanted)
    assert len(chosen) == min(count, wanted)
    assert (chosen[0], chosen[-1]) == (0, count - 1)
    assert len(set(np.diff(chosen).tolist())) <= 2


def test_long_runs_are_thinned_out(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)  # equal frames would be merged
    frames = [rng.integers(0, 256, (16, 16, 3)).astype(np.uint8) for _ in range(2 * ANIMATION_FRAMES)]
    write_animation(tmp_path / "a.webp", frames, seconds=2.0)
    with Image.open(tmp_path / "a.webp") as picture:
        assert picture.n_frames == ANIMATION_FRAMES  # type: ignore[attr-defined]


@pytest.mark.dds
@pytest.mark.slow
def test_live_demo_brings_every_frame_back_through_the_node(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert room_layout(["demo", "--frames", "6", "--out", str(out), "--rate", "0.05"]) == 0
    assert "6 of 6" in check_page(out)
    recording = read_recording(next((out / "results").glob("*.mcap")))
    counts = {topic: count for topic, _, count in recording.topics}
    assert {counts[f"/estimator/{name}"] for name in ("labels", "layout", "overlay", "markers")} == {6}
    stamps = {sample.frame.stamp_ns for sample in good_samples(open_source(out / "input"))}
    assert set(recording.labels) == stamps
    assert float(recording.health["latency_p50_ms"]) > 0


def test_the_legend_of_a_contact_sheet_has_three_quarters_of_its_size(made: Path) -> None:
    """At half of it, as it was, a 0 reads as an 8."""
    with Image.open(made / "contact-sheet.png") as sheet:
        assert sheet.width >= N_FRAMES * 0.75 * 640


@pytest.mark.parametrize(
    ("stamps_s", "gap_s", "seconds"),
    [((3.0,), 1 / 30, 1 / 30), (range(1, 601), 1.0, 600.0), ((5.0, 5.1, 5.2, 9.2), 0.1, 4.3)],
    ids=["one frame", "a frame a second", "with a pause"],
)
def test_how_long_a_bag_plays_is_told_by_its_stamps(stamps_s: Sequence[float], gap_s: float, seconds: float) -> None:
    stamps_ns = [round(stamp * 1e9) for stamp in stamps_s]
    assert demo_live.usual_gap_s(stamps_ns) == pytest.approx(gap_s)
    assert demo_live.duration_s(stamps_ns) == pytest.approx(seconds)


def test_a_slow_bag_is_played_in_real_time_and_a_quick_one_as_the_node_can(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def wait(self: LayoutEstimator, frame: object) -> None:
        time.sleep(0.05)

    monkeypatch.setattr(LayoutEstimator, "estimate", wait)
    monkeypatch.setattr(demo_live, "free_space_of_frame", lambda *_: None)
    monkeypatch.setattr(demo_live, "draw_overlay", lambda *_: None)
    assert demo_live._possible_rate(made / "input", 1.0) == 1.0
    assert 0.02 < demo_live._possible_rate(made / "input", 1 / 30) < 0.3


def test_a_single_frame_has_no_rate(made: Path) -> None:
    assert demo_live._speed(made / "input", [1], None) == 1.0
    assert demo_live._speed(made / "input", [1], 0.05) == 1.0
    assert demo_live._speed(made / "input", [1, 2], 0.05) == 0.05


@pytest.mark.parametrize(
    ("speed", "chosen", "notes"),
    [
        (0.5, True, ("Played at 0.50 of real time, at which this machine should estimate every frame.",)),
        (0.5, False, ("Played at 0.50 of real time.",)),
        (1.0, True, ()),
    ],
)
def test_a_slow_play_is_told_and_why_unless_it_was_asked_for(
    tmp_path: Path, speed: float, chosen: bool, notes: tuple[str, ...]
) -> None:
    log = tmp_path / "recorder.txt"
    log.write_text('{"/estimator/labels": [5, 0]}\n')
    with subprocess.Popen([sys.executable, "-c", ""]) as popen:
        assert demo_live._notes(demo_live.Process("recorder", popen, log), speed, chosen) == notes


def test_the_live_page_names_what_was_estimated() -> None:
    facts = DemoFacts(
        title="t", source="s", estimated="colour image", without_node="", cards=(), topics=(), animation=Path("a"),
        sheet=Path("b"), sheets=(), floors=None, mcap=Path("c"), bag=Path("d"), commands=(), notes=(),
    )  # fmt: skip
    assert "node turned each colour image into the room" in " ".join(demo_html(facts).split())


def test_all_that_the_node_publishes_is_recorded() -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed (extra ros)")
    from room_layout_ros.outputs import OUTPUTS

    topics = demo_live.recorded_topics()
    assert {"/estimator/room_outline", "/estimator/floor_pose", "/estimator/label_names", "/diagnostics"} <= set(topics)
    assert len(topics) == len(set(topics)) == len(OUTPUTS) + 2
