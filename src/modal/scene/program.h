/* program.h - a scene lowered to numbers: all that solvers and integrators read
 *
 * The motion of a program, x its n dofs, z its n_linear linear states, Omega = omega:
 *
 *     M(t) x'' + C(t) x' + K(t) x + sum_laws f(d, d', memory) = F z + p(t)                     (1)
 *     E z' = A z + Bx x + Bv x' + Ba x''                                                       (2)
 *     M(t) = M_0 + sum_k [ Mc_k cos(k Omega t) + Ms_k sin(k Omega t) ], C and K alike          (3)
 *
 * and its outputs y = Yx x + Yv x' + Ya x'' + Yz z.  Five kinds of things, and no effect's type
 * among them: what a scene does not list has left no trace here.
 */
#ifndef MODAL_PROGRAM_H
#define MODAL_PROGRAM_H
#include <stdbool.h>
#include <stdint.h>
#include "base/error.h"
#include "modal/linalg/sparse.h"
#include "modal/scene/law.h"

enum { PROGRAM_M, PROGRAM_C, PROGRAM_K };
enum { PROGRAM_TONES_MOST = 3 };      /* of several tones without a common period */

struct program_harmonic {             /* (3): one k >= 1; the n x n matrices may be empty (m = 0) */
    int k;
    struct sparse cosine[3], sine[3]; /* by PROGRAM_M, PROGRAM_C, PROGRAM_K */
};

struct program_load {                 /* p(t) on one dof */
    int dof;  /* on which p acts */
    enum program_load_type {
        LOAD_HARMONIC,
        LOAD_IMPULSE,
        LOAD_HALF_SINE,
        LOAD_ONE_MINUS_COSINE,
        LOAD_STEP,
        LOAD_TABLE
    } type;
    int k;                            /* HARMONIC: cosine cos(k Omega t) + sine sin(k Omega t) */
    /* numbers of k where the scene gave a list, 0 where it gave one number: then tone is k, 0, 0 */
    int tones, tone[PROGRAM_TONES_MOST];
    double cosine, sine;  /* N */
    double amplitude, duration, start;/* pulses; IMPULSE: amplitude in N s at t = start */
    int points;                       /* TABLE: linear between points, 0 outside */
    double *time, *force;  /* s from `start`, ascending; N */
    /* >= 0: on turning axes, a fixed-frame load p is p cos(frame_speed t) on dof and */
    int dof_sine;
    /* turn * p sin(frame_speed t) on dof_sine; -1: axes do not turn */
    double turn;
};

struct program_output {               /* one channel of `simulate` */
    char *name;  /* unique is not asked for */
    /* i: 0 x, 1 x', 2 x'', 3 z, j: which, value: coefficient; i + 4: the term times */
    struct triplet *terms;
    int count;                        /* cos(frame_speed t), i + 8: times sin(frame_speed t) */
};

struct program_effect {               /* one row of plan.effects, in the scene's order */
    char *type;
    int states;                       /* that it added */
    /* of an effect with laws: its own JSON, for the hash; else NULL */
    char *law_text;
    int64_t evaluations;              /* counted by whoever runs the program */
    double seconds;                   /* evaluations x calibrated unit cost */
    bool active;  /* it wrote an entry, or its law acted */
    /* 1 + the row whose law does this one's work, whose evaluations and activity are its own; 0:
     * none */
    int carrier;
};

struct program {
    int n;                            /* dofs */
    char **dofs;                      /* their names */
    int *by_name;                     /* dofs in the order of their names; NULL: not yet */
    struct sparse constant[3];        /* M_0, C_0, K_0 */
    int harmonics;  /* of (3) */
    struct program_harmonic *harmonic;/* ascending k */

    int n_linear;                     /* linear states z */
    struct sparse E, A, Bx, Bv, Ba;   /* (2) */
    struct sparse F;                  /* n x n_linear, (1) */

    int laws;  /* f of (1) */
    struct law *law;
    size_t lua_bytes;                 /* that all laws in Lua have now */
    int loads;  /* p of (1) */
    struct program_load *load;
    int outputs;  /* y */
    struct program_output *output;
    int effects;  /* rows of plan.effects */
    struct program_effect *effect;

    double *x0, *v0;                  /* initial state */
    double omega, period;             /* rad/s, s; 0: the scene gave none */
    double tones[PROGRAM_TONES_MOST]; /* rad/s, of loads whose k is a list; 0: there are none */
    double frame_speed;               /* of turning axes, for outputs in the fixed frame; 0: none */
    /* On fixed axes about a shaft turning at turn_speed: dof i's other transverse dof and J's sign
     * there, n each, or NULL. turning.h reads them; they say nothing that the matrices do not. */
    int *turn_partner;
    double *turn_sign, turn_speed;
    /* on turning axes, its outputs, loads and multipliers those of fixed ones */
    bool seen_fixed;
    char hash[65];                    /* SHA-256, hex, over all of the above but counters and
                                         lua_bytes: see program.c */
};

/* Of a harmonic load, rad/s: k omega, or k . tones. */
double program_load_frequency(const struct program *p, const struct program_load *load);

enum program_class { PROGRAM_LINEAR_CONSTANT, PROGRAM_LINEAR_PERIODIC, PROGRAM_NONLINEAR };
/* Nonlinear with any law, periodic with any harmonic. */
enum program_class program_class(const struct program *p);
/* The names are complete: program_dof finds them in log n from here on.  Fails with
 * MODAL_NO_MEMORY. */
enum modal_status program_order_names(struct program *p, struct modal_error *err);
int program_dof(const struct program *p, const char *name);   /* -1: no such dof */
/* "linear-constant", "linear-periodic", "nonlinear". */
const char *program_class_name(enum program_class class);
/* Whether all that moves are dofs on one set of axes, of a mass that stays the same. */
bool program_of_dofs(const struct program *p);
/* 2 x dofs + linear states + the laws' memory. */
int program_states(const struct program *p);
void program_hash(struct program *p);                          /* fill p->hash */
void program_free(struct program *p);

#endif
