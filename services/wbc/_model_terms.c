/* The terms of the controller's model that follow from what pinocchio leaves in its memory.
 *
 * After its passes for the mass matrix M (in the world's convention) and for the bias force h, that
 * memory holds the joints' placements and the world Jacobian J, whose column k is the velocity
 * [linear; angular] at the world's origin that a unit rate of joint k gives to what it carries. From
 * these, poses, Jacobians and Jdot v of hands and feet are a walk along each limb, and those of the
 * centre of mass are the base's rows of M and h: they say how its momentum changes.
 */
#include "common/native.h"

enum { NV = 31, ROWS = 30, FRAMES = 4, HANDS = 2, MOST_JOINTS = 16 };
/* Rows of the stacked Jacobian, as in layout.py. */
enum { TORSO = 3, FIRST_FRAME = 6 };

typedef struct {
    const double *rotation, *position; /* of its joint; matrices of pinocchio are column-major */
    double offset[3];                  /* of the frame from it */
    int floating;                      /* a foot: its limb begins with the six of the base */
    int count;
    unsigned char columns[MOST_JOINTS], velocities[MOST_JOINTS]; /* of J, of the reduced model */
} Limb;

enum { SHARED = 5, VIEWS = SHARED + 2 * FRAMES };

typedef struct {
    const double *J, *M, *h, *rotation, *position; /* of pinocchio; the last two of the base */
    double gravity[3];
    Limb limbs[FRAMES];
    Py_buffer views[VIEWS];
    int held;
} Model;

typedef struct {
    double *rotation, *com, *mass, *force, *jacobian, *velocity, *bias, *positions, *rotations, *soles;
} Terms;

