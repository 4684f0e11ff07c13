// SPDX-License-Identifier: MIT
// One phase after the other, none of which waits; see rn41.h.
#include "core/drivers/rn41.h"

#include <stddef.h>
#include <string.h>

#define MS UINT32_C(1000)

enum {
    // Of the processor in it: reset after 1.5 to 4 ms, 5 ms recommended (BlueCore4
    // data sheet, "RESETB").
    PULSE_US = 10 * MS,
    LOOK_US = 50 * MS,     // for a sign of a module, before the wire is a cable
    STEADY_US = 20 * MS,   // a level of PIO2 counts after
    SHOWN_US = 3000 * MS,  // a module known to be there shows itself again
    // $$$ counts with nothing in the second before and the second after ("Command Mode
    // vs. Data Mode", "$$$"). A module that has just started has heard nothing yet.
    SETTLE_US = 100 * MS,
    SILENCE_US = 1200 * MS,
    ENTRY_US = 1300 * MS,
    ANSWER_US = 1000 * MS,  // a setting goes to flash
    QUIET_US = 100 * MS,    // a list is over
    LIST_US = 3000 * MS,    // whatever it is
    REBOOT_US = 500 * MS,   // before it shows itself again
    PAUSE_US = 1000 * MS,
    LONG_PAUSE_US = 30000 * MS,
    TRIES = 4,        // both rates twice: the first may come too early
    EARLY_PEERS = 3,  // rejected
    ATTEMPTS = 3,     // before it is a fault
    REWRITES = 4,     // its flash wears
    PER_STEP = 255,   // bytes taken
};

enum phase {
    PHASE_PULSE = 0,
    PHASE_LOOK,
    PHASE_SILENCE,
    PHASE_ENTER,
    PHASE_BASIC,
    PHASE_EXTENDED,
    PHASE_CORRECT,
    PHASE_REBOOT,
    PHASE_LEAVE,
    PHASE_PAUSE,
    PHASE_SERVE,
};

enum {
    NAME = 1,
    BAUD = 2,
    MODE = 4,
    BASIC = NAME | BAUD | MODE,
    TIMER = 8,
};

enum {
    ANSWER_CMD = 1,
    ANSWER_AOK = 2,
    ANSWER_END = 4,
};

void rn41_name(char name[RN41_NAME_SIZE], const uint8_t id[8]) {
    static const char start[] = "imu-probe-";
    uint8_t at = sizeof start - 1;
    memcpy(name, start, at);
    for (uint8_t i = 6; i < 8; i++) {
        const uint8_t halves[2] = {id[i] / 16, id[i] % 16};
        for (uint8_t j = 0; j < 2; j++) {
            const uint8_t digit = halves[j];
            name[at] = (char)(digit < 10 ? '0' + digit : 'a' - 10 + digit);
            at++;
        }
    }
    name[at] = '\0';
}

static uint8_t length_of(const char *text) {
    uint8_t length = 0;
    while (text[length] != '\0') {
        length++;
    }
    return length;
}

static bool starts_with(const char *text, const char *start) {
    for (; *start != '\0'; text++, start++) {
        if (*text != *start) {
            return false;
        }
    }
    return true;
}

static bool equals(const char *text, const char *other) {
    return starts_with(text, other) && text[length_of(other)] == '\0';
}

static void say(const struct rn41 *rn41, const char *text) {
    rn41->port->send(text, length_of(text));
}

static void enter(struct rn41 *rn41, enum phase phase, uint32_t now_us) {
    rn41->phase = (uint8_t)phase;
    rn41->since_us = now_us;
    rn41->answer = 0;
}

// Sends what begins the phase.
static void ask(struct rn41 *rn41, enum phase phase, const char *text,
                uint32_t now_us) {
    enter(rn41, phase, now_us);
    rn41->heard_us = now_us;
    say(rn41, text);
}

void rn41_begin(struct rn41 *rn41, const struct rn41_port *port, const char *name,
                uint32_t now_us) {
    *rn41 = (struct rn41){.port = port, .state = RN41_LOOKING, .rewrites = REWRITES};
    for (uint8_t i = 0; i < RN41_NAME_SIZE - 1 && name[i] != '\0'; i++) {
        rn41->name[i] = name[i];
    }
    port->set_baud(RN41_BAUD);
    port->hold_reset(true);
    enter(rn41, PHASE_PULSE, now_us);
}

