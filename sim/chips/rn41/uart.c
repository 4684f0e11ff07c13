// SPDX-License-Identifier: MIT
// The UART: bytes out as CTS lets them, bytes in as their rate makes them.
#include "../uart.h"
#include "chip.h"

static uint64_t frame_ns(const struct rn41_chip *chip) {
    return (UART_BITS * SECOND + rn41_chip_rates[chip->rate].baud / 2) /
           rn41_chip_rates[chip->rate].baud;
}

void rn41_chip_begin_sending(struct rn41_chip *chip) {
    if (chip->is_sending || chip->now < chip->next_at || chip->is_cts_high ||
        !chip->is_ready || rn41_chip_suffers(chip, RN41_CHIP_DEAF) ||
        !ring_take(&chip->to_uart, &chip->shift)) {
        return;
    }
    chip->is_sending = true;
    chip->sent_at = chip->now + frame_ns(chip);
}

void rn41_chip_send_text(struct rn41_chip *chip, const char *text) {
    for (; *text != '\0'; text++) {
        if (!ring_put(&chip->to_uart, (uint8_t)*text)) {
            rn41_chip_complain(chip, "more answers than its buffer takes");
        }
    }
    rn41_chip_begin_sending(chip);
}

void rn41_chip_send_status(struct rn41_chip *chip, const char *text) {
    if (chip->used.status[0] != '\0') {
        rn41_chip_send_text(chip, chip->used.status);
        rn41_chip_send_text(chip, text);
        rn41_chip_send_text(chip, "\r\n");
    }
}

void rn41_chip_end_frame(struct rn41_chip *chip) {
    chip->sent_at = NEVER;
    chip->is_sending = false;
    chip->out_baud = rn41_chip_rates[chip->rate].baud;
    (void)ring_put(&chip->uart_out, chip->shift);
    // CTS is looked at before each byte, so the other side has its say first.
    chip->next_at = chip->now + 1;
    if (chip->is_linked) {
        rn41_chip_use_air(chip);
    }
    rn41_chip_finish_answer(chip);
}

void rn41_chip_receive(struct rn41_chip *chip, uint64_t now_ns, uint8_t byte,
                       uint32_t baud) {
    rn41_chip_advance(chip, now_ns);
    if (!chip->is_ready || rn41_chip_suffers(chip, RN41_CHIP_DEAF)) {
        chip->counters.lost_to_host++;
        return;
    }
    const uint32_t own = rn41_chip_rates[chip->rate].baud;
    bool has_stop = true;
    const uint8_t got = uart_sample(byte, baud, own, &has_stop);
    if (got != byte) {
        // A frame that begins within one that it believes to be receiving is no start.
        const uint64_t length = UART_BITS * SECOND / baud;
        const uint64_t start = now_ns > length ? now_ns - length : 0;
        if (start < chip->rx_busy) {
            return;
        }
        chip->rx_busy = start + (2 * UART_BITS - 1) * SECOND / (2 * (uint64_t)own);
    }
    if (chip->is_command) {
        rn41_chip_hear_command(chip, got);
    } else {
        rn41_chip_hear_data(chip, got);
    }
}

void rn41_chip_set_cts(struct rn41_chip *chip, uint64_t now_ns, bool is_high) {
    rn41_chip_advance(chip, now_ns);
    chip->is_cts_high = is_high;
    rn41_chip_begin_sending(chip);
}

bool rn41_chip_take(struct rn41_chip *chip, uint8_t *byte, uint32_t *baud) {
    *baud = chip->out_baud;
    return ring_take(&chip->uart_out, byte);
}

bool rn41_chip_is_sending(const struct rn41_chip *chip) {
    return chip->is_sending;
}
