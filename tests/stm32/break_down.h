// SPDX-License-Identifier: MIT
// What must end in a reset, by the letter that test_board.py sends for it.
#ifndef BREAK_DOWN_H
#define BREAK_DOWN_H

void break_down(char letter);

#endif
