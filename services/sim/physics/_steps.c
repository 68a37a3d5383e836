/* Physics steps behind the motor servo; `Steps.run` in steps.py says the same in Python.
 *
 * MuJoCo is called through the addresses of its functions in the library that its Python package
 * has loaded: building this needs neither MuJoCo nor NumPy. */

#include <math.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "common/native.h"

#define MOTORS 25
#define TERMS 5
#define MAX_ARRAYS 9

typedef void (*step_function)(const void *model, void *data);

typedef struct {
    step_function step1, step2;
    void *model, *data;
    /* Views of MuJoCo's memory. */
    double *torque, *length, *velocity, *qpos, *qvel, *rotation;
    /* Constants: (25,) each, and twice (50,) for torque and position. */
    double *per_joint, *lowest, *highest;
    Py_ssize_t nq, nv;
    int64_t step_ns, extrapolation_ns;
    double fade, height, uprightness, farthest_squared, fastest_squared;
    PyObject *error; /* class of exceptions for MuJoCo's fatal errors */
    Py_buffer buffers[MAX_ARRAYS];
    int held;
} Steps;

static _Thread_local jmp_buf *rescue;
static _Thread_local char fatal[1024];

/* Leave MuJoCo after a fatal error, from which it must not return; elsewhere end as it would. */
static void on_fatal(const char *text)
{
    snprintf(fatal, sizeof fatal, "%s", text);
    if (rescue != NULL)
        longjmp(*rescue, 1);
    fprintf(stderr, "ERROR: %s\n", text);
    exit(EXIT_FAILURE);
}

static void free_steps(PyObject *capsule)
{
    Steps *steps = PyCapsule_GetPointer(capsule, "steps");
    if (steps == NULL)
        return;
    for (int i = 0; i < steps->held; i++)
        PyBuffer_Release(&steps->buffers[i]);
    Py_XDECREF(steps->error);
    PyMem_Free(steps);
}

/* As np.maximum and np.minimum: NaN stays. */
static double at_least(double value, double bound) { return value < bound ? bound : value; }
static double at_most(double value, double bound) { return value > bound ? bound : value; }

/* Write the motor torques; returns whether a motor is at its torque limit. */
static int servo(const Steps *s, const double *law, double h)
{
    const double hh = h * h;
    /* Torques, then positions, as the limits are. */
    double free[2 * MOTORS], bounded[2 * MOTORS];
    for (int i = 0; i < MOTORS; i++) {
        const double position = s->length[i] * s->per_joint[i];
        const double velocity = s->velocity[i] * s->per_joint[i];
        double wanted = law[i] * position + law[MOTORS + i] * velocity;
        wanted += law[2 * MOTORS + i];
        wanted += law[3 * MOTORS + i] * h;
        wanted += law[4 * MOTORS + i] * hh;
        free[i] = wanted;
        free[MOTORS + i] = position;
    }
    for (int i = 0; i < 2 * MOTORS; i++)
        bounded[i] = at_most(at_least(free[i], s->lowest[i]), s->highest[i]);
    memcpy(s->torque, bounded, sizeof(double) * MOTORS);
    if (memcmp(free, bounded, sizeof free) == 0)
        return 0;
    for (int i = 0; i < MOTORS; i++) {
        const double beyond = free[MOTORS + i] - bounded[MOTORS + i];
        if (beyond * s->torque[i] > 0.0)
            s->torque[i] *= at_least(1.0 - fabs(beyond) / s->fade, 0.0);
    }
    return memcmp(free, bounded, sizeof(double) * MOTORS) != 0;
}

static double squared_norm(const double *values, Py_ssize_t count)
{
    double sum = 0.0;
    for (Py_ssize_t i = 0; i < count; i++)
        sum += values[i] * values[i];
    return sum;
}

/* Whether Python has to look at the state before the next step. NaN counts as out of bounds. */
static int is_notable(const Steps *s, int watch_fall)
{
    if (watch_fall && (s->qpos[2] < s->height || s->rotation[8] < s->uprightness))
        return 1;
    return !(squared_norm(s->qpos, s->nq) <= s->farthest_squared &&
             squared_norm(s->qvel, s->nv) <= s->fastest_squared);
}

typedef struct {
    int done, saturated, notable;
} Outcome;

/* Do at most `most` steps under a law that was made for the time `stamp_ns`. */
static Outcome do_steps(const Steps *s, const double *law, int64_t stamp_ns, int64_t now_ns,
                        int most, int watch_fall)
{
    Outcome outcome = {0, 0, 0};
    for (; outcome.done < most && !outcome.notable; outcome.done++) {
        int64_t since = now_ns - stamp_ns;
        since = since < 0 ? 0 : since > s->extrapolation_ns ? s->extrapolation_ns : since;
        s->step1(s->model, s->data);
        outcome.saturated += servo(s, law, (double)since * 1e-9);
        s->step2(s->model, s->data);
        now_ns += s->step_ns;
        outcome.notable = is_notable(s, watch_fall);
    }
    return outcome;
}

