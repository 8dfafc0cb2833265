"""The package's text stays readable: what a person has to carry in mind at a line is bounded."""

import pytest
from support.house import modules

MODULES = modules()


@pytest.mark.parametrize("module", MODULES, ids=lambda module: str(module.path.name))
def test_a_module_reads_plainly(module):
    assert module.is_compiled or not list(module.nested_conditionals()), "write an if block"
    assert not list(module.private_imports()), "give it a name without an underscore"
    assert not list(module.banned_words())


def test_lines_say_one_thing():
    lines = sum(module.code_lines for module in MODULES)
    assert sum(module.nodes for module in MODULES) < 10.5 * lines
    assert sum(module.conditional_expressions for module in MODULES) < 0.020 * lines
