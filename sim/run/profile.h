// SPDX-License-Identifier: MIT
// Attributes each cycle to a function of the image and to an interrupt, sample by
// sample. A sample is what the firmware marks, as in the summary.
//
// Calls, returns and interrupts, reported by the emulator of the processor, are
// followed on a stack of our own. An interrupt counts for itself alone, never for what
// it interrupted.
#ifndef SIM_RUN_PROFILE_H
#define SIM_RUN_PROFILE_H

#include <stdbool.h>
#include <stdint.h>

struct profile;

// Since power-up; of `cycle`, those spent asleep.
struct profile_time {
    uint64_t cycle, asleep;
};

// Byte addresses: of the call or the interrupted instruction, of what was called, where
// it returns to, and of the stack's top before it.
struct profile_call {
    uint32_t from, entry, back, sp;
};

// Profiles an image whose code lies at these bytes. Null where it has no symbols of
// code.
struct profile *profile_new(const char *image, uint32_t start, uint32_t size);
void profile_free(struct profile *profile);

// Assigns the instruction at an address to the function of another.
void profile_same(struct profile *profile, uint32_t address, uint32_t as);

// The instruction at that address has been executed; if it was a call or a return, that
// is reported after it. An interrupt is entered between two instructions.
void profile_instruction(struct profile *profile, uint32_t address,
                         struct profile_time now);
void profile_call(struct profile *profile, struct profile_call call);
void profile_interrupt(struct profile *profile, struct profile_call call,
                       struct profile_time now);
// All calls made deeper on the stack are over, however they ended.
void profile_return_above(struct profile *profile, uint32_t sp);
// The processor went to that address with that stack pointer. If a call returns so, it
// is over, with all calls below it; otherwise it was a jump and nothing happens.
void profile_return_to(struct profile *profile, uint32_t address, uint32_t sp);
// The innermost interrupt is over.
void profile_leave(struct profile *profile);

// The work on a sample begins; is done; is abandoned because of a reset.
void profile_begin_sample(struct profile *profile);
void profile_end_sample(struct profile *profile);
void profile_reset(struct profile *profile, struct profile_time now);

// Writes the profile as JSON. False where the file can't be written.
bool profile_write(struct profile *profile, const char *path);

#endif
