# SPDX-License-Identifier: MIT
"""Forks a Python program for each request of forked.py. Run with the number of the
socket that requests come from; ends when that is closed.
"""

import gc
import json
import os
import runpy
import signal
import socket
import sys
import traceback

# What most programs of tests import, and takes its time.
import imud.cli
import imud.client
import imud.daemon.daemon
import imud.recordings.record
import imud.virtual.sim  # noqa: F401


def run(arguments: list[str]) -> int:
    """What `python -P` with these arguments does; returns its exit code."""
    option, what, *rest = arguments
    sys.orig_argv = [sys.executable, "-P", *arguments]
    sys.argv = [option if option == "-c" else what, *rest]
    try:
        if option == "-c":
            exec(what, {"__name__": "__main__"})  # noqa: S102 - as Python does
        else:
            runpy.run_module(what, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:  # noqa: BLE001 - as Python does
        traceback.print_exc()
        return 1
    return 0


def start(message: bytes, streams: list[int]) -> None:
    """In a child of the starter: start the program, wait for it, and write its number
    and then its status to the last of the streams.
    """
    wanted = json.loads(message)
    end = streams.pop()
    if program := os.fork():
        for stream in (*streams, *range(3)):
            os.close(stream)
        os.write(end, f"{program}\n".encode())
        os.write(end, b"%d" % os.waitpid(program, 0)[1])
        return
    os.close(end)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    os.chdir(wanted["cwd"])
    os.environ.clear()
    os.environ.update(wanted["env"])
    code = run(wanted["arguments"])
    for buffer in (sys.stdout, sys.stderr):
        buffer.flush()
    os._exit(code)


def main() -> None:
    requests = socket.socket(fileno=int(sys.argv[1]))
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for a child of it
    gc.freeze()
    while True:
        message, streams, _, _ = socket.recv_fds(requests, 1 << 20, 4)
        if not message:
            return
        if os.fork() == 0:
            requests.close()
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            start(message, streams)
            os._exit(0)
        for stream in streams:
            os.close(stream)


if __name__ == "__main__":
    main()
