"""A part of the model against a single cause: where both explain the images alike, the single cause is believed.

The many unknowns of a part, such as the errors of all links, can stand in for one that the model lacks, such as a gear
ratio. The images then fit, the predictions do not, and no test of the whole model shows the cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from calib.chain.fit import Problem, fit_chains
from calib.chain.model_selection import Choice, Part, select_parts, without
from calib.chain.score_tests import find_error_hypotheses

UNEXPLAINED = 0.1  # of a rise or a disagreement that a single cause leaves unexplained at most


def prefer_single_causes(choice: Choice, parts: Sequence[Part], readings: Sequence[str]) -> Choice:
    """Return the choice without the parts that a single cause replaces: `Trial.instead` names it.

    Args:
        choice: a model and its fit.
        parts: of the model; those that exist by their prior are not replaced.
        readings: their names, for a single chain.
    """
    for part in parts:
        trial = next(t for t in choice.trials if t.part == part.name)
        if part.known or not trial.needed:
            continue
        bare = _with_known(without(choice.problem, part), parts)
        fit = fit_chains(bare, choice.fit.weights, choice.fit)
        rise = fit.cost - choice.fit.cost
        left = max(UNEXPLAINED * rise, float(len(part.unknowns)))
        causes = [s for s in find_error_hypotheses(bare, fit, readings) if s.sure and rise - s.drop <= left]
        if causes:
            instead = replace(trial, rise=rise - causes[0].drop, instead=causes[0].name)
            # whether the images show what exists anyway is judged anew, now that the part does not stand in for it
            known = select_parts(bare, [p for p in parts if p.known], fit, bare.noise_freedom)
            now = {t.part: t for t in (instead, *known.trials)}
            choice = Choice(known.problem, known.fit, tuple(now.get(t.part, t) for t in choice.trials))
    return choice


def _with_known(problem: Problem, parts: Sequence[Part]) -> Problem:
    """The problem with the parts that exist by their prior: another part may have stood in for them."""
    free = problem.free.copy()
    for part in parts:
        if part.known:
            free[list(part.unknowns)] = True
    return replace(problem, free=free)
