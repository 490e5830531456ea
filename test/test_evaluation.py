"""`room-layout evaluate`, the baselines, and the report: numbers agree with truth made by hand."""

from __future__ import annotations

import base64
import contextlib
import csv
import io
import json
import re
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from browser import BROWSER, Browser

from room_layout_ros.cli import main as room_layout
from room_layout_ros.commands.evaluate import BASELINES
from room_layout_ros.commands.frame_choice import choose_frames
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import DataError, FramesFolder, FrameTruth, Sample, open_folder
from room_layout_ros.datasets.images import write_image
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.datasets.writers import FolderWriter
from room_layout_ros.evaluation import baselines, figures, tables
from room_layout_ros.evaluation.c_curve import CCurve, CPoint, read_c_curve, update_c_curve
from room_layout_ros.evaluation.calibration import face_reliability, frame_reliability
from room_layout_ros.evaluation.folder_predictions import read_folder
from room_layout_ros.evaluation.measures import Reliability
from room_layout_ros.evaluation.prediction import Prediction
from room_layout_ros.evaluation.scores import Figure, SetScore, run

CAMERA = CameraIntrinsics(640, 480, 520.0, 520.0, 319.5, 239.5)
ROOM = RoomCuboid(np.eye(3), np.array([1.3, 1.2, 1.5, 3.0, 1.4]))
N_FRAMES = 3

pytestmark = pytest.mark.usefixtures("few_draws")  # but for `rendered`, which is made before


def room_sample(name: str = "a", seed: int = 0) -> Sample:
    """The analytic room, every pixel measured with 5 mm of noise, all of it wall (1), floor (2), ceiling (22)."""
    layout = ROOM.raster(CAMERA)
    depth = ROOM.depth(CAMERA) + np.random.default_rng(seed).normal(0, 0.005, layout.shape).astype(np.float32)
    classes = np.array([0, 22, 2, 1, 1, 1], np.uint8)[layout]
    return Sample(RgbdFrame(CAMERA, None, depth.astype(np.float32), name=name), FrameTruth(layout, classes))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("frames") / "rooms"
    with FolderWriter(path) as writer:
        for sample in SyntheticSource(frames=N_FRAMES, seed=3, walk=False, noise="clean"):
            assert isinstance(sample, Sample)
            writer.write(sample)
    names = open_folder(path).names
    (path / "splits.json").write_text(json.dumps({"first_two": list(names[:2]), "too_many": [*names, "000009"]}))
    return path


def test_percentile_walls_find_an_empty_room() -> None:
    result = run("p", baselines.percentile_walls, [room_sample()])
    assert result.layout_errors[0] < 0.03
    assert result.labelling_errors[0] < 0.03


def test_constant_layout_never_looks_at_the_frame_it_answers() -> None:
    other = np.full(ROOM.raster(CAMERA).shape, 2, np.uint8)
    samples = [room_sample("a"), Sample(room_sample("b").frame, FrameTruth(other))]
    layouts = {s.name: s.truth.layout for s in samples if s.truth is not None and s.truth.layout is not None}
    method = baselines.ConstantLayout.of(layouts)
    np.testing.assert_array_equal(method(samples[0]).layout, other)
    np.testing.assert_array_equal(method(samples[1]).layout, ROOM.raster(CAMERA))


def test_a_frame_without_an_estimate_is_wrong_in_every_pixel_and_counted() -> None:
    result = run("nothing", lambda s: Prediction.nothing(s.frame.camera, "no room in view"), [room_sample()])
    assert (result.layout_errors[0], result.labelling_errors[0], result.without_estimate) == (1.0, 1.0, 1)


def test_perfect_and_confident_predictions_are_calibrated_and_wrong_ones_are_not() -> None:
    layout = ROOM.raster(CAMERA)
    sure = np.ones(5)

    def perfect(_: Sample) -> Prediction:
        return Prediction(layout, layout, confidence=1.0, face_confidence=sure)

    def wrong(_: Sample) -> Prediction:
        # floor and ceiling swapped: no renaming of walls mends it
        swapped = np.array([0, 2, 1, 3, 4, 5], np.uint8)[layout]
        return Prediction(swapped, swapped, confidence=1.0, face_confidence=np.array([1.0, 1.0, 0, 0, 0]))

    right, bad = run("right", perfect, [room_sample()]), run("wrong", wrong, [room_sample()])
    for score, frames, faces in ((right, 0.0, 0.0), (bad, np.isin(layout, (1, 2)).mean(), 1.0)):
        of_frames, of_faces = frame_reliability(score), face_reliability(score)
        assert of_frames is not None
        assert of_faces is not None
        assert of_frames.ece == pytest.approx(frames)
        assert of_faces.ece == pytest.approx(faces)


