# SPDX-License-Identifier: MIT
"""Parts to print: handles for the boards, and gauges that turn them by known angles."""
