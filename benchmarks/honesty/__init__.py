# SPDX-License-Identifier: MIT
"""Whether the errors that poses state of themselves are true, and inform."""
