// SPDX-License-Identifier: MIT
// The common instructions, executed without libunicorn.
#ifndef SIM_F405_CORE_THUMB_H
#define SIM_F405_CORE_THUMB_H

#include <stdint.h>

struct f405;

// Executes instructions from m->pc on until an event or interrupt is due, a WFI, the
// end of a handler, or an instruction that only libunicorn knows.
enum thumb { THUMB_STOPPED, THUMB_UNKNOWN, THUMB_ASLEEP, THUMB_RETURNS };
enum thumb thumb_run(struct f405 *m);
// The state of an IT block after one of its instructions.
uint8_t thumb_advance(uint8_t it);

#endif
