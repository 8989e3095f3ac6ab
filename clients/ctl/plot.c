/* plot.c - see plot.h */
#include "plot.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "field.h"

enum {
    ORBIT_POINTS = 400,          /* of a closed curve: chords of a pixel */
    TURNS_DRAWN = 8,             /* of one that never closes: more hide each other */
};
/* |X_k| below it is not drawn: rounding of a motion of order 1, and 16 decades on one axis. */
static const double SIZE_LEAST = 1e-16;
static const struct svg_axis empty = { "", 1, 0, false };

static struct svg_panel panel_of(const char *x, const char *y)
{
    struct svg_panel p = { empty, empty };

    p.x.label = x;
    p.y.label = y;
    return p;
}

/* ------------------------------------------------------------------ identify */

static void draw_modes(struct svg *svg, const cJSON *result)
{
    struct svg_panel p = panel_of("frequency, Hz", "damping ratio");
    const cJSON *mode;

    cJSON_ArrayForEach(mode, field_get(result, "modes")) {
        svg_hold(&p.x, field_real(mode, "frequency_hz"));
        svg_hold(&p.y, field_real(mode, "damping_ratio"));
    }
    svg_hold(&p.y, 0);
    svg_panel(svg, &p);
    svg_line(svg, &p, (double[]) { p.x.low, p.x.high }, (double[]) { 0, 0 }, 2, SVG_THIN);
    cJSON_ArrayForEach(mode, field_get(result, "modes")) {
        const cJSON *std = field_get(mode, "std");
        svg_bar(svg, &p, field_real(mode, "frequency_hz"), field_real(mode, "damping_ratio"),
                field_real(std, "frequency_hz"), field_real(std, "damping_ratio"));
        svg_dot(svg, &p, field_real(mode, "frequency_hz"), field_real(mode, "damping_ratio"), true);
    }
}

/* Frequencies by order, of every order that was tried: a mode is where they stay. */
static void draw_stabilisation(struct svg *svg, const cJSON *result)
{
    struct svg_panel p = panel_of("frequency, Hz", "order");
    const cJSON *mode, *pole, *poles = field_get(result, "stabilisation");

    svg_hold(&p.y, 0);
    cJSON_ArrayForEach(mode, field_get(result, "modes"))
        svg_hold(&p.x, field_real(mode, "frequency_hz"));
    cJSON_ArrayForEach(pole, poles) {
        svg_hold(&p.x, field_real(pole, "frequency_hz"));
        svg_hold(&p.y, field_real(pole, "order"));
    }
    svg_panel(svg, &p);
    cJSON_ArrayForEach(mode, field_get(result, "modes")) {
        double x = field_real(mode, "frequency_hz");
        svg_line(svg, &p, (double[]) { x, x }, (double[]) { p.y.low, p.y.high }, 2, SVG_THIN);
    }
    cJSON_ArrayForEach(pole, poles)
        svg_dot(svg, &p, field_real(pole, "frequency_hz"), field_real(pole, "order"),
                cJSON_IsNumber(field_get(pole, "mode")));
}

static bool plot_identify(struct svg *svg, FILE *file, const cJSON *result,
                          const struct plot_input *input)
{
    bool signals = input != NULL && input->history != NULL;
    bool orders = cJSON_GetArraySize(field_get(result, "stabilisation")) > 0;
    char title[160];

    snprintf(title, sizeof title, "modes%s%s", orders ? "; by order, filled what is a mode's" : "",
             signals ? "; a channel (solid) and its reconstruction (dashed)" : "");
    svg_begin(svg, file, 1 + orders + signals, title);
    draw_modes(svg, result);
    if (orders)
        draw_stabilisation(svg, result);
    if (signals)
        input->history(svg, result, input->of);
    return true;
}

/* ------------------------------------------------------------------ steady */

/* The harmonics of a dof: X_k = re + i im, COUNT of them, at k omega.  Of several tones k is their
 * frequency, rad/s, and omega 1. */
struct harmonics { int count; double *k, *re, *im, omega, span; bool tones; };

static void harmonics_done(struct harmonics *h)
{
    free(h->k);
    free(h->re);
    free(h->im);
}

