# SPDX-License-Identifier: MIT
"""Work on messages: a message in, records or wishes out. No I/O."""
