/* exponents.h - from multipliers to exponents, corrected eq. (10) of the identification paper */
#ifndef MODAL_EXPONENTS_H
#define MODAL_EXPONENTS_H
#include <complex.h>
#include <stdbool.h>

/* ln of the largest growth whose exponential is taken: e^709 is the last that is finite. */
#define EXPONENT_MOST 700.0

/*
 * A multiplier rho over a step tau and its exponent, rho = exp(lambda tau), Im lambda in (-pi/tau,
 * pi/tau]. Throughout `identify` a set of poles is a list with one entry per conjugate pair or real
 * multiplier:
 *
 *   Im lambda in (0, pi/tau)       a pair, two real unknowns in each channel
 *   Im lambda = 0, exactly         a real positive multiplier, one unknown
 *   Im lambda = pi/tau, exactly  a real negative multiplier, one unknown: the column (-1)^l |rho|^l
 */
enum pole_kind { POLE_PAIR, POLE_REAL, POLE_NEGATIVE };

/* Which of them LAMBDA is, over TAU seconds. */
enum pole_kind pole_kind(double complex lambda, double tau);
/* 2 for a pair, else 1. */
int pole_order(double complex lambda, double tau);
int poles_order(const double complex *lambda, int count, double tau);
/* How many pairs and real multipliers that is. A pair that ROWS steps do not tell from two real
 * ones, for its own two are nearer than half a beat, counts as two. */
int poles_apart(const double complex *lambda, int count, double tau, int rows);

/* The exponent of RHO != 0; -HUGE_VAL as real part for rho = 0 ("faster than the sampling"). */
double complex exponent_of(double complex rho, double tau);
/* exp(lambda tau), exactly real for the two real kinds. */
double complex multiplier_of(double complex lambda, double tau);

/* ln|rho| without cancellation near |rho| = 1. */
double log_modulus(double complex rho);

/* |lambda|, and our damping ratio -Re/|lambda| (positive decays), 0 for lambda = 0. */
double frequency_of(double complex lambda);
double damping_ratio_of(double complex lambda);

/*
 * The poles of COUNT multipliers as LAPACK lists them (both of each pair), into LAMBDA (room for
 * COUNT); returns how many. Zeros, and what is below FLOOR in modulus, are left out and counted in
 * *dropped (may be NULL).  Sorted by descending |rho|, then ascending |arg rho|.
 */
int poles_of_multipliers(const double complex *rho, int count, double tau, double floor,
                         double complex *lambda, int *dropped);
#endif
