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
    JointProblem,
    coupling,
    label_problem,
    layout_costs,
    layout_tables,
    plane_costs,
    superpixel_faces,
)
from .frame import CameraIntrinsics
from .integral_geometry import PairTables, pair_tables
from .joint_problem import FrameEvidence, build_joint_problem
from .labelling import Labelling, LabelProblem, solve_labelling
from .labels import FRONT_WALL, N_FACES
from .layout import RoomCuboid
from .layout_search import (
    Layout,
    RankedLayout,
    add_unaries,
    diverse_layouts,
    layout_energy,
    min_marginals,
    search_layout,
)
from .ray_grid import SIDE_FACE
from .superpixels import Superpixels
from .weights import ModelWeights

_TIE = 1e-12
_NAME_TIE = 1e-3
_NEAR_STATES = 2


@dataclass(frozen=True, slots=True)
class JointSolution:
    """The minimum found.

    Attributes
    ----------
    layout : state indices of ceiling, floor, left and right ray. scale : distance of the front wall in m (1 without
        depth).
    labels : (K,) int64, 0..5. energy : E(x, y). bound : no labels and layout have less. gap : energy - bound.
    energies : after every half step of the best start, never rising.
    face_confidence : (5,) 0..1 from the min-marginals; 0 for a face that is not in view.
    finished : False where the deadline ended the search early.
    messages : state of the message passing, to warm-start the next frame's.
    """

    layout: Layout
    scale: float
    labels: NDArray[np.int64]
    energy: float
    bound: float
    energies: tuple[float, ...]
    face_confidence: NDArray[np.float64]
    finished: bool
    messages: Labelling

    @property
    def gap(self) -> float:
        """Energy above the lower bound; 0 proves the optimum."""
        return self.energy - self.bound


@dataclass(frozen=True, slots=True)
class JointEstimate:
    """The best solution over the namings of the axes.

    Attributes
    ----------
    hypothesis : index of the evidence it is for. solution : JointSolution. cuboid : the refined room.
    energies : of every hypothesis tried, in order.
    """

    hypothesis: int
    solution: JointSolution
    cuboid: RoomCuboid
    energies: tuple[float, ...]

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

    Raises
    ------
    ValueError
        When there is no hypothesis or an array does not fit.
    """
    if not hypotheses:
        raise ValueError("no hypothesis of the axes is given; at least one is needed")
    weights = (
        weights.variant(config.joint_variant)
        if geometry is not None
        else weights.variant(config.joint_variant).variant("rgb")
    )
    best: tuple[int, JointProblem, JointSolution] | None = None
    energies: list[float] = []
    for index, evidence in enumerate(hypotheses):
        if best is not None and expired():
            break
        problem = build_joint_problem(camera, superpixels, evidence, geometry, config)
        solution = solve_joint(problem, weights, config, expired, prove=config.joint_bound)
        energies.append(solution.energy)
        if best is None or solution.energy < best[2].energy - _NAME_TIE:
            best = (index, problem, solution)
    if best is None:
        raise AssertionError("no hypothesis was solved")
    index, problem, solution = best
    return JointEstimate(index, solution, refine_cuboid(problem, weights, solution), tuple(energies))


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
        Further layouts to start from (the previous frame's); their energies are not read.
    prove : bool
        False leaves the lower bound at -inf.
    """
    solver = _Alternation(problem, weights, config, expired, extra)
    best: _State | None = None
    for start in (*solver.first_layouts(), *(solver.placed(s.layout) for s in starts)):
        state = solver.run(start)
        if best is None or state.energy < best.energy - _TIE:
            best = state
        if expired():
            break
    if best is None:
        raise AssertionError("a layout search without a start")
    return solver.conclude(best, prove)


@dataclass(frozen=True, slots=True)
class _Placed:
    """A layout with its metric scale and its energy without labels."""

    layout: Layout
    scale: float
    energy: float


