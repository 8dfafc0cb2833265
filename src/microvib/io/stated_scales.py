"""Scales of samples, as far as a file's names, numbers and free texts beside them say anything of them.

Samples that may be in thousandths, or still volts, let no limit pass until the preparation states what
they are. Texts are free: what is recognised here is what may concern the scale, not what it is.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from microvib.testdata.channels import as_measured

LONGEST_REMARK = 200
"""Characters of a text beyond which it tells a story and states no scale."""
QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
"""A number, and its unit or nothing."""
_NOT_SCALED = re.compile(r"[01](\.0*)?")
"""A factor or offset, as text, that leaves samples as they are."""

_SCALE = re.compile(
    r"sensi|lsb|resolu|aufl(oe|ö)s|factor|faktor|calib|kalib|convers|scal(e|ing)|skal|gain|slope|steigung|offset|multip"
)
_SCALE_STARTS = re.compile(
    r"sens|res|fact|conv|cal|kal|scl|amp(l|s?_?per)|verst|mult|bias|zero|quant|coef|koef|poly|empf|full|fs[rv]|range|span|bits?\b"
    r"|volts?per|(eu|units?|n|nm)per|vrange"
)
"""Words in, or at the start of, the names of scale factors of converter counts."""
_FACTOR = re.compile(
    r"sensi|empfind|scal(e|ing)|skal|gain|verst(ae|ä)rk|amplif|fa[ck]tor|multip|calib|kalib|convers|(units?|eu|n|nm)per"
    r"|slope|steigung|attenu|exponent|prefix|coeff?|koeff|eupv|perunit|pereu|divi[ds]or|teiler"
)
"""Words in the names of factors that turn samples, also decimals, into a unit."""
_NO_FACTOR = re.compile(
    r"full|range|time|zeit|dat(e|um)|due|number|nummer|serial|version|interval|year|valid|crest|decim|oversampl|averag"
    r"|uncertain|error|safety|damp|quality|power|certific|type|mode|(x|nr|no|id|lab)$"
)
"""Words, at the start of which a name is of no such factor."""
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-zäöüé]+|\d+")

_LOAD_UNIT = re.compile(
    r"(?:(?<![A-Za-z0-9/])(?<!\d )|(?<=M[xyz]/)|(?<=F[xyz]/))"
    r"([kMmunµμ]?N(?:[ *·.-]?[cm]?m)?|lbf?[ .*-]?(?:in|ft)|kgf?[ .*-]?c?m)(?![A-Za-z])"
)
"""Unit of a load that stands by itself, as in ``Units: kN m``, or as divisor of its quantity, and not behind a number."""
_VOLTS_PER = re.compile(r"(?<![A-Za-z])[munµμ]?V ?(?:/|per )|(?:/|per ) ?[munµμ]?V(?![A-Za-z])")
_THOUSAND = re.compile(
    r"(?<![\d:/-])(?<!\d[.,])(?:1000|1[.,]?0?[eE][+-]?0?[36]|0[.,]001|10\^-?[36])(?![\d:/-]|[.,]\d)"
)
"""A thousand or a thousandth, which a prefix of a unit stands for."""
_ONE = re.compile(r"\D*[:=;,\t ] *[01](?:[.,]0*)?\W*")
"""A factor that leaves samples as they are."""
_RELATIVE = re.compile(
    r"normali[sz]|normier|anteil|thousand|tausend|promill|per ?mil|prefix|pr(ä|ae)fix|vorsatz"
    r"|\b(?:in|als|as) (?:%|percent|prozent|parts|fractions?)|\d ?[kMmunµμ]?N[ *·.-]?m? ?= ?1(?![\d.,])"
    r"|(?<![\w.])1 ?= ?\d",
    re.IGNORECASE,
)
"""Words that say that samples are parts of something, whatever else the remark is about."""
_KIND = re.compile(
    r"\b(?:data|values?|quantity|type|amplitudes?|samples?|daten|werte?|gr(?:ö|oe)(?:ß|ss)e)\b.*"
    r"\b(?:rms|eff\w*|peak.?(?:to.?)?peak|spitze.?spitze|envelopes?|h(?:ü|ue)llkurven?|differentiated|integrated|spectr(?:um|a))\b",
    re.IGNORECASE,
)
"""Words that say that the numbers are no samples of the quantity itself."""
_PREFIX_IN_NAME = re.compile(
    r"(?:\b|_)(?:kilo|milli|micro|mikro|volts?|log|dB)(?:\b|_)", re.IGNORECASE
)
_SCALES = re.compile(
    r"divi[ds]|teil(er|t)|pre.?amp|coeff|koeff|konstant|constant|umrechn|exponent|fa[ck]t|steigung|slope"
    r"|ratio\b|verh(ä|ae)ltnis|per unit|kilo|milli|multipl|scal(e|ing)|skal|(?<![a-z])dB(?![a-z])",
    re.IGNORECASE,
)
"""Words of a remark that may be about the scale of samples."""
_SCALES_NOTHING = re.compile(
    r"sampl|abtast|point|punkt|block|line|row|record|count|number|anzahl|nummer|channel|kanal|average|mittel|mittl|"
    r"test|run\b|order|ordnung|time|zeit|date|datum|serial|version|speed|drehzahl|rate|range|bereich|span|duration|dauer"
    r"|full|operator|filter|frequen|gear|getriebe|reducer|inertia|damping",
    re.IGNORECASE,
)
"""Words of a remark whose number is of something else."""

_TIMES_OR_BY = (
    r"[*×·÷/]|(?<![A-Za-z])x(?![A-Za-z])|div(?:ided)?(?: ?by)?|geteilt(?: durch)?|times|mal"
)
_POWER_OF_TEN = (
    r"(?:10\^|1?[eE])[+-]?\d|1[.,]?0*[eE][+-]?\d|10+(?![\d.,]\d|\d)|0[.,]0*1(?!\d)|1 ?: ?10+(?!\d)"
)
_FACTOR_IN_NAME = re.compile(
    rf"(?:{_TIMES_OR_BY})[\W_]*(?:{_POWER_OF_TEN})|(?<!\d)(?:{_POWER_OF_TEN})[\W_]*(?:[*×·]|x(?![A-Za-z]))|1 ?: ?10+(?!\d)"
)
"""A power of ten by which a channel's name multiplies or divides what it measures, as Mz/1000 does."""

