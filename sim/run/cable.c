// SPDX-License-Identifier: MIT
// A raw pseudo terminal that knows whether a program has it open; see cable.h.
#include "cable.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <stdio.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

static struct termios raw_settings(void) {
    struct termios raw;
    memset(&raw, 0, sizeof raw);
    cfmakeraw(&raw);
    raw.c_cflag |= CREAD | CLOCAL;
    (void)cfsetspeed(&raw, B500000);
    return raw;
}

const char *cable_open(struct cable *cable, const char *link) {
    memset(cable, 0, sizeof *cable);
    cable->master = cable->keeper = cable->watch = -1;
    if (strlen(link) + 16 > sizeof cable->link) {
        return "is too long a path";
    }
    const struct termios raw = raw_settings();
    if (openpty(&cable->master, &cable->keeper, cable->name, &raw, NULL) != 0) {
        return "can't have a pseudo terminal";
    }
    (void)fcntl(cable->master, F_SETFL, O_NONBLOCK);
    (void)fcntl(cable->master, F_SETFD, FD_CLOEXEC);
    (void)fcntl(cable->keeper, F_SETFD, FD_CLOEXEC);
    cable->watch = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
    if (cable->watch >= 0 &&
        inotify_add_watch(cable->watch, cable->name, IN_OPEN | IN_CLOSE) < 0) {
        (void)close(cable->watch);
        cable->watch = -1;
    }
    // A new link takes the place of an old one in one step.
    char fresh[sizeof cable->link];
    (void)snprintf(fresh, sizeof fresh, "%.*s.%ld", (int)(sizeof fresh - 24), link,
                   (long)getpid());
    (void)unlink(fresh);
    if (symlink(cable->name, fresh) != 0 || rename(fresh, link) != 0) {
        (void)unlink(fresh);
        return "can't be made a link to the pseudo terminal";
    }
    (void)snprintf(cable->link, sizeof cable->link, "%s", link);
    return NULL;
}

void cable_close(struct cable *cable) {
    cable_flush(cable);
    char target[sizeof cable->name] = "";
    if (cable->link[0] != '\0' &&
        readlink(cable->link, target, sizeof target - 1) > 0 &&
        strcmp(target, cable->name) == 0) {
        (void)unlink(cable->link);
    }
    const int files[] = {cable->watch, cable->keeper, cable->master};
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        if (files[i] >= 0) {
            (void)close(files[i]);
        }
    }
    cable->watch = cable->keeper = cable->master = -1;
}

// Unread bytes and settings of an earlier listener must not reach a later one. What it
// wrote is still delivered to the board.
static void forget(struct cable *cable) {
    const struct termios raw = raw_settings();
    cable->unheard += cable->held_count;
    cable->held_count = 0;
    (void)tcflush(cable->keeper, TCIFLUSH);
    (void)tcsetattr(cable->keeper, TCSANOW, &raw);
    (void)ioctl(cable->keeper, TIOCNXCL);
}

static void follow_listeners(struct cable *cable) {
    if (cable->watch < 0) {
        cable->listeners = 1;
        return;
    }
    union {
        struct inotify_event event;
        char bytes[4096];
    } got;
    ssize_t length = 0;
    while ((length = read(cable->watch, &got, sizeof got)) > 0) {
        ssize_t at = 0;
        while (at < length) {
            struct inotify_event event;
            memcpy(&event, got.bytes + at, sizeof event);
            at += (ssize_t)(sizeof event + event.len);
            if (event.mask & IN_OPEN) {
                cable->was_opened = cable->was_opened || cable->listeners == 0;
                cable->listeners++;
            } else if ((event.mask & IN_CLOSE) && cable->listeners > 0) {
                cable->listeners--;
                if (cable->listeners == 0) {
                    forget(cable);
                }
            }
        }
    }
}

bool cable_was_opened(struct cable *cable) {
    follow_listeners(cable);
    const bool was_opened = cable->was_opened;
    cable->was_opened = false;
    return was_opened;
}

static void hand_over(struct cable *cable) {
    while (cable->held_count > 0) {
        size_t run = CABLE_HELD - cable->held_head;
        if (run > cable->held_count) {
            run = cable->held_count;
        }
        const ssize_t put = write(cable->master, cable->held + cable->held_head, run);
        if (put <= 0) {
            return;
        }
        cable->held_head = (cable->held_head + (size_t)put) % CABLE_HELD;
        cable->held_count -= (size_t)put;
    }
}

void cable_flush(struct cable *cable) {
    if (cable->master < 0) {
        return;
    }
    follow_listeners(cable);
    if (cable->listeners == 0) {
        cable->unheard += cable->held_count;
        cable->held_count = 0;
    } else {
        hand_over(cable);
    }
}

bool cable_put(struct cable *cable, uint8_t byte, bool waits) {
    while (cable->held_count == CABLE_HELD) {
        cable_flush(cable);
        if (cable->held_count < CABLE_HELD) {
            break;
        }
        if (!waits) {
            cable->dropped++;
            return true;
        }
        struct pollfd ready = {.fd = cable->master, .events = POLLOUT};
        if (poll(&ready, 1, 100) < 0 && errno == EINTR) {
            return false;
        }
    }
    cable->held[(cable->held_head + cable->held_count) % CABLE_HELD] = byte;
    cable->held_count++;
    return true;
}

size_t cable_get(struct cable *cable, uint8_t *bytes, size_t room) {
    const ssize_t got = read(cable->master, bytes, room);
    if (got <= 0) {
        return 0;
    }
    // The program that wrote this may have opened it after another had closed it: what
    // the board answers must come after that was forgotten.
    follow_listeners(cable);
    return (size_t)got;
}
