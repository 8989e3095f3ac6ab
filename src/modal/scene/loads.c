/* loads.c - see loads.h
 *
 * An entry's type says which tables of keys it is read by; all types are read into one struct, of
 * which each uses its part, and become one program_load.
 */
#include "modal/scene/loads.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "modal/scene/noise.h"
#include "modal/scene/scene.h"

enum { ABSENT = -1 };              /* a frame that is not given: that of the structure */
enum { NOISE = LOAD_TABLE + 1 };   /* a type of entries only: what it draws is a table */
enum { DRAWN_MOST = 10000000 };    /* values of a scene's tables where some are drawn: 160 MB */
enum { ROTATING, FIXED };
static const char *const frames[] = { [ROTATING] = "rotating", [FIXED] = "fixed", NULL };

struct keys {                      /* of all types: each reads those of its own tables */
    int dof, frame, seed;  /* frame: of `frames`, or ABSENT */
    const cJSON *k;  /* of a harmonic */
    double cosine, sine, start, amplitude, duration, psd, corner;
    const cJSON *points;  /* of a table */
    struct scene_numbers time, force;
};

static const struct scene_key load_keys[] = {
    /* of all */
    { "type", SCENE_TEXT, SCENE_ELSEWHERE, .otherwise = "\"harmonic\"",
      .means = "what it is in time" },
    { "dof", SCENE_DOF, offsetof(struct keys, dof), .needed = true,
      .means = "on which p(t) acts, positive along it", .example = "\"x1\"" },
    { "frame", SCENE_WORD, offsetof(struct keys, frame), .words = frames, .standard = ABSENT,
      .otherwise = "the structure's",
      .means = "on a shaft: axes on which the load keeps its direction", .example = "\"fixed\"" },
    { 0 },
};
static const struct scene_key harmonic_keys[] = {
    { "k", SCENE_OWN, offsetof(struct keys, k), .otherwise = "1",
      .means =
          "harmonic of the scene's omega, 0 to 1000, 0: constant; [k1, k2] or [k1, k2, k3]: "
          "k omega is the sum of k_j W_j, W the tones of steady.tones",
      .example = "2" },
    { "cos", SCENE_NUMBER, offsetof(struct keys, cosine), "N", -HUGE_VAL, HUGE_VAL,
      .means = "a of a cos(k omega t)", .example = "1.5" },
    { "sin", SCENE_NUMBER, offsetof(struct keys, sine), "N", -HUGE_VAL, HUGE_VAL,
      .means = "b of b sin(k omega t)", .example = "-2" },
    { 0 },
};
static const struct scene_key start_keys[] = {         /* of all but harmonics */
    { "start", SCENE_NUMBER, offsetof(struct keys, start), "s", 0, HUGE_VAL,
      .means = "when it begins, tau = t - start; the motion begins at 0", .example = "0.1" },
    { 0 },
};
static const struct scene_key impulse_keys[] = {
    { "amplitude", SCENE_NUMBER, offsetof(struct keys, amplitude), "N s", -HUGE_VAL, HUGE_VAL,
      .needed = true, .means = "jump of momentum at start", .example = "0.5" },
    { 0 },
};
static const struct scene_key pulse_keys[] = {
    { "amplitude", SCENE_NUMBER, offsetof(struct keys, amplitude), "N", -HUGE_VAL, HUGE_VAL,
      .needed = true, .means = "a in the law", .example = "10" },
    { "duration", SCENE_NUMBER, offsetof(struct keys, duration), "s", SCENE_POSITIVE, HUGE_VAL,
      .needed = true, .means = "T in the law; 0 before and after", .example = "0.05" },
    { 0 },
};
static const struct scene_key step_keys[] = {
    { "amplitude", SCENE_NUMBER, offsetof(struct keys, amplitude), "N", -HUGE_VAL, HUGE_VAL,
      .needed = true, .means = "from start on", .example = "10" },
    { "duration", SCENE_NUMBER, offsetof(struct keys, duration), "s", SCENE_POSITIVE, HUGE_VAL,
      .standard = HUGE_VAL, .otherwise = "without end", .means = "how long", .example = "2" },
    { 0 },
};
static const struct scene_key table_keys[] = {
    { "amplitude", SCENE_NUMBER, offsetof(struct keys, amplitude), "", -HUGE_VAL, HUGE_VAL,
      .standard = 1, .means = "factor on all forces", .example = "2" },
    { "points", SCENE_OWN, offsetof(struct keys, points), .needed = true, .unless = "time",
      .means = "[t, force] in s after start and N, t ascending; linear between, 0 outside",
      .example = "[[0, 1], [0.5, 2], [2, 0]]" },
    { "time", SCENE_NUMBERS, offsetof(struct keys, time), "s", -HUGE_VAL, HUGE_VAL,
      .otherwise = "points", .means = "t of the points, ascending", .example = "[0, 0.5]" },
    { "force", SCENE_NUMBERS, offsetof(struct keys, force), "N", -HUGE_VAL, HUGE_VAL,
      .otherwise = "points", .means = "force of the points, as many as time", .example = "[1, 2]" },
    { 0 },
};

