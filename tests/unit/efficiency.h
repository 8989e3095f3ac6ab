/* efficiency.h - draws of the default identification, order unknown, scored against the Cramer-Rao
 * bound: for test and benchmark */
#ifndef TESTS_EFFICIENCY_H
#define TESTS_EFFICIENCY_H
#include <stdbool.h>
#include <stdio.h>
#include "modal/identify/identify.h"
#include "signals.h"

/* Over the draws of right order: squared errors over their bounds and parameters inside their 95 %
 * bars, each summed over `parameters`. */
struct efficiency { double squares, inside, parameters; int right, draws; };

/* The modes of R nearest to the truth, each used once, into S; RE and IM are the bounds. */
static inline void efficiency_compare(const struct decay *d, const struct identify_result *r,
                                      const double *re, const double *im, struct efficiency *s)
{
    bool used[DECAY_MODES] = { false };

    for (int j = 0; j < d->modes; j++) {
        int b = -1;
        for (int i = 0; i < r->mode_count; i++)
            if (!used[i] && (b < 0 || cabs(r->modes[i].exponent - d->lambda[j]) <
                                          cabs(r->modes[b].exponent - d->lambda[j])))
                b = i;
        used[b] = true;
        double complex e = r->modes[b].exponent - d->lambda[j];
        s->squares += pow(creal(e) / re[j], 2) + pow(cimag(e) / im[j], 2);
        s->inside += (fabs(creal(e)) <= 1.96 * r->modes[b].std_re) +
                     (fabs(cimag(e)) <= 1.96 * r->modes[b].std_im);
        s->parameters += 2;
    }
}

/* One draw of case K at SNR dB, three channels, into S.  False, and said on stderr, where it cannot
 * be identified. */
static inline bool efficiency_draw(const struct decay_case *k, double snr, uint64_t seed,
                                   struct efficiency *s)
{
    static double column[3 * 1200], samples[3 * 1200];
    struct random rng = { seed };
    struct identify_options opt = { 0 };
    struct identify_result r;
    struct modal_error err;
    double re[DECAY_MODES], im[DECAY_MODES], sd;
    struct decay d;

    decay_of_case(k, &rng, &d);
    decay_signals(&d, column, (size_t)d.samples);
    sd = decay_noise(&d, column, (size_t)d.samples, snr, &rng);
    decay_bound(&d, sd, re, im);
    for (int i = 0; i < d.samples; i++)
        for (int c = 0; c < 3; c++)
            samples[3 * i + c] = column[i + c * d.samples];
    struct batch b = {
        .samples = (size_t)d.samples, .channels = 3, .signals = samples, .dt = d.dt
    };
    if (modal_identify(&b, &opt, &r, &err) != MODAL_OK) {
        fprintf(stderr, "%s: %s\n", k->name, err.message);
        return false;
    }
    s->draws++;
    if (r.mode_count == d.modes && r.hankel_rank == 2 * d.modes) {
        s->right++;
        efficiency_compare(&d, &r, re, im, s);
    }
    identify_result_done(&r);
    return true;
}

#endif
