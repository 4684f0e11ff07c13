// SPDX-License-Identifier: MIT
// DMA1 and DMA2 between a peripheral and memory, one item a request (RM, "DMA
// controller"). A request is served at once: waits for the bus are not modelled.
#include "f405/f405.h"

enum {
    LISR = 0x00,
    HISR = 0x04,
    LIFCR = 0x08,
    HIFCR = 0x0C,
    STREAM0 = 0x10,
    STREAM_SIZE = 0x18,
    S_CR = 0x00,
    S_NDTR = 0x04,
    S_PAR = 0x08,
    S_M0AR = 0x0C,
    S_M1AR = 0x10,
    S_FCR = 0x14,
    CR_EN = 1 << 0,
    CR_DMEIE = 1 << 1,
    CR_TEIE = 1 << 2,
    CR_HTIE = 1 << 3,
    CR_TCIE = 1 << 4,
    CR_PFCTRL = 1 << 5,
    CR_DIR = 3 << 6,
    CR_TO_PERIPHERAL = 1 << 6,
    CR_CIRC = 1 << 8,
    CR_PINC = 1 << 9,
    CR_MINC = 1 << 10,
    CR_PINCOS = 1 << 15,
    CR_DBM = 1 << 18,
    CR_CT = 1 << 19,
    CR_BURST = 0xF << 21,
    FCR_DMDIS = 1 << 2,
    TEIF = 1 << 3,
    HTIF = 1 << 4,
    TCIF = 1 << 5,
};

static unsigned line_of(unsigned unit, unsigned stream) {
    if (unit == 0) {
        return stream == 7 ? IRQ_DMA1_STREAM7 : IRQ_DMA1_STREAM0 + stream;
    }
    return stream < 5 ? IRQ_DMA2_STREAM0 + stream : IRQ_DMA2_STREAM5 + stream - 5;
}

static void follow_line(struct f405 *m, unsigned unit, unsigned stream) {
    const uint32_t cr = m->dma[unit].streams[stream].cr;
    const uint8_t flags = m->dma[unit].flags[stream];
    core_irq(m, EXCEPTION_IRQ + line_of(unit, stream),
             ((flags & TCIF) && (cr & CR_TCIE)) || ((flags & HTIF) && (cr & CR_HTIE)) ||
                 ((flags & TEIF) && (cr & CR_TEIE)));
}

static unsigned width_of(const struct f405_stream *stream) {
    return 1U << ((stream->cr >> 11) & 3);
}

static uint32_t memory_of(const struct f405_stream *stream) {
    return (stream->cr & CR_CT) != 0 ? stream->m1ar : stream->m0ar;
}

static void raise_flag(struct f405 *m, unsigned unit, unsigned number, uint8_t flag) {
    m->dma[unit].flags[number] |= flag;
    follow_line(m, unit, number);
}

static void fail(struct f405 *m, unsigned unit, unsigned number) {
    m->dma[unit].streams[number].cr &= ~(uint32_t)CR_EN;
    f405_complain(m, "DMA where it can't reach");
    raise_flag(m, unit, number, TEIF);
}

// DMA1 reaches no peripherals but those on APB1; no DMA reaches the CCM (RM, "System
// architecture").
static bool is_reachable(unsigned unit, uint32_t peripheral, uint32_t memory) {
    const bool is_apb1 = peripheral - 0x40000000U < 0x8000;
    return (unit == 1 || is_apb1) && memory - F405_CCM >= F405_CCM_SIZE;
}

static void finish(struct f405 *m, unsigned unit, unsigned number) {
    struct f405_stream *stream = &m->dma[unit].streams[number];
    if ((stream->cr & CR_DBM) != 0) {
        stream->cr ^= CR_CT;
    }
    if ((stream->cr & (CR_CIRC | CR_DBM)) != 0) {
        stream->ndtr = stream->length;
        stream->at = memory_of(stream);
        stream->register_at = stream->par;
    } else {
        stream->cr &= ~(uint32_t)CR_EN;
    }
    raise_flag(m, unit, number, TCIF);
}

static bool move(struct f405 *m, const struct f405_stream *stream,
                 bool is_to_peripheral) {
    const unsigned width = width_of(stream);
    const uint32_t from = is_to_peripheral ? stream->at : stream->register_at;
    const uint32_t to = is_to_peripheral ? stream->register_at : stream->at;
    uint32_t value = 0;
    return f405_bus_read(m, from, width, &value) && f405_bus_write(m, to, width, value);
}

bool dma_serve(struct f405 *m, unsigned unit, unsigned number, unsigned channel,
               bool is_to_peripheral) {
    struct f405_stream *stream = &m->dma[unit].streams[number];
    if ((stream->cr & CR_EN) == 0 || stream->ndtr == 0 ||
        ((stream->cr >> 25) & 7) != channel ||
        ((stream->cr & CR_TO_PERIPHERAL) != 0) != is_to_peripheral) {
        return false;
    }
    if (!is_reachable(unit, stream->register_at, stream->at) ||
        !move(m, stream, is_to_peripheral)) {
        fail(m, unit, number);
        return true;
    }
    const unsigned width = width_of(stream);
    stream->at += (stream->cr & CR_MINC) != 0 ? width : 0;
    stream->register_at += (stream->cr & CR_PINC) != 0 ? width : 0;
    stream->ndtr--;
    if (stream->ndtr == stream->length / 2 && stream->length > 1) {
        raise_flag(m, unit, number, HTIF);
    }
    if (stream->ndtr == 0) {
        finish(m, unit, number);
    }
    return true;
}

