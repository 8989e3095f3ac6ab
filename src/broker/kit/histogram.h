/* histogram.h - how often a duration or a size fell into each of fixed buckets, as Prometheus
 * counts them */
#ifndef BROKER_HISTOGRAM_H
#define BROKER_HISTOGRAM_H
#include <stdint.h>

enum { HISTOGRAM_BUCKETS = 16 };  /* five decades of seconds at three a decade, and the ends */

struct histogram {
    int64_t counts[HISTOGRAM_BUCKETS + 1];   /* up to each bound, and above the last */
    double sum;
    int64_t count;
};

/* Bounds of seconds (0.1 ms to 10 s) and of numbers (1 to 32768), ascending. */
extern const double histogram_seconds[HISTOGRAM_BUCKETS], histogram_numbers[HISTOGRAM_BUCKETS];

/* VALUE into the first bucket whose bound is not below it. */
void histogram_add(struct histogram *h, const double bounds[HISTOGRAM_BUCKETS], double value);
#endif