def test_table_and_summary_state_the_same_means() -> None:
    scores: list[SetScore] = [run("walls", baselines.percentile_walls, [room_sample("a"), room_sample("b", 1)])]
    summary = json.loads(tables.summary_json(scores, {}))["methods"]["walls"]
    shown = re.search(r"walls\s+([\d.]+) \(", tables.text_table(scores))
    assert shown is not None
    assert float(shown[1]) == pytest.approx(100 * summary["layout_error"], abs=0.006)
    assert summary["layout_error"] == pytest.approx(float(np.mean(scores[0].layout_errors)), abs=1e-6)


SWAPPED = np.array([0, 1, 2, 4, 3, 5, 6], np.uint8)
"""Left called front and front called left."""


def swapped_walls(sample: Sample) -> Prediction:
    assert sample.truth is not None
    assert sample.truth.layout is not None
    assert sample.truth.labels is not None
    return Prediction(SWAPPED[sample.truth.layout], SWAPPED[sample.truth.labels])


def test_each_measure_is_told_with_the_walls_permuted_and_with_the_names_as_they_are() -> None:
    """Two frames: in the first the walls have other names, in the second all is right."""

    def method(sample: Sample) -> Prediction:
        return swapped_walls(sample) if sample.name == "a" else perfect(sample)

    score = run("swapped", method, [room_sample("a"), room_sample("b")])
    summary = json.loads(tables.summary_json([score], {}))["methods"]["swapped"]
    layout = ROOM.raster(CAMERA)
    wrong = float(np.isin(layout, (3, 4)).mean())
    left, front = (np.count_nonzero(layout == wall) for wall in (3, 4))
    # Each wall is right in one frame; its union with what is called so is that, and both walls of the other frame
    expected = [1, 1, left / (2 * left + front), front / (2 * front + left), 1]
    assert (summary["layout_error"], summary["labelling_error"], summary["mean_iou"]) == (0, 0, 1)
    for name in ("layout_error_fixed_names", "labelling_error_fixed_names"):
        assert summary[name] == pytest.approx(wrong / 2, abs=1e-6)
    assert summary["mean_iou_fixed_names"] == pytest.approx(np.mean(expected), abs=1e-6)
    by_label = [value for value in summary["iou_fixed_names"].values() if value is not None]
    assert by_label == pytest.approx(expected, abs=1e-6)
    low, high = summary["interval_95"]["mean_iou_fixed_names"]
    assert low < summary["mean_iou_fixed_names"] < high
    first = next(csv.DictReader(line for line in tables.frames_csv([score]).splitlines()))
    assert first["frame"] == "a"
    assert float(first["frame_mean_iou"]) == 1
    assert float(first["frame_mean_iou_fixed_names"]) == pytest.approx(3 / 5)  # ceiling, floor and right wall


def perfect(sample: Sample) -> Prediction:
    assert sample.truth is not None
    assert sample.truth.layout is not None
    assert sample.truth.labels is not None
    return Prediction(sample.truth.layout, sample.truth.labels)


def test_the_table_has_the_papers_numbers_beside_ours_of_fixed_names() -> None:
    lines = tables.text_table([run("swapped", swapped_walls, [room_sample("a")])]).splitlines()
    layout = ROOM.raster(CAMERA)
    wrong = f"{100 * np.isin(layout, (3, 4)).mean():.2f}"
    ours, paper = (next(line for line in lines if line.startswith(title)) for title in ("swapped", "paper, RGB-D"))
    assert re.split(r"\s{2,}", ours)[1:7] == [
        *("0.00 (0.0-0.0)", wrong),
        *("0.00 (0.0-0.0)", wrong),
        *("100.00 (100.0-100.0)", "60.00"),
    ]
    assert re.sub(r"\s+", " ", lines[0]) == " layout % fixed labelling % fixed mean IoU fixed corner % ms none"
    for number, of_ours in (("8.04", wrong), ("13.65", wrong), ("76.67", "60.00")):
        assert paper.index(number) + len(number) in [m.end() for m in re.finditer(of_ours, ours)]
    start = lines.index("wall names as they are:")
    assert lines[start + 1].split() == ["swapped", "100.00", "100.00", "0.00", "0.00", "100.00", "-"]


