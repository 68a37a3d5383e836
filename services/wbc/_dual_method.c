/* Goldfarb and Idnani's dual active-set method for the QPs of the whole-body controller.
 *
 *     min 1/2 x' P x + q' x   subject to   l <= A x <= u,   B x_1 >= b (soft)
 *
 * P = diag(P_1, D) with a dense P_1 and a diagonal D. With P = L L' and y = L' x, every row n' x >= b
 * becomes w' y >= b, w = L^-1 n, and the cost 1/2 |y - y0|^2. The method starts from y0 and makes one
 * violated row after the other hold. In between it drops rows that only hold back. The binding rows'
 * w are kept as Q R with orthonormal Q (thin QR), which stays accurate where rows nearly depend on
 * each other. A soft row has a variable of its own that makes up for its violation, of a given weight
 * in the cost, and is a row like the others then.
 *
 * D. Goldfarb, A. Idnani: A numerically stable dual method for solving strictly convex quadratic
 * programs. Mathematical Programming 27 (1983), 1-33.
 */
#include "common/native.h"

#include <math.h>

enum {
    MOST_DENSE = 40,     /* variables of the dense block */
    MOST_VARIABLES = 96, /* all of them, with those of the soft rows */
    MOST_ROWS = 256,
    MOST_STEPS = 200,    /* rows added and dropped for one QP; in walking about one a tick */
};
/* Share of a row that is left beside the binding ones, squared, up to which it depends on them. */
static const double DEPENDENT = 1e-18;

typedef struct {
    int dense, hard_variables, variables, equalities, rows, soft;
    const double *P, *q, *A, *l, *u, *B, *b;
    double slack_weight, tolerance;
} Qp;

typedef struct {
    int row;           /* of A, or rows + i for the soft row i */
    double side;       /* 1: its lower bound binds, -1: its upper bound */
    double multiplier; /* pressure, not negative; of an equality of any sign */
} Binding;

typedef struct {
    double U[MOST_DENSE][MOST_DENSE]; /* L' of the dense block */
    double inverse[MOST_VARIABLES];   /* 1 / diagonal of L */
    double y[MOST_VARIABLES];
    double Q[MOST_VARIABLES][MOST_VARIABLES]; /* Q[k], R[k]: their columns k */
    double R[MOST_VARIABLES][MOST_VARIABLES];
    Binding binding[MOST_VARIABLES];
    char binds[MOST_ROWS];
    int count;
} Work;

/* Four sums, for the compiler must not reorder one. */
static double dot(const double *a, const double *b, int n)
{
    double s0 = 0.0, s1 = 0.0, s2 = 0.0, s3 = 0.0;
    int i = 0;
    for (; i + 4 <= n; i += 4) {
        s0 += a[i] * b[i];
        s1 += a[i + 1] * b[i + 1];
        s2 += a[i + 2] * b[i + 2];
        s3 += a[i + 3] * b[i + 3];
    }
    for (; i < n; i++)
        s0 += a[i] * b[i];
    return (s0 + s1) + (s2 + s3);
}

static void add_multiple(double *restrict y, double factor, const double *restrict x, int n)
{
    for (int i = 0; i < n; i++)
        y[i] += factor * x[i];
}

/* Returns 0 if P is not positive definite, as with numbers that are not finite. */
static int factorise(const Qp *qp, Work *w)
{
    const int n = qp->dense;
    for (int i = 0; i < n; i++)
        memcpy(&w->U[i][i], &qp->P[i * qp->hard_variables + i], (n - i) * sizeof(double));
    for (int i = 0; i < qp->variables; i++) {
        double pivot = i < n                    ? w->U[i][i]
                       : i < qp->hard_variables ? qp->P[i * (qp->hard_variables + 1)]
                                                : qp->slack_weight;
        if (!(pivot > 0.0 && pivot < INFINITY))
            return 0;
        w->inverse[i] = 1.0 / sqrt(pivot);
        if (i >= n)
            continue;
        for (int k = i; k < n; k++)
            w->U[i][k] *= w->inverse[i];
        for (int k = i + 1; k < n; k++)
            add_multiple(&w->U[k][k], -w->U[i][k], &w->U[i][k], n - k);
    }
    return 1;
}

/* v <- L^-1 v */
static void forward(const Qp *qp, const Work *w, double *v)
{
    for (int i = 0; i < qp->variables; i++) {
        v[i] *= w->inverse[i];
        if (i < qp->dense)
            add_multiple(&v[i + 1], -v[i], &w->U[i][i + 1], qp->dense - i - 1);
    }
}

