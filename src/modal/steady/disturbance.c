/*
 * disturbance.c - see disturbance.h
 *
 * Laws with pieces are linear between their events, which the motion's harmonics have to place: the
 * motion is carried on to more of them.  Other laws have their own derivative at the motion.
 */
#include "modal/steady/disturbance.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"
#include "modal/scene/orbit.h"
#include "modal/scene/pieces.h"
#include "modal/scene/program.h"
#include "modal/steady/condense.h"
#include "modal/steady/estimate.h"
#include "modal/steady/point.h"

static const double TWO_PI = 6.283185307179586477;   /* a period of theta */
enum {
    EXTENDED = 2048,         /* harmonics at most that a motion with events is carried on to, */
    EXTEND = 16,             /* as many times the point's: H^-3 is then 4096 times smaller */
    SAMPLES_LEAST = 64,      /* where the motion has few harmonics: its laws have more */
};

void disturbance_done(struct disturbance *u)
{
    for (int i = 0; u->in != NULL && i < u->p->laws * LAW_INPUTS_MOST; i++)
        orbit_done(&u->in[i]);
    for (int i = 0; u->pieces != NULL && i < u->p->laws; i++)
        pieces_done(&u->pieces[i]);
    workspace_free(&u->space);
}

double disturbance_wrap(double theta) { return theta - TWO_PI * floor(theta / TWO_PI); }

/* Where each law's sliders have their c in the state. */
static void count_sliders(struct disturbance *u)
{
    u->sliders = 0;
    for (int l = 0; l < u->p->laws; l++) {
        u->first_slider[l] = u->sliders;
        u->sliders += u->p->law[l].kind->pieces != NULL ? u->p->law[l].memory : 0;
    }
}

/* Motions of each law's inputs, at full resolution, and its pieces. */
static enum modal_status law_motions(struct disturbance *u, struct modal_error *err)
{
    int H = u->H, K = H + 1, N = SAMPLES_LEAST;
    const int *place = condense_place(u->point->c);
    struct orbit_grid *g = NULL;
    enum modal_status rc;

    while (N < 4 * H + 2)                               /* turns between four samples a harmonic */
        N *= 2;
    N = N < u->point->N ? u->point->N : N;             /* no fewer than the laws were solved with */
    rc = orbit_grid_to_time(N, &g, err);
    for (int l = 0; rc == MODAL_OK && l < u->p->laws; l++) {
        const struct law *law = &u->p->law[l];
        const struct orbit *input[LAW_PIECE_INPUTS] = { &u->in[l * LAW_INPUTS_MOST],
                                                       &u->in[l * LAW_INPUTS_MOST + 1] };

        for (int j = 0; rc == MODAL_OK && j < law->kind->inputs; j++) {
            struct orbit *o = &u->in[l * LAW_INPUTS_MOST + j];

            rc = orbit_init(o, H, N, err);
            for (int k = 0; rc == MODAL_OK && k < K; k++)
                for (int e = law->start[j]; e < law->start[j + 1]; e++)
                    o->D[k] += law->end[e].weight * u->X[place[law->end[e].dof] * K + k];
            if (rc == MODAL_OK)
                orbit_sample(o, g, u->point->omega);    /* turns are sought between samples */
            if (rc == MODAL_OK && law->kind->pieces != NULL)
                rc = orbit_find_turns(o, err);
        }
        u->exact[l] = law->kind->pieces != NULL;
        if (rc == MODAL_OK && u->exact[l])
            rc = law->kind->pieces(law, input, &u->pieces[l], err);
        u->varies |= !u->exact[l];                      /* its slope follows the motion */
        if (law->kind->restart != NULL && law->kind->remembers(law))
            u->reason = "a user's law remembers; its disturbances are not followed";
    }
    orbit_grid_free(g);
    return rc;
}

/* Events move the multipliers by the motion's error there, H^-3: laws with events get the motion
 * carried on to EXTENDED. */
static enum modal_status choose_motion(struct disturbance *u, struct modal_error *err)
{
    const struct steady_point *point = u->point;
    bool events = false, done = false;
    double left;                                        /* as near as the point itself, or nearer */
    int H2 = EXTEND * point->H > EXTENDED ? EXTENDED : EXTEND * point->H;
    enum modal_status rc = MODAL_OK;

    for (int l = 0; l < u->p->laws; l++)
        /* A law that never acts has no events to be off. */
        events |= u->p->law[l].kind->pieces != NULL && point->acts[l];
    u->H = events && H2 > point->H ? H2 : point->H;
    u->X = workspace_zeros(&u->space, (size_t)point->q * ((size_t)u->H + 1), sizeof *u->X);
    if (u->X == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "stability: no memory");
    if (u->H > point->H)
        rc = steady_extend(u->s, point, u->H, u->X, &left, &done, err);
    if (!done) {                                        /* no extension: the point's own motion */
        u->H = point->H;
        memcpy(u->X, point->X, (size_t)point->q * ((size_t)point->H + 1) * sizeof *u->X);
    }
    return rc == MODAL_OVERFLOW ? MODAL_OK : rc;
}

/* The instants, in order, between which every piece is whole: 0, their ends, and 2 pi past the
 * last. */
static enum modal_status find_cuts(struct disturbance *u, struct modal_error *err)
{
    int most = 2;

