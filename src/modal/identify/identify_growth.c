/*
 * identify_growth.c - a record that grows until its own rounding is larger than all else
 *
 * What grows by G over a record is rounded there to G DBL_EPSILON of what it began as, and noise,
 * or modes, of less are nothing in the later part: a fit to all rows weighs them alike, and takes
 * rounding, which is no white noise, for more modes, or sees no others.  The earlier part tells of
 * them, and of the growth no less but for its last digits.  So where a fit with a mode that grows
 * came down to rounding, e is what it leaves and f, (6) of refine.c, what rounding makes of the
 * signals y, the record is cut to its first R rows, the most of which
 *
 *     sum_{l<R} |e_l|^2  >=  ABOVE^2 f^2 sum_{l<R} |y_l|^2,                                    (1)
 *
 * and searched anew, which may show more of e to be modes: until that settles.
 */
#include "modal/identify/ask/diagnose.h"
#include "modal/identify/identify_state.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/svd.h"

static const double ABOVE = 10;     /* rounding is a hundredth of the variance, and less of errors
                                     * than anybody tells */

static bool grows(const struct refined *fit)
{
    for (int j = 0; j < fit->poles; j++)
        if (creal(fit->lambda[j]) > 0)
            return true;
    return false;
}

/* f^2 of the signals, in parts of their energy. Of what is no one set of modes in noise the values
 * of a pencil may have hidden some, each a hundredth of what is left. */
static double rounding_share(const struct work *w, const struct refined *fit)
{
    double norm = safe_matrix_norm(w->data.Y), sum = 0,
           pencil = w->choice.clean ? 0 : ABOVE * ABOVE * DBL_EPSILON
               * fmax(w->pencil.height, w->pencil.columns);

    for (int g = 0; g < fit->groups; g++)
        sum += fit->floor[g] * fit->floor[g];
    return norm > 0 ? fmax(sum * w->data.Y->m / (norm * norm), pencil * pencil) : 0;
}

/* R of (1), of Y and its FIT; 0: none. */
static int rows_above_rounding(const struct matrix *Y, const struct matrix *fit, double f2)
{
    double left = 0, all = 0;
    int rows = 0;

    for (int l = 0; l < Y->m; l++) {
        for (int c = 0; c < Y->n; c++) {
            double y = Y->x[l + (size_t)c * (size_t)Y->ld],
                   e = y - fit->x[l + (size_t)c * (size_t)fit->ld];
            left += e * e, all += y * y;
        }
        if (left >= ABOVE * ABOVE * f2 * all && all > 0)
            rows = l + 1;
    }
    return rows;
}

/* The record as it is, for work_put_growth_back(). */
static enum modal_status keep_whole(struct work *w, struct modal_error *err)
{
    const struct matrix *Y = &w->rec.Y;
    size_t bytes = sizeof *w->whole_scale * (size_t)w->rec.channels;

    w->whole = matrix_new(Y->m, Y->n);
    w->whole_scale = malloc(bytes);
    if (w->whole.x == NULL || w->whole_scale == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d samples", Y->m);
    matrix_copy(Y->m, Y->n, Y->x, Y->ld, w->whole.x, w->whole.ld);
    memcpy(w->whole_scale, w->rec.scale, bytes);
    return MODAL_OK;
}

enum modal_status work_cut_growth(struct work *w, bool *cut, struct modal_error *err)
{
    const struct refined *fit = w->choice.chosen >= 0
                              ? &w->choice.candidates[w->choice.chosen].fit : NULL;
    struct synthesis s = { 0 };
    struct matrix rebuilt = { 0 };
    double f2 = 0;
    int rows = 0, L = w->rec.Y.m;
    enum modal_status rc;

    *cut = false;
    if (!work_may_take_wild(w) || w->rec.period > 0 || fit == NULL || !grows(fit))
        return MODAL_OK;
    f2 = rounding_share(w, fit);
    if (!(fit->residual < ABOVE * sqrt(f2) * safe_matrix_norm(w->data.Y)))
        return MODAL_OK;
    rebuilt = matrix_new(L, w->rec.Y.n);
    if (rebuilt.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d samples", L);
    rc = synthesis_fit(fit->lambda, fit->poles, w->tau, &w->rec.Y, &rebuilt, &s, err);
    if (rc == MODAL_OK)
        rows = rows_above_rounding(&w->rec.Y, &rebuilt, f2);
    synthesis_done(&s), free(rebuilt.x);
    if (rc != MODAL_OK || rows < REFINE_ROWS_LEAST || rows == L)
        return rc;
    if (w->whole.x == NULL && (rc = keep_whole(w, err)) != MODAL_OK)
        return rc;
    *cut = true;
    w->grown = rows;
    return record_cut(&w->rec, rows, w->opt.scale, err);
}

void work_put_growth_back(struct work *w)
{
    free(w->rec.Y.x), free(w->rec.scale);
    w->rec.Y = w->whole, w->rec.scale = w->whole_scale;
    w->whole = (struct matrix) { 0 }, w->whole_scale = NULL;
    w->grown = 0;
}

void work_report_growth(const struct work *w, struct identify_result *out)
{
    if (w->grown > 0)
        identify_diagnose(out, "growth_hides", -1,
                          "after %.6g s the growth hides noise and whatever else there is below "
                          "the rounding errors of its samples: the rest of the record is not used",
                          w->rec.t0 + w->grown * w->rec.step);
}

