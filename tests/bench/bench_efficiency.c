/* bench_efficiency.c - the default identification against the Cramer-Rao bound: six cases, three
 * noise levels, random draws
 *
 * Order unknown, defaults only.  For each case and level, over the draws: mean squared error of Re
 * and Im of all exponents over their bound (1 is the bound; its Monte Carlo interval, two
 * deviations of a chi-square mean, in `interval`), the share of draws with the right order, and the
 * share of true parameters inside the stated 95 % bars.  An argument sets the number of draws
 * (default 300).  Exit 1 where a figure misses its goal by more than its interval: 1.2 x the bound,
 * 98 %, 93 to 97 %.
 */
#include <stdio.h>
#include <stdlib.h>
#include "../unit/efficiency.h"

static void print(const struct decay_case *k, double snr, const char *what, double value,
                  const char *unit, double interval, double goal, int n)
{
    printf("{\"bench\":\"efficiency\",\"case\":\"%s %g dB: %s\",\"value\":%.4g,\"unit\":\"%s\","
           "\"interval\":%.2g,\"peer\":\"goal\",\"ratio\":%.4g,\"n\":%d}\n",
           k->name, snr, what, value, unit, interval, value / goal, n);
}

int main(int argc, char **argv)
{
    int draws = argc > 1 ? atoi(argv[1]) : 300, bad = 0;
    const double levels[3] = { 60, 40, 20 };

    for (int k = 0; k < 6; k++)
        for (int q = 0; q < 3; q++) {
            struct efficiency s = { 0 };
            for (int i = 0; i < draws; i++)
                if (!efficiency_draw(
                        &decay_cases[k], levels[q],
                        1 + 7919 * (uint64_t)i + 100003 * (uint64_t)q + 1000003 * (uint64_t)k, &s))
                    return 1;
            double n = s.parameters, mse = s.squares / n, right = (double)s.right / s.draws,
                   cover = s.inside / n;
            print(&decay_cases[k], levels[q], "mean squared error", mse, "x bound", 2 * sqrt(2 / n),
                  1.2, draws);
            print(&decay_cases[k], levels[q], "order right", right, "share",
                  2 * sqrt(0.02 * 0.98 / s.draws), 0.98, draws);
            print(&decay_cases[k], levels[q], "inside 95 % bars", cover, "share",
                  2 * sqrt(0.05 * 0.95 / n), 0.95, draws);
            bad += mse > 1.2 + 2 * sqrt(2 / n) || right < 0.98 - 2 * sqrt(0.02 * 0.98 / s.draws)
                || fabs(cover - 0.95) > 0.02 + 2 * sqrt(0.05 * 0.95 / n);
            fflush(stdout);
        }
    return bad > 0;
}
