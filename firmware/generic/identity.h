// SPDX-License-Identifier: MIT
// The id that the silicon is born with. No registers.
#ifndef IDENTITY_H
#define IDENTITY_H

#include <stdint.h>

// Eight bytes of a chip's id of any length: FNV-1a (Fowler, Noll, Vo) over its bytes.
// Never all zeros, which says that there is no id.
void identity_fold(const uint8_t *chip_id, uint8_t length, uint8_t id[8]);

#endif