@dataclass(frozen=True, slots=True)
class _State:
    placed: _Placed
    labelling: Labelling
    energy: float
    energies: tuple[float, ...]


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
        self.problem, self.weights, self.config, self.expired, self.extra = problem, weights, config, expired, extra
        self.labels_alone = label_problem(problem, weights, extra)
        self.tables_alone = layout_tables(problem, weights, None, extra)
        self.planes = [plane_costs(problem, weights, float(c)) for c in problem.scales]
        self.plane_minimum = np.array(
            [sum(float(u.min()) for u in sides) + constant for sides, constant in self.planes]
        )

    def first_layouts(self) -> list[_Placed]:
        """Best layouts of E_layout alone: the diverse ones at the best scale."""
        best = self.best_layout(self.tables_alone)
        if self.config.joint_starts == 1:
            return [best]
        index = int(np.flatnonzero(self.problem.scales == best.scale)[0])
        sides, constant = self.planes[index]
        ranked = diverse_layouts(add_unaries(self.tables_alone, sides), self.config.joint_starts)
        return [_Placed(r.layout, best.scale, r.energy + constant) for r in ranked]

    def placed(self, layout: Layout) -> _Placed:
        """Return a layout at the scale that suits it best."""
        energies = [self.plane_energy(layout, c) for c in range(len(self.planes))]
        c = int(np.argmin(energies))
        return _Placed(layout, float(self.problem.scales[c]), layout_energy(self.tables_alone, layout) + energies[c])

    def plane_energy(self, layout: Layout, c: int) -> float:
        sides, constant = self.planes[c]
        return constant + float(sum(side[state] for side, state in zip(sides, layout, strict=True)))

    def best_layout(self, tables: PairTables, known: _Placed | None = None) -> _Placed:
        """Return the exact minimum over layouts and scales; scales whose lower bound is no better are not searched."""
        floor = search_layout(tables).energy
        best = known
        if known is not None:
            c = int(np.flatnonzero(self.problem.scales == known.scale)[0])
            best = _Placed(
                known.layout, known.scale, layout_energy(tables, known.layout) + self.plane_energy(known.layout, c)
            )
        for c in np.argsort(self.plane_minimum, kind="stable"):
            if best is not None and floor + self.plane_minimum[c] >= best.energy - _TIE:
                break
            sides, constant = self.planes[c]
            found = search_layout(add_unaries(tables, sides))
            if best is None or found.energy + constant < best.energy - _TIE:
                best = _Placed(found.layout, float(self.problem.scales[c]), found.energy + constant)
        if best is None:
            raise AssertionError("no scale to search")
        return best

    def run(self, start: _Placed) -> _State:
        """Alternate from one layout until nothing changes, the rounds are used up or the time is."""
        placed = start
        labelling = self.label(placed.layout, None)
        energies = [placed.energy + labelling.energy]
        for _ in range(self.config.joint_alternations):
            if self.expired():
                break
            tables = layout_tables(self.problem, self.weights, labelling.labels, self.extra)
            alone = self.labels_alone.energy(labelling.labels)
            moved = self.best_layout(tables, placed)
            energies.append(moved.energy + alone)
            if moved.layout == placed.layout and moved.scale == placed.scale:
                break
            placed = moved
            if self.expired():
                break
            labelling = self.label(placed.layout, labelling)
            energies.append(self.layout_alone(placed) + labelling.energy)
        return _State(self.alone(placed), labelling, energies[-1], tuple(energies))

    def alone(self, placed: _Placed) -> _Placed:
        return _Placed(placed.layout, placed.scale, self.layout_alone(placed))

    def layout_alone(self, placed: _Placed) -> float:
        c = int(np.flatnonzero(self.problem.scales == placed.scale)[0])
        return layout_energy(self.tables_alone, placed.layout) + self.plane_energy(placed.layout, c)

    def label(self, layout: Layout, start: Labelling | None) -> Labelling:
        """Labels for a layout: min over x of E_labelling + E_comp(., y)."""
        alone = self.labels_alone
        unary = alone.unary + coupling(self.problem, self.weights, layout)
        return solve_labelling(LabelProblem(unary, alone.edges, alone.pairwise), self.config.labelling_sweeps, start)

    def conclude(self, state: _State, prove: bool) -> JointSolution:
        """Add bound and confidences to the best state."""
        finished = not self.expired()
        tables = layout_tables(self.problem, self.weights, state.labelling.labels, self.extra)
        c = int(np.flatnonzero(self.problem.scales == state.placed.scale)[0])
        full = add_unaries(tables, self.planes[c][0])
        return JointSolution(
            layout=state.placed.layout,
            scale=state.placed.scale,
            labels=state.labelling.labels,
            energy=state.energy,
            bound=self.bound(state) if prove and finished else -np.inf,
            energies=state.energies,
            face_confidence=_face_confidence(self.problem, full, state.placed.layout, self.config.layout_temperature),
            finished=finished,
            messages=state.labelling,
        )

    def bound(self, state: _State) -> float:
        """Lower bound on the joint energy.

        With any costs m(k, label) moved from the labels' side to the layout's,
        min E >= min_x [E_lab + m] + min_y [E_layout + sum over pixels of min_label (w_comp - m per pixel)].
        m = E_comp at the layout found makes the first term the labelling's own bound, and the second tight where
        superpixels do not straddle faces; the rest of the gap is honest.
        """
        problem = self.problem
        w = self.weights.block("compatibility") / problem.pixels
        best = -np.inf
        for share in (1.0, 0.0):
            moved = share * coupling(problem, self.weights, state.placed.layout)
            per_pixel = moved / np.maximum(problem.area * problem.pixels, 1e-9)[:, None]
            relaxed = (w[None] - per_pixel[:, None, :]).min(axis=2)
            cost = layout_costs(problem, self.weights, self.extra) + relaxed[problem.atom_superpixel]
            of_layout = self.best_layout(pair_tables(problem.counts, cost)).energy
            if share == 1.0:
                of_labels = state.labelling.bound
            else:
                alone = self.labels_alone
                of_labels = solve_labelling(alone, self.config.labelling_sweeps).bound
            best = max(best, of_layout + of_labels)
        return min(best, state.energy)


