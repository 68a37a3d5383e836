/* Fills the QP of one tick from tasks and model, as qp.py and tasks.py say it. */
#include "common/native.h"

#include <math.h>

enum {
    NV = 31,
    MOTORS = NV - 6,
    TORSO = 3, /* first row of its rotation, after the centre of mass */
    FIRST_FRAME = 6, /* of both hands and both feet, with position and rotation */
    FRAMES = 4,
    FRAME_ROWS = FIRST_FRAME + 6 * FRAMES, /* then one row for the posture of each upper-body motor */
    UPPER_BODY = 12, /* first motor of it */
    TASKS = FRAME_ROWS + MOTORS - UPPER_BODY,
    ARM_MOTORS = 12,
    FEET = 2,
    FZ = 2,
    VARIABLES = NV + 6 * FEET,
    CONE_ROWS = 17,
    CONES = NV,
    NORMAL = CONES + CONE_ROWS * FEET,
    BOUNDS = NORMAL + FEET,
    CONSTRAINTS = BOUNDS + MOTORS,
};

typedef struct {
    double *P, *q, *A, *l, *u;
    const double *rows; /* of each task: Jacobian and target */
    const double *weight, *motor_position, *motor_velocity, *mass, *force, *soles;
    const double *torque_limit, *arm_limits;
    double normal_max[FEET], normal_desired[FEET];
    double regulariser, force_weight, stiffness, damping, acceleration_max, airborne, infinity;
} Qp;

/* Hessian and gradient of 1/2 sum_i w_i |J_i qdd - target_i|^2 + 1/2 regulariser |qdd|^2 */
static void write_cost(const Qp *p)
{
    for (int i = 0; i < NV; i++) {
        memset(&p->P[i * VARIABLES + i], 0, (NV - i) * sizeof(double));
        p->P[i * VARIABLES + i] = p->regulariser;
        p->q[i] = 0.0;
    }
    for (int task = 0; task < TASKS; task++) {
        const double *row = &p->rows[task * (NV + 1)];
        for (int i = 0; i < NV; i++) {
            if (row[i] == 0.0)
                continue;
            const double weighted = p->weight[task] * row[i];
            double *restrict hessian = &p->P[i * VARIABLES];
            for (int j = i; j < NV; j++)
                hessian[j] += weighted * row[j];
            p->q[i] -= weighted * row[NV];
        }
    }
    for (int i = 1; i < NV; i++)
        for (int j = 0; j < i; j++)
            p->P[i * VARIABLES + j] = p->P[j * VARIABLES + i];
}

static void write_dynamics(const Qp *p)
{
    for (int i = 0; i < NV; i++) {
        memcpy(&p->A[i * VARIABLES], &p->mass[i * NV], NV * sizeof(double));
        p->l[i] = -p->torque_limit[i] - p->force[i];
        p->u[i] = p->torque_limit[i] - p->force[i];
    }
}

static void write_contact(const Qp *p, int side)
{
    const int carries = p->normal_max[side] > p->airborne, first = NV + 6 * side;
    const double *sole = &p->soles[side * 6 * NV];
    for (int i = 0; i < NV; i++)
        for (int k = 0; k < 6; k++)
            p->A[i * VARIABLES + first + k] = carries ? -sole[k * NV + i] : 0.0;
    for (int i = 0; i < CONE_ROWS; i++)
        p->l[CONES + CONE_ROWS * side + i] = carries ? 0.0 : -p->infinity;
    p->u[NORMAL + side] = carries ? p->normal_max[side] : p->infinity;
    p->q[first + FZ] = -p->force_weight * p->normal_desired[side];
}

static double clamp(double value, double limit)
{
    return value < -limit ? -limit : value > limit ? limit : value;
}

