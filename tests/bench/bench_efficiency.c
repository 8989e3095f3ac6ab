/* bench_efficiency.c - the default identification against the Cramer-Rao bound: six cases, three noise levels, random draws
 *
 * Order unknown, defaults only.  For each case and level, over the draws: mean squared error of Re and Im of all exponents over their bound
 * (1 is the bound; its Monte Carlo interval, two deviations of a chi-square mean, in `interval`), the share of draws with the right
 * order, and the share of true parameters inside the stated 95 % bars.  An argument sets the number of draws (default 300).  Exit 1 where a figure
 * misses its goal by more than its interval: 1.2 x the bound, 98 %, 93 to 97 %.
 */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include "modal/identify/identify.h"
#include "../unit/signals.h"

static double column[3 * 1200], samples[3 * 1200];

struct score { double squares, inside; int parameters, right, draws; };

/* Modes nearest to the truth, each used once. */
static void compare(const struct decay *d, const struct identify_result *r, const double *re, const double *im, struct score *s)
{
    bool used[DECAY_MODES] = { false };

    for (int j = 0; j < d->modes; j++) {
        int b = -1;
        for (int i = 0; i < r->mode_count; i++)
            if (!used[i] && (b < 0 || cabs(r->modes[i].exponent - d->lambda[j]) < cabs(r->modes[b].exponent - d->lambda[j])))
                b = i;
        used[b] = true;
        double complex e = r->modes[b].exponent - d->lambda[j];
        s->squares += pow(creal(e) / re[j], 2) + pow(cimag(e) / im[j], 2);
        s->inside += (fabs(creal(e)) <= 1.96 * r->modes[b].std_re) + (fabs(cimag(e)) <= 1.96 * r->modes[b].std_im);
        s->parameters += 2;
    }
}

static bool draw(const struct decay_case *k, double snr, uint64_t seed, struct score *s)
{
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
    struct batch b = { .samples = (size_t)d.samples, .channels = 3, .signals = samples, .dt = d.dt };
    if (modal_identify(&b, &opt, &r, &err) != MODAL_OK) {
        fprintf(stderr, "%s: %s\n", k->name, err.message);
        return false;
    }
    s->draws++;
    if (r.mode_count == d.modes && r.hankel_rank == 2 * d.modes) {
        s->right++;
        compare(&d, &r, re, im, s);
    }
    identify_result_done(&r);
    return true;
}

static void print(const struct decay_case *k, double snr, const char *what, double value, const char *unit, double interval, double goal, int n)
{
    printf("{\"bench\":\"efficiency\",\"case\":\"%s %g dB: %s\",\"value\":%.4g,\"unit\":\"%s\",\"interval\":%.2g,\"peer\":\"goal\",\"ratio\":%.4g,\"n\":%d}\n",
           k->name, snr, what, value, unit, interval, value / goal, n);
}

int main(int argc, char **argv)
{
    int draws = argc > 1 ? atoi(argv[1]) : 300, bad = 0;
    const double levels[3] = { 60, 40, 20 };

    for (int k = 0; k < 6; k++)
        for (int q = 0; q < 3; q++) {
            struct score s = { 0 };
            for (int i = 0; i < draws; i++)
                if (!draw(&decay_cases[k], levels[q], 1 + 7919 * (uint64_t)i + 100003 * (uint64_t)q + 1000003 * (uint64_t)k, &s))
                    return 1;
            double n = s.parameters, mse = s.squares / n, right = (double)s.right / s.draws, cover = s.inside / n;
            print(&decay_cases[k], levels[q], "mean squared error", mse, "x bound", 2 * sqrt(2 / n), 1.2, draws);
            print(&decay_cases[k], levels[q], "order right", right, "share", 2 * sqrt(0.02 * 0.98 / s.draws), 0.98, draws);
            print(&decay_cases[k], levels[q], "inside 95 % bars", cover, "share", 2 * sqrt(0.05 * 0.95 / n), 0.95, draws);
            bad += mse > 1.2 + 2 * sqrt(2 / n) || right < 0.98 - 2 * sqrt(0.02 * 0.98 / s.draws)
                || fabs(cover - 0.95) > 0.02 + 2 * sqrt(0.05 * 0.95 / n);
            fflush(stdout);
        }
    return bad > 0;
}
