/* plan.c - see plan.h; tested by tests/unit/job/test_scene_jobs.c */
#include "job/plan.h"
#include <math.h>
#include <stdlib.h>
#include <time.h>
#include "modal/scene/craig_bampton.h"

enum {
    CALIBRATION_CALLS = 2000,        /* of some 10 ns each: well above the clock's grain, far below
                                        a job */
    LAW_MEMORY_CALIBRATED = 256      /* doubles on the stack; laws with more are a user's own */
};

/* Seconds of one evaluation of LAW, over states that cross its regimes; laws that cannot be
 * asked out of turn (a user's own, with its memory) are left at 0. */
static double unit_cost(const struct law *law)
{
    struct timespec a, b;
    double memory[LAW_MEMORY_CALIBRATED] = { 0 }, after[LAW_MEMORY_CALIBRATED];

    if (law->memory > LAW_MEMORY_CALIBRATED || law->kind->restart != NULL)
        return 0;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
    for (int i = 0; i < CALIBRATION_CALLS; i++) {
        double d[LAW_INPUTS_MOST] = { (i % 16 - 8) * 1e-3, (i % 8 - 4) * 1e-3 },
               v[LAW_INPUTS_MOST] = { (i % 4 - 2) * 1e-3, 1e-3 };
        struct law_point at = { 1e-3 * i, d, v, memory };
        struct law_force f = { .memory = after };
        if (law->kind->force(law, &at, &f, NULL) != MODAL_OK)
            return 0;
    }
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
    return ((double)(b.tv_sec - a.tv_sec) + 1e-9 * (double)(b.tv_nsec - a.tv_nsec))
           / CALIBRATION_CALLS;
}

/* One law's cost: of a thousand contacts one is timed. */
struct timed { const struct law_class *kind; double each; };

/* To three digits: more would be the clock's noise, and long to print. */
static double three_digits(double x)
{
    double unit = x > 0 ? pow(10, 2 - floor(log10(x))) : 0;

    return isfinite(unit) && unit > 0 ? rint(x * unit) / unit : x;
}

/* LAW: the first of effect E, -1 where it has none. */
static double seconds_of(const struct program *p, const struct program_effect *e, int law,
                         struct timed *last)
{
    if (e->seconds > 0 || e->evaluations == 0 || law < 0)
        return e->seconds;
    if (p->law[law].kind != last->kind)
        *last = (struct timed){ p->law[law].kind, unit_cost(&p->law[law]) };
    return three_digits((double)e->evaluations * last->each);
}

/* The first law of each effect, -1: none; NULL without memory.  The caller frees. */
static int *first_laws(const struct program *p)
{
    int *first = malloc(((size_t)p->effects + 1) * sizeof *first);

    for (int i = 0; first != NULL && i < p->effects; i++)
        first[i] = -1;
    for (int l = p->laws - 1; first != NULL && l >= 0; l--)
        first[p->law[l].effect] = l;
    return first;
}

cJSON *plan_print(const struct program *p, const char *integrator)
{
    cJSON *plan = cJSON_CreateObject(), *effects;
    struct timed last = { 0 };
    int *first = first_laws(p);

    cJSON_AddStringToObject(plan, "class", program_class_name(program_class(p)));
    cJSON_AddNumberToObject(plan, "states", program_states(p));
    cJSON_AddStringToObject(plan, "integrator", integrator);
    cJSON_AddStringToObject(plan, "hash", p->hash);
    effects = cJSON_AddArrayToObject(plan, "effects");
    for (int i = 0; i < p->effects; i++) {
        const struct program_effect *e = &p->effect[i],
                                    *does = e->carrier > 0 ? &p->effect[e->carrier - 1] : e;
        cJSON *row = cJSON_CreateObject();

        cJSON_AddStringToObject(row, "type", e->type);
        cJSON_AddNumberToObject(row, "states", e->states);
        cJSON_AddNumberToObject(row, "evaluations", (double)does->evaluations);
        json_set_number(row, "seconds",
                        seconds_of(p, does, first != NULL ? first[does - p->effect] : -1, &last));
        cJSON_AddBoolToObject(row, "active", does->active);
        cJSON_AddItemToArray(effects, row);
    }
    free(first);
    return plan;
}

void plan_add_reduction(cJSON *plan, const struct craig_bampton *r)
{
    cJSON *o;

    if (r == NULL)
        return;
    o = cJSON_AddObjectToObject(plan, "reduction");
    cJSON_AddNumberToObject(o, "kept", r->kept);
    cJSON_AddNumberToObject(o, "modes", r->modes);
    json_set_number(o, "highest", r->highest);
    json_set_number(o, "next", isfinite(r->next) ? r->next : NAN);
}
