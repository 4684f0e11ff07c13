// SPDX-License-Identifier: MIT
// libunicorn: executes the instructions that thumb.c leaves to it, one at a time.
#ifndef SIM_F405_CORE_ENGINE_H
#define SIM_F405_CORE_ENGINE_H

#include <stdbool.h>
#include <stdint.h>
#include <unicorn/unicorn.h>

struct f405;

// False where libunicorn has no Cortex-M4 or can't map the memory.
bool engine_open(struct f405 *m);
void engine_close(struct f405 *m);
// One instruction at m->pc. True: it is done, and the next may follow. False: ask
// engine_serve_stop() to continue, with the error.
bool engine_step(struct f405 *m, uc_err *error);
// Serves what made libunicorn stop: an exception, a fault or sleep; or ends the run.
void engine_serve_stop(struct f405 *m, uc_err error);

#endif
