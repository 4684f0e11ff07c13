// SPDX-License-Identifier: MIT
// What py/modsys.c asks of extmod/, which the package of sources lacks.
#define MICROPY_PLATFORM_VERSION ""
