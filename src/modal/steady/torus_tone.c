/* torus_tone.c - a tone that the motion brings itself, moved from trial to trial; tested by
 * tests/unit/modal/steady/test_torus.c */
#include "modal/steady/torus_state.h"
#include <stdlib.h>
#include "modal/steady/torus_laws.h"

size_t torus_tone_place(const struct torus_solver *s)
{
    return (size_t)s->tone.lead * (size_t)s->count + (size_t)s->tone.at;
}

double complex torus_tone_take(const struct torus_solver *s, double complex *x)
{
    double complex *place, was;

    if (s->tone.index < 0)
        return 0;
    place = &x[torus_tone_place(s)];
    was = *place;
    *place = s->tone.held ? 0 : creal(was);
    return was - *place;
}

enum modal_status torus_tone_move(struct torus_solver *s, double omega, double gain,
                                  struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    torus_tones_move(&s->tones, s->tone.index, omega);
    s->tone.gain = gain;
    torus_laws_retune(s->laws, &s->tones);
    if (s->grid != NULL)
        torus_grid_retune(s->grid, &s->tones);
    for (int m = 0; rc == MODAL_OK && m < s->count; m++) {
        struct torus_linear l;

        if (s->index[m].k[s->tone.index] == 0)
            continue;
        rc = torus_linear_at(s, s->index[m], &l, err);
        if (rc == MODAL_OK) {
            torus_linear_done(&s->linear[m]);
            s->linear[m] = l;
        }
    }
    return rc;
}

void torus_tone_keep(struct torus_solver *s)
{
    if (s->tone.index < 0)
        return;
    s->tone.omega_kept = s->tones.omega[s->tone.index];
    s->tone.gain_kept = s->tone.gain;
}

enum modal_status torus_tone_told(struct torus_solver *s, bool *turned, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    *turned = false;
    for (int m = 0; rc == MODAL_OK && s->tone.index >= 0 && m < s->count; m++) {
        struct torus_linear l;
        bool flipped;
        struct torus_index k = torus_signed(&s->tones, s->index[m], &flipped);

        if (!flipped)
            continue;
        *turned = true;
        rc = torus_linear_at(s, k, &l, err);
        if (rc != MODAL_OK)
            break;
        torus_linear_done(&s->linear[m]);
        s->linear[m] = l;
        s->index[m] = k;
        for (size_t i = (size_t)m; i < (size_t)s->q * (size_t)s->count; i += (size_t)s->count) {
            s->X[i] = conj(s->X[i]);
            s->F[i] = conj(s->F[i]);
        }
    }
    return rc;
}