static void cross(const double *a, const double *b, double *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

/* c = R v of a column-major R; with `back` R' v */
static void turn(const double *R, const double *v, double *c, int back)
{
    for (int i = 0; i < 3; i++)
        c[i] = back ? R[3 * i] * v[0] + R[3 * i + 1] * v[1] + R[3 * i + 2] * v[2]
                    : R[i] * v[0] + R[3 + i] * v[1] + R[6 + i] * v[2];
}

/* Mass matrix from its upper triangle; momentum of the whole body: mass, centre, Jacobian, bias. */
static void whole_body(const Model *m, const Terms *t)
{
    for (int j = 0; j < NV; j++)
        for (int i = 0; i <= j; i++)
            t->mass[j * NV + i] = t->mass[i * NV + j] = m->M[j * NV + i];
    memcpy(t->force, m->h, NV * sizeof(double));
    const double mass = t->mass[0], *M = t->mass;
    /* The block beside the mass is that of its first moment's cross product. */
    const double centre[3] = {M[NV + 5] / mass, M[2 * NV + 3] / mass, M[4] / mass};
    turn(m->rotation, centre, t->com, 0);
    turn(m->rotation, m->h, t->bias, 0);
    for (int i = 0; i < 3; i++) {
        t->com[i] += m->position[i];
        t->bias[i] = t->bias[i] / mass + m->gravity[i];
        for (int j = 0; j < NV; j++)
            t->jacobian[i * NV + j] = (m->rotation[i] * M[j] + m->rotation[3 + i] * M[NV + j] +
                                       m->rotation[6 + i] * M[2 * NV + j]) /
                                      mass;
        for (int j = 0; j < 3; j++) {
            t->rotation[3 * i + j] = m->rotation[3 * j + i];
            t->jacobian[(TORSO + i) * NV + 3 + j] = m->rotation[3 * j + i];
        }
    }
}

/* Adds a joint's column to the Jacobian of a foot in world and in its own frame, or of a hand in the
 * base. */
static void add_column(const Model *m, int index, int k, const double *point, const Terms *t)
{
    const Limb *limb = &m->limbs[index];
    const double *J = &m->J[6 * limb->columns[k]];
    const int at = limb->velocities[k];
    double *jacobian = &t->jacobian[(FIRST_FRAME + 6 * index) * NV + at];
    double parts[2][3], turned[3];
    cross(&J[3], point, parts[0]);
    for (int i = 0; i < 3; i++) {
        parts[0][i] += J[i];
        parts[1][i] = J[3 + i];
    }
    for (int part = 0; part < 2; part++) {
        turn(limb->floating ? limb->rotation : m->rotation, parts[part], turned, 1);
        for (int i = 0; i < 3; i++) {
            const int row = (3 * part + i) * NV;
            jacobian[row] += limb->floating ? parts[part][i] : turned[i];
            if (limb->floating)
                t->soles[(index - HANDS) * 6 * NV + row + at] += turned[i];
        }
    }
}

/* Moves the frame's velocity and Jdot v, both at the world's origin, on by one joint. */
static void add_joint(const double *J, double rate, double *velocity, double *acceleration)
{
    double a[3], b[3];
    cross(&velocity[3], J, a);
    cross(velocity, &J[3], b);
    for (int i = 0; i < 3; i++)
        acceleration[i] += rate * (a[i] + b[i]);
    cross(&velocity[3], &J[3], a);
    for (int i = 0; i < 3; i++)
        acceleration[3 + i] += rate * a[i];
}

/* Jdot v at a point, from velocity and Jdot v at the world's origin. */
static void move_bias(const double *velocity, const double *point, double *acceleration)
{
    double a[3], b[3];
    cross(&velocity[3], point, a);
    for (int i = 0; i < 3; i++)
        a[i] += velocity[i];
    cross(&velocity[3], a, b);
    cross(&acceleration[3], point, a);
    for (int i = 0; i < 3; i++)
        acceleration[i] += a[i] + b[i];
}

/* Pose of a frame, its Jacobian and Jdot v: of a foot in world, of a hand in the base. */
static void frame(const Model *m, const double *v, int index, const Terms *t)
{
    const Limb *limb = &m->limbs[index];
    double point[3], velocity[6] = {0.0}, acceleration[6] = {0.0};
    double *bias = &t->bias[FIRST_FRAME + 6 * index];
    double *position = &t->positions[3 * index], *rotation = &t->rotations[9 * index];
    turn(limb->rotation, limb->offset, point, 0);
    for (int i = 0; i < 3; i++)
        point[i] += limb->position[i];
    for (int k = 0; k < limb->count; k++) {
        const double *J = &m->J[6 * limb->columns[k]], rate = v[limb->velocities[k]];
        add_column(m, index, k, point, t);
        /* The axes of the base move with it, so that they add nothing; the others with the limb. */
        if (!limb->floating || k >= 6)
            add_joint(J, rate, velocity, acceleration);
        for (int i = 0; i < 6; i++)
            velocity[i] += rate * J[i];
    }
    move_bias(velocity, point, acceleration);
    memcpy(bias, acceleration, sizeof acceleration);
    memcpy(position, point, sizeof point);
    if (!limb->floating) {
        for (int i = 0; i < 3; i++)
            point[i] -= m->position[i];
        turn(m->rotation, point, position, 1);
        turn(m->rotation, acceleration, bias, 1);
        turn(m->rotation, &acceleration[3], &bias[3], 1);
    }
    for (int j = 0; j < 3; j++) {
        double axis[3];
        memcpy(axis, &limb->rotation[3 * j], sizeof axis);
        if (!limb->floating)
            turn(m->rotation, &limb->rotation[3 * j], axis, 1);
        for (int i = 0; i < 3; i++)
            rotation[3 * i + j] = axis[i];
    }
}

static void free_model(PyObject *capsule)
{
    Model *m = PyCapsule_GetPointer(capsule, "model");
    while (m->held > 0)
        PyBuffer_Release(&m->views[--m->held]);
    PyMem_Free(m);
}

static const double *view(Model *m, PyObject *array, Py_ssize_t count, const char *name)
{
    const double *memory = native_doubles(array, count, 0, name, &m->views[m->held]);
    m->held += memory != NULL;
    return memory;
}

static int read_limb(Model *m, Limb *limb, PyObject *description)
{
    PyObject *rotation, *position;
    const char *columns, *velocities;
    Py_ssize_t count, same;
    if (!PyArg_ParseTuple(description, "OO(ddd)y#y#i", &rotation, &position, &limb->offset[0],
                          &limb->offset[1], &limb->offset[2], &columns, &count, &velocities, &same,
                          &limb->floating))
        return 0;
    if (count != same || count > MOST_JOINTS) {
        PyErr_Format(PyExc_ValueError, "a limb of %zd and %zd joints: expected as many, at most %d",
                     count, same, MOST_JOINTS);
        return 0;
    }
    limb->count = (int)count;
    memcpy(limb->columns, columns, count);
    memcpy(limb->velocities, velocities, count);
    for (int k = 0; k < limb->count; k++)
        if (limb->velocities[k] >= NV ||
            6 * (limb->columns[k] + 1) * (Py_ssize_t)sizeof(double) > m->views[0].len) {
            PyErr_SetString(PyExc_ValueError, "a limb with a joint that the model does not have");
            return 0;
        }
    return (limb->rotation = view(m, rotation, 9, "rotation")) &&
           (limb->position = view(m, position, 3, "position"));
}

static PyObject *prepare(PyObject *module, PyObject *arguments)
{
    PyObject *J, *M, *h, *rotation, *position, *limbs[FRAMES];
    (void)module;
    Model *m = PyMem_Calloc(1, sizeof *m);
    if (m == NULL)
        return PyErr_NoMemory();
    PyObject *capsule = PyCapsule_New(m, "model", free_model);
    if (capsule == NULL) {
        PyMem_Free(m);
        return NULL;
    }
    int right =
        PyArg_ParseTuple(arguments, "OOOOO(ddd)OOOO", &J, &M, &h, &rotation, &position,
                         &m->gravity[0], &m->gravity[1], &m->gravity[2], &limbs[0], &limbs[1],
                         &limbs[2], &limbs[3]) &&
        (m->J = view(m, J, -1, "J")) && (m->M = view(m, M, NV * NV, "M")) &&
        (m->h = view(m, h, NV, "h")) && (m->rotation = view(m, rotation, 9, "base rotation")) &&
        (m->position = view(m, position, 3, "base position"));
    for (int i = 0; right && i < FRAMES; i++)
        right = read_limb(m, &m->limbs[i], limbs[i]) && m->limbs[i].floating == (i >= HANDS);
    if (right)
        return capsule;
    if (!PyErr_Occurred())
        PyErr_SetString(PyExc_ValueError, "expected two hands, then two feet");
    Py_DECREF(capsule);
    return NULL;
}

enum { ARRAYS = 11 };

static PyObject *update(PyObject *module, PyObject *arguments)
{
    Terms t;
    const double *v;
    const NativeArray arrays[ARRAYS] = {
        {"v", NV, 0, &v},
        {"rotation", 9, 1, &t.rotation},
        {"com", 3, 1, &t.com},
        {"mass", NV * NV, 1, &t.mass},
        {"force", NV, 1, &t.force},
        {"jacobian", ROWS * NV, 1, &t.jacobian},
        {"velocity", ROWS, 1, &t.velocity},
        {"bias", ROWS, 1, &t.bias},
        {"positions", 3 * FRAMES, 1, &t.positions},
        {"rotations", 9 * FRAMES, 1, &t.rotations},
        {"soles", 2 * 6 * NV, 1, &t.soles},
    };
    Py_buffer views[ARRAYS];
    (void)module;
    PyObject *capsule = PyTuple_GetItem(arguments, 0);
    const Model *m = capsule == NULL ? NULL : PyCapsule_GetPointer(capsule, "model");
    if (m == NULL || !native_take(arguments, 1, arrays, ARRAYS, views))
        return NULL;
    memset(t.jacobian, 0, ROWS * NV * sizeof(double));
    memset(t.soles, 0, 2 * 6 * NV * sizeof(double));
    memset(t.bias, 0, ROWS * sizeof(double));
    whole_body(m, &t);
    for (int i = 0; i < FRAMES; i++)
        frame(m, v, i, &t);
    for (int i = 0; i < ROWS; i++) {
        t.velocity[i] = 0.0;
        for (int j = 0; j < NV; j++)
            t.velocity[i] += t.jacobian[i * NV + j] * v[j];
    }
    native_release(views, ARRAYS);
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"prepare", prepare, METH_VARARGS,
     "prepare(J, M, h, rotation, position, gravity, left hand, right hand, left foot, right foot)"
     "\n\nReturn what update() needs of a model."},
    {"update", update, METH_VARARGS,
     "update(prepared, v, rotation, com, mass, force, jacobian, velocity, bias, positions, "
     "rotations, soles)\n\nWrite the terms at the reduced velocity v."},
    {NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, .m_name = "_model_terms",
                                        .m_size = -1, .m_methods = methods};

PyMODINIT_FUNC PyInit__model_terms(void) { return native_module(&definition); }
