"""Command lines of the two days run as they are printed, and say what is quoted of them."""

from __future__ import annotations

import re

import pytest
from support.days import EXAMPLES, ROOT, begun, blocks, run


def plain(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.release
@pytest.mark.parametrize("page", ["docs/howto/test-day.md", "docs/howto/systems-evening.md"])
def test_every_command_says_what_is_quoted(page, tmp_path):
    begun(page, tmp_path)
    printed = list(blocks(page))
    for kind, name, text in printed:
        if kind == "file":
            (tmp_path / name).write_text(text)
    for kind, line, quoted in printed:
        if kind == "command":
            said = plain(run(line, tmp_path))
            for words in filter(None, map(plain, quoted.splitlines())):
                assert words in said, (line, words)


@pytest.mark.parametrize("page", EXAMPLES)
def test_a_day_has_twelve_tasks_with_all_parts(page):
    text = (ROOT / page).read_text("utf-8")
    tasks = re.split(r"^## (?=[1-9])", text.partition("\n## What this")[0], flags=re.M)[1:]
    assert [task.partition(".")[0] for task in tasks] == [str(k) for k in range(1, 13)]
    for task in tasks:
        for part in ("*What for:*", "*On the page", "*On the command line:*", "*Elsewhere:*"):
            assert part in task, (task.splitlines()[0], part)