def test_columns_stay_apart_whatever_is_in_them() -> None:
    def nothing(sample: Sample) -> Prediction:
        return Prediction.nothing(sample.frame.camera, "no room", 123456.0)

    title = "ours, /a/folder/with/a/name/that/is/longer/than/the/column/was"
    frames = [room_sample("a"), room_sample("b", 1)]
    lines = tables.text_table([run(title, nothing, frames), run("walls", baselines.percentile_walls, frames)])
    row = next(line for line in lines.splitlines() if line.startswith(title))
    assert "100.00 (100.0-100.0)" in row
    assert re.split(r"\s{2,}", row)[1:4] == ["100.00 (100.0-100.0)", "100.00", "100.00 (100.0-100.0)"]
    for table in lines.split("\n\n"):
        ends = {len(line) for line in table.splitlines() if line.startswith((title, "walls"))}
        assert len(ends) == 1, "all columns end at the same place"


@dataclass(frozen=True)
class Run:
    """What one run of evaluate on rendered rooms printed and wrote, with everything that it can show."""

    printed: str
    out: Path
    curve: CCurve

    @property
    def methods(self) -> dict[str, Any]:
        methods: dict[str, Any] = json.loads((self.out / "summary.json").read_text())["methods"]
        return methods

    @property
    def page(self) -> str:
        return (self.out / "report.html").read_text("utf-8")

    def section(self, heading: str) -> str:
        """Return the page from one heading to the next."""
        parts = re.split(r"<h2>(.*?)</h2>", self.page)
        return dict(zip(parts[1::2], parts[2::2], strict=True))[heading]


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("rendered")
    points = [CPoint(c, 8.0, 13.0, 77.0) for c in (100, 1000, 10000)]
    update_c_curve(folder / "curve.json", "rgbd", points, "two folds")
    update_c_curve(folder / "curve.json", "rgb", points[:2], "two folds")
    printed = io.StringIO()
    arguments = ["evaluate", "--rendered", str(N_FRAMES), "--noise", "clean", "--seed", "3"]
    with contextlib.redirect_stdout(printed):
        assert room_layout([*arguments, "--curve", str(folder / "curve.json"), "--out", str(folder / "out")]) == 0
    return Run(printed.getvalue(), folder / "out", read_c_curve(folder / "curve.json"))


def test_published_rows_are_said_to_be_of_nyu_and_not_of_the_data_set_of_these_frames(rendered: Run) -> None:
    for told in (rendered.printed, " ".join(rendered.page.split())):
        assert "their authors' own images of NYU v2" in told
        assert "same data set" not in told


@pytest.mark.skipif(BROWSER is None, reason="neither chromium nor google-chrome is on this machine")
def test_every_table_fits_into_a_window_of_1280_pixels(rendered: Run, tmp_path: Path) -> None:
    browser = Browser(tmp_path, (1280, 900))
    try:
        browser.open((rendered.out / "report.html").absolute().as_uri())
        browser.wait_for("document.readyState === 'complete' && document.querySelectorAll('.scroll').length > 2")
        hidden = browser.value("[...document.querySelectorAll('.scroll')].map(s => s.scrollWidth - s.clientWidth)")
    finally:
        browser.close()
    assert max(hidden) <= 0


def test_evaluate_prints_ours_beside_the_paper(rendered: Run) -> None:
    assert "paper, RGB-D" in rendered.printed
    assert "ours, RGB-D" in rendered.printed
    assert rendered.methods["ours, RGB-D"]["frames"] == N_FRAMES
    assert rendered.methods["ours, RGB-D"]["layout_error"] < 0.1  # noise-free rooms