static const struct scene_key noise_keys[] = {
    { "psd", SCENE_NUMBER, offsetof(struct keys, psd), "N^2/Hz", 0, SCENE_LARGE, .needed = true,
      .means = "one-sided density, from 0 to 1 / (2 dt) of the scene's time", .example = "0.5" },
    { "corner", SCENE_NUMBER, offsetof(struct keys, corner), "Hz", SCENE_POSITIVE, HUGE_VAL,
      .standard = HUGE_VAL, .otherwise = "white",
      .means = "where the density has fallen by half", .example = "20" },
    { "seed", SCENE_WHOLE, offsetof(struct keys, seed), "", 0, 2147483647, .needed = true,
      .means = "of the draw: the same seed, dt and duration give the same force", .example = "1" },
    { 0 },
};

/* In the order of enum program_load_type, then NOISE; tau = t - start. */
const struct scene_table loads_types[] = {
    [LOAD_HARMONIC] = { "excitation", "harmonic", NULL, { load_keys, harmonic_keys },
                        "p = cos cos(k omega t) + sin sin(k omega t)" },
    [LOAD_IMPULSE] = { "excitation", "impulse", NULL, { load_keys, start_keys, impulse_keys },
                       "momentum jumps by amplitude at start" },
    [LOAD_HALF_SINE] = { "excitation", "half_sine", NULL, { load_keys, start_keys, pulse_keys },
                         "p = a sin(pi tau / T), 0 < tau < T" },
    [LOAD_ONE_MINUS_COSINE] = { "excitation", "one_minus_cosine", NULL,
                                { load_keys, start_keys, pulse_keys },
                                "p = a (1 - cos(2 pi tau / T)), 0 < tau < T" },
    [LOAD_STEP] = { "excitation", "step", NULL, { load_keys, start_keys, step_keys },
                    "p = amplitude, 0 < tau < duration" },
    [LOAD_TABLE] = { "excitation", "table", NULL, { load_keys, start_keys, table_keys },
                     "p = amplitude force(tau), linear between its points, 0 outside" },
    [NOISE] = { "excitation", "noise", NULL, { load_keys, start_keys, noise_keys },
                "normal, of density psd / (1 + (f / corner)^2); linear between values each dt; for "
                "simulate" },
    { 0 },
};
enum { TYPES = sizeof loads_types / sizeof *loads_types - 1 };

/* `points` as two arrays. */
static enum modal_status read_points(const cJSON *list, const char *path, struct program_load *load,
                                     struct modal_error *err)
{
    const cJSON *point;
    char where[160];
    int n = cJSON_IsArray(list) ? cJSON_GetArraySize(list) : 0;

    if (!cJSON_IsArray(list)) {
        json_path(where, path, "points");
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s must be a list of [t, force]; no file stands for it", where);
    }
    /* the load's from the start: program_free frees */
    load->time = malloc(((size_t)n + 1) * sizeof *load->time);
    load->force = malloc(((size_t)n + 1) * sizeof *load->force);
    if (load->time == NULL || load->force == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    cJSON_ArrayForEach(point, list) {
        /* NULL where it is no list */
        const cJSON *t = cJSON_GetArrayItem(point, 0), *f = cJSON_GetArrayItem(point, 1);
        if (!cJSON_IsArray(point) || cJSON_GetArraySize(point) != 2 || !cJSON_IsNumber(t)
            || !cJSON_IsNumber(f)) {
            snprintf(where, sizeof where, "%.90s.points[%d]", path, load->points);
            return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s must be [t, force]", where);
        }
        load->time[load->points] = t->valuedouble;  /* points counts what program_free finds */
        load->force[load->points++] = f->valuedouble;
    }
    return MODAL_OK;
}

/* `time` and `force` become the load's. */
static enum modal_status move_lists(struct keys *k, const char *path, struct program_load *load,
                                    struct modal_error *err)
{
    char where[128];

    json_path(where, path, "force");
    if (k->time.count != k->force.count)
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s has %zu numbers, time has %zu; as many of each", where,
                                k->force.count, k->time.count);
    if (k->time.count <= LOWERING_POINTS_MOST)
        load->points = (int)k->time.count;  /* past the limit they stay 0, and are refused */
    load->time = k->time.x;
    load->force = k->force.x;
    k->time.x = k->force.x = NULL;  /* the load's now */
    return MODAL_OK;
}

