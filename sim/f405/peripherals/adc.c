// SPDX-License-Identifier: MIT
// ADC1, started by software: the regular sequence, once or continuously (RM,
// "Analog-to-digital converter"). Pins that nothing is wired to read as noise, except
// PC0, which keeps its charge.
#include <math.h>

#include "f405/f405.h"

enum {
    SR = 0x00,
    CR1 = 0x04,
    CR2 = 0x08,
    SMPR1 = 0x0C,
    SMPR2 = 0x10,
    SQR1 = 0x2C,
    SQR3 = 0x34,
    DR = 0x4C,
    CSR = 0x300,
    CCR = 0x304,
    EOC = 1 << 1,
    STRT = 1 << 4,
    OVR = 1 << 5,
    CR1_EOCIE = 1 << 5,
    CR1_SCAN = 1 << 8,
    CR1_RES = 3 << 24,
    CR1_OVRIE = 1 << 26,
    CR1_KNOWN = CR1_EOCIE | CR1_SCAN | CR1_RES | CR1_OVRIE,
    CR2_ADON = 1 << 0,
    CR2_CONT = 1 << 1,
    CR2_DMA = 1 << 8,
    CR2_DDS = 1 << 9,
    CR2_EOCS = 1 << 10,
    CR2_SWSTART = 1 << 30,
    CR2_KNOWN = CR2_ADON | CR2_CONT | CR2_DMA | CR2_DDS | CR2_EOCS | CR2_SWSTART,
    CCR_VBATE = 1 << 22,
    CCR_TSVREFE = 1 << 23,
    CHANNEL_CELL = 10,  // PC0
    CHANNEL_TEMPERATURE = 16,
    CHANNEL_REFERENCE = 17,
    CHANNEL_BATTERY = 18,
    // DS, "Embedded reference voltage" and "Temperature sensor characteristics".
    REFERENCE_MV = 1210,
    TEMPERATURE_MV = 760,  // at 25 degC
    FULL_SCALE = 4095,
    FASTEST_HZ = 36000000,  // DS, "12-bit ADC characteristics"
    DMA2_UNIT = 1,
    REFERENCE_SAMPLE_NS = 10000,  // DS, "Embedded reference voltage", the least
    // DS, "12-bit ADC characteristics": of the switch; and the capacitors, in fF, of
    // the sampling stage and, estimated, of a pin that nothing is wired to.
    SWITCH_OHMS = 6000,
    SAMPLING_FF = 4000,
    PIN_FF = 10000,
};

static void follow_line(struct f405 *m) {
    const struct f405_adc *adc = &m->adc;
    core_irq(m, EXCEPTION_IRQ + IRQ_ADC,
             ((adc->sr & EOC) && (adc->cr1 & CR1_EOCIE)) ||
                 ((adc->sr & OVR) && (adc->cr1 & CR1_OVRIE)));
}

static unsigned channel_now(const struct f405_adc *adc) {
    const uint32_t word = adc->sqr[2 - adc->index / 6];  // SQR3 has the first six
    return (word >> (5 * (adc->index % 6))) & 31;
}

static unsigned sample_cycles(const struct f405_adc *adc, unsigned channel) {
    static const uint16_t cycles[8] = {3, 15, 28, 56, 84, 112, 144, 480};
    const uint32_t code = channel < 10 ? adc->smpr[1] >> (3 * channel)
                                       : adc->smpr[0] >> (3 * (channel - 10));
    return cycles[code & 7];
}

static void begin(struct f405 *m) {
    struct f405_adc *adc = &m->adc;
    const uint32_t hz = m->pclk_hz[1] / (2 * (((adc->ccr >> 16) & 3) + 1));
    if (hz > FASTEST_HZ) {
        f405_complain(m, "the ADC's clock faster than 36 MHz");
    }
    const unsigned bits = 12 - 2 * ((adc->cr1 >> 24) & 3);
    adc->is_converting = true;
    f405_at(m, EVENT_ADC,
            f405_when(m) + f405_ps(sample_cycles(adc, channel_now(adc)) + bits, hz));
}

static double sample_seconds(const struct f405 *m, unsigned channel) {
    const uint32_t hz = m->pclk_hz[1] / (2 * (((m->adc.ccr >> 16) & 3) + 1));
    return hz == 0 ? 0.0 : (double)sample_cycles(&m->adc, channel) / hz;
}

// The divider charges the sampling capacitor as fast as its resistors allow. A floating
// pin shares its charge with the capacitor and so drifts towards what was sampled
// before.
static uint32_t sample_cell(struct f405 *m) {
    struct f405_adc *adc = &m->adc;
    double ohms = 0.0;
    const double mv = wired_analog_mv(m, &ohms);
    if (((m->ports[PORT_C].moder >> 0) & 3) != 3) {
        f405_complain(m, "the ADC on a pin that is not analog");
    }
    if (ohms > 0.0) {
        const double tau = (ohms + SWITCH_OHMS) * SAMPLING_FF * 1e-15;
        const double left = exp(-sample_seconds(m, CHANNEL_CELL) / tau);
        adc->sampled_mv = mv + (adc->sampled_mv - mv) * left;
    } else {
        adc->sampled_mv = (mv * PIN_FF + adc->sampled_mv * SAMPLING_FF) /
                          (double)(PIN_FF + SAMPLING_FF);
        m->wired.pin_mv = adc->sampled_mv;
    }
    const double counts = adc->sampled_mv * FULL_SCALE / F405_SUPPLY_MV + 0.5 +
                          (double)(f405_random(m) % 3) - 1.0;
    const uint32_t value = counts <= 0.0 ? 0 : (uint32_t)counts;
    return value > FULL_SCALE ? FULL_SCALE : value;
}

