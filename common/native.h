/* What every compiled kernel needs: the stable ABI of Python, arrays by the buffer protocol. */

#ifndef TRILL_NATIVE_H
#define TRILL_NATIVE_H

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include <string.h>

/* Get a contiguous array of `count` doubles (any number if negative). Returns its memory, or NULL
 * with an exception set. Its buffer must be released, and stays valid until then. */
static inline double *native_doubles(PyObject *array, Py_ssize_t count, int writable,
                                     const char *name, Py_buffer *buffer)
{
    int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0);
    if (PyObject_GetBuffer(array, buffer, flags) < 0)
        return NULL;
    Py_ssize_t got = buffer->len / (Py_ssize_t)sizeof(double);
    if (buffer->format == NULL || strcmp(buffer->format, "d") != 0) {
        PyErr_Format(PyExc_TypeError, "%s: expected an array of float64, got format %s", name,
                     buffer->format == NULL ? "B" : buffer->format);
    } else if (count >= 0 && got != count) {
        PyErr_Format(PyExc_ValueError, "%s: expected %zd numbers, got %zd", name, count, got);
    } else {
        return buffer->buf;
    }
    PyBuffer_Release(buffer);
    return NULL;
}

/* An array among a function's arguments. */
typedef struct {
    const char *name;
    Py_ssize_t count;
    int writable;
    void *place; /* address of the double * (or const double *) that becomes its memory */
} NativeArray;

static inline void native_release(Py_buffer *buffers, int count)
{
    while (count-- > 0)
        PyBuffer_Release(&buffers[count]);
}

/* Get `count` arrays from a tuple of arguments, beginning with the one at `first`. Returns 0 with an
 * exception set and nothing held, or 1; native_release() then releases them. */
static inline int native_take(PyObject *arguments, int first, const NativeArray *arrays, int count,
                              Py_buffer *buffers)
{
    for (int i = 0; i < count; i++) {
        PyObject *array = PyTuple_GetItem(arguments, first + i);
        double *memory = array == NULL ? NULL
                                       : native_doubles(array, arrays[i].count, arrays[i].writable,
                                                        arrays[i].name, &buffers[i]);
        if (memory == NULL) {
            native_release(buffers, i);
            return 0;
        }
        memcpy(arrays[i].place, &memory, sizeof memory);
    }
    return 1;
}

/* Add what the loader compares with the source; returns the module, or NULL with an exception. */
static inline PyObject *native_module(struct PyModuleDef *definition)
{
    PyObject *module = PyModule_Create(definition);
    if (module != NULL && PyModule_AddStringConstant(module, "FINGERPRINT", FINGERPRINT) < 0)
        Py_CLEAR(module);
    return module;
}

#endif
