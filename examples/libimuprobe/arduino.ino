// SPDX-License-Identifier: MIT
// An Arduino Mega that reads another probe at its Serial1, and lights its LED while
// that probe leans by more than 10 degrees; nobody has run it on a board. Put imuprobe.h
// and imuprobe.c beside it.

#include "imuprobe.h"

static struct imuprobe_reader reader;
static struct imuprobe_message message;

void setup() {
    pinMode(LED_BUILTIN, OUTPUT);
    Serial1.begin(500000);
    imuprobe_begin(&reader);
}

void loop() {
    while (Serial1.available()) {
        if (imuprobe_read(&reader, Serial1.read(), &message) == IMUPROBE_MESSAGE &&
            message.header.id == IMUPROBE_MESSAGE_POSE) {
            // The cosine of its lean is 1 - 2 (x^2 + y^2), in 2^-28 here.
            const int32_t x = message.pose.q[1] >> 16, y = message.pose.q[2] >> 16;
            digitalWrite(LED_BUILTIN, x * x + y * y > 2039000L);
        }
    }
}
