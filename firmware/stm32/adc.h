// SPDX-License-Identifier: MIT
// The converter: supply and battery.
#ifndef ADC_H
#define ADC_H

#include <stdint.h>

void adc_init(void);

// The battery behind its divider, mV; BATTERY_UNKNOWN for an open pin. 0.1 ms.
uint16_t adc_battery_mv(void);

#endif
