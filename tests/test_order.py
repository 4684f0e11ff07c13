# SPDX-License-Identifier: MIT
"""Which process gets which tests: each test once, where it may run."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import order
from order import Units, loads_c

NATIVE = [f"core.py::{n}" for n in range(30)]
OTHERS = [f"host.py::{n}" for n in range(50)]


class Node:
    """A process of xdist: keeps what it is given."""

    def __init__(self, tests: str) -> None:
        python = f"env IMU_TESTS={tests} python" if tests else None
        spec = SimpleNamespace(python=python)
        self.gateway = SimpleNamespace(spec=spec, id=tests)
        self.shutting_down = False
        self.waiting: list[int] = []

    def send_runtest_some(self, indices: list[int]) -> None:
        assert not self.shutting_down
        self.waiting += indices

    def shutdown(self) -> None:
        self.shutting_down = True


def units(count: int) -> Units:
    def log(*_: object) -> None: ...

    log.loadscopesched = log  # type: ignore[attr-defined]
    config: Any = SimpleNamespace(
        getvalue=lambda _: ["popen"] * count,
        option=SimpleNamespace(loadscopereorder=True),
    )
    return Units(config, log)


def begin(scheduler: Units, node: Node, tests: list[str]) -> None:
    """What xdist does when a process has collected."""
    scheduler.add_node_collection(node, tests)
    if scheduler.collection_is_completed:
        scheduler.schedule()


def work(scheduler: Units, node: Node) -> str | None:
    """Runs the first test of a process, which keeps one unless it is to end."""
    if len(node.waiting) < 1 + (not node.shutting_down):
        return None
    index = node.waiting.pop(0)
    scheduler.mark_test_complete(node, index)
    test: str = scheduler.registered_collections[node][index]
    return test


def finish(scheduler: Units, nodes: list[Node]) -> dict[str, list[str]]:
    """Runs all that is left; what each kind of process has run."""
    done: dict[str, list[str]] = {node.gateway.id: [] for node in nodes}
    is_busy = True
    while is_busy:
        is_busy = False
        for node in nodes:
            test = work(scheduler, node)
            if test is not None:
                is_busy = True
                done[node.gateway.id].append(test)
            elif node.shutting_down and node in scheduler.nodes:
                assert scheduler.remove_node(node) is None
    assert scheduler.tests_finished
    return done


@pytest.fixture(autouse=True)
def means(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(order, "seconds_of_files", lambda: {"host.py": 0.3})


def test_each_test_is_run_once_by_a_process_that_collected_it() -> None:
    scheduler = units(4)
    nodes = [Node("native"), Node("native"), Node("others"), Node("others")]
    for node in nodes:
        scheduler.add_node(node)
    for node in nodes:
        begin(scheduler, node, NATIVE if node.gateway.id == "native" else OTHERS)
    done = finish(scheduler, nodes)
    assert sorted(done["native"]) == sorted(NATIVE)
    assert sorted(done["others"]) == sorted(OTHERS)
    assert all(node.shutting_down and not node.waiting for node in nodes)


def test_who_has_collected_begins_while_others_compile() -> None:
    scheduler = units(2)
    late, early = Node("native"), Node("others")
    for node in (late, early):
        scheduler.add_node(node)
    begin(scheduler, early, OTHERS)
    assert work(scheduler, early) == OTHERS[0]
    while work(scheduler, early) is not None:
        pass
    assert not scheduler.tests_finished
    begin(scheduler, late, NATIVE)
    assert sorted(finish(scheduler, [late])["native"]) == sorted(NATIVE)


def test_a_unit_is_a_second_of_neighbours() -> None:
    scheduler = units(1)
    node = Node("")
    scheduler.add_node(node)
    begin(scheduler, node, OTHERS[:10])
    # Tests of 0.3 s, begun at 0, 0.3, 0.6 and 0.9 s.
    assert node.waiting == [0, 1, 2, 3]


def test_tests_that_build_on_each_other_are_one_unit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(order, "ROOT", tmp_path)
    (tmp_path / "host.py").write_text("pytestmark = pytest.mark.together")
    scheduler = units(1)
    node = Node("")
    scheduler.add_node(node)
    begin(scheduler, node, OTHERS)
    assert node.waiting == list(range(len(OTHERS)))


def test_a_test_that_ends_its_process_is_not_run_again_and_the_rest_is() -> None:
    scheduler = units(2)
    first, second, third = (Node("others") for _ in range(3))
    for node in (first, second):
        scheduler.add_node(node)
        begin(scheduler, node, OTHERS)
    assert [work(scheduler, first) for _ in range(2)] == OTHERS[:2]
    assert scheduler.remove_node(first) == OTHERS[2]
    scheduler.add_node(third)
    begin(scheduler, third, OTHERS)
    done = finish(scheduler, [second, third])["others"]
    assert sorted(done) == sorted(OTHERS[3:])


def test_a_process_with_nothing_to_collect_ends() -> None:
    scheduler = units(2)
    idle, busy = Node("native"), Node("others")
    for node in (idle, busy):
        scheduler.add_node(node)
    begin(scheduler, idle, [])
    begin(scheduler, busy, OTHERS)
    assert idle.shutting_down
    assert sorted(finish(scheduler, [busy])["others"]) == sorted(OTHERS)


def test_a_file_loads_c_itself_or_by_what_it_imports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(order, "TESTS", tmp_path)
    (tmp_path / "core").mkdir()
    for name, text in {
        "core/desk.py": "import native\nffi, lib = native.load()\n",
        "core/scene.py": "from core import desk\n",
        "test_a.py": "from core.scene import (\n    earth,\n)\n",
        "test_b.py": "from native import WARNINGS\n",
        "native.py": "def load(): ...\n",
    }.items():
        (tmp_path / name).write_text(text)
    names = ("core/desk.py", "core/scene.py", "test_a.py", "test_b.py")
    assert [loads_c(tmp_path / name) for name in names] == [True, True, True, False]
