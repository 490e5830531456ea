"""The joint energy of layout and labels, E = w . phi(x, y) (docs/method.md, section 6).

All terms are shares of the image, so that weights do not depend on the resolution or the number of superpixels:
layout and compatibility terms per pixel, unary terms per superpixel area, pair terms per border length times the mean
superpixel's side. Every named block of phi (`weights.BLOCKS`) has its costs here once, for inference, and its features
once, for learning; a test holds them equal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .integral_geometry import face_counts
from .joint_problem import JointProblem
from .labelling import LabelProblem
from .labels import FRONT_FACE, N_FACES, N_LABELS
from .layout_search import Layout
from .plane_fit import N_FIT
from .ray_grid import N_SIDES, SIDE_FACE
from .weights import BLOCKS, N_FEATURES, SLICES, ModelWeights, physical_table

_TABLE = physical_table()
_REVERSED = [1, 0, 3, 2, 5, 4]


@dataclass(frozen=True, slots=True)
class ExtraCosts:
    """Costs added to the model's, for loss-augmented inference: (A, 5) per atom and face, (K, 6) per superpixel and
    label.

    Both are for the whole atom or superpixel, in shares of the image.
    """

    face: NDArray[np.float64]
    label: NDArray[np.float64]


# --- layout -----------------------------------------------------------------------------------------------------------


def layout_costs(problem: JointProblem, weights: ModelWeights, extra: ExtraCosts | None = None) -> NDArray[np.float64]:
    """Return the cost of one pixel of each atom in each face, E_layout only: (A, 5)."""
    w = np.concatenate([weights.block(name) for name in ("layout_om", "layout_gc", "layout_scene")], axis=1)
    cost = problem.atom_feature @ w.T / problem.pixels
    if extra is not None:
        cost += extra.face / np.maximum(problem.counts.pixels, 1.0)[:, None]
    return cost


def compatibility_costs(problem: JointProblem, weights: ModelWeights, labels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the cost of one pixel of each atom in each face for labels (K,) 0..5, E_comp: (A, 5)."""
    per_label = np.ascontiguousarray(weights.block("compatibility").T) / problem.pixels
    return per_label[labels[problem.atom_superpixel]]


# --- labels -----------------------------------------------------------------------------------------------------------


def label_problem(problem: JointProblem, weights: ModelWeights, extra: ExtraCosts | None = None) -> LabelProblem:
    """Return E_labelling as unary and pairwise costs."""
    unary = _unary(
        problem.label_gc, problem.label_om, problem.label_depth, problem.area,
        weights.block("label_gc"), weights.block("label_om"), weights.block("label_depth"), weights.block("label_bias"),
    )  # fmt: skip
    if extra is not None:
        unary += extra.label
    return LabelProblem(unary, problem.edges, pair_costs(problem, weights))


@njit(cache=True, nogil=True)
def _unary(context, orientation, depth, area, w_context, w_orientation, w_depth, bias):  # type: ignore[no-untyped-def]
    """(K, 6); of the depth cues, the cosine and the distance that belong to a label count, each with its weight."""
    unary = np.empty((len(area), N_LABELS))
    for k in range(len(area)):
        for a in range(N_LABELS):
            cost = bias[a] + depth[k, a] * w_depth[a] + depth[k, N_LABELS + a] * w_depth[N_LABELS + a]
            for c in range(N_LABELS):
                cost += context[k, c] * w_context[c, a]
            for f in range(N_FACES):
                cost += orientation[k, f] * w_orientation[f, a]
            unary[k, a] = cost * area[k]
    return unary


def pair_costs(problem: JointProblem, weights: ModelWeights) -> NDArray[np.float64]:
    """(E, 6, 6): Table 1 for i against j and for j against i, and the cost of unlike labels."""
    per_feature = _pair_table(weights.block("pair"), weights.block("smoothness"), _TABLE)
    costs = _pairs(problem.relation, problem.smoothness, problem.contact, per_feature)
    return np.asarray(costs).reshape(-1, N_LABELS, N_LABELS)


@njit(cache=True, nogil=True)
def _pair_table(pair, smoothness, table):  # type: ignore[no-untyped-def]
    """(9, 36): what each of the six relations of i to j, and each smoothness feature, costs labels (a, b)."""
    costs = np.zeros((9, N_LABELS * N_LABELS))
    for a in range(N_LABELS):
        for b in range(N_LABELS):
            for r in range(6):
                reverse = r ^ 1  # j is below, left of, behind i
                costs[r, N_LABELS * a + b] = pair[a, b] * table[a, b, r] + pair[b, a] * table[b, a, reverse]
            for r in range(3):
                costs[6 + r, N_LABELS * a + b] = smoothness[r] if a != b else 0.0
    return costs


@njit(cache=True, nogil=True)
def _pairs(relation, smoothness, contact, per_feature):  # type: ignore[no-untyped-def]
    """(E, 36): the features of an edge times their costs for the labels, (9, 36); most relations are 0."""
    costs = np.zeros((len(contact), per_feature.shape[1]))
    for e in range(len(contact)):
        row = costs[e]
        for r in range(6):
            if relation[e, r] != 0.0:
                _add_scaled(row, relation[e, r] * contact[e], per_feature[r])
        for r in range(3):
            _add_scaled(row, smoothness[e, r] * contact[e], per_feature[6 + r])
    return costs


@njit(cache=True, nogil=True, inline="always")
def _add_scaled(row, factor, values):  # type: ignore[no-untyped-def]
    for a in range(N_LABELS * N_LABELS):
        row[a] += factor * values[a]


def violations(relation: NDArray[np.float64]) -> NDArray[np.float64]:
    """(E, 6, 6): how far the relations (E, 6) of i to j forbid the labels (a, b)."""
    result: NDArray[np.float64] = (relation @ _TABLE.reshape(36, 6).T.astype(np.float64)).reshape(-1, 6, 6)
    return result