/* The frequencies k . tones of DOF, and a span of the slowest tone's turns. */
static void of_tones(const cJSON *tones, const cJSON *dof, struct harmonics *h, size_t *count)
{
    const cJSON *k, *list = field_get(dof, "k");
    double slowest = HUGE_VAL;

    h->tones = true;
    h->omega = 1;
    h->k = calloc((size_t)cJSON_GetArraySize(list) + 1, sizeof *h->k);
    cJSON_ArrayForEach(k, list) {
        for (int j = 0; h->k != NULL && j < cJSON_GetArraySize(tones); j++)
            h->k[*count] += field_at(k, j) * field_at(tones, j);
        ++*count;
    }
    for (int j = 0; j < cJSON_GetArraySize(tones); j++)
        slowest = fmin(slowest, field_at(tones, j));
    h->span = TURNS_DRAWN * 2 * M_PI / slowest;
}

/* Read once: an entry of a list is found by walking to it.  Without memory there are none. */
static struct harmonics harmonics_of(const cJSON *result, const cJSON *dof)
{
    double omega = field_real(result, "omega");
    struct harmonics h = { .omega = omega, .span = 2 * M_PI / omega };
    size_t n[3] = { 0 };

    if (field_get(result, "tones") != NULL)
        of_tones(field_get(result, "tones"), dof, &h, &n[0]);
    else if (json_get_numbers(dof, "", "k", -HUGE_VAL, HUGE_VAL, &h.k, &n[0], NULL) != MODAL_OK)
        return h;
    if (h.k != NULL
        && json_get_numbers(dof, "", "re", -HUGE_VAL, HUGE_VAL, &h.re, &n[1], NULL) == MODAL_OK
        && json_get_numbers(dof, "", "im", -HUGE_VAL, HUGE_VAL, &h.im, &n[2], NULL) == MODAL_OK
        && n[0] == n[1] && n[1] == n[2])
        h.count = (int)n[0];
    return h;
}

/* |X_k| of the first dof, and its orbit x, x'. */
static void draw_spectrum(struct svg *svg, const struct harmonics *h)
{
    struct svg_panel p = panel_of(h->tones ? "frequency, rad/s" : "harmonic k", "|X_k|");

    p.y.logarithmic = true;
    for (int i = 0; i < h->count; i++) {
        double size = hypot(h->re[i], h->im[i]);
        svg_hold(&p.x, h->k[i]);
        svg_hold(&p.y, size > SIZE_LEAST ? size : NAN);
    }
    svg_panel(svg, &p);
    for (int i = 0; i < h->count; i++) {
        double k = h->k[i], size = hypot(h->re[i], h->im[i]);
        svg_line(svg, &p, (double[]) { k, k }, (double[]) { p.y.low, size }, 2, SVG_SOLID);
        svg_dot(svg, &p, k, size, true);
    }
}

static void draw_orbit(struct svg *svg, const struct harmonics *h, const char *name)
{
    struct svg_panel p = panel_of(name, "its velocity");
    double x[ORBIT_POINTS + 1], v[ORBIT_POINTS + 1];

    for (int j = 0; j <= ORBIT_POINTS; j++) {
        double t = h->span * j / ORBIT_POINTS;
        x[j] = v[j] = 0;
        for (int i = 0; i < h->count; i++) {
            double w = h->k[i] * h->omega, c = cos(w * t), s = sin(w * t);
            x[j] += h->re[i] * c - h->im[i] * s;
            v[j] -= w * (h->re[i] * s + h->im[i] * c);
        }
        svg_hold(&p.x, x[j]);
        svg_hold(&p.y, v[j]);
    }
    svg_panel(svg, &p);
    svg_line(svg, &p, x, v, ORBIT_POINTS + 1, SVG_SOLID);
}

/* The largest |X_k|, k >= 1, of the first dof reported. */
static double size_of(const cJSON *point)
{
    struct harmonics h = harmonics_of(point, cJSON_GetArrayItem(field_get(point, "harmonics"), 0));
    double most = NAN;

    for (int i = 0; i < h.count; i++)
        if (h.k[i] > 0)
            most = fmax(isnan(most) ? 0 : most, hypot(h.re[i], h.im[i]));
    harmonics_done(&h);
    return most;
}

static double value_of(const cJSON *point)
{
    return field_number(point, "value", field_real(point, "omega"));
}

static bool is_unstable(const cJSON *point)
{
    return cJSON_IsFalse(field_get(field_get(point, "stability"), "stable"));
}

/* A path in a scene, with the unit where the contract gives it one. */
static const char *axis_of(const char *path)
{
    return path != NULL && strcmp(path, "omega") == 0 ? "omega, rad/s" : path != NULL ? path : "";
}