static enum rn41_event fail(struct rn41 *rn41, enum rn41_fault fault, uint32_t now_us) {
    const bool is_told = rn41->state == RN41_FAILED;
    rn41->fault = fault;
    enter(rn41, PHASE_PAUSE, now_us);
    if (rn41->attempts < ATTEMPTS) {
        rn41->attempts++;
    }
    if (rn41->attempts < ATTEMPTS || is_told) {
        return RN41_NOTHING;
    }
    rn41->state = RN41_FAILED;
    return RN41_FAULT;
}

// A reported setting, "Baudrt(SW4)=115K": which it is, and whether it is right. Modes
// are reported as words, the one that SM,0 sets as "Slav".
static void take_setting(struct rn41 *rn41) {
    const char *value = rn41->line;
    for (; *value != '='; value++) {
        if (*value == '\0') {
            return;
        }
    }
    value++;
    uint8_t setting = 0;
    bool is_right = false;
    if (starts_with(rn41->line, "BTName")) {
        setting = NAME;
        is_right = equals(value, rn41->name);
    } else if (starts_with(rn41->line, "Baudrt")) {
        setting = BAUD;
        is_right = starts_with(value, "92");  // two characters tell it ("SU")
    } else if (starts_with(rn41->line, "Mode")) {
        setting = MODE;
        is_right = starts_with(value, "Slav");
    } else if (starts_with(rn41->line, "CfgTimer")) {
        setting = TIMER;
        is_right = equals(value, "0");
    }
    rn41->known |= setting;
    if (!is_right) {
        rn41->wrong |= setting;
    }
}

// Noise may come before an answer: its end counts.
static bool line_ends_with(const struct rn41 *rn41, const char *end) {
    const uint8_t length = length_of(end);
    return rn41->length >= length && equals(rn41->line + rn41->length - length, end);
}

static void take_line(struct rn41 *rn41) {
    rn41->line[rn41->length] = '\0';
    if (line_ends_with(rn41, "CMD")) {
        rn41->answer |= ANSWER_CMD;
    } else if (line_ends_with(rn41, "AOK")) {
        rn41->answer |= ANSWER_AOK;
    } else if (line_ends_with(rn41, "END")) {
        rn41->answer |= ANSWER_END;
    }
    if (rn41->phase == PHASE_BASIC || rn41->phase == PHASE_EXTENDED) {
        take_setting(rn41);
    }
    rn41->length = 0;
}

static void listen(struct rn41 *rn41, uint32_t now_us) {
    for (uint8_t i = 0; i < PER_STEP; i++) {
        const int16_t byte = rn41->port->receive();
        if (byte < 0) {
            return;
        }
        rn41->heard_us = now_us;
        if (byte == '\n') {
            take_line(rn41);
            if (rn41->phase == PHASE_LEAVE && (rn41->answer & ANSWER_END) != 0) {
                return;  // what follows is the host's
            }
        } else if (byte != '\r' && rn41->length < sizeof rn41->line - 1) {
            rn41->line[rn41->length] = (char)byte;
            rn41->length++;
        }
    }
}

static bool has_passed(const struct rn41 *rn41, uint32_t us, uint32_t now_us) {
    return now_us - rn41->since_us >= us;
}

// As PIO2 stands and has stood.
static bool is_steadily(const struct rn41 *rn41, bool is_linked, uint32_t now_us) {
    return rn41->is_linked == is_linked && now_us - rn41->linked_us >= STEADY_US;
}

static void look_at_link(struct rn41 *rn41, uint32_t now_us) {
    const bool is_linked = rn41->port->is_linked();
    if (is_linked != rn41->is_linked) {
        rn41->is_linked = is_linked;
        rn41->linked_us = now_us;
    }
}

// While a module starts its pin floats: it counts from the next time that it is low.
static void look_for_it(struct rn41 *rn41, uint32_t now_us) {
    rn41->is_linked = true;
    rn41->linked_us = now_us;
    enter(rn41, PHASE_LOOK, now_us);
}

// Begins with what leads into command mode.
static void configure(struct rn41 *rn41, bool is_fresh, uint32_t now_us) {
    if (rn41->state != RN41_FAILED) {
        rn41->state = RN41_CONFIGURING;
    }
    rn41->tries = 0;
    rn41->is_fresh = is_fresh;
    rn41->port->set_baud(RN41_BAUD);
    enter(rn41, PHASE_SILENCE, now_us);
}

