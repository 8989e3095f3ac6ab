/*
 * shaft_sensor.c - what a sensor on a shaft reads: a coordinate, as a dof or eliminated, on the
 * axes it names
 */
#include "modal/scene/structures/shaft_parts.h"
#include <stdio.h>
#include <string.h>
#include "base/near.h"

/* Dof or coordinate NAME as a coordinate: massless 0 .. 7, else the dof itself in plane y's or
 * z's place; -1: none. */
static int coordinate_of(const struct lowering *l, const char *name)
{
    const struct shaft *s = l->mesh;
    char other[32];

    if (!s->massless)  /* coordinates are dofs */
        return program_dof(l->p, name);
    for (int c = 0; c < 2 * PLANE; c++) {
        shaft_coordinate_name(s, c, false, other);
        if (strcmp(name, other) == 0)
            return c;
    }
    return -1;
}

/* Where WHAT stands in LIST; -1: nowhere. */
static int index_in(const int *list, int count, int what)
{
    for (int i = 0; i < count; i++)
        if (list[i] == what)
            return i;
    return -1;
}

/* The journal's own place: r = f + [row f of (M x'' + C x' + K x - F b)]/K_rr, the law being all
 * else that acts on f. */
static bool journal_terms(struct lowering *l, int plane, double factor, struct program_output *out)
{
    const struct shaft *s = l->mesh;
    const struct condensed *c = &s->condensed;
    int row = 2 * plane + 1, f = s->dof[SD + plane * PLANE];
    double scale = factor / s->journal_stiffness[plane];  /* 1 / K_rr */

    for (int i = 0; i < l->p->loads; i++)
        if (l->p->load[i].dof == f || l->p->load[i].dof_sine == f)
            return false;  /* a load on f acts there too: r is not known by these rows */
    lowering_add_term(l, out, 0, f, factor);
    for (int j = 0; j < c->nx; j++) {
        lowering_add_term(l, out, 0, s->dof[c->x[j]], scale * c->K[row * c->nx + j]);
        lowering_add_term(l, out, 1, s->dof[c->x[j]], scale * c->C[row * c->nx + j]);
        lowering_add_term(l, out, 2, s->dof[c->x[j]], scale * c->M[row * c->nx + j]);
    }
    for (int j = 0; j < c->nb; j++)
        lowering_add_term(l, out, 3, s->state + j, -scale * c->F[row * c->nb + j]);
    return true;
}

/* factor times the DERIVATIVE-th rate of coordinate c, on the program's own axes; false: it has
 * no such row. */
static bool coordinate_terms(struct lowering *l, int c, int derivative, double factor,
                             struct program_output *out)
{
    const struct shaft *s = l->mesh;
    const struct condensed *k = &s->condensed;
    int plane = c / PLANE, q = c % PLANE, at;  /* as coordinates are numbered */

    if (!s->massless) {
        lowering_add_term(l, out, derivative, c, factor);
        return true;
    }
    if (s->journal >= 0 && q == (s->journal == SHAFT_LEFT ? UL : UR))
        return derivative == 0 && journal_terms(l, plane, factor, out);
    if (s->journal >= 0 && q == SD) {
        lowering_add_term(l, out, derivative, s->dof[UD + plane * PLANE],
                          factor * s->journal_map[plane][0]);
        lowering_add_term(l, out, derivative, s->dof[c], factor * s->journal_map[plane][1]);
        return true;
    }
    if (s->dof[c] >= 0) {
        lowering_add_term(l, out, derivative, s->dof[c], factor);
        return true;
    }
    if ((at = index_in(k->b, k->nb, c)) >= 0) {
        lowering_add_term(l, out, 3, s->state + at, factor);
        return derivative == 0;  /* a first-order state has no rate of its own row */
    }
    if ((at = index_in(k->a, k->na, c)) < 0 || s->fixed)
        return false;
    for (int j = 0; j < k->nx; j++)
        lowering_add_term(l, out, derivative, s->dof[k->x[j]], factor * k->Rx[at * k->nx + j]);
    for (int j = 0; j < k->nb; j++)
        lowering_add_term(l, out, 3, s->state + j, factor * k->Rb[at * k->nb + j]);
    return derivative == 0 || k->nb == 0;
}

/* The same coordinate seen from fixed axes: rows of D = q, q' + W J q, q'' + 2 W J q' - W^2 q,
 * turned. */