def _face_confidence(
    problem: JointProblem, tables: PairTables, layout: Layout, temperature: float
) -> NDArray[np.float64]:
    """Share of belief, exp(-min-marginal / temperature), within two states of the chosen ray.

    The front wall has the mean of its borders.
    """
    confidence = np.zeros(N_FACES)
    seen = superpixel_faces(problem, layout).sum(axis=0)
    borders = []
    for side, (marginal, state) in enumerate(zip(min_marginals(tables), layout, strict=True)):
        belief = np.exp(-(marginal - marginal.min()) / temperature)
        near = belief[max(0, state - _NEAR_STATES) : state + _NEAR_STATES + 1].sum() / belief.sum()
        face = SIDE_FACE[side] - 1
        if seen[face] > 1e-3:
            confidence[face] = near
            borders.append(near)
    if seen[FRONT_WALL - 1] > 1e-3:
        confidence[FRONT_WALL - 1] = np.mean(borders) if borders else 0.0
    return confidence


def refine_cuboid(problem: JointProblem, weights: ModelWeights, solution: JointSolution) -> RoomCuboid:
    """Move each plane of the solution to the best offset between its neighbouring states, by the depth's balance.

    The states are a few pixels apart; between them the labels' and pixels' terms hardly change, and depth knows better.
    Without depth the cuboid is the solution's own.
    """
    grid = problem.counts.grid
    cuboid = grid.cuboid(solution.layout, solution.scale)
    if problem.profiles is None:
        return cuboid
    support, violation = weights.block("plane_support"), weights.block("plane_violation")
    distances = cuboid.distances.copy()
    reach = {FRONT_WALL - 1: (solution.scale * 0.96, solution.scale * 1.04)}
    for side, state in enumerate(solution.layout):
        values = grid.side_states(side) * solution.scale
        if np.isfinite(values[state]):
            low = values[state - 1] if state > 0 else values[state] * 0.97
            high = values[state + 1] if np.isfinite(values[state + 1]) else values[state] * 1.03
            reach[SIDE_FACE[side] - 1] = ((low + values[state]) / 2, (high + values[state]) / 2)
    for face, (low, high) in reach.items():
        trials = np.append(np.linspace(low, high, 15), distances[face])
        s, v = problem.profiles.at(face, trials)
        distances[face] = (
            trials[int(np.argmin(support[face] * s + violation[face] * v))] if s.max() > 0 else distances[face]
        )
    return RoomCuboid(cuboid.R_room_camera, distances)
