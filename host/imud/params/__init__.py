# SPDX-License-Identifier: MIT
"""The params: what turns raw into pose, as one value; docs/params.md."""
