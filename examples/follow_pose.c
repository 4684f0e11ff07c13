// SPDX-License-Identifier: MIT
// Prints the poses that it reads: imud listen --json | ./follow_pose. Needs a compiler
// alone: cc -o follow_pose follow_pose.c

#include <stdio.h>
#include <string.h>

int main(void) {
    static char line[65536];  // one pose, an object of JSON
    while (fgets(line, sizeof line, stdin) != NULL) {
        char probe[256];
        double w, x, y, z;
        const char *name = strstr(line, "\"probe\":\""), *q = strstr(line, "\"q\":[");
        if (name != NULL && q != NULL && sscanf(name + 9, "%255[^\"]", probe) == 1 &&
            sscanf(q + 5, "%lf,%lf,%lf,%lf", &w, &x, &y, &z) == 4) {
            printf("%s %.6f %.6f %.6f %.6f\n", probe, w, x, y, z);
        }
    }
    return 0;
}
