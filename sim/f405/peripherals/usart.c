// SPDX-License-Identifier: MIT
// USART2 as an asynchronous 8N1 line (RM, "Universal synchronous asynchronous receiver
// transmitter"): a data register beside each shift register, overrun, the idle line,
// RTS and CTS.

#include "chips/rn41.h"
#include "chips/uart.h"
#include "f405/f405.h"

enum {
    SR = 0x00,
    DR = 0x04,
    BRR = 0x08,
    CR1 = 0x0C,
    CR2 = 0x10,
    CR3 = 0x14,
    GTPR = 0x18,
    FE = 1 << 1,
    ORE = 1 << 3,
    IDLE = 1 << 4,
    RXNE = 1 << 5,
    TC = 1 << 6,
    TXE = 1 << 7,
    CTSF = 1 << 9,
    CLEARED_BY_DATA = ORE | IDLE | 0x07,
    CR1_RE = 1 << 2,
    CR1_TE = 1 << 3,
    CR1_IDLEIE = 1 << 4,
    CR1_RXNEIE = 1 << 5,
    CR1_TCIE = 1 << 6,
    CR1_TXEIE = 1 << 7,
    CR1_UE = 1 << 13,
    CR1_OVER8 = 1 << 15,
    CR1_KNOWN = 0xA1FC & ~(1 << 8),
    CR2_STOP = 3 << 12,
    CR3_EIE = 1 << 0,
    CR3_DMAR = 1 << 6,
    CR3_DMAT = 1 << 7,
    CR3_RTSE = 1 << 8,
    CR3_CTSE = 1 << 9,
    CR3_CTSIE = 1 << 10,
    CR3_ONEBIT = 1 << 11,
    CR3_KNOWN =
        CR3_EIE | CR3_DMAR | CR3_DMAT | CR3_RTSE | CR3_CTSE | CR3_CTSIE | CR3_ONEBIT,
    FRAME_BITS = 10,
    LINE_HZ = 921600,  // bytes that come while the receiver is not set up
    PIN_CTS = 0,
    PIN_RTS = 1,
    PIN_TX = 2,
    PIN_RX = 3,
    AF_USART = 7,
    DMA1_UNIT = 0,
    RX_STREAM = 5,
    TX_STREAM = 6,
    CHANNEL = 4,
};

static uint32_t divider_of(const struct f405_usart *usart) {
    return (usart->cr1 & CR1_OVER8) != 0 ? ((usart->brr >> 4) << 3) + (usart->brr & 7)
                                         : usart->brr;
}

uint32_t usart_baud(const struct f405 *m) {
    const uint32_t divider = divider_of(&m->usart);
    return divider == 0 ? 0 : (m->pclk_hz[0] + divider / 2) / divider;
}

// Without a radio the other side has the rate that is set here.
static uint64_t frame_ps(const struct f405 *m) {
    const uint32_t divider = divider_of(&m->usart);
    if (divider == 0 || m->pclk_hz[0] == 0) {
        return f405_ps(FRAME_BITS, LINE_HZ);
    }
    return f405_ps((uint64_t)FRAME_BITS * divider, m->pclk_hz[0]);
}

static bool is_on(const struct f405 *m, uint32_t half) {
    return (m->usart.cr1 & CR1_UE) != 0 && (m->usart.cr1 & half) != 0;
}

static void follow_line(struct f405 *m) {
    const struct f405_usart *usart = &m->usart;
    const uint32_t sr = usart->sr;
    const uint32_t cr1 = usart->cr1;
    const uint32_t by_dma = CR3_EIE | CR3_DMAR;
    core_irq(m, EXCEPTION_IRQ + IRQ_USART2,
             ((sr & TXE) && (cr1 & CR1_TXEIE)) || ((sr & TC) && (cr1 & CR1_TCIE)) ||
                 ((sr & (RXNE | ORE)) && (cr1 & CR1_RXNEIE)) ||
                 ((sr & IDLE) && (cr1 & CR1_IDLEIE)) ||
                 ((sr & (ORE | FE)) && (usart->cr3 & by_dma) == by_dma) ||
                 ((sr & CTSF) && (usart->cr3 & CR3_CTSIE)));
}

