# SPDX-License-Identifier: MIT
"""Which changes tools/mutate.py makes of a file, and which it leaves alone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import mutate

C = """\
// a < b in a comment
#define MORE (1 + 2)
enum { SIZE = 4 };
_Static_assert(SIZE == 4, "x < y");
static int pick(int a, int *b) {
    const char *text = "a == b";
    if (a < *b && text[0] != 'a') {
        *b = a + 1;
    }
    call(a);
    return -a;
}
"""

PYTHON = """\
# a < b
def pick(a: int | None, b: int) -> bool:
    if not a or b < 3:
        return True
    return "a == b"
"""


def changed(tmp_path: Path, name: str, text: str) -> set[tuple[str, str]]:
    path = tmp_path / name
    path.write_text(text)
    found = mutate.mutations(path, Path(name))
    for each in found:
        assert each.after in each.apply(text)
        assert each.apply(text) != text
    return {(each.before, each.after) for each in found}


def test_of_c(tmp_path: Path) -> None:
    line = "if (a < *b && text[0] != 'a') {"
    assert changed(tmp_path, "a.c", C) == {
        (line, line.replace("a <", "a <=")),
        (line, line.replace("&&", "||")),
        (line, line.replace("!=", "==")),
        (line, line.replace("[0]", "[1]")),
        (line, "if (!(a < *b && text[0] != 'a')) {"),
        ("*b = a + 1;", "*b = a - 1;"),
        ("*b = a + 1;", "*b = a + 2;"),
        ("*b = a + 1;", ";"),
        ("call(a);", ";"),
    }


def test_of_python(tmp_path: Path) -> None:
    line = "if not a or b < 3:"
    assert changed(tmp_path, "a.py", PYTHON) == {
        (line, "if  a or b < 3:"),
        (line, line.replace("or", "and")),
        (line, line.replace("<", "<=")),
        (line, line.replace("3", "4")),
        ("return True", "return False"),
    }


def test_tests_of_a_changed_host_run_the_copy_and_not_what_is_installed(
    tmp_path: Path,
) -> None:
    package = tmp_path / "host" / "imud"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("CHANGED = True\n")
    subprocess.run(
        [sys.executable, "-c", "import imud; assert imud.CHANGED"],
        env=os.environ | mutate.host_environment(tmp_path),
        check=True,
    )
