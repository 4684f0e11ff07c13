// SPDX-License-Identifier: MIT
// Prints what a reader of libimuprobe has read; shared by posix.c and windows.c.
#ifndef SHOW_H
#define SHOW_H

#include <stdio.h>

#include "imuprobe.h"

static void show(const struct imuprobe_reader *reader,
                 const struct imuprobe_message *message) {
    if (message->header.id == IMUPROBE_MESSAGE_HELLO) {
        printf("probe, firmware %.16s: %lu messages, %lu lost, %lu corrupt\n",
               message->hello.firmware, (unsigned long)reader->messages,
               (unsigned long)reader->lost, (unsigned long)reader->corrupt);
    } else if (message->header.id == IMUPROBE_MESSAGE_POSE) {
        const struct imuprobe_message_pose *pose = &message->pose;
        printf("%10.6f s  %9.6f %9.6f %9.6f %9.6f  tilt ",
               message->header.time_us * 1e-6, pose->q[0] * IMUPROBE_POSE_Q_SCALE,
               pose->q[1] * IMUPROBE_POSE_Q_SCALE, pose->q[2] * IMUPROBE_POSE_Q_SCALE,
               pose->q[3] * IMUPROBE_POSE_Q_SCALE);
        if (pose->tilt_sigma == IMUPROBE_POSE_TILT_SIGMA_NULL) {
            printf("unknown\n");
        } else {
            printf("±%.2f deg\n", pose->tilt_sigma * IMUPROBE_POSE_TILT_SIGMA_SCALE);
        }
    }
    fflush(stdout);
}

#endif
