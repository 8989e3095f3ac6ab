/* loop.c - a time-stepping loop with the three lines of modald_stream.h
 *
 * Two masses on springs, lightly damped, by the velocity form of Newmark's method (beta = 1/4,
 * gamma = 1/2):
 *
 *     m x'' + c x' + K x = 0,   K = k [2 -1; -1 2],   x(0) = (1, 0).
 *
 * usage: example_loop NAME STEPS [C] [SECONDS]
 * C is the damping (negative: grows), SECONDS the real time of each step.  The states go to stdout
 * too, so that a test can compare the run with and without a daemon.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE          /* POSIX, where the build asks for bare C */
#endif
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "modald_stream.h"

enum { N = 2 };

/* x'' at the state. */
static void accelerate(const double *x, const double *v, double c, double *a)
{
    static const double k = 4e4;

    a[0] = -k * (2 * x[0] - x[1]) - c * v[0];
    a[1] = -k * (2 * x[1] - x[0]) - c * v[1];
}

/* One step; the implicit equations by iterating to rounding: push only what has converged. */
static void step(double *x, double *v, double *a, double c, double dt)
{
    double x0[N], v0[N], a0[N];

    for (int i = 0; i < N; i++) {
        x0[i] = x[i];
        v0[i] = v[i];
        a0[i] = a[i];
    }
    for (int turn = 0; turn < 40; turn++) {
        for (int i = 0; i < N; i++) {
            x[i] = x0[i] + dt * v0[i] + dt * dt / 4 * (a0[i] + a[i]);
            v[i] = v0[i] + dt / 2 * (a0[i] + a[i]);
        }
        accelerate(x, v, c, a);
    }
}

int main(int argc, char **argv)
{
    const char *name = argc > 1 ? argv[1] : "loop";
    long steps = argc > 2 ? atol(argv[2]) : 1000;
    double c = argc > 3 ? atof(argv[3]) : 2.0, pause = argc > 4 ? atof(argv[4]) : 0, dt = 1e-3;
    double x[N] = { 1, 0 }, v[N] = { 0 }, a[N];
    struct timespec rest = { (time_t)pause, (long)(1e9 * (pause - (double)(time_t)pause)) };

    accelerate(x, v, c, a);
    modald_stream *s = modald_open(name, N, dt);
    for (long i = 0; i < steps; i++) {
        modald_push(s, x);
        fwrite(x, sizeof *x, N, stdout);
        if (modald_verdict(s) == MODALD_UNSTABLE)
            break;
        step(x, v, a, c, dt);
        if (pause > 0)
            nanosleep(&rest, NULL);
    }
    modald_close(s);
    return 0;
}
