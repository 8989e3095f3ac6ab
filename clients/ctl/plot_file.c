/* plot_file.c - see plot_file.h
 *
 * A channel's reconstruction is drawn from a free least-squares fit of the found exponents to it,
 * over at most 600 samples,
 *
 *     y(t) = sum_j e^{sigma_j t} (a_j cos w_j t + b_j sin w_j t),                               (1)
 *
 * solved by QR (LAPACK dgels) with its columns scaled: it shows whether these exponents can carry
 * the channel.
 */
#include "plot_file.h"
#include <errno.h>
#include <lapacke.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include "field.h"
#include "plot.h"
#include "whole_file.h"

enum { SHOWN_SAMPLES = 600 };    /* of a channel: more than a panel has pixels */
static const char suffix[] = ".svg";

/* (1) fitted to Y (COUNT samples, STEP seconds apart), whose fit replaces it; false: it cannot
 * be. */
static bool fit_channel(const cJSON *modes, double *y, int count, double step)
{
    int columns = 2 * cJSON_GetArraySize(modes), j = 0;
    double *a = calloc((size_t)count * (size_t)columns + 1, sizeof *a), *copy,
           *right = malloc((size_t)count * sizeof *right);
    const cJSON *mode;
    bool good = columns > 0 && columns <= count && a != NULL && right != NULL;

    cJSON_ArrayForEach(mode, modes) {
        const cJSON *exponent = field_get(mode, "resolved_exponent");
        double s = field_at(exponent, 0), w = field_at(exponent, 1),
               last = s > 0 ? (count - 1) * step : 0;
        /* each column's largest entry about 1 */
        for (int i = 0; good && i < count; i++) {
            double e = exp(s * (i * step - last));
            a[(size_t)j * (size_t)count + (size_t)i] = e * cos(w * i * step);
            a[(size_t)(j + 1) * (size_t)count + (size_t)i] = w != 0 ? e * sin(w * i * step)
                                                                    : e * (1e-12 * (i % 2));
        }
        j += 2;
    }
    copy = good ? malloc((size_t)count * (size_t)columns * sizeof *copy) : NULL;
    if (copy != NULL) {
        memcpy(copy, a, (size_t)count * (size_t)columns * sizeof *copy);
        memcpy(right, y, (size_t)count * sizeof *right);
        good = LAPACKE_dgels(LAPACK_COL_MAJOR, 'N', count, columns, 1, copy, count, right, count)
               == 0;
        for (int i = 0; good && i < count; i++) {
            y[i] = 0;
            for (int c = 0; c < columns; c++)
                y[i] += a[(size_t)c * (size_t)count + (size_t)i] * right[c];
        }
    }
    good = good && copy != NULL;
    free(a); free(copy); free(right);
    return good;
}

static void draw_history(struct svg *svg, const cJSON *result, const void *of)
{
    const struct input *input = of;
    const struct batch *b = &input->batch;
    int count = b->samples < SHOWN_SAMPLES ? (int)b->samples : SHOWN_SAMPLES;
    double t[SHOWN_SAMPLES], y[SHOWN_SAMPLES], fit[SHOWN_SAMPLES];
    struct svg_panel p = { { "time, s", 1, 0, false },
                           { b->names ? b->names[0] : "channel 0", 1, 0, false } };

    for (int i = 0; i < count; i++) {
        t[i] = i * b->dt;
        y[i] = fit[i] = b->signals[(size_t)i * b->channels];
        svg_hold(&p.x, t[i]);
        svg_hold(&p.y, y[i]);
    }
    svg_panel(svg, &p);
    svg_line(svg, &p, t, y, count, SVG_SOLID);
    if (field_get(input->options, "band") == NULL
        && fit_channel(field_get(result, "modes"), fit, count, b->dt))
        svg_line(svg, &p, t, fit, count, SVG_DASHED);
}

enum modal_status plot_path_check(const char *path, struct modal_error *err)
{
    size_t length = strlen(path), own = strlen(suffix);

    if (length > own && strcasecmp(path + length - own, suffix) == 0)
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, "plot", "%.300s: pictures are SVG; accepted: "
                            "FILE.svg, or - for stdout (not of what is watched)", path);
}

static enum modal_status draw(FILE *to, const char *kind, const cJSON *result,
                              const struct input *input, struct modal_error *err)
{
    bool signals = input != NULL && input->batch.samples > 0;
    struct plot_input in = { signals ? draw_history : NULL, input, input ? input->scene : NULL };

    return plot_draw(to, kind, result, &in, err);
}

enum modal_status plot_result(const char *path, const char *kind, const cJSON *result,
                              const struct input *input, struct modal_error *err)
{
    struct whole_file out;
    enum modal_status rc;

    if (strcmp(path, "-") == 0) {
        rc = draw(stdout, kind, result, input, err);
        return fflush(stdout) != 0 || ferror(stdout)
                   ? modal_fail(err, MODAL_IO, "stdout: %s", strerror(errno)) : rc;
    }
    rc = whole_file_begin(&out, path, "plot", err);
    if (rc == MODAL_OK && (rc = draw(out.file, kind, result, input, err)) != MODAL_OK)
        whole_file_drop(&out);
    return rc == MODAL_OK ? whole_file_end(&out, err) : rc;
}
