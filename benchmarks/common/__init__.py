# SPDX-License-Identifier: MIT
"""What several rooms use: boards, samples, filters, errors, captures."""