// Out

// RM, "RTS and CTS flow control": CTS is checked before each frame.
static bool is_clear_to_send(struct f405 *m) {
    if ((m->usart.cr3 & CR3_CTSE) == 0) {
        return true;
    }
    if (!pins_is_alternate(m, PORT_A, PIN_CTS, AF_USART)) {
        f405_complain(m, "USART2 waits for CTS with its pin elsewhere");
        return true;
    }
    if (wired_level(m, PORT_A, PIN_CTS) < 0 &&
        ((m->ports[PORT_A].pupdr >> (2 * PIN_CTS)) & 3) == 0) {
        f405_complain(m, "USART2 waits for a CTS that floats");
    }
    return !pins_level(m, PORT_A, PIN_CTS);
}

static void begin_sending(struct f405 *m) {
    struct f405_usart *usart = &m->usart;
    if (usart->is_shifting || !usart->is_data_full || !is_on(m, CR1_TE) ||
        !is_clear_to_send(m)) {
        return;
    }
    usart->shift = usart->data;
    usart->is_data_full = false;
    usart->is_shifting = true;
    usart->sr |= TXE;
    f405_at(m, EVENT_USART_SENT, f405_when(m) + frame_ps(m));
}

void usart_sent(struct f405 *m) {
    struct f405_usart *usart = &m->usart;
    usart->is_shifting = false;
    if (usart->is_preamble) {
        usart->is_preamble = false;
    } else if (!pins_is_alternate(m, PORT_A, PIN_TX, AF_USART)) {
        f405_complain(m, "USART2 sends with its pin elsewhere");
    } else if (m->radio != NULL) {
        const uint32_t baud = usart_baud(m);
        if (baud != 0) {
            rn41_chip_receive(m->radio, f405_ns(f405_when(m)), usart->shift, baud);
            wired_tell_host(m);
        }
    } else if (m->on_byte != NULL) {
        m->on_byte(m->context, usart->shift);
    }
    begin_sending(m);
    if (!usart->is_shifting && !usart->is_data_full) {
        usart->sr |= TC;
    }
    follow_line(m);
    wired_follow(m);
}

void usart_follow_cts(struct f405 *m) {
    struct f405_usart *usart = &m->usart;
    const bool is_high = pins_level(m, PORT_A, PIN_CTS);
    if (is_high == usart->was_cts_high) {
        return;
    }
    usart->was_cts_high = is_high;
    if ((usart->cr3 & CR3_CTSE) != 0) {
        usart->sr |= CTSF;
        begin_sending(m);
        follow_line(m);
    }
}

static void write_data(struct f405 *m, uint8_t byte) {
    struct f405_usart *usart = &m->usart;
    if (!is_on(m, CR1_TE)) {
        f405_complain(m, "a byte for USART2 while it does not send");
        return;
    }
    if (usart->is_data_full) {
        f405_complain(m, "a byte for USART2 written over another");
    }
    usart->data = byte;
    usart->is_data_full = true;
    usart->sr &= ~(uint32_t)TXE;
    usart->sr &= ~(usart->seen & TC);
    begin_sending(m);
}

// In

static void begin_receiving(struct f405 *m) {
    struct f405_usart *usart = &m->usart;
    if (usart->line.count == 0) {
        return;
    }
    const uint64_t now = f405_when(m);
    const uint64_t from = line_next(&usart->line);
    const uint64_t start = from > now ? from : now;
    usart->is_receiving = true;
    if (m->radio != NULL) {  // bytes from the host, at the radio's own rate
        f405_at(m, EVENT_USART_RECEIVED, start);
        return;
    }
    if (start < m->at[EVENT_USART_IDLE]) {
        f405_never(m, EVENT_USART_IDLE);  // its start bit comes before
    }
    f405_at(m, EVENT_USART_RECEIVED, start + frame_ps(m));
}

