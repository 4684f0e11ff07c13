// SPDX-License-Identifier: MIT
// See letters.h.
#include "letters.h"

static char line[120];
static uint8_t used;

void put(const char *text) {
    for (; *text != '\0' && used < sizeof line; text++) {
        line[used++] = *text;
    }
}

void put_number(int32_t value) {
    char digits[12];
    uint8_t at = sizeof digits;
    uint32_t rest = value < 0 ? (uint32_t)-value : (uint32_t)value;
    digits[--at] = '\0';
    do {
        digits[--at] = (char)('0' + rest % 10);
        rest /= 10;
    } while (rest != 0);
    put(value < 0 ? " -" : " ");
    put(digits + at);
}

void put_hex(const uint8_t *bytes, uint8_t length) {
    static const char digits[] = "0123456789abcdef";
    put(" ");
    for (uint8_t i = 0; i < length; i++) {
        const char pair[] = {digits[bytes[i] >> 4], digits[bytes[i] & 15], '\0'};
        put(pair);
    }
}

void end_line(void) {
    put("\n");
    while (!board_send((const uint8_t *)line, used)) {
        letters_rest();
    }
    used = 0;
}

void say(const char *text) {
    put(text);
    end_line();
}

static void tell(const char *word, int32_t value) {
    put(word);
    put_number(value);
    end_line();
}

void read_registers(uint8_t address, uint8_t reg, uint8_t length) {
    uint8_t bytes[8] = {0};
    const IN_FLASH struct bus_device *bus = &board_bus;
    const uint32_t begun = board_time_us();
    const enum bus_result result = bus->read(bus->port, address, reg, bytes, length);
    const uint32_t took = board_time_us() - begun;
    put("read");
    put_number(result);
    put_hex(bytes, length);
    put_number((int32_t)took);
    end_line();
}

static void recover(void) {
    const uint32_t begun = board_time_us();
    const enum bus_result result = board_bus_recover();
    const uint32_t took = board_time_us() - begun;
    put("recover");
    put_number(result);
    put_number((int32_t)took);
    end_line();
}

static void set_sensor_up(void) {
    enum bus_result results[2];
    letters_sensor.set_up(results);
    put("set up");
    put_number(results[0]);
    put_number(results[1]);
    end_line();
}

void start_sampling(const struct bus_burst *bursts, uint8_t count) {
    board_sampling_start(bursts, count);
    say("started");
}

static void take_all(void) {
    struct reading sample;
    int32_t taken = 0;
    int32_t missed = 0;
    enum reading_result result = board_reading_take(&sample);
    for (; result == READING_OK; result = board_reading_take(&sample)) {
        taken++;
        missed += sample.missed;
    }
    put("took");
    put_number(taken);
    put_number(missed);
    put_number((int32_t)board_samples_ready());
    put_number(result < 0 ? -1 : result);
    put_number(result < 0 ? result : 0);
    end_line();
}

static void one_sample(void) {
    struct reading sample;
    while (board_reading_take(&sample) != READING_OK) {
        board_idle();
    }
    put("sample");
    put_hex(sample.bytes, letters_sensor.sample_bytes);
    put_number((int32_t)sample.time_us);
    put_number(sample.missed);
    put_number((int32_t)board_samples_ready());
    end_line();
}

void wait_us(uint32_t us) {
    const uint32_t begun = board_time_us();
    while (board_time_us() - begun < us) {
        board_watchdog_kick();
    }
}

void await_idle_wire(void) {
    while (!board_send_is_idle()) {
        letters_rest();
    }
}

static void use_memory(void) {
    const IN_FLASH struct memory *memory = &board_memory;
    int32_t differences = 0;
    uint32_t longest = 0;
    for (uint16_t offset = 100; offset < 120; offset++) {
        const uint32_t begun = board_time_us();
        memory->write(memory->port, offset, (uint8_t)(offset * 7));
        const uint32_t took = board_time_us() - begun;
        longest = took > longest ? took : longest;
        while (!memory->is_ready(memory->port)) {
            board_watchdog_kick();
        }
    }
    for (uint16_t offset = 100; offset < 120; offset++) {
        if (memory->read(memory->port, offset) != (uint8_t)(offset * 7)) {
            differences++;
        }
    }
    put("stored");
    put_number(differences);
    put_number(memory->read(memory->port, 120));
    put_number((int32_t)longest);
    end_line();
}

__attribute__((noinline)) static void go_deep(void) {
    volatile uint8_t bytes[300];
    for (uint16_t i = 0; i < sizeof bytes; i++) {
        bytes[i] = 0;
    }
}

static void measure_stack(void) {
    put("stack");
    put_number(board_stack_free());
    go_deep();
    put_number(board_stack_free());
    end_line();
}

bool obey_common(char letter) {
    const struct letters_sensor *sensor = &letters_sensor;
    switch (letter) {
    case 'r':
        read_registers(sensor->address, sensor->who_am_i, 1);
        return true;
    case 'n':
        read_registers(sensor->absent, sensor->who_am_i, 1);
        return true;
    case 'v':
        recover();
        return true;
    case 'u':
        set_sensor_up();
        return true;
    case 's':
        start_sampling(sensor->bursts, sensor->bursts_count);
        return true;
    case 'p':
        board_sampling_stop();
        say("stopped");
        return true;
    case 't':
        take_all();
        return true;
    case 'o':
        one_sample();
        return true;
    case 'w':
        wait_us(52000);
        say("waited");
        return true;
    case 'l':
        tell("lost", board_receive_lost());
        return true;
    case 'e':
        use_memory();
        return true;
    case 'm':
        tell("supply", board_supply_mv());
        return true;
    case 'd':
        measure_stack();
        return true;
    case 'b':
        tell("button", board_button_is_down());
        return true;
    default:
        return false;
    }
}

_Noreturn void obey_for_ever(void (*obey)(char letter)) {
    for (;;) {
        board_watchdog_kick();
        const int16_t byte = board_receive();
        if (byte < 0) {
            letters_rest();
        } else if (!obey_common((char)byte)) {
            obey((char)byte);
        }
    }
}
