// SPDX-License-Identifier: MIT
// The link to the host: it comes and goes, packets over the air, data mode, flow
// control.
#include "chip.h"

#define AIR_NS (5 * MS / 2)

enum {
    PACKET = 75,  // bytes in AIR_NS: 240 kbit/s
    RTS_HIGH = BUFFER * 3 / 4,
    RTS_LOW = BUFFER / 2,
};

void rn41_chip_follow_rts(struct rn41_chip *chip) {
    if (chip->to_air.count >= RTS_HIGH) {
        chip->is_full = true;
    } else if (chip->to_air.count <= RTS_LOW) {
        chip->is_full = false;
    }
}

void rn41_chip_break_link(struct rn41_chip *chip) {
    if (!chip->is_linked) {
        return;
    }
    chip->is_linked = false;
    chip->counters.lost_to_host += chip->to_air.count;
    chip->counters.lost_from_host += chip->from_host.count;
    chip->to_air.count = chip->from_host.count = 0;
    chip->air_at = chip->host_escape_at = NEVER;
    rn41_chip_follow_rts(chip);
    rn41_chip_send_status(chip, "DISCONNECT");
}

void rn41_chip_follow_link(struct rn41_chip *chip) {
    if (!chip->is_ready) {
        return;
    }
    const bool is_dropped = rn41_chip_suffers(chip, RN41_CHIP_DROP);
    if (chip->is_linked && is_dropped) {
        rn41_chip_break_link(chip);
        chip->link_from = chip->now;
    }
    const unsigned mode = chip->used.mode;
    const bool is_slave = mode == 0 || mode == MODE_DTR || mode == MODE_PAIR;
    if (!chip->is_linked && !is_dropped && !rn41_chip_suffers(chip, RN41_CHIP_AWAY) &&
        is_slave && chip->now >= chip->link_from) {
        chip->is_linked = true;
        chip->counters.links++;
        rn41_chip_send_status(chip, "CONNECT,0123456789AB,0");
    }
}

void rn41_chip_use_air(struct rn41_chip *chip) {
    if (chip->air_at == NEVER &&
        (chip->to_air.count > 0 || chip->from_host.count > 0)) {
        chip->air_at = chip->now + AIR_NS;
    }
}

void rn41_chip_exchange_packets(struct rn41_chip *chip) {
    uint8_t byte = 0;
    chip->air_at = NEVER;
    for (unsigned i = 0; i < PACKET && ring_take(&chip->to_air, &byte); i++) {
        (void)ring_put(&chip->host_out, byte);
        chip->counters.to_host++;
    }
    for (unsigned i = 0; i < PACKET; i++) {
        if (chip->to_uart.count == chip->to_uart.room ||
            !ring_take(&chip->from_host, &byte)) {
            break;
        }
        if (chip->is_command) {
            chip->counters.lost_from_host++;
        } else {
            (void)ring_put(&chip->to_uart, byte);
            chip->counters.from_host++;
        }
    }
    rn41_chip_follow_rts(chip);
    rn41_chip_begin_sending(chip);
    rn41_chip_use_air(chip);
}

bool rn41_chip_lets_in(const struct rn41_chip *chip, unsigned side) {
    const unsigned timer = chip->used.timer;
    if (timer >= 1 && timer < TIMER_LOCAL) {
        return chip->now - chip->up_at < timer * SECOND;
    }
    return timer == side || timer == TIMER_BOTH;
}

static void pass_on(struct rn41_chip *chip, uint8_t byte) {
    if (!chip->is_linked || !ring_put(&chip->to_air, byte)) {
        chip->counters.lost_to_host++;
        return;
    }
    rn41_chip_follow_rts(chip);
    rn41_chip_use_air(chip);
}

static void pass_held(struct rn41_chip *chip) {
    for (; chip->held > 0; chip->held--) {
        pass_on(chip, (uint8_t)chip->used.character);
    }
    chip->escape_at = NEVER;
}

void rn41_chip_hear_data(struct rn41_chip *chip, uint8_t byte) {
    const bool was_quiet =
        chip->heard_at == NEVER || chip->now - chip->heard_at >= SECOND;
    chip->heard_at = chip->now;
    const bool is_character =
        byte == (uint8_t)chip->used.character &&
        (!chip->is_linked || rn41_chip_lets_in(chip, TIMER_LOCAL));
    if (!is_character || chip->held == 3 || (chip->held == 0 && !was_quiet)) {
        pass_held(chip);
        pass_on(chip, byte);
        return;
    }
    if (chip->held == 0) {
        chip->held_at = chip->now;
    }
    chip->held++;
    chip->escape_at =
        chip->held == 3 ? chip->now + chip->config.command_ns : chip->held_at + SECOND;
}

void rn41_chip_end_escape(struct rn41_chip *chip) {
    if (chip->held < 3) {
        pass_held(chip);
        return;
    }
    chip->held = 0;
    chip->escape_at = NEVER;
    chip->is_command = true;
    chip->length = 0;
    rn41_chip_send_text(chip, "CMD\r\n");
}

size_t rn41_chip_host_room(const struct rn41_chip *chip) {
    return chip->is_linked ? chip->from_host.room - chip->from_host.count : 0;
}

void rn41_chip_host_write(struct rn41_chip *chip, uint64_t now_ns, uint8_t byte) {
    rn41_chip_advance(chip, now_ns);
    const bool was_quiet =
        chip->host_heard_at == NEVER || chip->now - chip->host_heard_at >= SECOND;
    if (!chip->is_linked || !ring_put(&chip->from_host, byte)) {
        chip->counters.lost_from_host++;
        return;
    }
    chip->host_heard_at = chip->now;
    const bool is_character = byte == (uint8_t)chip->used.character;
    if (!is_character || (chip->host_held == 0 && !was_quiet)) {
        chip->host_held = 0;
    } else {
        chip->host_held++;
    }
    chip->host_escape_at = chip->host_held == 3 ? chip->now + SECOND : NEVER;
    rn41_chip_use_air(chip);
}

bool rn41_chip_host_read(struct rn41_chip *chip, uint8_t *byte) {
    return ring_take(&chip->host_out, byte);
}
