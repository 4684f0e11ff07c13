// SPDX-License-Identifier: MIT
// The settings at the end of flash.
#ifndef FLASH_H
#define FLASH_H

// Opens the journal: 1 ms, or 6 s at most at the first start and then once in
// thousands.
void flash_init(void);

#endif
