/* Pack the fields of a message; `encode_body` in codec.py says the same in Python.
 *
 * Only plain values and arrays are known here: for anything else the answer is None, and for what
 * does not fit the wire too, so that Python says what is wrong. */

#include <stdint.h>

#include "common/native.h"

typedef struct {
    unsigned char *data;
    size_t size, capacity;
} Output;

/* Make room for `more` bytes; returns where they go, or NULL without memory. */
static unsigned char *grow(Output *out, size_t more)
{
    if (out->size + more > out->capacity) {
        const size_t capacity = 1024 + 2 * (out->size + more);
        unsigned char *data = PyMem_Realloc(out->data, capacity);
        if (data == NULL)
            return NULL;
        out->data = data;
        out->capacity = capacity;
    }
    out->size += more;
    return out->data + out->size - more;
}

static int add(Output *out, const void *from, size_t size)
{
    unsigned char *to = grow(out, size);
    if (to == NULL)
        return 0;
    memcpy(to, from, size);
    return 1;
}

/* Add a type byte and a big-endian number of `size` bytes. */
static int add_number(Output *out, unsigned type, uint64_t bits, int size)
{
    unsigned char *to = grow(out, 1 + (size_t)size);
    if (to == NULL)
        return 0;
    *to++ = (unsigned char)type;
    for (int shift = 8 * (size - 1); shift >= 0; shift -= 8)
        *to++ = (unsigned char)(bits >> shift);
    return 1;
}

/* Add the shortest of three headers that holds a length; `types` are those of 8, 16 and 32 bits. */
static int add_length(Output *out, const unsigned char types[3], size_t length)
{
    if (length <= UINT8_MAX)
        return add_number(out, types[0], length, 1);
    if (length <= UINT16_MAX)
        return add_number(out, types[1], length, 2);
    return length <= UINT32_MAX && add_number(out, types[2], length, 4);
}

static int add_unsigned(Output *out, uint64_t value)
{
    if (value < 0x80)
        return add_number(out, (unsigned)value, 0, 0);
    if (value <= UINT8_MAX)
        return add_number(out, 0xCC, value, 1);
    if (value <= UINT16_MAX)
        return add_number(out, 0xCD, value, 2);
    if (value <= UINT32_MAX)
        return add_number(out, 0xCE, value, 4);
    return add_number(out, 0xCF, value, 8);
}

static int add_negative(Output *out, int64_t value)
{
    const uint64_t bits = (uint64_t)value;
    if (value >= -32)
        return add_number(out, (unsigned)(bits & 0xFF), 0, 0);
    if (value >= INT8_MIN)
        return add_number(out, 0xD0, bits, 1);
    if (value >= INT16_MIN)
        return add_number(out, 0xD1, bits, 2);
    if (value >= INT32_MIN)
        return add_number(out, 0xD2, bits, 4);
    return add_number(out, 0xD3, bits, 8);
}

static int add_integer(Output *out, PyObject *value)
{
    int overflow;
    const long long number = PyLong_AsLongLongAndOverflow(value, &overflow);
    if (overflow > 0)
        return add_unsigned(out, PyLong_AsUnsignedLongLong(value)) && !PyErr_Occurred();
    if (overflow < 0 || (number == -1 && PyErr_Occurred()))
        return 0;
    return number < 0 ? add_negative(out, number) : add_unsigned(out, (uint64_t)number);
}

static int add_text(Output *out, PyObject *value)
{
    static const unsigned char types[3] = {0xD9, 0xDA, 0xDB};
    Py_ssize_t size;
    const char *text = PyUnicode_AsUTF8AndSize(value, &size);
    if (text == NULL)
        return 0;
    const int started = size < 32 ? add_number(out, 0xA0 | (unsigned)size, 0, 0)
                                  : add_length(out, types, (size_t)size);
    return started && add(out, text, (size_t)size);
}

