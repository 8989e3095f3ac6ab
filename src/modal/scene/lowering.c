/* lowering.c - see lowering.h
 *
 * Entries are kept as triplets in the order in which they come: sums at one place are formed when
 * they are compressed, always in that order, so that a scene gives the same bits every time.
 */
#include "modal/scene/lowering.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/near.h"
#include "modal/scene/scene.h"

static const double WEIGHT_LEAST = 1e-150;  /* of an end: its square, which an entry has, */
static const double WEIGHT_MOST = 1e150;    /* is a double */

/* Grow an array that has COUNT of ROOM elements in use by one more; false: no memory. */
static bool grow(struct lowering *l, void **x, int count, int *room, size_t size)
{
    if (count < *room)  /* room is left */
        return true;
    int more = *room == 0 ? 16 : 2 * *room;  /* doubled: N entries cost N copies in all */
    void *bigger = realloc(*x, (size_t)more * size);
    if (bigger == NULL) {
        l->no_memory = true;  /* told once, at the end */
        return false;
    }
    *x = bigger;
    *room = more;
    return true;
}

/* Past the limit nothing is added and scene_lower says so: adding never fails. */
static void append(struct lowering *l, struct lowering_entries *e, int i, int j, double value)
{
    if (e->count >= LOWERING_ENTRIES_MOST) {
        l->too_many = true;  /* told once, at the end */
        return;
    }
    if (grow(l, (void **)&e->x, e->count, &e->room, sizeof *e->x))
        e->x[e->count++] = (struct triplet) { i, j, value };
}

int lowering_add_dof(struct lowering *l, const char *name)
{
    struct program *p = l->p;
    /* one a dof: realloc grows in place or by pages */
    char **dofs = realloc(p->dofs, ((size_t)p->n + 1) * sizeof *dofs);

    free(p->by_name);                /* without the new one */
    p->by_name = NULL;
    if (dofs != NULL)
        p->dofs = dofs;
    /* the list may have grown all the same */
    if (dofs == NULL || (dofs[p->n] = strdup(name)) == NULL) {
        l->no_memory = true;
        return -1;
    }
    return p->n++;  /* the new one's index */
}

void lowering_add(struct lowering *l, int matrix, int i, int j, double value)
{
    if (i >= 0 && j >= 0)  /* a support or the ground takes no entry */
        append(l, &l->constant[matrix], i, j, value);
}

void lowering_add_still_damping(struct lowering *l, int i, int j, double c)
{
    lowering_add(l, PROGRAM_C, i, j, c);
    if (l->turn_partner != NULL && j >= 0 && l->p->frame_speed != 0)
        /* W Cb J of (1) of shaft.c */
        lowering_add(l, PROGRAM_K, i, l->turn_partner[j], l->p->frame_speed * l->turn_sign[j] * c);
}

/* The harmonic k, made in ascending order where it is new; NULL: no memory. */
static struct lowering_harmonic *harmonic(struct lowering *l, int k)
{
    int at = 0;

    while (at < l->harmonics && l->harmonic[at].k < k)  /* few: a walk serves */
        at++;
    if (at < l->harmonics && l->harmonic[at].k == k)
        return &l->harmonic[at];
    struct lowering_harmonic *more =
        realloc(l->harmonic, ((size_t)l->harmonics + 1) * sizeof *more);
    if (more == NULL) {
        l->no_memory = true;
        return NULL;
    }
    l->harmonic = more;
    /* ascending k */
    memmove(more + at + 1, more + at, (size_t)(l->harmonics - at) * sizeof *more);
    more[at] = (struct lowering_harmonic) { .k = k };  /* empty */
    l->harmonics++;
    return &more[at];
}

void lowering_add_harmonic(struct lowering *l, int matrix, int k, int i, int j, double cosine,
                           double sine)
{
    if (k == 0) {  /* constant: cos 0 = 1, sin 0 = 0 */
        lowering_add(l, matrix, i, j, cosine);
        return;
    }
    if (i < 0 || j < 0 || (cosine == 0 && sine == 0))
        return;
    struct lowering_harmonic *h = harmonic(l, k);
    if (h == NULL)
        return;
    if (cosine != 0)  /* zeros are no entries: an absent part leaves no trace */
        append(l, &h->cosine[matrix], i, j, cosine);
    if (sine != 0)
        append(l, &h->sine[matrix], i, j, sine);
}

void lowering_add_element(struct lowering *l, int matrix, int n, const int *index,
                          const double *values)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            if (values[i * n + j] != 0)  /* nor here */
                lowering_add(l, matrix, index[i], index[j], values[i * n + j]);
}

int lowering_add_states(struct lowering *l, int count)
{
    int first = l->p->n_linear;

    if (count > LOWERING_STATES_MOST - first) {  /* so written that it cannot overflow */
        l->too_many = true;
        return -1;
    }
    l->p->n_linear += count;
    if (l->effect >= 0)
        l->p->effect[l->effect].states += count;  /* plan.effects tells whose they are */
    return first;
}