def reversed_relation(relation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the relations of j to i: above and below, right and left, in front and behind change places."""
    return relation[:, _REVERSED]


def couple(
    problem: JointProblem,
    weights: ModelWeights,
    faces: NDArray[np.float64],
    area: NDArray[np.float64],
    layout: Layout,
    scale: float,
) -> NDArray[np.float64]:
    """Return E_comp and the plane fit of one layout as a cost per superpixel and label: (K, 6).

    `faces` : (K, 5) `superpixel_faces` of the layout. `area` : (K,) of the problem.
    """
    compatibility = weights.block("compatibility")
    if problem.fit is None:
        return faces @ compatibility
    shares = problem.fit.at(plane_distances(problem, layout, scale))
    return np.asarray(_couple(faces, compatibility, area, shares, weights.block("plane_fit")))


@njit(cache=True, nogil=True)
def _couple(faces, compatibility, area, shares, fit_weights):  # type: ignore[no-untyped-def]
    """(K, 6): faces . compatibility + area (shares[k, f] . weights[f]) for every face f."""
    cost = np.zeros((len(area), compatibility.shape[1]))
    for k in range(len(area)):
        for f in range(N_FACES):
            if faces[k, f] != 0.0:
                for a in range(compatibility.shape[1]):
                    cost[k, a] += faces[k, f] * compatibility[f, a]
        for f in range(N_FACES):
            for r in range(fit_weights.shape[1]):
                cost[k, f] += area[k] * shares[k, f, r] * fit_weights[f, r]
    return cost


def plane_distances(problem: JointProblem, layout: Layout, scale: float) -> NDArray[np.float64]:
    """(5,) distances in m of the planes of a layout; +inf where a face is absent."""
    ceiling, floor, left, right = (problem.counts.grid.states[side, state] * scale for side, state in enumerate(layout))
    return np.array([ceiling, floor, left, scale, right])


def superpixel_faces(problem: JointProblem, layout: Layout) -> NDArray[np.float64]:
    """(K, 5): share of the image that each superpixel has in each face of a layout."""
    return problem.by_superpixel(face_counts(problem.counts, layout)) / problem.pixels


# --- features ---------------------------------------------------------------------------------------------------------


def joint_features(
    problem: JointProblem, labels: NDArray[np.int64], layout: Layout, scale: float
) -> NDArray[np.float64]:
    """Return phi(x, y), for which E = w . phi.

    Parameters
    ----------
    problem : JointProblem
    labels : (K,) int64, 0..5
    layout : state indices of ceiling, floor, left and right ray.
    scale : distance of the front wall in m (not read without depth).

    Returns
    -------
    (N_FEATURES,) float64, ordered as `weights.BLOCKS`.
    """
    one_hot = np.eye(N_LABELS)[labels]
    area = problem.area[:, None] * one_hot
    faces = face_counts(problem.counts, layout) / problem.pixels
    layout_features = faces.T @ problem.atom_feature
    depth = problem.label_depth.reshape(-1, 2, N_LABELS)
    i, j = problem.edges.T
    forward = violations(problem.relation)[np.arange(len(i)), labels[i], labels[j]] * problem.contact
    backward = (
        violations(reversed_relation(problem.relation))[np.arange(len(i)), labels[j], labels[i]] * problem.contact
    )
    pair = np.zeros((N_LABELS, N_LABELS))
    np.add.at(pair, (labels[i], labels[j]), forward)
    np.add.at(pair, (labels[j], labels[i]), backward)
    support, violation, absent = _plane_features(problem, layout, scale)
    blocks = {
        "layout_om": layout_features[:, :N_FACES],
        "layout_gc": layout_features[:, N_FACES : N_FACES + N_LABELS],
        "label_gc": problem.label_gc.T @ area,
        "label_depth": np.einsum("ktl,kl->tl", depth, area).ravel(),
        "pair": pair,
        "compatibility": problem.by_superpixel(faces).T @ one_hot,
        "label_om": problem.label_om.T @ area,
        "label_bias": area.sum(axis=0),
        "smoothness": problem.smoothness.T @ (problem.contact * (labels[i] != labels[j])),
        "plane_support": support,
        "plane_violation": violation,
        "plane_fit": _fit_features(problem, area, layout, scale),
        "face_absent": absent,
        "front_axis": np.array([problem.front_axis]),
        "layout_scene": layout_features[:, N_FACES + N_LABELS :],
    }
    phi = np.empty(N_FEATURES)
    for name in BLOCKS:
        phi[SLICES[name]] = blocks[name].ravel()
    return phi


def _fit_features(
    problem: JointProblem, area: NDArray[np.float64], layout: Layout, scale: float
) -> NDArray[np.float64]:
    if problem.fit is None:
        return np.zeros((N_FACES, N_FIT))
    return np.einsum("kfr,kf->fr", problem.fit.at(plane_distances(problem, layout, scale)), area[:, :N_FACES])


def _plane_features(
    problem: JointProblem, layout: Layout, scale: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    support, violation, absent = np.zeros(N_FACES), np.zeros(N_FACES), np.zeros(N_SIDES)
    for side, state in enumerate(layout):
        value = problem.counts.grid.states[side, state]
        absent[side] = float(np.isinf(value))
        if problem.profiles is not None:
            face = SIDE_FACE[side] - 1
            s, v = problem.profiles.at(face, np.array([value * scale]))
            support[face], violation[face] = s[0], v[0]
    if problem.profiles is not None:
        s, v = problem.profiles.at(FRONT_FACE, np.array([scale]))
        support[FRONT_FACE], violation[FRONT_FACE] = s[0], v[0]
    return support, violation, absent
