// SPDX-License-Identifier: MIT
// The part of the standard header that core/ and the compiler ask for, so that the
// image needs no C library; string.c has the functions.
#ifndef STRING_H
#define STRING_H

#include <stddef.h>

void *memcpy(void *restrict to, const void *restrict from, size_t length);
void *memmove(void *to, const void *from, size_t length);
void *memset(void *to, int value, size_t length);
int memcmp(const void *one, const void *other, size_t length);

#endif