static void write_arm_bounds(const Qp *p)
{
    for (int i = 0; i < ARM_MOTORS; i++) {
        const double position = p->motor_position[UPPER_BODY + i];
        const double braking = p->damping * p->motor_velocity[UPPER_BODY + i];
        const int row = BOUNDS + UPPER_BODY + i;
        double lower = p->stiffness * (p->arm_limits[i] - position) - braking;
        double upper = p->stiffness * (p->arm_limits[ARM_MOTORS + i] - position) - braking;
        p->l[row] = clamp(lower, p->acceleration_max);
        p->u[row] = clamp(upper, p->acceleration_max);
    }
}

/* Rotation vector of A B', both row-major, as rotation_vector_from_matrix() computes it. */
static void write_turn(const double *A, const double *B, double *vector)
{
    double R[3][3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            R[i][j] = A[3 * i] * B[3 * j] + A[3 * i + 1] * B[3 * j + 1] + A[3 * i + 2] * B[3 * j + 2];
    const double skew[3] = {R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]};
    const double trace = 0.5 * (R[0][0] + R[1][1] + R[2][2] - 1.0);
    const double cosine = trace < -1.0 ? -1.0 : trace > 1.0 ? 1.0 : trace;
    const double sine =
        0.5 * sqrt(skew[0] * skew[0] + skew[1] * skew[1] + skew[2] * skew[2]);
    if (cosine >= -0.999999) {
        const double scale = sine < 1e-9 ? 0.5 : 0.5 * atan2(sine, cosine) / sine;
        for (int i = 0; i < 3; i++)
            vector[i] = scale * skew[i];
        return;
    }
    /* Near half a turn the axis is in the symmetric part, cos I + (1 - cos) a a'. */
    int k = 0;
    for (int i = 1; i < 3; i++)
        k = R[i][i] > R[k][k] ? i : k;
    const double square = (R[k][k] - cosine) / (1.0 - cosine);
    double along = 0.0;
    for (int i = 0; i < 3; i++) {
        vector[i] = (0.5 * (R[i][k] + R[k][i]) - (i == k ? cosine : 0.0)) / (1.0 - cosine);
        vector[i] /= sqrt(square);
        along += vector[i] * skew[i];
    }
    for (int i = 0; i < 3; i++)
        vector[i] *= (along >= 0.0 ? 1.0 : -1.0) * atan2(sine, cosine);
}

enum { TASK_ARRAYS = 17, ARRAYS = 14, SCALARS = 11 };

static PyObject *write_tasks(PyObject *module, PyObject *arguments)
{
    double *rows, *error;
    const double *kp, *kd, *position, *rotation, *velocity, *acceleration;
    const double *jacobian, *measured, *bias, *com, *base_rotation, *positions, *rotations;
    const double *motor_position, *motor_velocity;
    const NativeArray arrays[TASK_ARRAYS] = {
        {"rows", TASKS * (NV + 1), 1, &rows},
        {"error", TASKS, 1, &error},
        {"kp", TASKS, 0, &kp},
        {"kd", TASKS, 0, &kd},
        {"position", TASKS, 0, &position},
        {"rotation", 9 * (1 + FRAMES), 0, &rotation},
        {"velocity", TASKS, 0, &velocity},
        {"acceleration", TASKS, 0, &acceleration},
        {"jacobian", FRAME_ROWS * NV, 0, &jacobian},
        {"measured", FRAME_ROWS, 0, &measured},
        {"bias", FRAME_ROWS, 0, &bias},
        {"com", 3, 0, &com},
        {"base_rotation", 9, 0, &base_rotation},
        {"positions", 3 * FRAMES, 0, &positions},
        {"rotations", 9 * FRAMES, 0, &rotations},
        {"motor_position", MOTORS, 0, &motor_position},
        {"motor_velocity", MOTORS, 0, &motor_velocity},
    };
    Py_buffer views[TASK_ARRAYS];
    (void)module;
    if (!native_take(arguments, 0, arrays, TASK_ARRAYS, views))
        return NULL;
    write_turn(rotation, base_rotation, &error[TORSO]);
    for (int i = 0; i < 3; i++) {
        error[i] = position[i] - com[i];
        for (int frame = 0; frame < FRAMES; frame++) {
            const int row = FIRST_FRAME + 6 * frame + i;
            error[row] = position[row] - positions[3 * frame + i];
        }
    }
    for (int frame = 0; frame < FRAMES; frame++)
        write_turn(&rotation[9 * (1 + frame)], &rotations[9 * frame],
                   &error[FIRST_FRAME + 6 * frame + 3]);
    for (int i = FRAME_ROWS; i < TASKS; i++)
        error[i] = position[i] - motor_position[UPPER_BODY + i - FRAME_ROWS];
    for (int i = 0; i < TASKS; i++) {
        double *row = &rows[i * (NV + 1)], is, moving = 0.0;
        if (i < FRAME_ROWS) {
            memcpy(row, &jacobian[i * NV], NV * sizeof(double));
            is = measured[i];
            moving = bias[i];
        } else {
            is = motor_velocity[UPPER_BODY + i - FRAME_ROWS];
        }
        row[NV] = kd[i] * (velocity[i] - is) + kp[i] * error[i] + acceleration[i] - moving;
    }
    native_release(views, TASK_ARRAYS);
    Py_RETURN_NONE;
}

