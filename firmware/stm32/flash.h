// SPDX-License-Identifier: MIT
// The settings in the last two sectors of flash.
#ifndef FLASH_H
#define FLASH_H

// Opens the journal: 2 ms, or 2 s at the first start and then once in thousands.
void flash_init(void);

#endif
