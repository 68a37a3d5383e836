/* Read a message by a template; `Template.read` in template.py says the same in Python.
 *
 * Whatever is not like the template, or looks wrong, gives None: the caller then reads the message
 * as if nothing were known, which says what is wrong. */

#include <math.h>
#include <stdint.h>

#include "common/native.h"

#define NAME "template"
#define SLOTS 4

/* What differs between two messages: a count of the header, a number, or the bytes of an array. */
typedef struct {
    char kind; /* c: a count of the header, n: another integer, d: a number, s: an array */
    Py_ssize_t size;
    Py_ssize_t to; /* of an array: where it goes in the block */
    PyObject *name;
} Hole;

typedef struct {
    PyObject *name;
    PyObject *slice; /* of the block */
    PyObject *shape; /* None for a vector */
    Py_ssize_t start, count;
    int unit;
} Array;

/* A model that is made without validation. */
typedef struct {
    PyTypeObject *type;
    PyObject *fields_set;
    PyObject *values; /* dict of all fields */
} Made;

typedef struct {
    PyObject *arguments; /* keeps every other object alive */
    PyObject *around;    /* tuple of bytes, one more than holes */
    Py_ssize_t size, block_size, holes_count, arrays_count;
    Hole *holes;
    Array *arrays;
    Made header, message;
    PyObject *check_numbers, *refusal; /* a function or None; its exception */
    PyObject *frombuffer, *dtype;
    double tolerance;
    PyObject *text_header, *text_injected, *text_reshape;
    PyObject *slots[SLOTS]; /* names of a model's slots, as in builder.py */
} Template;

static void free_template(PyObject *capsule)
{
    Template *t = PyCapsule_GetPointer(capsule, NAME);
    if (t == NULL)
        return;
    PyMem_Free(t->holes);
    PyMem_Free(t->arrays);
    Py_DECREF(t->arguments);
    PyMem_Free(t);
}

static uint64_t big_endian(const unsigned char *from, Py_ssize_t size)
{
    uint64_t value = 0;
    for (Py_ssize_t i = 0; i < size; i++)
        value = value << 8 | from[i];
    return value;
}

