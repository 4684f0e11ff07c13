// SPDX-License-Identifier: MIT
// Prints the poses of a probe that streams, on Windows; nobody has run it there:
//
//     cl windows.c imuprobe.c && windows COM5

#include <windows.h>

#include "show.h"

int main(int count, char **words) {
    char name[64];
    snprintf(name, sizeof name, "\\\\.\\%s", count == 2 ? words[1] : "COM1");
    const HANDLE port = CreateFileA(name, GENERIC_READ | GENERIC_WRITE, 0, NULL,
                                    OPEN_EXISTING, 0, NULL);
    DCB settings = {.DCBlength = sizeof settings};
    if (port == INVALID_HANDLE_VALUE || !GetCommState(port, &settings)) {
        fprintf(stderr, "windows: give the port of a probe that nobody else reads\n");
        return 1;
    }
    settings.BaudRate = 500000;
    settings.ByteSize = 8;
    settings.Parity = NOPARITY;
    settings.StopBits = ONESTOPBIT;
    COMMTIMEOUTS timeouts = {.ReadIntervalTimeout = 10};
    SetCommState(port, &settings);
    SetCommTimeouts(port, &timeouts);
    struct imuprobe_reader reader;
    struct imuprobe_message message;
    uint8_t bytes[256];
    DWORD got = 0;
    imuprobe_begin(&reader);
    while (ReadFile(port, bytes, sizeof bytes, &got, NULL)) {
        for (DWORD i = 0; i < got; ++i) {
            if (imuprobe_read(&reader, bytes[i], &message) == IMUPROBE_MESSAGE) {
                show(&reader, &message);
            }
        }
    }
    return 0;
}
