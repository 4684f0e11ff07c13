// SPDX-License-Identifier: MIT
// Gives a fuzz target the files it is called with, one after the other: a corpus needs
// no fuzzer to be run again.
#include "fuzz.h"

enum { INPUT_MAX = 65536 };

int main(int count, char **paths) {
    for (int i = 1; i < count; ++i) {
        FILE *file = fopen(paths[i], "rb");
        if (file == NULL) {
            perror(paths[i]);
            return 2;
        }
        static uint8_t room[INPUT_MAX];
        const size_t size = fread(room, 1, sizeof room, file);
        fclose(file);
        // On the heap and no longer than it is: one byte beyond would be seen.
        uint8_t *data = malloc(size + (size == 0));
        for (size_t at = 0; at < size; ++at) {
            data[at] = room[at];
        }
        LLVMFuzzerTestOneInput(data, size);
        free(data);
    }
    printf("%d inputs\n", count - 1);
    return 0;
}