/* Runs of points of one verdict as one line each; a run ends where the next begins. */
static void draw_runs(struct svg *svg, const struct svg_panel *p, const cJSON *points)
{
    int room = cJSON_GetArraySize(points), n = 0;
    double *x = malloc(((size_t)room + 1) * sizeof *x), *y = malloc(((size_t)room + 1) * sizeof *y);
    const cJSON *point, *before = NULL;

    for (point = points ? points->child : NULL; point != NULL && x != NULL && y != NULL;
         before = point, point = point->next) {
        if (before != NULL && is_unstable(point) != is_unstable(before)) {
            svg_line(svg, p, x, y, n, is_unstable(before) ? SVG_DASHED : SVG_SOLID);
            x[0] = value_of(before);
            y[0] = size_of(before);
            n = 1;
        }
        x[n] = value_of(point);
        y[n++] = size_of(point);
    }
    if (before != NULL && n > 0)
        svg_line(svg, p, x, y, n, is_unstable(before) ? SVG_DASHED : SVG_SOLID);
    free(x);
    free(y);
}

/* KEY of each point of a nonlinear mode over its amplitude. */
static void draw_backbone(struct svg *svg, const cJSON *result, const char *key, const char *label)
{
    struct svg_panel p = panel_of("amplitude", label);
    int room = cJSON_GetArraySize(field_get(result, "points")), n = 0;
    double *x = malloc(((size_t)room + 1) * sizeof *x), *y = malloc(((size_t)room + 1) * sizeof *y);
    const cJSON *point;

    cJSON_ArrayForEach(point, field_get(result, "points")) {
        if (x == NULL || y == NULL || !cJSON_IsTrue(field_get(point, "converged")))
            continue;
        svg_hold(&p.x, x[n] = field_real(point, "amplitude"));
        svg_hold(&p.y, y[n++] = field_real(point, key));
    }
    svg_panel(svg, &p);
    svg_line(svg, &p, x, y, n, SVG_SOLID);
    free(x);
    free(y);
}

static void draw_curve(struct svg *svg, const cJSON *result)
{
    const char *parameter = cJSON_GetStringValue(field_get(result, "parameter"));
    const cJSON *points = field_get(result, "points"), *first = cJSON_GetArrayItem(points, 0);
    const cJSON *point, *fold;
    const char *dof = field_word(cJSON_GetArrayItem(field_get(first, "harmonics"), 0), "dof",
                                 "the first dof");
    char label[96];
    snprintf(label, sizeof label, "largest |X_k| of %.60s", dof);
    struct svg_panel p = panel_of(axis_of(parameter), label);

    cJSON_ArrayForEach(point, field_get(result, "points")) {
        svg_hold(&p.x, value_of(point));
        svg_hold(&p.y, size_of(point));
    }
    svg_panel(svg, &p);
    draw_runs(svg, &p, field_get(result, "points"));
    cJSON_ArrayForEach(fold, field_get(result, "folds"))
        svg_line(svg, &p, (double[]){ field_real(fold, parameter), field_real(fold, parameter) },
                 (double[]){ p.y.low, p.y.high }, 2, SVG_THIN);
}

static bool plot_steady(struct svg *svg, FILE *file, const cJSON *result,
                        const struct plot_input *input)
{
    const cJSON *dof = cJSON_GetArrayItem(field_get(result, "harmonics"), 0);

    (void)input;
    if (field_get(result, "points") != NULL && field_get(result, "mode") != NULL) {
        svg_begin(svg, file, 2, "a nonlinear mode over its amplitude");
        draw_backbone(svg, result, "omega", "omega, rad/s");
        draw_backbone(svg, result, "damping_ratio", "damping ratio");
        return true;
    }
    if (field_get(result, "points") != NULL) {
        svg_begin(svg, file, 1, "response curve: stable solid, unstable dashed, folds thin");
        draw_curve(svg, result);
        return true;
    }
    if (dof == NULL)
        return false;
    svg_begin(svg, file, 2, "spectrum and orbit");
    struct harmonics h = harmonics_of(result, dof);
    draw_spectrum(svg, &h);
    draw_orbit(svg, &h, field_word(dof, "dof", "-"));
    harmonics_done(&h);
    return true;
}

/* ------------------------------------------------------------------ floquet, tradeoff, sweep */

/* A list of [re, im], with the unit circle where CIRCLE. */
static void draw_plane(struct svg *svg, const cJSON *list, const char *x, const char *y,
                       bool circle)
{
    struct svg_panel p = panel_of(x, y);
    double c[101], s[101];
    const cJSON *pair;

    for (int i = 0; i <= 100; i++) {
        c[i] = cos(2 * M_PI * i / 100);
        s[i] = sin(2 * M_PI * i / 100);
        svg_hold(&p.x, circle ? c[i] : 0);
        svg_hold(&p.y, circle ? s[i] : 0);
    }
    cJSON_ArrayForEach(pair, list) {
        svg_hold(&p.x, field_at(pair, 0));
        svg_hold(&p.y, field_at(pair, 1));
    }
    svg_panel(svg, &p);
    if (circle)
        svg_line(svg, &p, c, s, 101, SVG_THIN);
    else
        svg_line(svg, &p, (double[]) { 0, 0 }, (double[]) { p.y.low, p.y.high }, 2, SVG_THIN);
    cJSON_ArrayForEach(pair, list)
        svg_dot(svg, &p, field_at(pair, 0), field_at(pair, 1), true);
}

