/* histogram.c - see histogram.h */
#include "broker/kit/histogram.h"

const double histogram_seconds[HISTOGRAM_BUCKETS] = {
    1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1,  0.2,  0.5, 1,    2,    5,    10 };
const double histogram_numbers[HISTOGRAM_BUCKETS] = {
    1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768
};

void histogram_add(struct histogram *h, const double bounds[HISTOGRAM_BUCKETS], double value)
{
    int i = 0;

    while (i < HISTOGRAM_BUCKETS && value > bounds[i])
        i++;
    h->counts[i]++;
    h->count++;
    h->sum += value;
}