def test_the_page_tells_each_measure_with_the_names_as_they_are_too(rendered: Run) -> None:
    ours = rendered.methods["ours, RGB-D"]
    cards = rendered.page.split("class='cards'")[1].split("<h2>")[0]
    fixed = [ours[f"{name}_fixed_names"] for name in ("layout_error", "labelling_error", "mean_iou")]
    assert re.findall(r"wall names as they are ([\d.]+)", cards) == [f"{100 * value:.2f}" for value in fixed]
    table = rendered.section("Intersection over union per class (Table 4)")
    names_as_they_are = table.split("<th>IoU %, fixed names</th>")[1]
    assert f">{100 * fixed[2]:.2f} (" in names_as_they_are.split(">ours, RGB-D<")[1].split("</tr>")[0]
    assert table.count("paper, RGB-D") == names_as_they_are.count("paper, RGB-D") == 1
    errors = rendered.section("Layout and labelling error (paper, Table 2)")
    assert errors.split("</tr>")[0].count("fixed names") == 2
    assert "<td>paper, RGB-D</td><td></td><td>8.04</td><td></td><td>13.65</td>" in errors


def test_the_page_shows_every_frame_and_needs_nothing_from_outside(rendered: Run) -> None:
    page = rendered.page
    assert all(f"<b>{i:06d}</b>" in page for i in range(N_FRAMES))
    assert page.count("data:image/jpeg;base64,") == N_FRAMES
    assert not re.search(r"(src|href)='(?!data:)", page)


METHODS = 5
TABLES = {
    "Layout and labelling error (paper, Table 2)": METHODS + 5,
    "Intersection over union per class (Table 4)": 2 * METHODS
    + 2
    + 1,  # walls permuted, names as they are with a heading row
    "Furniture (Table 5)": 2,
    "Superpixels (Table 3)": 2 * 13 + 1,  # two truths, each with a heading row
    "The room in 3-D": METHODS - 1,  # the constant layout has no room
}
DRAWINGS = {
    "How the errors are spread": 1,
    "With and without depth (Figure 4 a)": 1,
    "Robustness to C (Figure 4 b-d)": 1,
    "Where pixels go": 1,
    "Is its confidence honest?": 1,
}
EVERY_FRAME = "Every frame, worst layout first (Figure 5)"


def test_the_page_has_the_papers_tables_and_figures_and_ours_and_no_other(rendered: Run) -> None:
    assert set(re.findall(r"<h2>(.*?)</h2>", rendered.page)) == {*TABLES, *DRAWINGS, EVERY_FRAME}


@pytest.mark.parametrize(("heading", "rows"), TABLES.items())
def test_each_table_has_all_its_rows_and_ours_with_intervals(rendered: Run, heading: str, rows: int) -> None:
    section = rendered.section(heading)
    assert section.count("<tr") == 1 + rows
    assert re.search(r"<td>[\d.]+ \([\d.]+-[\d.]+\)", section)


@pytest.mark.parametrize("heading", TABLES)
def test_no_value_lies_outside_its_own_interval(rendered: Run, heading: str) -> None:
    told = re.findall(r"([\d.]+) \(([\d.]+)-([\d.]+)\)", rendered.section(heading))
    assert told
    assert [(v, low, high) for v, low, high in told if not float(low) <= float(v) <= float(high)] == []
    assert tables.with_span(Figure(0.0934, 0.0911, 0.0962), 1.0) == "0.09 (0.09-0.10)"
    assert tables.with_span(Figure(0.0934, 0.0511, 0.1362)) == "9.34 (5.1-13.6)"


def test_colours_of_furniture_and_curves_have_their_names_beside_the_drawing(rendered: Run) -> None:
    assert "</i>cabinet" in rendered.section(EVERY_FRAME)
    curves = rendered.section("How the errors are spread")
    legend, drawing = curves.split("<svg")
    assert [title in legend for title in rendered.methods] == [True] * METHODS
    assert not any(f">{title}<" in drawing for title in rendered.methods), "no curve crosses a name"


def test_points_at_the_ends_of_the_scale_are_whole_and_the_title_is_two_statements() -> None:
    bins = Reliability(np.linspace(0, 1, 3), np.array([4, 4]), np.array([0.0, 1.0]), np.array([0.0, 1.0]), 0.002)
    drawn = figures.calibration(bins, None)
    assert "share of pixels right; ECE 0.002" in drawn
    assert not re.search(r"<g clip-path[^>]*>\s*<use", drawn)


@pytest.mark.parametrize(("heading", "count"), DRAWINGS.items())
def test_each_figure_is_drawn(rendered: Run, heading: str, count: int) -> None:
    assert rendered.section(heading).count("<svg") == count


