/* period_map.h - what free disturbances of a large sparse periodic system become over one period
 *
 *     M x'' + C(t) x' + K(t) x + sum_e b_e g_e(t) u_e = 0                                       (1)
 *
 * u_e is seen through a channel's ends as a displacement, a rate or a held number c, constant but
 * where it is set anew from displacements; b_e are the ends that it pushes.  The functions g are
 * smooth between cuts.  No matrix of states by states is made: a vector is carried over the period,
 * and the work of that is linear in the entries.
 */
#ifndef MODAL_PERIOD_MAP_H
#define MODAL_PERIOD_MAP_H
#include <stdbool.h>
#include "base/error.h"

struct law_end;
struct period_map;
struct program;

struct period_channel {
    const struct law_end *in, *out;      /* u_e; b_e.  dof n + i of `in`: the held number i */
    int ins, outs;
    bool rate;                   /* u_e is of x' */
    int function;                /* g_e */
};

/* At a cut c[held] becomes what the COUNT ends see of x, 0 where there is none. */
struct period_reset { int cut, held, count; const struct law_end *end; };

/* What (1) has beyond the program's own matrices. */
struct period_parts {
    int functions, channels, held, cuts, resets;
    struct period_channel *channel;
    double *cut;                 /* s, ascending in [0, period); from 0 on */
    struct period_reset *reset;  /* ascending by cut */
    double fastest;              /* rad/s by which functions and what they multiply move */
    /* Coefficients of g(t + s h) = sum_m out_m s^m, 0 <= s <= 1, between cuts; how many: at least
     * one, at most MOST, for which there is room.  The rest is rounding. */
    int (*taylor)(void *context, int function, double t, double h, int most, double *out);
    double step_work;            /* operations (budget.h) that all functions' coefficients over a
                                  * step take, shared among the vectors to be carried */
    void *context;
};

/* Is P, its laws left out, such a system?  Not with linear states, turning axes nor a mass that
 * pulsates. */
bool period_map_serves(const struct program *p);

/*
 * Of P, its laws and loads left out, and PARTS (NULL: none) over PERIOD in s.  The program and the
 * ends are borrowed, the rest is copied or asked at once.  Fails with MODAL_NO_MEMORY,
 * MODAL_BAD_INPUT (M is singular), MODAL_TOO_LARGE where the functions' coefficients leave
 * PERIOD_MAP_DOUBLES, or carrying a vector with its share of them takes more than MOST operations,
 * as the fastest motion asks for so many steps, which is known before any is made; or as
 * period_map_carry.
 */
enum modal_status period_map_new(const struct program *p, const struct period_parts *parts,
                                 double period, double most, struct period_map **out,
                                 struct modal_error *err);
/* NULL is accepted. */
void period_map_free(struct period_map *m);
/* Of the state (x, x', c): 2 n + held numbers, in the roots of energies. */
int period_map_states(const struct period_map *m);
/* Steps of a period. */
int period_map_steps(const struct period_map *m);
/* Speeds over displacements of the complex state Y, each dof by its mass: rad/s; 0 of no motion. */
double period_map_frequency(const struct period_map *m, const double _Complex *y);
/* Operations (budget.h) that carrying a vector takes, nearly. */
double period_map_work(const struct period_map *m);
/* The state Y after a period from X; they may be one.  Fails with MODAL_OVERFLOW where it leaves
 * the range of doubles, MODAL_NO_CONVERGENCE where a step's series does not end. */
enum modal_status period_map_carry(struct period_map *m, const double *x, double *y,
                                   struct modal_error *err);

enum { PERIOD_MAP_DOUBLES = 30000000 };  /* 240 MB: a quarter of what a worker may have */
#endif
