#!/bin/sh
# SPDX-License-Identifier: MIT
# The virtual Pico; its parts lie beside this file (sim/Makefile).
exec node "$(dirname "$(readlink -f "$0")")/pico.mjs" "$@"
