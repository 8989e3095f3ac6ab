/* answer.h - what identify says of rows of signals, and whether it is right; for tests */
#ifndef TESTS_ANSWER_H
#define TESTS_ANSWER_H
#include "modal/identify/identify.h"
#include <complex.h>
#include <math.h>
#include <string.h>
#include "check.h"

/* The answer on Y from T0 (WINDOW_AUTO: what window=auto takes); PERIOD 0: of a constant system. */
static inline struct identify_result identified(const double *y, int samples, int channels,
                                                double t0, double period)
{
    struct batch b = { .samples = (size_t)samples, .channels = (size_t)channels, .signals = y,
                       .dt = 1, .period = period };
    struct identify_options opt = { .window = { t0, 0 } };
    struct identify_result r;

    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    return r;
}

/* Is R said not to be free throughout? */
static inline bool told(const struct identify_result *r)
{
    bool found = false;

    for (int i = 0; i < r->diagnostic_count; i++)
        found |= strcmp(r->diagnostics[i].code, "not_free_throughout") == 0;
    return found;
}

/* The mode nearest LAMBDA lies within LEEWAY of its standard deviations, or rounding. */
static inline bool shows(const struct identify_result *r, double complex lambda, double leeway)
{
    int at = -1;

    for (int i = 0; i < r->mode_count; i++)
        if (at < 0 || cabs(r->modes[i].exponent - lambda) < cabs(r->modes[at].exponent - lambda))
            at = i;
    if (at < 0)
        return false;
    double complex d = r->modes[at].exponent - lambda;
    return fabs(creal(d)) <= leeway * r->modes[at].std_re + 1e-9
        && fabs(cimag(d)) <= leeway * r->modes[at].std_im + 1e-9;
}
#endif
