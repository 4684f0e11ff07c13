# SPDX-License-Identifier: MIT
"""Runs PyPI's SCons in place of the package that PlatformIO would download.

PlatformIO starts this file with its own Python, so SCons must be installed there.
"""

import sys

sys.path.pop(0)  # this folder, where `import scons` would find this very file

try:
    import SCons.Script
except ImportError:
    sys.exit(f"SCons is missing: {sys.executable} -m pip install scons==4.11.1")

SCons.Script.main()