static void restart(struct rn41 *rn41, uint32_t now_us) {
    if (rn41->resets < UINT16_MAX) {
        rn41->resets++;
    }
    rn41->port->set_baud(RN41_BAUD);
    rn41->port->hold_reset(true);
    enter(rn41, PHASE_PULSE, now_us);
}

static enum rn41_event connect(struct rn41 *rn41, uint32_t now_us) {
    rn41->port->set_baud(RN41_BAUD);
    rn41->state = RN41_CONNECTED;
    enter(rn41, PHASE_SERVE, now_us);
    return RN41_LINKED;
}

static enum rn41_event look(struct rn41 *rn41, uint32_t now_us) {
    if (is_steadily(rn41, false, now_us)) {
        configure(rn41, true, now_us);
        return RN41_NOTHING;
    }
    if (rn41->state == RN41_LOOKING) {
        if (has_passed(rn41, LOOK_US, now_us)) {
            rn41->state = RN41_CABLE;
        }
    } else if (rn41->state != RN41_CABLE && has_passed(rn41, SHOWN_US, now_us)) {
        return connect(rn41, now_us);
    }
    return RN41_NOTHING;
}

// A host has connected before the settings are known, and $$$ may reach it as data. A
// reset disconnects it; one that returns each time is served without a set-up.
static enum rn41_event reject_early_peer(struct rn41 *rn41, uint32_t now_us) {
    if (rn41->early_peers == EARLY_PEERS) {
        return connect(rn41, now_us);
    }
    rn41->early_peers++;
    restart(rn41, now_us);
    return RN41_NOTHING;
}

// At the other rate each time, also after each early peer, as there may be only one
// try.
static void try_entry(struct rn41 *rn41, uint32_t now_us) {
    const bool is_ours = (rn41->tries + rn41->early_peers) % 2 == 0;
    rn41->port->set_baud(is_ours ? RN41_BAUD : RN41_FACTORY_BAUD);
    rn41->length = 0;
    ask(rn41, PHASE_ENTER, "$$$", now_us);
}

static enum rn41_event be_silent(struct rn41 *rn41, uint32_t now_us) {
    if (is_steadily(rn41, true, now_us)) {
        return reject_early_peer(rn41, now_us);
    }
    if (!rn41->is_linked &&
        has_passed(rn41, rn41->is_fresh ? SETTLE_US : SILENCE_US, now_us)) {
        try_entry(rn41, now_us);
    }
    return RN41_NOTHING;
}

static enum rn41_event enter_command_mode(struct rn41 *rn41, uint32_t now_us) {
    if ((rn41->answer & ANSWER_CMD) != 0) {
        rn41->known = 0;
        rn41->wrong = 0;
        ask(rn41, PHASE_BASIC, "D\r", now_us);
        return RN41_NOTHING;
    }
    if (!has_passed(rn41, ENTRY_US, now_us)) {
        return RN41_NOTHING;
    }
    if (is_steadily(rn41, true, now_us)) {
        return reject_early_peer(rn41, now_us);
    }
    rn41->tries++;
    if (rn41->tries == TRIES) {
        return fail(rn41, RN41_SILENT, now_us);
    }
    try_entry(rn41, now_us);
    return RN41_NOTHING;
}

// Asks for the first setting that is wrong.
static void correct(struct rn41 *rn41, uint32_t now_us) {
    if ((rn41->wrong & NAME) != 0) {
        ask(rn41, PHASE_CORRECT, "SN,", now_us);
        say(rn41, rn41->name);
        say(rn41, "\r");
    } else if ((rn41->wrong & BAUD) != 0) {
        ask(rn41, PHASE_CORRECT, "SU,921K\r", now_us);
    } else if ((rn41->wrong & MODE) != 0) {
        ask(rn41, PHASE_CORRECT, "SM,0\r", now_us);
    } else {
        ask(rn41, PHASE_CORRECT, "ST,0\r", now_us);
    }
}

static enum rn41_event judge_settings(struct rn41 *rn41, uint32_t now_us) {
    if (rn41->wrong == 0) {
        ask(rn41, PHASE_LEAVE, "---\r", now_us);
        return RN41_NOTHING;
    }
    if (rn41->is_corrected || rn41->rewrites == 0) {
        return fail(rn41, RN41_REFUSED, now_us);
    }
    rn41->rewrites--;
    rn41->is_corrected = true;
    correct(rn41, now_us);
    return RN41_NOTHING;
}

