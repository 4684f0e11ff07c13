# SPDX-License-Identifier: MIT
"""Where what probes say goes to. A sink knows its library and the record, no more."""
