"""`room-layout evaluate FILE.mat --layouts ... --classes40 ...`: exact scores on a small file in the published form."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nyu_on_disk import ROOMS, true_layouts, write_mat, write_nyu

from room_layout_ros.cli import main as room_layout
from room_layout_ros.core.labels import CLUTTER
from room_layout_ros.datasets.images import write_image
from room_layout_ros.datasets.nyu import NYU_CAMERA

pytest.importorskip("h5py", reason="h5py is not installed (extra datasets)")

pytestmark = pytest.mark.usefixtures("few_draws")

NUMBERS = (2, 4, 5)
N_FRAMES = 5
WALL_894, TABLE_894 = 21, 19
"""Numbers of two classes of the data set's 894."""

WRONG_ROWS, CLUTTER_ROWS, UNLABELLED_ROWS = 30, 100, 48


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data set, what was published apart, and estimates of which the error is known by construction."""
    folder, rng = tmp_path_factory.mktemp("nyu"), np.random.default_rng(0)
    labels = np.full((N_FRAMES, 480, 640), WALL_894, np.uint16)
    labels[:, -CLUTTER_ROWS:] = TABLE_894
    labels[:, :UNLABELLED_ROWS] = 0
    depths = rng.uniform(0.7, 9.9, (N_FRAMES, 480, 640)).astype(np.float32)
    for number, room in zip(NUMBERS, ROOMS, strict=True):
        depths[number - 1] = room.depth(NYU_CAMERA)
    write_nyu(folder / "nyu.mat", rng, N_FRAMES, labels=labels, depths=depths)
    mapping = np.full((1, 894), 40, np.uint8)
    mapping[0, WALL_894 - 1], mapping[0, TABLE_894 - 1] = 1, 7
    write_mat(folder / "classMapping40.mat", {"mapClass": mapping}, "5")
    layouts = np.moveaxis(true_layouts(), 0, -1)
    write_mat(folder / "layouts.mat", {"index": np.array([NUMBERS]), "layout": layouts}, "5")
    write_mat(folder / "split.mat", {"train": np.array([[1, 2]]), "test": np.array([[3]])}, "5")
    other = np.array([0, 5, 4, 2, 1, 3], np.uint8)[layouts]
    write_mat(folder / "other.mat", {"index": np.array([NUMBERS]), "layout_GT": other}, "7.3")
    for kind in ("layout", "labels"):
        (folder / "estimates" / kind).mkdir(parents=True)
    for number, layout in zip(NUMBERS, true_layouts(), strict=True):
        found = layout.copy()
        if number == 2:
            found[:WRONG_ROWS] = np.where(layout[:WRONG_ROWS] == 2, 1, 2)
        write_image(folder / "estimates" / "layout" / f"{number:04d}.png", found)
        found[-CLUTTER_ROWS:] = CLUTTER
        write_image(folder / "estimates" / "labels" / f"{number:04d}.png", found)
    return folder


def evaluate(files: Path, out: Path, *words: str) -> dict[str, Any]:
    """Score the estimates and return their summary."""
    arguments = ["evaluate", str(files / "nyu.mat"), "--estimates", str(files / "estimates"), "--baseline", "none"]
    filled = [word.format(files=files) for word in words]
    assert room_layout([*arguments, "--no-report", "--out", str(out), *filled]) == 0
    (scores,) = json.loads((out / "summary.json").read_text())["methods"].values()
    assert isinstance(scores, dict)
    return scores


LAYOUTS = ("--layouts", "{files}/layouts.mat", "{files}/split.mat", "--classes40", "{files}/classMapping40.mat")


def test_errors_are_exactly_those_that_were_made(files: Path, tmp_path: Path) -> None:
    scores = evaluate(files, tmp_path, *LAYOUTS)
    assert scores["frames"] == len(NUMBERS)
    assert scores["layout_error"] == pytest.approx(WRONG_ROWS / 480 / 3, abs=1e-6)
    # The wrong rows are unlabelled, so the labelling is right wherever it is asked for.
    assert WRONG_ROWS < UNLABELLED_ROWS
    assert scores["labelling_error"] == 0


def test_files_may_be_named_in_capitals(files: Path, tmp_path: Path) -> None:
    loud = tmp_path / "loud"
    loud.mkdir()
    for name in ("nyu", "layouts", "split", "classMapping40"):
        (loud / f"{name}.MAT").symlink_to(files / f"{name}.mat")
    words = [word.replace(".mat", ".MAT").format(files=loud) for word in LAYOUTS]
    command = ["evaluate", str(loud / "nyu.MAT"), "--estimates", str(files / "estimates"), "--baseline", "none"]
    assert room_layout([*command, *words]) == 0


def test_wrong_labels_count_over_the_labelled_pixels(files: Path, tmp_path: Path) -> None:
    mapping = np.full((1, 894), 40, np.uint8)
    mapping[0, TABLE_894 - 1] = 1  # the table passes for a wall, so all that is called clutter is wrong and reversed
    path = write_mat(tmp_path / "map.mat", {"mapClass": mapping}, "7.3")
    scores = evaluate(files, tmp_path / "out", "--layouts", "{files}/layouts.mat", "--classes40", str(path))
    assert scores["labelling_error"] == 1


def test_without_the_mapping_there_is_no_labelling_to_score(files: Path, tmp_path: Path) -> None:
    scores = evaluate(files, tmp_path, "--layouts", "{files}/layouts.mat")
    assert scores["layout_error"] == pytest.approx(WRONG_ROWS / 480 / 3, abs=1e-6)
    assert scores["labelling_error"] is None


def test_ids_of_another_order_give_the_same_score(files: Path, tmp_path: Path) -> None:
    index = ("--layouts", "{files}/other.mat", "{files}/split.mat", "--face-ids", "5,4,2,1,3")
    assert evaluate(files, tmp_path, *index)["layout_error"] == pytest.approx(WRONG_ROWS / 480 / 3, abs=1e-6)


@pytest.mark.parametrize(("subset", "error"), (("test", 0.0), ("train", 1 / 32), ("0002", 1 / 16), ("0004,0005", 0.0)))
def test_frames_can_be_chosen_by_published_list_and_by_name(
    files: Path, tmp_path: Path, subset: str, error: float
) -> None:
    assert evaluate(files, tmp_path, *LAYOUTS, "--frames", subset)["layout_error"] == pytest.approx(error, abs=1e-6)


def test_our_estimator_is_scored_on_the_same_frames(
    files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["evaluate", str(files / "nyu.mat"), "--frames", "test", "--baseline", "depth", "--out", str(tmp_path)]
    assert room_layout([*arguments, *(word.format(files=files) for word in LAYOUTS)]) == 0
    assert "1 frames with a true layout" in capsys.readouterr().out
    methods = json.loads((tmp_path / "summary.json").read_text())["methods"]
    assert methods["our simple depth estimator"]["layout_error"] < 0.05  # the depth is that of the empty room
    assert "<b>0005</b>" in (tmp_path / "report.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("words", "sentence"),
    (
        ((), "holds no layouts; give the published ones by --layouts"),
        (("--layouts", "{files}/other.mat"), "give the ids of ceiling, floor, left, front, right by --face-ids"),
        (("--layouts", "{files}/other.mat", "--face-ids", "1,2"), "five whole numbers"),
        (("--layouts", "{files}/other.mat", "--face-ids", "1,2,3,4,4"), "five different ones"),
        (("--face-ids", "1,2,3,4,5"), "give that too"),
        (("--layouts", "{files}/nyu.mat"), "index and layout are needed"),
        (("--layouts", "{files}/layouts.mat", "--frames", "0001"), "nor names of frames"),
        (("--layouts", "{files}/layouts.mat", "--classes40", "{files}/layouts.mat"), "no field mapClass"),
    ),
)
def test_what_does_not_fit_ends_in_one_sentence(
    files: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], sentence: str
) -> None:
    assert room_layout(["evaluate", str(files / "nyu.mat"), *(word.format(files=files) for word in words)]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said.strip().splitlines()) == 1