void lowering_add_block(struct lowering *l, enum lowering_block block, int i, int j, double value)
{
    if (i >= 0 && j >= 0 && value != 0)
        append(l, &l->block[block], i, j, value);
}

void lowering_add_law(struct lowering *l, struct law *law)
{
    struct program *p = l->p;
    struct law *more = realloc(p->law, ((size_t)p->laws + 1) * sizeof *more);

    if (more == NULL) {
        l->no_memory = true;
        law_done(law);  /* it was the program's to free */
        return;
    }
    p->law = more;  /* the old one is gone */
    l->couplings += (double)law_ends(law) * law_ends(law);
    l->too_many |= l->couplings > LOWERING_COUPLINGS_MOST;
    law->effect = l->effect;  /* who is counted and told */
    more[p->laws++] = *law;
    if (l->effect >= 0)
        p->effect[l->effect].states += law->memory;
    *law = (struct law) { 0 };  /* the caller has nothing to free any more */
}

void lowering_add_term(struct lowering *l, struct program_output *out, int quantity, int j,
                       double value)
{
    if (j < 0)
        return;
    struct triplet *more = realloc(out->terms, ((size_t)out->count + 1) * sizeof *more);
    if (more == NULL) {
        l->no_memory = true;
        return;
    }
    out->terms = more;  /* likewise */
    more[out->count++] = (struct triplet) { quantity, j, value };
}

const cJSON *lowering_lists(const struct lowering *l, const char *type, const cJSON *after)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(l->scene, "effects"), *item;
    int position = 0;

    cJSON_ArrayForEach(item, list) {
        const cJSON *name = cJSON_GetObjectItemCaseSensitive(item, "type");
        bool left_out =
            l->options != NULL && position < SCENE_EFFECTS_MOST && l->options->without[position];

        position++;
        if (after != NULL) {
            after = item == after ? NULL : after;  /* up to AFTER all are passed over */
            continue;
        }
        if (!left_out && cJSON_IsString(name) && strcmp(name->valuestring, type) == 0)
            return item;
    }
    return NULL;
}

/* MODAL_BAD_INPUT: NAME, at PATH, is no dof. */
static enum modal_status no_dof(const struct lowering *l, const char *path, const char *name,
                                struct modal_error *err)
{
    char meant[NEAR_TEXT];

    near_given(name, (const char *const *)l->p->dofs, (size_t)l->p->n, meant);
    return modal_fail_field(err, MODAL_BAD_INPUT, path,
                            "no dof \"%.40s\" in this structure%s; its dofs run from %s to %s",
                            name, meant, l->p->n > 0 ? l->p->dofs[0] : "-",
                            l->p->n > 0 ? l->p->dofs[l->p->n - 1] : "-");
}

/* MODAL_BAD_INPUT: ITEM, at PATH, is no name at all; a number is taken for one by many. */
static enum modal_status no_name(const struct lowering *l, const char *path, const cJSON *item,
                                 struct modal_error *err)
{
    char *given = json_print(item);
    enum modal_status rc = modal_fail_field(
        err, MODAL_BAD_INPUT, path, "%s is %.80s; accepted: the name of a dof; they run from "
        "\"%s\" to \"%s\"", path, given ? given : "?", l->p->n > 0 ? l->p->dofs[0] : "-",
        l->p->n > 0 ? l->p->dofs[l->p->n - 1] : "-");

    free(given);
    return rc;
}

enum modal_status lowering_dof(const struct lowering *l, const cJSON *json, const char *base,
                               const char *key, int *dof, struct modal_error *err)
{
    const cJSON *item = json_member(json, key);
    const char *name = item != NULL ? item->valuestring : NULL;  /* borrowed from the scene */
    char path[128];

    if (item == NULL)
        return MODAL_OK;
    json_path(path, base, key);
    if (!cJSON_IsString(item))
        return no_name(l, path, item, err);
    if (strcmp(name, "ground") == 0) {  /* a name that no dof may have */
        *dof = -1;
        return MODAL_OK;
    }
    int found = program_dof(l->p, name);
    if (found < 0)
        return no_dof(l, path, name, err);
    *dof = found;
    return MODAL_OK;
}

/* ITEM, a weight at PATH, into *OUT. */
static enum modal_status read_end(const struct lowering *l, const cJSON *item, const char *path,
                                  struct law_end *out, struct modal_error *err)
{
    int dof = program_dof(l->p, item->string);  /* the ground is none: it does not move */
    double weight = cJSON_IsNumber(item) ? item->valuedouble : 0;

    if (dof < 0)
        return no_dof(l, path, item->string, err);
    if (!(fabs(weight) >= WEIGHT_LEAST && fabs(weight) <= WEIGHT_MOST))
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "%s must be a number that is not 0, of size %g to %g", path,
                                WEIGHT_LEAST, WEIGHT_MOST);
    *out = (struct law_end) { dof, weight };
    return MODAL_OK;
}

