// SPDX-License-Identifier: MIT
// A walk of a sensor that exists nowhere, through the core, to one number: the same on
// every processor.
#ifndef BITS_H
#define BITS_H

#include <stdint.h>

void bits_begin(int32_t filter);
// One sample, at rest until the calibration at start-up is through.
void bits_step(void);
// FNV-1a over all poses so far.
uint32_t bits_digest(void);

#endif
