// SPDX-License-Identifier: MIT
// The part of extmod/ that py/modsys.c needs, which the package of sources lacks.
#define MICROPY_PLATFORM_VERSION ""
