// SPDX-License-Identifier: MIT
// The start of the boot ROM as the RP2040 data sheet has it ("Bootrom contents"): the
// vectors, `M u 1` and a version, then where the tables and their reader are, 16 bits
// each. The tables are pairs of a code of two letters and an address.
.syntax unified
.thumb
.cpu cortex-m0plus

.macro entry a, b, at
    .hword \a | \b << 8
    .hword \at
.endm

.section .head, "a"
.word 0x20041f00
.word halt + 1, halt + 1, halt + 1
.byte 'M', 'u', 1, 3
.hword functions, data, lookup + 1
.hword 0
.balign 4
functions:
    entry 'M', 'C', rom_copy + 1
    entry 'M', 'S', rom_set + 1
    entry 'C', '4', rom_copy + 1
    entry 'S', '4', rom_set + 1
    entry 'P', '3', rom_popcount + 1
    entry 'L', '3', rom_clz + 1
    entry 'T', '3', rom_ctz + 1
    entry 'R', '3', rom_reverse + 1
    entry 'I', 'F', rom_nothing + 1
    entry 'E', 'X', rom_nothing + 1
    entry 'F', 'C', rom_nothing + 1
    entry 'C', 'X', rom_nothing + 1
    entry 'R', 'E', rom_erase + 1
    entry 'R', 'P', rom_program + 1
    entry 'U', 'B', rom_usb_boot + 1
    .hword 0, 0
.balign 4
data:
    entry 'S', 'F', floats + 4
    .hword 0, 0

.text
.thumb_func
.global halt
halt:
    wfi
    b halt
