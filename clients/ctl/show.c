/* show.c - see show.h */
#include "show.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "field.h"
#include "sweep_point.h"

enum { HARMONICS_SHOWN = 12 };       /* of a dof: a screen of two dofs */

static const char *text(const cJSON *object, const char *key)
{
    return field_word(object, key, "-");
}

static void cell(int width, const char *format, double value)
{
    char s[48];

    if (isfinite(value))
        snprintf(s, sizeof s, format, value);
    else
        snprintf(s, sizeof s, "-");
    printf(" %*s", width, s);
}

static const char *verdict(const cJSON *stability)
{
    const cJSON *stable = field_get(stability, "stable");

    return cJSON_IsTrue(stable)    ? "stable"
           : cJSON_IsFalse(stable) ? "unstable"
           : stability             ? "undecided"
                                   : "-";
}

/* The mode that the verdict rests on, where it is another than the one that the margin is of. */
static void show_decides(const cJSON *stability, const cJSON *modes)
{
    int decides = field_index(stability, "decides");
    const cJSON *mode = cJSON_GetArrayItem(modes, decides);
    double re = field_at(field_get(mode, "exponent"), 0);
    double std = field_at(field_get(field_get(mode, "std"), "exponent"), 0);

    if (!isfinite(re) || -re == field_real(stability, "margin"))
        return;
    printf("; mode %d decides, Re %.4g 1/s", decides, re);
    if (isfinite(std))
        printf(" +- %.2g", std);
}

static void show_stability(const cJSON *stability, const cJSON *modes)
{
    if (!cJSON_HasObjectItem(stability, "margin")
        && !isfinite(field_real(stability, "max_multiplier")))
        return;                                         /* not looked at */
    printf("%s", verdict(stability));
    if (isfinite(field_real(stability, "margin")))
        printf(", margin %.4g 1/s", field_real(stability, "margin"));
    if (isfinite(field_real(stability, "margin_std")))
        printf(" +- %.2g", field_real(stability, "margin_std"));
    if (isfinite(field_real(stability, "max_multiplier")))
        printf(", largest multiplier %.8g", field_real(stability, "max_multiplier"));
    show_decides(stability, modes);
    putchar('\n');
}

/* The same about one channel after another is one line. */
static bool same_of_another_channel(const cJSON *d, const cJSON *next)
{
    return next != NULL && cJSON_HasObjectItem(d, "channel") && cJSON_HasObjectItem(next, "channel")
           && strcmp(text(d, "code"), text(next, "code")) == 0;
}

static void show_diagnostics(const cJSON *result)
{
    const cJSON *d = field_get(result, "diagnostics");

    for (d = d ? d->child : NULL; d != NULL; d = d->next) {
        int more = 0;
        printf("note %s: %s", text(d, "code"), text(d, "message"));
        for (; same_of_another_channel(d, d->next); d = d->next)
            more++;
        if (more > 0)
            printf(" (so %d more channel%s)", more, more > 1 ? "s" : "");
        putchar('\n');
    }
}

static void show_cost(const cJSON *result)
{
    const cJSON *cost = field_get(result, "cost"), *stage;

    if (cost == NULL)
        return;
    printf("cost: %.3g s, %.3g s CPU", field_real(cost, "wall_s"), field_real(cost, "cpu_s"));
    if (isfinite(field_real(cost, "peak_bytes")))
        printf(", %.3g MB", field_real(cost, "peak_bytes") / 1e6);
    cJSON_ArrayForEach(stage, field_get(cost, "stages"))
        printf("; %s %.2g s", stage->string, stage->valuedouble);
    putchar('\n');
}

static void show_plan(const cJSON *result)
{
    const cJSON *plan = field_get(result, "plan"), *effect;

    if (plan == NULL)
        return;
    printf("plan: %s, %g states, %s\n", text(plan, "class"), field_real(plan, "states"),
           text(plan, "integrator"));
    cJSON_ArrayForEach(effect, field_get(plan, "effects"))
        printf("  %-22s %4g states  %8.0f evaluations  %9.2e s  %s\n", text(effect, "type"),
               field_real(effect, "states"), field_real(effect, "evaluations"),
               field_real(effect, "seconds"),
               cJSON_IsTrue(field_get(effect, "active")) ? "active" : "at rest");
}