static PyObject *fill(PyObject *module, PyObject *arguments)
{
    Qp p;
    Py_buffer views[ARRAYS];
    const NativeArray arrays[ARRAYS] = {
        {"P", VARIABLES * VARIABLES, 1, &p.P},
        {"q", VARIABLES, 1, &p.q},
        {"A", CONSTRAINTS * VARIABLES, 1, &p.A},
        {"l", CONSTRAINTS, 1, &p.l},
        {"u", CONSTRAINTS, 1, &p.u},
        {"rows", TASKS * (NV + 1), 0, &p.rows},
        {"weight", TASKS, 0, &p.weight},
        {"motor_position", MOTORS, 0, &p.motor_position},
        {"motor_velocity", MOTORS, 0, &p.motor_velocity},
        {"mass", NV * NV, 0, &p.mass},
        {"force", NV, 0, &p.force},
        {"soles", FEET * 6 * NV, 0, &p.soles},
        {"torque_limit", NV, 0, &p.torque_limit},
        {"arm_limits", 2 * ARM_MOTORS, 0, &p.arm_limits},
    };
    double *const scalars[SCALARS] = {
        &p.normal_max[0], &p.normal_max[1], &p.normal_desired[0], &p.normal_desired[1],
        &p.regulariser,   &p.force_weight,  &p.stiffness,         &p.damping,
        &p.acceleration_max, &p.airborne,   &p.infinity,
    };
    (void)module;
    for (int i = 0; i < SCALARS; i++) {
        PyObject *number = PyTuple_GetItem(arguments, ARRAYS + i);
        if (number == NULL || ((*scalars[i] = PyFloat_AsDouble(number)) == -1.0 && PyErr_Occurred()))
            return NULL;
    }
    if (!native_take(arguments, 0, arrays, ARRAYS, views))
        return NULL;
    write_cost(&p);
    write_dynamics(&p);
    for (int side = 0; side < FEET; side++)
        write_contact(&p, side);
    write_arm_bounds(&p);
    native_release(views, ARRAYS);
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"write_tasks", write_tasks, METH_VARARGS,
     "write_tasks(rows, error, kp, kd, position, rotation, velocity, acceleration, jacobian, "
     "measured, bias, com, base_rotation, positions, rotations, motor_position, motor_velocity)"
     "\n\nWrite error, Jacobian and target of each task."},
    {"fill", fill, METH_VARARGS,
     "fill(P, q, A, l, u, rows, weight, motor_position, motor_velocity, mass, force, soles, "
     "torque_limit, arm_limits, normal_max left, right, normal_desired left, right, regulariser, "
     "force_weight, stiffness, damping, acceleration_max, airborne, infinity)\n\n"
     "Write P, q, A, l, u of one tick, without constant rows."},
    {NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, .m_name = "_qp", .m_size = -1,
                                        .m_methods = methods};

PyMODINIT_FUNC PyInit__qp(void) { return native_module(&definition); }
