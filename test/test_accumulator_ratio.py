"""The ratio that the paper's section 3.5 is about: CPU time in one run, so that other processes hardly matter."""

from __future__ import annotations

import contextlib
import io

import pytest

from benchmarks import accumulators

Ratios = tuple[dict[str, float], str]


@pytest.fixture(scope="module")
def as_it_is() -> Ratios:
    """The figures and what was printed."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        figures = accumulators.run(rounds=1)  # raises where the ways differ
    return figures, printed.getvalue()


def test_accumulators_agree_and_inference_asks_a_thousand_times_faster_than_naively(as_it_is: Ratios) -> None:
    """Issue 3: 1000 for what inference needs, its counting included; measured were 1900 to 2000."""
    figures, printed = as_it_is
    assert figures[accumulators.INFERENCE] > 1000
    assert figures["naive / ours"] > 2500  # measured 5100 to 6800
    assert figures[accumulators.FIVE] > 300  # measured 580 to 620
    assert figures["naive / Alg. 2"] > 10  # measured 26; the paper: 22
    assert accumulators.INFERENCE in printed


def test_a_slower_inference_is_noticed(as_it_is: Ratios, monkeypatch: pytest.MonkeyPatch) -> None:
    """The figure is of what inference does: counting every pixel instead of one in five halves it.

    (Between 540 and 1200 then, by the machine and what else it does, so the gate of 1000 alone is no test of that.)
    """
    monkeypatch.setattr(accumulators, "STEP", 1)
    assert accumulators.run(rounds=1)[accumulators.INFERENCE] < 0.8 * as_it_is[0][accumulators.INFERENCE]
