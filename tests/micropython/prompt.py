# SPDX-License-Identifier: MIT
"""Runs in MicroPython: a board's raw REPL on standard input and output, written from
its documentation. Ctrl-D at the plain prompt starts the main.py in this folder.
"""

import io
import sys

BUFFER = 256  # of an ESP32
stream = sys.stdin.buffer


def say(text):
    sys.stdout.write(text)


def carry_out(code, names):
    say("OK")
    fault = ""
    try:
        exec(code.replace("sys.implementation", "MACHINE"), names)
    except Exception as error:
        text = io.StringIO()
        sys.print_exception(error, text)
        fault = text.getvalue()
    say(f"\x04{fault}\x04>")


def main():
    import machine

    names = {"MACHINE": machine.Implementation}
    is_raw, code = False, b""
    while True:
        byte = stream.read(1)
        if byte in (b"\x01", b"\x02"):
            is_raw, code = byte == b"\x01", b""
            say("raw REPL; CTRL-B to exit\r\n>" if is_raw else "\r\n>>> ")
        elif byte == b"\x04" and not is_raw:
            break
        elif byte == b"\x04":
            carry_out(code.decode(), names)
            code = b""
        elif byte != b"\x03" and is_raw:
            code += byte
            assert len(code) < BUFFER
    with open("main.py") as file:
        exec(file.read(), {})


main()