static bool plot_floquet(struct svg *svg, FILE *file, const cJSON *result,
                         const struct plot_input *input)
{
    const cJSON *multipliers = field_get(result, "multipliers"),
                *exponents = field_get(result, "exponents");

    (void)input;
    if (multipliers == NULL && exponents == NULL)
        return false;
    svg_begin(svg, file, (multipliers != NULL) + (exponents != NULL),
              "stable left of the line, within the circle");
    if (exponents != NULL)
        draw_plane(svg, exponents, "Re exponent, 1/s", "Im, rad/s", false);
    if (multipliers != NULL)
        draw_plane(svg, multipliers, "Re multiplier", "Im", true);
    return true;
}

static bool plot_tradeoff(struct svg *svg, FILE *file, const cJSON *result,
                          const struct plot_input *input)
{
    struct svg_panel p = panel_of("CPU seconds", "relative error");
    const cJSON *rung, *best = cJSON_GetArrayItem(field_get(result, "rungs"),
                                                  field_index(result, "recommended"));
    double bound = field_real(result, "bound");

    (void)input;
    p.x.logarithmic = p.y.logarithmic = true;
    cJSON_ArrayForEach(rung, field_get(result, "rungs")) {
        svg_hold(&p.x, field_real(rung, "seconds"));
        svg_hold(&p.y, field_real(rung, "error"));
    }
    svg_hold(&p.y, bound);
    svg_begin(svg, file, 1, "accuracy against time: filled, none is both faster and better");
    svg_panel(svg, &p);
    if (bound > 0) {
        svg_line(svg, &p, (double[]){ p.x.low, p.x.high }, (double[]){ bound, bound }, 2,
                 SVG_DASHED);
        svg_text(svg, &p, p.x.high, bound, SVG_BELOW_BEFORE, "Cramer-Rao bound of the data");
    }
    cJSON_ArrayForEach(rung, field_get(result, "rungs"))
        svg_dot(svg, &p, field_real(rung, "seconds"), field_real(rung, "error"),
                cJSON_IsTrue(field_get(rung, "pareto")));
    if (best != NULL)
        svg_text(svg, &p, field_real(best, "seconds"), field_real(best, "error"), SVG_ABOVE_AFTER,
                 "recommended");
    return true;
}

/* Value I of axis AXIS of a sweep's grid. */
static double grid_value(const cJSON *grid, int axis, int i)
{
    return field_at(field_get(cJSON_GetArrayItem(grid, axis), "values"), i);
}

static const char *grid_path(const cJSON *grid, int axis)
{
    const char *path = cJSON_GetStringValue(field_get(cJSON_GetArrayItem(grid, axis), "path"));

    return axis_of(path);
}

static int index_of(const cJSON *point, int axis)
{
    return field_index_at(field_get(point, "index"), axis);
}

/* What tells how stable a point is: its largest multiplier, or e^-margin. */
static double level(const cJSON *point)
{
    const cJSON *s = field_get(point, "stability");
    double m = field_real(s, "max_multiplier");

    return isfinite(m) ? m : exp(-field_real(s, "margin"));
}

static void draw_levels(struct svg *svg, const cJSON *result, const cJSON *grid)
{
    struct svg_panel p = panel_of(grid_path(grid, 0), "largest multiplier");
    const cJSON *point;

    cJSON_ArrayForEach(point, field_get(result, "points")) {
        svg_hold(&p.x, grid_value(grid, 0, index_of(point, 0)));
        svg_hold(&p.y, level(point));
    }
    svg_hold(&p.y, 1);
    svg_panel(svg, &p);
    svg_line(svg, &p, (double[]) { p.x.low, p.x.high }, (double[]) { 1, 1 }, 2, SVG_THIN);
    cJSON_ArrayForEach(point, field_get(result, "points"))
        svg_dot(svg, &p, grid_value(grid, 0, index_of(point, 0)), level(point),
                !cJSON_IsFalse(field_get(field_get(point, "stability"), "stable")));
}