_NUMBER_OF_FACTOR = re.compile(rf"(?:{_FACTOR.pattern})[a-z]*[\W_]*\d", re.IGNORECASE)
"""A word for a factor and its number, as in Mz gain 100."""


def names_factor(name: str) -> bool:
    """Whether a number of this name may be a factor on samples, whole or not."""
    words = [word.lower() for word in _WORDS.findall(name.rsplit(".", 1)[-1])]
    said = bool(_FACTOR.search("".join(words))) or "cal" in words
    return said and not any(map(_NO_FACTOR.match, words))


def names_scale(name: str) -> bool:
    """Whether a number of this name may be what turns a converter's counts into a unit."""
    words = [word.lower() for word in _WORDS.findall(name.rsplit(".", 1)[-1])]
    whole = "".join(words)
    return bool(_SCALE.search(whole)) or any(_SCALE_STARTS.match(word) for word in (*words, whole))


def scaling_value(value: Any) -> str | float | None:
    """A text with a number in it, or the first of some numbers, that does not leave samples as they are; None
    without one.
    """
    if isinstance(value, str):
        scales = re.search(r"\d", value) and not _NOT_SCALED.fullmatch(value.strip())
        return value if scales else None
    numbers = np.ravel(np.asarray(value))
    if numbers.dtype.kind not in "fiu":
        return None
    other = numbers[(numbers != 0) & (numbers != 1)]
    return float(other[0]) if other.size else None


def factor_in(name: str, value: Any) -> str | float | None:
    """Number or text of this name that may be a factor on samples; None where it is none."""
    found = scaling_value(value) if names_factor(name) else None
    if isinstance(found, str):
        number = QUANTITY.fullmatch(found)
        return found if number is not None and float(number[1]) != 0.0 else None
    return found


def name_may_scale(channel: str) -> bool:
    """Whether a channel's name holds a factor, as ``Mz/1000``, ``Mz x 0.001``, ``Mz gain 100`` and
    ``Mz normalised`` do."""
    about_scale = (_FACTOR_IN_NAME, _NUMBER_OF_FACTOR, _RELATIVE, _PREFIX_IN_NAME)
    return any(each.search(channel) for each in about_scale)


def remark_may_scale(remark: str, units: Sequence[str]) -> bool:
    """Whether a free text beside samples may say that they are to be multiplied, or are in another unit
    than ``units``, those of the file's channels.
    """
    if len(remark) > LONGEST_REMARK:
        return False
    if any(_is_another_unit(unit, units) for unit in _LOAD_UNIT.findall(remark)):
        return True
    if any(each.search(remark) for each in (_VOLTS_PER, _RELATIVE, _KIND)):
        return True
    if _SCALES_NOTHING.search(remark) or _ONE.fullmatch(remark):
        return False
    return bool(_THOUSAND.search(remark) or _SCALES.search(remark))


def _is_another_unit(said: str, units: Sequence[str]) -> bool:
    """Whether a unit is of the kind of some of the channels' ``units``, and none of them."""
    given, own = as_measured(f"1 {said}"), [as_measured(f"1 {unit}") for unit in units]
    alike = [one for one in own if one is not None and given is not None and one[1] == given[1]]
    return bool(alike) and given not in alike
