"""The package's text stays readable: what a person has to carry in mind at a line is bounded."""

import inspect
import re

import pytest
from support.front import PUBLIC
from support.house import modules

MODULES = modules()


@pytest.mark.parametrize("module", MODULES, ids=lambda module: str(module.path.name))
def test_a_module_reads_plainly(module):
    assert module.is_compiled or not list(module.nested_conditionals()), "write an if block"
    assert not list(module.private_imports()), "give it a name without an underscore"
    assert not list(module.banned_words())
    assert not list(module.vague_docstrings()), "begin with a noun or a verb"


def test_lines_say_one_thing():
    lines = sum(module.code_lines for module in MODULES)
    assert sum(module.nodes for module in MODULES) < 10.5 * lines
    assert sum(module.conditional_expressions for module in MODULES) < 0.020 * lines


DATA_CLASSES = {"LineTable", "Motion", "Scenario"}
"""Classes that functions make: their fields say what they hold."""


def section(text, title):
    """Lines of a section of a NumPy-style docstring; none where it is not there."""
    found = re.search(rf"^{title}\n-+\n(.*?)(?=^\w[^\n]*\n-+\n|\Z)", text, re.MULTILINE | re.DOTALL)
    return [] if found is None else found[1].splitlines()


@pytest.mark.parametrize("name", [name for name in PUBLIC if name not in DATA_CLASSES])
def test_what_is_public_says_what_it_takes_and_gives(name):
    function = PUBLIC[name]
    text = inspect.getdoc(function)
    documented = set()
    for line in section(text, "Parameters"):
        if line and not line.startswith(" "):
            assert " : " in line or name in ("compare", "identify"), line
            documented |= {one.strip().lstrip("*") for one in line.split(" : ")[0].split(",")}
    taken = set(inspect.signature(function).parameters) - {"self", "cls"}
    assert documented == taken
    if not inspect.isclass(function):
        assert section(text, "Returns") or section(text, "Yields")
    first = text.split("\n\n")[0]
    assert first.endswith(".")
    assert not re.match(r"(What|Of|The same)\b", first)


def test_functions_are_not_hard_to_read():
    """Both bounds only ever fall; `python benchmarks/house.py` lists the functions."""
    plain = [module for module in MODULES if not module.is_compiled]
    hard = [each for module in plain for each in module.complexities() if each.value > 12]
    assert not [str(each) for each in hard if each.value > 22]
    assert len(hard) < 79
