# SPDX-License-Identifier: MIT
"""Where a daemon is and what its keys begin with, unless told otherwise."""

PORT = 7447  # Zenoh's own
ENDPOINT = f"tcp/127.0.0.1:{PORT}"  # this machine alone
PREFIX = "imud"
PAGE = "127.0.0.1:8735"  # the page for browsers
FOXGLOVE = "127.0.0.1:8765"  # the port that Foxglove offers
OPENIGTLINK = "127.0.0.1:18944"  # the port that 3D Slicer and PLUS use
# Where imud bridge sends to, each on its field's usual port.
OSC, VMC = "127.0.0.1:9000", "127.0.0.1:39539"
MQTT, MAVLINK = "127.0.0.1:1883", "127.0.0.1:14550"

# Params that came into force; under XDG_STATE_HOME where that is set.
STATE = "~/.local/state"
HISTORY = f"{STATE}/imud/params"

# More probes come from a device, or a log, that makes up ids: 64 at 200 Hz fill a core.
PROBES_MAX = 256