static void show_mode(int i, const cJSON *mode)
{
    const cJSON *std = field_get(mode, "std");

    printf("%3d", i);
    cell(14, "%.8g", field_real(mode, "frequency_hz"));
    cell(9, "%.1e", field_real(std, "frequency_hz"));
    cell(14, "%.7g", field_real(mode, "damping_ratio"));
    cell(9, "%.1e", field_real(std, "damping_ratio"));
    cell(13, "%.6g", field_at(field_get(mode, "exponent"), 0));
    cell(13, "%.8g", field_at(field_get(mode, "exponent"), 1));
    cell(10, "%.3g", field_real(mode, "amplitude"));
    cell(9, "%.1e", field_real(mode, "residual"));
    cell(4, "%g", field_real(mode, "resolved_k"));
    putchar('\n');
}

/* Where they were asked for: channel by channel, what 1 is the largest of. */
static void show_shapes(const cJSON *result)
{
    const cJSON *mode, *signals = field_get(field_get(result, "reconstruction"), "signals");
    int i = 0;

    cJSON_ArrayForEach(mode, field_get(result, "modes")) {
        const cJSON *shape = field_get(mode, "shape"), *one;
        int c = 0;
        if (shape != NULL)
            printf("shape %d, mpc %.4g: magnitude, phase in degrees\n", i, field_real(mode, "mpc"));
        cJSON_ArrayForEach(one, shape) {
            printf("  %-20s", text(cJSON_GetArrayItem(signals, c++), "name"));
            cell(10, "%.4g", hypot(field_at(one, 0), field_at(one, 1)));
            cell(9, "%.1f", atan2(field_at(one, 1), field_at(one, 0)) * 180 / M_PI);
            putchar('\n');
        }
        i++;
    }
}

static void show_identify(const cJSON *result)
{
    const cJSON *mode, *signal, *rebuilt = field_get(result, "reconstruction"),
                *rank = field_get(result, "rank");
    int i = 0;

    printf("%3s %14s %9s %14s %9s %13s %13s %10s %9s %4s\n", "", "frequency Hz", "+-",
           "damping ratio", "+-", "Re 1/s", "Im rad/s", "amplitude", "residual", "k");
    cJSON_ArrayForEach(mode, field_get(result, "modes"))
        show_mode(i++, mode);
    show_shapes(result);
    show_stability(field_get(result, "stability"), field_get(result, "modes"));
    printf("reconstruction: relative error");
    cell(0, "%.3g", field_real(rebuilt, "relative_error"));
    putchar('\n');
    cJSON_ArrayForEach(signal, field_get(rebuilt, "signals")) {
        printf("  %-20s rms error", text(signal, "name"));
        cell(10, "%.3g", field_real(signal, "rms_error"));
        printf("  relative");
        cell(10, "%.3g", field_real(signal, "relative_error"));
        putchar('\n');
    }
    printf("rank: %g proper orthogonal, %g Hankel (%s)\n", field_real(rank, "pod"),
           field_real(rank, "hankel"), text(rank, "rule"));
}

/* "3", or "(1,-2)" of several tones, into ROOM bytes of OUT. */
static void name_harmonic(const cJSON *k, char *out, size_t room)
{
    size_t used = 0;

    if (!cJSON_IsArray(k)) {
        snprintf(out, room, "%g", cJSON_IsNumber(k) ? k->valuedouble : NAN);
        return;
    }
    for (int j = 0; j < cJSON_GetArraySize(k) && used < room; j++)
        used += (size_t)snprintf(out + used, room - used, "%c%g", j > 0 ? ',' : '(',
                                 field_at(k, j));
    if (used < room)
        snprintf(out + used, room - used, ")");
}

static void show_harmonics(const cJSON *result)
{
    const cJSON *dof;

    cJSON_ArrayForEach(dof, field_get(result, "harmonics")) {
        int n = cJSON_GetArraySize(field_get(dof, "k"));
        for (int i = 0; i < n && i < HARMONICS_SHOWN; i++) {
            double re = field_at(field_get(dof, "re"), i), im = field_at(field_get(dof, "im"), i);
            char name[64];

            name_harmonic(cJSON_GetArrayItem(field_get(dof, "k"), i), name, sizeof name);
            printf("  %-12s %4s %16.9g %12.6g rad\n", i ? "" : text(dof, "dof"), name,
                   hypot(re, im), atan2(im, re));
        }
        if (n > HARMONICS_SHOWN)
            printf("  %-12s ... %d harmonics\n", "", n);
    }
}

