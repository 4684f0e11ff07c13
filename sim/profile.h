// SPDX-License-Identifier: MIT
// Whose each cycle is: by function of the image, by part, by interrupt, sample for
// sample. A sample is what the firmware marks, as in the summary.
//
// Calls, returns and interrupts are followed on a stack of our own; who runs the
// processor tells of them. A part is a set of addresses; what belongs to none, such as
// shared arithmetic, counts for the part that called it. An interrupt counts for itself
// alone, never for what it interrupted.
#ifndef SIM_PROFILE_H
#define SIM_PROFILE_H

#include <stdbool.h>
#include <stdint.h>

struct profile;

// Since power-up; of `cycle`, those spent asleep.
struct profile_time {
    uint64_t cycle, asleep;
};

// Addresses of bytes: of the call or of what was interrupted, of what was called, where
// it returns to, and of the stack's top before it.
struct profile_call {
    uint32_t from, entry, back, sp;
};

// Of an image whose code lies there. Null where it has no symbols of code.
struct profile *profile_new(const char *image, uint32_t start, uint32_t size);
void profile_free(struct profile *profile);

// From a text file of lines `START END PART`: addresses of bytes of code as hexadecimal
// numbers, END not included; `-` is the part of the caller. What no line has is of the
// part `rest`. False where it can't be read.
bool profile_read_parts(struct profile *profile, const char *path);

// The instruction at that address is of the function and part of another.
void profile_same(struct profile *profile, uint32_t address, uint32_t as);

// The instruction at that address has been executed; then, where it was one of those, a
// call, or a return. An interrupt enters between two of them.
void profile_instruction(struct profile *profile, uint32_t address,
                         struct profile_time now);
void profile_call(struct profile *profile, struct profile_call call);
void profile_interrupt(struct profile *profile, struct profile_call call,
                       struct profile_time now);
// Whatever was called from deeper on the stack is over, however it ended.
void profile_return_above(struct profile *profile, uint32_t sp);
// It went there with the stack as it is: the call that comes back so is over, with all
// that it has called. Nothing happens where there is none: it was a jump.
void profile_return_to(struct profile *profile, uint32_t address, uint32_t sp);
// The innermost interrupt is over.
void profile_leave(struct profile *profile);

// A sample's work begins, is done, will never be done.
void profile_begin_sample(struct profile *profile);
void profile_end_sample(struct profile *profile);
void profile_reset(struct profile *profile, struct profile_time now);

// JSON. False where the file can't be written.
bool profile_write(struct profile *profile, const char *path);

#endif