/* Points or two lists, of ascending times; forces times the amplitude. */
static enum modal_status read_table(struct keys *k, const char *path, struct program_load *load,
                                    struct modal_error *err)
{
    enum modal_status rc = k->points != NULL ? read_points(k->points, path, load, err)
                                             : move_lists(k, path, load, err);
    const char *key = k->points != NULL ? "points" : "time";  /* for messages: what the scene has */
    char where[160];

    if (rc != MODAL_OK)
        return rc;
    json_path(where, path, key);
    if (load->points < 2 || load->points > LOWERING_POINTS_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: a table has 2 to %d points",
                                where, LOWERING_POINTS_MOST);
    for (int i = 1; i < load->points; i++)
        if (load->time[i] <= load->time[i - 1]) {  /* a jump is two steps, not two points */
            snprintf(where, sizeof where, "%.90s.%s[%d]", path, key, i);
            return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                    "%s: times must ascend; %g follows %g", where, load->time[i],
                                    load->time[i - 1]);
        }
    for (int i = 0; i < load->points; i++)
        load->force[i] *= load->amplitude;  /* once here, not at every instant */
    return MODAL_OK;
}

/* A table of what is drawn, a value each step of TIME, past the end of the record. */
static enum modal_status draw_noise(const struct lowering *l, const struct keys *k,
                                    const char *path, const struct scene_time *time,
                                    struct program_load *load, struct modal_error *err)
{
    struct noise noise = { k->psd, k->corner, time->dt, k->seed };
    double count = time->dt > 0 ? ceil((time->start + time->duration) / time->dt) + 2 : 0;
    double drawn = 0;
    char where[128];

    json_path(where, path, "type");
    if (!(time->dt > 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s: noise is drawn each dt of the scene's `time`, which is absent",
                                where);
    if (!(count <= LOWERING_POINTS_MOST))
        return modal_fail_field(err, MODAL_TOO_LARGE, where,
                                "%s: noise over %g steps of time.dt; at most %d", where, count - 2,
                                LOWERING_POINTS_MOST - 2);
    for (const struct program_load *other = l->p->load; other < load; other++)
        drawn += other->points;
    if (count + drawn > DRAWN_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, where,
                                "%s: with this one tables and noise have %g values; at most %d",
                                where, count + drawn, DRAWN_MOST);
    load->type = LOAD_TABLE;
    load->time = malloc((size_t)count * sizeof *load->time);
    load->force = malloc((size_t)count * sizeof *load->force);
    if (load->time == NULL || load->force == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    load->points = (int)count;
    for (int i = 0; i < load->points; i++)
        load->time[i] = i * time->dt;
    return noise_draw(&noise, load->points, load->force, err);
}

/* A load fixed in space on turning axes acts on two dofs. */
static enum modal_status read_frame(const struct lowering *l, int frame, const char *path,
                                    struct program_load *load, struct modal_error *err)
{
    char where[128];

    load->dof_sine = -1;  /* does not turn */
    if (frame == ABSENT && l->p->seen_fixed)
        frame = FIXED;  /* what is given is given on the axes that are seen */
    if (frame == ABSENT)
        return MODAL_OK;
    json_path(where, path, "frame");
    if (!l->names_frames)  /* no shaft */
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: the axes of a %s do not turn",
                                where, l->structure->name);
    if (frame == ROTATING && (l->turn_partner == NULL || l->p->seen_fixed))
        return modal_fail_field(
            err, MODAL_BAD_INPUT, where,
            "%s: the structure's dofs are on fixed axes; a load on turning ones needs "
            "structure.frame \"rotating\"",
            where);
    if (frame == FIXED && l->turn_partner != NULL) {
        load->dof_sine = l->turn_partner[load->dof];  /* p cos on dof, p sin on its partner */
        load->turn = l->turn_sign[load->dof];
    }
    return MODAL_OK;
}

/* `k` of JSON: a harmonic of omega, or a list, one of each tone. */
static enum modal_status read_k(const struct keys *k, const cJSON *json, const char *path,
                                struct program_load *load, struct modal_error *err)
{
    double *list = NULL;
    size_t count;
    char where[128];
    enum modal_status rc;

