// SPDX-License-Identifier: MIT
// Constants take RAM on the AVR where nothing says that they stay in flash (ISO/IEC TR
// 18037, 5.1: named address spaces).
#ifndef IN_FLASH_H
#define IN_FLASH_H

#ifdef __FLASH
#define IN_FLASH __flash
#else
#define IN_FLASH
#endif

#endif