def test_the_figure_over_c_has_a_point_for_each_row_of_the_file(rendered: Run) -> None:
    section = rendered.section("Robustness to C (Figure 4 b-d)")
    for label in ("ours, RGB-D", "ours, RGB", "paper, RGB-D, C = 1000", "paper, RGB, C = 1000"):
        assert f">{label}<" in section
    one_less = replace(rendered.curve, rgbd=rendered.curve.rgbd[:-1])
    whole, less = (figures.robustness_to_c(curve).count("<use ") for curve in (rendered.curve, one_less))
    assert whole - less == 3  # a marker in each of the three drawings
    assert "two folds" in section
    assert "judged on the other, no cross-validation" in " ".join(section.split())
    assert "discrete solution, before its refinement, and without the scene network" in " ".join(section.split())


def test_a_row_of_figure_5_shows_evidence_depth_truth_and_estimate(rendered: Run) -> None:
    section = rendered.section(EVERY_FRAME)
    encoded = re.findall(r"base64,([^']+)'", section)
    assert len(encoded) == N_FRAMES
    pixels = np.frombuffer(base64.b64decode(encoded[0]), np.uint8)
    height, width = np.asarray(cv2.imdecode(pixels, cv2.IMREAD_COLOR)).shape[:2]
    # layout, two of evidence, depth, true and our labels, true and our furniture: two rows of four tiles
    assert width > 4 * 280
    assert height > 2 * 210


def test_frames_are_listed_worst_first_on_the_page_and_in_the_csv(rendered: Run) -> None:
    rows = list(csv.DictReader((rendered.out / "frames.csv").read_text().splitlines()))
    assert len(rows) == METHODS * N_FRAMES
    for title in rendered.methods:
        own = [float(row["layout_error"]) for row in rows if row["method"] == title]
        assert len(own) == N_FRAMES
        assert own == sorted(own, reverse=True)
    listed = re.findall(r"<b>(\d{6})</b>", rendered.section(EVERY_FRAME))
    assert listed == [row["frame"] for row in rows if row["method"] == "ours, RGB-D"]


def test_every_number_of_the_summary_has_an_interval_around_it(rendered: Run) -> None:
    counts = {"frames", "frames_without_estimate", "milliseconds_median", "interval_95"}

    def check(values: dict[str, Any], spans: dict[str, Any]) -> int:
        assert set(values) - counts == set(spans)
        checked = 0
        for name, span in spans.items():
            if isinstance(span, dict):
                checked += check(values[name], span)
            elif values[name] is None:
                assert span == [None, None]
            elif name not in ("frame_ece", "face_ece"):  # the error of a resampled calibration is biased upwards
                assert span[0] <= values[name] <= span[1]
                checked += 1
        return checked

    for scores in rendered.methods.values():
        assert check(scores, scores["interval_95"]) >= 10
    assert check(rendered.methods["ours, RGB-D"], rendered.methods["ours, RGB-D"]["interval_95"]) >= 18
    segmentation = json.loads((rendered.out / "summary.json").read_text())["superpixels"]
    assert len(segmentation) == 2 * 13
    for row in segmentation.values():
        assert check(row, row["interval_95"]) == 3