static void take(struct f405 *m, uint8_t byte, bool has_stop) {
    struct f405_usart *usart = &m->usart;
    if (m->rcc.is_stopped || !is_on(m, CR1_RE) ||
        !pins_is_alternate(m, PORT_A, PIN_RX, AF_USART) || !f405_is_clocked(m, 4, 17)) {
        usart->deaf++;
        return;
    }
    if ((usart->sr & RXNE) != 0) {
        usart->overruns++;
        usart->sr |= ORE;  // the unread byte stays, the one that came is lost
    } else {
        usart->received = byte;
        usart->sr |= RXNE | (has_stop ? 0 : FE);
    }
    usart->is_idle_due = true;
}

void usart_received(struct f405 *m) {
    struct f405_usart *usart = &m->usart;
    const uint8_t byte = line_take(&usart->line);
    usart->is_receiving = false;
    if (m->radio != NULL) {
        rn41_chip_host_write(m->radio, f405_ns(f405_when(m)), byte);
        wired_tell_host(m);
        begin_receiving(m);
        wired_follow(m);
        return;
    }
    take(m, byte, true);
    follow_line(m);
    f405_at(m, EVENT_USART_IDLE, f405_when(m) + frame_ps(m));
    begin_receiving(m);
}

void usart_deliver(struct f405 *m, uint8_t byte, uint32_t baud) {
    struct f405_usart *usart = &m->usart;
    const uint32_t own = usart_baud(m);
    const uint64_t now = f405_when(m);
    bool has_stop = true;
    if (own == 0) {
        usart->deaf++;
        return;
    }
    const uint8_t got = uart_sample(byte, baud, own, &has_stop);
    if (got != byte) {
        // A start bit within a frame that the receiver believes to be receiving is not
        // recognized.
        const uint64_t length = f405_ps(FRAME_BITS, baud);
        const uint64_t start = now > length ? now - length : 0;
        if (start < usart->busy_until) {
            return;
        }
        usart->busy_until = start + f405_ps(2 * FRAME_BITS - 1, own) / 2;
    }
    take(m, got, has_stop);
    follow_line(m);
    f405_at(m, EVENT_USART_IDLE, now + frame_ps(m));
    f405_pump(m);
}

// RM, "RTS and CTS flow control": low as long as a byte can be received.
int usart_rts(const struct f405 *m) {
    const struct f405_usart *usart = &m->usart;
    if (!pins_is_alternate(m, PORT_A, PIN_RTS, AF_USART)) {
        const unsigned mode = (m->ports[PORT_A].moder >> (2 * PIN_RTS)) & 3;
        return mode != 1 ? -1 : pins_level(m, PORT_A, PIN_RTS) ? 1 : 0;
    }
    if ((usart->cr3 & CR3_RTSE) == 0) {
        return 1;
    }
    return is_on(m, CR1_RE) && (usart->sr & RXNE) == 0 && !m->rcc.is_stopped ? 0 : 1;
}

// A frame's time without a start bit sets IDLE, once until something has come again.
void usart_idle(struct f405 *m) {
    struct f405_usart *usart = &m->usart;
    if (usart->is_idle_due && is_on(m, CR1_RE)) {
        usart->is_idle_due = false;
        usart->sr |= IDLE;
        follow_line(m);
    }
}

bool f405_send(struct f405 *m, uint64_t from_ps, uint8_t byte) {
    struct f405_usart *usart = &m->usart;
    if (!line_put(&usart->line, from_ps, byte)) {
        return false;
    }
    if (!usart->is_receiving) {
        begin_receiving(m);
    }
    return true;
}

void usart_free(struct f405 *m) {
    line_free(&m->usart.line);
}

