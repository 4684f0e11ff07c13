// SPDX-License-Identifier: MIT
// The summary of a run.
#ifndef SIM_RUN_SUMMARY_H
#define SIM_RUN_SUMMARY_H

#include <stdbool.h>

#include "run.h"

// Prints the summary and writes it to the file of --summary, if given. False, with a
// message, where that file can't be written.
bool run_summarize(struct run *run, bool is_good);

#endif
