/* torus_sheet.c - how a record is laid out, what reading it costs, and its arrays; tested by
 * tests/unit/modal/steady/test_torus_lines.c */
#include <math.h>
#include "modal/steady/torus_lines.h"

enum {
    OTHERS_MOST = 160,         /* |k_j| of one tone beside the leading one: slow envelopes of close
                                * tones have as many lines */
    OTHERS_OF_TWO_MOST = 12,   /* of two */
};
static const double WAVE = 1.2;           /* budget.h: of a sample and a row, two products of
                                           * matrices of two columns */
static const double READ = 3;             /* passes of a record that has not settled, most often */
static const double FACTOR = 0.4;         /* of a factor of them, times its rows' cube */

bool torus_sheet_lay(struct torus_sheet *a, int N, int turns, double wanted)
{
    const struct torus_tones *t = &a->s->tones;
    int r = 0, most = t->count > 2 ? OTHERS_OF_TWO_MOST : OTHERS_MOST, wide;

    a->N = N, a->turns = turns;
    a->wanted = wanted;
    a->apart = torus_sheet_apart(t, turns, a->settled);
    a->others[0] = a->others[1] = -1;
    for (int j = 0; j < t->count; j++)
        if (j != t->lead)
            a->others[r++] = j;
    a->highest = r == 0 ? 0 : turns / TORUS_TURNS_A_ROW < most ? turns / TORUS_TURNS_A_ROW : most;
    wide = 2 * a->highest + 1;
    a->rows = t->count > 2 ? (wide * wide + 1) / 2 : a->highest + 1;
    return (double)N * turns * a->outputs <= TORUS_SHEET_MOST;
}

double torus_sheet_work(const struct torus_sheet *a)
{
    return a->rows * (WAVE * (a->settled ? 1 : READ) * a->outputs * ((double)a->N * a->turns)
                      + FACTOR * (double)a->rows * a->rows);
}

enum modal_status torus_sheet_room(struct torus_sheet *a, struct modal_error *err)
{
    size_t samples = (size_t)a->N * (size_t)a->turns, wide = (size_t)(a->N * a->outputs);
    size_t rows = (size_t)a->rows;

    if (a->x == NULL)
        a->x = workspace_zeros(&a->space, samples * (size_t)a->outputs, sizeof *a->x);
    a->left = workspace_room(&a->space, samples * (size_t)a->outputs, sizeof *a->left);
    a->row = workspace_room(&a->space, rows, sizeof *a->row);
    a->wave = workspace_room(&a->space, 2 * rows * (size_t)a->turns, sizeof *a->wave);
    a->sum = workspace_room(&a->space, 2 * rows * wide, sizeof *a->sum);
    a->Y = workspace_room(&a->space, rows * wide, sizeof *a->Y);
    a->z = workspace_room(&a->space, (size_t)a->N, sizeof *a->z);
    a->mean = workspace_room(&a->space, 2 * rows, sizeof *a->mean);
    return workspace_check(&a->space, "torus: no memory for a record", err);
}
