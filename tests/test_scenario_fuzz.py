"""Mutated scenarios: each is read, or refused with a sentence; what is read is what was written, and runs to finite numbers.

``MICROVIB_FUZZ=3000 python -m pytest tests/test_scenario_fuzz.py`` tries as many; every tenth legal one is run.
"""

import copy
import math
import os
import random
import time

import numpy as np
import pytest

import microvib as mv
from microvib.io.named import catalog_text
from microvib.io.scenario_file import scenario_of
from microvib.io.yaml_text import parse_yaml
from microvib.model.part import to_plain_data

pytestmark = pytest.mark.long
COUNT = int(os.environ.get("MICROVIB_FUZZ", "150"))
LONGEST = 20.0  # s
NAMES = (*mv.catalog_names(), "new")
TEXTS = [catalog_text(name) for name in NAMES]
UNITS = {
    "N*m": [("Nm", 1.0), ("mNm", 1e-3), ("N mm", 1e-3), ("Ncm", 1e-2)],
    "kg*m^2": [("kgm2", 1.0), ("gcm2", 1e-7), ("kg·cm²", 1e-4), ("g m²", 1e-3)],
    "rad/s": [
        ("deg/s", math.pi / 180),
        ("°/s", math.pi / 180),
        ("rpm", math.pi / 30),
        ("mrad/s", 1e-3),
    ],
    "Hz": [("Hz", 1.0), ("kHz", 1e3), ("mHz", 1e-3)],
    "A": [("A", 1.0), ("mA", 1e-3)],
    "s": [("s", 1.0), ("ms", 1e-3), ("min", 60.0)],
    "N*m/rad": [("Nm/rad", 1.0), ("Nm/deg", 180 / math.pi), ("kN m", 1e3)],
    "N*m*s/rad": [("Nms/rad", 1.0), ("mNms", 1e-3)],
    "ohm": [("Ω", 1.0), ("kohm", 1e3)],
    "H": [("mH", 1e-3), ("µH", 1e-6)],
    "": [("", 1.0), ("%", 0.01)],
}
JUNK = [
    None, True, "", " ", "rigid", "null", "nan", ".nan", math.nan, math.inf, -math.inf, 0, -1, 1e308, 5e-324, 10**400, 10**5000,
    "1e999 A", "1e-999 A", "1" * 150, "x" * 500_0, "1 A^9^9^9", "1,5 A", "− 3 N m", "3\u00a0°/s", "\0", "{}", [], {}, [[]], [1] * 50,
    {"a": {"b": {}}}, ["0.1 A"], "1 banana", "5 dB", "0x1F A", "1_000 A", "1 A; 2 A", 2**63, -(2**63), 1.5, "2 m", "deg", (1, 2),
]  # fmt: skip
PIECES = ["[", "]", "{", "}", ":", "- ", "\t", "\n", "&a ", "*a", "!!python/x ", "<<: ", "'", '"', "#", "\ufeff", "\0", "é", "---\n", "? ", "| ",
          "[" * 200, "  " * 50, "1e400", "9" * 400, "null", "%", "\x85", "\u2028"]  # fmt: skip


def leaves(data, path=()):
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        yield (*path, key)
        if isinstance(value, (dict, list)):
            yield from leaves(value, (*path, key))


def mutated_data(r: random.Random):
    """Data of a scenario with one to three changes of keys, values, structure."""
    data = parse_yaml(r.choice(TEXTS), "base")
    for _ in range(r.randint(1, 3)):
        *way, last = r.choice(list(leaves(data)))
        node = data
        for step in way:
            node = node[step]
        kind = r.randrange(6)
        if kind == 0:
            del node[last]
        elif kind == 1 and isinstance(node, dict):
            node[f"{last}{r.choice(['x', '', '_', ' ', '.', '*'])}"] = node.pop(last)
        elif kind == 2:
            node[last] = [copy.deepcopy(node[last])] * r.randint(0, 3)
        elif kind == 3:
            other = r.choice(list(leaves(data)))
            node[last] = copy.deepcopy(data[other[0]])
        elif (
            kind == 4
            and isinstance(node[last], str)
            and node[last].split()[0].replace(".", "").isdigit()
        ):
            number, *unit = node[last].split()
            node[last] = f"{float(number) * 10.0 ** r.randint(-6, 6)!r} {' '.join(unit)}"
        else:
            node[last] = r.choice(JUNK)
    return data