/* A nonlinear mode over its amplitude. */
static void show_backbone(const cJSON *result)
{
    const cJSON *point, *linear = field_get(result, "linear");

    printf("mode %g: %.9g rad/s, damping ratio %.6g where it is small\n",
           field_real(result, "mode"), field_real(linear, "omega"),
           field_real(linear, "damping_ratio"));
    printf("%14s %14s %14s %14s %12s %10s\n", "amplitude", "rad/s", "Hz", "damping ratio", "energy",
           "converged");
    cJSON_ArrayForEach(point, field_get(result, "points")) {
        printf("%14.6g %14.9g %14.9g", field_real(point, "amplitude"), field_real(point, "omega"),
               field_real(point, "frequency_hz"));
        cell(14, "%.6g", field_real(point, "damping_ratio"));
        cell(12, "%.6g", field_real(point, "energy"));
        printf(" %10s\n", cJSON_IsTrue(field_get(point, "converged")) ? "yes" : "no");
    }
}

/* |X_1| of the first dof; of several TONES the largest |X_k| beside its mean. */
static double size_of(const cJSON *point, bool tones)
{
    const cJSON *first = cJSON_GetArrayItem(field_get(point, "harmonics"), 0);
    double most = hypot(field_at(field_get(first, "re"), 1), field_at(field_get(first, "im"), 1));

    for (int i = 2; tones && i < cJSON_GetArraySize(field_get(first, "re")); i++)
        most = fmax(most, hypot(field_at(field_get(first, "re"), i),
                                field_at(field_get(first, "im"), i)));
    return most;
}

static void show_points(const cJSON *result)
{
    const char *parameter = text(result, "parameter");
    const cJSON *point, *special;
    bool tones = field_get(cJSON_GetArrayItem(field_get(result, "points"), 0), "tones") != NULL;

    printf("%16s %10s %12s %12s\n", parameter, "converged", tones ? "max |X_k|" : "|X_1|",
           "stability");
    cJSON_ArrayForEach(point, field_get(result, "points")) {
        printf("%16.9g %10s",
               field_real(point, cJSON_HasObjectItem(point, "value") ? "value" : "omega"),
               cJSON_IsTrue(field_get(point, "converged")) ? "yes" : "no");
        cell(12, "%.6g", size_of(point, tones));
        printf(" %12s\n", verdict(field_get(point, "stability")));
    }
    cJSON_ArrayForEach(special, field_get(result, "folds"))
        printf("fold at %.9g\n", field_real(special, parameter));
    cJSON_ArrayForEach(special, field_get(result, "bifurcations"))
        printf("%s at %.9g\n", text(special, "type"), field_real(special, parameter));
    if (cJSON_HasObjectItem(result, "reason"))
        printf("not complete: %s\n", text(result, "reason"));
}

static void show_steady(const cJSON *result)
{
    const cJSON *tones = field_get(result, "tones");

    printf("%s, %s %.9g",
           cJSON_IsTrue(field_get(result, "converged")) ? "converged" : "NOT converged",
           tones != NULL ? "tones" : "omega",
           tones != NULL ? field_at(tones, 0) : field_real(result, "omega"));
    for (int j = 1; j < cJSON_GetArraySize(tones); j++)
        printf(", %.9g", field_at(tones, j));
    printf(" rad/s, %s, %g iterations, residual", text(result, "method"),
           field_real(result, "iterations"));
    cell(0, "%.2e", field_real(result, "residual"));
    printf(", truncation error");
    cell(0, "%.2e", field_real(result, "truncation_error"));
    putchar('\n');
    printf("  %-12s %4s %16s %12s\n", "dof", "k", "|X_k|", "phase");
    show_harmonics(result);
    show_stability(field_get(result, "stability"), field_get(result, "modes"));
}

static void show_multipliers(const cJSON *list)
{
    const cJSON *pair;

    if (list == NULL)
        return;
    printf("%-14s %16s %16s %16s\n", "multipliers", "re", "im", "magnitude");
    cJSON_ArrayForEach(pair, list) {
        printf("%14s", "");
        cell(16, "%.10g", field_at(pair, 0));
        cell(16, "%.10g", field_at(pair, 1));
        cell(16, "%.10g", hypot(field_at(pair, 0), field_at(pair, 1)));
        putchar('\n');
    }
}

