// SPDX-License-Identifier: MIT
// The RP2040 of a Raspberry Pi Pico as a whole: start-up of its parts, identity,
// supply, sleep.
#include "../board.h"

#include "core/drivers/adafruit_4517.h"
#include "core/drivers/mpu9250.h"
#include "core/wire/messages.h"
#include "flash.h"
#include "generic/identity.h"
#include "hardware/adc.h"
#include "hardware/gpio.h"
#include "hardware/sync.h"
#include "hardware/timer.h"
#include "idle.h"
#include "pico/unique_id.h"
#include "pins.h"
#include "reset.h"
#include "sampling.h"
#include "wire.h"

enum {
    STACK_PAINT = 0x5AC4A11C,
    ADC_COUNTS = 4096,
    REFERENCE_MV = 3300,
    VSYS_DIVIDER = 3,
    VSYS_COUNTS_MIN = 370,  // half of what the least supply gives, 1.8 V
    VSYS_SETTLE_US = 1000,
    SUPPLY_UNKNOWN = UINT16_MAX,
};

// A Pico W: the LED's pin selects the radio, and connects VSYS to its pin while high,
// as its users report; no document was at hand.
static bool has_radio;

extern uint32_t __StackBottom;  // of the linker script

// The sensor of this board: an MPU-9250 with its address pin low, or else a module of
// two chips, which have other addresses.
static struct joined module = {.config = &lsm6dsv16x_lis3mdl};
static const struct sensor_driver pair = JOINED_DRIVER(&module, joined_begin);
static struct mpu9250 chip;
const IN_FLASH struct sensor_driver board_sensor =
    MPU9250_DRIVER(&chip, .or_else = &pair);

// From the bottom to where this function's own begins.
static void paint_stack(void) {
    const uint32_t *const end = __builtin_frame_address(0);
    for (volatile uint32_t *word = &__StackBottom; word < end - 16; word++) {
        *word = STACK_PAINT;
    }
}

static void pins_init(void) {
    gpio_init(PIN_LED);
    gpio_set_dir(PIN_LED, GPIO_OUT);
    gpio_init(PIN_BUTTON);
    gpio_pull_up(PIN_BUTTON);
    adc_init();
    adc_gpio_init(PIN_VSYS);
    adc_select_input(ADC_VSYS);
    busy_wait_us(VSYS_SETTLE_US);
    const bool is_off = adc_read() < VSYS_COUNTS_MIN;
    gpio_put(PIN_LED, true);
    busy_wait_us(VSYS_SETTLE_US);
    has_radio = is_off && adc_read() >= VSYS_COUNTS_MIN;
    gpio_put(PIN_LED, has_radio);  // which it then leaves alone
}

void board_init(void) {
    reset_init();
    paint_stack();
    pins_init();
    flash_init();
    sampling_init();
    wire_init();
    // A transfer that a reset cut short. A bus that stays held shows at the first
    // transfer.
    const enum bus_result freed = board_bus_recover();
    (void)freed;
    reset_watch();
}

uint32_t board_time_us(void) {
    return time_us_32();
}

uint8_t board_kind(void) {
    return BOARD_PICO;
}

uint8_t board_cycles_per_us(void) {
    return SYS_CLK_MHZ;
}

// As the firmware in MicroPython: machine.unique_id() has the same bytes.
bool board_unique_id(uint8_t id[8]) {
    pico_unique_board_id_t own;
    pico_get_unique_board_id(&own);
    identity_fold(own.id, sizeof own.id, id);
    return true;
}

uint16_t board_entropy(void) {
    return 0;  // it has an id
}

// As it was, while USB borrows the pin: CMakeLists.txt.
bool board_button_is_down(void) {
    static bool is_down;
    if (gpio_get_function(PIN_BUTTON) == GPIO_FUNC_SIO) {
        is_down = !gpio_get(PIN_BUTTON);
    }
    return is_down;
}

void board_led_set(bool on) {
    gpio_put(PIN_LED, on || has_radio);
}

// What feeds the board, by USB or a battery: 1.8 to 5.5 V.
uint16_t board_supply_mv(void) {
    if (has_radio) {
        return SUPPLY_UNKNOWN;
    }
    return (uint16_t)((uint32_t)adc_read() * REFERENCE_MV * VSYS_DIVIDER / ADC_COUNTS);
}

uint16_t board_stack_free(void) {
    uint16_t bytes = 0;
    for (const uint32_t *word = &__StackBottom; *word == STACK_PAINT; word++) {
        bytes = (uint16_t)(bytes + sizeof *word);
    }
    return bytes;
}

// Until an interrupt brings work; the tick of 1 ms does, so that USB is moved on.
void board_idle(void) {
    while (!idle_has_work) {
        const uint32_t mask = save_and_disable_interrupts();
        if (!idle_has_work) {
            __wfi();  // ends at an interrupt, masked or not
        }
        restore_interrupts(mask);
    }
    idle_has_work = false;
}

void board_pause(void) {
    board_idle();
}
