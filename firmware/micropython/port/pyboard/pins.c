// SPDX-License-Identifier: MIT
// machine.Pin, with the names that a pyboard v1.1 prints or MicroPython gives them, and
// the interrupts of its edges.
#include "objects.h"

#include <string.h>

#include "cpu.h"
#include "gpio.h"
#include "idle.h"
#include "py/gc.h"
#include "py/mphal.h"
#include "py/runtime.h"

struct pin {
    mp_obj_base_t base;
    struct gpio *port;
    uint8_t number, port_code;
    mp_obj_t handler;
    bool is_hard;
};

enum { IN = 0, OUT = 1, OPEN_DRAIN = 2, PULL_UP = 1, PULL_DOWN = 2 };
enum { RISING = 1, FALLING = 2, LINES = 16 };

// Of EXTI0 to EXTI4 on their own, then those that share a line of the NVIC.
enum { IRQ_EXTI0 = 6, IRQ_EXTI9_5 = 23, IRQ_EXTI15_10 = 40 };

static const struct {
    const char *name;
    char port;
    uint8_t number;
} names[] = {
    {"X3", 'A', 2},  {"X4", 'A', 3}, {"X9", 'B', 6},       {"X10", 'B', 7},
    {"X17", 'B', 3}, {"SW", 'B', 3}, {"LED_BLUE", 'B', 4}, {"Y11", 'B', 0},
    {"X19", 'C', 0}, {"Y1", 'C', 6}, {"MMA_AVDD", 'B', 5},
};

// One pin of each number can have an interrupt. The pins are MicroPython's to keep.
MP_REGISTER_ROOT_POINTER(mp_obj_t pyboard_pins[16]);

static struct gpio *port_of(char letter) {
    switch (letter) {
    case 'A':
        return GPIOA;
    case 'B':
        return GPIOB;
    case 'C':
        return GPIOC;
    default:
        mp_raise_ValueError(MP_ERROR_TEXT("unknown pin"));
    }
}

// "B6", as the processor has it, or one of the board's names.
static void find(const char *name, char *port, uint8_t *number) {
    for (size_t i = 0; i < MP_ARRAY_SIZE(names); i++) {
        if (strcmp(name, names[i].name) == 0) {
            *port = names[i].port;
            *number = names[i].number;
            return;
        }
    }
    unsigned value = 0;
    *port = name[0];
    for (const char *digit = name + 1; *digit >= '0' && *digit <= '9'; digit++) {
        value = value * 10 + (unsigned)(*digit - '0');
    }
    if (*port == '\0' || name[1] == '\0' || value >= LINES) {
        mp_raise_ValueError(MP_ERROR_TEXT("unknown pin"));
    }
    *number = (uint8_t)value;
}

static void set_up(struct pin *self, size_t n_args, const mp_obj_t *all_args,
                   mp_map_t *kw) {
    enum { MODE, PULL, VALUE };
    static const mp_arg_t allowed[] = {
        {MP_QSTR_mode, MP_ARG_INT, {.u_int = -1}},
        {MP_QSTR_pull, MP_ARG_OBJ, {.u_rom_obj = MP_ROM_NONE}},
        {MP_QSTR_value, MP_ARG_KW_ONLY | MP_ARG_OBJ, {.u_rom_obj = MP_ROM_NONE}},
    };
    mp_arg_val_t args[MP_ARRAY_SIZE(allowed)];
    mp_arg_parse_all(n_args, all_args, kw, MP_ARRAY_SIZE(allowed), allowed, args);
    if (args[VALUE].u_obj != mp_const_none) {
        gpio_set(self->port, self->number, mp_obj_is_true(args[VALUE].u_obj));
    }
    const mp_int_t mode = args[MODE].u_int;
    if (mode < 0) {
        return;
    }
    const mp_int_t pull =
        args[PULL].u_obj == mp_const_none ? 0 : mp_obj_get_int(args[PULL].u_obj);
    gpio_set_pull(self->port, self->number, (enum gpio_pull)pull);
    self->port->otyper = (self->port->otyper & ~BIT(self->number)) |
                         (mode == OPEN_DRAIN ? BIT(self->number) : 0);
    gpio_set_mode(self->port, self->number, mode == IN ? GPIO_INPUT : GPIO_OUTPUT);
}

static mp_obj_t make_new(const mp_obj_type_t *type, size_t n_args, size_t n_kw,
                         const mp_obj_t *args) {
    mp_arg_check_num(n_args, n_kw, 1, MP_OBJ_FUN_ARGS_MAX, true);
    char letter;
    uint8_t number;
    find(mp_obj_str_get_str(args[0]), &letter, &number);
    struct gpio *const port = port_of(letter);
    struct pin *self = mp_obj_malloc(struct pin, type);
    self->port = port;
    self->port_code = (uint8_t)(letter - 'A');
    self->number = number;
    self->handler = mp_const_none;
    self->is_hard = false;
    mp_map_t kw;
    mp_map_init_fixed_table(&kw, n_kw, args + n_args);
    set_up(self, n_args - 1, args + 1, &kw);
    return MP_OBJ_FROM_PTR(self);
}

