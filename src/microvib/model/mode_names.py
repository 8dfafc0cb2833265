"""Names of a craft's modes: by what holds most of their elastic energy while both hinges are
locked.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from microvib.model.craft import Craft, hub_matrices
from microvib.model.line_names import ARRAY_MODE, CONTROL_MODE, HUB_MODE, SECOND_WING_MODE, LineName


def mode_names(craft: Craft) -> tuple[str, ...]:
    """Names of the modes in the order of their frequencies: ``array_mode_1``, ``hub_mode_1``,
    ``control_mode_1`` and so on.

    There are as many of each as it has coordinates, so that ``array_mode_k`` is the k-th mode of
    the array also where energies are shared: the mode that is most of its own kind is named first.
    """
    spacecraft, shapes, wing = craft.spacecraft, craft.shapes, craft.second
    _, K, _, free = hub_matrices(spacecraft)
    flexible = 6 + len(spacecraft.hub.modes)
    end = flexible + (0 if wing is None else len(wing.M))
    parts = {CONTROL_MODE: (free, 6, K[free:6, free:6]), HUB_MODE: (6, flexible, K[6:, 6:])}
    parts |= {SECOND_WING_MODE: (flexible, end, np.zeros((0, 0)) if wing is None else wing.K)}
    energy = {
        kind: np.sum(shapes[a:b] * (held @ shapes[a:b]), axis=0)
        for kind, (a, b, held) in parts.items()
    }
    energy[ARRAY_MODE] = craft.squares - sum(energy.values())
    left = {kind: b - a for kind, (a, b, _) in parts.items()} | {ARRAY_MODE: len(shapes) - end}
    kinds = list(energy)
    shares = np.array([energy[kind] for kind in kinds]) / craft.squares
    named: dict[int, str] = {}
    for place in np.argsort(-shares, axis=None, kind="stable").tolist():
        kind, mode = kinds[place // shares.shape[1]], place % shares.shape[1]
        if mode not in named and left[kind]:
            named[mode], left[kind] = kind, left[kind] - 1
    count: Counter[str] = Counter()
    names = []
    for mode in range(shares.shape[1]):
        count[named[mode]] += 1
        names.append(str(LineName(named[mode], count[named[mode]])))
    return tuple(names)
