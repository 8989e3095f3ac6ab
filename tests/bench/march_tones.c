/* march_tones.c - Runge and Kutta's steps of a small system under tones; bench_tones.py's reference
 *
 * Standard input, numbers alone:
 *
 *     n M C K (n n each, by rows)
 *     laws, each: kind i j p q    j -1: ground; of kind 0 p d^3, 1 gap p and clearance q,
 *                                 2 slider p and limit q, 3 p d^2 d', 4 p tanh(d' / q)
 *     loads, each: i w cos sin
 *     lines, each: w, then re and im of every dof; of the motion to begin with, 0: begin at rest
 *     h before steps every
 *
 * From -BEFORE h to 0 sliders follow the lines; then STEPS steps of the system itself.  Every
 * EVERY-th instant out: time and x.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { DOFS = 128, LAWS = 256, LOADS = 64, LINES = 8192 };

static int n, laws, loads, lines;
static double iM[DOFS * DOFS], A[DOFS * DOFS], B[DOFS * DOFS];    /* M^-1; M^-1 K; M^-1 C */
static int begin[DOFS], end[DOFS];          /* of a row's numbers that are not 0, in all three */
static struct { int kind, i, j; double p, q, z; } law[LAWS];
static struct { int i; double w, c, s; } load[LOADS];
static double omega[LINES], *re, *im;

static double number(void)
{
    double x;

    if (scanf("%lf", &x) != 1)
        exit(2);
    return x;
}

/* M^-1 by elimination: small and definite. */
static void invert(double *M)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            iM[i * n + j] = i == j;
    for (int c = 0; c < n; c++) {
        double pivot = M[c * n + c];

        for (int j = 0; j < n; j++)
            M[c * n + j] /= pivot, iM[c * n + j] /= pivot;
        for (int r = 0; r < n; r++) {
            double f = M[r * n + c];

            for (int j = 0; r != c && j < n; j++)
                M[r * n + j] -= f * M[c * n + j], iM[r * n + j] -= f * iM[c * n + j];
        }
    }
}

static void read_matrix(double *to)
{
    for (int e = 0; e < n * n; e++)
        to[e] = number();
}

static void read_all(void)
{
    static double raw[3][DOFS * DOFS];

    n = (int)number();
    for (int a = 0; a < 3; a++)
        read_matrix(raw[a]);
    invert(raw[0]);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            for (int k = 0; k < n; k++) {
                B[i * n + j] += iM[i * n + k] * raw[1][k * n + j];
                A[i * n + j] += iM[i * n + k] * raw[2][k * n + j];
            }
    for (int i = 0; i < n; i++) {
        begin[i] = n;
        for (int j = 0; j < n; j++)
            if (iM[i * n + j] != 0 || A[i * n + j] != 0 || B[i * n + j] != 0) {
                begin[i] = j < begin[i] ? j : begin[i];
                end[i] = j + 1;
            }
    }
    laws = (int)number();
    for (int l = 0; l < laws; l++) {
        law[l].kind = (int)number(), law[l].i = (int)number(), law[l].j = (int)number();
        law[l].p = number(), law[l].q = number();
    }
    loads = (int)number();
    for (int l = 0; l < loads; l++) {
        load[l].i = (int)number(), load[l].w = number();
        load[l].c = number(), load[l].s = number();
    }
    lines = (int)number();
    re = calloc((size_t)lines * (size_t)n + 1, sizeof *re);
    im = calloc((size_t)lines * (size_t)n + 1, sizeof *im);
    for (int l = 0; l < lines; l++) {
        omega[l] = number();
        for (int i = 0; i < n; i++)
            re[l * n + i] = number(), im[l * n + i] = number();
    }
}

static void lines_at(double t, double *x, double *v)
{
    memset(x, 0, (size_t)n * sizeof *x), memset(v, 0, (size_t)n * sizeof *v);
    for (int l = 0; l < lines; l++) {
        double c = cos(omega[l] * t), s = sin(omega[l] * t);

        for (int i = 0; i < n; i++) {
            x[i] += re[l * n + i] * c - im[l * n + i] * s;
            v[i] -= omega[l] * (re[l * n + i] * s + im[l * n + i] * c);
        }
    }
}

static double extension(int l, const double *x)
{
    return x[law[l].i] - (law[l].j < 0 ? 0 : x[law[l].j]);
}

static double law_force(int l, double d, double v)
{
    double p = law[l].p, q = law[l].q, f;

    switch (law[l].kind) {
    case 0: return p * d * d * d;
    case 1: return d > q ? p * (d - q) : 0;
    case 2: f = p * (d - law[l].z); return f > q ? q : f < -q ? -q : f;
    case 3: return p * d * d * v;
    default: return p * tanh(v / q);
    }
}

static void slide(const double *x)
{
    for (int l = 0; l < laws; l++)
        if (law[l].kind == 2) {
            double d = extension(l, x), f = law[l].p * (d - law[l].z);

            if (fabs(f) > law[l].q)
                law[l].z = d - copysign(law[l].q, f) / law[l].p;
        }
}

static void accelerate(double t, const double *x, const double *v, double *a)
{
    double f[DOFS] = { 0 };

    for (int l = 0; l < loads; l++)
        f[load[l].i] += load[l].c * cos(load[l].w * t) + load[l].s * sin(load[l].w * t);
    for (int l = 0; l < laws; l++) {
        double g = law_force(l, extension(l, x), extension(l, v));

        f[law[l].i] -= g;
        if (law[l].j >= 0)
            f[law[l].j] += g;
    }
    for (int i = 0; i < n; i++) {
        a[i] = 0;
        for (int j = begin[i]; j < end[i]; j++)
            a[i] += iM[i * n + j] * f[j] - A[i * n + j] * x[j] - B[i * n + j] * v[j];
    }
}

static void step(double t, double h, double *x, double *v)
{
    static const double at[4] = { 0, 0.5, 0.5, 1 }, weight[4] = { 1, 2, 2, 1 };
    double dx[DOFS] = { 0 }, dv[DOFS] = { 0 }, k[DOFS], y[DOFS], u[DOFS], w[DOFS];

    for (int s = 0; s < 4; s++) {
        for (int i = 0; i < n; i++) {
            y[i] = x[i] + (s > 0 ? at[s] * h * w[i] : 0);
            u[i] = v[i] + (s > 0 ? at[s] * h * k[i] : 0);
        }
        memcpy(w, u, (size_t)n * sizeof *w);
        accelerate(t + at[s] * h, y, u, k);
        for (int i = 0; i < n; i++)
            dx[i] += weight[s] * w[i], dv[i] += weight[s] * k[i];
    }
    for (int i = 0; i < n; i++)
        x[i] += h / 6 * dx[i], v[i] += h / 6 * dv[i];
    slide(x);
}

int main(void)
{
    double x[DOFS] = { 0 }, v[DOFS] = { 0 }, h;
    long before, steps, every;

    read_all();
    h = number(), before = (long)number(), steps = (long)number(), every = (long)number();
    for (long s = lines > 0 ? -before : 0; s <= 0; s++) {
        lines_at((double)s * h, x, v);
        slide(x);
    }
    for (long s = 0; s <= steps; s++) {
        if (s % every == 0) {
            double row[DOFS + 1] = { (double)s * h };

            memcpy(row + 1, x, (size_t)n * sizeof *x);
            fwrite(row, sizeof *row, (size_t)n + 1, stdout);
        }
        step((double)s * h, h, x, v);
    }
    return 0;
}