static double little_endian_double(const unsigned char *from)
{
    uint64_t bits = 0;
    double value;
    for (int i = 7; i >= 0; i--)
        bits = bits << 8 | from[i];
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* NaN and infinity have all bits of the exponent set. */
static int all_finite(const unsigned char *block, Py_ssize_t size)
{
    for (Py_ssize_t i = 0; i < size; i += 8)
        if ((block[i + 7] & 0x7F) == 0x7F && (block[i + 6] & 0xF0) == 0xF0)
            return 0;
    return 1;
}

static int is_unit(const unsigned char *block, const Array *array, double tolerance)
{
    double sum = 0.0;
    for (Py_ssize_t i = 0; i < array->count; i++) {
        const double value = little_endian_double(block + 8 * (array->start + i));
        sum += value * value;
    }
    /* A hair less than allowed: at the border Python decides. */
    return fabs(sqrt(sum) - 1.0) < 0.999 * tolerance;
}

/* Return a model of these values, which it takes over; NULL with an exception set. */
static PyObject *make(const Template *t, const Made *made, PyObject *values)
{
    PyObject *model = PyType_GenericAlloc(made->type, 0);
    PyObject *contents[SLOTS] = {values, made->fields_set, Py_None, Py_None};
    for (int i = 0; model != NULL && i < SLOTS; i++)
        if (PyObject_GenericSetAttr(model, t->slots[i], contents[i]) < 0)
            Py_CLEAR(model);
    Py_DECREF(values);
    return model;
}

/* Set values[name] to a new reference, which is given away; -1 with an exception set. */
static int put(PyObject *values, PyObject *name, PyObject *value)
{
    if (value == NULL)
        return -1;
    const int status = PyDict_SetItem(values, name, value);
    Py_DECREF(value);
    return status;
}

/* Take a payload apart: 1, 0 if it is not like the template, or -1 with an exception set. */
static int take_apart(const Template *t, const unsigned char *from, PyObject *header,
                      PyObject *numbers, unsigned char *block)
{
    for (Py_ssize_t i = 0;; i++) {
        PyObject *run = PyTuple_GetItem(t->around, i);
        const Py_ssize_t length = PyBytes_Size(run);
        if (memcmp(from, PyBytes_AsString(run), (size_t)length) != 0)
            return 0;
        from += length;
        if (i == t->holes_count)
            return 1;
        const Hole *hole = &t->holes[i];
        if (hole->kind == 's') {
            memcpy(block + hole->to, from, (size_t)hole->size);
        } else {
            const uint64_t bits = big_endian(from, hole->size);
            double number;
            memcpy(&number, &bits, sizeof number);
            if (hole->kind == 'c' && bits >> 63)
                return 0;
            PyObject *value = hole->kind == 'd' ? PyFloat_FromDouble(number)
                                                : PyLong_FromUnsignedLongLong(bits);
            const int status = put(hole->kind == 'c' ? header : numbers, hole->name, value);
            if (status < 0)
                return -1;
        }
        from += hole->size;
    }
}

/* Put views on the block into the values; -1 with an exception set. */
static int put_arrays(const Template *t, PyObject *values, PyObject *bytes)
{
    PyObject *block = PyObject_CallFunctionObjArgs(t->frombuffer, bytes, t->dtype, NULL);
    int status = block == NULL ? -1 : 0;
    for (Py_ssize_t i = 0; status == 0 && i < t->arrays_count; i++) {
        const Array *array = &t->arrays[i];
        PyObject *view = PyObject_GetItem(block, array->slice);
        if (view != NULL && array->shape != Py_None) {
            PyObject *shaped =
                PyObject_CallMethodObjArgs(view, t->text_reshape, array->shape, NULL);
            Py_DECREF(view);
            view = shaped;
        }
        status = put(values, array->name, view);
    }
    Py_XDECREF(block);
    return status;
}

/* Validate the numbers outside arrays: 1, 0 if they are refused, or -1 with an exception set. */
static int put_numbers(const Template *t, PyObject *values, PyObject *numbers)
{
    PyObject *checked = PyObject_CallFunctionObjArgs(t->check_numbers, numbers, NULL);
    if (checked == NULL) {
        if (!PyErr_ExceptionMatches(t->refusal))
            return -1;
        PyErr_Clear();
        return 0;
    }
    const int status = PyDict_Update(values, checked);
    Py_DECREF(checked);
    return status < 0 ? -1 : 1;
}

static int arrays_are_good(const Template *t, const unsigned char *block)
{
    if (!all_finite(block, t->block_size))
        return 0;
    for (Py_ssize_t i = 0; i < t->arrays_count; i++)
        if (t->arrays[i].unit && !is_unit(block, &t->arrays[i], t->tolerance))
            return 0;
    return 1;
}

static PyObject *read_message(PyObject *module, PyObject *args)
{
    PyObject *capsule, *payload, *injected, *message = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "OSO!", &capsule, &payload, &PyLong_Type, &injected))
        return NULL;
    const Template *t = PyCapsule_GetPointer(capsule, NAME);
    if (t == NULL)
        return NULL;
    if (PyBytes_Size(payload) != t->size)
        Py_RETURN_NONE;
    PyObject *header = PyDict_Copy(t->header.values);
    PyObject *values = PyDict_Copy(t->message.values);
    PyObject *numbers = t->check_numbers == Py_None ? NULL : PyDict_New();
    PyObject *bytes = PyBytes_FromStringAndSize(NULL, t->block_size);
    int status = -1;
    if (header != NULL && values != NULL && bytes != NULL &&
        (numbers != NULL || t->check_numbers == Py_None)) {
        unsigned char *block = (unsigned char *)PyBytes_AsString(bytes);
        status = take_apart(t, (const unsigned char *)PyBytes_AsString(payload), header, numbers,
                            block);
        if (status == 1)
            status = arrays_are_good(t, block);
    }
    if (status == 1 && numbers != NULL)
        status = put_numbers(t, values, numbers);
    if (status == 1) {
        const int was_injected = PyObject_IsTrue(injected);
        if (was_injected < 0 ||
            (was_injected && PyDict_SetItem(header, t->text_injected, injected) < 0)) {
            status = -1;
        } else {
            status = put(values, t->text_header, make(t, &t->header, Py_NewRef(header)));
            if (status == 0)
                status = put_arrays(t, values, bytes);
            if (status == 0)
                message = make(t, &t->message, Py_NewRef(values));
        }
    } else if (status == 0) {
        message = Py_NewRef(Py_None);
    }
    Py_XDECREF(header);
    Py_XDECREF(values);
    Py_XDECREF(numbers);
    Py_XDECREF(bytes);
    return message;
}

