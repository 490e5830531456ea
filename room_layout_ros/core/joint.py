"""Joint estimation of layout and labels by alternating exact minimisation (paper 3.3; docs/method.md, section 8)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .config import EstimatorConfig
from .depth import DepthGeometry
from .energies import (
    ExtraCosts,
    compatibility_costs,
    couple,
    label_problem,
    layout_costs,
    superpixel_faces,
)
from .frame import CameraIntrinsics
from .frame_evidence import FrameEvidence
from .integral_geometry import PairTables, pair_tables
from .joint_problem import FirstParts, JointProblem, build_joint_problem, gather_parts
from .labelling import Labelling, LabelSolver
from .labels import FRONT_FACE, N_FACES, N_LABELS
from .layout import RoomCuboid
from .layout_search import (
    Layout,
    RankedLayout,
    add_unaries,
    diverse_layouts,
    layout_energy,
    min_marginals,
)
from .plane_costs import PlaneCosts, plane_costs, with_fit
from .ray_grid import SIDE_FACE
from .scale_search import PlacedLayout, best_layout
from .superpixels import Superpixels
from .wall_naming import NAME_TIE
from .weights import ModelWeights

_TIE = 1e-12
_NEAR_STATES = 2


@dataclass(frozen=True, slots=True)
class JointSolution:
    """The minimum found.

    Attributes
    ----------
    layout : state indices of ceiling, floor, left and right ray. scale : distance of the front wall in m (1 without
        depth).
    labels : (K,) int64, 0..5. energy : E(x, y). bound : no labels and layout have less.
    energies : after every half step of the best start, never rising.
    face_confidence : (5,) 0..1 from the min-marginals; 0 for a face that is not in view.
    finished : False where the deadline ended the search early.
    """

    layout: Layout
    scale: float
    labels: NDArray[np.int64]
    energy: float
    bound: float
    energies: tuple[float, ...]
    face_confidence: NDArray[np.float64]
    finished: bool


@dataclass(frozen=True, slots=True)
class JointEstimate:
    """The best solution over the namings of the axes.

    Attributes
    ----------
    solution : JointSolution. cuboid : its room, with planes at states of the rays.
    """

    solution: JointSolution
    cuboid: RoomCuboid

    @property
    def labels(self) -> NDArray[np.uint8]:
        """(K,) label ids 1..6 of the superpixels."""
        return (self.solution.labels + 1).astype(np.uint8)


def estimate_joint(
    camera: CameraIntrinsics,
    superpixels: Superpixels,
    hypotheses: tuple[FrameEvidence, ...],
    geometry: DepthGeometry | None,
    weights: ModelWeights,
    config: EstimatorConfig,
    expired: Callable[[], bool] = lambda: False,
    first: FirstParts | None = None,
) -> JointEstimate:
    """Solve the joint problem under each naming of the axes and keep the one of least energy.

    Parameters
    ----------
    camera : CameraIntrinsics
    superpixels : Superpixels
    hypotheses : FrameEvidence, best first
        Evidence under each naming; near ties go to the earlier, so that names do not flicker.
    geometry : DepthGeometry or None
        None: without depth; the room then has the front wall at distance 1.
    weights : ModelWeights
    config : EstimatorConfig
    expired : callable
        True once the deadline has passed. The first hypothesis always gets an answer.
    first : FirstParts, optional
        Gathered already, the atoms for the first hypothesis.

    Raises
    ------
    ValueError
        When there is no hypothesis, an array does not fit, or `first` is of other axes than the first hypothesis.
    """
    if not hypotheses:
        raise ValueError("no hypothesis of the axes is given; at least one is needed")
    if first is not None and not np.array_equal(first.atoms.counts.grid.R_room_camera, hypotheses[0].R_room_camera):
        raise ValueError("the atoms given are counted under other axes than those of the first hypothesis")
    weights = weights.used(config.joint_variant, with_depth=geometry is not None)
    best: tuple[_Alternation, _State] | None = None
    parts = gather_parts(superpixels, geometry, config) if first is None else first.shared
    for index, evidence in enumerate(hypotheses):
        if best is not None and expired():
            break
        atoms = first.atoms if first is not None and index == 0 else None
        problem = build_joint_problem(camera, superpixels, evidence, geometry, config, parts=parts, atoms=atoms)
        solver = _Alternation(problem, weights, config, expired, None)
        state = solver.search()
        if best is None or state.energy < best[1].energy - NAME_TIE:
            best = (solver, state)
    if best is None:
        raise AssertionError("no hypothesis was solved")
    solver, state = best
    solution = solver.conclude(state, config.joint_bound)
    cuboid = solver.problem.counts.grid.cuboid(solution.layout, solution.scale)
    return JointEstimate(solution, cuboid)


def solve_joint(
    problem: JointProblem,
    weights: ModelWeights,
    config: EstimatorConfig,
    expired: Callable[[], bool] = lambda: False,
    extra: ExtraCosts | None = None,
    starts: tuple[RankedLayout, ...] = (),
    prove: bool = True,
) -> JointSolution:
    """Minimise the joint energy over labels, layout and scale.

    Parameters
    ----------
    problem : JointProblem
    weights : ModelWeights
    config : EstimatorConfig
        `joint_alternations`, `joint_starts`, `labelling_sweeps`.
    expired : callable
        True once the deadline has passed; asked between half steps. The first labelling is always made.
    extra : ExtraCosts, optional
        Added to the energy (the negative loss, for learning).
    starts : RankedLayout, optional
        Further layouts to start from (the true one, for learning); their energies are not read.
    prove : bool
        False leaves the lower bound at -inf.
    """
    solver = _Alternation(problem, weights, config, expired, extra)
    return solver.conclude(solver.search(starts), prove)


@dataclass(frozen=True, slots=True)
class _State:
    layout: Layout
    scale: int
    labelling: Labelling
    energies: tuple[float, ...]

    @property
    def energy(self) -> float:
        return self.energies[-1]


class _Alternation:
    """The half steps on one problem; holds what does not change between them."""

    def __init__(
        self,
        problem: JointProblem,
        weights: ModelWeights,
        config: EstimatorConfig,
        expired: Callable[[], bool],
        extra: ExtraCosts | None,
    ) -> None:
        self.problem, self.weights, self.config, self.expired = problem, weights, config, expired
        self.labels_alone = label_problem(problem, weights, extra)
        self.solver = LabelSolver(self.labels_alone)
        self.cost_alone = layout_costs(problem, weights, extra)
        self.tables_alone = pair_tables(problem.counts, self.cost_alone)
        self.planes_alone = plane_costs(problem, weights)
        self.area = problem.area
        self.faces: dict[Layout, NDArray[np.float64]] = {}
        self.given: dict[bytes, tuple[PairTables, PlaneCosts]] = {}

    def search(self, starts: tuple[RankedLayout, ...] = ()) -> _State:
        """Alternate from every start; the state of least energy."""
        best: _State | None = None
        for start in (*self.first_layouts(), *(self.placed(s.layout) for s in starts)):
            state = self.run(start)
            if best is None or state.energy < best.energy - _TIE:
                best = state
            if self.expired():
                break
        if best is None:
            raise AssertionError("a layout search without a start")
        return best

    def first_layouts(self) -> list[PlacedLayout]:
        """Best layouts of E_layout alone: the diverse ones at the best scale."""
        best = best_layout(self.tables_alone, self.planes_alone)
        if self.config.joint_starts == 1:
            return [best]
        tables = add_unaries(self.tables_alone, self.planes_alone.unaries(best.scale))
        ranked = diverse_layouts(tables, self.config.joint_starts)
        return [
            PlacedLayout(r.layout, best.scale, r.energy + float(self.planes_alone.constant[best.scale])) for r in ranked
        ]

    def placed(self, layout: Layout) -> PlacedLayout:
        """Return a layout at the scale that suits it best."""
        energies = [self.planes_alone.of(layout, c) for c in range(len(self.problem.scales))]
        c = int(np.argmin(energies))
        return PlacedLayout(layout, c, layout_energy(self.tables_alone, layout) + energies[c])

    def run(self, start: PlacedLayout) -> _State:
        """Alternate from one layout until nothing changes, the rounds are used up or the time is."""
        layout, scale = start.layout, start.scale
        labelling = self.label(layout, scale, None)
        energies = [start.energy + labelling.energy]
        for _ in range(self.config.joint_alternations):
            if self.expired():
                break
            moved = best_layout(*self.given_labels(labelling.labels), (layout, scale))
            energies.append(moved.energy + self.labels_alone.energy(labelling.labels))
            if (moved.layout, moved.scale) == (layout, scale):
                break
            layout, scale = moved.layout, moved.scale
            if self.expired():
                break
            labelling = self.label(layout, scale, labelling)
            energies.append(self.layout_alone(layout, scale) + labelling.energy)
        return _State(layout, scale, labelling, tuple(energies))

    def given_labels(self, labels: NDArray[np.int64]) -> tuple[PairTables, PlaneCosts]:
        """E_layout + E_comp(x, .) as tables; kept, since starts often meet in the same labels."""
        key = labels.tobytes()
        if key not in self.given:
            cost = self.cost_alone + compatibility_costs(self.problem, self.weights, labels)
            tables = pair_tables(self.problem.counts, cost)
            self.given[key] = tables, with_fit(self.planes_alone, self.problem, self.weights, labels, self.area)
        return self.given[key]

    def layout_alone(self, layout: Layout, scale: int) -> float:
        return layout_energy(self.tables_alone, layout) + self.planes_alone.of(layout, scale)

    def label(self, layout: Layout, scale: int, start: Labelling | None) -> Labelling:
        """Labels for a layout: min over x of E_labelling + E_comp(., y)."""
        scale_m = float(self.problem.scales[scale])
        coupled = couple(self.problem, self.weights, self.faces_of(layout), self.area, layout, scale_m)
        return self.solve_labels(coupled, start)

    def faces_of(self, layout: Layout) -> NDArray[np.float64]:
        """(K, 5) `superpixel_faces` of a layout; kept, since starts often meet."""
        if layout not in self.faces:
            self.faces[layout] = superpixel_faces(self.problem, layout)
        return self.faces[layout]

    def solve_labels(self, added: NDArray[np.float64], start: Labelling | None) -> Labelling:
        return self.solver.solve(self.labels_alone.unary + added, self.config.labelling_sweeps, start)

    def conclude(self, state: _State, prove: bool) -> JointSolution:
        """Add bound and confidences to the best state."""
        finished = not self.expired()
        tables, planes = self.given_labels(state.labelling.labels)
        full = add_unaries(tables, planes.unaries(state.scale))
        return JointSolution(
            layout=state.layout,
            scale=float(self.problem.scales[state.scale]),
            labels=state.labelling.labels,
            energy=state.energy,
            bound=self.bound(state) if prove and finished else -np.inf,
            energies=state.energies,
            face_confidence=_face_confidence(
                self.faces_of(state.layout), full, state.layout, self.config.layout_temperature
            ),
            finished=finished,
        )

    def bound(self, state: _State) -> float:
        """Lower bound on the joint energy.

        With any costs m(k, label) moved from the layout's side to the labels', and the plane fit at its least,
        min E >= min_x [E_lab + least fit + m] + min_y [E_layout + sum over pixels of min_label (w_comp - m per pixel)],
        with w_comp = 0 for a pixel that hits no face. Both minima are bounded or exact. m is tried as 0 and as E_comp
        at the layout found, where the second term is tight but for superpixels that straddle faces.
        """
        problem = self.problem
        w = self.weights.block("compatibility")
        least = np.zeros((len(problem.label_gc), N_LABELS))
        if problem.fit is not None:
            least = problem.fit.least(self.weights.block("plane_fit")) * problem.area[:, None]
        best = -np.inf
        for share in (1.0, 0.0):
            moved = share * (self.faces_of(state.layout) @ w)
            per_pixel = moved / np.maximum(problem.area * problem.pixels, 1e-9)[:, None]
            relaxed = (w[None] / problem.pixels - per_pixel[:, None, :]).min(axis=2)
            cost = self.cost_alone + relaxed[problem.atom_superpixel]
            faceless = -per_pixel.max(axis=1)[problem.atom_superpixel]
            of_layout = best_layout(pair_tables(problem.counts, cost, faceless), self.planes_alone).energy
            best = max(best, of_layout + self.solve_labels(moved + least, None).bound)
        return min(best, state.energy)


def _face_confidence(
    faces: NDArray[np.float64], tables: PairTables, layout: Layout, temperature: float
) -> NDArray[np.float64]:
    """Share of belief, exp(-min-marginal / temperature), within two states of the chosen ray.

    The front wall has the mean of its borders.
    """
    confidence = np.zeros(N_FACES)
    seen = faces.sum(axis=0)
    borders = []
    for side, (marginal, state) in enumerate(zip(min_marginals(tables), layout, strict=True)):
        belief = np.exp(-(marginal - marginal.min()) / temperature)
        near = belief[max(0, state - _NEAR_STATES) : state + _NEAR_STATES + 1].sum() / belief.sum()
        face = SIDE_FACE[side] - 1
        if seen[face] > 1e-3:
            confidence[face] = near
            borders.append(near)
    if seen[FRONT_FACE] > 1e-3:
        confidence[FRONT_FACE] = np.mean(borders) if borders else 0.0
    return confidence
