// SPDX-License-Identifier: MIT
// The interrupts between a data-ready edge and the bytes of a sample.
#ifndef SAMPLING_H
#define SAMPLING_H

// Starts the timer that captures edges.
void sampling_init(void);

void sampling_edge(void);  // TIM3
void sampling_bus(void);   // I2C1, event and error

#endif