static int set_made(Made *made, PyObject *triple)
{
    return PyArg_ParseTuple(triple, "O!O!O!", &PyType_Type, &made->type, &PySet_Type,
                            &made->fields_set, &PyDict_Type, &made->values);
}

static int set_arrays(Template *t, PyObject *arrays)
{
    const Py_ssize_t count = PyTuple_Size(arrays);
    t->arrays = PyMem_Calloc((size_t)count + 1, sizeof *t->arrays);
    if (t->arrays == NULL)
        return 0;
    for (Array *array = t->arrays; array < t->arrays + count; array++) {
        array->start = t->block_size / 8;
        if (!PyArg_ParseTuple(PyTuple_GetItem(arrays, array - t->arrays), "UOOnp", &array->name,
                              &array->slice, &array->shape, &array->count, &array->unit))
            return 0;
        t->block_size += 8 * array->count;
    }
    t->arrays_count = count;
    return 1;
}

static int set_holes(Template *t, PyObject *holes)
{
    const Py_ssize_t count = PyTuple_Size(holes);
    t->holes = PyMem_Calloc((size_t)count + 1, sizeof *t->holes);
    if (t->holes == NULL)
        return 0;
    for (Hole *hole = t->holes; hole < t->holes + count; hole++) {
        if (!PyArg_ParseTuple(PyTuple_GetItem(holes, hole - t->holes), "CnnU", &hole->kind,
                              &hole->size, &hole->to, &hole->name))
            return 0;
        const int lies_inside = hole->to >= 0 && hole->to + hole->size <= t->block_size;
        const int is_number = hole->kind == 'd' || hole->kind == 'n';
        if ((hole->kind == 's' && !lies_inside) || hole->size < 0 ||
            (is_number && t->check_numbers == Py_None)) {
            PyErr_Format(PyExc_ValueError, "%U: a hole that cannot be read", hole->name);
            return 0;
        }
        t->size += hole->size;
    }
    t->holes_count = count;
    for (Py_ssize_t i = 0; i <= count; i++) {
        PyObject *run = PyTuple_GetItem(t->around, i);
        if (run == NULL || PyBytes_Size(run) < 0)
            return 0;
        t->size += PyBytes_Size(run);
    }
    return 1;
}

static PyObject *prepare(PyObject *module, PyObject *args)
{
    PyObject *holes, *arrays, *header, *message;
    (void)module;
    Template *t = PyMem_Calloc(1, sizeof *t);
    if (t == NULL)
        return PyErr_NoMemory();
    t->arguments = Py_NewRef(args);
    PyObject *capsule = PyCapsule_New(t, NAME, free_template);
    if (capsule == NULL) {
        Py_DECREF(args);
        PyMem_Free(t);
        return NULL;
    }
    if (PyArg_ParseTuple(args, "O!O!O!O!O!OOOOd(UUU)(UUUU)", &PyTuple_Type, &t->around,
                         &PyTuple_Type, &holes, &PyTuple_Type, &arrays, &PyTuple_Type, &header,
                         &PyTuple_Type, &message, &t->check_numbers, &t->refusal, &t->frombuffer,
                         &t->dtype, &t->tolerance, &t->text_header, &t->text_injected,
                         &t->text_reshape, &t->slots[0], &t->slots[1], &t->slots[2],
                         &t->slots[3]) &&
        set_made(&t->header, header) && set_made(&t->message, message) && set_arrays(t, arrays) &&
        set_holes(t, holes))
        return capsule;
    Py_DECREF(capsule);
    return PyErr_Occurred() ? NULL : PyErr_NoMemory();
}

static PyMethodDef methods[] = {
    {"prepare", prepare, METH_VARARGS, "Return what read() needs of one template."},
    {"read", read_message, METH_VARARGS,
     "read(prepared, payload, injected_ns) -> the message, or None if it is not like the template"},
    {NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_template", "Reads messages by templates.", -1, methods,
    NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__template(void) { return native_module(&definition); }
