/* ports.h - where a nonlinear program's forces act and look: channels of force, probes of motion
 *
 * A channel is one input of a law (force along its direction), or one row of the
 * pulsating stiffness and damping, which beside laws are forces like theirs.  A probe is what they
 * look at: a relative displacement and its rate. Laws are asked here and nowhere else, and counted.
 */
#ifndef MODAL_PORTS_H
#define MODAL_PORTS_H
#include <stdbool.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/statespace.h"

struct port_law {
    const struct law *law;
    int channel;                 /* its first; its probes have the same numbers */
    int memory;                  /* its first place in memories */
    int held;                    /* a set-valued law: 0 sticks, +1 and -1 slips that way */
    int64_t evaluations;  /* for plan.effects */
    bool acted;  /* slipped, touched, .. at the end of any step */
};

struct ports {
    const struct statespace *ss; /* borrowed */
    int laws;  /* in the program's order */
    struct port_law *law;
    int channels, probes;        /* of laws first, in their order */
    int memory;                  /* doubles, of all laws */
    /* N x channels: what a unit of each channel does to y' (minus its force) */
    double *U;
    double *R;                   /* 2 probes x N: displacements, then rates */
    /* of the pulsating part: channels and probes from `inputs` on, one per dof it touches */
    int rows;
    int inputs;                  /* of all laws */
    int *row_dof;                /* rows */
    /* rows x rows: C and K */
    struct port_harmonic { int k; double *cosine[2], *sine[2]; } *harmonic;
    struct workspace space;      /* of the arrays */
};

/* SS is borrowed.  Fails with MODAL_NO_MEMORY, or MODAL_TOO_LARGE where a law remembers too
 * much. */
enum modal_status ports_new(const struct statespace *ss, struct ports **out,
                            struct modal_error *err);
/* NULL is accepted. */
void ports_free(struct ports *p);

/*
 * Forces of all channels at time t: PROBE holds 2 x probes numbers, MEMORY what the laws remember
 * from the step's start.  FORCE gets channels numbers, SLOPE (channels x 2 probes by columns, or
 * NULL) their derivatives, AFTER (or NULL) the memory there.  A set-valued law gives held * limit.
 */
enum modal_status ports_force(struct ports *p, double t, const double *probe,
                              const double *memory, double *force, double *slope, double *after,
                              struct modal_error *err);

/* The same for one law alone; *regime is its smooth piece. */
enum modal_status ports_law(struct ports *p, int law, double t, const double *d, const double *v,
                            const double *memory, double *after, int *regime,
                            struct modal_error *err);

/* Adds what laws counted to the rows of their effects in PROGRAM. */
void ports_report(const struct ports *p, struct program *program);
#endif
