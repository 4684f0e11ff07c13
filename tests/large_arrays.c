// SPDX-License-Identifier: MIT
// Memory of numpy's large arrays from the C library instead of the address sanitizer,
// which asks the system for each and gives it back: most of the time of tests that make
// a minute of motion. Smaller arrays stay with the sanitizer.
#include <Python.h>

#include <malloc.h>
#include <numpy/arrayobject.h>

#define LARGE (128 * 1024)  // bytes; the sanitizer keeps what is smaller

// Of the sanitizer and of glibc, whose headers do not declare them.
int __sanitizer_get_ownership(const volatile void *pointer);
void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *old, size_t size);
void __libc_free(void *old);

static void *get(void *context, size_t size)
{
    (void)context;
    return size < LARGE ? malloc(size) : __libc_malloc(size);
}

static void *get_zeros(void *context, size_t count, size_t size)
{
    (void)context;
    return count * size < LARGE ? calloc(count, size) : __libc_calloc(count, size);
}

static void *resize(void *context, void *old, size_t size)
{
    (void)context;
    if (old == NULL || __sanitizer_get_ownership(old)) {
        return realloc(old, size);
    }
    return __libc_realloc(old, size);
}

static void give_back(void *context, void *old, size_t size)
{
    (void)context;
    (void)size;
    if (old == NULL || __sanitizer_get_ownership(old)) {
        free(old);
    } else {
        __libc_free(old);
    }
}

static PyDataMem_Handler handler = {
    "large_arrays", 1, {NULL, get, get_zeros, resize, give_back}};

// Has all arrays that are made from here on use it; returns 0, or -1 with an error set.
int large_arrays_use(void)
{
    import_array1(-1);
    mallopt(M_MMAP_THRESHOLD, INT_MAX);  // glibc would ask the system, too
    mallopt(M_TRIM_THRESHOLD, INT_MAX);
    PyObject *capsule = PyCapsule_New(&handler, "mem_handler", NULL);
    PyObject *old = capsule == NULL ? NULL : PyDataMem_SetHandler(capsule);
    Py_XDECREF(capsule);
    Py_XDECREF(old);
    return old == NULL ? -1 : 0;
}
