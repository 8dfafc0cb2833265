"""Goodness of a fit: whether the model explains the evidence, and what of it is off."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from microvib.studies.evidence import Observation, predicted
from microvib.studies.identify.problem import TORQUE_FORMS, Problem

REJECTION_PROBABILITY = 1e-3
"""Probability of so large a chi-square with a correct model, below which a model does not explain
the data.
"""
OUTLIER_SIGMAS = 3.0
"""Standard deviations above which a figure counts as off."""
MIN_DEGREES_OF_FREEDOM = 3
"""Degrees of freedom below which the data hardly check the model."""
TRIAL_MODEL_ERRORS = (*(1e-3 * k for k in range(1, 100)), *(1e-2 * k for k in range(10, 31)))
"""Errors of amplitudes at which it is asked whether a model would explain the data."""
QUESTIONABLE_PROBABILITY = 0.05
"""Probability of so large a chi-square below which a model is questionable where the data hardly check
it.
"""


@dataclass(frozen=True)
class Goodness:
    """Goodness of a fit."""

    chi_square: float
    figures: int
    """Observed figures."""
    parameters: int

    @property
    def freedom(self) -> int:
        """Degrees of freedom: figures over parameters."""
        return self.figures - self.parameters

    @property
    def ratio(self) -> float:
        """Chi-square per degree of freedom; where there is none, chi-square itself."""
        return self.chi_square / max(self.freedom, 1)

    @property
    def is_questionable(self) -> bool:
        """Whether few degrees of freedom are left to check the model, and these speak against it."""
        from scipy.stats import chi2

        return (
            0 < self.freedom < MIN_DEGREES_OF_FREEDOM
            and float(chi2.sf(self.chi_square, self.freedom)) < QUESTIONABLE_PROBABILITY
        )

    @property
    def limit(self) -> float:
        """Chi-square per degree of freedom that a correct model exceeds in one of a thousand cases."""
        from scipy.stats import chi2

        return float(chi2.isf(REJECTION_PROBABILITY, max(self.freedom, 1))) / max(self.freedom, 1)

    @property
    def explained(self) -> bool:
        """Whether the model explains the data."""
        return self.ratio <= self.limit

    @property
    def counted(self) -> str:
        """Figures and parameters in words."""
        return f"{self.figures} figures, {self.parameters} parameter{'s' if self.parameters > 1 else ''}"

    @property
    def sentence(self) -> str:
        """In words."""
        if self.explained and self.freedom <= 0:
            return (
                f"No degrees of freedom are left to check the model: {self.counted}. Any model with"
                " this many parameters could fit."
            )
        value = f"chi-square {self.ratio:.3g} per degree of freedom; {self.counted}"
        if not self.explained:
            return f"The model does not explain these data: {value}; a correct model stays below {self.limit:.3g}."
        few = " Few degrees of freedom are left to check the model: a wrong one might fit, too."
        return (
            "The model explains these data within their uncertainties:"
            f" {value}.{few if self.freedom < MIN_DEGREES_OF_FREEDOM else ''}"
        )


@dataclass(frozen=True)
class Deviation:
    """One figure of a test beside the fitted model's."""

    test: str
    line: str
    form: str
    measured: float
    fitted: float
    sigma: float
    """Difference over its standard deviation, errors that figures of the recording share taken off."""

    @property
    def off(self) -> bool:
        """Whether it is further off than its uncertainty explains."""
        return not abs(self.sigma) <= OUTLIER_SIGMAS


def goodness(problem: Problem, r: np.ndarray) -> Goodness:
    """Goodness of residuals: those of figures and of errors that they share, without the prior's."""
    m = len(problem.keys)
    return Goodness(float(r[:-m] @ r[:-m]), problem.figures, m)


def required_model_error(problem: Problem, r: np.ndarray) -> Iterator[str]:
    """A sentence on the error of each amplitude at which the model would explain the evidence,
    where it does not.
    """
    if goodness(problem, r).explained:
        return
    sizes = np.array([o.form in TORQUE_FORMS for _, o in problem.observed], dtype=bool)
    rest, m = r[: problem.figures] * problem.weights, len(problem.keys)
    other = float(np.sum(r[problem.figures : -m] ** 2))

    def explains(error: float) -> bool:
        more = np.where(sizes, max(error**2 - problem.trust.each**2, 0.0), 0.0)
        squares = float(np.sum(rest**2 / (problem.weights**2 + more))) + other
        return Goodness(squares, problem.figures, m).explained

    now = f"{100.0 * problem.trust.each:.2g} percent"
    enough = next(
        (error for error in TRIAL_MODEL_ERRORS if error > problem.trust.each and explains(error)),
        None,
    )
    if enough is not None:
        yield (
            f"At a model_error of {100.0 * enough:.2g} percent, in place of {now}, it would explain"
            " them: state that if model and"
            " instrument are no better."
        )
        return
    far = np.abs(r[: problem.figures]) > OUTLIER_SIGMAS
    forms = sorted(
        {
            o.form
            for (_, o), off in zip(problem.observed, far, strict=True)
            if off and o.form not in TORQUE_FORMS
        }
    )
    if forms:
        also = f"; figures of {', '.join(forms)} are off, which no model_error explains"
    else:
        also = ""
    yield f"No model_error up to {100.0 * TRIAL_MODEL_ERRORS[-1]:.0f} percent would make it explain them{also}."


def unwrap_to_measured(o: Observation, value: float) -> float:
    """A model's figure beside a measured one: an angle within half a turn of it."""
    if o.is_angle and math.isfinite(value):
        return o.value + math.remainder(value - o.value, math.tau)
    return value


def deviations(problem: Problem, x: np.ndarray) -> tuple[Deviation, ...]:
    """All figures beside the model's at ``x``."""
    tables = problem.lines(x)
    sigma, _ = problem.weighted(problem.differences(tables))
    return tuple(
        Deviation(
            problem.tests[k][0].name, o.line, o.form, o.value,
            math.nan if tables is None else unwrap_to_measured(o, predicted(tables[k], o)), float(s),
        )
        for (k, o), s in zip(problem.observed, sigma, strict=True)
    )  # fmt: skip