    load->k = 1;
    if (!cJSON_IsArray(k->k)) {
        rc = json_get_int(json, path, "k", 0, LOWERING_HARMONIC_MOST, &load->k, err);
        load->tone[0] = load->k;
        return rc;
    }
    json_path(where, path, "k");
    rc = json_get_numbers(json, path, "k", -LOWERING_HARMONIC_MOST, LOWERING_HARMONIC_MOST, &list,
                          &count, err);
    if (rc == MODAL_OK && (count < 2 || count > PROGRAM_TONES_MOST))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where,
                              "%s has %zu numbers; accepted: a whole number, or two or three, one "
                              "of each tone", where, count);
    for (size_t j = 0; rc == MODAL_OK && j < count; j++) {
        load->tone[load->tones++] = (int)list[j];
        if ((int)list[j] != list[j])
            rc = modal_fail_field(err, MODAL_BAD_INPUT, where,
                                  "%s holds %g; accepted: whole numbers", where, list[j]);
    }
    free(list);
    return rc;
}

/* What K says into LOAD, whose type is set. */
static enum modal_status fill_load(const struct lowering *l, struct keys *k, const cJSON *json,
                                   const char *path, const struct scene_time *time,
                                   struct program_load *load,
                                   struct modal_error *err)
{
    char where[128];
    enum modal_status rc;

    json_path(where, path, "dof");
    if ((load->dof = k->dof) < 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: the ground cannot be excited",
                                where);
    if ((rc = read_frame(l, k->frame, path, load, err)) != MODAL_OK)
        return rc;
    load->cosine = k->cosine;
    load->sine = k->sine;
    load->amplitude = k->amplitude;
    load->start = k->start;
    load->duration = k->duration;
    if (load->type == LOAD_HARMONIC && (rc = read_k(k, json, path, load, err)) != MODAL_OK)
        return rc;
    if (load->type == LOAD_HARMONIC && load->k > 0 && load->tones == 0)
        return lowering_need_omega(l, "a harmonic excitation", err);
    if ((int)load->type == NOISE)
        return draw_noise(l, k, path, time, load, err);
    return load->type == LOAD_TABLE ? read_table(k, path, load, err) : MODAL_OK;
}

/* The type first: it says which tables the entry is read by. */
static enum modal_status read_load(const struct lowering *l, const cJSON *json, const char *path,
                                   const struct scene_time *time, struct program_load *load,
                                   struct modal_error *err)
{
    const char *names[TYPES + 1] = { NULL };
    int type = LOAD_HARMONIC;
    struct keys k = { 0 };  /* of all types: what a type has no row for stays 0 */
    enum modal_status rc;

    for (int i = 0; i < TYPES; i++)  /* words of `type`, for the message */
        names[i] = loads_types[i].name;
    if (!cJSON_IsObject(json))
        return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s must be an object", path);
    if ((rc = json_get_choice(json, path, "type", names, &type, err)) != MODAL_OK)
        return rc;
    load->type = (enum program_load_type)type;  /* loads_types is in the enum's order */
    rc = scene_keys_read(l, json, path, loads_types[type].keys, &k, err);
    if (rc == MODAL_OK)
        rc = fill_load(l, &k, json, path, time, load, err);
    scene_keys_free(loads_types[type].keys, &k);  /* what was not moved */
    return rc;
}

enum modal_status loads_lower(struct lowering *l, const cJSON *excitation,
                              const struct scene_time *time, struct modal_error *err)
{
    const cJSON *item;
    char path[32];
    int count;
    enum modal_status rc = MODAL_OK;

    if (excitation == NULL)  /* free motion */
        return MODAL_OK;
    if (!cJSON_IsArray(excitation))
        return modal_fail_field(err, MODAL_BAD_INPUT, "excitation", "excitation must be a list");
    count = cJSON_GetArraySize(excitation);  /* before room is made */
    if (count > LOWERING_LOADS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "excitation",
                                "excitation lists %d loads; at most %d", count,
                                LOWERING_LOADS_MOST);
    /* one more: calloc(0) may be NULL */
    if ((l->p->load = calloc((size_t)count + 1, sizeof *l->p->load)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    cJSON_ArrayForEach(item, excitation) {
        snprintf(path, sizeof path, "excitation[%d]", l->p->loads);
        if (rc == MODAL_OK)
            /* counted before it is read: freed with the program */
            rc = read_load(l, item, path, time, &l->p->load[l->p->loads++], err);
    }
    return rc;
}

void loads_tones(const cJSON *steady, struct program *p)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(steady, "tones");

    for (int j = 0; cJSON_IsArray(list) && j < PROGRAM_TONES_MOST; j++) {
        const cJSON *tone = cJSON_GetArrayItem(list, j);

        p->tones[j] = cJSON_IsNumber(tone) && tone->valuedouble > 0 ? tone->valuedouble : 0;
    }
}
