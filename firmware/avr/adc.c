// SPDX-License-Identifier: MIT
// The converter measures the supply against the bandgap; once in a probe's life it
// listens to a floating pin.
#include "adc.h"

#include <avr/io.h>

#include "../board.h"
#include "pins.h"

enum {
    // Reference AVcc, input the 1.1 V bandgap.
    MUX_BANDGAP = _BV(REFS0) | ADC_BANDGAP,
    MUX_FLOATING = _BV(REFS0) | ADC_FLOATING,
    BANDGAP_MV = 1100,  // 1000 to 1200 ("System and Reset Characteristics")
    // Below 200 kHz for all ten bits: 16 MHz / 128. Noise is welcome to more: / 16.
    PRECISE = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0),
    COARSE = _BV(ADEN) | _BV(ADPS2),
    ENTROPY_CONVERSIONS = 64,  // of 13 us: 0.9 ms; four for each bit
    WAIT_MAX = 255,            // turns of 5 cycles or more; a conversion takes 400
};

static bool is_settled;  // the conversion under way began with a charged bandgap

void adc_init(void) {
    ADMUX = MUX_BANDGAP;
    ADCSRA = PRECISE | _BV(ADSC);
    is_settled = false;
}

// Each call hands out the conversion that the call before it began, so that nobody
// waits. The first began while the bandgap charged and is not used.
uint16_t board_supply_mv(void) {
    if ((ADCSRA & _BV(ADSC)) != 0) {
        return 0;
    }
    const uint16_t counts = ADC;
    const bool is_good = is_settled && counts != 0;
    is_settled = true;
    ADCSRA = PRECISE | _BV(ADSC);
    return is_good ? (uint16_t)(BANDGAP_MV * UINT32_C(1024) / counts) : 0;
}

uint16_t board_entropy(void) {
    uint16_t bits = 0;
    ADCSRA = 0;
    ADMUX = MUX_FLOATING;
    for (uint8_t i = 0; i < ENTROPY_CONVERSIONS; i++) {
        ADCSRA = COARSE | _BV(ADSC);
        for (uint8_t turn = 0; turn < WAIT_MAX; turn++) {
            if ((ADCSRA & _BV(ADSC)) == 0) {
                break;
            }
        }
        bits = (uint16_t)(bits << 1 | bits >> 15) ^ ADC;
    }
    ADCSRA = 0;
    adc_init();
    return bits;
}
