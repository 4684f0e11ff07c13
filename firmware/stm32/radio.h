// SPDX-License-Identifier: MIT
// The other end of the wire, a cable or an RN-41, and the functions of
// board.h that send and receive.
//
// For who calls: radio_init() once USART2 and its pins have their clocks, then
// radio_step() every 5 ms, whose event says what to do.
// - RN41_LINKED: board_send() says yes from now on, and nothing has been sent: the
// first
//   message is to be a hello, at once, then the event radio_connected.
// - RN41_DROPPED: radio_dropped, for the next host that connects, and for the card.
// - RN41_FAULT: radio_fault with radio_cause(). Tries continue, without more events,
// until
//   there is RN41_LINKED or radio_state() says that it waits.
// Over a cable there is no event: board_send() says yes from reset on. A module looks
// like one while it starts, a second or so, as its pin floats: what is sent then
// reaches nobody.
//
// A module from the factory runs at another rate until it has been set up: a host that
// keeps connecting to it meanwhile, within two seconds of each start, keeps it from
// that.
#ifndef RADIO_H
#define RADIO_H

#include <stdint.h>

#include "core/drivers/rn41.h"
#include "core/wire/messages.h"

void radio_init(void);
enum rn41_event radio_step(uint32_t now_us);

// For the message `equipment`.
enum radio radio_state(void);
uint16_t radio_resets(void);

// Why it was given up.
enum cause radio_cause(void);

#endif
