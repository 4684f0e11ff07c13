# SPDX-License-Identifier: MIT
"""Makes a probe stream and its heading 0: command.py [ENDPOINT]."""

import sys

from imud.client import Client
from imud.errors import ImudError

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"
try:
    with Client(endpoint) as client:
        probe = client.only_probe()
        client.command(probe, "start")
        client.command(probe, "tare", what="heading")
        print(f"{probe} streams from here on")
except ImudError as error:
    sys.exit(f"command.py: {error}")