static int add_array(Output *out, PyObject *value)
{
    static const unsigned char types[3] = {0xC4, 0xC5, 0xC6};
    Py_buffer buffer;
    if (native_doubles(value, -1, 0, "array", &buffer) == NULL)
        return 0;
    const int added = add_length(out, types, (size_t)buffer.len) &&
                      add(out, buffer.buf, (size_t)buffer.len);
    PyBuffer_Release(&buffer);
    return added;
}

static int add_value(Output *out, PyObject *value)
{
    if (value == Py_None)
        return add_number(out, 0xC0, 0, 0);
    if (value == Py_True || value == Py_False)
        return add_number(out, value == Py_True ? 0xC3 : 0xC2, 0, 0);
    if (PyLong_Check(value))
        return add_integer(out, value);
    if (PyUnicode_Check(value))
        return add_text(out, value);
    if (!PyFloat_Check(value))
        return 0;
    const double number = PyFloat_AsDouble(value);
    uint64_t bits;
    memcpy(&bits, &number, sizeof bits);
    return add_number(out, 0xCB, bits, 8);
}

/* Add the names and values of all fields; 0 if one is not known here or does not fit. */
static int add_fields(Output *out, PyObject *fields, PyObject *values)
{
    const Py_ssize_t count = PyTuple_Size(fields);
    if (!(count < 16 ? add_number(out, 0x80 | (unsigned)count, 0, 0)
                     : add_number(out, 0xDE, (uint64_t)count, 2)))
        return 0;
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *field = PyTuple_GetItem(fields, i);
        PyObject *packed = PyTuple_GetItem(field, 1);
        PyObject *value = PyDict_GetItemWithError(values, PyTuple_GetItem(field, 0));
        if (value == NULL || !add(out, PyBytes_AsString(packed), (size_t)PyBytes_Size(packed)))
            return 0;
        const int is_array = PyTuple_GetItem(field, 2) == Py_True;
        if (!(is_array ? add_array(out, value) : add_value(out, value)))
            return 0;
    }
    return 1;
}

/* Return what was added as bytes, or None if something is not known here or does not fit. */
static PyObject *finish(Output *out, int added)
{
    PyObject *packed;
    if (added) {
        packed = PyBytes_FromStringAndSize((const char *)out->data, (Py_ssize_t)out->size);
    } else {
        PyErr_Clear();
        packed = Py_NewRef(Py_None);
    }
    PyMem_Free(out->data);
    return packed;
}

static PyObject *pack(PyObject *module, PyObject *args)
{
    PyObject *fields, *values;
    (void)module;
    if (!PyArg_ParseTuple(args, "O!O!", &PyTuple_Type, &fields, &PyDict_Type, &values))
        return NULL;
    Output out = {NULL, 0, 0};
    return finish(&out, add_fields(&out, fields, values));
}

static PyObject *pack_with_header(PyObject *module, PyObject *args)
{
    PyObject *fields, *header;
    const char *prefix, *body;
    Py_ssize_t prefix_size, body_size, head;
    (void)module;
    if (!PyArg_ParseTuple(args, "y#O!O!y#n", &prefix, &prefix_size, &PyTuple_Type, &fields,
                          &PyDict_Type, &header, &body, &body_size, &head))
        return NULL;
    Output out = {NULL, 0, 0};
    const int added = head >= 0 && head <= body_size && PyDict_Size(header) == PyTuple_Size(fields) &&
                      add(&out, prefix, (size_t)prefix_size) && add_fields(&out, fields, header) &&
                      add(&out, body + head, (size_t)(body_size - head));
    return finish(&out, added);
}

static PyMethodDef methods[] = {
    {"pack", pack, METH_VARARGS,
     "pack(((name, packed name, is an array), ...), values) -> a msgpack map, or None"},
    {"pack_with_header", pack_with_header, METH_VARARGS,
     "pack_with_header(prefix, fields, header, body, bytes of it to leave out) -> bytes, or None"},
    {NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_codec", "Packs messages.", -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__codec(void) { return native_module(&definition); }