/* Half a cell towards the neighbour D of value I. */
static double edge(const cJSON *grid, int axis, int i, int d)
{
    int n = cJSON_GetArraySize(field_get(cJSON_GetArrayItem(grid, axis), "values"));
    int other = i + d >= 0 && i + d < n ? i + d : i - d >= 0 && i - d < n ? i - d : i;
    double half = fabs(grid_value(grid, axis, other) - grid_value(grid, axis, i)) / 2;

    return grid_value(grid, axis, i) + d * half;
}

static void draw_map(struct svg *svg, const cJSON *result, const cJSON *grid)
{
    struct svg_panel p = panel_of(grid_path(grid, 0), grid_path(grid, 1));
    const cJSON *point;

    cJSON_ArrayForEach(point, field_get(result, "points")) {
        svg_hold(&p.x, grid_value(grid, 0, index_of(point, 0)));
        svg_hold(&p.y, grid_value(grid, 1, index_of(point, 1)));
    }
    svg_panel(svg, &p);
    cJSON_ArrayForEach(point, field_get(result, "points")) {
        const cJSON *stable = field_get(field_get(point, "stability"), "stable");
        int i = index_of(point, 0), j = index_of(point, 1);
        svg_shade(svg, &p, edge(grid, 0, i, -1), edge(grid, 1, j, -1), edge(grid, 0, i, 1),
                  edge(grid, 1, j, 1),
                  cJSON_IsTrue(stable)    ? "#d5e8d4"
                  : cJSON_IsFalse(stable) ? "#d98880"
                                          : "#e0e0e0");
    }
}

/* Where each point has exponents: their path as the first value runs. */
static void draw_roots(struct svg *svg, const cJSON *result)
{
    struct svg_panel p = panel_of("Re exponent, 1/s", "Im, rad/s");
    const cJSON *point, *pair;

    svg_hold(&p.x, 0);
    cJSON_ArrayForEach(point, field_get(result, "points"))
        cJSON_ArrayForEach(pair, field_get(point, "exponents")) {
            svg_hold(&p.x, field_at(pair, 0));
            svg_hold(&p.y, field_at(pair, 1));
        }
    svg_panel(svg, &p);
    svg_shade(svg, &p, 0, p.y.low, p.x.high, p.y.high, "#f5d5d0");
    cJSON_ArrayForEach(point, field_get(result, "points"))
        cJSON_ArrayForEach(pair, field_get(point, "exponents"))
            svg_dot(svg, &p, field_at(pair, 0), field_at(pair, 1), field_at(pair, 0) < 0);
}

static bool plot_sweep(struct svg *svg, FILE *file, const cJSON *result,
                       const struct plot_input *input)
{
    const cJSON *grid = field_get(result, "grid") ? field_get(result, "grid")
                        : input             ? field_get(input->scene, "grid")
                                            : NULL;
    bool roots = field_get(cJSON_GetArrayItem(field_get(result, "points"), 0), "exponents") != NULL;

    if (cJSON_GetArraySize(grid) < 1 || cJSON_GetArraySize(grid) > 2)
        return false;
    svg_begin(svg, file, 1 + roots, "stable green or filled, unstable red or open");
    if (cJSON_GetArraySize(grid) == 1)
        draw_levels(svg, result, grid);
    else
        draw_map(svg, result, grid);
    if (roots)
        draw_roots(svg, result);
    return true;
}

/* ------------------------------------------------------------------ the table */

static const struct {
    const char *kind;
    bool (*plot)(struct svg *, FILE *, const cJSON *, const struct plot_input *);
} plots[] = {
    { "identify", plot_identify }, { "steady", plot_steady }, { "curve", plot_steady },
    { "backbone", plot_steady }, { "floquet", plot_floquet },
    { "tradeoff", plot_tradeoff }, { "sweep", plot_sweep },
};

bool plot_is_of(const char *kind)
{
    for (size_t i = 0; i < sizeof plots / sizeof plots[0]; i++)
        if (strcmp(plots[i].kind, kind) == 0)
            return true;
    return false;
}

enum modal_status plot_draw(FILE *file, const char *kind, const cJSON *result,
                            const struct plot_input *input, struct modal_error *err)
{
    struct svg svg;
    bool drawn = false;

    for (size_t i = 0; i < sizeof plots / sizeof plots[0]; i++)
        if (strcmp(plots[i].kind, kind) == 0)
            drawn = plots[i].plot(&svg, file, result, input);
    if (!drawn)
        return modal_fail_field(err, MODAL_BAD_INPUT, "plot", "a result of %s has no picture",
                                kind);
    svg_end(&svg);
    return MODAL_OK;
}