def test_a_folder_without_classes_is_scored_by_its_layouts_alone(folder: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(folder, bare, ignore=shutil.ignore_patterns("labels40"))
    arguments = ["evaluate", str(bare), "--baseline", "percentile", "--rgb-only", "--out", str(tmp_path / "out")]
    assert room_layout(arguments) == 0
    scores = json.loads((tmp_path / "out" / "summary.json").read_text())["methods"]["walls at the 98th percentile"]
    assert scores["layout_error"] < 0.2
    assert scores["labelling_error"] is None
    assert "Superpixels (Table 3)" not in (tmp_path / "out" / "report.html").read_text("utf-8")


def test_no_report_of_other_numbers_stays_beside_new_ones(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("earlier")
    (tmp_path / "notes.html").write_text("mine")
    words = ["evaluate", str(folder), "--out", str(tmp_path), "--rgb-only", "--baseline", "none", "--no-report"]
    assert room_layout(words) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["frames.csv", "notes.html", "summary.json"]


def test_where_no_scheduler_answers_no_folder_is_made(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="distributed is not installed (extra train)")
    monkeypatch.setattr("room_layout_ros.parallel.CONNECT_TIMEOUT_S", 0.2)
    words = ["evaluate", str(folder), "--out", str(tmp_path / "new"), "--scheduler", "tcp://127.0.0.1:9"]
    assert room_layout(words) == 2
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_true_layouts_given_as_estimates_score_zero(folder: Path, tmp_path: Path) -> None:
    truth = tmp_path / "truth"
    for sample in open_folder(folder):
        assert isinstance(sample, Sample)
        assert sample.truth is not None
        assert sample.truth.layout is not None
        assert sample.truth.labels is not None
        for kind, image in (("layout", sample.truth.layout), ("labels", sample.truth.labels)):
            (truth / kind).mkdir(parents=True, exist_ok=True)
            write_image(truth / kind / f"{sample.name}.png", image)
    out = tmp_path / "out"
    arguments = ["evaluate", str(folder), "--estimates", str(truth), "--baseline", "none", "--no-report"]
    assert room_layout([*arguments, "--out", str(out)]) == 0
    (scores,) = json.loads((out / "summary.json").read_text())["methods"].values()
    assert (scores["layout_error"], scores["labelling_error"], scores["mean_iou"]) == (0, 0, 1)


BED = 4


@pytest.mark.parametrize(
    ("missing", "shares"),
    [(("furniture", "layout", "labels"), (0.5, 0.5)), (("furniture",), (0.5, 1.0)), ((), (1.0, 1.0))],
)
def test_furniture_that_a_frame_without_files_missed_is_counted(
    missing: tuple[str, ...], shares: tuple[float, float], tmp_path: Path
) -> None:
    """Two frames, half of each a bed; the files say the truth, but some of the second frame's are not there."""
    samples = [with_bed(room_sample("a")), with_bed(room_sample("b"))]
    for kind in ("layout", "labels", "furniture"):
        (tmp_path / kind).mkdir()
    for sample in samples:
        assert sample.truth is not None
        for kind in ("layout", "labels", "furniture"):
            if sample.name == "a" or kind not in missing:
                image = getattr(sample.truth, kind)
                write_image(tmp_path / kind / f"{sample.name}.png", image)
    scores = run("files", read_folder(tmp_path), samples)
    found = tuple(scores.figures[name].value for name in (f"furniture_iou.{BED}", "mean_iou"))
    assert found == pytest.approx(shares, abs=0.01)
    if "layout" not in missing:
        shutil.rmtree(tmp_path / "furniture")
        assert np.isnan(run("files", read_folder(tmp_path), samples).figures["mean_furniture_iou"].value)


def with_bed(sample: Sample) -> Sample:
    assert sample.truth is not None
    assert sample.truth.labels40 is not None
    classes = sample.truth.labels40.copy()
    classes[:, ::2] = BED
    return replace(sample, truth=replace(sample.truth, labels40=classes))


def test_furniture_of_another_size_is_refused(tmp_path: Path) -> None:
    sample = room_sample("a")
    layout = ROOM.raster(CAMERA)
    for kind, image in (("layout", layout), ("labels", layout), ("furniture", layout[:-1])):
        (tmp_path / kind).mkdir()
        write_image(tmp_path / kind / "a.png", image)
    with pytest.raises(DataError, match=r"furniture/a.png has shape \(479, 640\)"):
        read_folder(tmp_path)(sample)


def test_a_baseline_that_names_no_furniture_has_no_figure_of_it() -> None:
    blind = replace(room_sample("b").frame, depth_m=np.full((480, 640), np.nan, np.float32))
    samples = [with_bed(room_sample("a")), replace(with_bed(room_sample("b")), frame=blind)]
    scores = run("walls", baselines.percentile_walls, samples)
    assert scores.without_estimate == 1
    assert np.isnan(scores.figures["mean_furniture_iou"].value)


def test_estimates_of_other_frames_are_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All frames would count as wrong, and the table would say 100 %."""
    for kind in ("layout", "labels"):
        (tmp_path / kind).mkdir()
        write_image(tmp_path / kind / "hall.png", np.ones((480, 640), np.uint8))
    assert room_layout(["evaluate", str(folder), "--estimates", str(tmp_path), "--baseline", "none"]) == 2
    assert f"knows none of the {N_FRAMES} frames of frames folder" in capsys.readouterr().err


@pytest.mark.parametrize(("told", "time"), [({"milliseconds": 64.0}, 64.0), ({}, None)])
def test_the_time_of_files_is_what_they_say_and_nothing_else(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], told: dict[str, float], time: float | None
) -> None:
    """Neither the sum of stages that run beside each other, nor the time of reading the files."""
    lines = []
    for sample in open_folder(folder):
        assert isinstance(sample, Sample)
        assert sample.truth is not None
        assert sample.truth.layout is not None
        for kind in ("layout", "labels"):
            (tmp_path / kind).mkdir(exist_ok=True)
            write_image(tmp_path / kind / f"{sample.name}.png", sample.truth.layout)
        stages = {"joint": 70.0, "network": 60.0}
        lines.append(json.dumps({"name": sample.name, "status": "OK", "timings_ms": stages, **told}))
    (tmp_path / "estimates.jsonl").write_text("\n".join(lines))
    arguments = ["evaluate", str(folder), "--estimates", str(tmp_path), "--baseline", "none"]
    assert room_layout([*arguments, "--out", str(tmp_path / "out")]) == 0
    (scores,) = json.loads((tmp_path / "out" / "summary.json").read_text())["methods"].values()
    assert scores["milliseconds_median"] == time
    row = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("ours, "))
    assert row.split()[-2] == ("-" if time is None else "64.0")
    assert "nan ms" not in (tmp_path / "out" / "report.html").read_text("utf-8")


def test_without_colour_the_colour_alone_is_not_scored(folder: Path, tmp_path: Path) -> None:
    """It would be wrong in every pixel, for no fault of the estimator."""
    arguments = ["evaluate", str(folder), "--frames", "first_two", "--baseline", "none", "--no-report"]
    assert room_layout([*arguments, "--set", "use_color=false", "--out", str(tmp_path)]) == 0
    assert set(json.loads((tmp_path / "summary.json").read_text())["methods"]) == {"ours, RGB-D"}


@pytest.mark.parametrize(
    ("missing", "left", "words"),
    (
        ("depth", {"ours, RGB", "constant layout"}, "has no depth: our estimator with depth is left out"),
        ("rgb", {"ours, RGB-D", *BASELINES.values()}, "has no colour: our estimator without depth is left out"),
    ),
)
def test_a_method_whose_stream_is_missing_is_left_out_and_that_is_said(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], missing: str, left: set[str], words: str
) -> None:
    """Not scored under a name that says it looked at what is not there."""
    half = tmp_path / "half"
    shutil.copytree(folder, half, ignore=shutil.ignore_patterns(missing))
    assert room_layout(["evaluate", str(half), "--no-report", "--out", str(tmp_path / "out")]) == 0
    assert words in capsys.readouterr().err
    assert set(json.loads((tmp_path / "out" / "summary.json").read_text())["methods"]) == left
    alone = ["--rgb-only"] if missing == "rgb" else ["--baseline", "percentile"]
    assert room_layout(["evaluate", str(half), *alone]) == 2
    assert "has no colour, and --rgb-only" if missing == "rgb" else "needs depth" in capsys.readouterr().err


def test_frames_without_an_annotated_pixel_are_left_out_and_counted(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other"
    shutil.copytree(folder, other)
    write_image(other / "layout" / "000000.png", np.zeros((480, 640), np.uint8))
    (other / "layout" / "000001.png").unlink()
    arguments = ["evaluate", str(other), "--baseline", "none", "--rgb-only"]
    assert room_layout([*arguments, "--frames", "0,1,2"]) == 0
    printed = capsys.readouterr()
    assert "2 of 3 frames have no true layout and are left out" in printed.err
    assert "1 frames with a true layout" in printed.out


def test_where_only_some_frames_have_classes_it_is_said_of_how_many_the_labelling_is(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    some = tmp_path / "some"
    shutil.copytree(folder, some)
    (some / "labels40" / "000000.png").unlink()
    arguments = ["evaluate", str(some), "--baseline", "percentile", "--rgb-only"]
    words = "labelling error and IoU are of {} of 3 frames: the others have no class labels (labels40/NAME.png)\n"
    assert room_layout(arguments) == 0
    assert words.format(2) in capsys.readouterr().err
    write_image(some / "labels40" / "000001.png", np.zeros((480, 640), np.uint8))  # nothing is labelled
    assert room_layout(arguments) == 0
    assert words.format(1) in capsys.readouterr().err
    for whole in (["evaluate", str(folder)], ["evaluate", str(some), "--frames", "0"]):  # all have them, none has
        assert room_layout([*whole, "--baseline", "percentile", "--rgb-only"]) == 0
        assert "labelling error" not in capsys.readouterr().err


def test_a_file_of_names_may_hold_names_with_spaces(folder: Path, tmp_path: Path) -> None:
    spaced = tmp_path / "spaced"
    shutil.copytree(folder, spaced, ignore=shutil.ignore_patterns("*.txt"))
    for path in spaced.glob("*/*0.*"):
        path.rename(path.with_name(f"living room{path.suffix}"))
    (tmp_path / "names.txt").write_text("living room\n000001 000002\n")
    chosen = choose_frames(open_folder(spaced), str(tmp_path / "names.txt"))
    assert isinstance(chosen, FramesFolder)
    assert chosen.names == ("living room", "000001", "000002")
    chosen = choose_frames(open_folder(spaced), "living room, 1")
    assert isinstance(chosen, FramesFolder)
    assert chosen.names == ("living room", "000001")


def test_a_subset_of_splits_json_is_what_is_scored(folder: Path, tmp_path: Path) -> None:
    arguments = ["evaluate", str(folder), "--frames", "first_two", "--baseline", "percentile", "--no-report"]
    assert room_layout([*arguments, "--rgb-only", "--out", str(tmp_path)]) == 0
    methods = json.loads((tmp_path / "summary.json").read_text())["methods"]
    assert set(methods) == {"ours, RGB", "walls at the 98th percentile"}
    assert {scores["frames"] for scores in methods.values()} == {2}


@pytest.mark.parametrize(
    ("arguments", "words"),
    (
        (["{folder}", "--frames", "nonsense"], "first_two"),
        (["{folder}/missing"], "does not exist"),
        (["{folder}", "--estimates", "{folder}/rgb"], "no layout/"),
        (["{folder}", "--estimates", "{folder}"], "has layout/, but labels/ is missing"),
        (["{folder}", "--curve", "{folder}/camera.yaml", "--out", "{tmp}"], "no curve"),
        (["{folder}", "--curve", "{folder}/nowhere.json", "--out", "{tmp}"], "cannot be read"),
        (["{folder}", "--layouts", "layouts.mat"], "NYU v2 .mat file only"),
        (["{folder}", "--rendered", "3"], "either INPUT or --rendered N is needed; both were given"),
        ([], "either INPUT or --rendered"),
        (["--rendered", "0"], "1 or more"),
        (["--rendered", "2", "--seed", "-1"], "argument --seed: '-1' is given; it must be a whole number, 0 or more"),
        (["--rendered", "2", "--frames", "first_two"], "needs a frames folder"),
        (["{folder}", "--fits", "{folder}"], "fits.jsonl is missing"),
        (["{folder}", "--fits", "{fits}"], "holds no accepted fit; at least one is needed"),
        (["{folder}", "--estimates", "{tmp}", "--rgb-only"], "as it was written; --rgb-only cannot change it"),
        (["{folder}", "--estimates", "{tmp}", "--set", "max_depth_m=4"], "as it was written; --set cannot change it"),
        (["{folder}", "--estimates", "{tmp}", "--models", "{tmp}"], "as it was written; --models cannot change it"),
        (["{folder}", "--models", "{tmp}"], "scene.npz cannot be read: No such file or directory; --models needs"),
        (["{folder}", "--set", "superpixel_count=many"], "no int"),
        (["{folder}", "--noise", "stereo"], "--noise stereo is of rendered rooms"),
        (["{folder}", "--seed", "0"], "--seed 0 is of rendered rooms"),
        (["{folder}", "--frames", "0,0"], "--frames 0,0 names '000000' more than once; each frame counts once"),
        (["{folder}", "--frames", "0,9"], "nor names of frames; '9' is none"),
        (["{folder}", "--frames", "{tmp}/fits/empty.txt"], "names no frame; at least one is needed"),
        (["{folder}", "--frames", "too_many"], "splits.json names '000009', and frames folder"),
    ),
)
def test_bad_input_ends_in_one_sentence_and_exit_code_2(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    (tmp_path / "fits").mkdir()
    (tmp_path / "fits" / "empty.txt").touch()
    (tmp_path / "fits" / "fits.jsonl").write_text('{"name": "000000", "accepted": false}\n')
    filled = [word.format(folder=folder, tmp=tmp_path, fits=tmp_path / "fits") for word in arguments]
    assert room_layout(["evaluate", *filled]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.strip().splitlines()) == 1
