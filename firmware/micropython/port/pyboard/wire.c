// SPDX-License-Identifier: MIT
// machine.UART: USART2 on X3 and X4, by DMA; and MicroPython's own output, which goes
// there too.
#include "cpu.h"
#include "gpio.h"
#include "idle.h"
#include "objects.h"
#include "pins.h"
#include "py/mperrno.h"
#include "py/mphal.h"
#include "py/runtime.h"
#include "py/stream.h"
#include "uart.h"

enum {
    UART = 2,
    PIECE_MAX = 128,     // bytes that uart_send() gets at a time
    PRINT_MS_MAX = 200,  // for a ring that is full to have room again
};

struct uart_object {
    mp_obj_base_t base;
};

static bool is_open;
static int16_t held = -1;  // a byte that was looked for and not yet read

static void open_pin(uint8_t pin) {
    GPIOA->afr[0] |= (uint32_t)ALTERNATE_USART2 << (4 * pin);
    gpio_set_mode(GPIOA, pin, GPIO_ALTERNATE);
}

void wire_open(uint32_t baud) {
    if (is_open) {
        uart_set_baud(baud);
        return;
    }
    open_pin(PIN_TXD);
    open_pin(PIN_RXD);
    gpio_set_pull(GPIOA, PIN_RXD, GPIO_PULL_UP);
    uart_init(baud);
    is_open = true;
}

// UART(2, baud)
static mp_obj_t make_new(const mp_obj_type_t *type, size_t n_args, size_t n_kw,
                         const mp_obj_t *args) {
    mp_arg_check_num(n_args, n_kw, 1, MP_OBJ_FUN_ARGS_MAX, true);
    if (mp_obj_get_int(args[0]) != UART) {
        mp_raise_ValueError(MP_ERROR_TEXT("this board has UART(2)"));
    }
    wire_open(n_args > 1 ? (uint32_t)mp_obj_get_int(args[1]) : WIRE_BAUD);
    return MP_OBJ_FROM_PTR(mp_obj_malloc(struct uart_object, type));
}

static int16_t look(void) {
    if (held < 0) {
        held = uart_receive();
    }
    return held;
}

static mp_uint_t stream_read(mp_obj_t object, void *buffer, mp_uint_t size,
                             int *error) {
    (void)object;
    uint8_t *bytes = buffer;
    mp_uint_t length = 0;
    for (; length < size && look() >= 0; length++) {
        bytes[length] = (uint8_t)held;
        held = -1;
    }
    if (length == 0 && size > 0) {
        *error = MP_EAGAIN;
        return MP_STREAM_ERROR;
    }
    return length;
}

static mp_uint_t stream_write(mp_obj_t object, const void *buffer, mp_uint_t size,
                              int *error) {
    (void)object;
    const uint8_t *bytes = buffer;
    mp_uint_t length = 0;
    while (length < size) {
        const mp_uint_t left = size - length;
        const uint8_t piece = (uint8_t)(left < PIECE_MAX ? left : PIECE_MAX);
        if (!uart_send(bytes + length, piece)) {
            break;
        }
        length += piece;
    }
    if (length == 0 && size > 0) {
        *error = MP_EAGAIN;
        return MP_STREAM_ERROR;
    }
    return length;
}

static mp_uint_t stream_ioctl(mp_obj_t object, mp_uint_t request, uintptr_t flags,
                              int *error) {
    (void)object;
    if (request != MP_STREAM_POLL) {
        *error = MP_EINVAL;
        return MP_STREAM_ERROR;
    }
    mp_uint_t ready = flags & MP_STREAM_POLL_WR;
    if ((flags & MP_STREAM_POLL_RD) != 0 && look() >= 0) {
        ready |= MP_STREAM_POLL_RD;
    }
    return ready;
}

static const mp_stream_p_t stream = {
    .read = stream_read,
    .write = stream_write,
    .ioctl = stream_ioctl,
};

// any(): how many bytes can be read at least.
static mp_obj_t any(mp_obj_t object) {
    (void)object;
    return MP_OBJ_NEW_SMALL_INT(look() >= 0 ? 1 : 0);
}
static MP_DEFINE_CONST_FUN_OBJ_1(any_obj, any);

// txdone(): everything has left.
static mp_obj_t txdone(mp_obj_t object) {
    (void)object;
    return mp_obj_new_bool(uart_is_idle());
}
static MP_DEFINE_CONST_FUN_OBJ_1(txdone_obj, txdone);

static const mp_rom_map_elem_t table[] = {
    {MP_ROM_QSTR(MP_QSTR_read), MP_ROM_PTR(&mp_stream_read_obj)},
    {MP_ROM_QSTR(MP_QSTR_readinto), MP_ROM_PTR(&mp_stream_readinto_obj)},
    {MP_ROM_QSTR(MP_QSTR_write), MP_ROM_PTR(&mp_stream_write_obj)},
    {MP_ROM_QSTR(MP_QSTR_any), MP_ROM_PTR(&any_obj)},
    {MP_ROM_QSTR(MP_QSTR_txdone), MP_ROM_PTR(&txdone_obj)},
};
static MP_DEFINE_CONST_DICT(dict, table);

MP_DEFINE_CONST_OBJ_TYPE(pyboard_uart_type, MP_QSTR_UART, MP_TYPE_FLAG_NONE, make_new,
                         make_new, protocol, &stream, locals_dict, &dict);

// What is printed, such as an exception that ends a program.
mp_uint_t mp_hal_stdout_tx_strn(const char *text, size_t length) {
    const mp_uint_t begun_ms = mp_hal_ticks_ms();
    size_t done = 0;
    while (is_open && done < length && mp_hal_ticks_ms() - begun_ms < PRINT_MS_MAX) {
        const size_t left = length - done;
        const uint8_t piece = (uint8_t)(left < PIECE_MAX ? left : PIECE_MAX);
        done += uart_send((const uint8_t *)text + done, piece) ? piece : 0;
    }
    return done;
}

int mp_hal_stdin_rx_chr(void) {
    return 0;  // no console
}
