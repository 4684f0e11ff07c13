// SPDX-License-Identifier: MIT
// The id that the silicon is born with. No registers.
#ifndef IDENTITY_H
#define IDENTITY_H

#include <stdint.h>

// Of 96 bits 64: FNV-1a (Fowler, Noll, Vo) over the twelve bytes, the lowest
// of each word first. Never all zeros, which says that there is no id.
void identity_fold(const uint32_t words[3], uint8_t id[8]);

#endif
