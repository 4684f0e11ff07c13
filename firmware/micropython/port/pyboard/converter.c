// SPDX-License-Identifier: MIT
// machine.ADC: the battery's pin, X19. adc_init() of firmware/stm32 has set it up.
#include <string.h>

#include "cpu.h"
#include "gpio.h"
#include "objects.h"
#include "pins.h"
#include "py/mperrno.h"
#include "py/runtime.h"

enum {
    CHANNEL_X19 = 10,
    TURNS_MAX = 2000,  // a conversion takes 3900 cycles, a turn four and more
};

static const mp_obj_base_t x19 = {&pyboard_adc_type};

// ADC("X19"): the only one.
static mp_obj_t make_new(const mp_obj_type_t *type, size_t n_args, size_t n_kw,
                         const mp_obj_t *args) {
    (void)type;
    mp_arg_check_num(n_args, n_kw, 1, 1, false);
    if (strcmp(mp_obj_str_get_str(args[0]), "X19") != 0) {
        mp_raise_ValueError(MP_ERROR_TEXT("this board has ADC('X19')"));
    }
    gpio_set_mode(GPIOC, PIN_BATTERY, GPIO_ANALOG);
    return MP_OBJ_FROM_PTR(&x19);
}

// read_u16(): 0 to 65535, of 12 bits.
static mp_obj_t read_u16(mp_obj_t object) {
    (void)object;
    ADC1->sqr3 = CHANNEL_X19;
    ADC1->cr2 = ADC_CR2_ADON | ADC_CR2_SWSTART;
    for (uint16_t i = 0; i < TURNS_MAX; i++) {
        if ((ADC1->sr & ADC_SR_EOC) != 0) {
            const uint32_t counts = ADC1->dr;
            return MP_OBJ_NEW_SMALL_INT(counts << 4 | counts >> 8);
        }
    }
    mp_raise_OSError(MP_ETIMEDOUT);
}
static MP_DEFINE_CONST_FUN_OBJ_1(read_u16_obj, read_u16);

static const mp_rom_map_elem_t table[] = {
    {MP_ROM_QSTR(MP_QSTR_read_u16), MP_ROM_PTR(&read_u16_obj)},
};
static MP_DEFINE_CONST_DICT(dict, table);

MP_DEFINE_CONST_OBJ_TYPE(pyboard_adc_type, MP_QSTR_ADC, MP_TYPE_FLAG_NONE, make_new,
                         make_new, locals_dict, &dict);