/* v <- L'^-1 v */
static void backward(const Qp *qp, const Work *w, double *v)
{
    for (int i = qp->variables - 1; i >= 0; i--) {
        if (i < qp->dense)
            v[i] -= dot(&w->U[i][i + 1], &v[i + 1], qp->dense - i - 1);
        v[i] *= w->inverse[i];
    }
}

/* Writes n of a row n' x >= b and returns b. */
static double normal(const Qp *qp, int row, double side, double *n)
{
    const int hard = qp->hard_variables, soft = row - qp->rows;
    memset(n, 0, qp->variables * sizeof(double));
    if (soft >= 0) {
        memcpy(n, &qp->B[soft * qp->dense], qp->dense * sizeof(double));
        n[hard + soft] = 1.0;
        return qp->b[soft];
    }
    for (int i = 0; i < hard; i++)
        n[i] = side * qp->A[row * hard + i];
    return side > 0.0 ? qp->l[row] : -qp->u[row];
}

/* v <- v - Q Q' v, and c <- Q' v. Twice, for one pass loses digits where little of v is left. */
static void project(const Work *w, double *v, double *c, int n)
{
    memset(c, 0, w->count * sizeof(double));
    for (int pass = 0; pass < 2; pass++)
        for (int k = 0; k < w->count; k++) {
            double share = dot(w->Q[k], v, n);
            c[k] += share;
            add_multiple(v, -share, w->Q[k], n);
        }
}

/* c <- R^-1 c */
static void back_substitute(const Work *w, double *c)
{
    for (int k = w->count - 1; k >= 0; k--) {
        c[k] /= w->R[k][k];
        add_multiple(c, -c[k], w->R[k], k);
    }
}

static void drop(Work *w, int place, int n)
{
    w->binds[w->binding[place].row] = 0;
    w->count--;
    for (int k = place; k < w->count; k++) {
        w->binding[k] = w->binding[k + 1];
        memcpy(w->R[k], w->R[k + 1], (k + 2) * sizeof(double));
    }
    /* Givens rotations make R triangular again. */
    for (int k = place; k < w->count; k++) {
        double length = hypot(w->R[k][k], w->R[k][k + 1]);
        double c = w->R[k][k] / length, s = w->R[k][k + 1] / length;
        for (int j = k; j < w->count; j++) {
            double a = w->R[j][k], b = w->R[j][k + 1];
            w->R[j][k] = c * a + s * b;
            w->R[j][k + 1] = c * b - s * a;
        }
        for (int i = 0; i < n; i++) {
            double a = w->Q[k][i], b = w->Q[k + 1][i];
            w->Q[k][i] = c * a + s * b;
            w->Q[k + 1][i] = c * b - s * a;
        }
    }
}

/* Makes a violated row hold; returns 0 if it contradicts those that bind. */
static int add(const Qp *qp, Work *w, int row, double side)
{
    const int n = qp->variables;
    double image[MOST_VARIABLES], z[MOST_VARIABLES], r[MOST_VARIABLES], column[MOST_VARIABLES];
    const double bound = normal(qp, row, side, image);
    forward(qp, w, image);
    const double square = dot(image, image, n);
    double multiplier = 0.0;
    for (;;) {
        memcpy(z, image, n * sizeof(double));
        project(w, z, column, n);
        memcpy(r, column, w->count * sizeof(double));
        back_substitute(w, r);
        double left = dot(z, z, n), partial = INFINITY, full = INFINITY;
        if (left > DEPENDENT * square)
            full = (bound - dot(image, w->y, n)) / left;
        int weakest = -1;
        for (int k = qp->equalities; k < w->count; k++)
            if (r[k] > 0.0 && w->binding[k].multiplier < partial * r[k]) {
                partial = w->binding[k].multiplier / r[k];
                weakest = k;
            }
        const double step = full <= partial ? full : partial;
        if (!(step < INFINITY))
            return 0;
        for (int k = 0; k < w->count; k++)
            w->binding[k].multiplier -= step * r[k];
        multiplier += step;
        if (full < INFINITY)
            add_multiple(w->y, step, z, n);
        if (full <= partial) {
            const double length = sqrt(left), scale = 1.0 / length;
            for (int i = 0; i < n; i++)
                w->Q[w->count][i] = scale * z[i];
            memcpy(w->R[w->count], column, w->count * sizeof(double));
            w->R[w->count][w->count] = length;
            w->binds[row] = 1;
            w->binding[w->count++] = (Binding){row, side, multiplier};
            return 1;
        }
        drop(w, weakest, n);
    }
}