    for (int l = 0; l < u->p->laws; l++)
        most += 2 * u->pieces[l].count;
    u->cut = workspace_zeros(&u->space, (size_t)most, sizeof *u->cut);
    if (u->cut == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "stability: no memory for %d cuts", most);
    u->cut[u->cuts++] = 0;
    for (int l = 0; l < u->p->laws; l++)
        for (int i = 0; i < u->pieces[l].count; i++) {
            const struct law_piece *piece = &u->pieces[l].piece[i];

            u->cut[u->cuts++] = disturbance_wrap(piece->from);
            u->cut[u->cuts++] = disturbance_wrap(piece->to);
            u->varies |= piece->cross != 0;             /* its slopes follow the motion */
            if (piece->jump != 0)
                u->reason = "a motion that rigid friction makes jump is not linearised here";
        }
    /* cuts of no length are passed over */
    numbers_sort(u->cut, (size_t)u->cuts);
    u->cut[u->cuts] = TWO_PI;                           /* the end of the last */
    return MODAL_OK;
}

bool disturbance_covers(const struct law_piece *piece, double theta)
{
    return theta >= piece->from
               ? disturbance_wrap(theta - piece->from) < piece->to - piece->from
                     && theta < piece->to
               : disturbance_wrap(theta + TWO_PI - piece->from) < piece->to - piece->from;
}

/* Whether law L's slopes at THETA depend on where the motion is then: of pieces, those alone that
 * multiply displacement and rate. */
static bool needs_motion(const struct disturbance *u, int l, double theta)
{
    bool needs = !u->exact[l];

    for (int i = 0; !needs && i < u->pieces[l].count; i++)
        needs = u->pieces[l].piece[i].cross != 0
                && disturbance_covers(&u->pieces[l].piece[i], theta);
    return needs;
}

enum modal_status disturbance_slopes(const struct disturbance *u, int l, double theta,
                                     double gd[][LAW_INPUTS_MOST],
                                     double gv[][LAW_INPUTS_MOST], double *held,
                                     struct modal_error *err)
{
    const struct law *law = &u->p->law[l];
    const struct orbit *o = &u->in[l * LAW_INPUTS_MOST];
    double omega = u->point->omega, at[3], d[LAW_INPUTS_MOST], v[LAW_INPUTS_MOST],
           memory[1] = { 0 };
    struct law_point point = { .t = theta / omega, .d = d, .v = v, .memory_before = memory };
    struct law_force f = { .memory = memory };
    enum modal_status rc;

    memset(gd, 0, LAW_INPUTS_MOST * sizeof *gd);
    memset(gv, 0, LAW_INPUTS_MOST * sizeof *gv);
    for (int i = 0; i < law->memory && u->exact[l]; i++)
        held[i] = 0;
    for (int j = 0; needs_motion(u, l, theta) && j < law->kind->inputs; j++) {
        orbit_at(&o[j], theta, at);
        d[j] = at[0];
        v[j] = omega * at[1];
    }
    for (int i = 0; u->exact[l] && i < u->pieces[l].count; i++) {
        const struct law_piece *piece = &u->pieces[l].piece[i];

        if (!disturbance_covers(piece, theta))
            continue;
        for (int j = 0; j < law->kind->inputs; j++)
            gd[piece->output][j] += piece->gain[j];
        gv[piece->output][0] += piece->damp;
        if (piece->cross != 0) {
            gd[piece->output][0] += piece->cross * v[0];  /* of cross d v, by d */
            gv[piece->output][0] += piece->cross * d[0];  /* and by v */
        }
        if (piece->holds && piece->slider >= 0)
            /* c is kept over this gain: in the unit of y */
            held[piece->slider] = piece->gain[law->kind->inputs - 1];
    }
    if (u->exact[l])
        return MODAL_OK;
    /* A sampled law: its own derivative at the motion. */
    rc = law->kind->force(law, &point, &f, err);
    for (int i = 0; rc == MODAL_OK && i < law->kind->inputs; i++)
        for (int j = 0; j < law->kind->inputs; j++) {
            gd[i][j] = f.fd[i][j];
            gv[i][j] = f.fv[i][j];
        }
    return rc;
}

enum modal_status disturbance_begin(struct disturbance *u, struct modal_error *err)
{
    size_t laws = (size_t)u->p->laws;

    u->n = u->p->n;
    u->nz = u->p->n_linear;
    u->varies = u->p->harmonics > 0;
    u->first_slider = workspace_zeros(&u->space, laws, sizeof *u->first_slider);
    u->in = workspace_zeros(&u->space, laws * LAW_INPUTS_MOST, sizeof *u->in);
    u->pieces = workspace_zeros(&u->space, laws, sizeof *u->pieces);
    u->exact = workspace_zeros(&u->space, laws, sizeof *u->exact);
    if (u->space.failed)
        return modal_fail(err, MODAL_NO_MEMORY, "stability: no memory for %d dofs", u->n);
    count_sliders(u);
    return MODAL_OK;
}

enum modal_status disturbance_follow(struct disturbance *u, struct modal_error *err)
{
    enum modal_status rc = choose_motion(u, err);

    if (rc == MODAL_OK && u->reason == NULL)
        rc = law_motions(u, err);
    return rc == MODAL_OK && u->reason == NULL ? find_cuts(u, err) : rc;
}
