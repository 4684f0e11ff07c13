# SPDX-License-Identifier: MIT
"""The order of functions in the Nano's image."""

from __future__ import annotations

import numpy as np

from benchmarks.firmware import function_order as order

LINKED = """Linker script and memory map

 .text          0x00000068        0x2 crtatmega328p.o
 .text.near     0x0000006a       0x10 a.o
 .text.startup.main
                0x0000007a       0x20 main.o
 .text.big.part.0
                0x0000009a     0x1000 a.o
 .text.big      0x0000109a       0x10 a.o
 .text.libgcc.prologue
                0x000010aa       0x38 /usr/lib/libgcc.a(_prologue.o)
"""
DISASSEMBLED = """
0000006a <near>:
      6a:\t0e 94 4d 08 \tcall\t0x109a\t; 0x109a <big>
      7a:\tf7 df       \trcall\t.-18     \t; 0x6a <near>
     109a:\t0c 94 55 08 \tjmp\t0x10aa\t; 0x10aa <__prologue_saves__>
     109e:\t02 d8       \trcall\t.-4092   \t; 0xa4 <big>
     10a0:\t09 95       \ticall
"""


def test_a_map_and_a_disassembly_give_functions_and_calls_between_them() -> None:
    image = order.parse(LINKED, DISASSEMBLED)
    assert image.sizes == {
        "near": 0x10,
        "main": 0x20,
        "big": 0x1010,
        "lib:_prologue": 0x38,
    }
    assert image.calls == [
        ("near", 0, "big", 0x1000),
        ("main", 0, "near", 0),
        ("big", 0x1000, "lib:_prologue", 0),
    ]


def test_functions_that_call_each_other_are_put_together() -> None:
    sizes = {f"f{number}": 1500 for number in range(12)}
    calls = [(f"f{number}", 0, f"f{11 - number}", 0) for number in range(6)]
    image = order.Image(sizes, calls * 3)
    names = order.names_of([image])
    costs = order.Costs(image, names)
    assert costs.long(np.arange(12)) == 3 * 5
    found = order.anneal([image], names, turns=3000)
    assert sorted(found) == sorted(names)
    assert costs.long(np.array([names.index(name) for name in found])) == 0


def test_the_list_is_written_between_the_comments_of_the_linker_script() -> None:
    script = order.SCRIPT.read_text(encoding="utf-8")
    written = order.with_list(script, ["near", "lib:_prologue"])
    assert written.startswith(script[: script.index(order.BEGIN)])
    assert written.endswith(script[script.index(order.END) :])
    lines = written.partition(order.BEGIN)[2].partition(order.END)[0].split("\n")
    found = [line.strip() for line in lines if line.strip()]
    assert found == ["*(.text.near .text.near.*)", "*lib*.a:_prologue.o(.text .text.*)"]
