// SPDX-License-Identifier: MIT
// Whose each cycle is: by function of the image, by part, by interrupt, sample for
// sample. A sample is what the firmware marks by GPIOR0, as in the summary.
//
// Calls, returns and interrupts are followed on a stack of our own. A part is a set of
// addresses; what belongs to none, such as shared arithmetic, counts for the part that
// called it. An interrupt counts for itself alone, never for what it interrupted.
#ifndef SIM_PROFILE_H
#define SIM_PROFILE_H

#include "machine.h"

struct profile;

// Watches the machine, in which the image has been loaded; it runs slower then, and the
// same to the cycle. Null where the image has no symbols of code.
struct profile *profile_new(struct machine *machine, const char *image);
void profile_free(struct profile *profile);

// From a text file of lines `START END PART`: addresses of bytes in flash as
// hexadecimal numbers, END not included; `-` is the part of the caller. What no line
// has is of the part `rest`. False where it can't be read.
bool profile_read_parts(struct profile *profile, const char *path);

// From the machine's callbacks: a sample's work begins, is done, will never be done.
void profile_begin_sample(struct profile *profile);
void profile_end_sample(struct profile *profile);
void profile_reset(struct profile *profile);

// JSON. False where the file can't be written.
bool profile_write(struct profile *profile, const char *path);

#endif
