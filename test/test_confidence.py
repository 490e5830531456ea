"""Confidences: logistic in their signs, 0 where a face was not seen, low for what is no room; the fit behind them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import SMALL, look, seen_from_inside

from room_layout_ros.core.confidence import (
    FACE_SIGNS,
    FRAME_SIGNS,
    ConfidenceModel,
    Signs,
    face_rows,
    load_confidence,
    logistic,
    plausibility,
    save_confidence,
    state_confidence,
)
from room_layout_ros.core.estimate import Status, no_estimate
from room_layout_ros.core.model_file import WeightsError
from room_layout_ros.core.models import config_folder, model_file
from room_layout_ros.evaluation.confidence_fit import JudgedSigns, fit_confidence, judge_signs

FLAT = ConfidenceModel(np.zeros(len(FRAME_SIGNS) + 1), np.zeros(len(FACE_SIGNS) + 1))
ROOM_SIGNS = Signs(
    np.array([0.1, 0.5, 0.8, 0.9, 0.95]),
    np.array([[0, 0, 0, 0], [0.9, 0.01, 0.3, 0.9], [0.8, 0.0, 0.2, 0.8], [0.9, 0.0, 0.5, 0.95], [0, 0, 0, 0]]),
)

SUPPORTED = (0.9,) * 5


def with_frame(**values: float) -> Signs:
    frame = ROOM_SIGNS.frame.copy()
    for name, value in values.items():
        frame[FRAME_SIGNS.index(name.replace("_", " "))] = value
    return Signs(frame, ROOM_SIGNS.face)


def with_support(*support: float) -> Signs:
    face = ROOM_SIGNS.face.copy()
    face[:, 0], face[:, 2] = support, 0.2
    return Signs(ROOM_SIGNS.frame, face)


def test_logistic_is_logistic() -> None:
    rows = np.array([[0.0, 1.0], [2.0, -1.0]])
    np.testing.assert_allclose(logistic(rows, np.array([1.0, 2.0, -2.0])), [0.5, 1 / (1 + np.exp(2))])


def test_faces_that_are_not_seen_have_none_and_all_lie_between_0_and_1(rng: np.random.Generator) -> None:
    seen = np.array([False, True, True, True, False])
    for _ in range(50):
        model = ConfidenceModel(rng.normal(0, 5, len(FRAME_SIGNS) + 1), rng.normal(0, 5, len(FACE_SIGNS) + 1))
        frame, faces = state_confidence(ROOM_SIGNS, seen, model)
        assert 0 <= frame <= 1
        assert ((faces >= 0) & (faces <= 1)).all()
        np.testing.assert_array_equal(faces > 0, seen)


def test_a_faces_last_sign_is_the_frames_confidence() -> None:
    rows = face_rows(ROOM_SIGNS, 0.7)
    np.testing.assert_array_equal(rows[:, :-1], ROOM_SIGNS.face)
    np.testing.assert_array_equal(rows[:, -1], 0.7)
    face = np.zeros(len(FACE_SIGNS) + 1)
    face[FACE_SIGNS.index("frame")] = 4.0
    low = state_confidence(with_support(*SUPPORTED), np.ones(5, bool), replace(FLAT, face=face))[1]
    np.testing.assert_allclose(low, logistic(np.array([[0.5]]), np.array([4.0, 0.0]))[0])


def test_a_room_is_plausible_and_f31_what_is_none_is_not() -> None:
    assert plausibility(ROOM_SIGNS) == 1.0
    assert plausibility(with_frame(axes=0.04)) == 0.2, "normals in all directions: a ball"
    assert plausibility(with_support(0, 0, 0, 1.0, 0)) == 0.2, "one plane"
    assert plausibility(with_support(0, 0, 0.5, 0, 0.5)) == 0.2, "two planes, one axis"
    assert plausibility(with_support(0, 0.05, 0, 0.02, 0)) == 0.2, "all clutter"
    assert plausibility(with_support(0, 0.5, 0, 0.5, 0)) == 1.0, "floor and one wall"
    without_depth = Signs(with_frame(share_measured=0.0).frame, np.zeros((5, 4)))
    assert plausibility(without_depth) == 1.0, "no depth says nothing about planes"
    values = [plausibility(with_frame(axes=a)) for a in np.linspace(0, 0.3, 20)]
    assert values == sorted(values)


def test_the_factor_holds_for_frame_and_faces() -> None:
    certain = replace(FLAT, frame=np.append(np.zeros(len(FRAME_SIGNS)), 9.0))
    signs = replace(with_support(*SUPPORTED), frame=with_frame(axes=0.0).frame)
    frame, faces = state_confidence(signs, np.ones(5, bool), certain)
    assert frame == pytest.approx(0.2, abs=0.001)
    np.testing.assert_allclose(faces, 0.1)


def test_a_face_without_depth_on_it_has_half_where_depth_is_used() -> None:
    seen = np.ones(5, bool)
    faces = state_confidence(with_support(0.9, 0.05, 0.025, 0.0, 0.9), seen, FLAT)[1]
    np.testing.assert_allclose(faces, [0.5, 0.5, 0.375, 0.25, 0.5])
    by_color = Signs(with_frame(share_measured=0.0).frame, np.zeros((5, 4)))
    np.testing.assert_allclose(state_confidence(by_color, seen, FLAT)[1], 0.5)


def test_coefficients_survive_the_file(tmp_path: Path, rng: np.random.Generator) -> None:
    model = ConfidenceModel(rng.normal(size=6), rng.normal(size=6), {"frames": 40})
    save_confidence(model, tmp_path / "c.npz")
    again = load_confidence(tmp_path / "c.npz")
    np.testing.assert_array_equal(again.frame, model.frame)
    np.testing.assert_array_equal(again.face, model.face)
    assert again.card["frames"] == 40


def test_wrong_shapes_and_wrong_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"confidence coefficients have shapes \(3,\) and \(6,\); \(6,\) and \(6,\)"):
        ConfidenceModel(np.zeros(3), np.zeros(6))
    (tmp_path / "c.npz").write_bytes(b"no model")
    with pytest.raises(WeightsError):
        load_confidence(tmp_path / "c.npz")
    with pytest.raises(WeightsError):
        load_confidence(tmp_path / "absent.npz")


@pytest.mark.parametrize("with_depth", (True, False))
@pytest.mark.parametrize("with_scene", (True, False))
def test_the_shipped_coefficients_were_fitted_and_point_the_right_way(with_depth: bool, with_scene: bool) -> None:
    model = load_confidence(config_folder() / model_file("confidence", with_depth, with_scene))
    assert model.card.get("frames", 0) >= 30, f"made up: {dict(model.card)}"
    assert model.frame[:-1].any()
    if with_depth:
        assert model.frame[FRAME_SIGNS.index("fit cost")] < 0
        assert model.face[FACE_SIGNS.index("support")] > 0


# --- the fit -------------------------------------------------------------------------------------------------------


def made_up(rng: np.random.Generator, truth: ConfidenceModel, count: int) -> list[JudgedSigns]:
    """Signs whose outcomes follow `truth` exactly."""
    judged = []
    for _ in range(count):
        signs = Signs(rng.random(len(FRAME_SIGNS)), rng.random((5, len(FACE_SIGNS) - 1)))
        right = float(logistic(signs.frame[None], truth.frame)[0])
        iou = logistic(face_rows(signs, right), truth.face)
        judged.append(JudgedSigns(signs, right, rng.random(5) < 0.7, iou))
    return judged


def test_the_fit_finds_the_functions_that_made_the_outcomes(rng: np.random.Generator) -> None:
    truth = ConfidenceModel(rng.normal(0, 1.5, len(FRAME_SIGNS) + 1), rng.normal(0, 1.5, len(FACE_SIGNS) + 1))
    fitted = fit_confidence(made_up(rng, truth, 3000), {"frames": 3000})
    np.testing.assert_allclose(fitted.frame, truth.frame, atol=0.15)
    np.testing.assert_allclose(fitted.face, truth.face, atol=0.15)
    assert fitted.card == {"frames": 3000}


def test_a_sign_that_never_changes_gets_no_say(rng: np.random.Generator) -> None:
    truth = ConfidenceModel(np.array([0, 1.0, 0, 0, 0, 0]), np.zeros(6))
    judged = [
        replace(j, signs=Signs(np.append(j.signs.frame[:4], 0.95), j.signs.face)) for j in made_up(rng, truth, 200)
    ]
    fitted = fit_confidence(judged, {})
    assert fitted.frame[4] == 0.0
    assert np.isfinite(fitted.frame).all()


def test_outcomes_that_are_all_right_give_finite_coefficients(rng: np.random.Generator) -> None:
    judged = [replace(j, right=1.0, iou=np.ones(5)) for j in made_up(rng, FLAT, 60)]
    fitted = fit_confidence(judged, {})
    assert np.isfinite(fitted.frame).all()
    assert logistic(judged[0].signs.frame[None], fitted.frame)[0] > 0.95


def test_too_few_frames_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(ValueError, match=r"^29 frames with estimate and layout are given; at least 30 are needed$"):
        fit_confidence(made_up(rng, FLAT, 29), {})


def test_an_estimate_is_judged_up_to_the_names_of_its_walls() -> None:
    frame, room = seen_from_inside(SMALL, look(20, 8))
    layout = room.raster(SMALL)
    estimate = replace(no_estimate(Status.OK, frame, {}), layout=layout, signs=ROOM_SIGNS)
    judged = judge_signs(estimate, np.array([0, 1, 2, 4, 5, 3], np.uint8)[layout])
    assert judged is not None
    assert judged.right == 1.0
    np.testing.assert_array_equal(judged.in_view, np.isin(np.arange(1, 6), layout))
    np.testing.assert_allclose(judged.iou[judged.in_view], 1.0)
    wrong = layout.copy()
    wrong[:, :80] = 2
    judged = judge_signs(replace(estimate, layout=wrong), layout)
    assert judged is not None
    assert judged.right == pytest.approx((wrong == layout).mean())
    assert judge_signs(no_estimate(Status.NO_ROOM, frame, {}), layout) is None
