# SPDX-License-Identifier: MIT
"""Commands on recordings: decode, export, info, recover, replay."""
