"""Identification: parameters of the drive from measured lines, with verdicts on them.

A global search, local fits and a second search (``search``) minimise weighted differences between
measured and simulated figures (``problem``). Goodness of fit comes first (``goodness``): a model
that does not explain the data identifies nothing. Intervals are those of the profile of the cost
where its curvature alone is wrong (``intervals``); ``verdict`` says what each estimate is worth.
The clock is not fitted: the evidence tells it directly.

A calibration is not a prediction: parameters that are fitted to some lines say nothing new about
these lines.
"""

from microvib.studies.identify.fit import MODEL_ERROR, Fit, identify
from microvib.studies.identify.goodness import Deviation, Goodness
from microvib.studies.identify.keys import FitKey, IntegerKey, parse_fit, parse_key
from microvib.studies.identify.problem import ErrorModel, FitProgress
from microvib.studies.identify.selection import Candidate, effects_of, with_effects
from microvib.studies.identify.verdict import Dependence, Estimate

__all__ = [
    "MODEL_ERROR",
    "Candidate",
    "Dependence",
    "Deviation",
    "ErrorModel",
    "Estimate",
    "Fit",
    "FitKey",
    "FitProgress",
    "Goodness",
    "IntegerKey",
    "effects_of",
    "identify",
    "parse_fit",
    "parse_key",
    "with_effects",
]
