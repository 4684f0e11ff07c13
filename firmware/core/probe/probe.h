// SPDX-License-Identifier: MIT
// The probe: samples, button and time in, frames out; received bytes are for
// commands.h. It has neither hardware nor a clock.
//
// Calls in core/probe/ go down these lines only, which tests/test_house.py reads:
//
//     acquisition, equipment      the sensor; clock, radio, card and battery
//     polled                      when a sensor without a wire has a sample
//     probe, commands             samples, button and steps; received bytes
//     probe_params, probe_stream  what both of them change
//     probe_filter                begins the filter
//     own_field                   what the filter begins with
//     send                        messages out
//     probe_state, outlet         the struct; to the wire or the card
#ifndef PROBE_H
#define PROBE_H

#include "core/probe/probe_state.h"

// Loads settings and params, counts the boot, makes the probe's id where it has none.
void probe_begin(struct probe *probe, const IN_FLASH struct probe_port *port,
                 uint32_t now_us);

// The board has more than sensor, wire and button. Both must stay valid.
void probe_equip(struct probe *probe, struct probe_log *log,
                 void (*equipment)(struct message_equipment *out));

// The sensor is set up and samples will come, for the first time or again.
void probe_sensor_ready(struct probe *probe, const struct sensor_identity *identity,
                        uint32_t now_us);

// The sensor or its bus failed; `detail` goes into the event. `is_over`: samples have
// stopped until probe_sensor_ready(); otherwise one sample was lost.
void probe_sensor_failed(struct probe *probe, enum event event, enum cause cause,
                         int32_t detail, bool is_over, uint32_t now_us);

// Data-ready edges were missed: their samples are lost.
void probe_overrun(struct probe *probe, uint16_t missed, uint32_t now_us);

void probe_sample(struct probe *probe, const struct sample *sample);

// Reports the cycles of a sample, all work for it included.
void probe_worked(struct probe *probe, uint32_t cycles);

// Something happened that a board knows of.
void probe_tell(struct probe *probe, enum event event, enum cause cause, int32_t detail,
                uint32_t now_us);

// Starts or stops streaming and tells it with its cause; nothing where it does already.
void probe_set_streaming(struct probe *probe, bool is_streaming, enum cause cause,
                         uint32_t now_us);

// A host may have come: says who the probe is.
void probe_say_hello(struct probe *probe, uint32_t now_us);

// Starts to keep messages: a hello, then each sample's raw and pose whatever the wire
// gets of them, and all else that is sent. Their sequence starts at 0. Or stops it.
void probe_log(struct probe *probe, bool is_on, uint32_t now_us);

// Button, periodic messages, settings. Call it every 10 ms or oftener.
void probe_step(struct probe *probe, bool is_button_down, uint32_t now_us);

// Idle: a flash of 50 ms every 2 s. Calibrating: 5 blinks a second. Streaming: on.
// Fault: two short flashes a second.
bool probe_led(const struct probe *probe, uint32_t now_us);

#endif
