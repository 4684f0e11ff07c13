# SPDX-License-Identifier: MIT
"""The browser that shows the page to tests."""

from __future__ import annotations

import shutil

# The one without windows starts in half the processor time.
CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium")
