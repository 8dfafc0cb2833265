"""Files of published tests: of states, or of cases."""

from __future__ import annotations

from microvib.errors import ScenarioError
from microvib.io.file_access import WORKING_FOLDER
from microvib.io.named import named_text, test_names
from microvib.io.yaml_text import parse_yaml
from microvib.model.sentences import validate_part
from microvib.validation.cases_file import CasesTest
from microvib.validation.published import PublishedTest


def load_published(name: str) -> PublishedTest | CasesTest:
    """A published test of the catalog, or of a YAML file: one with ``states`` of a drive with an
    array, or one with ``cases``.

    Raises MicrovibError with one sentence per problem.
    """
    text = named_text(name, WORKING_FOLDER, kind="test", published=test_names(), within="tests/")
    data = parse_yaml(text, name)
    if not isinstance(data, dict) or not ({"states", "cases"} & set(data)):
        raise ScenarioError(
            f"{name}: has neither cases nor states; a published test has title, citation, measured,"
            " scenario, cases, metrics and compare"
        )
    if "states" in data:
        return validate_part(PublishedTest, data, origin=name)
    return validate_part(CasesTest, data, origin=name)
