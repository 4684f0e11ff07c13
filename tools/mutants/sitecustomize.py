# SPDX-License-Identifier: MIT
"""Python runs this at its start where this folder is in PYTHONPATH. Without the finder
of the editable installation it loads the package that is in PYTHONPATH, too: a changed
copy, not the sources that are installed.
"""

import sys

sys.meta_path[:] = [
    finder for finder in sys.meta_path if "ScikitBuild" not in type(finder).__name__
]
