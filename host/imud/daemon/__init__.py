# SPDX-License-Identifier: MIT
"""`imud run`: ports in, sinks out, commands back."""