// A list has no end mark: it ends when all is sent and nothing more comes.
static enum rn41_event take_list(struct rn41 *rn41, uint8_t wanted, uint32_t now_us) {
    if ((rn41->known & wanted) != wanted || now_us - rn41->heard_us < QUIET_US) {
        return has_passed(rn41, LIST_US, now_us) ? fail(rn41, RN41_GARBLED, now_us)
                                                 : RN41_NOTHING;
    }
    if (rn41->phase == PHASE_BASIC) {
        ask(rn41, PHASE_EXTENDED, "E\r", now_us);
        return RN41_NOTHING;
    }
    return judge_settings(rn41, now_us);
}

static enum rn41_event take_correction(struct rn41 *rn41, uint32_t now_us) {
    if ((rn41->answer & ANSWER_AOK) == 0) {
        return has_passed(rn41, ANSWER_US, now_us) ? fail(rn41, RN41_REFUSED, now_us)
                                                   : RN41_NOTHING;
    }
    rn41->wrong &= (uint8_t)(rn41->wrong - 1);  // that one, the lowest bit set
    if (rn41->wrong != 0) {
        correct(rn41, now_us);
    } else {
        ask(rn41, PHASE_REBOOT, "R,1\r", now_us);
    }
    return RN41_NOTHING;
}

// Settings count from the next start ("Set Commands"). Its answer, "Reboot!", may be
// cut short; whether the start has been shows in the settings.
static enum rn41_event reboot(struct rn41 *rn41, uint32_t now_us) {
    if (has_passed(rn41, REBOOT_US, now_us)) {
        look_for_it(rn41, now_us);
    }
    return RN41_NOTHING;
}

static enum rn41_event leave(struct rn41 *rn41, uint32_t now_us) {
    if ((rn41->answer & ANSWER_END) != 0) {
        rn41->state = RN41_WAITING;
        rn41->is_verified = true;
        rn41->attempts = 0;
        rn41->early_peers = 0;
        rn41->fault = RN41_NO_FAULT;
        enter(rn41, PHASE_SERVE, now_us);
        return RN41_NOTHING;
    }
    return has_passed(rn41, ANSWER_US, now_us) ? fail(rn41, RN41_SILENT, now_us)
                                               : RN41_NOTHING;
}

static enum rn41_event pause(struct rn41 *rn41, uint32_t now_us) {
    if (has_passed(rn41, rn41->attempts < ATTEMPTS ? PAUSE_US : LONG_PAUSE_US,
                   now_us)) {
        rn41->is_corrected = false;
        restart(rn41, now_us);
    }
    return RN41_NOTHING;
}

static enum rn41_event serve(struct rn41 *rn41, uint32_t now_us) {
    if (rn41->state == RN41_WAITING && is_steadily(rn41, true, now_us)) {
        return connect(rn41, now_us);
    }
    if (rn41->state != RN41_CONNECTED || !is_steadily(rn41, false, now_us)) {
        return RN41_NOTHING;
    }
    rn41->state = RN41_WAITING;
    if (!rn41->is_verified) {
        rn41->is_corrected = false;
        configure(rn41, false, now_us);
    }
    return RN41_DROPPED;
}

enum rn41_event rn41_step(struct rn41 *rn41, uint32_t now_us) {
    look_at_link(rn41, now_us);
    if (rn41->state == RN41_CONFIGURING || rn41->state == RN41_FAILED) {
        listen(rn41, now_us);
    }
    switch (rn41->phase) {
    case PHASE_PULSE:
        if (has_passed(rn41, PULSE_US, now_us)) {
            rn41->port->hold_reset(false);
            look_for_it(rn41, now_us);
        }
        return RN41_NOTHING;
    case PHASE_LOOK:
        return look(rn41, now_us);
    case PHASE_SILENCE:
        return be_silent(rn41, now_us);
    case PHASE_ENTER:
        return enter_command_mode(rn41, now_us);
    case PHASE_BASIC:
        return take_list(rn41, BASIC, now_us);
    case PHASE_EXTENDED:
        return take_list(rn41, TIMER, now_us);
    case PHASE_CORRECT:
        return take_correction(rn41, now_us);
    case PHASE_REBOOT:
        return reboot(rn41, now_us);
    case PHASE_LEAVE:
        return leave(rn41, now_us);
    case PHASE_PAUSE:
        return pause(rn41, now_us);
    default:
        return serve(rn41, now_us);
    }
}

bool rn41_carries(const struct rn41 *rn41) {
    return rn41->state == RN41_CABLE || rn41->state == RN41_CONNECTED;
}
