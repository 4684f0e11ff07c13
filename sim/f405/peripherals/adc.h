// SPDX-License-Identifier: MIT
// ADC1.
#ifndef SIM_F405_PERIPHERALS_ADC_H
#define SIM_F405_PERIPHERALS_ADC_H

#include <stdbool.h>
#include <stdint.h>

struct f405;

struct f405_adc {
    uint32_t sr, cr1, cr2, smpr[2], sqr[3], data, ccr;
    unsigned index;  // in the sequence
    bool is_converting;
    double sampled_mv;  // on the sampling capacitor, by the last conversion
};

void adc_reset(struct f405 *m, unsigned unit);
void adc_event(struct f405 *m);
// One transfer by DMA, where the unit asks for one. True: there may be another.
bool adc_pump(struct f405 *m);
uint32_t adc_read(struct f405 *m, unsigned unit, uint32_t at);
void adc_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

#endif