static void show_exponents(const cJSON *list)
{
    const cJSON *pair;

    printf("%-14s %16s %16s %16s %16s\n", "exponents", "Re 1/s", "Im rad/s", "frequency Hz",
           "damping ratio");
    cJSON_ArrayForEach(pair, list) {
        double re = field_at(pair, 0), size = hypot(re, field_at(pair, 1));
        printf("%14s", "");
        cell(16, "%.10g", re);
        cell(16, "%.10g", field_at(pair, 1));
        cell(16, "%.10g", size / (2 * M_PI));
        cell(16, "%.7g", -re / size);
        putchar('\n');
    }
}

static void show_floquet(const cJSON *result)
{
    show_multipliers(field_get(result, "multipliers"));
    show_exponents(field_get(result, "exponents"));
    show_stability(field_get(result, "stability"), field_get(result, "modes"));
}

static void show_tradeoff(const cJSON *result)
{
    const cJSON *rung;
    int i = 0, recommended = field_index(result, "recommended");

    printf("%3s %12s %12s %7s  settings\n", "", "error", "seconds", "pareto");
    cJSON_ArrayForEach(rung, field_get(result, "rungs")) {
        char *settings = json_print(field_get(rung, "settings"));
        printf("%3d", i);
        cell(12, "%.3e", field_real(rung, "error"));
        cell(12, "%.3e", field_real(rung, "seconds"));
        printf(" %7s  %s%s\n", cJSON_IsTrue(field_get(rung, "pareto")) ? "yes" : "",
               settings ? settings : "", i == recommended ? "  <- recommended" : "");
        cJSON_free(settings);
        i++;
    }
    if (cJSON_IsNumber(field_get(result, "bound_at_2x")))
        printf("the data's own error %.3e; with twice the record %.3e\n",
               field_real(result, "bound"), field_real(result, "bound_at_2x"));
}

static void show_ablate(const cJSON *result)
{
    const cJSON *effect, *change;

    printf("%-24s %12s  change without it\n", "effect", "seconds");
    cJSON_ArrayForEach(effect, field_get(result, "effects")) {
        printf("%-24s", text(effect, "type"));
        cell(12, "%.3e", field_real(effect, "seconds"));
        cJSON_ArrayForEach(change, field_get(effect, "change"))
            if (cJSON_IsNumber(change))
                printf("  %s %.4g", change->string, change->valuedouble);
        putchar('\n');
    }
}

static void show_sweep(const cJSON *result)
{
    const cJSON *grid = field_get(result, "grid"), *point, *axis;

    const bool moves = strcmp(text(result, "verb"), "steady") == 0;

    cJSON_ArrayForEach(axis, grid)
        printf(" %22s", text(axis, "path"));
    printf(" %12s %16s %14s%s\n", "stability", "multiplier", moves ? "amplitude" : "margin 1/s",
           moves ? "  of" : "");
    cJSON_ArrayForEach(point, field_get(result, "points")) {
        const cJSON *stability = field_get(point, "stability");
        int i = 0;
        cJSON_ArrayForEach(axis, grid)
            cell(22, "%.9g", field_at(field_get(axis, "values"),
                                      field_index_at(field_get(point, "index"), i++)));
        printf(" %12s", verdict(stability));
        cell(16, "%.9g", field_real(stability, "max_multiplier"));
        if (moves) {
            struct sweep_amplitude a = sweep_amplitude(point);
            cell(14, "%.6g", a.size);
            printf("  %s", a.dof);
        } else
            cell(14, "%.6g", field_real(stability, "margin"));
        if (sweep_failure(point)[0] != '\0')
            printf("  %s: %s", field_word(field_get(point, "error"), "code", "not converged"),
                   sweep_failure(point));
        putchar('\n');
    }
}

static void show_nothing(const cJSON *result)
{
    (void)result;
}

static const struct { const char *kind; void (*show)(const cJSON *); } shows[] = {
    { "identify", show_identify }, { "steady", show_steady }, { "curve", show_points },
    { "backbone", show_backbone }, { "simulate", show_nothing }, { "floquet", show_floquet },
    { "tradeoff", show_tradeoff }, { "ablate", show_ablate }, { "sweep", show_sweep },
};

void show_result(const char *kind, const cJSON *result)
{
    for (size_t i = 0; i < sizeof shows / sizeof shows[0]; i++)
        if (strcmp(shows[i].kind, kind) == 0)
            shows[i].show(result);
    show_plan(result);
    show_diagnostics(result);
    show_cost(result);
}