/* Returns the row that is violated most, with its side; -1 if each holds. */
static int worst(const Qp *qp, const double *x, double *side)
{
    const int hard = qp->hard_variables;
    double most = qp->tolerance;
    int found = -1;
    for (int row = 0; row < qp->rows + qp->soft; row++) {
        double below, above = -INFINITY;
        if (row < qp->rows) {
            double value = dot(&qp->A[row * hard], x, hard);
            below = qp->l[row] - value;
            above = value - qp->u[row];
        } else {
            int i = row - qp->rows;
            below = qp->b[i] - dot(&qp->B[i * qp->dense], x, qp->dense) - x[hard + i];
        }
        /* Also so if a number is not finite, for then no comparison holds. */
        if (!(below <= most && above <= most)) {
            *side = below > above ? 1.0 : -1.0;
            most = below > above ? below : above;
            found = row;
        }
    }
    return found;
}

/* Writes x and returns how many inequalities bind; -1 if there is no solution or none was found. */
static int minimise(const Qp *qp, Work *w, double *x)
{
    const int n = qp->variables;
    double side;
    w->count = 0;
    memset(w->binds, 0, sizeof w->binds);
    if (!factorise(qp, w))
        return -1;
    for (int i = 0; i < n; i++)
        w->y[i] = i < qp->hard_variables ? -qp->q[i] : 0.0;
    forward(qp, w, w->y);
    for (int row = 0; row < qp->equalities; row++)
        if (!add(qp, w, row, 1.0))
            return -1;
    for (int step = 0; step < MOST_STEPS; step++) {
        memcpy(x, w->y, n * sizeof(double));
        backward(qp, w, x);
        int row = worst(qp, x, &side);
        if (row < 0)
            return w->count - qp->equalities;
        /* A row that binds and does not hold is beyond what the numbers can tell. */
        if (w->binds[row] || w->count == n || !add(qp, w, row, side))
            return -1;
    }
    return -1;
}

enum { ARRAYS = 8 };

static PyObject *solve(PyObject *module, PyObject *arguments)
{
    PyObject *objects[ARRAYS];
    Py_buffer views[ARRAYS];
    double *result;
    Qp qp;
    (void)module;
    if (!PyArg_ParseTuple(arguments, "OOOOOOOOiidd", &objects[0], &objects[1], &objects[2],
                          &objects[3], &objects[4], &objects[5], &objects[6], &objects[7], &qp.dense,
                          &qp.equalities, &qp.slack_weight, &qp.tolerance))
        return NULL;
    const Py_ssize_t hard = PyObject_Size(objects[1]), rows = PyObject_Size(objects[3]);
    const Py_ssize_t soft = PyObject_Size(objects[6]);
    if (hard < 0 || rows < 0 || soft < 0)
        return NULL;
    if (qp.dense < 0 || qp.dense > MOST_DENSE || qp.dense > hard || qp.equalities < 0 ||
        qp.equalities > rows || qp.equalities > hard || hard + soft > MOST_VARIABLES ||
        rows + soft > MOST_ROWS)
        return PyErr_Format(PyExc_ValueError,
                            "%zd variables, %d of them dense, %zd rows, %d of them equalities, %zd "
                            "soft rows: expected at most %d, %d and %d variables and rows in all",
                            hard, qp.dense, rows, qp.equalities, soft, MOST_VARIABLES, MOST_DENSE,
                            MOST_ROWS);
    const NativeArray arrays[ARRAYS] = {
        {"P", hard * hard, 0, &qp.P}, {"q", hard, 0, &qp.q},
        {"A", hard * rows, 0, &qp.A}, {"l", rows, 0, &qp.l},
        {"u", rows, 0, &qp.u},        {"B", qp.dense * soft, 0, &qp.B},
        {"b", soft, 0, &qp.b},        {"x", hard, 1, &result},
    };
    if (!native_take(arguments, 0, arrays, ARRAYS, views))
        return NULL;
    qp.hard_variables = (int)hard;
    qp.variables = (int)(hard + soft);
    qp.rows = (int)rows;
    qp.soft = (int)soft;
    double x[MOST_VARIABLES];
    Work work;
    const int binding = minimise(&qp, &work, x);
    if (binding >= 0)
        memcpy(result, x, hard * sizeof(double));
    native_release(views, ARRAYS);
    return PyLong_FromLong(binding);
}

static PyMethodDef methods[] = {
    {"solve", solve, METH_VARARGS,
     "solve(P, q, A, l, u, B, b, x, dense, equalities, slack_weight, tolerance)\n\n"
     "Write the minimiser to x and return how many inequalities bind; -1 if there is none."},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, .m_name = "_dual_method", .m_size = -1, .m_methods = methods};

PyMODINIT_FUNC PyInit__dual_method(void)
{
    return native_module(&definition);
}
