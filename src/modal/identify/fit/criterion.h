/* criterion.h - what a model of the signals is worth: the one number by which models are
 * compared */
#ifndef MODAL_CRITERION_H
#define MODAL_CRITERION_H
#include <stdbool.h>

/* Where a pole may be told from the others, a row: ordinates that remainder.h looks at, of
 * independent ones. */
enum { CRITERION_PLACES = 4 };

/* The signals that models are compared on. */
struct criterion {
    int groups, phases;          /* signals; columns of each */
    double numbers;              /* of a signal: rows x phases */
    double own;                  /* of those, independent ones: a filter leaves a share */
    bool exact;                  /* what is left is rounding, not white: (3) of criterion.c is */
    const double *energy;        /* borrowed, per signal: sum of squares; 0: it is not there */
    const double *floor2;        /* borrowed, per signal: variance below which nothing is signal */
    double white;                /* share of its columns that are free in noise, for (3); 0: 1 */
};

/*
 * (1) of criterion.c for a model of so many POLES (poles_apart), of ORDER columns, and PARAMETERS
 * exponents that leaves the sum of squares FACTOR times RSS[g] in signal g. Less is better; only
 * differences mean anything.
 */
double criterion_of(const struct criterion *c, const double *rss, double factor, int poles,
                    int order, int parameters);

/* (2): what a parameter costs more where there are so many UNKNOWNS for so few NUMBERS. */
double criterion_scarcity(double unknowns, double numbers);

/* The part of it that a model pays for its size. */
double criterion_price(const struct criterion *c, int poles, int order, int parameters);

/* Of a periodic system of so many COLUMNS, a share WHITE of them free in noise, NUMBERS in all: the
 * chi-squared that noise gives a pair at most, but in one of 1000 records; the order after which
 * white noise could give a pair all that is left. */
double criterion_noise_pair(double columns, double white, double numbers);
int criterion_order_told(double columns, double numbers);
/* The chance that white noise, NUMBERS in so many COLUMNS, gives the best pole of K columns in each
 * of them so much CHI2, wherever that is: the number of places times that of one, 1 at most. */
double criterion_chance(double columns, double numbers, double chi2, int k);
#endif