uint32_t dma_left(const struct f405 *m, unsigned unit, unsigned number,
                  unsigned channel) {
    const struct f405_stream *stream = &m->dma[unit].streams[number];
    const bool serves =
        (stream->cr & CR_EN) != 0 && ((stream->cr >> 25) & 7) == channel;
    return serves ? stream->ndtr : 0;
}

// Flags of four streams in a word (RM, "DMA low interrupt status register").
static const uint8_t flag_shift[4] = {0, 6, 16, 22};

static uint32_t read_flags(const struct f405 *m, unsigned unit, unsigned first) {
    uint32_t word = 0;
    for (unsigned i = 0; i < 4; i++) {
        word |= (uint32_t)m->dma[unit].flags[first + i] << flag_shift[i];
    }
    return word;
}

static void clear_flags(struct f405 *m, unsigned unit, unsigned first, uint32_t word) {
    for (unsigned i = 0; i < 4; i++) {
        m->dma[unit].flags[first + i] &= (uint8_t) ~((word >> flag_shift[i]) & 0x3D);
        follow_line(m, unit, first + i);
    }
}

static void enable(struct f405 *m, unsigned unit, unsigned number) {
    struct f405_stream *stream = &m->dma[unit].streams[number];
    if ((stream->cr & (CR_PFCTRL | CR_PINCOS | CR_BURST)) != 0 ||
        (stream->cr & CR_DIR) > CR_TO_PERIPHERAL || (stream->fcr & FCR_DMDIS) != 0) {
        f405_not_modelled(m, "DMA by FIFO, in bursts, or from memory to memory");
    }
    if (m->dma[unit].flags[number] != 0) {
        f405_complain(m, "a DMA stream enabled with flags of its last use");
    }
    stream->length = stream->ndtr;
    stream->at = memory_of(stream);
    stream->register_at = stream->par;
}

static void write_stream_control(struct f405 *m, unsigned unit, unsigned number,
                                 uint32_t value) {
    struct f405_stream *stream = &m->dma[unit].streams[number];
    const bool was_on = (stream->cr & CR_EN) != 0;
    const bool is_on = (value & CR_EN) != 0;
    const uint32_t always = CR_EN | CR_DMEIE | CR_TEIE | CR_HTIE | CR_TCIE | CR_CT;
    if (was_on && ((stream->cr ^ value) & ~always) != 0) {
        f405_complain(m, "a DMA stream changed while it is enabled");
        value = (stream->cr & ~always) | (value & always);
    }
    stream->cr = value & 0x0FFFFFFF;
    if (!was_on && is_on) {
        enable(m, unit, number);
    } else if (was_on && !is_on) {
        raise_flag(m, unit, number, TCIF);  // RM, "DMA transfer suspension"
    }
    follow_line(m, unit, number);
}

static uint32_t *stream_register(struct f405_stream *stream, uint32_t at) {
    switch (at) {
    case S_CR:
        return &stream->cr;
    case S_NDTR:
        return &stream->ndtr;
    case S_PAR:
        return &stream->par;
    case S_M0AR:
        return &stream->m0ar;
    case S_M1AR:
        return &stream->m1ar;
    default:
        return &stream->fcr;
    }
}

uint32_t dma_read(struct f405 *m, unsigned unit, uint32_t at) {
    if (at <= HISR) {
        return read_flags(m, unit, at);  // 0 or 4: the first stream of the word
    }
    if (at <= HIFCR) {
        return 0;
    }
    const uint32_t number = (at - STREAM0) / STREAM_SIZE;
    if (number >= STREAMS) {
        f405_not_modelled(m, "no register of DMA");
        return 0;
    }
    return *stream_register(&m->dma[unit].streams[number],
                            (at - STREAM0) % STREAM_SIZE);
}

void dma_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    if (at <= HISR) {
        return;  // read-only
    }
    if (at <= HIFCR) {
        clear_flags(m, unit, at - LIFCR, value);
        return;
    }
    const uint32_t number = (at - STREAM0) / STREAM_SIZE;
    const uint32_t reg = (at - STREAM0) % STREAM_SIZE;
    if (number >= STREAMS) {
        f405_not_modelled(m, "no register of DMA");
        return;
    }
    struct f405_stream *stream = &m->dma[unit].streams[number];
    if (reg == S_CR) {
        write_stream_control(m, unit, number, value);
        return;
    }
    // The buffer that is not in use may be set while the other one is.
    const bool is_free = reg == ((stream->cr & CR_CT) != 0 ? S_M0AR : S_M1AR);
    if ((stream->cr & CR_EN) != 0 && !is_free) {
        f405_complain(m, "a DMA stream changed while it is enabled");
        return;
    }
    *stream_register(stream, reg) = reg == S_NDTR ? value & 0xFFFF : value;
}

void dma_reset(struct f405 *m, unsigned unit) {
    m->dma[unit] = (struct f405_dma){0};
    for (unsigned i = 0; i < STREAMS; i++) {
        m->dma[unit].streams[i].fcr = 0x21;
        follow_line(m, unit, i);
    }
}