enum modal_status lowering_ends_of(const struct lowering *l, const cJSON *value, const char *path,
                                   bool named, struct scene_ends *out, struct modal_error *err)
{
    bool alone = named && cJSON_IsString(value);
    int count = alone ? 1 : cJSON_IsObject(value) ? cJSON_GetArraySize(value) : 0;
    int dof = alone ? program_dof(l->p, value->valuestring) : 0;
    const cJSON *item;
    char where[128];
    enum modal_status rc = MODAL_OK;

    if (count < 1 || count > LAW_ENDS_MOST)
        return modal_fail_field(err, count > 0 ? MODAL_TOO_LARGE : MODAL_BAD_INPUT, path,
                                "%s has %d dofs; accepted: %san object of 1 to %d weights by dof "
                                "name", path, count, named ? "the name of a dof, or " : "",
                                LAW_ENDS_MOST);
    if (dof < 0)
        return no_dof(l, path, value->valuestring, err);
    if ((out->x = malloc((size_t)count * sizeof *out->x)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    if (alone)
        out->x[out->count++] = (struct law_end) { dof, 1 };
    cJSON_ArrayForEach(item, value) {  /* a name has none */
        json_path(where, path, item->string);
        if (rc == MODAL_OK)
            rc = read_end(l, item, where, &out->x[out->count++], err);
    }
    return rc;
}

enum modal_status lowering_ends(const struct lowering *l, const cJSON *json, const char *base,
                                const char *key, bool named, struct scene_ends *out,
                                struct modal_error *err)
{
    const cJSON *value = json_member(json, key);
    char where[128];

    json_path(where, base, key);
    return value != NULL ? lowering_ends_of(l, value, where, named, out, err) : MODAL_OK;
}

const char *const lowering_suffix[3] = { "", "_dot", "_ddot" };

const struct scene_key lowering_ends_keys[] = {
    { "type", SCENE_TEXT, SCENE_ELSEWHERE, .means = "which effect it is" },
    { "dof", SCENE_DOF, offsetof(struct local_ends, dof), .needed = true, .unless = "direction",
      .means = "on which the force acts, and whose displacement counts positive in d",
      .example = "\"x1\"" },
    { "to", SCENE_DOF, offsetof(struct local_ends, to), .otherwise = "\"ground\"",
      .means = "the other end, with the opposite force: d = x_dof - x_to",
      .example = "\"ground\"" },
    { "direction", SCENE_ENDS, offsetof(struct local_ends, along), "",
      .means = "in place of dof and to: d = sum of weight x_dof, and the force on each dof is its "
               "weight times that of the law; not normalised",
      .example = "{\"x1\": 1}" },
    { 0 },
};

enum modal_status lowering_strain_rate(struct lowering *l, double mu, struct modal_error *err)
{
    if (mu != 0 && l->structure->strain_rate != NULL)
        return l->structure->strain_rate(l, mu, err);
    for (int i = 0; mu != 0 && i < l->structural[PROGRAM_K]; i++) {
        struct triplet t = l->constant[PROGRAM_K].x[i];
        lowering_add(l, PROGRAM_C, t.i, t.j, mu * t.value);
    }
    return MODAL_OK;
}

void lowering_along(struct lowering *l, int matrix, struct scene_ends at, double value)
{
    for (int i = 0; value != 0 && i < at.count; i++)  /* of 0, no trace */
        for (int j = 0; j < at.count; j++)
            lowering_add(l, matrix, at.x[i].dof, at.x[j].dof, at.x[i].weight * at.x[j].weight
                                                              * value);
}

void lowering_along_harmonic(struct lowering *l, int k, struct scene_ends at,
                             double cosine, double sine)
{
    for (int i = 0; i < at.count; i++)
        for (int j = 0; j < at.count; j++) {
            double w = at.x[i].weight * at.x[j].weight;

            lowering_add_harmonic(l, PROGRAM_K, k, at.x[i].dof, at.x[j].dof, w * cosine, w * sine);
        }
}

void lowering_place(struct lowering *l, struct law *law, int input, struct scene_ends at)
{
    if (!law_add_ends(law, input, at.x, at.count))
        l->no_memory = true;  /* as adding any */
}

enum modal_status lowering_need_omega(const struct lowering *l, const char *who,
                                      struct modal_error *err)
{
    if (l->p->omega > 0)  /* a shaft's speed has set it by now */
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, "omega",
                            "%s needs the scene's omega [rad/s], a number > 0", who);
}

double *lowering_structural_dense(const struct lowering *l, int matrix)
{
    int n = l->p->n;  /* of the structure: effects add no dofs */
    double *a = calloc((size_t)n * (size_t)n + 1, sizeof *a);

    for (int e = 0; a != NULL && e < l->structural[matrix]; e++) {
        const struct triplet *t = &l->constant[matrix].x[e];
        a[t->i + (size_t)t->j * (size_t)n] += t->value;  /* entries of one place add up */
    }
    return a;
}