static uint32_t convert(struct f405 *m, unsigned channel) {
    struct f405_adc *adc = &m->adc;
    if (channel == CHANNEL_CELL) {
        return sample_cell(m) >> (2 * ((adc->cr1 >> 24) & 3));
    }
    if (channel == CHANNEL_REFERENCE &&
        sample_seconds(m, channel) < REFERENCE_SAMPLE_NS * 1e-9) {
        f405_complain(m, "the reference sampled for less than 10 us");
    }
    uint32_t mv = f405_random(m) % F405_SUPPLY_MV;
    if (channel == CHANNEL_REFERENCE && (adc->ccr & CCR_TSVREFE) != 0) {
        mv = REFERENCE_MV;
    } else if (channel == CHANNEL_TEMPERATURE && (adc->ccr & CCR_TSVREFE) != 0) {
        mv = TEMPERATURE_MV;
    } else if (channel == CHANNEL_BATTERY && (adc->ccr & CCR_VBATE) != 0) {
        mv = F405_SUPPLY_MV / 2;
    }
    adc->sampled_mv = mv;
    const uint32_t counts = (mv * FULL_SCALE + F405_SUPPLY_MV / 2) / F405_SUPPLY_MV;
    return counts >> (2 * ((adc->cr1 >> 24) & 3));
}

void adc_event(struct f405 *m) {
    struct f405_adc *adc = &m->adc;
    const unsigned length =
        (adc->cr1 & CR1_SCAN) != 0 ? ((adc->sqr[0] >> 20) & 15) + 1 : 1;
    const bool is_last = adc->index + 1 >= length;
    adc->is_converting = false;
    if ((adc->sr & EOC) != 0 && (adc->cr2 & (CR2_DMA | CR2_EOCS)) != 0) {
        adc->sr |= OVR;
        follow_line(m);
        return;
    }
    adc->data = convert(m, channel_now(adc));
    if (is_last || (adc->cr2 & (CR2_EOCS | CR2_DMA)) != 0) {
        adc->sr |= EOC;
    }
    adc->index = is_last ? 0 : adc->index + 1;
    follow_line(m);
    if (!is_last || (adc->cr2 & CR2_CONT) != 0) {
        begin(m);
    }
}

bool adc_pump(struct f405 *m) {
    const struct f405_adc *adc = &m->adc;
    return (adc->cr2 & CR2_DMA) != 0 && (adc->sr & EOC) != 0 &&
           (dma_serve(m, DMA2_UNIT, 0, 0, false) ||
            dma_serve(m, DMA2_UNIT, 4, 0, false));
}

uint32_t adc_read(struct f405 *m, unsigned unit, uint32_t at) {
    (void)unit;
    struct f405_adc *adc = &m->adc;
    if (at >= SQR1 && at <= SQR3) {
        return adc->sqr[(at - SQR1) / 4];
    }
    switch (at) {
    case SR:
        return adc->sr;
    case CR1:
        return adc->cr1;
    case CR2:
        return adc->cr2;
    case SMPR1:
    case SMPR2:
        return adc->smpr[(at - SMPR1) / 4];
    case DR:
        adc->sr &= ~(uint32_t)EOC;
        follow_line(m);
        return adc->data;
    case CSR:
        return adc->sr;
    case CCR:
        return adc->ccr;
    default:
        f405_not_modelled(m, "a register of the ADCs");
        return 0;
    }
}

static void write_control(struct f405 *m, uint32_t value) {
    struct f405_adc *adc = &m->adc;
    if ((value & ~(uint32_t)CR2_KNOWN) != 0) {
        f405_not_modelled(m, "triggers and alignment of the ADC");
    }
    adc->cr2 = value & CR2_KNOWN & ~(uint32_t)CR2_SWSTART;
    if ((value & CR2_ADON) == 0) {
        adc->is_converting = false;
        f405_never(m, EVENT_ADC);
    } else if ((value & CR2_SWSTART) != 0 && !adc->is_converting) {
        adc->sr |= STRT;
        adc->index = 0;
        begin(m);
    }
}

void adc_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value) {
    (void)unit;
    struct f405_adc *adc = &m->adc;
    if (at >= SQR1 && at <= SQR3) {
        adc->sqr[(at - SQR1) / 4] = value;
        return;
    }
    switch (at) {
    case SR:
        adc->sr &= value;
        break;
    case CR1:
        adc->cr1 = value & CR1_KNOWN;
        if ((value & ~(uint32_t)CR1_KNOWN) != 0) {
            f405_not_modelled(m, "injected channels and the watchdog of the ADC");
        }
        break;
    case CR2:
        write_control(m, value);
        break;
    case SMPR1:
    case SMPR2:
        adc->smpr[(at - SMPR1) / 4] = value;
        break;
    case CCR:
        adc->ccr = value & 0x00C30000;
        if ((value & ~UINT32_C(0x00C30000)) != 0) {
            f405_not_modelled(m, "several ADCs together");
        }
        break;
    default:
        f405_not_modelled(m, "a register of the ADCs");
        break;
    }
    follow_line(m);
}

void adc_reset(struct f405 *m, unsigned unit) {
    (void)unit;
    m->adc = (struct f405_adc){0};
    f405_never(m, EVENT_ADC);
    follow_line(m);
}
