"""Limits and what they say of lines, as the page draws them."""

from __future__ import annotations

import math
from typing import Any

from microvib.analysis.limits import Judgement


def drawn_limit(judged: Judgement) -> dict[str, Any]:
    """The verdict in words, with its gaps and each line's, and the limit in SI units: the least that is
    allowed anywhere, its band [Hz], and the points of its curve, None of one number.
    """
    limit = judged.limit
    points = limit.as_dict()
    curve = points.get("curve") or points.get("loads", {}).get(judged.component)
    return {
        "text": str(judged),
        "verdict": judged.verdict,
        "gaps": judged.all_gaps,
        "torque": limit.torque if math.isfinite(limit.torque) else None,
        "low": limit.low,
        "high": limit.high if math.isfinite(limit.high) else None,
        "curve": None if limit.is_one_number else curve,
        "margins": [{"line": m.line.name, "verdict": m.verdict} for m in judged.margins],
    }