static PyObject *run(PyObject *module, PyObject *args)
{
    PyObject *capsule, *law_array;
    long long stamp_ns, now_ns;
    int most, watch_fall;
    (void)module;
    if (!PyArg_ParseTuple(args, "OOLLip", &capsule, &law_array, &stamp_ns, &now_ns, &most,
                          &watch_fall))
        return NULL;
    Steps *s = PyCapsule_GetPointer(capsule, "steps");
    if (s == NULL)
        return NULL;
    Py_buffer law_buffer;
    const double *law = native_doubles(law_array, TERMS * MOTORS, 0, "law", &law_buffer);
    if (law == NULL)
        return NULL;
    Outcome outcome = {0, 0, 0};
    jmp_buf here;
    volatile int failed = 0;
    Py_BEGIN_ALLOW_THREADS
    if (setjmp(here) == 0) {
        rescue = &here;
        outcome = do_steps(s, law, stamp_ns, now_ns, most, watch_fall);
    } else {
        failed = 1;
    }
    rescue = NULL;
    Py_END_ALLOW_THREADS
    PyBuffer_Release(&law_buffer);
    if (failed) {
        PyErr_SetString(s->error, fatal);
        return NULL;
    }
    return Py_BuildValue("iiO", outcome.done, outcome.saturated,
                         outcome.notable ? Py_True : Py_False);
}

static PyObject *prepare(PyObject *module, PyObject *args, PyObject *keywords)
{
    static char *names[] = {
        "step1", "step2", "user_error", "error", "model", "data",
        "torque", "length", "velocity", "qpos", "qvel", "rotation",
        "per_joint", "lowest", "highest",
        "step_ns", "extrapolation_ns",
        "fade", "height", "uprightness", "farthest_squared", "fastest_squared", NULL};
    PyObject *arrays[MAX_ARRAYS];
    unsigned long long step1, step2, user_error, model, data;
    PyObject *error;
    long long step_ns, extrapolation_ns;
    (void)module;
    Steps *s = PyMem_Calloc(1, sizeof *s);
    if (s == NULL)
        return PyErr_NoMemory();
    PyObject *capsule = PyCapsule_New(s, "steps", free_steps);
    if (capsule == NULL) {
        PyMem_Free(s);
        return NULL;
    }
    if (!PyArg_ParseTupleAndKeywords(
            args, keywords, "$KKKOKKOOOOOOOOOLLddddd", names, &step1, &step2, &user_error, &error,
            &model, &data, &arrays[0], &arrays[1], &arrays[2], &arrays[3], &arrays[4], &arrays[5], &arrays[6],
            &arrays[7], &arrays[8], &step_ns, &extrapolation_ns, &s->fade, &s->height,
            &s->uprightness, &s->farthest_squared, &s->fastest_squared))
        goto failed;
    s->step1 = (step_function)(uintptr_t)step1;
    s->step2 = (step_function)(uintptr_t)step2;
    s->error = Py_NewRef(error);
    void (**handler)(const char *) = (void (**)(const char *))(uintptr_t)user_error;
    if (*handler == NULL)
        *handler = on_fatal;
    s->model = (void *)(uintptr_t)model;
    s->data = (void *)(uintptr_t)data;
    s->step_ns = step_ns;
    s->extrapolation_ns = extrapolation_ns;
    double **views[MAX_ARRAYS] = {&s->torque,   &s->length,    &s->velocity, &s->qpos,   &s->qvel,
                                  &s->rotation, &s->per_joint, &s->lowest,   &s->highest};
    const Py_ssize_t counts[MAX_ARRAYS] = {MOTORS, MOTORS, MOTORS,     -1,        -1,
                                           9,      MOTORS, 2 * MOTORS, 2 * MOTORS};
    for (int i = 0; i < MAX_ARRAYS; i++) {
        *views[i] = native_doubles(arrays[i], counts[i], i == 0, names[6 + i], &s->buffers[i]);
        if (*views[i] == NULL)
            goto failed;
        s->held++;
    }
    s->nq = s->buffers[3].len / (Py_ssize_t)sizeof(double);
    s->nv = s->buffers[4].len / (Py_ssize_t)sizeof(double);
    return capsule;
failed:
    Py_DECREF(capsule);
    return NULL;
}

static PyMethodDef methods[] = {
    {"prepare", (PyCFunction)(void (*)(void))prepare, METH_VARARGS | METH_KEYWORDS,
     "Return what run() needs of one plant."},
    {"run", run, METH_VARARGS,
     "run(prepared, law, stamp_ns, now_ns, most, watch_fall) -> (steps, saturated ones, notable)"},
    {NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_steps", "Physics steps behind the motor servo.", -1, methods,
    NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__steps(void) { return native_module(&definition); }
