// SPDX-License-Identifier: MIT
// MicroPython on this machine: runs the file that is its first argument. sys.path has
// its folder; the module `host` reads and writes whole files.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>

#include "chips_time.h"
#include "py/builtin.h"
#include "py/compile.h"
#include "py/gc.h"
#include "py/mperrno.h"
#include "py/mphal.h"
#include "py/objlist.h"
#include "py/runtime.h"
#include "py/stackctrl.h"
#include "shared/runtime/gchelper.h"

enum { STACK_BYTES = 400000 };

static char heap[64 << 20];

mp_uint_t mp_hal_stdout_tx_strn(const char *bytes, size_t length) {
    return fwrite(bytes, 1, length, stdout);
}

int mp_hal_stdin_rx_chr(void) {
    return getchar();
}

static uint64_t now_us(void) {
    uint64_t us;
    if (chips_time_us(&us)) {
        return us;
    }
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000 + (uint64_t)now.tv_nsec / 1000;
}

mp_uint_t mp_hal_ticks_us(void) {
    return now_us();
}

mp_uint_t mp_hal_ticks_ms(void) {
    return now_us() / 1000;
}

void mp_hal_delay_us(mp_uint_t us) {
    const struct timespec wait = {us / 1000000, (long)(us % 1000000) * 1000};
    (void)nanosleep(&wait, NULL);
}

void mp_hal_delay_ms(mp_uint_t ms) {
    mp_hal_delay_us(ms * 1000);
}

mp_import_stat_t mp_import_stat(const char *path) {
    struct stat found;
    if (stat(path, &found) != 0) {
        return MP_IMPORT_STAT_NO_EXIST;
    }
    return S_ISDIR(found.st_mode) ? MP_IMPORT_STAT_DIR : MP_IMPORT_STAT_FILE;
}

void gc_collect(void) {
    gc_collect_start();
    gc_helper_collect_regs_and_stack();
    gc_collect_end();
}

void nlr_jump_fail(void *value) {
    (void)value;
    abort();
}

void host_alloc_exec(size_t least, void **bytes, size_t *size) {
    void *found = mmap(NULL, least, PROT_READ | PROT_WRITE | PROT_EXEC,
                       MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    *bytes = found == MAP_FAILED ? NULL : found;
    *size = least;
}

void host_free_exec(void *bytes, size_t size) {
    (void)munmap(bytes, size);
}

static mp_obj_t host_read(mp_obj_t path) {
    FILE *file = fopen(mp_obj_str_get_str(path), "rb");
    struct stat found;
    if (file == NULL || fstat(fileno(file), &found) != 0) {
        mp_raise_OSError(MP_ENOENT);
    }
    vstr_t bytes;
    vstr_init_len(&bytes, (size_t)found.st_size);
    bytes.len = fread(bytes.buf, 1, bytes.len, file);
    (void)fclose(file);
    return mp_obj_new_bytes_from_vstr(&bytes);
}
static MP_DEFINE_CONST_FUN_OBJ_1(host_read_obj, host_read);

static mp_obj_t host_write(mp_obj_t path, mp_obj_t object) {
    mp_buffer_info_t bytes;
    mp_get_buffer_raise(object, &bytes, MP_BUFFER_READ);
    FILE *file = fopen(mp_obj_str_get_str(path), "wb");
    if (file == NULL || fwrite(bytes.buf, 1, bytes.len, file) != bytes.len ||
        fclose(file) != 0) {
        mp_raise_OSError(MP_EIO);
    }
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_2(host_write_obj, host_write);

static const mp_rom_map_elem_t host_table[] = {
    {MP_ROM_QSTR(MP_QSTR___name__), MP_ROM_QSTR(MP_QSTR_host)},
    {MP_ROM_QSTR(MP_QSTR_read), MP_ROM_PTR(&host_read_obj)},
    {MP_ROM_QSTR(MP_QSTR_write), MP_ROM_PTR(&host_write_obj)},
};
static MP_DEFINE_CONST_DICT(host_globals, host_table);

const mp_obj_module_t host_module = {
    .base = {&mp_type_module},
    .globals = (mp_obj_dict_t *)&host_globals,
};
MP_REGISTER_MODULE(MP_QSTR_host, host_module);

static int run(const char *path) {
    nlr_buf_t nlr;
    if (nlr_push(&nlr) != 0) {
        mp_obj_print_exception(&mp_plat_print, MP_OBJ_FROM_PTR(nlr.ret_val));
        return 1;
    }
    const char *slash = strrchr(path, '/');
    const size_t length = slash == NULL ? 0 : (size_t)(slash - path);
    mp_obj_list_append(mp_sys_path, mp_obj_new_str(path, length));
    mp_lexer_t *lexer = mp_lexer_new_from_file(qstr_from_str(path));
    const qstr name = lexer->source_name;
    mp_parse_tree_t tree = mp_parse(lexer, MP_PARSE_FILE_INPUT);
    (void)mp_call_function_0(mp_compile(&tree, name, false));
    nlr_pop();
    return 0;
}

int main(int argc, char **argv) {
    if (argc < 2) {
        (void)fprintf(stderr, "usage: %s FILE [ARGUMENT ...]\n", argv[0]);
        return 2;
    }
    mp_cstack_init_with_sp_here(STACK_BYTES);
    gc_init(heap, heap + sizeof heap);
    mp_init();
    for (int i = 1; i < argc; i++) {
        mp_obj_list_append(mp_sys_argv, mp_obj_new_str(argv[i], strlen(argv[i])));
    }
    const int code = run(argv[1]);
    mp_deinit();
    return code;
}
