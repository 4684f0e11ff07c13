// SPDX-License-Identifier: MIT
// The converter: supply voltage.
#ifndef ADC_H
#define ADC_H

// Starts to measure the supply.
void adc_init(void);

#endif