static mp_obj_t init(size_t n_args, const mp_obj_t *args, mp_map_t *kw) {
    set_up(MP_OBJ_TO_PTR(args[0]), n_args - 1, args + 1, kw);
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_KW(init_obj, 1, init);

static mp_obj_t call(mp_obj_t object, size_t n_args, size_t n_kw,
                     const mp_obj_t *args) {
    mp_arg_check_num(n_args, n_kw, 0, 1, false);
    const struct pin *self = MP_OBJ_TO_PTR(object);
    if (n_args == 0) {
        return MP_OBJ_NEW_SMALL_INT(gpio_is_high(self->port, self->number) ? 1 : 0);
    }
    gpio_set(self->port, self->number, mp_obj_is_true(args[0]));
    return mp_const_none;
}

static mp_obj_t value(size_t n_args, const mp_obj_t *args) {
    return call(args[0], n_args - 1, 0, args + 1);
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(value_obj, 1, 2, value);

// Interrupts

static void run_handler(struct pin *self) {
    if (!self->is_hard) {
        mp_sched_schedule(self->handler, MP_OBJ_FROM_PTR(self));
        return;
    }
    // No allocation: one may be in progress.
    gc_lock();
    mp_sched_lock();
    nlr_buf_t nlr;
    if (nlr_push(&nlr) == 0) {
        (void)mp_call_function_1(self->handler, MP_OBJ_FROM_PTR(self));
        nlr_pop();
    } else {
        self->handler = mp_const_none;  // it would raise its exception for ever
        mp_sched_exception(MP_OBJ_FROM_PTR(nlr.ret_val));
    }
    mp_sched_unlock();
    gc_unlock();
}

void pins_edge(void) {
    const uint32_t lines = EXTI->pr & EXTI->imr;
    EXTI->pr = lines;
    for (uint8_t line = 0; line < LINES; line++) {
        const mp_obj_t object = MP_STATE_PORT(pyboard_pins)[line];
        struct pin *self = MP_OBJ_TO_PTR(object);
        if ((lines & BIT(line)) != 0 && object != MP_OBJ_NULL &&
            self->handler != mp_const_none) {
            run_handler(self);
        }
    }
    idle_has_work = true;
}

static uint8_t irq_of(uint8_t line) {
    if (line < 5) {
        return (uint8_t)(IRQ_EXTI0 + line);
    }
    return line < 10 ? IRQ_EXTI9_5 : IRQ_EXTI15_10;
}

static void watch(struct pin *self, mp_int_t trigger) {
    const uint8_t line = self->number;
    volatile uint32_t *const choice = &SYSCFG->exticr[line / 4];
    EXTI->imr &= ~BIT(line);
    *choice =
        (*choice & ~SYSCFG_EXTICR(line, 0xF)) | SYSCFG_EXTICR(line, self->port_code);
    EXTI->rtsr = (EXTI->rtsr & ~BIT(line)) | ((trigger & RISING) != 0 ? BIT(line) : 0);
    EXTI->ftsr = (EXTI->ftsr & ~BIT(line)) | ((trigger & FALLING) != 0 ? BIT(line) : 0);
    EXTI->pr = BIT(line);
    MP_STATE_PORT(pyboard_pins)[line] = MP_OBJ_FROM_PTR(self);
    irq_enable((enum irq)irq_of(line), PRIORITY_SAMPLING);
    EXTI->imr |= BIT(line);
}

static mp_obj_t irq(size_t n_args, const mp_obj_t *all_args, mp_map_t *kw) {
    enum { HANDLER, TRIGGER, HARD };
    static const mp_arg_t allowed[] = {
        {MP_QSTR_handler, MP_ARG_OBJ, {.u_rom_obj = MP_ROM_NONE}},
        {MP_QSTR_trigger, MP_ARG_INT, {.u_int = RISING | FALLING}},
        {MP_QSTR_hard, MP_ARG_BOOL, {.u_bool = false}},
    };
    mp_arg_val_t args[MP_ARRAY_SIZE(allowed)];
    mp_arg_parse_all(n_args - 1, all_args + 1, kw, MP_ARRAY_SIZE(allowed), allowed,
                     args);
    struct pin *self = MP_OBJ_TO_PTR(all_args[0]);
    self->handler = args[HANDLER].u_obj;
    self->is_hard = args[HARD].u_bool;
    watch(self, self->handler == mp_const_none ? 0 : args[TRIGGER].u_int);
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_KW(irq_obj, 1, irq);

void pins_forget(void) {
    EXTI->imr = 0;
    memset(MP_STATE_PORT(pyboard_pins), 0, sizeof MP_STATE_PORT(pyboard_pins));
}

static const mp_rom_map_elem_t table[] = {
    {MP_ROM_QSTR(MP_QSTR_init), MP_ROM_PTR(&init_obj)},
    {MP_ROM_QSTR(MP_QSTR_value), MP_ROM_PTR(&value_obj)},
    {MP_ROM_QSTR(MP_QSTR_irq), MP_ROM_PTR(&irq_obj)},
    {MP_ROM_QSTR(MP_QSTR_IN), MP_ROM_INT(IN)},
    {MP_ROM_QSTR(MP_QSTR_OUT), MP_ROM_INT(OUT)},
    {MP_ROM_QSTR(MP_QSTR_OPEN_DRAIN), MP_ROM_INT(OPEN_DRAIN)},
    {MP_ROM_QSTR(MP_QSTR_PULL_UP), MP_ROM_INT(PULL_UP)},
    {MP_ROM_QSTR(MP_QSTR_PULL_DOWN), MP_ROM_INT(PULL_DOWN)},
    {MP_ROM_QSTR(MP_QSTR_IRQ_RISING), MP_ROM_INT(RISING)},
    {MP_ROM_QSTR(MP_QSTR_IRQ_FALLING), MP_ROM_INT(FALLING)},
};
static MP_DEFINE_CONST_DICT(dict, table);

MP_DEFINE_CONST_OBJ_TYPE(pyboard_pin_type, MP_QSTR_Pin, MP_TYPE_FLAG_NONE, make_new,
                         make_new, call, call, locals_dict, &dict);
