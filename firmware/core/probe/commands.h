// SPDX-License-Identifier: MIT
// Commands of a host: received bytes in, what they ask for done, a reply each.
#ifndef COMMANDS_H
#define COMMANDS_H

#include "core/probe/probe_state.h"

// Takes one byte of what a host sends.
void commands_receive(struct probe *probe, uint8_t byte, uint32_t now_us);

#endif