static bool turned_terms(struct lowering *l, int c, int derivative, struct program_output *out)
{
    const struct shaft *s = l->mesh;
    int half = s->massless ? PLANE : 2, y = s->massless ? c % PLANE : c & ~2,
        plane = s->massless ? c / PLANE : (c & 2) / 2;
    double W = s->speed;  /* D = q' + W J q and its rate */
    bool found = true;  /* all of its rows must be there */

    for (int p = 0; p < 2; p++) {                       /* D_y, then D_z */
        int own = y + p * half, other = y + (1 - p) * half, first = out->count;
        double J = p == 0 ? -1 : 1;                     /* (J q)_y = -q_z, (J q)_z = q_y */
        /* y: cos D_y - sin D_z;  z: sin D_y + cos D_z */
        double weight = plane == 0 && p == 1 ? -1 : 1;
        int shift = plane == p ? 4 : 8;

        found = found && coordinate_terms(l, own, derivative, weight, out);
        if (derivative == 1)
            found = found && coordinate_terms(l, other, 0, weight * W * J, out);
        if (derivative == 2) {
            found = found && coordinate_terms(l, other, 1, weight * 2 * W * J, out);
            found = found && coordinate_terms(l, own, 0, -weight * W * W, out);
        }
        for (int t = first; t < out->count; t++)
            out->terms[t].i += shift;  /* times cos or sin */
    }
    return found;
}

enum { ABSENT = -1 };              /* a frame that is not given: that of the structure */

struct keys { const char *dof, *name; int derivative, frame; };

static const char *const of_shaft[] = { "shaft", NULL };
static const struct scene_key keys[] = {
    { "dof", SCENE_TEXT, offsetof(struct keys, dof), .needed = true,
      .means = "y<i>, sy<i>, z<i>, sz<i> of node i; a massless shaft's ends too",
      .example = "\"y1\"" },
    { "derivative", SCENE_WHOLE, offsetof(struct keys, derivative), "", 0, 2, .means = "in time",
      .example = "1" },
    { "frame", SCENE_WORD, offsetof(struct keys, frame), .words = shaft_frames, .standard = ABSENT,
      .otherwise = "the structure's", .means = "axes on which it is read", .example = "\"fixed\"" },
    { "name", SCENE_TEXT, offsetof(struct keys, name), .otherwise = "the dof's, with _dot or _ddot",
      .means = "of the channel", .example = "\"disk\"" },
    { 0 },
};
const struct scene_table shaft_sensors[] = {
    { .list = "sensors", .structures = of_shaft, .keys = { keys },
      .law = "a dof or a coordinate without mass, on turning or on fixed axes" },
    { 0 },
};

enum modal_status shaft_sensor(struct lowering *l, const cJSON *json, const char *path,
                               struct program_output *out, struct modal_error *err)
{
    const struct shaft *s = l->mesh;
    struct keys k = { 0 };
    int face = s->fixed || s->seen_fixed ? 1 : 0, own = s->fixed ? 1 : 0, c;
    char where[128], text[96], meant[NEAR_TEXT];
    enum modal_status rc = scene_keys_read(l, json, path, shaft_sensors[0].keys, &k, err);

    if (rc != MODAL_OK)
        return rc;
    if (k.frame == ABSENT)
        k.frame = face;
    json_path(where, path, "dof");
    if ((c = coordinate_of(l, k.dof)) < 0) {
        near_given(k.dof, (const char *const *)l->p->dofs, (size_t)l->p->n, meant);
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "no dof \"%.40s\" in this shaft%s; its dofs run from %s to %s",
                                k.dof, meant, l->p->dofs[0], l->p->dofs[l->p->n - 1]);
    }
    if (k.frame == 0 && face == 1) {
        json_path(where, path, "frame");
        return modal_fail_field(
            err, MODAL_BAD_INPUT, where,
            "%s: on fixed axes sensors are fixed too; use structure.frame \"rotating\"", where);
    }
    if (!(k.frame == own ? coordinate_terms(l, c, k.derivative, 1, out)
                         : turned_terms(l, c, k.derivative, out)))
        return modal_fail_field(
            err, MODAL_BAD_INPUT, where,
            "%s: \"%.40s\" has no output row of derivative %d in this model (an end without mass)",
            where, k.dof, k.derivative);
    snprintf(text, sizeof text, "%.40s%s%s", k.dof, lowering_suffix[k.derivative],
             k.frame == face ? "" : "_fixed");
    out->name = strdup(k.name != NULL ? k.name : text);
    return out->name != NULL ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "shaft: out of memory");
}