def mutated_text(r: random.Random) -> str:
    text = r.choice(TEXTS)
    for _ in range(r.randint(1, 4)):
        k, n = r.randrange(len(text)), r.randint(1, 40)
        piece = r.choice([r.choice(PIECES), text[k : k + n], chr(r.randrange(32, 0x2FF)), ""])
        text = text[:k] + piece + text[k + r.choice([0, 1, n]) :]
    return text


def tried(make, *arguments):
    """What is made, or None where it is refused with a sentence; in time."""
    begun, made, sentence = time.monotonic(), None, "made"
    try:
        made = make(*arguments)
    except mv.MicrovibError as error:
        sentence = str(error).strip()
    assert sentence
    assert len(sentence) < 8000
    assert time.monotonic() - begun < LONGEST
    return made


def read(text_or_data, seed: int) -> mv.Scenario:
    name = f"seed {seed}"
    data = parse_yaml(text_or_data, name) if isinstance(text_or_data, str) else text_or_data
    return scenario_of(data, name)


def run(scenario: mv.Scenario) -> mv.Motion:
    """A short run, whose figures are finite."""
    short = scenario.with_(
        {"record.settle": "0.05 s", "record.duration": "0.25 s", "record.sample_rate": "1024 Hz"}
    )
    motion = mv.simulate(short)
    assert all(np.isfinite(values).all() for values in motion.channels.values())
    assert all(np.isfinite(line.expected) for line in mv.find_lines(motion))
    return motion


@pytest.mark.parametrize("block", range(3))
def test_mutated_scenarios_are_read_or_refused(block):
    legal = []
    for seed in range(block, COUNT, 3):
        r = random.Random(seed)
        scenario = tried(read, mutated_data(r) if r.random() < 0.6 else mutated_text(r), seed)
        if scenario is not None:
            assert read(mv.dump_scenario(scenario), seed) == scenario, seed
            legal.append(scenario)
    ran = [tried(run, scenario) for scenario in legal[::10]]
    assert any(motion is not None for motion in ran)


def written_numbers():
    """Keys of the catalog's quantities for whose units other ways of writing are known."""
    for name in mv.catalog_names():
        for key, value, quantity in mv.load_scenario(name).entries():
            if quantity is not None and isinstance(value, float) and quantity.unit in UNITS:
                yield name, key, quantity


WRITTEN = list(written_numbers())


def test_no_number_is_changed_in_silence():
    read_back = 0
    for seed in range(COUNT):
        r = random.Random(seed)
        name, key, quantity = r.choice(WRITTEN)
        number = r.choice(
            [
                f"{r.uniform(0, 10):.6g}",
                f"{10 ** r.uniform(-9, 9):.4e}",
                str(r.randint(0, 10**6)),
                f"-{r.random()}",
            ]
        )
        unit, factor = r.choice(UNITS[quantity.unit])
        text = f"{number}{r.choice(['', ' ', chr(160)])}{unit}".strip()
        scenario = tried(mv.load_scenario, name, {key: text})
        if scenario is not None:
            read_back += 1
            value = next(value for entry, value, _ in scenario.entries() if entry == key)
            assert value == pytest.approx(float(number) * factor, rel=1e-12), (key, text)
            others = [(k, v) for k, v, _ in scenario.entries() if k != key]
            assert others == [(k, v) for k, v, _ in mv.load_scenario(name).entries() if k != key]
    assert read_back > COUNT // 10


def test_mutations_change_something():
    assert sum(mutated_text(random.Random(seed)) in TEXTS for seed in range(50)) < 5
    whole = [to_plain_data(mv.load_scenario(name), text=True) for name in mv.catalog_names()]
    assert not any(mutated_data(random.Random(seed)) in whole for seed in range(20))
