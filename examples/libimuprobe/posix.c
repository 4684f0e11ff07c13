// SPDX-License-Identifier: MIT
// Starts a probe and prints its poses, on Linux:
//
//     cc -o posix posix.c imuprobe.c && ./posix /dev/ttyUSB0

#include <fcntl.h>
#include <termios.h>
#include <unistd.h>

#include "show.h"

int main(int count, char **words) {
    const int port = count == 2 ? open(words[1], O_RDWR | O_NOCTTY) : -1;
    if (port < 0) {
        fprintf(stderr, "posix: give the port of a probe that nobody else reads\n");
        return 1;
    }
    struct termios settings;
    if (tcgetattr(port, &settings) == 0) {  // else it is no serial port
        cfmakeraw(&settings);
        cfsetspeed(&settings, B500000);  // 500,000 baud
        tcsetattr(port, TCSANOW, &settings);
    }
    struct imuprobe_reader reader;
    struct imuprobe_message message;
    uint8_t bytes[256];
    imuprobe_begin(&reader);
    for (ssize_t got; (got = read(port, bytes, sizeof bytes)) > 0;) {
        for (ssize_t i = 0; i < got; ++i) {
            switch (imuprobe_read(&reader, bytes[i], &message)) {
            case IMUPROBE_OTHER_SCHEMA:
                fprintf(stderr, "posix: the probe has another schema, 0x%08lx\n",
                        (unsigned long)reader.schema);
                return 1;
            case IMUPROBE_MESSAGE:
                show(&reader, &message);
                if (reader.messages == 1) {  // its first hello
                    uint8_t frame[IMUPROBE_COMMAND_MAX];
                    const uint8_t length =
                        imuprobe_command(&reader, IMUPROBE_COMMAND_START, 0, 0, frame);
                    if (write(port, frame, length) != length) {
                        return 1;
                    }
                }
                break;
            default:
                break;
            }
        }
    }
    return 0;
}