bool usart_pump(struct f405 *m) {
    const struct f405_usart *usart = &m->usart;
    if ((usart->cr3 & CR3_DMAR) != 0 && (usart->sr & RXNE) != 0 &&
        dma_serve(m, DMA1_UNIT, RX_STREAM, CHANNEL, false)) {
        return true;
    }
    return (usart->cr3 & CR3_DMAT) != 0 && (usart->sr & TXE) != 0 && is_on(m, CR1_TE) &&
           dma_serve(m, DMA1_UNIT, TX_STREAM, CHANNEL, true);
}

// Registers

static uint32_t read_data(struct f405 *m) {
    struct f405_usart *usart = &m->usart;
    usart->sr &= ~(uint32_t)RXNE;
    usart->sr &= ~(usart->seen & CLEARED_BY_DATA);
    usart->seen = 0;
    follow_line(m);
    wired_follow(m);
    return usart->received;
}

static void write_control(struct f405 *m, uint32_t value) {
    struct f405_usart *usart = &m->usart;
    const bool was_sending = is_on(m, CR1_TE);
    if ((value & ~(uint32_t)CR1_KNOWN) != 0) {
        f405_not_modelled(m, "USART2 other than 8N1");
    }
    usart->cr1 = value & CR1_KNOWN;
    if (!was_sending && is_on(m, CR1_TE)) {
        // The transmitter starts with an idle frame (RM, "Transmitter").
        usart->is_shifting = usart->is_preamble = true;
        f405_at(m, EVENT_USART_SENT, f405_when(m) + frame_ps(m));
    }
    if ((value & CR1_UE) == 0) {
        usart->is_shifting = usart->is_preamble = usart->is_data_full = false;
        usart->sr = TXE | TC;
        f405_never(m, EVENT_USART_SENT);
    }
}

uint32_t usart_read(struct f405 *m, unsigned unit, uint32_t at) {
    (void)unit;
    struct f405_usart *usart = &m->usart;
    switch (at) {
    case SR:
        usart->seen = usart->sr;
        return usart->sr;
    case DR:
        return read_data(m);
    case BRR:
        return usart->brr;
    case CR1:
        return usart->cr1;
    case CR2:
        return usart->cr2;
    case CR3:
        return usart->cr3;
    case GTPR:
        return usart->gtpr;
    default:
        f405_not_modelled(m, "no register of USART2");
        return 0;
    }
}

void usart_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    (void)unit;
    struct f405_usart *usart = &m->usart;
    switch (at) {
    case SR:
        usart->sr &= value | ~(uint32_t)(RXNE | TC | CTSF);
        break;
    case DR:
        write_data(m, (uint8_t)value);
        break;
    case BRR:
        usart->brr = value & 0xFFFF;
        break;
    case CR1:
        write_control(m, value);
        break;
    case CR2:
        usart->cr2 = value;
        if ((value & ~(uint32_t)CR2_STOP) != 0 || (value & CR2_STOP) != 0) {
            f405_not_modelled(m, "USART2 other than 8N1");
        }
        break;
    case CR3:
        usart->cr3 = value & CR3_KNOWN;
        if ((value & ~(uint32_t)CR3_KNOWN) != 0) {
            f405_not_modelled(m, "half duplex and the like of USART2");
        }
        usart->was_cts_high = pins_level(m, PORT_A, PIN_CTS);
        begin_sending(m);
        break;
    case GTPR:
        usart->gtpr = value & 0xFFFF;
        break;
    default:
        f405_not_modelled(m, "no register of USART2");
        break;
    }
    follow_line(m);
    wired_follow(m);
}

// Bytes on the line come from outside and keep arriving.
void usart_reset(struct f405 *m, unsigned unit) {
    (void)unit;
    struct f405_usart *usart = &m->usart;
    *usart = (struct f405_usart){
        .sr = TXE | TC,
        .overruns = usart->overruns,
        .deaf = usart->deaf,
        .line = usart->line,
    };
    f405_never(m, EVENT_USART_SENT);
    f405_never(m, EVENT_USART_IDLE);
    begin_receiving(m);
    follow_line(m);
}
